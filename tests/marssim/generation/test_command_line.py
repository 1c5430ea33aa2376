import json
import shlex
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marssim.base.camera import NATECAM, PinholeCamera, StereoRig
from marssim.generation.command_line import _rig, command_flags
from marssim.generation.config import GenerateConfig, RigOptions, parse_generate
from marssim.scene.presets import PRESETS, preset


def again(config: GenerateConfig) -> GenerateConfig:
    """Return the config that the flags of a config give."""
    flags = command_flags(config)
    assert flags is not None
    return parse_generate("generate", None, ["--out", str(config.out), *shlex.split(flags)])


def asked(*flags: object) -> GenerateConfig:
    return parse_generate("generate", None, ["--out", "x", *map(str, flags)])


@pytest.mark.parametrize(
    "flags",
    [
        (),
        ("--pairs", 7, "--seed", 3, "--renderer", "embree", "--views-per-scene", 2),
        ("--scene", "gale", "--rocks.k", 0.1, "--look.sun-elevation-deg", 10, 20, "--size", 20, "--horizon", 50.5),
        ("--scene", "jezero", "--trajectory", "--drive.step", 0.3, "--view.roll-deg", -3, 3),
        ("--scene", "mixed", "--rocks.k", 0.15, "--relief.hurst", 1 / 3),
        ("--rig.width", 640, "--rig.height", 400, "--rig.focal", 500.25, "--rig.baseline", 0.4, "--rig.cx", 300),
        ("--rig.focal-y", 600, "--rig.cy", 200.5),
        ("--sensor.rotation-deg", 0, 0, "--sensor.psf", 0.3, 0.7),
        ("--rasterizer", "egl"),
        ("--faults", "random", "--sensor.dust", 0, 0, "--sensor.fault-chance", 0.25, 0.25),
    ],
)
def test_the_flags_of_a_config_give_the_same_config(flags):
    assert again(asked(*flags)) == asked(*flags)


def test_a_heightmap_is_among_the_flags(tmp_path):
    np.save(tmp_path / "a map.npy", np.zeros((300, 300)))
    config = asked("--relief.heightmap", tmp_path / "a map.npy", "--relief.heightmap-scale", 1, "--scene", "hard")
    drawn = replace(config.scenes[0], relief=replace(config.scenes[0].relief, heightmap_at=None))
    for scenes in (config.scenes, (drawn,)):
        assert again(replace(config, scenes=scenes)) == replace(config, scenes=scenes)


@settings(max_examples=8, deadline=None)  # a command line takes a while to be parsed
@given(
    seed=st.integers(0, 2**70),
    fx=st.floats(1, 5000), fy=st.floats(1, 5000), cx=st.floats(-100, 100), baseline=st.floats(1e-3, 10),
    k=st.floats(0, 0.4), dust=st.tuples(st.floats(0, 12), st.floats(0, 12)).map(sorted),
)  # fmt: skip
def test_numbers_come_back_to_the_last_bit(seed, fx, fy, cx, baseline, k, dust):
    gale = preset("gale")
    scene = replace(gale, rocks=replace(gale.rocks, k=k), look=replace(gale.look, optical_depth=tuple(dust)))
    rig = StereoRig(PinholeCamera(64, 48, fx, fy, cx, 23.5), baseline)
    config = replace(asked(), seed=seed, rig=rig, scenes=(scene,))
    assert again(config) == config


def test_folder_and_workers_are_left_out():
    flags = command_flags(asked("--workers", 3, "--scheduler", "tcp://a:1", "--pairs", 5))
    assert flags == "--pairs 5 --seed 0 --scene utopia"


def test_scenes_that_flags_cannot_give_have_no_command():
    gale, hard = preset("gale"), preset("hard")
    rough = replace(gale, relief=replace(gale.relief, rms_slope_deg=9.0))
    every = tuple(map(preset, PRESETS))
    for scenes in ((gale, hard), (gale, rough), (replace(gale, preset="mine"),), every[::-1]):
        assert command_flags(replace(asked(), scenes=scenes)) is None
    mixed = replace(asked(), scenes=(*every[:-1], replace(hard, size=9.0)))
    assert command_flags(mixed) is None
    assert command_flags(replace(mixed, scenes=tuple(replace(scene, size=9.0) for scene in every))) is not None


def test_every_setting_on_which_the_content_depends_is_recorded():
    """A field that is added to RunConfig is recorded without any other change."""
    config = asked()
    for field in fields(config):
        if field.name not in ("out", "workers", "scheduler", "scenes", "rig", "raw", "raw_rig", "rig_file"):
            content = {**config.content(), "pairs": 1, "drive": 1, "rasterizer": 1}  # the last two: where they count
            assert field.name in json.dumps(content), field.name


def test_a_flag_replaces_the_heightmap_of_a_place_file(tmp_path):
    for name in ("first", "second"):
        np.save(tmp_path / f"{name}.npy", np.full((250, 250), 1.0 if name == "first" else 2.0))
    place = {"relief": {"heightmap": "first.npy", "heightmap_scale": 1}}
    (tmp_path / "place.json").write_text(json.dumps(place))
    here = ("--scene", tmp_path / "place.json")
    own, other = (
        asked(*here, *more).scenes[0].relief for more in ((), ("--relief.heightmap", tmp_path / "second.npy"))
    )
    assert Path(other.heightmap).name == "second.npy" and other.heightmap_scale == 1
    assert None not in (own.heightmap_sha256, other.heightmap_sha256)
    assert own.heightmap_sha256 != other.heightmap_sha256
    with pytest.raises(ValueError, match="its SHA-256 is"):
        asked(*here, "--relief.heightmap-sha256", "0" * 64)


def test_a_default_height_of_pixels_is_a_flag_where_the_width_is_none():
    rig = RigOptions(focal=700.0, focal_y=NATECAM.camera.fy).rig()
    flags = {name.removeprefix("rig."): value for name, value in _rig(rig).items()}
    assert RigOptions(**flags).rig() == rig
