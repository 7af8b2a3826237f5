"""Masks followed through the frames: carried along the flow, linked to objects, or tracked, span by span."""
