"""Settings that are gone: name to words that name the successor, said after the name."""

from __future__ import annotations

GONE: dict[str, str] = {
    "proposals.link_gap": "is linking.gap now",
    "proposals.link_overlap": "is linking.overlap now",
    "labels.guide_eps": "is the constant guide_eps = 1e-4 of zsmoseg.proposals.embedded.guided_filter.GuidedFilter now",
    "objects.clean_pad": "is the constant clean_pad = 0.5 of zsmoseg.proposals.embedded.persistence.Cleanness now",
    "objects.contrast_flow": "is the constant contrast_flow = 1.0 of zsmoseg.proposals.embedded.threshold.Contrast now",
    "objects.part_least": "is the constant part_least = 1.0 of zsmoseg.proposals.embedded.partition.Partition now",
    "objects.part_link": "is the constant part_link = 0.25 of zsmoseg.proposals.embedded.partition.Partition now",
    "objects.part_ratio": "is the constant part_ratio = 2.5 of zsmoseg.proposals.embedded.partition.Partition now",
    "objects.part_share": "is the constant part_share = 0.05 of zsmoseg.proposals.embedded.partition.Partition now",
    "objects.score": "is the constant score = 0.3 of zsmoseg.proposals.embedded.objects.Selection now",
    "objects.smallest": "is the constant smallest = 0.0005 of zsmoseg.proposals.embedded.objects.Selection now",
    "objects.threshold": "is the constant threshold = 0.06 of zsmoseg.proposals.embedded.threshold.Threshold now",
    "objects.threshold_bins": "is the constant threshold_bins = 64 of zsmoseg.proposals.embedded.threshold.Threshold now",
    "objects.threshold_sure": "is the constant threshold_sure = 0.26 of zsmoseg.proposals.embedded.threshold.Threshold now",
    "objects.top_least": "is the constant top_least = 1.0 of zsmoseg.proposals.embedded.full_motion.FullMotion now",
    "objects.trust_least": "is the constant trust_least = 0.05 of zsmoseg.proposals.embedded.visibility.Trust now",
    "tables.link_least": "is the constant link_least = 2 of zsmoseg.proposals.embedded.extraction.Links now",
    "affinity.factor": "went with the kernel inlier; affinity.pair is what two objects may cost more than alone",
    "groups.below_strongest": "went: the strongest always costs more than what affinity.most tolerates",
    "groups.certain": "is affinity.most now, of mean squares",
    "groups.clear": "went: affinity.floor is what is never motion",
    "groups.clear_cells": "went with the cells of the background: affinity.most and affinity.floor are the yardstick now",
    "groups.coherent": "went: what an object's own motion leaves counts in affinity.most",
    "groups.coherent_part": "went: what an object's own motion leaves counts in affinity.most",
    "groups.exist": "went: affinity.floor is what is never motion",
    "groups.floor": "is affinity.floor now",
    "groups.frames": "is groups.least_pairs now",
    "groups.keep": "went: the strongest always costs more than what affinity.most tolerates",
    "groups.noise_area": "is affinity.noise_area now",
    "groups.quantile": "went with the cells of the background: affinity.most and affinity.floor are the yardstick now",
    "groups.rounds": "is affinity.rounds now",
    "groups.same": "is affinity.floor now",
    "groups.same_own": "is affinity.pair now, of mean squares",
    "groups.significant": "went: affinity.most bounds what is tolerated by what costs the world most in all",
    "groups.small": "went: what an object may cost is affinity.most whatever its size",
    "groups.small_fraction": "went: what an object may cost is affinity.most whatever its size",
    "groups.top_fraction": "is affinity.most now, in which the strongest of the pair counts",
    "groups.visible": "is affinity.visible now",
    "statistics.cells_x": "went with the cells of the background: affinity.most and affinity.floor are the yardstick now",
    "statistics.cells_y": "went with the cells of the background: affinity.most and affinity.floor are the yardstick now",
}
"""Whoever renames or removes a setting adds a line here; ``resolve`` answers with it."""

GONE_VALUES: dict[tuple[str, str], str] = {
    ("affinity.kernel", "inlier"): "is merge now",
    ("groups.rule", "calibrated"): "is linkage now",
}
"""The same for values of settings that stay."""
