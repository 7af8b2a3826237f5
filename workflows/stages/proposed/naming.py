"""What networks may name: the tags of a list, a prompt, or the categories that a network was trained on."""

from __future__ import annotations

from zsmoseg import settings
from zsmoseg.networks.instance_masks import categories_of
from zsmoseg.networks.prompts import parse_prompt
from zsmoseg.networks.references import contract_at
from zsmoseg.networks.tags import tag_names

ANYTHING = ("object",)
"""The one category of networks that name nothing."""


def tag_list(s: settings.Tags) -> tuple[str, ...]:
    """The tags that are looked for, or may be found."""
    if s.prompt:
        return parse_prompt(s.prompt)
    return tag_names(contract_at(s.model)) if s.model else ()


def categories(proposals: settings.Proposals, tags: settings.Tags) -> tuple[str, ...]:
    """The names of the categories that proposals have with these settings; none where nothing is named."""
    if proposals.source != "network":
        return ()
    if proposals.model:
        return tuple(categories_of(contract_at(proposals.model))) or ANYTHING
    return tag_list(tags)
