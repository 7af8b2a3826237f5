"""Settings that are gone: name to words that name the successor, said after the name."""

from __future__ import annotations

GONE: dict[str, str] = {
    "groups.frames": "is groups.least_pairs now",
    "groups.keep": "is groups.below_strongest now",
}
"""Whoever renames or removes a setting adds a line here; ``resolve`` answers with it."""
