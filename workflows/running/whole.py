"""A tiny video as one task: its jobs in order, where each of them alone would cost less than a scheduler takes for it."""

from __future__ import annotations

from collections.abc import Sequence

from zsmoseg.workflows.running.jobs import Job, Outcome, run_job

TINY = 2.0
"""Estimated seconds of a video below which its jobs are one task: a task of its own costs each of them some milliseconds."""

Ordered = Sequence[tuple[Job, Sequence[str]]]
"""Jobs, each after those that it reads, with the names of these."""


def run_jobs(jobs: Ordered) -> dict[str, Outcome]:
    """What became of each job, by name: as if each had been a task of its own."""
    found: dict[str, Outcome] = {}
    for job, before in jobs:
        found[job.name] = run_job(job, *(found[name] for name in before))
    return found


def all_failed(jobs: Ordered, outcome: Outcome) -> dict[str, Outcome]:
    """What became of jobs whose one task died: the first failed, the others were skipped."""
    return {job.name: Outcome("skipped") if i else outcome for i, (job, _) in enumerate(jobs)}
