"""Masks, flow and depth that users bring: where they are, whether they fit, what was brought before."""
