import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from marssim.scene.place_file import load_place, save_place
from marssim.scene.presets import PRESETS, preset
from marssim.scene.scene import build_scene


@pytest.fixture
def place_file(tmp_path):
    """Writes an object to a file, and returns the file."""

    def write(content: object) -> str:
        file = tmp_path / "my_place.json"
        file.write_text(content if isinstance(content, str) else json.dumps(content))
        return str(file)

    return write


@pytest.mark.parametrize("name", PRESETS)
def test_the_name_of_a_preset_is_that_preset(name):
    assert load_place(name) == preset(name)


@pytest.mark.parametrize("name", PRESETS)
def test_a_place_comes_back_from_its_file(name, tmp_path):
    place = preset(name, size=20.0, rocks=replace(preset(name).rocks, k=1 / 3))
    save_place(place, tmp_path / "place.json")
    assert load_place(tmp_path / "place.json") == place


def test_a_file_changes_what_it_names_of_the_preset_that_it_starts_from(place_file):
    gale = preset("gale")
    look = replace(gale.look, sun_elevation_deg=(20.0, 25.0))
    asked = {"preset": "gale", "size": 40, "rocks": {"k": 0.12}, "look": {"sun_elevation_deg": [20, 25]}}
    place = load_place(place_file(asked))
    assert place == replace(gale, size=40.0, rocks=replace(gale.rocks, k=0.12), look=look)
    assert type(place.size) is float and type(place.look.sun_elevation_deg[0]) is float


def test_a_file_without_a_preset_starts_from_the_default_place(place_file):
    assert load_place(place_file({"size": 20})) == preset("utopia", size=20.0)
    assert load_place(place_file({})) == preset("utopia")


def test_the_path_of_a_heightmap_is_relative_to_the_file(place_file, tmp_path):
    np.save(tmp_path / "hill.npy", np.full((400, 400), 3.0))
    changes = {"size": 12, "horizon": 16, "rocks": {"k": 0}}
    relief = {"heightmap": "hill.npy", "heightmap_scale": 1, "heightmap_at": None}
    place = load_place(place_file({**changes, "relief": relief}))
    assert place.relief.heightmap == str(tmp_path / "hill.npy") and place.relief.heightmap_at is None
    assert build_scene(place, np.random.default_rng(0)).terrain.datum == pytest.approx(3.0)
    save_place(place, tmp_path / "elsewhere.json")
    assert load_place(tmp_path / "elsewhere.json") == place


def test_what_a_dataset_notes_of_a_scene_is_a_place(place_file):
    place = preset("hard", size=14.0)
    assert load_place(place_file(asdict(place))) == place


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"rock": {"k": 0.1}}, "unknown field rock; did you mean rocks?"),
        ({"rocks": {"kk": 0.1}}, "unknown field rocks.kk; did you mean rocks.k?"),
        ({"rocks": {"zzz": 1}}, "unknown field rocks.zzz; choose from rocks.k, rocks.min_diameter, rocks."),
        ({"rocks": {"k": 3}}, "rocks.k must lie in [0, 0.4], got 3.0"),
        ({"rocks": {"k": "many"}}, "rocks.k must be a number, got 'many'"),
        ({"rocks": {"k": True}}, "rocks.k must be a number, got True"),
        ({"rocks": {"families": [1, 2]}}, "rocks.families must be a list of 3 numbers, got [1, 2]"),
        ({"rocks": 3}, "rocks must be a JSON object, got 3"),
        ({"look": {"pebbles": [0.5, 0.1]}}, "look.pebbles must be a range LOW HIGH within 0 and 1, got 0.5 0.1"),
        ({"size": 3000}, "size must lie in [1, 400] m, got 3000"),
        ({"size": 30, "horizon": 10}, "size must be more than cell, 0.08 m, and less than twice horizon, 10 m"),
        ({"relief": {"heightmap_at": 5}}, "relief.heightmap_at must be a list of 2 numbers or null, got 5"),
        ({"relief": {"heightmap": 5}}, "relief.heightmap must be a text or null, got 5"),
        ({"relief": {"heightmap": "none.npy"}}, "none.npy: no such file"),
        ({"relief": {"heightmap_scale": 5}}, "relief.heightmap_scale describes a heightmap, so it needs"),
        ({"preset": "galle"}, "preset 'galle' is unknown; did you mean gale?"),
        ({"preset": "zzz"}, "preset 'zzz' is unknown; choose from utopia"),
        ({"preset": ["gale"]}, "preset ['gale'] is unknown; did you mean gale?"),
        ('{"size": NaN}', "size must be a number, got nan"),
        ("[]", "not a JSON object"),
        ("{", "is not JSON"),
    ],
)
def test_a_mistake_in_a_file_is_one_line_with_the_file_and_the_field(content, message, place_file):
    file = place_file(content)
    with pytest.raises(ValueError) as error:
        load_place(file)
    assert (
        str(error.value).startswith(f"`scene` {file}: ")
        and message in str(error.value)
        and "\n" not in str(error.value)
    )
    assert str(error.value).count("`") == 2


def test_neither_a_preset_nor_a_file():
    with pytest.raises(
        ValueError, match=r"^`scene` galle: no preset \(utopia, .*\) and no JSON .*\(did you mean gale\?\)$"
    ):
        load_place("galle")
    with pytest.raises(ValueError, match=r"^`scene` nowhere\.json: no such file$"):
        load_place("nowhere.json")


def test_a_label_of_ones_own_comes_back(tmp_path):
    place = preset("gale", preset="mine", size=np.float32(40.0))
    save_place(place, tmp_path / "place.json")
    assert load_place(str(tmp_path / "place.json")) == place
