"""Phrases that the messages of several commands share."""

from __future__ import annotations

GOES_ON = "the same command goes on from here"
KILLED = f"a worker process was killed, perhaps for lack of memory; {GOES_ON}, with fewer --workers it needs less"


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, as "1 pair" or "2 pairs".

    Args:
        number: How many there are.
        noun: The noun in the singular, whose plural ends in s.
    """
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
