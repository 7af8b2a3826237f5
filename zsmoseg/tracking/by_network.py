"""The tracker of a network, by the style that its contract names."""

from __future__ import annotations

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import NAME, Contract
from zsmoseg.networks.session import Network
from zsmoseg.tracking.by_cutie import CutieTracker
from zsmoseg.tracking.by_deaot import DeaotTracker
from zsmoseg.tracking.protocol import Factory

STYLES = {"cutie": CutieTracker, "deaot": DeaotTracker}
"""By ``[tracker] style``."""


def style_of(contract: Contract) -> str:
    """What the contract of a tracker names as its style.

    Raises
    ------
    ModelError
        None, or one that is not known.
    """
    style = contract.tables.get("tracker", {}).get("style", "none")
    if style not in STYLES:
        raise ModelError(
            f"{contract.folder / NAME}: [tracker] style is {style}; {' and '.join(STYLES)} are known"
        )
    return str(style)


def network_tracker(network: Network) -> Factory:
    """Trackers that share the sessions of a network, a new one for every span."""
    style = style_of(network.contract)
    return lambda: STYLES[style](network)
