"""A Scene as PyBullet collision geometry.

The ground is a heightfield. The rocks are two compounds of convex hulls: those that the rover can drive over and those
that block it, so that a contact tells which kind was touched. Friction is Coulomb's, with the product of the
coefficients of ground and wheels.
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

GRAVITY = 3.72076  # [m/s2] on Mars
GROUND_FRICTION = 1.0  # friction coefficient
GROUND_CELL = 0.10  # [m] coarsest grid spacing of the ground, so that the wheels feel what the cameras see
MAX_NODES = 260  # nodes per side above which the ground is thinned: 341 take 0.4 s, growing with the square
SOLVER_ITERATIONS = 16  # Bullet's 50 change no drive here by more than 1 mm a metre, and cost a third more
WATCH_EVERY = 8  # steps between two checks of whether all that is watched rests


class PhysicsWorld:
    """A PyBullet client with a scene's ground and rocks. Use it as a context manager, or call `close`.

    Rocks, slabs, blocks and fragments with a diameter below 0.10 m are left out. Larger rocks keep 42 vertices, or 162
    from 0.2 m on; slabs and blocks keep all. There is no ground outside the fine square.

    Attributes:
        scene: The scene.
        spec: The rover that the rocks are sorted for.
        time_step: Length of a step [s].
        time: Simulated time [s].
        bullet: The pybullet module.
        client: Id of the client; -1 once closed.
        ground: PyBullet's body of the ground.
        obstacles: PyBullet's bodies of the rocks that block: one or none.
    """

    def __init__(self, scene: Scene, spec: RoverSpec = ZHURONG, time_step: float = 1 / 240) -> None:
        """Build the world.

        Args:
            scene: The scene.
            spec: The rover, whose obstacle_height sorts the rocks.
            time_step: Length of a step [s], above 0 and up to 0.02.

        Raises:
            ImportError: PyBullet is not installed. The message is one line.
            ValueError: The time step is out of range.
        """
        if not (np.isfinite(time_step) and 0 < time_step <= 0.02):
            raise ValueError(f"time_step must lie in (0, 0.02] s, got {time_step}")
        self.scene, self.spec, self.time_step = scene, spec, time_step
        self.time = 0.0
        self.bullet = import_pybullet()
        self.client = self.bullet.connect(self.bullet.DIRECT)
        self._steps_owed, self._resting = 0.0, False
        self._rest_checks: list[Callable[[], bool]] = []
        self._step_callbacks: list[Callable[[], None]] = []
        self._rovers, self._rovers_slip = 0, False
        try:
            self._build()
        except BaseException:
            self.close()
            raise

    def step(self, seconds: float) -> None:
        """Advance the simulation. A remainder of less than a step is carried over to the next call.

        While all that is watched rests, time passes but nothing is computed.

        Args:
            seconds: Time to advance [s].

        Raises:
            RuntimeError: The world is closed.
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
                    for after_step in self._step_callbacks:
                        after_step()
            self.time += batch * self.time_step
            count -= batch
            self.check_rest()

    def check_rest(self) -> None:
        """Ask now whether all that is watched rests. Call it after a body has been given something to do."""
        answers = [is_at_rest() for is_at_rest in self._rest_checks]  # a list, so that every function is called
        self._resting = bool(answers) and all(answers)

    def note_rover(self, slips: bool) -> None:
        """Note that a rover is added. Where it slips, the ground has no friction of its own: the soil pushes it.

        Args:
            slips: Whether its wheels slip.

        Raises:
            ValueError: A rover in this world slips where this one does not, or the other way round.
        """
        if self._rovers and slips != self._rovers_slip:
            raise ValueError("all rovers of one PhysicsWorld slip, or none: give each the same kind of `ground`")
        self._rovers, self._rovers_slip = self._rovers + 1, slips
        self._set_friction()

    def forget_rover(self) -> None:
        """Note that a rover was removed."""
        self._rovers -= 1
        self._set_friction()

    def _set_friction(self) -> None:
        friction = 0.0 if self._rovers and self._rovers_slip else GROUND_FRICTION
        self.bullet.changeDynamics(self.ground, -1, lateralFriction=friction, physicsClientId=self.client)

    def watch(self, is_at_rest: Callable[[], bool], after_step: Callable[[], None]) -> None:
        """Watch a body: call two functions back from now on.

        Args:
            is_at_rest: Called every WATCH_EVERY steps. It returns whether the body has come to rest.
            after_step: Called after every step, so that it notices the shortest contact.
        """
        self._rest_checks.append(is_at_rest)
        self._step_callbacks.append(after_step)
        self._resting = False

    def unwatch(self, is_at_rest: Callable[[], bool], after_step: Callable[[], None]) -> None:
        """Stop calling two functions of `watch` back.

        Args:
            is_at_rest: The first function.
            after_step: The second function.

        Raises:
            ValueError: The functions are not called back.
        """
        self._rest_checks.remove(is_at_rest)
        self._step_callbacks.remove(after_step)

    @cached_property
    def support(self) -> SupportMap:
        """The same scene as rasters, to put a rover down."""
        return SupportMap.from_scene(self.scene, self.spec.obstacle_height)

    def close(self) -> None:
        """Free the client; a second call does nothing."""
        if self.client >= 0:
            self.bullet.resetSimulation(physicsClientId=self.client)
            self.bullet.disconnect(physicsClientId=self.client)
            self.client = -1
        self._rest_checks.clear()
        self._step_callbacks.clear()

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
        self.ground = self._add_ground()
        climbable, blocking = split_rocks(self.scene, self.spec.obstacle_height)
        self._add_rocks(climbable)
        self.obstacles = self._add_rocks(blocking)

    def _add_ground(self) -> int:
        fine = self.scene.terrain.fine
        heights, cell = fine.heights, fine.cell
        if max(heights.shape) > MAX_NODES:
            stride = max(1, int(GROUND_CELL / cell + 1e-6))
            while any((n - 1) % stride for n in heights.shape):
                stride -= 1  # so that the last row and column stay
            heights, cell = heights[::stride, ::stride], cell * stride
        ny, nx = heights.shape
        shape = self.bullet.createCollisionShape(
            self.bullet.GEOM_HEIGHTFIELD, meshScale=[cell, cell, 1.0], heightfieldData=heights.ravel().tolist(),
            numHeightfieldRows=nx, numHeightfieldColumns=ny, physicsClientId=self.client,
        )  # fmt: skip
        # Bullet centres a heightfield on its bounding box: in z, halfway between the lowest and the highest node
        x0, y0, x1, y1 = fine.bounds
        middle = [(x0 + x1) / 2, (y0 + y1) / 2, float(heights.min() + heights.max()) / 2]
        return self._static(shape, middle)

    def _add_rocks(self, members: np.ndarray) -> list[int]:
        """Add one body, a compound of the convex hulls of some rocks; return its id, or nothing without rocks.

        Rocks are nearly convex. A concave mesh of the same faces is slower, and PyBullet never frees its vertices.
        """
        if len(members) == 0:
            return []
        text, count = [], 1
        for member in members:
            used, index = np.unique(coarse_faces(self.scene.bodies, np.array([member])), return_inverse=True)
            points, corners = self.scene.bodies.vertices[used], index.reshape(-1, 3) + count
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
        # without a visual shape PyBullet would draw the collision shape, and read its file once more
        speck = self.bullet.createVisualShape(self.bullet.GEOM_SPHERE, radius=1e-3, physicsClientId=self.client)
        body = self.bullet.createMultiBody(0, shape, speck, basePosition=position, physicsClientId=self.client)
        self.bullet.changeDynamics(
            body, -1, lateralFriction=GROUND_FRICTION, restitution=0, physicsClientId=self.client
        )
        return body
