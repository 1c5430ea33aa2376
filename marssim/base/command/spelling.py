"""Suggests the word that a misspelt one may stand for."""

from __future__ import annotations

import difflib
from collections.abc import Sequence


def did_you_mean(word: str, words: Sequence[str]) -> str:
    """Return the end of an error message on an unknown word: " (did you mean NAME?)", or nothing.

    Args:
        word: The unknown word.
        words: The words that are allowed. One that differs in capitals alone is suggested first, then one that differs
            in two swapped neighbours, and else the most similar one if it is similar enough.
    """
    near = nearest(word, words)
    return "" if near is None else f" (did you mean {near}?)"


def nearest(word: str, words: Sequence[str]) -> str | None:
    """Return the allowed word that an unknown one may stand for, as did_you_mean chooses it; None if none is near."""
    swapped = {word[:i] + word[i + 1] + word[i] + word[i + 2 :] for i in range(len(word) - 1)}
    # difflib counts a swap as two errors and would suggest gravel for gael
    near = [name for name in words if name.lower() == word.lower()]
    near = near or [name for name in words if name in swapped] or difflib.get_close_matches(word, words, 1)
    return near[0] if near else None
