"""Text and stripes of the pages of drives have the contrast that WCAG asks for, in light and in dark mode."""

import re

import pytest
from recorded_drives import drive_of, step

from envs.drives.colours import OUTCOME_COLOURS
from envs.recording.drive_page import asset, drive_page
from envs.recording.page_colours import (
    COLOURS,
    PAPERS,
    STATUS_COLOURS,
    STRIPE_CONTRAST,
    colour_rules,
    contrast,
    outcome_style,
    shown_on,
    text_on,
)

TEXT_CONTRAST = 4.5  # WCAG 1.4.3, text below 18 pt
MODES = ("light", "dark")


def variables(style):
    """The variables of a style by mode; what the dark mode does not set is that of the light one."""
    light, dark = (
        dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", root)) for root in re.findall(r":root {(.*?)}", style, re.S)
    )
    return {"light": light, "dark": {**light, **dark}}


def mixed(colour, ground, share):
    """The colour of color-mix in sRGB over a ground."""
    channels = zip(*(bytes.fromhex(c[1:]) for c in (colour, ground)))
    return "#" + "".join(f"{round(share * a + (1 - share) * b):02x}" for a, b in channels)


def test_contrast_is_that_of_wcag():
    assert contrast("#ffffff", "#000000") == contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#ffffff", "#777777") == pytest.approx(4.48, abs=0.005)
    assert contrast("#ffffff", "#e08e45") == pytest.approx(2.58, abs=0.005)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", COLOURS)
def test_every_outcome_and_status_can_be_read_and_its_stripe_be_seen(name, mode):
    shown = variables(colour_rules())[mode]
    colour, paper = shown[f"is-{name}"], PAPERS[mode]
    assert contrast(shown[f"on-{name}"], colour) >= TEXT_CONTRAST and contrast(colour, paper) >= STRIPE_CONTRAST
    if contrast(COLOURS[name], paper) >= STRIPE_CONTRAST:
        assert colour == COLOURS[name]  # as on the maps


@pytest.mark.parametrize("mode", MODES)
def test_text_of_the_page_can_be_read_on_paper_cards_and_rows(mode):
    style = variables(asset("page.css"))[mode]
    for name in ("ink", "soft", "accent", "warn", "clear", "error"):
        assert min(contrast(style[name], style[ground]) for ground in ("paper", "card")) >= TEXT_CONTRAST, name
    assert contrast(style["on-accent"], style["accent"]) >= TEXT_CONTRAST  # the flag "decided"
    rows = [mixed(style[name], style["card"], 0.14) for name in ("accent", "clear")]
    assert min(contrast(style[name], row) for name in ("ink", "warn") for row in rows) >= TEXT_CONTRAST
    assert style["paper"] == PAPERS[mode]


def test_one_of_black_and_white_can_be_read_on_any_colour():
    for grey in range(256):
        colour = f"#{grey:02x}{grey:02x}{grey:02x}"
        assert contrast(text_on(colour), colour) >= TEXT_CONTRAST
        assert contrast(shown_on(PAPERS["dark"], colour), PAPERS["dark"]) >= STRIPE_CONTRAST


@pytest.mark.parametrize("mode", MODES)
def test_outcomes_have_different_colours(mode):
    shown = variables(colour_rules())[mode]
    assert len({shown[f"is-{name}"] for name in OUTCOME_COLOURS}) == len(OUTCOME_COLOURS)
    assert not set(STATUS_COLOURS) & set(OUTCOME_COLOURS)


def test_a_page_has_the_colours_and_an_unknown_outcome_one_too(tmp_path):
    page = drive_page([drive_of(tmp_path / "a.zip", [step(), step(x=9.0)])]).decode()
    assert colour_rules() in page and "color: #fff" not in page
    assert outcome_style("goal") == "background:var(--is-goal);color:var(--on-goal)"
    assert outcome_style('";x') == "background:var(--is-other);color:var(--on-other)"
