"""Scores of masks against truth."""

from zsmoseg.metrics.contours import boundary_f, boundary_map
from zsmoseg.metrics.regions import region_j
from zsmoseg.metrics.tracks import TrackScores, track_scores

__all__ = ["TrackScores", "boundary_f", "boundary_map", "region_j", "track_scores"]
