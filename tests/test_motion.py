"""Motion models, the one pass over the pixels, fits and residuals against naive references and exact flow."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zsmoseg.motion.fit import fit, joint_costs
from zsmoseg.motion.grams import gram_matrices
from zsmoseg.motion.measuring import measure_pair
from zsmoseg.motion.models import BASIS, MODELS, Model, coordinates, normalise
from zsmoseg.motion.residuals import merge_costs, pair_residuals
from zsmoseg.motion.statistics import Sums, mean_flow, slots, without_borders
from zsmoseg.settings import resolve
from zsmoseg.synthetic import Motion, rigid_flow

SHAPE = 60, 90
PLAIN = resolve(overrides={"statistics.border": 0}).statistics.parameters(Sums)


def scene(seed: int = 0, objects: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Labels (h, w) of rectangles and the background, inverse depth with relief (h, w)."""
    rng = np.random.default_rng(seed)
    height, width = SHAPE
    y, x = np.mgrid[:height, :width]
    label = np.zeros(SHAPE, np.uint16)
    inverse = 0.1 + 0.05 * y / height + 0.01 * np.sin(x / 7) * np.cos(y / 5)
    for n in range(1, objects + 1):
        top, left = rng.integers(0, height - 20), rng.integers(0, width - 25)
        label[top : top + 18, left : left + 22] = n
        inverse[label == n] = 0.2 + 0.05 * n + 0.02 * np.sin(x / 3 + n)[label == n]
    return label, inverse


def rigid(label: np.ndarray, inverse: np.ndarray, seed: int = 0, turns: float = 0.02) -> np.ndarray:
    """Exact flow (2, h, w) of objects that each have a screw motion of their own."""
    rng = np.random.default_rng(seed)
    height, width = label.shape
    y, x = np.mgrid[:height, :width].astype(float)
    x, y = x - (width - 1) / 2, y - (height - 1) / 2
    flow = np.zeros((2, height, width))
    for n in np.unique(label):
        motion = Motion(rng.normal(0, turns, 3), rng.normal(0, 0.2, 3))
        flow[:, label == n] = np.array(rigid_flow(x, y, inverse, 80.0, motion))[:, label == n]
    return flow


def ids_of(label: np.ndarray) -> np.ndarray:
    return np.arange(int(label.max()) + 1, dtype=np.int64)


def pair_statistics(
    label: np.ndarray,
    ids: np.ndarray,
    flow: np.ndarray,
    back: np.ndarray | None,
    inverse: np.ndarray | None,
    ignore: np.ndarray | None,
    sums: Sums,
) -> np.ndarray:
    """Grams of the objects."""
    found = measure_pair(label, ids, flow, back, inverse, None, ignore, sums)
    assert np.isnan(found.unexplained).all()
    return found.gram


def design(inverse_depth: np.ndarray, model: Model) -> tuple[np.ndarray, np.ndarray]:
    """The rows of u and of v (h * w, parameters) of every pixel, for a look pixel by pixel."""
    x, y = np.meshgrid(*coordinates(*inverse_depth.shape))
    q = normalise(inverse_depth)
    phi = np.stack([np.ones_like(x), x, y, q, x * q, y * q, x * x, x * y, y * y], -1).reshape(-1, BASIS)
    return phi @ model.rows_u, phi @ model.rows_v


def residual_of(label: np.ndarray, flow: np.ndarray, inverse: np.ndarray, model: str) -> np.ndarray:
    gram = pair_statistics(label, ids_of(label), flow, None, inverse, None, PLAIN)
    return pair_residuals(gram, MODELS[model]).residual


def naive(label: np.ndarray, flow: np.ndarray, inverse: np.ndarray, model: str) -> np.ndarray:
    """The residual tensor pixel by pixel with lstsq."""
    rows_u, rows_v = design(inverse, MODELS[model])
    u, v, flat = flow[0].ravel(), flow[1].ravel(), label.ravel()
    count = int(label.max()) + 1
    out = np.zeros((count, count))
    for i in range(count):
        mine = flat == i
        rows = np.concatenate([rows_u[mine], rows_v[mine]])
        theta = np.linalg.lstsq(rows, np.concatenate([u[mine], v[mine]]), rcond=None)[0]
        error = (rows_u @ theta - u) ** 2 + (rows_v @ theta - v) ** 2
        out[i] = [error[flat == n].mean() for n in range(count)]
    return out


@pytest.mark.parametrize("model", MODELS)
def test_residuals_equal_least_squares_pixel_by_pixel(model: str) -> None:
    label, inverse = scene()
    flow = rigid(label, inverse) + np.random.default_rng(1).normal(0, 0.3, (2, *SHAPE))
    expected = naive(label, flow, inverse, model)
    np.testing.assert_allclose(residual_of(label, flow, inverse, model), expected, rtol=1e-9)
    single = residual_of(label, flow.astype(np.float32), inverse.astype(np.float32), model)
    np.testing.assert_allclose(single, expected, rtol=2e-3)


@pytest.mark.parametrize("scale", [1.0, 7.0, 1e-3])
def test_screw_is_exact_at_any_scale_of_inverse_depth(scale: float) -> None:
    label, inverse = scene(1)
    own = np.diagonal(residual_of(label, rigid(label, inverse), scale * inverse, "screw"))
    assert own.max() < 1e-6


@pytest.mark.parametrize(("scale", "shift"), [(3.0, 0.4), (1.0, -0.05), (0.2, 5.0)])
def test_screw_shift_is_exact_at_any_scale_and_shift(scale: float, shift: float) -> None:
    label, inverse = scene(2)
    flow = rigid(label, inverse)
    assert np.diagonal(residual_of(label, flow, scale * inverse + shift, "screw-shift")).max() < 1e-6
    assert np.diagonal(residual_of(label, flow, scale * inverse + shift, "screw")).max() > 1e-5


def test_screw_plane_is_exact_with_a_ramp_in_inverse_depth() -> None:
    label, inverse = scene(2)
    flow = rigid(label, inverse)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    ramp = 2 * inverse + 0.3 + 0.002 * x - 0.003 * y
    assert np.diagonal(residual_of(label, flow, ramp, "screw-plane")).max() < 1e-6
    assert np.diagonal(residual_of(label, flow, ramp, "screw-shift")).max() > 1e-5


@pytest.mark.parametrize("model", ["quadratic", "screw-printed", "planar", "affine", "translation"])
def test_other_models_are_not_exact_on_rigid_flow(model: str) -> None:
    label, inverse = scene(1)
    own = np.diagonal(residual_of(label, rigid(label, inverse), inverse, model))
    assert own.max() > 1e-4


def test_rolling_camera_is_nothing_for_screw_and_a_motion_for_the_printed_equation() -> None:
    label, inverse = np.zeros(SHAPE, np.uint16), scene()[1]
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    x, y = x - (SHAPE[1] - 1) / 2, y - (SHAPE[0] - 1) / 2
    flow = np.array(rigid_flow(x, y, inverse, 80.0, Motion(np.array([0, 0, 0.05]), np.zeros(3))))
    assert residual_of(label, flow, inverse, "screw")[0, 0] < 1e-12
    assert residual_of(label, flow, inverse, "screw-printed")[0, 0] > 0.1


def test_a_plane_moves_as_the_planar_model_says() -> None:
    label = np.zeros(SHAPE, np.uint16)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    inverse = 0.2 + 0.001 * x - 0.002 * y
    flow = rigid(label, inverse, 3)
    assert residual_of(label, flow, inverse, "planar")[0, 0] < 1e-9


# ------------------------------------------------------------------------ statistics
def naive_grams(slot: np.ndarray, q: np.ndarray, flow: np.ndarray, count: int) -> np.ndarray:
    x, y = np.meshgrid(*coordinates(*slot.shape))
    one = np.ones_like(x)
    psi = np.stack([one, x, y, q, x * q, y * q, x * x, x * y, y * y, flow[0], flow[1]], -1)
    used = np.isfinite(psi).all(-1)
    return np.stack([psi[(slot == n) & used].T @ psi[(slot == n) & used] for n in range(count)])


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 30), st.integers(1, 30), st.integers(1, 9))
def test_the_loop_equals_sums_of_products(seed: int, height: int, width: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    slot = rng.integers(-1, count, (height, width)).astype(np.int32)
    slot = np.repeat(slot, 3, axis=1)[:, :width]
    q, flow = rng.random((height, width)), rng.normal(0, 5, (2, height, width))
    flow[0][rng.random((height, width)) < 0.05] = np.nan
    x, y = coordinates(height, width)
    gram = gram_matrices(slot, x, y, q, flow[0], flow[1], count)
    np.testing.assert_allclose(gram, naive_grams(slot, q, flow, count), rtol=1e-10, atol=1e-10)


def test_ignored_pixels_enter_no_sum() -> None:
    label, inverse = scene()
    flow = rigid(label, inverse).astype(np.float32)
    ignore = np.zeros(SHAPE, np.bool_)
    ignore[:25] = True
    wild = flow.copy()
    wild[:, :25] = 1e6
    calm = pair_statistics(label, ids_of(label), flow, None, inverse, ignore, PLAIN)
    np.testing.assert_array_equal(
        calm, pair_statistics(label, ids_of(label), wild, None, inverse, ignore, PLAIN)
    )
    assert calm[:5, 0, 0].sum() == np.count_nonzero(~ignore)


@pytest.mark.parametrize("noise", [0.1, 0.4])
def test_noise_is_measured_whatever_the_motion_and_the_depth(noise: float) -> None:
    """White noise, at any lag; the flow itself, of a camera that turns and moves, adds next to nothing."""
    label, inverse = scene(objects=2)
    flow = rigid(label, inverse) + np.random.default_rng(1).normal(0, noise, (2, *SHAPE))
    for lag in (1, 4):
        sums = resolve(overrides={"statistics.border": 0, "statistics.noise_lag": lag}).statistics
        found = measure_pair(label, ids_of(label), flow, None, inverse, None, None, sums.parameters(Sums))
        assert found.noise == pytest.approx(2 * noise**2, rel=0.15)


def test_noise_of_flow_that_is_known_nowhere_on_the_background_is_nothing() -> None:
    label = np.zeros(SHAPE, np.uint16)
    for flow in (np.full((2, *SHAPE), np.nan), np.ones((2, *SHAPE))):
        assert measure_pair(label, ids_of(label), flow, None, None, None, None, PLAIN).noise == 0.0
        assert (
            measure_pair(label + np.uint16(1), np.array([0, 1]), flow, None, None, None, None, PLAIN).noise
            == 0
        )


def test_mean_flow_is_that_of_the_pixels_and_unknown_of_few() -> None:
    label, inverse = scene()
    flow = rigid(label, inverse)
    gram = pair_statistics(label, np.append(ids_of(label), 9), flow, None, inverse, None, PLAIN)
    found = mean_flow(gram)
    np.testing.assert_allclose(found[2], flow[:, label == 2].mean(1))
    assert np.isnan(found[-1]).all()


def test_absent_objects_have_no_pixels_and_unknown_labels_count_for_nothing() -> None:
    label, inverse = scene()
    ids = np.array([0, 2, 3, 9])
    gram = pair_statistics(label, ids, rigid(label, inverse), None, inverse, None, PLAIN)
    assert gram[3, 0, 0] == 0
    assert gram[1, 0, 0] == np.count_nonzero(label == 2)
    assert slots(label, ids)[label == 4].max() == -1


def test_borders_are_left_out_but_thin_objects_keep_their_pixels() -> None:
    slot = np.zeros((40, 40), np.int32)
    slot[5:25, 5:25] = 1
    slot[30:32] = 2
    border = without_borders(slot, 1)
    assert border[5, 5:25].all()
    assert border[4, 5:25].all()
    assert not border[6:24, 6:24].any()
    assert not border[30:32].any()
    assert not without_borders(slot, 0).any()


def test_statistics_leave_out_flow_that_does_not_close_unless_it_closes_on_no_object() -> None:
    label = np.zeros(SHAPE, np.uint16)
    label[10:30, 10:40], label[35:55, 50:80] = 1, 2
    flow = np.zeros((2, *SHAPE), np.float32)
    back = flow.copy()
    back[0, 10:20, 10:40] = 9.0
    count = pair_statistics(label, ids_of(label), flow, back, None, None, PLAIN)[:3, 0, 0]
    assert count.tolist() == [60 * 90 - 1200, 300, 600]
    back[0, label > 0] = 9.0
    count = pair_statistics(label, ids_of(label), flow, back, None, None, PLAIN)[:3, 0, 0]
    assert count.tolist() == [60 * 90 - 1200, 600, 600]


def test_without_depth_the_inverse_depth_is_nothing() -> None:
    label, inverse = scene()
    gram = pair_statistics(label, ids_of(label), rigid(label, inverse), None, None, None, PLAIN)
    assert not gram[:, 3:6].any()
    assert normalise(np.full((2, 2), np.nan)).tolist() == [[0, 0], [0, 0]]


def test_sums_of_grams_are_the_grams_of_unions() -> None:
    label, inverse = scene()
    flow = rigid(label, inverse)
    gram = pair_statistics(label, ids_of(label), flow, None, inverse, None, PLAIN)
    united = pair_statistics(np.where(label == 2, 1, label), ids_of(label), flow, None, inverse, None, PLAIN)
    np.testing.assert_allclose(gram[1] + gram[2], united[1], rtol=1e-12)


# -------------------------------------------------------------------------- degenerate
def test_what_an_object_does_not_determine_comes_from_the_frame() -> None:
    _, inverse = scene()
    motion = Motion(np.array([0.01, -0.02, 0.03]), np.array([0.1, 0.2, -0.3]))
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    x, y = x - (SHAPE[1] - 1) / 2, y - (SHAPE[0] - 1) / 2
    line = np.zeros(SHAPE, np.uint16)
    line[20, 10:40] = 1
    flow = np.array(rigid_flow(x, y, inverse, 80.0, motion))
    residual = residual_of(line, flow, inverse, "screw")
    assert residual.max() < 1e-6, "a line on a rigid world has the world's motion, everywhere"


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("depth", ["constant", "none", "relief"])
@pytest.mark.parametrize("kind", ["line", "square", "dot"])
def test_degenerate_objects_spread_no_nan(model: str, depth: str, kind: str) -> None:
    relief = scene()[1]
    label = np.zeros(SHAPE, np.uint16)
    label[{"line": np.s_[9, 5:30], "square": np.s_[9:13, 5:9], "dot": np.s_[9, 5]}[kind]] = 1
    inverse = {"constant": np.full(SHAPE, 0.2), "none": None, "relief": relief}[depth]
    flow = rigid(label, relief) + np.random.default_rng(0).normal(0, 0.1, (2, *SHAPE))
    gram = pair_statistics(label, ids_of(label), flow, None, inverse, None, PLAIN)
    found = pair_residuals(gram[:2], MODELS[model])
    residual, pixels, coefficient = found.residual, found.pixels, found.coefficient
    assert pixels.tolist() == [np.count_nonzero(label == 0), np.count_nonzero(label == 1)]
    assert np.isfinite(residual[0, 0])
    assert np.isfinite(coefficient[0]).all()
    seen = kind != "dot"
    assert np.isfinite(residual).all() == seen, "unseen only below the least number of pixels"
    assert np.isfinite(coefficient[1]).all() == seen
    own = residual[1, 1] if seen else 0.0
    assert own < 10 * float((flow**2).sum(0)[label == 1].mean()) + 1


def test_a_frame_without_any_pixel_is_unseen() -> None:
    found = pair_residuals(np.zeros((3, 11, 11)), MODELS["screw"])
    for values in (found.residual, found.merge, found.own, found.coefficient):
        assert np.isnan(values).all()
    assert not found.pixels.any()


def test_one_motion_for_two_costs_nothing_where_they_share_it() -> None:
    label, inverse = scene(5, 3)
    label[label == 3] = 0
    flow = rigid(label, inverse)
    shared = rigid(np.zeros_like(label), inverse)
    for movement, same in ((shared, True), (flow, False)):
        gram = pair_statistics(label, ids_of(label), movement, None, inverse, None, PLAIN)[:3]
        cost, own = merge_costs(gram, MODELS["screw"], gram.sum(0))
        assert own.max() < 1e-6
        np.testing.assert_array_equal(cost, cost.T)
        assert not np.diagonal(cost).any()
        assert (cost.max() < 1e-6) == same


@pytest.mark.parametrize("model", MODELS)
def test_costs_of_unions_are_those_of_fits_to_their_pixels(model: str) -> None:
    label, inverse = scene(3, 6)
    flow = rigid(label, inverse) + np.random.default_rng(0).normal(0, 0.2, (2, *SHAPE))
    label[2, 3:30] = 6  # a line, which determines few parameters
    gram = pair_statistics(label, ids_of(label), flow, None, inverse, None, PLAIN)
    frame, count = gram.sum(0), len(gram)
    found = joint_costs(gram, MODELS[model], frame)
    _, own = merge_costs(gram, MODELS[model], frame)
    rows_u, rows_v = design(inverse, MODELS[model])
    for i in range(count):
        for j in range(i):
            both = np.isin(label, (i, j)).ravel()
            theta = fit((gram[i] + gram[j])[None], MODELS[model], frame)[0]
            left = flow.reshape(2, -1)[:, both] - np.stack([rows_u[both] @ theta, rows_v[both] @ theta])
            assert found[i, j] == found[j, i] == pytest.approx(float((left**2).sum()), rel=1e-6, abs=1e-6)
        theta = fit(gram[i][None], MODELS[model], frame)[0]
        mine = (label == i).ravel()
        left = flow.reshape(2, -1)[:, mine] - np.stack([rows_u[mine] @ theta, rows_v[mine] @ theta])
        assert own[i] == pytest.approx(float((left**2).sum() / mine.sum()), rel=1e-6, abs=1e-8)


def test_slots_that_are_not_seen_change_no_bit() -> None:
    """Chunks list other objects beside those of a pair; the values of the pair must not depend on them."""
    label, inverse = scene()
    flow = rigid(label, inverse).astype(np.float32)
    few, many = ids_of(label), np.array([0, 1, 2, 3, 4, 7, 8, 9, 30])
    grams = [pair_statistics(label, ids, flow, None, inverse, None, PLAIN)[: len(ids)] for ids in (few, many)]
    for model in MODELS.values():
        a, b = (pair_residuals(gram, model) for gram in grams)
        np.testing.assert_array_equal(a.residual, b.residual[:5, :5])
        np.testing.assert_array_equal(a.merge, b.merge[:5, :5])
        np.testing.assert_array_equal(a.own, b.own[:5])


def test_terms_are_named_and_every_model_is_a_combination_of_the_monomials() -> None:
    for model in MODELS.values():
        assert len(set(model.terms)) == model.parameters
        assert model.rows_u.shape == model.rows_v.shape == (BASIS, model.parameters)
        rows = np.concatenate([model.rows_u, model.rows_v])
        assert np.linalg.matrix_rank(rows) == model.parameters


def test_a_fit_finds_the_true_parameters() -> None:
    label, inverse = np.zeros(SHAPE, np.uint16), scene()[1]
    model = MODELS["screw-shift"]
    theta = np.random.default_rng(3).normal(size=model.parameters)
    rows_u, rows_v = design(inverse, model)
    flow = np.stack([(rows_u @ theta).reshape(SHAPE), (rows_v @ theta).reshape(SHAPE)])
    gram = pair_statistics(label, ids_of(label), flow, None, inverse, None, PLAIN)[:1]
    np.testing.assert_allclose(fit(gram, model, gram[0])[0], theta, atol=1e-7)
