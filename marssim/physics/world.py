"""A Scene as PyBullet collision geometry.

Ground: a heightfield. Rocks: two compounds of convex hulls, those that can be driven over apart from those that block,
so that a contact says which kind it is. Friction is Coulomb's, the product of ground's and wheels' coefficients.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from functools import cached_property

import numpy as np

from marssim.base.rover_spec import ZHURONG, RoverSpec
from marssim.engines.bullet import import_pybullet
from marssim.physics.support import SupportMap, coarse_faces, split_rocks
from marssim.scene.scene import Scene

GRAVITY = 3.72076  # [m/s2]
GROUND_FRICTION = 1.0
GROUND_CELL = 0.10  # [m] coarsest grid that ground is thinned to; what the eyes see of a course, the wheels feel
MAX_NODES = 260  # [per side] above which the ground is thinned: 341 take 0.4 s to build, and time grows as the square
SOLVER_ITERATIONS = 16  # Bullet's 50 change no drive here by more than a millimetre a metre, and cost a third more
WATCH_EVERY = 8  # steps between two calls of the watchers


class PhysicsWorld:
    """One PyBullet client with a scene's ground and rocks in it; use as a context manager, or close() it.

    Rocks of less than 0.10 m diameter are left out; the others keep 42 or, from 0.2 m on, 162 vertices. Around the
    fine square the world ends: there is no ground.
    """

    def __init__(self, scene: Scene, spec: RoverSpec = ZHURONG, time_step: float = 1 / 240) -> None:
        """Raises ImportError, in one line, where PyBullet is missing; ValueError for a time step that is no length."""
        if not (np.isfinite(time_step) and 0 < time_step <= 0.02):
            raise ValueError(f"time_step must lie in (0, 0.02] s, got {time_step}")
        self.scene, self.spec, self.time_step = scene, spec, time_step
        self.time = 0.0  # [s] simulated
        self.bullet = import_pybullet()
        self.client = self.bullet.connect(self.bullet.DIRECT)
        self._steps_owed, self._resting = 0.0, False
        self._watchers: list[Callable[[], bool]] = []
        self._feelers: list[Callable[[], None]] = []
        try:
            self._build()
        except BaseException:
            self.close()
            raise

    def step(self, seconds: float) -> None:
        """Advance by that time; what is less than a step is carried over to the next call.

        While every watcher says that it rests, time passes but nothing is computed.
        """
        if self.client < 0:
            raise RuntimeError("this PhysicsWorld is closed")
        self._steps_owed += seconds / self.time_step
        count = int(np.floor(self._steps_owed + 1e-6))
        self._steps_owed -= count
        advance, client = self.bullet.stepSimulation, self.client
        while count > 0:
            batch = min(count, WATCH_EVERY)
            if not self._resting:
                for _ in range(batch):
                    advance(physicsClientId=client)
                    for feel in self._feelers:
                        feel()
            self.time += batch * self.time_step
            count -= batch
            self.look()

    def look(self) -> None:
        """Ask the watchers now; to be called when one of them has been given something to do."""
        answers = [watch() for watch in self._watchers]  # all are asked, whatever the first one says
        self._resting = bool(answers) and all(answers)

    def watch(self, callback: Callable[[], bool], feel: Callable[[], None]) -> None:
        """Call both back from now on: `callback` every few steps, which returns whether what it watches is at rest for
        good; `feel` after every single one, so that the shortest contact is noticed."""
        self._watchers.append(callback)
        self._feelers.append(feel)
        self._resting = False

    def unwatch(self, callback: Callable[[], bool], feel: Callable[[], None]) -> None:
        """Call them back no more. Raises ValueError if they were not watching."""
        self._watchers.remove(callback)
        self._feelers.remove(feel)

    @cached_property
    def support(self) -> SupportMap:
        """The same scene as rasters, for putting a rover down."""
        return SupportMap.of(self.scene, self.spec.obstacle_height)

    def close(self) -> None:
        """Free the client; a second call does nothing."""
        if self.client >= 0:
            self.bullet.resetSimulation(physicsClientId=self.client)
            self.bullet.disconnect(physicsClientId=self.client)
            self.client = -1
        self._watchers.clear()
        self._feelers.clear()

    def __enter__(self) -> PhysicsWorld:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _build(self) -> None:
        p, client = self.bullet, self.client
        p.setGravity(0, 0, -GRAVITY, physicsClientId=client)
        p.setPhysicsEngineParameter(
            fixedTimeStep=self.time_step, numSubSteps=0, numSolverIterations=SOLVER_ITERATIONS,
            deterministicOverlappingPairs=1, enableFileCaching=0, physicsClientId=client,
        )  # fmt: skip
        self._add_ground()
        climbable, blocking = split_rocks(self.scene, self.spec.obstacle_height)
        self._add_rocks(climbable)
        self.obstacles = self._add_rocks(blocking)  # PyBullet's bodies of the rocks that block, one or none

    def _add_ground(self) -> int:
        fine = self.scene.terrain.fine
        heights, cell = fine.heights, fine.cell
        if max(heights.shape) > MAX_NODES:
            stride = max(1, int(GROUND_CELL / cell + 1e-6))
            while any((n - 1) % stride for n in heights.shape):
                stride -= 1  # the last row and column must stay
            heights, cell = heights[::stride, ::stride], cell * stride
        ny, nx = heights.shape
        shape = self.bullet.createCollisionShape(
            self.bullet.GEOM_HEIGHTFIELD, meshScale=[cell, cell, 1.0], heightfieldData=heights.ravel().tolist(),
            numHeightfieldRows=nx, numHeightfieldColumns=ny, physicsClientId=self.client,
        )  # fmt: skip
        # Bullet centres a heightfield on its box: in z on the middle between lowest and highest.
        x0, y0, x1, y1 = fine.bounds
        middle = [(x0 + x1) / 2, (y0 + y1) / 2, float(heights.min() + heights.max()) / 2]
        return self._static(shape, middle)

    def _add_rocks(self, members: np.ndarray) -> list[int]:
        """One body, a compound of each rock's convex hull.

        Rocks are all but convex. A concave mesh of the same faces is slower, and PyBullet never frees its vertices.
        """
        if len(members) == 0:
            return []
        text, count = [], 1
        for member in members:
            used, index = np.unique(coarse_faces(self.scene.rocks, np.array([member])), return_inverse=True)
            points, corners = self.scene.rocks.vertices[used], index.reshape(-1, 3) + count
            text.append(f"o rock{member}\n" + "v %.4f %.4f %.4f\n" * len(used) % tuple(points.ravel().tolist()))
            text.append("f %d %d %d\n" * len(corners) % tuple(corners.ravel().tolist()))
            count += len(used)
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "rocks.obj")  # PyBullet makes compounds of hulls from files only
            with open(path, "w", encoding="utf-8") as file:
                file.writelines(text)
            shape = self.bullet.createCollisionShape(self.bullet.GEOM_MESH, fileName=path, physicsClientId=self.client)
        return [self._static(shape, [0, 0, 0])]

    def _static(self, shape: int, position: list[float]) -> int:
        # without a visual shape PyBullet would draw the collision shape, and read its file again for that
        speck = self.bullet.createVisualShape(self.bullet.GEOM_SPHERE, radius=1e-3, physicsClientId=self.client)
        body = self.bullet.createMultiBody(0, shape, speck, basePosition=position, physicsClientId=self.client)
        self.bullet.changeDynamics(
            body, -1, lateralFriction=GROUND_FRICTION, restitution=0, physicsClientId=self.client
        )
        return body
