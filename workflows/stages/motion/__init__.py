"""Stages from labels to groups: everything behind the front ends."""
