"""The key of an artifact: a hash of all that its values depend on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

FORMAT = 4
"""Version of the layout of a store; another one is refused. It is part of every key."""


def key(
    schema_version: int,
    stage: str,
    stage_version: int,
    settings: Mapping[str, Any],
    inputs: Mapping[str, str],
    fingerprint: str,
) -> str:
    """20 hexadecimal digits of blake2b over canonical JSON.

    Parameters
    ----------
    schema_version
        ``FORMAT``.
    stage, stage_version
        What computes it; the version is raised by hand when values change with equal settings.
    settings
        Those that the stage reads and that act; JSON types. The order does not matter.
    inputs
        Keys of what it reads, by stage.
    fingerprint
        Of the source.

    Raises
    ------
    ValueError
        If a setting is NaN or infinite.
    TypeError
        If a setting is of no JSON type.
    """
    content = [schema_version, stage, stage_version, settings, inputs, fingerprint]
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.blake2b(text.encode(), digest_size=10).hexdigest()
