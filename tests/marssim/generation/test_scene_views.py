"""What a sample's JSON records of its scene."""

import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from marssim.base.camera import NATECAM
from marssim.base.dataset.sample import StereoSample, recorded_mount
from marssim.base.right_image import is_rotation
from marssim.base.rover_spec import CameraMount
from marssim.generate import GenerateConfig, generate_dataset
from marssim.render.faults import RANDOM
from marssim.render.sensor import FAULTS, SensorConfig
from marssim.scene.look import Look
from marssim.scene.presets import preset
from marssim.scene.scene import SceneConfig, build_scene
from marssim.scene.trajectory import TrajectoryConfig
from marssim.scene.viewpoint import ViewConfig

SMALL = preset("gale", size=12.0, horizon=16.0)


def pair(out: Path, scene: SceneConfig = SMALL, **changes) -> StereoSample:
    """Return the only pair of a dataset."""
    asked = GenerateConfig(
        out=out, pairs=1, views_per_scene=1, renderer="scan", seed=4, rig=NATECAM.resized(48, 48), scenes=(scene,)
    )
    return generate_dataset(replace(asked, **changes))[0]


def config(out: Path, views: int, **changes) -> GenerateConfig:
    """Return a dataset of one scene."""
    asked = GenerateConfig(
        out=out, pairs=views, views_per_scene=views, renderer="scan", seed=4, rig=NATECAM.resized(48, 48),
        scenes=(SMALL,),
    )  # fmt: skip
    return replace(asked, **changes)


@pytest.fixture(scope="module")
def sample(tmp_path_factory) -> StereoSample:
    return pair(tmp_path_factory.mktemp("views") / "set")


def test_every_value_of_the_look_is_recorded(sample):
    look = build_scene(SMALL, np.random.default_rng((4, 0))).look
    assert {f.name for f in fields(Look)} <= set(sample.meta)
    for field in fields(Look):
        assert np.array_equal(sample.meta[field.name], getattr(look, field.name)), field.name
    assert sample.meta["sun_elevation_deg"] == pytest.approx(math.degrees(math.asin(look.sun[2])))


def test_ranges_narrowed_to_what_was_recorded_give_the_same_images(sample, tmp_path):
    """Every range of the look and of the sensor has its drawn value; the sun's two angles are in its vector."""
    drawn = {name: (sample.meta[name],) * 2 for name in vars(SMALL.look) if name in sample.meta}
    assert set(vars(SMALL.look)) - set(drawn) == {"sun_azimuth_deg"}
    del drawn["sun_elevation_deg"]  # a rounding error away
    scene = replace(SMALL, look=replace(SMALL.look, **drawn))
    drawn = {name: value for name, value in sample.meta["sensor"].items() if name != "seed"}
    sensor = SensorConfig(**{name: (value, value) for name, value in drawn.items()})
    again = pair(tmp_path / "set", scene, sensor=sensor)
    assert again.meta["scene_config"] != sample.meta["scene_config"]
    assert again.meta["sha256"] == sample.meta["sha256"]


def test_faults_narrowed_to_what_was_recorded_give_the_same_images(tmp_path):
    sample = pair(tmp_path / "first", sensor=replace(RANDOM, fault_chance=(0.8, 0.8)))
    drawn = {name: (value, value) for name, value in sample.meta["sensor"].items() if name != "seed"}
    assert sum(sample.meta["sensor"][name] != getattr(SensorConfig(), name)[0] for name in FAULTS) > 4
    again = pair(tmp_path / "again", sensor=SensorConfig(**drawn))
    assert again.meta["sha256"] == sample.meta["sha256"]
    assert np.array_equal(again.disparity, sample.disparity)


def test_a_drive_keeps_its_detectors_and_their_dust(tmp_path):
    config = GenerateConfig(
        out=tmp_path / "drive", pairs=2, views_per_scene=2, trajectory=True, renderer="scan", seed=4,
        rig=NATECAM.resized(48, 48), scenes=(SMALL,), sensor=SensorConfig(dust=(0.3, 0.3)),
    )  # fmt: skip
    first, second = generate_dataset(config)
    assert first.meta["sensor"] == second.meta["sensor"] and first.meta["sensor"]["dust"] == 0.3
    assert not np.array_equal(first.left, second.left)


def test_the_rover_is_recorded_and_leaves_views_without_it_as_they_are(tmp_path):
    view = ViewConfig(rover=(0.6, 0.6), rover_pan_deg=(110.0, 160.0), pitch_deg=(25.0, 35.0))
    plain, some = (
        generate_dataset(replace(config(tmp_path / name, 5), view=each))
        for name, each in (("plain", replace(view, rover=(0.0, 0.0))), ("some", view))
    )
    present = ["rover" in sample.meta for sample in some]
    assert 0 < sum(present) < 5 and not any("rover" in sample.meta for sample in plain)
    for there, before, after in zip(present, plain, some, strict=True):
        assert (before.meta["sha256"] == after.meta["sha256"]) != there
        own = after.rock == -1
        assert own.any() == there and (before.rock >= 0).all()
        if there:
            assert 110 <= after.meta["rover"]["pan_deg"] <= 160
            assert np.array_equal(after.depth[~own], before.depth[~own])
            assert (after.depth[own] < before.depth[own]).all() and after.depth[own].min() > 0.3
            assert is_rotation(np.array(after.meta["rover"]["pose"])[:3, :3])


def test_a_drive_has_the_rover_in_all_views_or_none(tmp_path):
    for seed in range(3):
        asked = config(tmp_path / str(seed), 2, trajectory=True, seed=seed, view=ViewConfig(rover=(0.5, 0.5)))
        pans = [sample.meta.get("rover", {}).get("pan_deg") for sample in generate_dataset(asked)]
        assert len(set(pans)) == 1


def test_the_mast_of_a_rover_in_view_is_rigid_over_a_drive_and_time_goes_on(tmp_path):
    rough = replace(
        SMALL, size=24.0, horizon=30.0, relief=replace(SMALL.relief, rms_slope_deg=9, regional_slope_deg=12)
    )
    view, drive = ViewConfig(rover=(1.0, 1.0), rover_pan_deg=(100.0, 100.0)), TrajectoryConfig(step=0.8, speed=0.5)
    asked = config(tmp_path, 3, trajectory=True, view=view, drive=drive, scenes=(rough,))
    samples = generate_dataset(asked)
    assert [sample.meta["timestamp"] for sample in samples] == pytest.approx([0.0, 1.6, 3.2])
    mounts = [recorded_mount(sample.meta) for sample in samples]
    for mount in mounts:
        np.testing.assert_allclose(mount, mounts[0], atol=1e-9)
    assert np.rad2deg(CameraMount.of_left_eye(mounts[0], NATECAM.baseline)[1]) == pytest.approx(100.0, abs=1e-6)


def test_a_heightmap_is_recorded_with_its_place_and_datum(sample, tmp_path):
    """With place and datum, the cameras can be placed in the map: they have their height above its ground."""
    assert "heightmap" not in sample.meta
    east = np.arange(160) - 79.5
    np.save(tmp_path / "map.npy", np.tile(-2500 + 0.05 * east, (160, 1)))
    relief = replace(SMALL.relief, heightmap=str(tmp_path / "map.npy"), heightmap_scale=1.0, heightmap_at=None)
    bare = replace(relief, ripple_amplitude=0.0, crater_density=0.0)
    rendered = pair(tmp_path / "set", replace(SMALL, relief=bare))
    recorded, eye = rendered.meta["heightmap"], np.array(rendered.meta["pose"])[:3, 3]
    assert np.abs(recorded["at"]).min() > 1
    ground = -2500 + 0.05 * (recorded["at"][0] + eye[0])
    assert 1.14 < eye[2] + recorded["datum"] - ground < 1.26
    assert "`datum`" in (tmp_path / "set" / "README.md").read_text()
