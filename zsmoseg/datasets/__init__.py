"""Layouts of datasets, and their published lists."""
