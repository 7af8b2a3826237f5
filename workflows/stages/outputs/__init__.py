"""Stages that leave files in the output folder."""
