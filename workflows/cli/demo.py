"""``zsmoseg demo``: a synthetic clip, segmented and scored."""

from __future__ import annotations

import argparse
from pathlib import Path

from zsmoseg.remote.url import local_folder
from zsmoseg.workflows.cli.common import store_option, store_path

FPS = 25


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``demo``."""
    parser.add_argument("-o", "--out", type=local_folder, default=Path("zsmoseg-out"), help="output folder")
    store_option(parser)
    parser.add_argument("--scheduler", default="local", help="local, serial, an address or a scheduler file")
    parser.add_argument("--seed", type=int, default=0, help="another scene")


def main(options: argparse.Namespace) -> int:
    """Render, segment, score; the clip stays beside the masks."""
    from zsmoseg.metrics.tracks import track_scores
    from zsmoseg.settings import resolve
    from zsmoseg.stores.location import Store
    from zsmoseg.synthetic import demo_scene
    from zsmoseg.workflows.result import Result
    from zsmoseg.workflows.running.progress import make_watcher
    from zsmoseg.workflows.running.request import Request
    from zsmoseg.workflows.running.run import run

    clip = options.out / "demo.mp4"
    print(f"rendering {clip}: a moving camera, two things that move by themselves")
    scene = demo_scene(options.seed)
    write_clip(clip, scene.frames)
    store = store_path(options.store, options.out)
    request = Request([str(clip)], options.out / "demo", store, resolve(), options.scheduler)
    with make_watcher() as watcher:
        report = run(request, watcher)
    if report.failures:
        return 1
    (plan,) = report.plans
    result = Result(
        Store.open(store, create=False), plan.name, plan.video, {n: s.key for n, s in plan.stages.items()}
    )
    found = result.masks("moving")
    scores = track_scores((truth > 0, mask.values) for truth, mask in zip(scene.truth, found, strict=True))
    print(f"against the truth of the scene: Pu {scores.pu:.1f}  Ru {scores.ru:.1f}  Fu {scores.fu:.1f}")
    print(f"look at {plan.output.path / 'overlay.mp4'}")
    return 0


def write_clip(path: Path, frames: object) -> None:
    """Frames (T, H, W, 3) BGR uint8 as H.264 of high quality."""
    import av
    import numpy as np

    from zsmoseg.video.decoding import media

    images = np.asarray(frames)
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(media(path), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=FPS)
        stream.width, stream.height, stream.pix_fmt = images.shape[2], images.shape[1], "yuv420p"
        stream.options = {"crf": "12", "preset": "veryfast", "threads": "1"}
        for image in images:
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, "bgr24")):
                container.mux(packet)
        for packet in stream.encode(None):
            container.mux(packet)
