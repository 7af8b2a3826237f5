"""Masks as one PNG a frame whose pixel values are ids: palette or grey, 8 or 16 bits (DAVIS)."""

from __future__ import annotations

from pathlib import Path

from zsmoseg.errors import FormatError
from zsmoseg.formats.binary import refuse_binary
from zsmoseg.formats.label_images import image_size, read_labels
from zsmoseg.formats.names import others
from zsmoseg.formats.overlaps import FrameMasks, MaskSource, as_ids, text


class IndexedFolder(MaskSource):
    """A folder of PNG files named like the frames; sizes and kinds are checked when it is opened."""

    def __init__(self, folder: Path, files: list[Path]) -> None:
        size = image_size(files[0])
        for file in files[1:]:
            if image_size(file) != size:
                raise FormatError(
                    f"{file}: is {text(image_size(file))}, {files[0].name} {text(size)}; give all in one size"
                )
        super().__init__(folder, [file.stem for file in files], len(files), size, ids=True)
        self._files = files
        self.left_out += others(folder, files)
        refuse_binary((str(file), self._read(i).label) for i, file in enumerate(files))

    def _read(self, index: int) -> FrameMasks:
        file = self._files[index]
        return FrameMasks(as_ids(read_labels(file), self.size, str(file)))
