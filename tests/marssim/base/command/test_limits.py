from dataclasses import dataclass

import pytest

from marssim.base.command.limits import check_least


@dataclass(frozen=True)
class Settings:
    pairs: int = 1
    limit: int | None = None
    step: float = 0.5


def test_the_least_value_and_none_pass():
    check_least(Settings(), pairs=1, limit=1, step=0.5)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (Settings(pairs=0), "pairs must be at least 1, got 0"),
        (Settings(limit=-1), "limit must be at least 1, got -1"),
        (Settings(step=float("nan")), "step must be at least 0.5, got nan"),
    ],
)
def test_a_smaller_value_is_refused_by_the_name_of_its_field(settings, message):
    with pytest.raises(ValueError, match=f"^{message}$"):
        check_least(settings, pairs=1, limit=1, step=0.5)
