"""The risk that the navigator takes, and for how long; each step is one call of update."""

from dataclasses import replace

import pytest

from nav.config import NavigatorConfig, RiskLevel
from nav.risk import RiskTaking

LEVELS = (RiskLevel(0.24, 26.0, 0.5), RiskLevel(0.27, 28.0, 0.3))
CONFIG = NavigatorConfig(risk_levels=LEVELS, risk_after=3, risk_steps=8, closed_steps=6)
PLAIN = CONFIG.traversability


def after(*steps, risk=None):
    """The RiskTaking after steps, each (closed, hemmed_in)."""
    risk = risk or RiskTaking(CONFIG)
    for closed, hemmed_in in steps:
        risk.update(closed, hemmed_in)
    return risk


CLOSED, OPEN, HEMMED = (True, False), (False, False), (False, True)


def test_no_risk_is_taken_before_every_way_has_been_closed_for_long_enough():
    for steps in ([CLOSED] * 2, [CLOSED, CLOSED, OPEN, CLOSED, CLOSED]):  # not in a row
        risk = after(*steps)
        assert risk.rules is PLAIN and risk.margin_share == 1.0 and not risk.given_up


def test_each_risk_level_allows_more_and_comes_nearer():
    risk = RiskTaking(CONFIG)
    for level in LEVELS:
        after(*[CLOSED] * 3, risk=risk)
        assert risk.rules == replace(
            PLAIN, step_blocked=level.step, slope_blocked_deg=level.slope_deg, margin=PLAIN.margin * level.margin_share
        )
        assert risk.margin_share == level.margin_share and not risk.given_up


def test_the_drive_is_given_up_after_the_last_risk_level_and_not_before():
    risk = RiskTaking(CONFIG)
    given_up = [after(CLOSED, risk=risk).given_up for _ in range(12)]
    assert given_up == [False] * 11 + [True]  # three steps for each level, and then closed_steps in a row


def test_a_rover_that_comes_nearer_at_the_last_level_does_not_give_up():
    risk = after(*[CLOSED] * 11)
    risk.came_nearer()
    given_up = [after(CLOSED, risk=risk).given_up for _ in range(12)]
    assert given_up == [False] * 11 + [True]  # three steps until the level ends and is taken again, three to the last
    waiting = after(CLOSED, CLOSED)
    waiting.came_nearer()  # at the levels before, it does not put off the next one
    assert after(CLOSED, risk=waiting).level == 1


def test_a_risk_too_short_to_give_up_in_is_refused():
    with pytest.raises(ValueError, match="risk_steps must be more than closed_steps, got 6 and 6"):
        replace(CONFIG, risk_steps=6)
    assert replace(CONFIG, risk_steps=6, risk_levels=()).risk_levels == ()


def test_a_risk_lasts_its_steps_and_longer_only_beside_an_obstacle():
    entered = [CLOSED] * 3
    assert after(*entered, *[OPEN] * 7).margin_share == 0.5
    assert after(*entered, *[OPEN] * 8).margin_share == 1.0
    hemmed = after(*entered, *[HEMMED] * 12)
    assert hemmed.margin_share == 0.5
    hemmed.update(*OPEN)
    assert hemmed.margin_share == 1.0 and hemmed.rules is PLAIN


def test_dead_ends_raise_the_risk_too_and_a_new_goal_resets_it():
    risk = RiskTaking(CONFIG)
    for _ in range(5):  # there is no more than the last
        risk.raise_level()
    assert risk.margin_share == 0.3
    risk.reset()
    assert risk.rules is PLAIN and risk.closed == 0


@pytest.mark.parametrize("level", NavigatorConfig().risk_levels)
def test_a_risk_level_never_forbids_what_was_allowed(level):
    wider_rules = replace(PLAIN, step_blocked=0.29, slope_blocked_deg=29.0)
    risk = RiskTaking(replace(CONFIG, traversability=wider_rules, risk_levels=(level,)))
    risk.raise_level()
    assert (risk.rules.step_blocked, risk.rules.slope_blocked_deg) == (0.29, 29.0)
    assert level.step < 0.30 and 0 < level.margin_share < 1  # below RoverSpec.obstacle_height
