from dataclasses import replace

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from envs.drivers.driver import Stop
from envs.drives.colours import OUTCOME_COLOURS, WAY_COLOUR
from envs.drives.episodes import Cell, EpisodeRecord
from envs.drives.maps import plot_maps
from envs.drives.metrics import FAILURES, effective_drives, summarise
from envs.drives.plots import plot_success, pool_by
from envs.drives.report import (
    FEW_COURSES,
    NO_INTERVAL,
    bounds,
    differences,
    errors_beside,
    failures,
    ground_as_sky,
    looks_without_depth,
    soil,
    states_of_the_code,
    table,
    write_report,
)
from marssim.base.rover_spec import ZHURONG

DRIVE = EpisodeRecord(
    driver="navigator", perception="sgbm", cell="k=0.1, slope=5", episode=0, outcome="goal", steps=3, distance=0.5,
    start_distance=3.0, shortest=3.0, path_length=3.5, min_clearance=1.0, max_tilt_deg=4.0, reward=12.0,
    step_seconds=0.1, perception_seconds=0.0, redraws=0, goal=[0.0, 3.0], abs_rel=0.0123,
    obstacles=[[1.0, 1.0, 0.8]], track=[[0.0, 0.0], [0.5, 1.5], [0.0, 2.5]],
)  # fmt: skip
ROW = {
    "driver": "navigator", "perception": "sgbm", "cell": {"k": 0.07, "slope_deg": None}, "episodes": 20,
    "success_rate": 0.85, "success_interval": [0.6396, 0.9476], "spl": 0.754, "soft_spl": 0.812,
    "path_inefficiency": 1.08, "collision_rate": 0.1, "near_miss_rate": 0.05,
    "failures": {"no feasible path": 1, "safety limit": 2, "time": 0, "elsewhere": 3}, "max_tilt_deg": 17.4,
    "abs_rel": 0.0123, "unreachable_share": 0.09, "step_seconds": 0.356,
}  # fmt: skip


DRIVE_OF_ROW = replace(DRIVE, cell="k=0.07, slope=preset")


def test_a_row_of_the_table():
    head, rule, row = table([ROW]).splitlines()[:3]
    assert head.count("|") == rule.count("|") == row.count("|")
    assert row == (
        "| navigator | sgbm | 0.07 | preset | 20 | 85 % (64-95) | 0.75 | 0.81 | 1.08 | 10 % | 5 % | 1, 2, 0, 3 "
        "| 17 deg | 0.0123 | 9 % | 0.36 |"
    )


def test_every_figure_of_the_table_is_explained_below_it():
    head, *_, legend = table([ROW]).partition("\n\n")
    columns = [name.strip() for name in head.splitlines()[0].split("|")[6:-1]]
    for name in ", ".join(columns).replace(" (95 %)", "").split(", "):
        assert name.casefold() in " ".join(legend.split()).casefold(), name
    assert legend.startswith("Success: the rover came within 1 m of the goal;")


def test_near_ground_that_was_taken_for_sky_is_in_the_page():
    assert ground_as_sky([DRIVE, replace(DRIVE, near_ground=0, near_ground_as_sky=0)]) == ""
    drives = [replace(DRIVE, near_ground=3000, near_ground_as_sky=n) for n in (0, 3)]
    assert ground_as_sky([DRIVE, *drives]) == "\nsgbm took 0.05 % of the ground within 8 m for sky.\n"
    assert ground_as_sky(drives[:1]) == "\nsgbm took 0 % of the ground within 8 m for sky.\n"


def test_a_cell_with_many_unreachable_goals_is_marked():
    page = table([ROW, {**ROW, "unreachable_share": 0.3, "abs_rel": None, "path_inefficiency": None}])
    plain, marked = page.splitlines()[2:4]
    assert " preset * |" in marked and "*" not in plain and "20 %" in page.splitlines()[-1]
    assert "| - | 30 % |" in marked


def test_drives_of_other_code_are_reported():
    same, other = replace(DRIVE, code="aa11"), replace(DRIVE, code="bb22")
    assert states_of_the_code([same, same]) == states_of_the_code([DRIVE]) == ""
    message = states_of_the_code([same, other, same, DRIVE])
    assert "2 by aa11, 1 by bb22, 1 by an unknown one" in message


def test_failures_are_listed_by_outcome_and_cause():
    assert failures([DRIVE]) == ""
    stopped = replace(DRIVE, outcome="no_path", cause="false obstacles")
    rows = failures([DRIVE, stopped, replace(DRIVE, outcome="time"), stopped]).split("\n")
    assert rows[1:5] == [
        "| method | outcome | cause | failures |", "|---|---|---|---|",
        "| navigator, sgbm | no path | false obstacles | 2 |", "| navigator, sgbm | time | unknown | 1 |",
    ]  # fmt: skip
    hint = "To learn the unknown causes, drive with `--record failures`, which repeats only those."
    assert rows[5:] == ["", hint, ""]
    for unrecorded in (stopped, replace(DRIVE, outcome="time", driver="straight")):
        assert "--record" not in failures([DRIVE, unrecorded])


def test_slip_and_energy_are_reported_where_wheels_slip():
    drives = [replace(DRIVE, slip=slip, energy=energy) for slip, energy in ((0.1, 900.0), (0.3, 1500.0), (None, 0.0))]
    row = {"driver": "a|b", "perception": "sgbm", "cell": Cell(k=0.1).content(), **summarise(drives)}
    assert (row["slip"], row["energy"]) == pytest.approx((0.2, 800.0))
    assert soil([row]) == "a\\|b, sgbm, k=0.1, slope=preset: slip of 20.0 %, 0.80 kJ of the wheels' motors a drive\n"
    assert soil([{**row, **summarise([DRIVE])}]) == ""


def test_looks_without_any_depth_are_reported():
    seeing, blind = replace(DRIVE, perception="sgbm"), replace(DRIVE, perception="mine:Net", blind=3)
    assert looks_without_depth([seeing, replace(seeing, blind=0)]) == ""
    assert looks_without_depth([seeing, blind, replace(blind, blind=0), replace(blind, blind=None)]) == (
        "\nmine:Net gave no depth at all in 3 of its 8 looks (38 %).\n"
    )
    assert "3 of its 1001 looks (under 1 %)" in looks_without_depth([replace(blind, steps=1000)])


DIFFERENCE = {
    "driver": "straight", "perception": "p", "less": ["navigator", "p"], "episodes": 40, "courses": 20,
    "difference": -0.35, "interval": [-0.5, -0.2], "spl_difference": -0.281, "spl_interval": [-0.4, -0.1],
}  # fmt: skip


def test_differences_are_reported_in_points_and_in_spl():
    assert differences([DIFFERENCE]) == (
        "straight, p less navigator, p, paired, 40 episodes: -35 points of success (-50 to -20), "
        "SPL -0.28 (-0.40 to -0.10)\n"
    )


def test_an_interval_without_width_is_not_shown_as_certainty():
    for ends in ([-0.281, -0.281], [-0.281, -0.281 + 3e-17]):  # sums in another order
        (line,) = differences([{**DIFFERENCE, "spl_interval": ends}]).splitlines()
        assert line.endswith(f" points of success (-50 to -20), SPL -0.28 ({NO_INTERVAL})")
    (line,) = differences([{**DIFFERENCE, "courses": 3, "spl_interval": None}]).splitlines()
    assert line.endswith(f", SPL -0.28 ({FEW_COURSES})")


def test_names_do_not_break_out_of_a_cell():
    row = {**ROW, "driver": "a|b", "perception": "<i>"}
    assert "| a\\|b | \\<i> | 0.07 |" in table([row])
    assert differences([{**DIFFERENCE, "perception": "<i>"}]).startswith("straight, \\<i> less navigator, p, paired")
    assert "\\<i> gave no depth" in looks_without_depth([replace(DRIVE, perception="<i>", blind=3)])
    assert errors_beside({"<i>": 0.1}, [replace(DRIVE, perception="<i>")]).startswith("\\<i>: Abs Rel")


def test_an_interval_is_shown_in_the_units_of_its_value():
    assert bounds([-0.5, 0.25], 100, "+.0f") == " (-50 to +25)" and bounds((0.5, 0.5), 1, ".2f") == ""


def outcome_colour(name):
    """Blue, green, red."""
    return [int(OUTCOME_COLOURS[name][i : i + 2], 16) for i in (5, 3, 1)]


def coloured(path, name="goal"):
    """Pixels of the colour that means an outcome."""
    return (np.abs(cv2.imread(str(path)).astype(int) - outcome_colour(name)).max(axis=2) < 40).sum()


def test_every_drive_is_drawn_in_the_colour_of_its_end(tmp_path):
    other = replace(DRIVE, driver="straight", outcome="tilt", track=[[0.0, 0.0], [-0.5, 1.5], [-2.0, 2.5]])
    plot_maps(tmp_path, [DRIVE, other, replace(DRIVE, cell="k=0.2, slope=0")])
    assert sorted(file.name for file in tmp_path.iterdir()) == ["k0.1-slope5-0.png", "k0.2-slope0-0.png"]
    both, one = tmp_path / "k0.1-slope5-0.png", tmp_path / "k0.2-slope0-0.png"
    assert coloured(both) > 5 < coloured(both, "tilt") and coloured(one) > 5 and coloured(one, "tilt") == 0


def test_line_styles_go_by_the_order_of_the_records(tmp_path, monkeypatch):
    """The first driver on the command line is solid, whatever its name."""
    figures = []
    monkeypatch.setattr("envs.drives.maps.save", lambda figure, path: figures.append(figure))
    plot_maps(tmp_path, [replace(DRIVE, driver=name, episode=n) for n in (0, 1) for name in ("straight", "navigator")])
    handles = {handle.get_label(): handle for handle in figures[0].legends[0].get_lines()}
    assert [handles[f"{name}, sgbm"].get_linestyle() for name in ("straight", "navigator")] == ["-", "--"]
    drawn = [line.get_linestyle() for line in figures[0].axes[1].get_lines() if line.get_linewidth() == 1.3]
    assert drawn == ["-", "--"]


def test_the_words_about_a_single_course_find_room(tmp_path, monkeypatch):
    figures = []
    monkeypatch.setattr("envs.drives.maps.save", lambda figure, path: figures.append(figure))
    ramp = (np.linspace(0, 6, 11)[:, None] * np.ones(11)).tolist()
    crashed = replace(DRIVE, outcome="collision", half=10.0, relief=ramp, shortest_path=[[0.0, 0.0], [0.0, 3.0]])
    plot_maps(tmp_path, [replace(crashed, perception=name) for name in ("ground_truth", "m3depth", "sgbm")])
    figure = figures[0]
    figure.draw_without_rendering()
    width, height = figure.bbox.size
    for words in (figure.legends[0], figure.texts[0]):
        box = words.get_window_extent()
        assert box.x0 >= 0 and box.x1 <= width and box.y0 >= 0 and box.y1 <= height


def test_rocks_that_block_are_discs_where_they_lie(tmp_path):
    """The goal lies north of the start, so that a rock 3 m west of the way is drawn 6 m above one 3 m east of it."""
    middles = []
    for east in (3.0, -3.0):
        plot_maps(tmp_path, [replace(DRIVE, obstacles=[[east, 1.5, 3.0]], track=[[0.0, 0.0], [0.0, 0.1]])])
        picture = cv2.imread(str(tmp_path / "k0.1-slope5-0.png")).astype(int)
        picture = picture[: 3 * len(picture) // 4]  # without the legend
        row, column = np.nonzero(np.abs(picture - (0x8C, 0x93, 0x9A)).max(axis=2) < 5)
        width, height = np.ptp(column) + 1, np.ptp(row) + 1
        assert width > 20 and abs(width - height) <= 1 and len(row) == pytest.approx(np.pi / 4 * width**2, rel=0.2)
        middles.append((np.mean(column), np.mean(row)))
    (x0, y0), (x1, y1) = middles
    assert x0 == pytest.approx(x1, abs=1) and y0 - y1 == pytest.approx(2 * width, rel=0.1)


def test_a_cross_marks_where_something_was_hit(tmp_path):
    inks = []
    for outcome in ("collision", "tilt"):
        plot_maps(tmp_path, [replace(DRIVE, outcome=outcome)])
        picture = cv2.imread(str(tmp_path / "k0.1-slope5-0.png")).astype(int)
        panel = picture[: 3 * len(picture) // 4]
        inks.append((np.abs(panel - outcome_colour(outcome)).max(axis=2) < 10).sum())
    assert inks[0] > inks[1] + 15


def test_a_detour_is_on_the_picture_as_a_whole(tmp_path):
    """The drive goes 11 m to the right, which is down, where 8 m would be shown: its turn lies within the frame."""
    plot_maps(tmp_path, [replace(DRIVE, track=[[0.0, 0.0], [11.0, 1.5], [0.0, 2.5]])])
    picture = cv2.imread(str(tmp_path / "k0.1-slope5-0.png")).astype(int)
    lines = (picture < 60).all(axis=2).sum(axis=1) > 0.15 * picture.shape[1]
    top, bottom = np.flatnonzero(lines)[[0, -1]]  # of the frame
    green = np.nonzero(np.abs(picture - outcome_colour("goal")).max(axis=2) < 60)[0]
    lowest = green[green <= bottom].max()
    assert top < lowest < bottom - 3


def test_more_courses_than_a_page_holds_take_another(tmp_path):
    plot_maps(tmp_path, [replace(DRIVE, episode=n) for n in range(21)])
    assert len(list(tmp_path.iterdir())) == 2


def test_pages_of_drives_that_are_no_longer_asked_for_go_and_others_files_stay(tmp_path):
    plot_maps(tmp_path, [replace(DRIVE, episode=n) for n in range(21)])
    mine = ["k0.1-slope5-0-annotated.png", "kept-slopes-of-mine.png", "notes.png"]
    for name in mine:
        (tmp_path / name).touch()
    plot_maps(tmp_path, [replace(DRIVE, cell="k=0.2, slope=preset")])
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted([*mine, "k0.2-slopepreset-0.png"])


def test_drives_are_turned_so_that_the_goal_is_to_the_right(tmp_path):
    """The same drive in another direction is the same picture."""
    turned = replace(DRIVE, goal=[-3.0, 0.0], track=[[-y, x] for x, y in DRIVE.track], obstacles=[[-1.0, 1.0, 0.8]])
    for name, record in (("a", DRIVE), ("b", turned)):
        plot_maps(tmp_path / name, [record])
    a, b = (cv2.imread(str(tmp_path / name / "k0.1-slope5-0.png")).astype(int) for name in "ab")
    assert np.abs(a - b).max() < 60 and (a != b).mean() < 0.01


def drawn_in(path, colour, reach=12):
    """Pixels (N, 2), row and column, of a colour given as #rrggbb."""
    blue_green_red = [int(colour[i : i + 2], 16) for i in (5, 3, 1)]
    return np.argwhere(np.abs(cv2.imread(str(path)).astype(int) - blue_green_red).max(axis=2) < reach)


def test_the_shortest_way_is_a_band_and_named(tmp_path):
    """It goes 2 m to the left of the straight line, which is up."""
    for name, way in (("without", []), ("with", [[0.0, 0.0], [-2.0, 1.5], [0.0, 3.0]])):
        plot_maps(tmp_path / name, [replace(DRIVE, shortest_path=way)])
    without, band = (drawn_in(tmp_path / name / "k0.1-slope5-0.png", WAY_COLOUR) for name in ("without", "with"))
    assert len(without) == 0 and len(band) > 100
    legend_from = 0.87 * len(cv2.imread(str(tmp_path / "with" / "k0.1-slope5-0.png")))
    in_panel, legend = band[band[:, 0] < legend_from], band[band[:, 0] >= legend_from]
    assert np.ptp(in_panel[:, 0]) > 10 and len(legend) > 20


def test_what_one_record_of_a_course_tells_is_drawn_for_all(tmp_path):
    """As where drives of an earlier version, which kept no relief, are in the folder. The bend is in the frame."""
    ramp = (np.linspace(0, 6, 11)[:, None] * np.ones(11)).tolist()
    newer = replace(DRIVE, half=10.0, relief=ramp, shortest_path=[[0.0, 0.0], [11.0, 1.5], [0.0, 3.0]])
    plot_maps(tmp_path / "old", [DRIVE, replace(DRIVE, driver="straight")])
    plot_maps(tmp_path / "mixed", [DRIVE, replace(newer, driver="straight")])
    old, mixed = (drawn_in(tmp_path / name / "k0.1-slope5-0.png", WAY_COLOUR) for name in ("old", "mixed"))
    assert len(old) == 0 and len(mixed) > 100
    frame = cv2.imread(str(tmp_path / "mixed" / "k0.1-slope5-0.png")).astype(int)
    lines = np.flatnonzero((frame < 60).all(axis=2).sum(axis=1) > 0.1 * frame.shape[1])
    bend = mixed[mixed[:, 0] <= lines[-1], 0].max()
    assert lines[0] < bend < lines[-1] - 3


def test_the_footprint_shows_where_drives_begin_and_end(tmp_path):
    """In the colour of the end; its size is the rover's."""
    track = [[0.0, 0.0], [0.0, 1.0]]
    plain = replace(DRIVE, track=track, obstacles=[], goal=[0.0, 20.0])
    for name, headings in (("without", []), ("ahead", [np.pi / 2] * 2), ("turned", [np.pi / 4] * 2)):
        plot_maps(tmp_path / name, [replace(plain, headings=headings)])
    spread = {}
    for name in ("without", "ahead", "turned"):
        green = drawn_in(tmp_path / name / "k0.1-slope5-0.png", OUTCOME_COLOURS["goal"], 60)
        inside = ((green > (200, 60)) & (green < (320, 400))).all(axis=1)  # of the frame, without the goal
        spread[name] = np.ptp(green[inside, 0])
    assert spread["without"] < 8 < spread["ahead"]
    diagonal = (ZHURONG.length + ZHURONG.width) / np.sqrt(2)
    assert (spread["turned"] + 1) / (spread["ahead"] + 1) == pytest.approx(diagonal / ZHURONG.width, rel=0.15)


def test_relief_is_drawn_as_contours_an_interval_for_the_page(tmp_path, monkeypatch):
    titles = []
    monkeypatch.setattr(Figure, "suptitle", lambda self, text, **_: titles.append(text))
    ramp = (np.linspace(0, 6, 11)[:, None] * np.ones(11)).tolist()
    level = np.zeros((11, 11)).tolist()
    inks = []
    for relief in ([], level, ramp):
        folder = tmp_path / str(len(inks))
        plot_maps(folder, [replace(DRIVE, half=10.0, relief=relief)])
        inks.append((cv2.imread(str(folder / "k0.1-slope5-0.png")) < 250).all(axis=2).sum())
    message = [title.partition("contours every ")[2].partition(",")[0] for title in titles]
    assert message == ["", "0.1 m", "0.5 m"]
    assert inks[2] > inks[1] + 300


def test_slopes_are_pooled_for_each_k():
    goals = {(0.2, 0.0): 4, (0.1, 0.0): 10, (0.1, 10.0): 8}
    rows = [{**ROW, "cell": {"k": k, "slope_deg": slope}} for k, slope in goals]
    drives = [
        replace(DRIVE, cell=Cell(*cell).name, episode=n, outcome="goal" if n < count else "time")
        for cell, count in goals.items()
        for n in range(10)
    ]
    pooled = pool_by(rows, drives, "k", [0.1, 0.2, 0.3])
    assert list(pooled) == [0.1, 0.2] and pooled[0.2] == (pytest.approx(0.4), pytest.approx(10))
    share, number = pooled[0.1]
    arrived, courses = np.repeat([1.0, 1.0, 0.0], [10, 8, 2]), [*range(10), *range(10)]
    assert share == pytest.approx(0.9) and number == effective_drives(arrived, courses) and 10 < number < 20


def test_success_is_plotted_without_depth_errors_too(tmp_path):
    for name, error in (("known", 0.02), ("unknown", None)):
        plot_success(tmp_path / f"{name}.png", [{**ROW, "abs_rel": error}], [DRIVE_OF_ROW])
    both, alone = (cv2.imread(str(tmp_path / f"{name}.png")) for name in ("known", "unknown"))
    assert both.shape[0] == alone.shape[0] and both.shape[1] > 1.8 * alone.shape[1]  # no panel that shows nothing
    dark = [(picture < 128).all(axis=2).sum() for picture in (alone, both[:, : alone.shape[1]])]
    assert min(dark) > 1000


def test_the_test_sets_error_is_a_line_of_its_own(tmp_path):
    for name, test_set in (("with", {"sgbm": 0.013}), ("without", {"m3depth": 0.013})):
        plot_success(tmp_path / f"{name}.png", [ROW], [DRIVE_OF_ROW], test_set)
    pictures = [cv2.imread(str(tmp_path / f"{name}.png")) for name in ("with", "without")]
    assert pictures[0].shape == pictures[1].shape and (pictures[0] != pictures[1]).any()


def test_errors_on_the_way_stand_beside_the_test_sets():
    drives = [DRIVE, replace(DRIVE, abs_rel=0.0177), replace(DRIVE, abs_rel=None), replace(DRIVE, perception="m3depth")]
    assert errors_beside({"sgbm": 0.02, "ground_truth": 0.1}, drives) == (
        "sgbm: Abs Rel 0.0150 on the way (2 drives), 0.0200 on the test set\n"
    )
    assert errors_beside({}, drives) == ""


def test_every_end_has_a_colour():
    ends = {"goal", "collision", "tilt", "stuck", "time", "out_of_bounds"}
    assert set(OUTCOME_COLOURS) == ends | {stop.value for stop in Stop}
    assert {"goal", *(end for outcomes in FAILURES.values() for end in outcomes)} == set(OUTCOME_COLOURS)
    assert len(set(OUTCOME_COLOURS.values())) == len(OUTCOME_COLOURS)


def test_all_files_are_written(tmp_path):
    row = {"driver": "navigator", "perception": "sgbm", "cell": {"k": 0.1, "slope_deg": 5.0}, **summarise([DRIVE])}
    settings = {"seed": 3, "align_rows": False, "sun_elevation_deg": 8.0}
    content = {"driven_with": settings, "results": [row], "differences": [], "test_set_abs_rel": {"sgbm": 0.02}}
    write_report(tmp_path, content, [DRIVE])
    page = (tmp_path / "results.md").read_text()
    assert page.startswith("Driven with --seed 3, --no-align-rows, --sun-elevation-deg 8.0.\n\n" + table([row]))
    assert page.endswith(errors_beside({"sgbm": 0.02}, [DRIVE]))
    assert {file.name for file in tmp_path.iterdir()} == {"results.md", "success.png", "maps"}
