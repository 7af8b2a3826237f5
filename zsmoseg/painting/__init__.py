"""From objects to what is looked at: numbers, palette images, overlays."""
