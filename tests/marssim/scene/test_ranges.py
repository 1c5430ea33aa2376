from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.render.sensor import SensorConfig
from marssim.scene.look import LookConfig
from marssim.scene.ranges import Range, check_ranges
from marssim.scene.viewpoint import ViewConfig

LIMITS = {"first": (0.0, 1.0), "second": (-5.0, 5.0)}


@dataclass(frozen=True)
class Two:
    first: Range
    second: Range


@given(st.tuples(*[st.floats(-2, 2)] * 2), st.tuples(*[st.floats()] * 2))
def test_a_range_ascends_within_its_limits(first, second):
    wrong = [
        name
        for name, (low, high) in (("first", first), ("second", second))
        if sorted([LIMITS[name][0], low, high, LIMITS[name][1]]) != [LIMITS[name][0], low, high, LIMITS[name][1]]
        or not low <= high
    ]
    if not wrong:
        check_ranges(Two(first, second), LIMITS)
    else:
        with pytest.raises(ValueError, match=f"^{wrong[0]} must be (a range LOW HIGH )?within"):
            check_ranges(Two(first, second), LIMITS)


@pytest.mark.parametrize(
    ("config", "name"),
    [(SensorConfig, "exposure"), (ViewConfig, "pitch_deg"), (LookConfig, "optical_depth"), (LookConfig, "bedding")],
)
def test_every_config_of_ranges_is_checked(config, name):
    with pytest.raises(ValueError, match=rf"^{name} must be a range LOW HIGH within .*, got 0\.5 0\.4"):
        config(**{name: (0.5, 0.4)})


def test_a_fixed_value_is_named_as_a_number():
    with pytest.raises(ValueError, match=r"^optical_depth must be within 0 and 12, got 99$"):
        LookConfig(optical_depth=(99, 99))


@pytest.mark.parametrize("value", [20, 0.5, (1.0,), (1.0, 2.0, 3.0)])
def test_a_value_that_is_no_range_is_named(value):
    with pytest.raises(ValueError, match=r"^first must be a range LOW HIGH, two equal numbers for a fixed value, got"):
        check_ranges(Two(value, (0.0, 0.0)), LIMITS)
