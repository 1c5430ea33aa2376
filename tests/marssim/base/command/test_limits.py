import re
from dataclasses import dataclass

import pytest

from marssim.base.command.limits import check_least, check_number, check_range


@dataclass(frozen=True)
class Settings:
    pairs: int = 1
    limit: int | None = None
    step: float = 0.5


@pytest.mark.parametrize("value", ["1", True, [0.5], None])
def test_what_is_no_number_is_refused(value):
    """None passes only where the field may be None."""
    for check in (
        lambda: check_least(Settings(step=value), step=0),
        lambda: check_range(Settings(step=value), step=(0, 1)),
    ):
        with pytest.raises(ValueError, match=rf"^step must be a number, got {re.escape(repr(value))}$"):
            check()


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


@pytest.mark.parametrize(
    ("step", "passes"), [(0.5, True), (2.0, True), (0.25, False), (2.5, False), (float("nan"), False)]
)
def test_a_value_out_of_its_range_is_refused(step, passes):
    if passes:
        check_range(Settings(step=step), step=(0.5, 2.0), limit=(1, 9))
    else:
        with pytest.raises(ValueError, match=rf"^step must lie in \[0.5, 2\], got {step:g}$"):
            check_range(Settings(step=step), step=(0.5, 2.0))


@pytest.mark.parametrize("value", [0, -3, 1e12, -1e12, (1 << 63) - 1, 5e-324])
def test_numbers_that_can_be_meant_pass(value):
    check_number("--step", value)


@pytest.mark.parametrize("value", [float("inf"), float("-inf"), float("nan"), 1e13, -1e300, 10**400])
def test_numbers_that_cannot_be_meant_are_refused(value):
    with pytest.raises(
        ValueError, match=r"^--step must (be a finite number|lie within \+-1(e\+12|\.84e\+19)), got \S{1,40}$"
    ):
        check_number("--step", value)


def test_infinity_may_stand_for_no_limit():
    check_number("--far", float("inf"), may_be_infinite=True)
    with pytest.raises(ValueError, match="--far must be a finite number, got nan"):
        check_number("--far", float("nan"), may_be_infinite=True)
