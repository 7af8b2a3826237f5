"""Optical flow: found, checked against the way back, brought to other grids, followed."""
