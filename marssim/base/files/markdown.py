"""Text that somebody else may have chosen, such as names and reasons, as text in Markdown."""

from __future__ import annotations

import re

BEGINNINGS = re.compile(r"([\\|<`]|(?<=\])\()")
PUNCTUATION = re.compile(r"([!-/:-@\[-`{-~])")  # a backslash before any of these makes it text (CommonMark 2.4)


def in_table(name: str) -> str:
    """Return a name as text in a cell of a table that is read as it is, too: only some characters are escaped.

    They are those that end a cell, or begin HTML, a link, an image or code.
    """
    return BEGINNINGS.sub(r"\\\1", name)


def as_text(words: str) -> str:
    """Return words that no renderer takes for markup: no emphasis, no HTML, no link, no image, no second line."""
    return PUNCTUATION.sub(r"\\\1", " ".join(words.split()))
