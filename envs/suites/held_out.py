"""A split that nobody has seen: its courses follow from a passphrase, whose digest is published first.

The host of a challenge chooses a passphrase, publishes `published_digest`, and keeps the passphrase secret. When all
methods are in, the host publishes the passphrase too. Everyone can then check that it belongs to the digest, so the
courses were not chosen to favour anyone, and draw the same courses from it.

The digest covers the content of the suite's file, whose conditions the courses take over, and the number of courses: a
host who changes one of them after the methods are known needs another digest. It says nothing of the courses.
"""

from __future__ import annotations

import hashlib

from envs.suites.suite import Suite
from marssim.base.command.wording import counted

SPLIT = "held_out"  # name of the split
SHORTEST = 16  # characters of a passphrase, so that trying them all takes too long


def published_digest(suite: Suite, courses: int, passphrase: str) -> str:
    """Return the digest to publish before the challenge, 64 hexadecimal digits.

    Args:
        suite: The suite whose conditions are driven.
        courses: Number of courses under each condition.
        passphrase: The secret.

    Raises:
        ValueError: The passphrase has less than 16 characters.
    """
    return _digest(suite, courses, "published", passphrase)


def held_out_seed(suite: Suite, courses: int, passphrase: str, published: str) -> int:
    """Return the seed of the held-out courses.

    Args:
        suite: The suite whose conditions are driven.
        courses: Number of courses under each condition.
        passphrase: The secret.
        published: The digest that was published.

    Raises:
        ValueError: The passphrase is too short; or passphrase, suite and number of courses are not those of the digest.
    """
    digest = published_digest(suite, courses, passphrase)
    if digest != published.strip().lower():
        raise ValueError(
            f"`published` must be the digest of this passphrase, of {counted(courses, 'course')} and of this file of "
            f"{suite.name}, {digest}, got {published!r}"
        )
    return int(_digest(suite, courses, "courses", passphrase)[:16], 16)


def _digest(suite: Suite, courses: int, use: str, passphrase: str) -> str:
    if len(passphrase) < SHORTEST:
        raise ValueError(f"the passphrase must have {SHORTEST} characters or more, got {len(passphrase)}")
    return hashlib.sha256(f"{suite.name}\n{suite.sha256}\n{courses}\n{use}\n{passphrase}".encode()).hexdigest()
