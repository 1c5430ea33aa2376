"""The colours of drives, the same on maps, pages and in the viewer."""

OUTCOME_COLOURS = {
    "goal": "#2a9d5c", "collision": "#d1495b", "tilt": "#8e44ad", "stuck": "#e08e45", "time": "#5c6b7a",
    "out_of_bounds": "#b08968", "no_path": "#264653", "elsewhere": "#3a86c8",
}  # fmt: skip
OTHER_COLOUR = "#333333"  # of outcomes that this version does not have
ROCK_COLOUR, WAY_COLOUR = "#9a938c", "#f4d58d"  # of rocks that block, and of the shortest passable path
