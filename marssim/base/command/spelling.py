"""Suggests the word that a misspelt one may stand for."""

from __future__ import annotations

import difflib
from collections.abc import Sequence


def did_you_mean(word: str, known: Sequence[str]) -> str:
    """Return the end of an error message on an unknown word: " (did you mean NAME?)", or nothing.

    Args:
        word: The unknown word.
        known: The words that are allowed; the most similar one is suggested if it is similar enough.
    """
    near = difflib.get_close_matches(word, known, 1)
    return f" (did you mean {near[0]}?)" if near else ""
