"""Suggests the word that a misspelt one may stand for."""

from __future__ import annotations

import difflib
from collections.abc import Sequence


def did_you_mean(word: str, words: Sequence[str]) -> str:
    """Return the end of an error message on an unknown word: " (did you mean NAME?)", or nothing.

    Args:
        word: The unknown word.
        words: The words that are allowed. One that differs in two swapped neighbours is suggested first, and else the
            most similar one if it is similar enough.
    """
    swapped = {word[:i] + word[i + 1] + word[i] + word[i + 2 :] for i in range(len(word) - 1)}
    # difflib counts a swap as two errors and would suggest gravel for gael
    near = [name for name in words if name in swapped] or difflib.get_close_matches(word, words, 1)
    return f" (did you mean {near[0]}?)" if near else ""
