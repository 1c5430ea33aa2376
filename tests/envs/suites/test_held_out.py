from dataclasses import replace

import pytest

from envs.suites.held_out import held_out_seed, published_digest
from envs.suites.suite import Suite

SECRET = "correct horse battery staple"
A = Suite("a-v1", 64 * "a", "0.2.0", {}, {}, {}, {})


def test_digest_and_seed_follow_from_the_passphrase_the_suite_and_the_number_of_courses():
    """Conditions that are changed after the digest was published change the file's SHA-256."""
    digest = published_digest(A, 20, SECRET)
    seed = held_out_seed(A, 20, SECRET, digest)
    assert held_out_seed(A, 20, SECRET, f" {digest.upper()}\n") == seed and 0 <= seed < 2**64
    for suite, courses, secret in (
        (replace(A, name="b-v1"), 20, SECRET), (replace(A, sha256=64 * "b"), 20, SECRET), (A, 19, SECRET),
        (A, 20, SECRET + "."),
    ):  # fmt: skip
        other = published_digest(suite, courses, secret)
        assert other != digest and held_out_seed(suite, courses, secret, other) != seed
        message = rf"^`published` must be the digest of this passphrase, of {courses} courses and of .* {suite.name}, "
        with pytest.raises(ValueError, match=message):
            held_out_seed(suite, courses, secret, digest)


def test_the_published_digest_does_not_begin_like_the_seed():
    digest = published_digest(A, 20, SECRET)
    assert len(digest) == 64 and f"{held_out_seed(A, 20, SECRET, digest):016x}" not in digest


def test_a_short_passphrase_is_refused():
    with pytest.raises(ValueError, match="must have 16 characters or more, got 5"):
        published_digest(A, 20, "short")
    assert len(published_digest(A, 20, 16 * "a")) == 64
