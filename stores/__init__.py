"""Artifacts: what is on disk and how it gets there whole. Knows neither stages nor Dask."""
