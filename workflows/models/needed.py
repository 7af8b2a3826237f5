"""Which models a preset needs."""

from __future__ import annotations

from zsmoseg.settings import resolve
from zsmoseg.workflows.planning.chosen_models import named


def preset_models(preset: str) -> list[str]:
    """The models that the settings of a preset name, each once.

    Raises
    ------
    SettingsError
        The preset is unknown.
    """
    return list(dict.fromkeys(model for _, _, model in named(resolve(preset))))
