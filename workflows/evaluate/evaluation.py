"""Scores of several predictions against one dataset: one task a prediction and sequence, in processes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path

import cv2

from zsmoseg.datasets import Dataset, Selection, Truth
from zsmoseg.datasets.motion_times import read_motion_times
from zsmoseg.errors import DatasetError, FormatError, SettingsError, StageError
from zsmoseg.metrics.clips import Times
from zsmoseg.metrics.protocols import PROTOCOLS, Rules, protocols_with
from zsmoseg.workflows.evaluate.predictions import Prediction
from zsmoseg.workflows.evaluate.scoreboard import Scoreboard
from zsmoseg.workflows.evaluate.scoring import Job, Scored, score
from zsmoseg.workflows.planning.estimate import cores
from zsmoseg.workflows.running.guard import refuse_unguarded, unheard

SMALL = 100
"""Frames in all up to which starting processes takes longer than scoring."""
WORDS = {"masks": "label images", "points": "track points"}
"""Kinds of truth."""
CLIP = 20
"""Frames of a clip of track points, about."""


def evaluate(
    predictions: Sequence[Prediction],
    dataset: Dataset,
    selection: Selection,
    rules: Rules,
    times: Mapping[str, Times] | None = None,
    workers: int | None = None,
) -> Scoreboard:
    """Score predictions against the chosen sequences of a dataset.

    Parameters
    ----------
    times : of each sequence when its objects move, for protocols with ``motion_metrics``.
    workers : processes; ``None`` for the cores.

    Raises
    ------
    DatasetError
        The truth is not whole, or does not go with the protocol.
    FormatError
        A prediction is not whole, of another size, or with ids that the protocol does not allow.
    """
    if rules.entry.truth != dataset.truth_kind:
        raise DatasetError(
            f"{dataset.path}: is {dataset.name}, with {protocols_with(dataset.truth_kind)} only; "
            f"{rules.protocol} needs {WORDS[rules.entry.truth]}"
        )
    truths = [dataset.truth(name) for name in selection.names]
    each = times or {}
    jobs = [Job(p, truth, rules, each.get(truth.name)) for p in predictions for truth in truths]
    scored = score_all(jobs, workers)
    methods = {
        p.name: {t.name: s.score for t, s in zip(truths, scored[n * len(truths) :], strict=False)}
        for n, p in enumerate(predictions)
    }
    metrics = rules.entry.names(times is not None)
    notes = _gathered((note, job.truth.name) for job, s in zip(jobs, scored, strict=True) for note in s.notes)
    words = f"{dataset.name}, {dataset.path}"
    return Scoreboard(rules, words, selection.words, selection.benchmark, metrics, methods, notes)


def read_times(path: Path, dataset: Dataset, selection: Selection, rules: Rules) -> dict[str, Times]:
    """Motion times of the chosen sequences.

    Raises
    ------
    SettingsError
        The protocol does not use them.
    FormatError
        A file that cannot be used, a sequence that the dataset does not have, or one without times.
    """
    if not rules.entry.motion_metrics:
        using = ", ".join(name for name, entry in PROTOCOLS.items() if entry.motion_metrics)
        raise SettingsError(f"--motion-times: {rules.protocol} does not use them; --protocol {using} does")
    times = read_motion_times(path)
    foreign = next((name for name in times if name not in dataset.places), None)
    if foreign is not None:
        raise FormatError(f"{path}: names the sequence {foreign!r}, which {dataset.path} does not have")
    missing = next((name for name in selection.names if name not in times), None)
    if missing is not None:
        raise FormatError(
            f"{path}: has no line for the sequence {missing!r}; --sequences leaves sequences out"
        )
    return {name: times[name] for name in selection.names}


def score_all(jobs: Sequence[Job], workers: int | None = None) -> list[Scored]:
    """Score all jobs, in order.

    Parameters
    ----------
    workers : processes; ``None`` for the cores, at most one a job. Few frames are scored in this process.

    Raises
    ------
    ZsmosegError
        The first thing that is wrong.
    """
    for job in jobs:
        if isinstance(job.truth, Truth):
            job.prediction.check(job.truth, job.rules.entry.inner)
    frames = sum(len(job.truth.frames) if isinstance(job.truth, Truth) else CLIP for job in jobs)
    count = min(cores(workers), len(jobs))
    if count <= 1 or (workers is None and frames <= SMALL):
        return [score(job) for job in jobs]
    refuse_unguarded()
    pool = ProcessPoolExecutor(count, get_context("spawn"), _quiet)
    try:
        with unheard():
            found = pool.map(score, jobs)
        return list(found)
    except BrokenProcessPool as error:
        raise StageError("a scoring process was killed (out of memory?); try --workers 1") from error
    finally:
        pool.shutdown(cancel_futures=True)


def _gathered(notes: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Each note once, with the sequences that it is about."""
    about: dict[str, dict[str, None]] = {}
    for note, sequence in notes:
        about.setdefault(note, {})[sequence] = None
    return tuple(f"{note} ({', '.join(sequences)})" for note, sequences in about.items())


def _quiet() -> None:
    """Before the first task of a process: one thread."""
    cv2.setNumThreads(1)
