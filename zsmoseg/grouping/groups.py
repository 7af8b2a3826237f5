"""The groups of a shot: what moves, which movers move together, which objects are one thing."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from zsmoseg import settings
from zsmoseg.grouping.clustering import Labels, agreement, average_linkage, by_weight, spectral
from zsmoseg.grouping.decision import Decision, decide
from zsmoseg.grouping.evidence import Shot
from zsmoseg.grouping.state import motion_state
from zsmoseg.linking import Nearness, Pieces, nearness
from zsmoseg.motion.models import MODELS, Floats, Model
from zsmoseg.motion.residuals import LEAST, merge_costs


@dataclass(frozen=True)
class ShotGroups:
    """The answer for the N objects of a shot of T frames, object 0 first."""

    group: Labels
    """(N,) 0 = static, 1.. by falling size."""
    thing: Labels
    """(N,) 0 = static, 1.. by falling size."""
    moving: NDArray[np.bool_]
    """(T, N) whether an object moves at a frame."""
    margin: NDArray[np.float32]
    """(T, N) ln(excess / threshold), NaN = unknown."""
    decision: Decision
    eigenvalues: Floats
    """Of the normalised affinity of the objects that are seen, the largest first."""
    warnings: list[str] = field(default_factory=list)


def group_shot(
    shot: Shot,
    pieces: Pieces,
    affinity: Floats,
    shape: tuple[int, int],
    model: str,
    s: settings.Groups,
    visibility: Floats | None = None,
) -> ShotGroups:
    """Decide, group, link.

    Parameters
    ----------
    shot : the Grams of the valid pairs.
    pieces : place and colour of the N objects.
    affinity : (N, N), used by the rule ``spectral``.
    shape : height and width of the working grid.
    model : name of the motion model.
    visibility : (N,) what the world's motion leaves unexplained of an object's pixels over what its flow does;
        None: there are no pictures.
    """
    support = pieces.area.sum(0).astype(np.float64)
    support[0] = 0.0
    area = pieces.area.sum(0).astype(np.float64)
    visible = None if visibility is None else visibility >= s.visible
    decision = decide(shot, area, MODELS[model], s, visible)
    summary = _summarise(shot, len(support))
    eigenvalues = _eigenvalues(affinity, area)
    if s.rule == "keep":
        group = kept_groups(support, s)
        near = nearness(pieces, summary.velocity, shape, np.flatnonzero(group > 0), s)
    elif s.rule == "spectral":
        group = spectral_groups(affinity, area, s)
        near = nearness(pieces, summary.velocity, shape, np.flatnonzero(group > 0), s)
    else:
        chosen = _choose(pieces, decision, support, summary.pairs, s)
        near = nearness(pieces, summary.velocity, shape, np.flatnonzero(chosen.strong | chosen.open), s)
        group = linked_groups(shot, chosen, decision, near, summary.pairs, support, MODELS[model], s)
    group = _renumber(group, support)
    thing = connected(group, near.distance <= 1, support)
    moving, margin = motion_state(
        decision.evidence.pairs, len(pieces.area), group, _thresholds(decision, group, s), s
    )
    warnings = _warn(pieces.area[:, 1:] > 0, group, s)
    moving &= pieces.area > 0
    return ShotGroups(group, thing, moving, margin, decision, eigenvalues, warnings)


def _warn(seen: NDArray[np.bool_], group: Labels, s: settings.Groups) -> list[str]:
    """What deserves a word; ``seen`` (T, objects without the background)."""
    frames = seen.sum(0)
    objects, brief = int((frames > 0).sum()), int((frames == 1).sum())
    if objects == 0:
        return ["no object stands out from the camera's motion: everything is static"]
    out = ["there is one object only"] if objects == 1 else []
    if brief:
        out.append(f"{brief} of {objects} objects are seen in one frame only, which proves no motion")
    if s.count != "auto" and s.count > len(np.unique(group)):
        out.append(
            f"{s.count} groups asked for, but there are {objects} objects and the background: "
            f"{len(np.unique(group))} groups"
        )
    if s.count == "auto" and not group.any():
        out.append("no object moves against the background: the whole frame moves as one")
    if s.rule == "spectral":
        apart = int(np.count_nonzero(~(seen.T.astype(np.int64) @ seen > 0)[frames > 0][:, frames > 0])) // 2
        if apart:
            out.append(f"{apart} pairs of objects are never seen together: their affinity is inferred")
    return out


def _thresholds(decision: Decision, group: Labels, s: settings.Groups) -> Floats:
    """(N,) px above which an object moves at a pair.

    The decision's; what moves by other evidence (a given number of groups, another rule, a piece of a thing)
    is held to its own mean.
    """
    out = decision.threshold.copy()
    movers = group > 0
    out[movers] = np.minimum(out[movers], s.keep * decision.score[movers])
    return np.asarray(np.maximum(out, 1e-6), np.float64)


# ------------------------------------------------------------------ the default rule
@dataclass(frozen=True)
class _Summary:
    """What linking needs of the Grams: (N,) pairs in which an object is seen; (2, N, 2) first and last velocity."""

    pairs: NDArray[np.int64]
    velocity: Floats


def _summarise(shot: Shot, count: int) -> _Summary:
    """Velocities are means over the first and the last three pairs, px a frame."""
    first: list[list[Floats]] = [[] for _ in range(count)]
    last: list[list[Floats]] = [[] for _ in range(count)]
    pairs = np.zeros(count, np.int64)
    for g in shot():
        for slot in np.flatnonzero(g.pixels >= LEAST):
            n = g.ids[slot]
            mean = g.objects[slot, 0, 9:11] / g.objects[slot, 0, 0]
            if pairs[n] < 3:
                first[n].append(mean)
            last[n] = [*last[n], mean][-3:]
            pairs[n] += 1
    means = [[np.mean(known, axis=0) if known else np.zeros(2) for known in end] for end in (first, last)]
    return _Summary(pairs, np.array(means))


@dataclass(frozen=True)
class _Chosen:
    """(N,) objects that make groups, and objects that may join one."""

    strong: NDArray[np.bool_]
    open: NDArray[np.bool_]


def _choose(
    pieces: Pieces, decision: Decision, support: Floats, pairs: NDArray[np.int64], s: settings.Groups
) -> _Chosen:
    strong = _strong(decision, support, pairs, s)
    if not strong.any():
        return _Chosen(strong, strong)
    seen: NDArray[np.bool_] = np.greater(pieces.area, 0)
    covered = (seen & seen[:, strong].any(axis=1, keepdims=True)).sum(0) >= s.overlap * seen.sum(0)
    hidden = ~covered & (decision.score > s.weak * decision.threshold)
    return _Chosen(strong, (support > 0) & ~strong & (decision.moving | hidden | (pairs < s.frames)))


def linked_groups(
    shot: Shot,
    chosen: _Chosen,
    decision: Decision,
    near: Nearness,
    pairs: NDArray[np.int64],
    support: Floats,
    model: Model,
    s: settings.Groups,
) -> Labels:
    """Groups of the movers, and what belongs to them.

    1. Strong: called moving, with ``share`` of the largest mover's pixels and ``frames`` pairs or more. They
       are clustered on the cost of one motion for two over what non-rigid parts of one thing cost, less
       where few pairs show both; what goes on in each other counts half whatever its cost.
    2. Open: a mover that is not strong; an object too short to tell; an object above ``weak`` thresholds that
       is mostly seen while no strong mover is (a hidden thing come back). It joins the nearest thing if it is
       near and, where they are seen together, moves with it rather than with the background.
    3. What joins nothing is static.
    """
    group = np.zeros(len(pairs), np.int64)
    if not chosen.strong.any():
        return group
    ids = np.flatnonzero(chosen.strong | chosen.open)
    cost = pair_costs(shot, ids, len(pairs), model, s)
    proof = cost.pairs / (cost.pairs + s.frames)
    apart = cost.together / cost.tolerance * np.where(cost.pairs > 0, proof, 1.0)
    ratio = np.where(near.goes_on, np.minimum(apart, 0.5), apart)
    members = np.flatnonzero(chosen.strong)
    clusters = None if s.count == "auto" else min(s.count - 1, len(members))
    group[members] = average_linkage(ratio[np.ix_(members, members)], support[members], clusters)
    _join(group, chosen.open, near, cost, pairs, decision, support, s)
    return group


def _strong(
    decision: Decision, support: Floats, pairs: NDArray[np.int64], s: settings.Groups
) -> NDArray[np.bool_]:
    """The movers that make groups; with a given number of groups at least that many, by falling evidence."""
    if s.count == 1:
        return np.zeros(len(support), np.bool_)
    moving = decision.moving & (support > 0)
    strong: NDArray[np.bool_] = moving
    if moving.any():
        big = support >= s.share * support[moving].max()
        strong = moving & big & (pairs >= min(s.frames, max(int(pairs.max()), 1)))
        strong = strong if strong.any() else moving
    if s.count != "auto" and strong.sum() < s.count - 1:
        ranked = [n for n in np.lexsort((-support, -decision.score)) if support[n] > 0 and not strong[n]]
        strong = strong.copy()
        strong[ranked[: s.count - 1 - int(strong.sum())]] = True
    return strong


def _join(
    group: Labels,
    open_: NDArray[np.bool_],
    near: Nearness,
    cost: Costs,
    pairs: NDArray[np.int64],
    decision: Decision,
    support: Floats,
    s: settings.Groups,
) -> None:
    """Let open objects join the nearest thing, the largest first, until nothing changes."""
    waiting = [int(n) for n in np.argsort(-support, kind="stable") if open_[n]]
    changed = True
    while changed:
        changed = False
        for n in list(waiting):
            homes = np.flatnonzero((group > 0) & (near.distance[n] <= 1))
            short = (cost.pairs[n, homes] < s.frames) | (pairs[n] < s.frames)
            homes = homes[short | (cost.together[n, homes] < decision.score[n])]
            if len(homes):
                group[n] = group[homes[np.lexsort((-support[homes], near.distance[n, homes]))[0]]]
                waiting.remove(n)
                changed = True


@dataclass(frozen=True)
class Costs:
    """(N, N) means over the pairs in which two objects are seen together."""

    together: Floats
    """px, rms cost of one motion for both; infinite where never together."""
    tolerance: Floats
    """px, what non-rigid parts of one thing cost."""
    pairs: Floats
    """Number of such pairs."""


def pair_costs(shot: Shot, ids: NDArray[np.int64], count: int, model: Model, s: settings.Groups) -> Costs:
    """What one motion for two costs, for all pairs of the objects ``ids``.

    The yardstick is what each costs alone: limbs are not rigid, and neither is what flow makes of a body.
    """
    total, tolerance, weight, pairs = (np.zeros((count, count)) for _ in range(4))
    wanted = np.zeros(count, np.bool_)
    wanted[ids] = True
    for g in shot():
        here = np.flatnonzero(wanted[g.ids] & (g.pixels >= LEAST))
        if len(here) < 2:
            continue
        rows = np.append(0, here)
        d, own = merge_costs(g.objects[rows], model, g.objects.sum(0))
        d, own, noise = d[1:, 1:], own[1:], own[0]
        pixels = g.pixels[here]
        small = np.minimum(pixels[:, None], pixels[None, :])
        both = own[:, None] + own[None, :]
        chance = 0.5 * model.parameters * s.noise_area * np.minimum(both / 2, noise) / small
        at = np.ix_(g.ids[here], g.ids[here])
        total[at] += small * np.sqrt(np.maximum(d - chance, 0.0))
        tolerance[at] += small * (s.same + s.same_own * np.sqrt(both))
        weight[at] += small
        pairs[at] += 1
    known = weight > 0
    safe = np.where(known, weight, 1.0)
    return Costs(np.where(known, total / safe, np.inf), np.where(known, tolerance / safe, 1.0), pairs)


# ------------------------------------------------------------------ other rules
def kept_groups(support: Floats, s: settings.Groups) -> Labels:
    """Every object a group of its own; with a given number of groups only the largest ones, the rest is static."""
    order = np.argsort(-support, kind="stable")
    most = len(order) if s.count == "auto" else s.count - 1
    group = np.zeros(len(support), np.int64)
    group[order[:most]] = np.arange(1, len(order) + 1)[:most]
    return np.where(support > 0, group, 0)


def _seen_block(affinity: Floats, area: Floats) -> tuple[NDArray[np.int64], Floats]:
    """The background and the objects that are seen, and their affinity, at most 1."""
    ids = np.flatnonzero((area > 0) | (np.arange(len(area)) == 0))
    block = affinity[np.ix_(ids, ids)]
    return ids, block / max(float(block.max()), 1e-12)


def _eigenvalues(affinity: Floats, area: Floats) -> Floats:
    return spectral(_seen_block(affinity, area)[1], 1)[1]


def spectral_groups(affinity: Floats, area: Floats, s: settings.Groups) -> Labels:
    """Row-normalised spectral clustering; the static group is the one that holds object 0.

    Without a given number of groups the one that explains the affinity best is taken, 1 = nothing moves.
    """
    ids, block = _seen_block(affinity, area)
    weight = np.ones(len(ids)) if s.equal else np.maximum(area[ids], 1.0)
    if s.count == "auto":
        counts = range(1, min(s.most_groups, len(ids)) + 1)
        tried = [(spectral(block, k, weight)[0], k) for k in counts]
        label = max(tried, key=lambda t: (round(agreement(block, t[0], weight), 9), -t[1]))[0]
    else:
        label = spectral(block, min(s.count, len(ids)), weight)[0]
    group = np.zeros(len(area), np.int64)
    group[ids] = np.where(label == label[0], 0, label + 1)
    return group


# ------------------------------------------------------------------ numbering
def _renumber(group: Labels, support: Floats) -> Labels:
    """Moving groups 1.. by falling size."""
    out = np.zeros_like(group)
    moving = group > 0
    if moving.any():
        out[moving] = by_weight(group[moving], support[moving])
    return out


def connected(group: Labels, near: NDArray[np.bool_], support: Floats) -> Labels:
    """Things 1.. by falling size: what is connected by nearness within a group."""
    link = near & (group[:, None] == group[None, :]) & (group[:, None] > 0)
    name = connected_components(csr_array(link), directed=False)[1]
    out = np.zeros_like(group)
    moving = group > 0
    if moving.any():
        out[moving] = by_weight(name[moving], support[moving])
    return out
