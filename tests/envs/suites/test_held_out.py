import pytest

from envs.suites.held_out import held_out_seed, published_digest

SECRET = "correct horse battery staple"


def test_the_seed_follows_from_the_passphrase_and_the_suite():
    digests = {published_digest(name, SECRET) for name in ("a-v1", "b-v1")}
    seeds = {held_out_seed(name, SECRET, published_digest(name, SECRET)) for name in ("a-v1", "b-v1")}
    assert len(digests) == 2 and len(seeds) == 2 and all(0 <= seed < 2**64 for seed in seeds)
    assert held_out_seed("a-v1", SECRET, f" {published_digest('a-v1', SECRET).upper()}\n") in seeds


def test_the_published_digest_does_not_begin_like_the_seed():
    digest = published_digest("a-v1", SECRET)
    assert len(digest) == 64 and f"{held_out_seed('a-v1', SECRET, digest):016x}" not in digest


def test_another_passphrase_is_refused():
    with pytest.raises(ValueError, match=r"^`published` must be the digest of this passphrase for a-v1, "):
        held_out_seed("a-v1", SECRET, published_digest("a-v1", SECRET + "."))
    with pytest.raises(ValueError, match="must have 16 characters or more, got 5"):
        published_digest("a-v1", "short")
