"""The colours of what the rover does and of how drives ended, on the light and the dark paper of the pages of drives.

Contrast is that of WCAG 2.2: (lighter + 0.05) / (darker + 0.05), of relative luminances.
"""

from __future__ import annotations

from colorsys import hls_to_rgb, rgb_to_hls
from functools import cache

from envs.drives.colours import OUTCOME_COLOURS

PAPERS = {"light": "#f6f2ec", "dark": "#1d1a18"}  # --paper of page.css
STRIPE_CONTRAST = 3.0  # least contrast of a stripe of the time line with the paper (WCAG 1.4.11)
WHITE, BLACK = "#ffffff", "#000000"
OTHER = "other"  # name of what has no colour of its own
STATUS_COLOURS = {
    "drive": "#6a9a62", "backwards": "#a8628f", "turn": "#5a86b8", "look": "#b9a05a", "recover": "#a85a2a",
    "blind": "#555555", "stand": "#8d8578", "arrived": "#2a9d5c", OTHER: "#777777",
}  # fmt: skip
COLOURS = {**OUTCOME_COLOURS, **STATUS_COLOURS}  # the navigator gives up as drives end: stuck, no_path


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours, #rrggbb: 1 to 21."""
    darker, lighter = sorted((_luminance(one), _luminance(other)))
    return (lighter + 0.05) / (darker + 0.05)


def text_on(colour: str) -> str:
    """Return white or black, whichever can be read better on a colour; one of them has a contrast of 4.5 or more."""
    return max(WHITE, BLACK, key=lambda ink: contrast(ink, colour))


def shown_on(paper: str, colour: str) -> str:
    """Return a colour, darker or lighter of the same hue as far as it needs to stand out from the paper."""
    end = 1.0 if text_on(paper) == WHITE else 0.0
    hue, lightness, saturation = rgb_to_hls(*_channels(colour))
    towards = (lightness + percent / 100 * (end - lightness) for percent in range(101))
    shades = (_colour_of(hls_to_rgb(hue, light, saturation)) for light in towards)
    return next(shade for shade in shades if contrast(shade, paper) >= STRIPE_CONTRAST)


@cache
def colour_rules() -> str:
    """Return the style rules with the colours in both modes: --is-NAME, and of text on it --on-NAME."""

    def root(paper: str) -> str:
        shades = {name: shown_on(paper, colour) for name, colour in COLOURS.items()}
        return ":root { " + " ".join(f"--is-{n}: {c}; --on-{n}: {text_on(c)};" for n, c in shades.items()) + " }"

    return f"{root(PAPERS['light'])}\n@media (prefers-color-scheme: dark) {{ {root(PAPERS['dark'])} }}"


def outcome_style(outcome: str) -> str:
    """Return the style of a badge with an outcome, which may be unknown."""
    name = outcome if outcome in OUTCOME_COLOURS else OTHER
    return f"background:var(--is-{name});color:var(--on-{name})"


def _channels(colour: str) -> tuple[float, float, float]:
    """Return red, green and blue of #rrggbb, 0 to 1 each."""
    red, green, blue = (int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return red, green, blue


def _colour_of(channels: tuple[float, float, float]) -> str:
    """Return red, green and blue, 0 to 1 each, as #rrggbb."""
    return "#" + "".join(f"{round(255 * value):02x}" for value in channels)


def _luminance(colour: str) -> float:
    """Return the relative luminance of a colour, 0 to 1."""
    red, green, blue = (s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4 for s in _channels(colour))
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue
