"""Two real networks: what the stages leave is what ONNX Runtime says, to the last bit."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from conftest import SHARED
from runs import segment

from zsmoseg.depth.relative import relative
from zsmoseg.formats.rle import mask_of, unpacked
from zsmoseg.workflows.result import Result, open_store

MODELS, GOAT = SHARED / "models", SHARED / "DAVIS/JPEGImages/480p/goat"
FRAMES = 5
pytestmark = pytest.mark.skipif(not MODELS.is_dir(), reason=f"{MODELS} is missing")


@pytest.fixture(scope="module")
def goat(tmp_path_factory: pytest.TempPathFactory) -> Result:
    root = tmp_path_factory.mktemp("real")
    settings = {
        "proposals.source": "network",
        "proposals.model": "yolov8n-seg",
        "depth.source": "network",
        "depth.model": "tcmonodepth-small",
        "video.end": f"{FRAMES}f",
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ZSMOSEG_MODELS", str(MODELS))
        segment(GOAT, root, settings)
    return open_store(root / "store")["goat"]


def frames() -> list[np.ndarray]:
    return [cv2.imread(str(path)) for path in sorted(GOAT.glob("*.jpg"))[:FRAMES]]


def direct(name: str, tensor: np.ndarray) -> list[np.ndarray]:
    import onnxruntime

    session = onnxruntime.InferenceSession(MODELS / name / f"{name}.onnx")
    return session.run(None, {session.get_inputs()[0].name: tensor})


def test_depth_is_that_of_the_network(goat: Result) -> None:
    """The contract's words: RGB 0..255, short side 256, multiples of 32, cubic on numbers, disparity."""
    stored = goat.tree["depth/inverse_depth"].values
    for image, found in zip(frames(), stored, strict=True):
        tensor = cv2.resize(image.astype(np.float32), (448, 256), interpolation=cv2.INTER_CUBIC)[..., ::-1]
        (disparity,) = direct("tcmonodepth-small", np.ascontiguousarray(tensor.transpose(2, 0, 1)[None]))
        full = cv2.resize(disparity[0, 0], image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        np.testing.assert_array_equal(found, relative(full, found.shape).astype(np.float16))
    assert stored[:, -40:].mean() > 1.5 * stored[:, :40].mean(), (
        "near is large: the rocks in front, not the slope"
    )


def test_boxes_scores_and_masks_are_those_of_the_network(goat: Result) -> None:
    """The contract's words: letterbox of 640, 114 around, RGB 0..1; candidates above 0.1; logits > 0 in the box."""
    found = goat.tree["detections"]
    ends = np.cumsum([0, *found["candidates"].values])
    masks = unpacked(found["length"].values, found["run"].values, (480, 854))
    for t, image in enumerate(frames()):
        canvas = np.full((640, 640, 3), 114, np.uint8)
        canvas[140:500] = cv2.resize(image, (640, 360), interpolation=cv2.INTER_LINEAR)
        tensor = canvas[..., ::-1].astype(np.float32) * np.float32(0.00392156862745098)
        rows, prototypes = direct("yolov8n-seg", np.ascontiguousarray(tensor.transpose(2, 0, 1)[None]))
        best = rows[0, 4:84].max(0)
        for n in range(ends[t], ends[t + 1]):
            (k,) = np.flatnonzero(best == found["score"].values[n, 0])
            assert rows[0, 4:84, k].argmax() == found["category_of"].values[n, 0]
            x, y, w, h = rows[0, :4, k]
            corners = np.array([x - w / 2, y - h / 2 - 140, x + w / 2, y + h / 2 - 140])
            box = np.clip(corners / np.tile([640 / 854, 360 / 480], 2), 0, [854, 480, 854, 480])
            np.testing.assert_allclose(found["box"].values[n], box, atol=1e-3)
            logits = np.tensordot(rows[0, 84:, k], prototypes[0], 1)
            full = cv2.resize(cv2.resize(logits, (640, 640))[140:500], (854, 480)) > 0
            inside = np.zeros_like(full)
            x0, y0, x1, y1 = np.rint(box).astype(int)
            inside[y0:y1, x0:x1] = full[y0:y1, x0:x1]
            mask = mask_of(masks[n])
            assert (mask & inside).sum() > 0.97 * (mask | inside).sum()
    assert (found["candidates"].values > 0).all()
