"""Scores of masks against truth."""

from zsmoseg.metrics.regions import TrackScores, region_j, track_scores

__all__ = ["TrackScores", "region_j", "track_scores"]
