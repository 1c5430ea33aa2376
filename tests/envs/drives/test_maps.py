from dataclasses import replace

import pytest

from envs.drives.colours import OUTCOME_COLOURS
from envs.drives.episodes import EpisodeRecord
from envs.drives.maps import END_MARKS, plot_maps

DRIVE = EpisodeRecord(
    driver="navigator", perception="sgbm", cell="k=0.1, slope=5", episode=0, outcome="goal", steps=3, distance=0.5,
    start_distance=3.0, shortest=3.0, path_length=3.5, min_clearance=1.0, max_tilt_deg=4.0, reward=12.0,
    step_seconds=0.1, perception_seconds=0.0, redraws=0, goal=[0.0, 3.0], obstacles=[[1.0, 1.0, 0.8]],
    track=[[0.0, 0.0], [0.5, 1.5], [0.0, 2.5]],
)  # fmt: skip


@pytest.mark.parametrize(
    "name",
    ["k0.1-slope0-0.png", "conditionstorm-0.png", "conditionmy.storm-v2-11.png", "conditionstorm-k0.1-slope0-1.png"],
)
def test_pages_of_earlier_records_are_deleted_and_other_files_stay(tmp_path, name):
    for file in (name, "notes.png", f"my-{name}"):
        (tmp_path / file).touch()
    plot_maps(tmp_path, [DRIVE])
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(["k0.1-slope5-0.png", "notes.png", f"my-{name}"])


@pytest.mark.parametrize("methods", [1, 3, 6])
def test_the_legend_fits_into_its_page_and_names_every_method(tmp_path, drawn_figures, methods):
    names = [f"m3depth:runs/{'a_long_name_' * 6}/{n}/weights_of_the_training.safetensors" for n in range(methods)]
    plot_maps(tmp_path, [replace(DRIVE, perception=name) for name in names])
    (figure,) = drawn_figures
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert box.x0 >= 0 and box.x1 <= figure.bbox.x1
    lines = [line for line, text in zip(legend.get_lines(), legend.get_texts()) if "safetensors" in text.get_text()]
    assert len(lines) == len({(line.get_linestyle(), line._unscaled_dash_pattern) for line in lines}) == methods


def test_the_mark_at_the_end_tells_the_outcome_without_its_colour(tmp_path, drawn_figures):
    assert END_MARKS.keys() == OUTCOME_COLOURS.keys() and len({mark for mark, _ in END_MARKS.values()}) == 8
    outcomes = [*OUTCOME_COLOURS, "of a later version"]
    plot_maps(tmp_path, [replace(DRIVE, perception=outcome, outcome=outcome) for outcome in outcomes])
    (figure,) = drawn_figures
    legend = {line.get_label(): line.get_marker() for line in figure.legends[0].get_lines()}
    drawn = [line.get_marker() for line in figure.axes[0].get_lines() if len(line.get_xdata()) == 1]
    assert drawn[:9] == [legend[f"outcome: {outcome}"] for outcome in outcomes] and len({*drawn[:9]}) == 9
