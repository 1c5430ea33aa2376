"""The physics' figures at length: what the tests check on few places and for a minute. Printed, and asserted."""

import numpy as np
import pytest

pytest.importorskip("pybullet")

from settling_errors import settling_errors

from marssim.base.rover_spec import ZHURONG
from marssim.physics.rover import Rover
from marssim.physics.world import PhysicsWorld
from marssim.scene.presets import preset
from marssim.scene.scene import build_scene

pytestmark = pytest.mark.benchmark


def test_settling_at_200_places(capsys):
    errors = np.concatenate(
        [
            settling_errors(
                build_scene(preset("gale", size=24.0, cell=0.1, horizon=24.0), np.random.default_rng(seed)),
                50,
                np.random.default_rng(seed),
            )
            for seed in range(4)
        ]
    )
    median, ninety = np.median(errors, axis=0), np.quantile(errors, 0.9, axis=0)
    with capsys.disabled():
        for name, at in (("median", median), ("90 %", ninety)):
            print(f"\nsettling against physics, 200 places, {name}: {at[0]:.2f} deg roll, {at[1]:.2f} deg pitch, "
                  f"{100 * at[2]:.1f} cm", end="")  # fmt: skip
    assert (median < [2, 2, 0.03]).all()


@pytest.mark.parametrize("awake", [False, True])
def test_parked_for_ten_minutes(capsys, monkeypatch, awake):
    """On 15 deg of gale's relief; awake: with the parking brake's static hold taken away, as the contacts alone do."""
    scene = build_scene(preset("gale", size=12.0, horizon=12.0, cell=0.1), np.random.default_rng(2))
    rise = np.tan(np.deg2rad(15))
    fine = scene.terrain.fine
    fine.heights[:] += rise * (fine.x0 + np.arange(fine.heights.shape[1]) * fine.cell)[None, :]
    if awake:
        monkeypatch.setattr("marssim.physics.rover.PARK_SPEED", 0.0)
    with PhysicsWorld(scene, ZHURONG) as world:
        rover = Rover(world, 0.0, 0.0, 0.3)
        world.step(2.0)
        start = rover.state()
        world.step(600.0 if not awake else 60.0)
        state = rover.state()
    creep = np.linalg.norm(state.position - start.position)
    turn = np.rad2deg(abs(state.yaw - start.yaw))
    with capsys.disabled():
        print(f"\nparked on 15 deg, {'contacts alone, 60 s' if awake else '10 minutes'}: {1000 * creep:.2f} mm, "
              f"{turn:.3f} deg", end="")  # fmt: skip
    if not awake:
        assert creep < 0.005 and turn < 0.2
