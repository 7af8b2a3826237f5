"""References that are pinned: where a model lies, and the digest that it must have there.

Settings carry them from the plan to the workers; in keys the digest alone counts.
"""

from __future__ import annotations

from pathlib import Path

from zsmoseg.networks.contract import Contract, load_contract

PIN = "@sha256:"
"""Between the folder and the digest."""


def pinned(contract: Contract) -> str:
    """The reference to just this model."""
    return f"{contract.folder.absolute()}{PIN}{contract.digest}"


def is_pinned(reference: str) -> bool:
    """Whether it is more than a name or a folder."""
    return PIN in reference


def digest_of(reference: str) -> str:
    """The digest of a pinned reference; what is not pinned is itself."""
    return reference.rpartition(PIN)[2]


def contract_at(reference: str) -> Contract:
    """The contract of a pinned reference, as it is there now."""
    return load_contract(Path(reference.rpartition(PIN)[0]))
