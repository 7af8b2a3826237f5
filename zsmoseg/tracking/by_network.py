"""The tracker of a network, by the style that its contract names."""

from __future__ import annotations

from zsmoseg.networks.session import Network
from zsmoseg.tracking.protocol import Factory


def network_tracker(network: Network) -> Factory:
    """Trackers that share the sessions of a network."""
    raise NotImplementedError(network.contract.name)
