"""What is done, what is missing and why, for one video; nothing here computes or writes."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby
from operator import itemgetter
from typing import Any

from zsmoseg.errors import SettingsError
from zsmoseg.networks.references import is_pinned
from zsmoseg.settings import Settings
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.checks import part_problem
from zsmoseg.stores.imports import Brought
from zsmoseg.stores.keys import FORMAT
from zsmoseg.stores.keys import key as artifact_key
from zsmoseg.stores.location import Store
from zsmoseg.stores.output import STATES, SUMMARY, Output
from zsmoseg.video.probe import Probe
from zsmoseg.workflows.imports.contents import check
from zsmoseg.workflows.planning.differences import differences
from zsmoseg.workflows.stage import ALL, Stage, description, ignored_words, working_size
from zsmoseg.workflows.stages.graph import GRAPHS, Graph, graph_of, names
from zsmoseg.workflows.stages.outputs.overlay import scaled_words
from zsmoseg.workflows.wording import counted


@dataclass
class StagePlan:
    """One stage of one video: its key, how it is cut, which parts are to do, and why.

    ``settings`` are those that it reads, ``acting`` what of them is in the key: content in the place of paths;
    ``again``: asked for (``--from``), whether it is done or not; ``packed``: its artifact is, or will be, one file.
    """

    stage: Stage[Any, Any]
    key: str
    inputs: dict[str, str]
    settings: dict[str, Any]
    acting: dict[str, dict[str, Any]]
    parts: list[tuple[int, int]]
    todo: list[int] = field(default_factory=list)
    reason: str = "done"
    again: bool = False
    artifact: Artifact | None = None
    packed: bool = False

    @cached_property
    def given(self) -> Settings:
        """The settings that it reads; the others are defaults."""
        return Settings.model_validate(self.settings)

    @property
    def description(self) -> dict[str, Any]:
        """What is written beside the result, so that a later plan can say what changed."""
        return description(self.stage, self.key, self.settings, self.inputs)

    @cached_property
    def models(self) -> list[str]:
        """References of the networks that it runs."""
        return [
            model
            for name in self.stage.section_names
            for model in getattr(self.given, name).models().values()
            if is_pinned(model)
        ]

    @property
    def lengths_todo(self) -> list[int]:
        """Frames of each part to do."""
        return [self.parts[i][1] - self.parts[i][0] for i in self.todo]


@dataclass
class VideoPlan:
    """One video: the stages in order, of the graph ``graph``; ``brought`` are the cues that are brought, ``imported`` the
    kinds that were imported for it before.

    ``known``: stages and keys of artifacts that are whole; ``dropped``: of those that runs do without; ``seen``: how they are
    (``stores/seen.py``); ``notes``: what its user should know of the source and what is ignored of it; ``settled``: the summary of
    a video for which nothing is to be done or written.
    """

    source: str
    name: str
    video: str
    fingerprint: str
    probe: Probe
    stages: dict[str, StagePlan]
    output: Output
    graph: str = "embedded-flow"
    brought: Mapping[str, Brought] = field(default_factory=dict)
    known: Set[tuple[str, str]] = frozenset()
    dropped: Set[tuple[str, str]] = frozenset()
    seen: Mapping[str, str] = field(default_factory=dict)
    notes: Sequence[str] = ()
    settled: dict[str, Any] | None = None
    imported: Set[str] = frozenset()

    @property
    def keys(self) -> dict[str, str]:
        """The key of each stage."""
        return {name: stage.key for name, stage in self.stages.items()}

    @property
    def files(self) -> list[str]:
        """Every file that the plan leaves in the output folder."""
        frames = len(self.probe.times)
        return [
            name
            for s in self.stages.values()
            if s.stage.files is not None
            for name in s.stage.files(self.probe, 0, frames, s.stage.chosen(s.given))
        ]

    def lacks(self, stage: StagePlan) -> bool:
        """Whether the artifact of a stage was dropped, and nothing asked for it."""
        return (stage.stage.name, stage.key) in self.dropped

    @property
    def todo(self) -> int:
        """Number of parts to do."""
        return sum(len(stage.todo) for stage in self.stages.values())

    def before(self, stage: StagePlan, part: int) -> list[tuple[str, int]]:
        """The (stage, part) that part ``part`` of ``stage`` reads."""
        start, stop = stage.parts[part]
        last = [(stage.stage.name, part - 1)] if stage.stage.follows and part else []
        return last + [
            (name, i)
            for name, reach in stage.stage.reaches.items()
            for i in _touched(self.stages[name].parts, start, stop + reach if reach != ALL else None)
        ]


def plan_video(
    store: Store,
    source: str,
    name: str,
    video: str,
    fingerprint: str,
    probe: Probe,
    settings: Settings,
    brought: Mapping[str, Brought],
    out: str,
    start_from: str | None = None,
    until: Sequence[str] = (),
    known: Set[tuple[str, str]] = frozenset(),
    dropped: Set[tuple[str, str]] = frozenset(),
) -> VideoPlan:
    """The plan of one video, up to the stages ``until``; without them all.

    Parameters
    ----------
    settings, brought
        As ``settle`` leaves them.
    known
        Stages and keys of artifacts that are whole: they are not looked at.
    dropped
        Of those that runs do without: they are made again where something that is to do reads them.

    Raises
    ------
    SettingsError
        ``start_from`` or ``until`` name no stage; an ignore mask that does not fit.
    FormatError
        Files of an imported cue do not fit.
    OutputError
        The output folder is not ours.
    """
    graph = graph_of(settings)
    stages = GRAPHS[graph]
    for option, value in [("--from", start_from), *(("--until", stage) for stage in until)]:
        if value is not None and value not in stages:
            what = "no stage with these settings" if value in names() else "no such stage"
            raise SettingsError(f"{option} {value}: {what}; there are {', '.join(stages)}")
    output = Output(out, video)
    about = (source, name, video, fingerprint, probe)
    plan = VideoPlan(*about, {}, output, graph, brought, known | dropped, dropped)
    plan.notes = [*probe.notes, *ignored_words(settings.ignore, probe.height, probe.width)]
    needed = _needed(stages, until)
    for stage in needed:
        plan.stages[stage.name] = _plan_stage(plan, store, stage, settings)
    if any(stage.output for stage in needed):
        plan.notes = [*plan.notes, *(scaled_words(probe) if settings.overlay.write else [])]
        plan.output.refuse_foreign([*plan.files, SUMMARY, STATES], store)
    again = following(stages, start_from) if start_from else set()
    for planned in plan.stages.values():
        _mark(plan, planned, planned.stage.name in again, start_from)
    _bring_back(plan)
    for kind in brought:
        if kind in plan.stages and plan.stages[kind].todo:
            grid = working_size(probe, settings.frames.width)
            check(store, kind, brought[kind], getattr(settings, kind), probe, grid)
    return plan


def _touched(parts: Sequence[tuple[int, int]], start: int, stop: int | None) -> range:
    """Those of ``parts``, which are in order, that share a frame with [start, stop); all where there is no ``stop``."""
    if stop is None:
        return range(len(parts))
    return range(bisect_right(parts, start, key=itemgetter(1)), bisect_left(parts, stop, key=itemgetter(0)))


def _needed(stages: Graph, until: Sequence[str]) -> list[Stage[Any, Any]]:
    """The stages that ``until`` need, themselves included, in order; all without them; ``frames`` holds the probe."""
    needed = {"frames", *(until or stages)}
    for name in reversed(list(stages)):
        if name in needed:
            needed |= set(stages[name].reaches)
    return [stage for name, stage in stages.items() if name in needed]


def following(stages: Graph, start: str) -> set[str]:
    """The stage ``start`` and all that hangs on it."""
    found = {start}
    for name, stage in stages.items():
        if found & set(stage.reaches):
            found.add(name)
    return found


def _plan_stage(plan: VideoPlan, store: Store, stage: Stage[Any, Any], settings: Settings) -> StagePlan:
    inputs = {name: plan.stages[name].key for name in stage.reaches}
    sections = {name: getattr(settings, name) for name in stage.section_names}
    active = {name: section.active() for name, section in sections.items()}
    for name in active.keys() & plan.brought.keys():
        active[name]["imported"] = plan.brought[name].fingerprint
    key = artifact_key(FORMAT, stage.name, stage.version, active, inputs, plan.fingerprint)
    frames = len(plan.probe.times)
    span = stage.span(stage.chosen(settings))
    length = -(-max(settings.chunk.length, stage.least) // span) * span
    parts = [(0, frames)] if stage.scope == "video" else cut(frames, length)
    dumped = {name: section.model_dump(mode="json") for name, section in sections.items()}
    planned = StagePlan(stage, key, inputs, dumped, active, parts)
    if not stage.output:
        artifact = planned.artifact = store.artifact(plan.video, stage.name, key)
        planned.packed = artifact.packed if artifact.exists else frames <= settings.chunk.length
        if planned.packed:
            planned.parts = [(0, frames)]
        elif stage.scope == "chunk" and (stage.name, key) not in plan.known and artifact.parts:
            planned.parts = list(artifact.parts)
    return planned


def cut(frames: int, length: int) -> list[tuple[int, int]]:
    """Chunks of ``length`` frames; the last one may be shorter."""
    return [(a, min(a + length, frames)) for a in range(0, frames, length)]


def _mark(plan: VideoPlan, stage: StagePlan, again: bool, start_from: str | None) -> None:
    """Which parts are to do, and the reason in words."""
    problems = _problems(plan, stage)
    redone = {(name, part) for name in stage.stage.reaches for part in plan.stages[name].todo}
    sound = range(0) if again else [i for i in range(len(stage.parts)) if i not in problems]
    behind = [i for i in sound if redone and not redone.isdisjoint(plan.before(stage, i))]
    stage.todo = sorted({*range(len(stage.parts))} - {*sound} | {*behind})
    if not stage.todo:
        return
    stage.again = again
    if again:
        stage.reason = f"asked for (--from {start_from})"
    elif not _begun(plan, stage):
        stage.reason = _what_changed(plan, stage)
    elif problems:
        first = next(iter(problems.values()))
        stage.reason = f"{len(problems)} of {len(stage.parts)} parts to do: {first}"
    else:
        changed = sorted({name for i in stage.todo for name, _ in redone.intersection(plan.before(stage, i))})
        stage.reason = f"input redone: {', '.join(changed)}"


def _bring_back(plan: VideoPlan) -> None:
    """Mark what was dropped and is read by something that is to do."""
    for stage in reversed(plan.stages.values()):
        for other in (plan.stages[name] for name in stage.stage.reaches):
            if stage.todo and not other.todo and plan.lacks(other):
                other.todo = list(range(len(other.parts)))
                other.reason = f"not kept, and {stage.stage.name} reads it"
    plan.dropped -= {(stage.stage.name, stage.key) for stage in plan.stages.values() if stage.todo}


def _problems(plan: VideoPlan, stage: StagePlan) -> dict[int, str]:
    """Why parts are not usable; without those that are."""
    parts = range(len(stage.parts))
    if (stage.stage.name, stage.key) in plan.known:
        return {}
    if not _begun(plan, stage):
        return dict.fromkeys(parts, "not written yet" if stage.artifact is None else "not computed yet")
    if stage.artifact is not None:
        found = {part: part_problem(stage.artifact, part) for part in parts}
    else:
        found = {part: _output_problem(plan, stage, part) for part in parts}
    return {part: problem for part, problem in found.items() if problem}


def _output_problem(plan: VideoPlan, stage: StagePlan, part: int) -> str | None:
    start, stop = stage.parts[part]
    assert stage.stage.files is not None
    return plan.output.problem(
        stage.stage.files(plan.probe, start, stop, stage.stage.chosen(stage.given)), stage.key
    )


def _begun(plan: VideoPlan, stage: StagePlan) -> bool:
    """Whether something was laid out for just this key."""
    if stage.artifact is not None:
        return stage.artifact.description is not None
    return plan.output.stages.get(stage.stage.name, {}).get("key") == stage.key


def _what_changed(plan: VideoPlan, stage: StagePlan) -> str:
    """Against what this stage left last."""
    old = plan.output.stages.get(stage.stage.name) if stage.artifact is None else stage.artifact.sibling()
    if old is None:
        return "not computed yet"
    words = differences(old.get("settings", {}), stage.settings)
    if words:
        return "; ".join(words)
    if set(old.get("inputs", {})) != set(stage.inputs):
        return f"made from {', '.join(stage.inputs)} now, from {', '.join(old.get('inputs', {}))} before"
    if old.get("version") != stage.stage.version:
        return f"stage version: {old.get('version')} -> {stage.stage.version}"
    changed = [name for name, key in stage.inputs.items() if old.get("inputs", {}).get(name) != key]
    return f"input changed: {', '.join(changed)}" if changed else "the source was read anew"


def explain_plan(plans: Sequence[VideoPlan]) -> list[str]:
    """The plan as lines: one per video, one per stage to do; stages that share their reason share a line."""
    lines = []
    for plan in plans:
        done = [s.stage.name for s in plan.stages.values() if not s.todo and not plan.lacks(s)]
        frames, parts = counted(len(plan.probe.times), "frame"), counted(plan.todo, "part")
        lines.append(f"{plan.name}: {frames}, {parts} to do")
        lines += [f"  {note}" for note in plan.notes]
        for reason, group in groupby((s for s in plan.stages.values() if s.todo), key=lambda s: s.reason):
            stages = list(group)
            names = ", ".join(s.stage.name for s in stages)
            count = sum(len(s.todo) for s in stages)
            lines.append(f"  {names} ({counted(count, 'part')}): {reason}")
        if done:
            lines.append(f"  done: {', '.join(done)}")
    return lines
