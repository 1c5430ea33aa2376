from dataclasses import replace

import numpy as np
import pytest

from envs.drivers.builtin import NavigatorDriver, StraightDriver
from envs.drives.episodes import Cell, run_episode
from envs.mars_nav import MarsNavEnv
from envs.recording.recorder import Recorder
from envs.world.eyes import EyesConfig
from m3depth.stereo.prediction import Prediction
from marssim.base.dataset.drive_file import read_drive


class Flat:
    """An estimator that sees level ground, 10 % too far, and no rocks; nothing at the left margin."""

    def infer(self, left, right, rig):
        down = np.arange(rig.camera.height)[:, None] - rig.camera.cy + rig.camera.fy * np.tan(np.deg2rad(20))
        level = 1.2 * rig.camera.fy / np.maximum(down, 1) / np.cos(np.deg2rad(20))  # as the cameras stand and look
        depth = np.where(down > 10, 1.1 * level, np.inf)
        depth = np.broadcast_to(depth, left.shape[:2]).astype(np.float32)
        depth[:, : left.shape[1] // 16] = np.nan
        return Prediction(depth, rig.depth_to_disparity(depth), None, np.ones_like(depth))


@pytest.fixture(scope="session")
def record_drive(make_scene, make_course, tmp_path_factory):
    """Drives over a hand-made course with a rock on the straight path; returns the DriveFile and its environment."""

    def record(name, driver, perception, **changes):
        course = make_course(make_scene(rocks=[(0.0, 0.0, 1.2, 0.8)]), start=(-3.0, 0.3, 0.0), goal=(3.5, 0.3))
        eyes = EyesConfig(image_pixels=128, ground_truth_pixels=64, **changes)
        env = MarsNavEnv(perception, "kinematic", goal_distance=6.5, mast=True, eyes=eyes, align_rows=False)
        recorder = Recorder()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("envs.suites.drawn_course.draw_course", lambda *_: course)
            outcome = run_episode(env, driver, Cell(), 5, 0, (driver_name(driver), name), recorder.watch)
        env.close()
        path = tmp_path_factory.mktemp("drives") / f"{name}.zip"
        path.write_bytes(recorder.drive_file(replace(outcome, cause=recorder.cause), {"seed": 5}))
        return read_drive(path), outcome

    return record


def driver_name(driver):
    return type(driver).__name__.removesuffix("Driver").lower()


@pytest.fixture(scope="session")
def arrival(record_drive):
    """The navigator's drive round the rock, by the true depth, with a look every 0.8 m."""
    return record_drive("ground_truth", NavigatorDriver(), "ground_truth", look_every=0.8)


@pytest.fixture(scope="session")
def crash(record_drive):
    """The straight driver's drive against the rock, with eyes that see level ground only."""
    return record_drive("flat", StraightDriver(), Flat())


@pytest.fixture(scope="session")
def blind_crash(record_drive):
    """The navigator's drive against the rock, with the same eyes."""
    return record_drive("flat-navigator", NavigatorDriver(), Flat())
