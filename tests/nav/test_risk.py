"""What is dared, and for how long, as the configuration says; each step is one call of update."""

from dataclasses import replace

import pytest

from nav.config import Boldness, NavigatorConfig
from nav.risk import Daring

LEVELS = (Boldness(0.24, 26.0, 0.5), Boldness(0.27, 28.0, 0.3))
CONFIG = NavigatorConfig(bold=LEVELS, bold_after=3, bold_steps=8, closed_steps=6)
PLAIN = CONFIG.traversability


def after(*steps, daring=None):
    """A Daring after steps, each (closed, hemmed_in)."""
    daring = daring or Daring(CONFIG)
    for closed, hemmed_in in steps:
        daring.update(closed, hemmed_in)
    return daring


CLOSED, OPEN, HEMMED = (True, False), (False, False), (False, True)


def test_nothing_is_dared_before_every_way_has_been_closed_for_long_enough():
    for steps in ([CLOSED] * 2, [CLOSED, CLOSED, OPEN, CLOSED, CLOSED]):  # not in a row
        daring = after(*steps)
        assert daring.rules is PLAIN and daring.margin_share == 1.0 and not daring.given_up


def test_each_step_of_daring_allows_more_and_comes_nearer():
    daring = Daring(CONFIG)
    for bold in LEVELS:
        after(*[CLOSED] * 3, daring=daring)
        assert daring.rules == replace(
            PLAIN, step_blocked=bold.step, slope_blocked_deg=bold.slope_deg, margin=PLAIN.margin * bold.margin_share
        )
        assert daring.margin_share == bold.margin_share and not daring.given_up


def test_it_gives_up_after_the_last_of_them_and_not_before():
    daring = Daring(CONFIG)
    given_up = [after(CLOSED, daring=daring).given_up for _ in range(12)]
    assert given_up == [False] * 11 + [True]  # three steps for each level, and then closed_steps in a row


def test_a_daring_too_short_to_give_up_in_is_refused():
    with pytest.raises(ValueError, match="bold_steps must be more than closed_steps, got 6 and 6"):
        replace(CONFIG, bold_steps=6)
    assert replace(CONFIG, bold_steps=6, bold=()).bold == ()


def test_daring_lasts_its_steps_and_longer_only_beside_an_obstacle():
    entered = [CLOSED] * 3
    assert after(*entered, *[OPEN] * 7).margin_share == 0.5
    assert after(*entered, *[OPEN] * 8).margin_share == 1.0
    hemmed = after(*entered, *[HEMMED] * 12)
    assert hemmed.margin_share == 0.5
    hemmed.update(*OPEN)
    assert hemmed.margin_share == 1.0 and hemmed.rules is PLAIN


def test_dead_ends_make_it_dare_too_and_a_new_goal_forgets():
    daring = Daring(CONFIG)
    for _ in range(5):  # there is no more than the last
        daring.more()
    assert daring.margin_share == 0.3
    daring.forget()
    assert daring.rules is PLAIN and daring.closed == 0


@pytest.mark.parametrize("bold", NavigatorConfig().bold)
def test_what_is_dared_never_forbids_what_was_allowed(bold):
    own = replace(PLAIN, step_blocked=0.29, slope_blocked_deg=29.0)
    daring = Daring(replace(CONFIG, traversability=own, bold=(bold,)))
    daring.more()
    assert (daring.rules.step_blocked, daring.rules.slope_blocked_deg) == (0.29, 29.0)
    assert bold.step < 0.30 and 0 < bold.margin_share < 1  # below RoverSpec.obstacle_height
