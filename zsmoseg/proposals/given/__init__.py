"""Masks from elsewhere: propagated to the frames without any, and linked to objects."""
