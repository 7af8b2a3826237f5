"""Words, boxes and masks of networks: on generated graphs that know plain colours (``graphs.py``)."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from graphs import (
    COLOURS,
    TAGS,
    VOCABULARY,
    coloured_clip,
    write_box_filler,
    write_detector,
    write_lines,
    write_segmenter,
    write_tagger,
)

from zsmoseg.errors import ModelError, SettingsError
from zsmoseg.networks.box_masks import embed, logits_of_frame, masks_of_boxes, masks_of_points, point_grid
from zsmoseg.networks.contract import load_contract
from zsmoseg.networks.image import Geometry
from zsmoseg.networks.prompts import padded, parse_prompt, prompts_of, tokenizer_of
from zsmoseg.networks.session import Network
from zsmoseg.networks.tags import chosen_tags, tag_names, tag_scores, tag_thresholds
from zsmoseg.networks.text_boxes import Candidates, RawBoxes, prompts_for, text_boxes

TOKENIZER = tokenizer_of("\n".join(VOCABULARY).encode(), "vocab.txt")
RED, GREEN, BLUE = ([255 * part for part in COLOURS[name][::-1]] for name in ("red", "green", "blue"))


def opened(folder: Path) -> Network:
    return Network(load_contract(folder), "cpu")


def picture(height: int = 117, width: int = 203) -> np.ndarray:
    """Grey, with a red and a blue rectangle: x 31..70, y 20..49 and x 120..179, y 60..99."""
    frame = np.full((height, width, 3), 128, np.uint8)
    frame[20:50, 31:71] = RED
    frame[60:100, 120:180] = BLUE
    return frame


BOXES = np.float32([[31, 20, 71, 50], [120, 60, 180, 100]])


def found(folder: Path, phrases: tuple[str, ...], frame: np.ndarray, **options: Any) -> RawBoxes:
    network = opened(folder)
    return text_boxes(network, frame, prompts_for(network.contract, phrases), **options)


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


# ------------------------------------------------------------------------------------------------ phrases


def test_a_prompt_is_split_at_commas_and_lonely_stops_and_said_twice_counts_once() -> None:
    assert parse_prompt("Person, dog . big cat. bird; dog.") == ("person", "dog", "big cat", "bird")
    with pytest.raises(SettingsError, match="no phrase"):
        parse_prompt(" , . ")


def test_tokens_stand_as_the_detector_was_trained() -> None:
    (prompt,) = prompts_of(["red square", "Teddy bears"], TOKENIZER)
    words = [VOCABULARY[index] for index in prompt.input_ids[0]]
    assert words == ["[CLS]", "red", "square", ".", "teddy", "bear", "##s", ".", "[SEP]"]
    assert prompt.spans == ((1, 3), (4, 7))
    assert prompt.position_ids[0].tolist() == [0, 0, 1, 2, 0, 1, 2, 3, 0]


def test_a_token_attends_to_its_own_phrase_only() -> None:
    (prompt,) = prompts_of(["red", "blue square"], TOKENIZER)
    blocks = [[0], [1, 2], [3, 4, 5], [6]]
    expected = np.zeros((7, 7), bool)
    for block in blocks:
        expected[np.ix_(block, block)] = True
    assert np.array_equal(prompt.text_token_mask[0], expected)
    longer = padded(prompt, 9)
    assert np.array_equal(longer.text_token_mask[0, :7, :7], expected)
    assert np.array_equal(longer.text_token_mask[0, 7:], np.eye(9, dtype=bool)[7:])
    assert longer.attention_mask[0].tolist() == [1] * 7 + [0, 0]


@pytest.mark.parametrize("most", [6, 9, 40])
def test_many_phrases_make_several_prompts_split_at_their_borders(most: int) -> None:
    phrases = [f"{colour} {noun}" for colour in COLOURS for noun in ("dog", "cat", "teddy")]
    prompts = prompts_of(phrases, TOKENIZER, most)
    assert [index for prompt in prompts for index in prompt.phrases] == list(range(len(phrases)))
    assert max(prompt.input_ids.shape[1] for prompt in prompts) <= most
    for prompt in prompts:
        for index, (a, b) in zip(prompt.phrases, prompt.spans, strict=True):
            assert " ".join(VOCABULARY[i] for i in prompt.input_ids[0, a:b]) == phrases[index]
    assert len(prompts) == {6: 12, 9: 6, 40: 1}[most]


@pytest.mark.parametrize(
    ("phrases", "named"),
    [([], "no phrase"), (["dog", " . "], '" . "'), (["犬"], "犬"), (["a" + " dog" * 300], "tokens")],
)
def test_phrases_that_cannot_be_asked_for_are_named(phrases: list[str], named: str) -> None:
    with pytest.raises(SettingsError, match=named):
        prompts_of(phrases, TOKENIZER)


def test_a_file_that_is_no_vocabulary_is_refused() -> None:
    with pytest.raises(ModelError, match=r"no token"):
        tokenizer_of(b"red\nblue", "vocab.txt")
    with pytest.raises(ModelError, match=r"tokenizer.json is no vocabulary"):
        tokenizer_of(b"{}", "tokenizer.json")


# ------------------------------------------------------------------------------------------------ tags


def test_tags_that_are_seen_pass_their_own_thresholds(tmp_path: Path) -> None:
    network = opened(write_tagger(tmp_path))
    scores = tag_scores(network, picture())
    on = chosen_tags(scores, tag_thresholds(network.contract))
    assert [tag_names(network.contract)[index] for index in on] == ["red square", "blue square", "sky"]
    assert scores[TAGS.index("stand")] > 0.9, "on, but for its threshold of 1"


def test_a_threshold_is_exceeded_strictly() -> None:
    half = np.float32([0.5, 0.5])
    assert chosen_tags(half, np.float32([0.5, 0.4999])).tolist() == [1]


def test_tags_as_probabilities_are_not_squashed_again(tmp_path: Path) -> None:
    logits, probabilities = (
        tag_scores(opened(write_tagger(tmp_path / meaning, meaning)), picture())
        for meaning in ("logits", "probabilities")
    )
    np.testing.assert_allclose(logits, probabilities, atol=1e-6)


def with_lines(folder: Path, name: str, lines: tuple[object, ...]) -> Network:
    """The tagger with another text file, whose digest the contract knows."""
    old, new = (folder / name).read_bytes(), write_lines(folder / name, lines)
    contract = (folder / "contract.toml").read_text().replace(hashlib.sha256(old).hexdigest(), new["sha256"])
    (folder / "contract.toml").write_text(contract.replace(f"bytes = {len(old)}", f"bytes = {new['bytes']}"))
    return opened(folder)


def test_a_tag_list_of_another_length_is_refused_with_both_numbers(tmp_path: Path) -> None:
    network = with_lines(write_tagger(tmp_path), "tags.txt", TAGS[:5])
    with pytest.raises(ModelError, match=r"scores 6 tags, tags.txt names 5"):
        tag_scores(network, picture())
    with pytest.raises(ModelError, match=r"5 tags, thresholds.txt has 6"):
        tag_thresholds(network.contract)


def test_a_tag_list_that_was_edited_is_refused(tmp_path: Path) -> None:
    network = opened(write_tagger(tmp_path))
    write_lines(tmp_path / "tags.txt", TAGS[::-1])
    with pytest.raises(ModelError, match="sha256"):
        tag_names(network.contract)


# ------------------------------------------------------------------------------------------------ boxes


@pytest.mark.parametrize("original", [False, True])
@pytest.mark.parametrize("shape", [(117, 203), (240, 183), (160, 320)])
def test_boxes_are_exact_and_every_phrase_has_its_scores(
    tmp_path: Path, original: bool, shape: tuple[int, int]
) -> None:
    raw = found(write_detector(tmp_path, original), ("dog", "blue square", "red"), picture(*shape))
    by_phrase = raw.phrase_score.argmax(1)
    assert sorted(by_phrase) == [1, 2], "the second and third phrase, not the first"
    for box, phrase in zip(raw.box, by_phrase, strict=True):
        np.testing.assert_allclose(box, BOXES[2 - phrase], atol=1e-3)
    np.testing.assert_allclose(raw.phrase_score.max(1), 1 / (1 + np.exp(-4)), atol=1e-6)


LETTERBOXES = {
    "centre": {"rule": "letterbox", "height": 256, "width": 320, "pad_value": [114, 114, 114]},
    "corner": {"rule": "long-side", "long_side": 320, "pad": "bottom-right"},
    "stretched": {"rule": "stretch", "height": 351, "width": 406, "interpolation": "antialias"},
}


@pytest.mark.parametrize("resize", LETTERBOXES.values(), ids=LETTERBOXES)
def test_boxes_come_back_from_letterboxes_within_a_pixel(tmp_path: Path, resize: dict[str, Any]) -> None:
    raw = found(write_detector(tmp_path, True, resize), ("red", "blue"), picture())
    order = raw.box[:, 0].argsort()
    np.testing.assert_allclose(raw.box[order], BOXES, atol=1)


def test_the_mask_of_pixels_makes_boxes_count_from_the_picture(tmp_path: Path) -> None:
    raw = found(write_detector(tmp_path, False, LETTERBOXES["corner"]), ("red", "blue"), picture())
    np.testing.assert_allclose(raw.box[raw.box[:, 0].argsort()], BOXES, atol=1)


def test_the_order_of_phrases_changes_no_score(tmp_path: Path) -> None:
    folder = write_detector(tmp_path, True)
    there, back = (
        found(folder, phrases, picture()) for phrases in (("red", "dog", "blue"), ("blue", "dog", "red"))
    )
    a, b = there.box[:, 0].argsort(), back.box[:, 0].argsort()
    assert np.array_equal(there.box[a], back.box[b])
    assert np.array_equal(there.phrase_score[a], back.phrase_score[b][:, ::-1])


def test_several_prompts_number_their_phrases_together(tmp_path: Path) -> None:
    folder = write_detector(tmp_path, most_tokens=7)
    raw = found(folder, ("red square", "dog", "cat", "blue square"), picture())
    order = raw.box[:, 0].argsort()
    np.testing.assert_allclose(raw.box[order], BOXES, atol=1e-3)
    assert raw.phrase_score[order].argmax(1).tolist() == [0, 3]


def test_a_graph_that_knows_one_phrase_is_called_once_for_each(tmp_path: Path) -> None:
    network = opened(write_detector(tmp_path, phrases="one"))
    prompts = prompts_for(network.contract, ("red", "blue"))
    assert [prompt.phrases for prompt in prompts] == [(0,), (1,)]
    assert len(text_boxes(network, picture(), prompts).box) == 2
    with pytest.raises(ModelError, match="one phrase a call"):
        text_boxes(network, picture(), prompts_of(("red", "blue"), TOKENIZER))


def test_red_is_not_blue(tmp_path: Path) -> None:
    frame = picture()
    frame[60:100, 120:180] = 128
    right = found(write_detector(tmp_path / "rgb"), ("red", "blue"), frame)
    swapped = found(write_detector(tmp_path / "bgr", colour_order="BGR"), ("red", "blue"), frame)
    assert right.phrase_score.argmax(1).tolist() == [0]
    assert swapped.phrase_score.argmax(1).tolist() != [0]


def test_nothing_found_is_no_box(tmp_path: Path) -> None:
    raw = found(write_detector(tmp_path), ("green", "dog"), picture())
    assert raw.box.shape == (0, 4)
    assert raw.phrase_score.shape == (0, 2)
    assert raw.outside == 0


def test_a_box_that_is_there_already_counts_once_and_the_most_are_the_best(tmp_path: Path) -> None:
    folder = write_detector(tmp_path, most_tokens=5)
    twice = found(folder, ("red", "red", "blue"), picture())
    assert len(twice.box) == 2
    assert len(found(folder, ("red", "blue"), picture(), candidates=Candidates(most=1)).box) == 1


# ------------------------------------------------------------------------------------------------ masks


@pytest.mark.parametrize("shape", [(117, 203), (203, 181), (240, 320)])
def test_masks_of_boxes_are_the_objects(tmp_path: Path, shape: tuple[int, int]) -> None:
    network, frame = opened(write_segmenter(tmp_path)), picture(*shape)
    boxes = np.concatenate([BOXES + np.float32([-4, -4, 4, 4]), np.float32([[500, 20, 600, 60]])])
    masks = masks_of_boxes(network, embed(network, frame), boxes)
    assert masks.mask.shape == (3, *shape)
    for mask, colour in zip(masks.mask, (RED, BLUE), strict=False):
        least, most = (
            change((frame == colour).all(-1).astype(np.uint8), np.ones((3, 3)))
            for change in (cv2.erode, cv2.dilate)
        )
        assert mask[least > 0].all(), "within a pixel of its edge"
        assert most[mask].all(), "within a pixel of its edge"
    assert not masks.mask[2].any(), "a box outside the frame"
    np.testing.assert_allclose(masks.quality, [0.9, 0.9, 0], atol=1e-6)
    assert (masks.stability[:2] > 0.8).all()


@pytest.mark.parametrize(
    ("style", "slots"), [("efficient-sam", False), ("efficient-sam", True), ("transformers", False)]
)
def test_other_forms_of_decoders_take_several_boxes_a_call(tmp_path: Path, style: str, slots: bool) -> None:
    network, frame = opened(write_box_filler(tmp_path, style, slots)), picture()
    boxes = np.concatenate([BOXES, np.float32([[-5, 90, 60, 140]])])
    masks = masks_of_boxes(network, embed(network, frame), boxes)
    for mask, (left, top, right, bottom) in zip(
        masks.mask, np.clip(boxes, 0, [203, 117, 203, 117]), strict=True
    ):
        y, x = np.nonzero(mask)
        np.testing.assert_allclose(
            [x.min(), y.min(), x.max() + 1, y.max() + 1], [left, top, right, bottom], atol=1.01
        )
    np.testing.assert_allclose(masks.quality, 0.8)


def test_two_passes_are_refused_where_no_logits_are_taken_back(tmp_path: Path) -> None:
    folder = write_box_filler(tmp_path, "efficient-sam", slots=True)
    text = (folder / "contract.toml").read_text()
    (folder / "contract.toml").write_text(text.replace("boxes_per_call", "passes = 2, boxes_per_call"))
    network = opened(folder)
    with pytest.raises(ModelError, match="passes = 2"):
        embed(network, picture())


def test_one_step_upsampling_of_a_padded_picture_is_refused(tmp_path: Path) -> None:
    folder = write_segmenter(tmp_path)
    text = (folder / "contract.toml").read_text()
    (folder / "contract.toml").write_text(text.replace("passes = 1", 'upsample = "frame"'))
    with pytest.raises(ModelError, match="fills the canvas"):
        embed(opened(folder), picture())


def test_no_boxes_are_no_masks(tmp_path: Path) -> None:
    network = opened(write_segmenter(tmp_path))
    masks = masks_of_boxes(network, embed(network, picture()), np.zeros((0, 4), np.float32))
    assert masks.mask.shape == (0, 117, 203)


def test_a_second_pass_gives_the_logits_back(tmp_path: Path) -> None:
    network = opened(
        write_segmenter(tmp_path, passes=2, resize={"rule": "stretch", "height": 256, "width": 256})
    )
    once = masks_of_boxes(network, embed(network, picture()), BOXES)
    np.testing.assert_allclose(once.quality, 0.95, atol=1e-6)


def test_points_find_the_vivid_objects_and_nothing_pale(tmp_path: Path) -> None:
    network, frame = opened(write_segmenter(tmp_path)), picture()
    masks = masks_of_points(network, embed(network, frame), point_grid(8, *frame.shape[:2]))
    assert {round(float(q), 2) for q in masks.quality} == {0.9}
    assert iou(masks.mask.any(0), ((frame == RED) | (frame == BLUE)).all(-1)) > 0.9


def test_logits_grow_before_they_are_compared_with_zero() -> None:
    """A slanted edge: bilinear logits give the line to half a pixel, a mask that is grown has steps of a cell."""
    y, x = np.mgrid[:64, :64].astype(np.float32) + 0.5
    logits = x - 0.7 * y - 8
    where = Geometry((480, 854), (576, 1024), (1024, 1024))
    full = logits_of_frame(logits, where, "canvas") > 0
    rows, columns = np.mgrid[:480, :854] + 0.5
    edge = columns * 1024 / 854 / 16 - 0.7 * rows * 576 / 480 / 16 - 8
    wrong = (full != (edge > 0))[
        10:-10, 10:-10
    ]  # beyond the outermost cells' middles there is nothing to go by
    assert np.abs(edge[10:-10, 10:-10][wrong]).max(initial=0) < 0.05, "a cell is 1 of these units"


def test_the_coloured_clip_is_tagged_boxed_and_masked_to_its_truth(tmp_path: Path) -> None:
    images, truth = coloured_clip(12, 121, 167)
    tagger, detector, segmenter = (
        opened(write(tmp_path / write.__name__)) for write in (write_tagger, write_detector, write_segmenter)
    )
    for t in (0, 11):
        scores = tag_scores(tagger, images[t])
        on = chosen_tags(scores, tag_thresholds(tagger.contract))
        phrases = [TAGS[index] for index in on]
        raw = text_boxes(detector, images[t], prompts_for(detector.contract, phrases))
        masks = masks_of_boxes(segmenter, embed(segmenter, images[t]), raw.box)
        seen = sorted(set(np.unique(truth[t])) - {0})
        assert len(masks.mask) == len(seen) == (3 if t == 0 else 4)
        for number in seen:
            assert max(iou(mask, truth[t] == number) for mask in masks.mask) > 0.85


def test_the_same_frame_gives_the_same_bytes(tmp_path: Path) -> None:
    folder = write_segmenter(tmp_path)
    first, second = (
        masks_of_boxes(network, embed(network, picture()), BOXES)
        for network in (opened(folder), opened(folder))
    )
    assert first.mask.tobytes() == second.mask.tobytes()
    assert replace(first, mask=second.mask).stability.tobytes() == second.stability.tobytes()
