"""Points followed along flow: where they go, when they end, where new ones start."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from zsmoseg.flow.consistency import Flow
from zsmoseg.flow.trajectories import Tracks, follow, look_up

HEIGHT, WIDTH, SPACING = 24, 40, 8


def uniform(x: float, y: float) -> Flow:
    return np.broadcast_to(np.array([x, y], np.float32)[:, None, None], (2, HEIGHT, WIDTH)).copy()


def shifted(x: float, y: float, pairs: int) -> list[tuple[Flow, Flow]]:
    return [(uniform(x, y), uniform(-x, -y))] * pairs


def test_a_track_goes_where_the_flow_leads_with_fractions_of_a_pixel() -> None:
    tracks = follow(shifted(0.75, -0.25, 4), HEIGHT, WIDTH, SPACING)
    i, j = tracks.both(0, 4)
    np.testing.assert_allclose(
        tracks.place[j] - tracks.place[i], np.tile([3.0, -1.0], (len(i), 1)), atol=1e-5
    )
    assert len(i) > 5
    np.testing.assert_array_equal(tracks.track[i], tracks.track[j])


def test_a_track_follows_flow_that_differs_from_place_to_place() -> None:
    zoom = 1.02 * np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))).astype(np.float32)
    grid = zoom / np.float32(1.02)
    pair = (zoom - grid, grid / np.float32(1.02) - grid)
    tracks = follow([pair] * 3, HEIGHT, WIDTH, SPACING)
    i, j = tracks.both(0, 3)
    np.testing.assert_allclose(tracks.place[j], tracks.place[i] * 1.02**3, rtol=1e-4)


def test_tracks_end_at_the_border_and_start_where_none_is_left() -> None:
    tracks = follow(shifted(5.0, 0.0, 6), HEIGHT, WIDTH, SPACING)
    place = tracks.place
    assert place.min() >= 0
    assert (place <= [WIDTH - 1, HEIGHT - 1]).all()
    for t in range(7):
        cells = {tuple(c) for c in (place[tracks.at(t)] // SPACING).astype(int)}
        assert len(cells) == (HEIGHT // SPACING) * (WIDTH // SPACING)


def test_a_track_ends_where_forward_and_backward_disagree() -> None:
    forward, backward = shifted(2.0, 0.0, 1)[0]
    backward[:, :, 20:] = 3.0
    tracks = follow([(forward, backward)], HEIGHT, WIDTH, SPACING)
    i, _ = tracks.both(0, 1)
    left = tracks.place[tracks.at(0)][:, 0] + 2 <= 19
    np.testing.assert_array_equal(np.sort(tracks.track[i]), np.flatnonzero(left))


def test_unknown_flow_ends_a_track_and_nothing_else() -> None:
    forward, backward = shifted(0.0, 0.0, 1)[0]
    forward[:, 4, 4] = np.nan
    tracks = follow([(forward, backward)], HEIGHT, WIDTH, SPACING)
    i, _ = tracks.both(0, 1)
    assert len(i) == len(tracks.track[tracks.at(0)]) - 1
    assert np.isfinite(tracks.place).all()


def test_no_track_crosses_a_cut() -> None:
    pairs = [*shifted(0.0, 0.0, 1), None, *shifted(0.0, 0.0, 1)]
    tracks = follow(pairs, HEIGHT, WIDTH, SPACING)
    assert len(tracks.both(0, 1)[0]) == len(tracks.both(2, 3)[0]) == 15
    assert not len(tracks.both(1, 2)[0])


def test_of_tracks_that_meet_the_older_goes_on() -> None:
    across = np.broadcast_to(np.arange(WIDTH, dtype=np.float32), (HEIGHT, WIDTH))
    squeeze, widen = uniform(0.0, 0.0), uniform(0.0, 0.0)
    squeeze[0], widen[0] = -0.4 * across, across / 0.6 - across
    tracks = follow([(squeeze, widen)], HEIGHT, WIDTH, 1)
    i, j = tracks.both(0, 1)
    pixel = np.rint(tracks.place[j]).astype(int)
    assert len(np.unique(pixel, axis=0)) == len(j) == HEIGHT * (round(0.6 * (WIDTH - 1)) + 1)
    older = {0: 0, 1: 1, 2: 3, 3: 5}
    row = pixel[:, 1] == 0
    for x, first in older.items():
        assert tracks.place[i][row & (pixel[:, 0] == x)][0, 0] == first


def test_rows_are_ordered_and_a_pair_is_read_when_it_is_needed() -> None:
    asked = []

    def pairs() -> Iterator[tuple[Flow, Flow]]:
        for m, pair in enumerate(shifted(3.0, 1.0, 5)):
            asked.append(m)
            yield pair

    tracks = follow(pairs(), HEIGHT, WIDTH, SPACING)
    assert asked == list(range(5))
    order = np.lexsort((tracks.track, tracks.frame))
    np.testing.assert_array_equal(order, np.arange(len(order)))


def test_a_frame_without_tracks_has_no_rows() -> None:
    tracks = Tracks(np.array([0, 0]), np.array([0, 2]), np.zeros((2, 2), np.float32))
    assert tracks.at(1) == slice(1, 1)
    assert not len(tracks.both(0, 1)[0])


@pytest.mark.parametrize(
    ("place", "expected"), [([0.4, 0.0], 0), ([0.6, 0.0], 1), ([2.0, 1.4], 5), ([9.0, 9.0], 5)]
)
def test_labels_are_those_of_the_nearest_pixel(place: list[float], expected: int) -> None:
    assert look_up(np.arange(6).reshape(2, 3), np.array([place], np.float32)).tolist() == [expected]
