"""Objects through a shot, span by span: a tracker runs from each key frame into the next span, where it hands over.

A key frame is one whose masks somebody proposes anew. A tracker starts with them, and the one of the span before runs
on for some frames, so that its objects can be told among those of the new one. Source: the paper's front end, with our
own rule for what nobody proposes again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import SettingsError
from zsmoseg.tracking.carrying import Label
from zsmoseg.tracking.matching import Ids, matched, overlaps
from zsmoseg.tracking.protocol import Factory, Frame, Step, Tracker

MOST = int(np.iinfo(np.uint16).max)
"""Numbers of objects that a label image holds."""
FREE = 0.5
"""Part of a carried object that no new mask covers; with less it is one of them, seen otherwise."""


@dataclass(frozen=True)
class Spans:
    """How objects get from one span to the next."""

    handover: int
    """Frames, the key frame among them, in which the tracker of the span before runs beside the new one; >= 1."""
    overlap: float
    """Mean intersection over union in these frames from which two masks are one object."""
    gap: int
    """Key frames in a row that an object may be carried over without being proposed."""
    carry: bool
    """Whether an object that is not proposed again goes on while it is tracked."""


@dataclass(frozen=True)
class Moment:
    """A frame of the shot, and the masks that are proposed in it."""

    step: Step
    """The frame."""
    masks: Label | None = None
    """(H, W) mask of each pixel: 1 to K without gaps, 0 = none; not None makes it a key frame."""


@dataclass(frozen=True)
class Followed:
    """The objects of one frame."""

    label: Label
    """(H, W) object of each pixel, 0 = none."""
    masks: Ids | None
    """(K) the object of each proposed mask of a key frame; None in the others."""


@dataclass(frozen=True)
class Begun:
    """The masks that a tracker was given: given them again, and the frames since, it is what it is."""

    frame: int
    """The frame that it started with."""
    label: Label
    """(H, W) its numbers there."""
    late: tuple[int, Label] | None = None
    """A later frame, and its numbers there with those that it was given then."""


@dataclass(frozen=True)
class Halt:
    """Where a shot is left before a key frame, and can be gone on with."""

    last: int
    """Number of the last object."""
    begun: Begun | None
    """The tracker that is at work; None: there is none."""
    objects: Ids
    """(n + 1) the object of each of its numbers; 0 = it has ended."""
    missed: Ids
    """(n + 1) key frames in a row without a mask of it."""


@dataclass
class _Span:
    """A tracker at work."""

    tracker: Tracker
    begun: Begun
    objects: Ids
    """(n + 1) the object of each of its numbers; 0 = it has ended."""
    missed: Ids
    """(n + 1) key frames in a row without a mask of it."""

    def paint(self, label: Label) -> Label:
        """(H, W) objects of the numbers of the tracker."""
        return np.asarray(self.objects[label], np.uint16)


@dataclass
class _Handover:
    """What two trackers say of the same frames."""

    count: int
    """Number of masks of the key frame."""
    carried: Ids = field(default_factory=lambda: np.zeros(0, np.int64))
    """Numbers of the old tracker that the new one has, too, as ``count + 1`` and so on."""
    frames: list[Frame] = field(default_factory=list)
    old: list[Label] = field(default_factory=list)
    new: list[Label] = field(default_factory=list)

    def shares(self, n: int) -> NDArray[np.float64]:
        """(K, n) mean intersection over union over the frames in which either is."""
        total = np.zeros((self.count, n))
        seen = np.zeros((self.count, n), np.int64)
        for new, old in zip(self.new, self.old, strict=True):
            both, union = overlaps(np.where(new > self.count, 0, new), old, self.count, n)
            total += both / np.maximum(union, 1)
            seen += union > 0
        return total / np.maximum(seen, 1)


def follow(moments: Iterable[Moment], factory: Factory, spans: Spans, last: int = 0) -> Iterator[Followed]:
    """The objects of every frame of one shot, some frames late: a handover must end before its frames have objects.

    Parameters
    ----------
    moments
        All frames of the shot, in order.
    factory
        Makes the tracker of each span.
    last
        Number of the last object of the shots before: the first new one is the next.

    Raises
    ------
    SettingsError
        There are more objects than a label image holds.
    """
    return Follower(factory, spans, last).run(moments)


@dataclass
class Follower:
    """What goes through a shot: the tracker of this span, and during a handover that of the next; see ``follow``.

    A shot can be left before any key frame: ``halt`` says what another one, ``resume``d, needs to go on from there.
    """

    factory: Factory
    spans: Spans
    last: int = 0
    at: int = 0
    """The frame that it is at."""
    now: _Span | None = None
    coming: Tracker | None = None
    begun: Begun | None = None
    """Of ``coming``."""
    between: _Handover | None = None

    def resume(self, halt: Halt, moments: Iterable[Moment]) -> None:
        """Go on from there; ``moments``: the frames since its tracker began, which are tracked again."""
        self.last, begun = halt.last, halt.begun
        if begun is None:
            return
        tracker = self.factory()
        for self.at, moment in enumerate(moments, start=begun.frame):
            if self.at == begun.frame:
                tracker.start(moment.step.frame, begun.label)
            else:
                tracker.step(moment.step)
            if begun.late is not None and self.at == begun.late[0]:
                tracker.add(moment.step.frame, begun.late[1])
        self.at += 1
        self.now = _Span(tracker, begun, halt.objects, halt.missed)

    def halt(self) -> Halt:
        """What is needed to go on; between two calls of ``run`` only."""
        none = np.zeros(0, np.int64)
        if self.now is None:
            return Halt(self.last, None, none, none)
        return Halt(self.last, self.now.begun, self.now.objects, self.now.missed)

    def run(self, moments: Iterable[Moment], goes_on: bool = False) -> Iterator[Followed]:
        """Frame by frame; ``goes_on``: a key frame of the same shot comes next."""
        for moment in moments:
            if self.between is not None and moment.masks is not None:
                yield from self._settle()
            old = self.now.tracker.step(moment.step) if self.now is not None else None
            if moment.masks is not None and moment.masks.any():
                self._begin(moment, old, moment.masks)
            elif self.between is not None and self.coming is not None:
                self._both(moment, old, self.coming.step(moment.step))
            else:
                yield self._single(moment, old)
            if self.between is not None and len(self.between.frames) == self._length():
                yield from self._settle()
            self.at += 1
        if self.between is not None:
            yield from self._settle(last=not goes_on)

    def _length(self) -> int:
        """Frames of a handover: where no tracker hands over, one is enough."""
        return self.spans.handover if self.now is not None else 1

    def _begin(self, moment: Moment, old: Label | None, masks: Label) -> None:
        """A tracker starts with the masks of a key frame, and with the objects that they do not show."""
        self.between = _Handover(int(masks.max()))
        self._both(moment, old, masks)
        alive = np.flatnonzero(self._known()[0])
        self.between.carried = self._carried(np.setdiff1d(alive, self._match(alive)))
        label = _with(masks, self.between.old[0], self.between.carried, self.between.count)
        self.between.new[0] = label
        self.coming, self.begun = self.factory(), Begun(self.at, label)
        self.coming.start(moment.step.frame, label)

    def _both(self, moment: Moment, old: Label | None, new: Label) -> None:
        """One frame of the handover."""
        assert self.between is not None
        self.between.frames.append(moment.step.frame)
        self.between.old.append(np.zeros_like(new) if old is None else old)
        self.between.new.append(new)

    def _known(self) -> tuple[Ids, Ids]:
        """(n + 1) each: objects of the numbers of the old tracker, and how often they were missed."""
        none = np.zeros(1, np.int64)
        return (none, none) if self.now is None else (self.now.objects, self.now.missed)

    def _match(self, alive: Ids) -> Ids:
        """(K) the number of the old tracker that each mask is, 0 = none, as far as the handover has been seen."""
        assert self.between is not None
        share = self.between.shares(len(self._known()[0]) - 1)[:, alive - 1]
        return np.asarray(np.append(alive, 0)[matched(share, self.spans.overlap)])

    def _single(self, moment: Moment, old: Label | None) -> Followed:
        """A frame that one tracker sees, or none."""
        empty = moment.masks is not None
        if self.now is not None and empty:
            self.now.missed += 1
            self.now.objects[self.now.missed > (self.spans.gap if self.spans.carry else 0)] = 0
            if not self.now.objects.any():
                self.now = None
        shape = moment.step.frame.shape[:2]
        label = np.zeros(shape, np.uint16) if old is None or self.now is None else self.now.paint(old)
        return Followed(label, np.zeros(0, np.int64) if empty else None)

    def _settle(self, last: bool = False) -> Iterator[Followed]:
        """Match and give numbers; then all frames of the handover are known."""
        between, tracker, begun = self.between, self.coming, self.begun
        assert between is not None
        assert tracker is not None
        assert begun is not None
        known, missed = self._known()
        alive = np.flatnonzero(known)
        found = self._match(alive)
        objects = known[found]
        fresh = objects == 0
        objects[fresh] = self.last + 1 + np.arange(int(fresh.sum()))
        self.last += int(fresh.sum())
        if self.last > MOST:
            raise SettingsError(
                f"more than {MOST} objects up to this frame, more than a label image holds; propose fewer masks, or link "
                "more of them (a smaller overlap)"
            )
        # those that parted from the mask that they were in the key frame
        late = self._carried(np.setdiff1d(alive, np.concatenate([found, between.carried])))
        count = between.count + len(between.carried)
        if len(late) and not last:
            label = _with(between.new[-1], between.old[-1], late, count)
            tracker.add(between.frames[-1], label)
            begun = replace(begun, late=(begun.frame + len(between.frames) - 1, label))
        goes = np.concatenate([between.carried, late])
        self.now = _Span(
            tracker,
            begun,
            np.concatenate([[0], objects, np.where(np.isin(goes, found), 0, known[goes])]).astype(np.int64),
            np.concatenate([np.zeros(between.count + 1, np.int64), missed[goes] + 1]),
        )
        self.coming = self.begun = self.between = None
        for k, (new, old) in enumerate(zip(between.new, between.old, strict=True)):
            yield Followed(self.now.paint(_with(new, old, late, count)), objects if k == 0 else None)

    def _carried(self, lost: Ids) -> Ids:
        """Those of the numbers that go on: still tracked, mostly outside of the new masks, and not for too long."""
        assert self.between is not None
        if not self.spans.carry:
            return lost[:0]
        missed = self._known()[1]
        old, new = self.between.old[-1], self.between.new[-1]
        whole = np.bincount(old.ravel(), minlength=len(missed))[lost]
        free = np.bincount(old[new == 0], minlength=len(missed))[lost]
        return np.asarray(lost[(free > 0) & (free >= FREE * whole) & (missed[lost] < self.spans.gap)])


def _with(new: Label, old: Label, carried: Ids, count: int) -> Label:
    """The new masks, and behind them the objects that are carried on as ``count + 1`` and so on."""
    table = np.zeros(int(max(old.max(initial=0), carried.max(initial=0))) + 1, np.uint16)
    table[carried] = count + 1 + np.arange(len(carried), dtype=np.uint16)
    return np.where(new > 0, new, table[old]).astype(np.uint16)
