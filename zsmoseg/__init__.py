"""Zero-shot motion segmentation: what moves by itself in a video from a moving camera.

>>> import zsmoseg
>>> result = zsmoseg.segment("walk.mp4")  # doctest: +SKIP
>>> result.masks("moving")  # (frame, y, x) bool  # doctest: +SKIP
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HERE = Path(__file__).parent
if not ((_HERE / "stores").is_dir() and (_HERE / "workflows").is_dir()):  # a checkout without symbolic links
    if not ((_HERE.parent / "stores").is_dir() and (_HERE.parent / "workflows").is_dir()):
        raise ImportError(
            f"{_HERE}: stores and workflows are missing, as when it is installed from a checkout without symbolic links; "
            "clone it with git clone -c core.symlinks=true and install that"
        )
    __path__.append(str(_HERE.parent))

_OFFERED = {
    "segment": ("zsmoseg.workflows.segmenting", "segment"),
    "open_store": ("zsmoseg.workflows.result", "open_store"),
    "settings": ("zsmoseg.settings", None),
    "synthetic": ("zsmoseg.synthetic", None),
}
__all__ = ["__version__", "open_store", "segment", "settings", "synthetic"]


if TYPE_CHECKING:
    from zsmoseg import settings, synthetic
    from zsmoseg.workflows.result import open_store
    from zsmoseg.workflows.segmenting import segment
else:  # type checkers know every name, and find those that are not there

    def __getattr__(name: str) -> Any:
        """Load what is offered when it is first asked for."""
        if name not in _OFFERED:
            raise AttributeError(f"module 'zsmoseg' has no attribute {name!r}")
        module, attribute = _OFFERED[name]
        loaded = import_module(module)
        return loaded if attribute is None else getattr(loaded, attribute)


def __dir__() -> list[str]:
    """What is offered, loaded or not."""
    return sorted({*globals(), *_OFFERED})
