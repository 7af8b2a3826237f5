"""What is in a picture, in words: a network that gives each tag of a fixed list a score.

RAM and RAM++ (Zhang et al., CVPRW 2024; Huang et al. 2023): a tag is on where its probability is above its own
threshold, from a file beside the list of names.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import MAIN, Contract, File, Table
from zsmoseg.networks.image import prepare
from zsmoseg.networks.session import Network, verified

Scores = NDArray[np.float32]


class TagsTable(Table):
    """``[tags]`` of a contract: the names in the graph's order and the thresholds that belong to them."""

    names: File
    thresholds: File | None = None
    threshold: float = Field(0.68, ge=0, le=1)
    meaning: Literal["logits", "probabilities"] = "logits"


def tag_names(contract: Contract) -> tuple[str, ...]:
    """Names of the tags in the order of the scores, one a line of the contract's file."""
    file = contract.extra("tags", TagsTable).names
    names = tuple(_lines(contract, file))
    if not names:
        raise ModelError(
            f"{contract.folder / file.file}: names no tag; take the list of the network's revision"
        )
    return names


def tag_thresholds(contract: Contract) -> Scores:
    """(K,) probability that each tag must exceed: the file's, or one for all.

    Raises
    ------
    ModelError
        Names and thresholds differ in number, or a line is no number.
    """
    table = contract.extra("tags", TagsTable)
    count = len(tag_names(contract))
    if table.thresholds is None:
        return np.full(count, table.threshold, np.float32)
    lines = _lines(contract, table.thresholds)
    try:
        thresholds = np.array([float(line) for line in lines], np.float32)
    except ValueError as error:
        raise ModelError(f"{table.thresholds.file} of {contract.name}: {error}") from error
    if not ((thresholds >= 0) & (thresholds <= 1)).all():
        raise ModelError(f"{table.thresholds.file} of {contract.name}: thresholds are probabilities, 0 to 1")
    if len(thresholds) != count:
        raise ModelError(
            f"{contract.name}: {table.names.file} has {count} tags, {table.thresholds.file} has"
            f" {len(thresholds)} thresholds: take the two files of one revision"
        )
    return thresholds


def tag_scores(network: Network, frame: NDArray[np.uint8]) -> Scores:
    """(K,) probability of each tag, before any threshold.

    Parameters
    ----------
    network : of task ``tags``: ``image`` to ``scores`` (1, K).
    frame : (H, W, 3) BGR.

    Raises
    ------
    ModelError
        The graph scores another number of tags than the list names.
    """
    contract = network.contract
    table = contract.extra("tags", TagsTable)
    tensor, _ = prepare(frame, contract.image)
    found = network.run(MAIN, {"image": tensor}, ["scores"])["scores"]
    scores = np.asarray(found, np.float32).reshape(-1)
    named = len(tag_names(contract))
    if len(scores) != named:
        raise ModelError(
            f"{contract.name}: the graph scores {len(scores)} tags, {table.names.file} names {named}"
        )
    return scipy.special.expit(scores) if table.meaning == "logits" else scores


def chosen_tags(scores: Scores, thresholds: Scores) -> NDArray[np.int64]:
    """Which tags are on, in the list's order: strictly above their thresholds, as in RAM's ``generate_tag``."""
    return np.flatnonzero(scores > thresholds)


def _lines(contract: Contract, file: File) -> list[str]:
    """Lines of a text file; RAM's own has no newline at its end."""
    try:
        return verified(contract.folder, file).decode("utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise ModelError(f"{contract.folder / file.file}: is no UTF-8 text ({error})") from error
