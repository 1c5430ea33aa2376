"""How far the rover's place at rest without dynamics is from the one that rigid bodies come to."""

from __future__ import annotations

import numpy as np

from marssim.base.rover_spec import ZHURONG, RoverSpec
from marssim.physics.kinematics import collides, settle
from marssim.physics.rover import Rover
from marssim.physics.world import PhysicsWorld
from marssim.scene.scene import Scene

DROP_TIME = 1.5  # [s] after which the springs of the contacts are at rest


def settling_errors(scene: Scene, places: int, rng: np.random.Generator, spec: RoverSpec = ZHURONG) -> np.ndarray:
    """(places, 3) roll [deg], pitch [deg] and height [m] by which settle() and PhysicsWorld differ, without sign.

    Places are drawn where no wheel stands on an obstacle and the belly is free, all over the scene's fine square. The
    rigid bodies are put down where settle() says, and may move for DROP_TIME; where they then stand, as they may have
    slid, settle() is asked again. Needs PyBullet.
    """
    reach = scene.half - np.hypot(spec.length, spec.width) / 2 - 0.1
    out = np.zeros((places, 3))
    with PhysicsWorld(scene, spec) as world:
        done = 0
        while done < places:
            x, y, yaw = *rng.uniform(-reach, reach, 2), float(rng.uniform(-np.pi, np.pi))
            hit = collides(world.support, spec, x, y, yaw)
            if hit.collision or settle(world.support, spec, x, y, yaw).belly_contact:
                continue
            rover = Rover(world, x, y, yaw)
            world.step(DROP_TIME)
            state = rover.state()
            place = settle(world.support, spec, float(state.position[0]), float(state.position[1]), state.yaw)
            rover.remove()
            turn = np.rad2deg([state.roll - place.roll, state.pitch - place.pitch])
            out[done] = np.abs([*turn, state.position[2] - place.pose[2, 3]])
            done += 1
    return out
