import json

import numpy as np
import pytest

from envs.courses.course import CourseConfig
from envs.suites.draws import EpisodeDraws, stream_of_draws
from envs.world.eyes import EyesConfig
from envs.world.slip import SlipConfig
from marssim.scene.presets import preset


def draws(slip=None, condition=None, **numbers):
    return EpisodeDraws(preset("utopia"), EyesConfig(), numbers, slip, condition)


def test_numbers_come_from_their_ranges_and_all_choices_come_up():
    source = draws(
        (None, "sand", SlipConfig("crust", 0.5)), ("clear", "storm", {"look_every": 2.0}),
        k=(0.03, 0.2), slope_deg=(0, 10), goal_distance=9.0, sun_elevation_deg=(20, 30),
    )  # fmt: skip
    rng = stream_of_draws(1)
    drawn = [source.draw(rng) for _ in range(60)]
    values = [each.info()["drawn"] for each in drawn]
    for name, low, high in (("k", 0.03, 0.2), ("slope_deg", 0, 10), ("sun_elevation_deg", 20, 30)):
        numbers = np.array([each[name] for each in values])
        assert low <= numbers.min() < low + 0.2 * (high - low) and high - 0.2 * (high - low) < numbers.max() <= high
    assert {each["slip"] for each in values} == {None, "sand", "crust"}
    assert {each.slip for each in drawn} == {None, SlipConfig("sand"), SlipConfig("crust", 0.5)}
    assert [v["condition"] for v in values].count('{"look_every": 2.0}') > 5
    for each in drawn:
        assert each.course.goal_distance == 9.0 and each.info()["drawn"]["k"] == each.course.k
        assert (each.scene.look.optical_depth == (3.0, 3.0)) == (each.condition == "storm")
        assert each.eyes.look_every == (0 if isinstance(each.condition, str) else 2.0)


def test_the_strength_of_a_condition_comes_from_its_range():
    source = draws(condition={"optical_depth": (1, 3), "lens_dust": [0.1, 0.4], "look_every": 2.0})
    rng = stream_of_draws(2)
    drawn = [source.draw(rng) for _ in range(40)]
    depths = np.array([each.scene.look.optical_depth for each in drawn])
    dust = np.array([each.eyes.lens_dust for each in drawn])
    assert (depths[:, 0] == depths[:, 1]).all() and 1 <= depths.min() < 1.4 and 2.6 < depths.max() <= 3
    assert 0.1 <= dust.min() < 0.16 and 0.34 < dust.max() <= 0.4
    for each in drawn:
        values = json.loads(each.info()["drawn"]["condition"])
        assert values == {
            "optical_depth": each.scene.look.optical_depth[0], "lens_dust": each.eyes.lens_dust, "look_every": 2.0,
        }  # fmt: skip


def test_a_range_of_one_value_is_that_value():
    source = draws(condition={"optical_depth": (2, 2)}, k=(0.1, 0.1))
    settings = source.draw(stream_of_draws(0))
    assert settings.scene.look.optical_depth == (2.0, 2.0) and settings.course.k == 0.1


def test_draws_follow_from_the_seed():
    source = draws(k=(0.0, 0.2))
    first, again, other = ([source.draw(rng).course.k for _ in range(3)] for rng in map(stream_of_draws, (4, 4, 5)))
    assert first == again != other and len(set(first)) == 3
    numbers = [stream_of_draws(seed).random() for seed in (-1, 0, 1, 2**32 + 1)]
    assert numbers[0] == numbers[1] and len(set(numbers[1:])) == 3


def test_nothing_is_drawn_of_fixed_values():
    rng = stream_of_draws(0)
    settings = draws("sand", "storm", k=0.1, goal_distance=7.0).draw(rng)
    assert settings.info() == {} and settings.slip == SlipConfig("sand")
    assert settings.course == CourseConfig(7.0, k=0.1) and settings.scene.look.optical_depth == (3.0, 3.0)
    assert rng.random() == stream_of_draws(0).random()


def test_numbers_of_the_info_are_floats_and_tell_what_the_odometry_measures():
    """gymnasium gives the values of all environments of a vector the type of the first."""
    source = draws(
        (SlipConfig("sand"), SlipConfig("sand", 1), None), ({"goal_distance": 5}, "clear"), goal_distance=(4, 8)
    )
    rng = stream_of_draws(0)
    values = [source.draw(rng).info()["drawn"] for _ in range(40)]
    assert {type(each["goal_distance"]) for each in values} == {float}
    assert {(each["slip"], each["slip_measured"]) for each in values} == {("sand", 0.0), ("sand", 1.0), (None, None)}
    assert "slip_measured" not in draws((None, "sand", "crust")).draw(rng).info()["drawn"]


def test_a_condition_and_then_options_replace_what_was_drawn():
    source = draws(condition=({"sun_elevation_deg": 8.0, "k": 0.01},), k=(0.1, 0.2), sun_elevation_deg=(40, 50))
    settings = source.draw(stream_of_draws(0))
    assert settings.course.k == 0.01 and settings.course.sun_elevation_deg is None
    assert settings.scene.look.sun_elevation_deg == (8.0, 8.0)
    assert settings.info()["drawn"] == {
        "k": 0.01, "sun_elevation_deg": 8.0, "condition": '{"k": 0.01, "sun_elevation_deg": 8.0}'
    }  # fmt: skip
    with_option = settings.with_options({"k": 0.3, "sun_elevation_deg": 60})
    of_the_scene = draws(k=(0.1, 0.2), sun_elevation_deg=(40, 50)).draw(stream_of_draws(0))
    of_the_scene = of_the_scene.with_options({"k": None, "sun_elevation_deg": None})
    assert of_the_scene.info()["drawn"] == {"k": None, "sun_elevation_deg": None}
    assert with_option.info()["drawn"]["k"] == 0.3 and with_option.info()["drawn"]["sun_elevation_deg"] == 60


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"k": (0.2, 0.1)}, r"^k must have the lower end of its range first, got \(0.2, 0.1\)$"),
        ({"k": (0.1,)}, r"^k must be a number or the two ends of a range, got \(0.1,\)$"),
        ({"slope_deg": [0, 5, 9]}, "^slope_deg must be a number or the two ends"),
        ({"k": (None, 0.1)}, "^k must be a number or the two ends"),
        ({"k": (0.1, 0.5)}, r"^k must lie in \[0, 0.4\], got 0.5$"), ({"k": ("few", "many")}, "^k must lie in .*'few'"),
        ({"goal_distance": (3, float("nan"))}, "^goal_distance must lie in"),
        ({"sun_elevation_deg": (0, 30)}, "^sun_elevation_deg must lie in .*got 0$"),
        ({"slip": ()}, r"^slip must have one choice or more, got \(\)$"),
        ({"slip": ("mud",)}, "^slip 'mud' is unknown"),
        ({"condition": []}, "^condition must have one choice"),
        ({"condition": ("clear", "strom")}, "^condition 'strom'"),
        ({"condition": (None,)}, "^condition must be a name or a dict of values, got None"),
        (
            {"condition": ("clear", "ditch"), "goal_distance": (5, 20)},
            "^ditch needs a `goal_distance` of 12 m or more, got 5$",
        ),
        ({"condition": {"optical_depth": (3, 1)}}, r"^optical_depth must have the lower end .*got \(3, 1\)$"),
        ({"condition": {"optical_depth": (1, 20)}}, "^optical_depth must be within 0 and 12, got 20"),
        ({"condition": {"optical_depth": ("a", 2)}}, "^optical_depth must be a number, got 'a'"),
        ({"condition": {"lens_dust": (0.1,)}}, r"^lens_dust must be a number or the two ends of a range"),
        ({"condition": {"image_pixels": (128, 256)}}, r"^image_pixels must be one value in a condition, not a range"),
        ({"condition": {"goal_distance": (2, 9)}}, r"^goal_distance must lie in .*got 2"),
        (
            {"k": (0.1, 0.2), "goal_distance": (8, 80)},
            "^`k` 0.2 with a `goal_distance` of 80 m: the scene may have .* rocks, and can hold 50000; choose",
        ),
        ({"condition": ("clear", {"k": 0.4}), "goal_distance": 40}, "^`k` 0.4 with a `goal_distance` of 40 m"),
        ({"condition": {"k": (0.4, 0.05), "goal_distance": 40}}, "^k must have the lower end of its range first"),
        ({"condition": ("clear", {"k": 2})}, r"^k must lie in \[0, 0.4\], got 2$"),
    ],
)  # fmt: skip
def test_what_cannot_be_drawn_is_named(settings, message):
    with pytest.raises(ValueError, match=message) as error:
        draws(**settings)
    assert "\n" not in str(error.value)
