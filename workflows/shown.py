"""How results and stores look where somebody prints them: text, and HTML in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


def as_text(title: str, lines: Sequence[str]) -> str:
    """The title, and the lines below it."""
    return "\n  ".join([title, *lines])


def as_html(title: str, lines: Sequence[str], table: str = "") -> str:
    """The title, a list, and a table that is HTML already."""
    return f"<b>{escape(title)}</b><ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>{table}"
