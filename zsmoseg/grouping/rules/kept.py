"""The rule ``keep``: all proposals move, each by itself."""

from __future__ import annotations

import numpy as np

from zsmoseg.grouping.clustering import Count, Labels
from zsmoseg.motion.models import Floats


def kept_groups(support: Floats, count: Count) -> Labels:
    """Every object a group of its own; with a given number of groups only the largest ones, the rest is static.

    Parameters
    ----------
    support : (N,) pixels of every object, 0 for the background.
    """
    order = np.argsort(-support, kind="stable")
    most = len(order) if count == "auto" else count - 1
    group = np.zeros(len(support), np.int64)
    group[order[:most]] = np.arange(1, len(order) + 1)[:most]
    return np.where(support > 0, group, 0)
