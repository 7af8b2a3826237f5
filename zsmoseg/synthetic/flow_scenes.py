"""Random scenes of exact flow with noise, without pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from zsmoseg.errors import SettingsError
from zsmoseg.motion.models import Floats
from zsmoseg.synthetic.arrangement import Arrangement, arrange, centred_grid, dilated, stand
from zsmoseg.synthetic.contrast import Played, contrast_of
from zsmoseg.synthetic.rigid import Motion, camera_motion, mixed, own_motions, rigid_flow
from zsmoseg.synthetic.scene import CAMERAS, Camera, Scene
from zsmoseg.synthetic.textures import flow_noise, smooth_noise
from zsmoseg.synthetic.wishes import check_camera, check_number, check_shape, check_whole

ATTEMPTS = 60
"""Motions drawn for one layout before another is."""
LAYOUTS = 12
"""Layouts drawn before what is asked for is called impossible."""
MOST = 10_000
"""Objects: labels have 16 bits."""
NEXT_LAYOUT = 1_000_003
"""Added to the seed for it: no seed in use is as large."""
WOBBLE, PERIOD = 0.3, 12
"""Part by which speeds vary over a shot, and pairs of one swing."""
BLOTCHES = 25
"""px over which the error of inverse depth is correlated."""


@dataclass(frozen=True)
class Wishes:
    """What a flow scene is to be."""

    n_movers: int | None = None
    """Independent motions; None: 0 to 3."""
    n_objects: int | None = None
    """Proposals, the background apart; None: 3 to 25."""
    camera: Camera | None = None
    """None: any of ``CAMERAS``."""
    noise: float = 0.1
    """px rms of the flow's error, half of its variance white, half correlated over 6 px."""
    n_pairs: int = 8
    """Frame pairs."""
    shape: tuple[int, int] = (240, 426)
    """Height and width, px."""
    depth_shift: bool = True
    """Whether inverse depth is known up to scale and shift, or else up to scale."""
    depth_noise: float = 0.0
    """Relative rms of a smooth error of inverse depth."""
    min_contrast: float = 0.75
    """px rms by which a mover differs from the best single motion for it together with the background, and from every
    other mover; else motions, then layout, are drawn again: what nothing could tell apart is not asked for."""
    stop: bool = False
    """Whether the movers move in the first half of the pairs only."""
    companions: float = 0.3
    """Probability that a motion is shared by two objects."""
    leak: int = 0
    """px by which every mask is dilated."""


def flow_scene(seed: int, **wishes: Any) -> Scene:
    """A random scene: a wall and a ground, objects with relief in front of them, 0 to 3 motions.

    Parameters
    ----------
    seed : the scene.
    wishes : fields of ``Wishes``.

    Raises
    ------
    SettingsError
        A wish that there is not, or out of range; in ``LAYOUTS`` layouts the movers were never clear of all else.
    """
    odd = wishes.keys() - {field.name for field in fields(Wishes)}
    if odd:
        raise SettingsError(
            f"{min(odd)} is no wish; there are {', '.join(field.name for field in fields(Wishes))}"
        )
    check_whole("seed", seed, 0)
    return _drawn(seed, _checked(Wishes(**wishes)))


def _checked(wishes: Wishes) -> Wishes:
    """The same wishes, each of which can be."""
    most = MOST if wishes.n_objects is None else wishes.n_objects
    for name, count, top in (("n_objects", wishes.n_objects, MOST), ("n_movers", wishes.n_movers, most)):
        if count is not None:
            check_whole(name, count, 0, top)
    if wishes.camera is not None:
        check_camera(wishes.camera)
    check_whole("n_pairs", wishes.n_pairs, 1)
    check_whole("leak", wishes.leak, 0)
    check_shape(wishes.shape)
    for name in ("noise", "depth_noise", "min_contrast"):
        check_number(name, getattr(wishes, name))
    check_number("companions", wishes.companions, most=1)
    return wishes


def _drawn(seed: int, wishes: Wishes, layouts: int = LAYOUTS) -> Scene:
    rng = np.random.default_rng(seed)
    movers = int(rng.integers(0, 4)) if wishes.n_movers is None else wishes.n_movers
    objects = wishes.n_objects
    objects = int(rng.integers(max(3, 2 * movers), 26)) if objects is None else objects
    camera = CAMERAS[int(rng.integers(len(CAMERAS)))] if wishes.camera is None else wishes.camera
    layout = arrange(rng, wishes.shape, objects, movers, wishes.companions)
    static = camera_motion(rng, camera)
    phase = rng.uniform(0, 2 * np.pi, (movers + 1, 2))[:, 0]
    scale, shift = rng.uniform(0.2, 5), rng.uniform(-0.5, 1.5) if wishes.depth_shift else 0.0
    for attempt in range(ATTEMPTS):
        motions = [static, *own_motions(rng, layout, static, movers, attempt)]
        played = _play(layout, motions, phase, wishes.n_pairs, wishes.stop)
        contrast, clear = contrast_of(played, wishes.min_contrast)
        if clear:
            break
    else:
        if layouts == 1:
            raise SettingsError(
                f"min_contrast = {wishes.min_contrast:g}, n_movers = {movers}: in {LAYOUTS} layouts with {ATTEMPTS} motions each "
                "the movers were never clear of all else by so much; ask for less contrast or fewer movers"
            )
        drawn = replace(wishes, n_movers=movers, n_objects=objects, camera=camera)
        return _drawn(seed + NEXT_LAYOUT, drawn, layouts - 1)
    flow = played.flow + flow_noise(rng, played.flow.shape, wishes.noise)
    observed = scale * (played.inverse_depth + shift * played.inverse_depth.mean())
    if wishes.depth_noise:
        observed *= [1 + wishes.depth_noise * smooth_noise(rng, wishes.shape, BLOTCHES) for _ in observed]
    labels = played.labels
    if wishes.leak:
        labels = np.stack([dilated(label, wishes.leak) for label in labels])
    return Scene(
        labels,
        flow.astype(np.float32),
        observed.astype(np.float32),
        layout.group,
        played.moving,
        contrast,
        camera,
    )


def _play(layout: Arrangement, motions: Sequence[Motion], phase: Floats, pairs: int, stop: bool) -> Played:
    """Move the objects along their own flow; speeds vary over the shot."""
    height, width = layout.back.shape
    x, y = centred_grid((height, width))
    labels = np.zeros((pairs + 1, height, width), np.uint16)
    inverse = np.zeros(labels.shape)
    flow = np.zeros((pairs, 2, height, width))
    moving = np.zeros((pairs, len(layout.group)), np.bool_)
    at = layout.centre.copy()
    for m in range(pairs + 1):
        labels[m], inverse[m] = stand(layout, at, x, y)
        if m == pairs:
            break
        wobble = 1 + WOBBLE * np.sin(2 * np.pi * m / PERIOD + phase)
        for g in range(len(motions)):
            active = g > 0 and not (stop and m >= pairs // 2)
            motion = mixed(motions[0], motions[g], wobble[0], wobble[g]) if active else motions[0]
            motion = motion if active else Motion(motion.turn * wobble[0], motion.shift * wobble[0])
            mine = layout.group[labels[m]] == g
            flow[m][:, mine] = rigid_flow(x[mine], y[mine], inverse[m][mine], layout.focal, motion)
            moving[m, layout.group == g] = active
            for k in np.flatnonzero(layout.group[1:] == g):
                at[k] += np.array(rigid_flow(at[k, 0], at[k, 1], layout.inverse[k], layout.focal, motion))
    return Played(labels, flow, inverse, layout.group, moving)
