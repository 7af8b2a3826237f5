"""Export of pixels to keep, for reconstruction: one image a frame, as COLMAP and nerfstudio look for it.

Both read images as they are stored, whatever EXIF says of their orientation (COLMAP since 3.8; nerfstudio copies and opens
them so), and take a mask for what it is called.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from zsmoseg.errors import FormatError, OutputError, SettingsError
from zsmoseg.formats.frame_names import match_frames
from zsmoseg.formats.keep import encode_keep
from zsmoseg.stores import files
from zsmoseg.video.orientation import UPRIGHT, as_stored, orientation
from zsmoseg.video.pixels import image_size
from zsmoseg.video.sources import image_files
from zsmoseg.workflows.export.painting import image_names, painted
from zsmoseg.workflows.export.registry import Choice
from zsmoseg.workflows.result import Result


def write_colmap(result: Result, path: Path, choice: Choice) -> None:
    """Called like the image, ``.png`` added."""
    _write(result, path, choice, lambda name: f"{name}.png")


def write_nerfstudio(result: Result, path: Path, choice: Choice) -> None:
    """Called like the image without its ending, in a folder ``masks``."""
    _write(result, path, choice, lambda name: f"masks/{Path(name).stem}.png")


def check_images(result: Result, choice: Choice) -> None:
    """Raise where what moves would grow by more than the frame, or the images for which masks are made cannot be read, or are
    not those of the video.
    """
    size = result.probe.width, result.probe.height
    if choice.dilate > max(size):
        raise SettingsError(
            f"--dilate {choice.dilate}: {result.name} is {size[0]} x {size[1]}; give {max(size)} px or less"
        )
    for image in _images(result, choice.images):
        if image_size(image) != size:
            raise FormatError(
                f"{image}: is {' x '.join(map(str, image_size(image)))}, the frames are {size[0]} x {size[1]}; "
                "give --images the frames at that size"
            )


def _write(result: Result, path: Path, choice: Choice, called: Callable[[str], str]) -> None:
    images = _images(result, choice.images)
    names = [Path(image).name for image in images] or image_names(result)
    turns = [orientation(image) for image in images] or [UPRIGHT] * len(names)
    for name, turn, ids in zip(names, turns, painted(result, "group", choice.when), strict=True):
        mask = as_stored(ids > 0, turn)
        files.write(files.below(path, called(name), OutputError), encode_keep(mask, choice.dilate))


def _images(result: Result, folder: str) -> list[str]:
    """The image of every frame: of a folder, else of the source; none of a video file without a folder.

    Raises
    ------
    FormatError
        If the images of the folder are not those of the frames, or those of the source are gone.
    """
    probe = result.probe
    if not folder:
        return _own(result) if probe.files else []
    found = image_files(folder)
    stems = [Path(image).stem for image in found]
    if probe.files:
        places = match_frames(stems, [Path(file).stem for file in probe.files], folder)
    elif len(found) == probe.total:
        places = list(probe.indices)
    elif len(found) == len(probe.times):
        places = list(range(len(found)))
    else:
        places = [None]
    if None in places:
        raise FormatError(
            f"{folder}: holds {len(found)} images, {result.name} has {probe.total} frames, {len(probe.times)} of them used; "
            "give --images a folder with one image for each (ffmpeg -i VIDEO -fps_mode passthrough FOLDER/%05d.png)"
        )
    return [found[place] for place in places if place is not None]


def _own(result: Result) -> list[str]:
    """The images of the source that are used, as it lists them now: a record may name any file."""
    probe = result.probe
    found = image_files(probe.source)
    used = [found[index] for index in probe.indices if index < len(found)]
    if [Path(image).name for image in used] != [Path(file).name for file in probe.files]:
        raise FormatError(
            f"{probe.source}: its images are gone or others, and how they are stored is read from them; "
            "give the images with --images FOLDER"
        )
    return used
