"""Predictions against truth: reading both, scoring in processes, tables."""
