"""The tracker of a network, by the style that its contract names."""

from __future__ import annotations

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import NAME
from zsmoseg.networks.session import Network
from zsmoseg.tracking.by_cutie import CutieTracker
from zsmoseg.tracking.by_deaot import DeaotTracker
from zsmoseg.tracking.protocol import Factory

STYLES = {"cutie": CutieTracker, "deaot": DeaotTracker}
"""By ``[tracker] style``."""


def network_tracker(network: Network) -> Factory:
    """Trackers that share the sessions of a network.

    Raises
    ------
    ModelError
        The contract names no style, or one that is not known.
    """
    style = network.contract.tables.get("tracker", {}).get("style", "none")
    if style not in STYLES:
        raise ModelError(
            f"{network.contract.folder / NAME}: [tracker] style is {style}; {' and '.join(STYLES)} are known"
        )
    return lambda: STYLES[style](network)
