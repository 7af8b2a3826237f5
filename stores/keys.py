"""The key of an artifact: a hash of all that its values depend on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any


def key(
    schema: int,
    stage: str,
    version: int,
    settings: Mapping[str, Any],
    inputs: Mapping[str, str],
    fingerprint: str,
) -> str:
    """20 hexadecimal digits of blake2b over canonical JSON.

    ``settings`` are those that the stage reads and that act; ``inputs`` the keys of what it reads.
    """
    content = [schema, stage, version, settings, inputs, fingerprint]
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.blake2b(text.encode(), digest_size=10).hexdigest()
