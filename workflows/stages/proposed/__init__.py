"""Stages of the front ends for masks that files or networks propose."""
