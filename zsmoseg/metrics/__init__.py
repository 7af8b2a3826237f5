"""Scores of masks against truth: one file a measure; ``protocols`` says which belong together."""
