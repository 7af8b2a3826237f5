"""Stages of the front end for masks that are given."""
