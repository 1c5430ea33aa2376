from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from marssim.abundance import main, measure, visible_areas
from marssim.scene.presets import PRESETS, preset
from marssim.scene.rocks.golombek import covered_area
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig, build_scene

CELL = 0.025  # [m]


@cache
def draw(k, seed=0, **changes):
    config = SceneConfig(rocks=replace(RockConfig(k=k, min_diameter=0.06), **changes), size=20.0, horizon=11.0)
    return build_scene(config, np.random.default_rng(seed))


@pytest.mark.parametrize("k", [0.01, 0.03, 0.15, 0.3])
def test_seen_from_above_rocks_cover_what_was_asked(k):
    result = measure([draw(k, seed) for seed in range(2)], k, cell=CELL)
    assert result.within.all(), f"\n{result.table()}"


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_has_its_abundance(name):
    config = replace(preset(name), size=20.0, horizon=11.0)
    result = measure([build_scene(config, np.random.default_rng(3))], config.rocks.k, cell=CELL)
    assert result.within.all(), f"\n{result.table()}"


def test_deep_burial_and_clusters_are_corrected_for():
    """Half of each rock is below ground and all lie in clusters, and the rocks cover as much ground."""
    result = measure([draw(0.15, n, buried=(0.5, 0.5), cluster=1.0) for n in range(2)], 0.15, cell=CELL)
    assert result.within.all(), f"\n{result.table()}"


def test_the_visible_area_of_a_rock_is_the_disc_of_its_diameter():
    scene = draw(0.05)
    outline, middle = visible_areas(scene, 0.012)
    rocks = scene.rocks
    inside = (np.abs(rocks.centre[:, :2]).max(axis=1) < scene.half - 1.3) & (rocks.diameter > 0.15)
    assert inside.sum() > 50
    measured = np.sqrt(4 / np.pi * outline[inside])
    assert np.median(measured / rocks.diameter[inside]) == pytest.approx(1, abs=0.03)
    assert np.abs(middle[inside] - rocks.centre[inside, :2]).max() < 0.3


def test_a_wrong_abundance_is_noticed():
    """Scenes with more or fewer rocks than asked for are outside the bounds."""
    scenes = [draw(0.15, seed) for seed in range(2)]
    assert not measure(scenes, 0.21, cell=CELL).within.all()
    assert not measure(scenes, 0.10, cell=CELL).within.all()


def test_the_command_prints_a_table(capsys):
    assert main(["--scene", "utopia", "--scenes", "1", "--cell", "0.05"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "utopia" in lines[0] and len(lines) == 2 + 6
    assert float(lines[2].split()[1]) == pytest.approx(100 * covered_area(np.array(0.1), 0.033), abs=1e-3)
    ratio, rocks, expected = (float(word) for word in lines[2].split()[3:6])
    assert ratio == pytest.approx(1, abs=0.3)
    assert expected == pytest.approx(0.696 * 29.5**2, rel=0.02)  # of the published table, on the ground looked at
    assert abs(rocks - expected) < 4 * expected**0.5


def test_the_command_measures_the_rocks_that_it_is_given(capsys):
    """The rocks are those of the place that --scene names, but for the values that flags give."""
    flags = ["--scene", "utopia", "--scenes", "1", "--cell", "0.05"]
    tables = []
    for more in ([], ["--rocks.k", "0.033"], ["--rocks.buried", "0", "0.5"], ["--rocks.k", "0"]):
        assert main([*flags, *more]) == 0
        tables.append(capsys.readouterr().out.splitlines())
    assert tables[0] == tables[1] and tables[0][2:] != tables[2][2:]
    assert all(float(word) == 0 for line in tables[3][2:] for word in line.split()[1:3])


def test_help_shows_the_rocks_of_the_place(capsys):
    for place, k in (("gale", "0.07"), ("jezero", "0.15")):
        with pytest.raises(SystemExit):
            main([f"--scene={place}", "--help"])
        assert f"(default: {k})" in " ".join(capsys.readouterr().out.replace("│", " ").split())


@pytest.mark.parametrize("flag", ["--scenes 0", "--seed -1", "--rocks.k 0.9", "--rocks.albedo nan", "--cell 1"])
def test_a_mistake_is_one_line(flag, capsys):
    assert main(flag.split()) == 2
    error = capsys.readouterr().err
    assert flag.split()[0] in error and error.count("\n") == 1


def test_a_place_without_ground_inside_the_margin_is_refused(tmp_path, capsys):
    (tmp_path / "place.json").write_text('{"size": 2, "horizon": 4}')
    assert main(["--scene", str(tmp_path / "place.json"), "--scenes", "1", "--cell", "0.05"]) == 2
    out, error = capsys.readouterr()
    assert out == "" and error.startswith("error: size must be above 2.5 m, ") and error.count("\n") == 1


def test_a_scene_reports_what_it_achieved():
    """The scene computes it from outlines, and the rays agree."""
    scenes = [draw(0.15, seed) for seed in range(2)]
    listed = np.mean([scene.abundance()["achieved"] for scene in scenes], axis=0)
    measured = measure(scenes, 0.15, cell=CELL)
    assert scenes[0].abundance()["asked"] == pytest.approx(measured.asked.tolist())
    assert listed == pytest.approx(measured.achieved, rel=0.15)  # the rays leave out a margin
