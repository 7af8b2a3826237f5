"""Other people's masks of one video, whatever the format: ``open_masks``.

| given | ids | overlaps |
| --- | --- | --- |
| folder of indexed PNG (``indexed``) | for the whole video | cannot be |
| .npz or .npy with one array (frame, y, x) (``volumes``) | for the whole video | cannot be |
| .npz with frame, score, packed, size (``volumes``) | none | higher score on top |
| folder of proposals_<frame>.npz (``volumes``) | none | higher score on top |
| COCO JSON (``coco``) | if all annotations (or their attributes) have a track_id or instance_id | higher score, else the smaller, on top |
| YouTube-VIS JSON (``ytvis``) | for the whole video | higher score, else the smaller, on top |
"""

from __future__ import annotations

from pathlib import Path

from zsmoseg.errors import FormatError
from zsmoseg.formats.annotations import load_json
from zsmoseg.formats.coco import CocoImages
from zsmoseg.formats.indexed import IndexedFolder
from zsmoseg.formats.names import frame_files, not_there
from zsmoseg.formats.npy import keys
from zsmoseg.formats.overlaps import FrameMasks, MaskSource
from zsmoseg.formats.volumes import PREFIX, Detections, IdVolume, ProposalFolder
from zsmoseg.formats.ytvis import Tracks

__all__ = ["FrameMasks", "MaskSource", "open_masks"]


def open_masks(path: str | Path, name: str | None = None) -> MaskSource:
    """Open the masks of one video.

    Parameters
    ----------
    path
        See the table above.
    name
        Of the video, for a JSON that holds several.

    Raises
    ------
    FormatError
        If it is none of these, or damaged.
    """
    path = Path(path)
    if path.is_dir():
        return _open_folder(path)
    if not path.is_file():
        raise not_there(path)
    ending = path.suffix.lower()
    if ending == ".json":
        return _open_json(path, name)
    if ending == ".npz" and set(keys(path)) >= Detections.KEYS:
        return Detections(path)
    if ending in (".npz", ".npy"):
        return IdVolume(path)
    raise FormatError(
        f"{path}: is no file of masks; give a folder of PNG, an npz, or COCO or YouTube-VIS JSON"
    )


def _open_folder(path: Path) -> MaskSource:
    images, proposals = frame_files(path, [".png"]), sorted(path.glob(f"{PREFIX}*.npz"))
    if images and proposals:
        raise FormatError(f"{path}: holds PNG and {PREFIX}<frame>.npz; keep those of one kind")
    if images:
        return IndexedFolder(path, images)
    if proposals:
        return ProposalFolder(path, proposals)
    raise FormatError(f"{path}: holds neither PNG files of ids nor {PREFIX}<frame>.npz")


def _open_json(path: Path, name: str | None) -> MaskSource:
    content = load_json(path)
    if isinstance(content, dict) and "videos" in content:
        return Tracks(path, content, name)
    if isinstance(content, dict) and "images" in content:
        return CocoImages(path, content, name)
    if isinstance(content, list) and content and all(isinstance(entry, dict) for entry in content):
        raise FormatError(
            f"{path}: is a list of results, which names no images; give them as the annotations of a file with images"
        )
    raise FormatError(
        f"{path}: is neither COCO (images, annotations) nor YouTube-VIS (videos, annotations) JSON"
    )
