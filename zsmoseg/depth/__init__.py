"""Pseudo depth: a plane without weights; maps from elsewhere on the working grid."""
