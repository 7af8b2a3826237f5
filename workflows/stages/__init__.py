"""The stages, by room; ``graph`` has them in order."""
