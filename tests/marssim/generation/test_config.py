import ast
import inspect
import itertools
import json
import math
import textwrap
from dataclasses import fields, replace
from pathlib import Path

import pytest

from marssim.abundance import AbundanceConfig
from marssim.base.camera import NATECAM, PinholeCamera, StereoRig
from marssim.base.command.flags import parse
from marssim.base.dataset.dataset import split_of
from marssim.export import ExportConfig
from marssim.generate import main
from marssim.generation.command_line import command_flags
from marssim.generation.config import GenerateConfig, GenerateOptions, RigOptions, RunConfig, parse_generate
from marssim.render.faults import RANDOM
from marssim.render.renderers.by_name import FALLBACK_NOTE
from marssim.render.sensor import SensorConfig
from marssim.scene.look import LookConfig
from marssim.scene.presets import PRESETS, preset
from marssim.scene.relief import ReliefConfig
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import SceneConfig
from marssim.slopes import SlopesConfig
from marssim.verify import VerifyConfig


def asked(*args: object) -> GenerateConfig:
    return parse_generate("generate", None, ["--out", "x", *map(str, args)])


def shown(capsys, *args: str) -> str:
    with pytest.raises(SystemExit, match="0"):
        parse_generate("generate", None, [*args, "--help"])
    return " ".join(capsys.readouterr().out.replace("│", " ").split())


@pytest.mark.parametrize("name", PRESETS)
def test_a_place_alone_is_its_preset(name):
    config = asked("--scene", name)
    assert config.scenes == (preset(name),) and type(config.scenes[0]) is SceneConfig
    assert config.place == name and config.rig == NATECAM
    assert config == GenerateConfig(out=config.out, scenes=(preset(name),))


def test_the_last_scene_counts_however_it_is_written():
    assert asked("--scene", "gale", "--scene=hard").scenes == (preset("hard"),)
    assert asked("--scene=hard", "--scene", "gale").scenes == (preset("gale"),)


def test_knobs_change_the_place_and_nothing_else():
    gale = preset("gale")
    config = asked("--scene", "gale", "--rocks.k", 0.1, "--relief.hurst", 0.6, "--look.sun-elevation-deg", 10, 20,
                   "--horizon", 50)  # fmt: skip
    assert config.scenes == (
        replace(
            gale,
            rocks=replace(gale.rocks, k=0.1),
            relief=replace(gale.relief, hurst=0.6),
            look=replace(gale.look, sun_elevation_deg=(10.0, 20.0)),
            horizon=50.0,
        ),
    )


def test_a_place_from_a_file_and_flags_that_change_it(tmp_path, capsys):
    file = tmp_path / "my_place.json"
    file.write_text('{"preset": "gale", "size": 20, "rocks": {"k": 0.12}}')
    gale = preset("gale", size=20.0, rocks=replace(preset("gale").rocks, k=0.12))
    config = asked("--scene", file)
    assert config.scenes == (gale,) and type(config.scenes[0]) is SceneConfig and config.place == "gale"
    assert command_flags(config) == "--pairs 100 --seed 0 --scene gale --rocks.k 0.12 --size 20.0"
    assert asked("--scene", file, "--rocks.k", 0.2).scenes == (replace(gale, rocks=replace(gale.rocks, k=0.2)),)
    assert "Viking 2 0.15. (default: 0.12)" in shown(capsys, "--scene", str(file))


@pytest.mark.parametrize("name", ["galle", "no.json", ""])
def test_a_scene_that_is_neither_a_preset_nor_a_file_is_refused_with_the_flag(name, capsys):
    assert main(["--out", "x", f"--scene={name}"]) == 2
    line = capsys.readouterr().err
    assert line.startswith("error: ") and "--scene" in line and line.count("\n") == 1
    assert ("did you mean gale?" in line) == (name == "galle")


def test_without_pybullet_scan_renders_and_a_note_says_so(monkeypatch, capsys):
    """The command of the dataset names scan, so that it gives the same data where PyBullet is installed."""
    monkeypatch.setattr("marssim.render.renderers.by_name.pybullet_is_installed", lambda: False)
    config = asked()
    assert config.renderer == "scan" and capsys.readouterr().err == f"note: {FALLBACK_NOTE}\n"
    assert command_flags(config) == "--pairs 100 --seed 0 --scene utopia --renderer scan"
    for renderer in ("embree", "scan"):
        assert asked("--renderer", renderer).renderer == renderer and not capsys.readouterr().err
    assert asked("--renderer=scan").renderer == "scan" and not capsys.readouterr().err
    monkeypatch.setattr("marssim.render.renderers.by_name.pybullet_is_installed", lambda: True)
    assert asked().renderer == "pybullet" and not capsys.readouterr().err


def test_every_flag_of_marssims_commands_is_explained_by_sentences():
    """Where the help of a flag stands below its field, it begins with a capital and ends with a full stop."""
    for config in (RunConfig, RigOptions, GenerateOptions, VerifyConfig, ExportConfig, AbundanceConfig, SlopesConfig):
        tree = ast.parse(textwrap.dedent(inspect.getsource(config))).body[0]
        body = tree.body[1:] if isinstance(tree, ast.ClassDef) else []
        for field, text in itertools.pairwise(body):
            if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
                words = text.value.value
                assert words[0].isupper() and words.endswith("."), f"{config.__name__}.{field.target.id}: {words}"


def test_faults_set_the_sensor_and_flags_replace_their_values(capsys):
    assert asked().sensor == asked("--faults", "none").sensor == SensorConfig()
    assert asked("--faults", "random").sensor == RANDOM == asked("--faults=none", "--faults=random").sensor
    config = asked("--scene", "mixed", "--sensor.dust", 0.1, 0.2, "--faults", "random", "--sensor.psf", 1, 1)
    assert config.sensor == replace(RANDOM, dust=(0.1, 0.2), psf=(1.0, 1.0)) and len(config.scenes) == len(PRESETS)
    assert "(default: 0.03 0.5)" in shown(capsys, "--faults", "random")
    assert main(["--out", "x", "--faults", "many"]) == 2
    assert "none" in (error := capsys.readouterr().err) and "random" in error and "--faults" in error


def test_knobs_hold_for_every_place_of_mixed():
    config = asked("--scene", "mixed", "--rocks.k", preset("jezero").rocks.k)
    assert config.place == "mixed" and [s.preset for s in config.scenes] == list(PRESETS)
    for scene in config.scenes:
        whole = preset(scene.preset)
        assert scene == replace(whole, rocks=replace(whole.rocks, k=preset("jezero").rocks.k))


def test_help_shows_the_values_of_the_place(capsys):
    for name in ("gale", "hard"):
        text = shown(capsys, "--scene", name)
        assert f"Utopia has 0.033, Viking 2 0.15. (default: {preset(name).rocks.k})" in text


def test_every_field_of_the_scene_is_a_flag_with_help(capsys):
    """The fields come from the configs, so that one that is added later is tested too."""
    text = shown(capsys)
    for part, config in (("rocks", RockConfig), ("relief", ReliefConfig), ("look", LookConfig)):
        for field in fields(config):
            flag = f"--{part}.{field.name.replace('_', '-')} "
            assert flag in text, flag
            after = text.split(flag, 1)[1].split(" --", 1)[0]
            assert len(after.split("(default", 1)[0].split()) > 4, f"{flag} has no help"
    assert "--preset" not in text and "--knobs" not in text


def test_cameras_by_flags():
    rig = asked("--rig.width", 640, "--rig.height", 400, "--rig.focal", 500, "--rig.baseline", 0.4).rig
    assert rig == StereoRig(PinholeCamera.centred(640, 400, 500.0), 0.4)
    assert asked("--rig.cx", 250.25).rig.camera.cx == 250.25
    assert asked("--rig.focal-y", 610).rig == replace(NATECAM, camera=replace(NATECAM.camera, fy=610.0))
    assert RigOptions().rig() == NATECAM


def test_cameras_by_a_file(tmp_path):
    rig = StereoRig(PinholeCamera(320, 200, 300.0, 301.0, 160.0, 99.0), 0.12)
    file = tmp_path / "rig.json"
    file.write_text(json.dumps(rig.to_dict()))
    assert asked("--rig-file", file).rig == rig
    with pytest.raises(ValueError, match=r"--rig-file .*cannot be combined with the flags --rig"):
        asked("--rig-file", file, "--rig.width", 100)
    for content, message in (
        ("{", "is not JSON: "),
        ("{}", "field 'width' is missing"),
        ('{"width": "wide"}', "field 'width' must be a whole number"),
        (json.dumps({**rig.to_dict(), "fx": -1}), "fx must be positive"),
        ("[]", "not a JSON object"),
        ("5", "not a JSON object"),
        *(('{"a":' * deep + "1" + "}" * deep, "levels deep") for deep in (70, 900, 100_000)),
        (json.dumps({**rig.to_dict(), "k1": 0.1}), "unknown field k1; a rig has width, height, fx"),
        ("\xff", "is not JSON: "),
    ):
        file.write_text(content, encoding="latin-1")
        with pytest.raises(ValueError, match=rf"^--rig-file {file}: ") as error:
            asked("--rig-file", file)
        assert message in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(ValueError, match=rf"^--rig-file {tmp_path}: is a directory$"):
        asked("--rig-file", tmp_path)


def test_more_pairs_than_fit_into_memory_are_refused():
    with pytest.raises(ValueError, match=r"^--pairs must be at most 10000000, got 100000000000000000000$"):
        asked("--pairs", 10**20)


def test_images_that_opencv_would_not_read_are_refused():
    assert asked("--rig.width", 2**16, "--rig.height", 2**14).rig.camera.width == 2**16
    with pytest.raises(ValueError, match=r"^`rig.width` times `rig.height`, .* 1073741824 px, got 65536 x 16385$"):
        asked("--rig.width", 2**16, "--rig.height", 2**14 + 1)


def test_images_that_jpeg_does_not_take_are_refused_where_they_may_be_compressed():
    wide = "--rig.width", 65501, "--rig.height", 8
    assert asked(*wide).rig.camera.width == 65501
    for flags in (("--faults", "public"), ("--sensor.jpeg-quality", 80, 80)):
        with pytest.raises(ValueError, match=r"^`sensor.jpeg_quality` below 100, which --faults may set, needs images"):
            asked(*wide, *flags)


@pytest.mark.parametrize("flag", ["--rig.focal", "--rig.focal-y"])
def test_a_focal_length_in_metres_is_refused(flag):
    assert asked(flag, 1).rig.camera.fy == 1
    with pytest.raises(ValueError, match=r"^`rig.focal`, .* must be at least 1 px, got 0.0131; in metres\?$"):
        asked(flag, 0.0131)


@pytest.mark.parametrize(("flag", "value"), [("--drive.step", 1), ("--drive.speed", 0.1)])
def test_flags_of_a_drive_need_a_drive(flag, value):
    with pytest.raises(ValueError, match=rf"^{flag} describes a drive, which needs --trajectory$"):
        asked(flag, value)
    assert asked(flag, value, "--trajectory").trajectory


def test_only_settings_on_which_the_content_depends_are_recorded():
    first = asked("--scene", "gale")
    same = asked("--scene", "gale", "--pairs", 7, "--workers", 3, "--scheduler", "tcp://a:1")
    assert first.content() == same.content()
    changes = [("--seed", 1), ("--rocks.k", 0.2), ("--rig.focal", 500), ("--trajectory",), ("--view.roll-deg", 0, 0)]
    changes += [("--sensor.rotation-deg", 0, 0), ("--views-per-scene", 2), ("--renderer", "embree"), ("--size", 20)]
    noted = [json.dumps(asked("--scene", "gale", *change).content(), sort_keys=True) for change in changes]
    assert len({*noted, json.dumps(first.content(), sort_keys=True)}) == len(changes) + 1
    drives = [asked("--trajectory", "--drive.step", step).content() for step in (0.2, 0.3)]
    assert drives[0] != drives[1]


def test_every_place_is_recorded_in_the_order_of_the_draw(tmp_path):
    """Two places may start from the same preset."""
    rough = preset("gale", relief=replace(preset("gale").relief, rms_slope_deg=9.0))
    orders = [(preset("gale"), rough), (rough, preset("gale")), (rough,), (rough, rough)]
    noted = [GenerateConfig(out=tmp_path, scenes=scenes).content()["scenes"] for scenes in orders]
    assert [len(scenes) for scenes in noted] == [2, 2, 1, 2]
    assert noted[0] == noted[1][::-1] != noted[1] and noted[3] == noted[2] * 2


def places(count: int, seed: int, scenes: int) -> list[int]:
    """Return which of `count` places each scene of a dataset is drawn from."""
    configs = [preset("gale", size=10.0 + n) for n in range(count)]
    config = GenerateConfig(out=Path("x"), scenes=tuple(configs), seed=seed)
    return [configs.index(config.scene_config(scene)) for scene in range(scenes)]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 7, 10])
@pytest.mark.parametrize("seed", [0, 1, 2**40])
def test_places_come_in_turn_and_each_split_has_each_equally_often(count, seed):
    """Every block has each place once; over count * lcm(count, 10) scenes each split has each equally often."""
    cycle = count * math.lcm(count, 10)
    drawn = places(count, seed, 2 * cycle)
    for start in range(0, len(drawn), count):
        assert sorted(drawn[start : start + count]) == list(range(count))
    for part in (drawn[:cycle], drawn[cycle:]):
        for split, share in (("train", 0.7), ("val", 0.2), ("test", 0.1)):
            members = [place for scene, place in enumerate(part) if split_of(scene) == split]
            assert [members.count(place) for place in range(count)] == [round(share * cycle / count)] * count


def test_the_order_of_the_places_follows_from_the_seed():
    assert places(5, 3, 100) == places(5, 3, 100) != places(5, 4, 100)
    orders = {tuple(places(5, seed, 5)) for seed in range(60)}
    assert len(orders) > 30  # of 120
    first = [places(5, seed, 2)[1] for seed in range(300)]  # the scene that is the test split of a small dataset
    assert min(first.count(place) for place in range(5)) > 30


def test_a_config_needs_a_scene(tmp_path):
    with pytest.raises(ValueError, match="scenes"):
        GenerateConfig(out=tmp_path, scenes=())


def test_options_default_to_the_first_place():
    """Without the values of a preset, the flags have those of the first place."""
    assert parse(GenerateOptions, "generate", None, ["--out", "x"]).scene == PRESETS[0]
