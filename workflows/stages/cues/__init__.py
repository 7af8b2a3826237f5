"""Stages of the cues: what is computed from pixels and kept."""
