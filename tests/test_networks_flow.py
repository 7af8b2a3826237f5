"""Flow of a network comes back to the frame: direction, length of each axis, colours, padding, bad output."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from graphs_flow import PAD, write_flow

from zsmoseg.errors import ModelError, NetworkError
from zsmoseg.networks.contract import load_contract
from zsmoseg.networks.flow import check_flow, network_flow
from zsmoseg.networks.image import prepare
from zsmoseg.networks.session import Network

Frames = tuple[np.ndarray, np.ndarray]


def moved(height: int, width: int, dx: int, dy: int, seed: int = 0) -> Frames:
    """Two views (H, W, 3) of one texture without fine detail; the second shows it dx, dy px further."""
    rng = np.random.default_rng(seed)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (height + 64, width + 64, 3)), (0, 0), 3)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    first = texture[32 : 32 + height, 32 : 32 + width]
    second = texture[32 - dy : 32 - dy + height, 32 - dx : 32 - dx + width]
    return first.copy(), second.copy()


def flow_of(folder: Path, frames: Frames) -> np.ndarray:
    return network_flow(Network(load_contract(folder)), *frames)


def inner(flow: np.ndarray, border: int = 24) -> np.ndarray:
    return flow[:, border:-border, border:-border]


def assert_moved(flow: np.ndarray, dx: float, dy: float) -> None:
    """Nearly everywhere, for where the texture is flat block matching may fail."""
    off = np.abs(inner(flow) - np.array([dx, dy]).reshape(2, 1, 1)).max(0)
    assert np.percentile(off, 95) < 1e-3, np.median(inner(flow), axis=(1, 2))


@pytest.mark.parametrize("size", [(96, 144), (128, 112)])
def test_points_from_the_first_frame_to_the_second_x_before_y(tmp_path: Path, size: tuple[int, int]) -> None:
    frames = moved(*size, 3, -2)
    flow = flow_of(write_flow(tmp_path), frames)
    assert flow.shape == (2, *size)
    assert flow.dtype == np.float32
    assert_moved(flow, 3, -2)
    assert_moved(flow_of(tmp_path, frames[::-1]), -3, 2)


def test_each_axis_is_scaled_by_its_own_factor(tmp_path: Path) -> None:
    """The network sees a third of the width and half of the height."""
    frames = moved(128, 240, 9, 4)
    folder = write_flow(tmp_path, 'rule = "stretch"\nheight = 64\nwidth = 80\ninterpolation = "area"')
    flow = flow_of(folder, frames)
    assert flow.shape == (2, 128, 240)
    assert_moved(flow, 9, 4)


def test_padding_is_cut_off_and_scales_nothing(tmp_path: Path) -> None:
    frames = moved(90, 137, -4, 3)
    folder = write_flow(tmp_path, PAD)
    tensor, where = prepare(frames[0], load_contract(folder).image)
    assert tensor.shape == (1, 3, 96, 144)
    assert (where.top, where.left) == (3, 3)
    flow = flow_of(folder, frames)
    assert flow.shape == (2, 90, 137)
    assert np.array_equal(inner(flow)[0], np.full((42, 89), -4, np.float32))
    assert np.array_equal(inner(flow)[1], np.full((42, 89), 3, np.float32))


def test_an_odd_size_stretched_comes_back_to_the_pixel(tmp_path: Path) -> None:
    """97 x 141 become 112 x 144: shifts of whole steps of both grids would be 97 and 141 px; near enough counts."""
    flow = flow_of(write_flow(tmp_path), moved(97, 141, 3, 3))
    assert flow.shape == (2, 97, 141)
    steps = np.array([141 / 144, 97 / 112])
    assert np.abs(np.median(inner(flow), axis=(1, 2)) - 3).max() <= steps.max() / 2


def test_flow_on_a_coarser_grid_is_in_pixels_of_the_input_all_the_same(tmp_path: Path) -> None:
    flow = flow_of(write_flow(tmp_path, stride=4), moved(96, 144, 3, -2))
    assert flow.shape == (2, 96, 144)
    assert_moved(flow, 3, -2)


def test_the_contract_chooses_the_output_whatever_the_order_in_the_graph(tmp_path: Path) -> None:
    frames = moved(96, 144, 2, 1)
    fine = flow_of(write_flow(tmp_path / "fine"), frames)
    coarse = flow_of(write_flow(tmp_path / "coarse", flow="coarse"), frames)
    assert_moved(fine, 2, 1)
    assert_moved(coarse, 2, 1)
    assert np.abs(fine - coarse).max() > 0.1


def test_six_channels_at_once_are_the_same_as_two_images(tmp_path: Path) -> None:
    frames = moved(96, 144, 2, -3)
    two, one = (flow_of(write_flow(tmp_path / n, both=b), frames) for n, b in (("two", False), ("one", True)))
    assert np.array_equal(two, one)


@pytest.mark.parametrize(("order", "expected"), [("BGR", (0, 3)), ("RGB", (4, 0))])
def test_blue_and_red_are_told_apart(tmp_path: Path, order: str, expected: tuple[int, int]) -> None:
    """Blue moves down and red to the right; the network looks at its first channel only."""
    blue, red = moved(96, 144, 0, 3), moved(96, 144, 4, 0, seed=1)
    frames = tuple(
        np.stack([b[..., 0], b[..., 0] * 0, r[..., 2]], -1) for b, r in zip(blue, red, strict=True)
    )
    folder = write_flow(tmp_path, colour_order=order, channels=(1, 0, 0))
    assert_moved(flow_of(folder, (frames[0], frames[1])), *expected)


def test_twice_the_same_frames_give_the_same_bytes(tmp_path: Path) -> None:
    folder, frames = write_flow(tmp_path), moved(97, 141, 1, 2)
    assert flow_of(folder, frames).tobytes() == flow_of(folder, frames).tobytes()


def test_flow_that_is_not_finite_is_refused_by_name(tmp_path: Path) -> None:
    folder = write_flow(tmp_path, nan_on_black=True)
    frames = moved(96, 144, 1, 1)
    assert_moved(flow_of(folder, frames), 1, 1)
    with pytest.raises(NetworkError, match=r"block-matching.*flow is not finite"):
        flow_of(folder, (np.zeros_like(frames[0]), frames[1]))


def test_a_contract_that_does_not_say_what_flow_is_measured_in_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"contract.toml: \[output\] meaning of the flow is missing"):
        check_flow(load_contract(write_flow(tmp_path, meaning="")))
    with pytest.raises(ModelError, match="meaning of the flow is parts of the width"):
        flow_of(write_flow(tmp_path, meaning="parts of the width"), moved(96, 144, 1, 1))


def test_an_output_that_is_no_flow_is_refused_with_its_shape(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"shape \[1, 1, 96, 144\]; flow is two numbers"):
        flow_of(write_flow(tmp_path, flow="one"), moved(96, 144, 1, 1))


def test_a_graph_that_takes_something_else_is_refused_with_what_it_takes(tmp_path: Path) -> None:
    contract = write_flow(tmp_path) / "contract.toml"
    contract.write_text(contract.read_text().replace("first = ", "before = "))
    with pytest.raises(ModelError, match=r"first and second, or both .* takes before, second"):
        flow_of(tmp_path, moved(96, 144, 1, 1))
