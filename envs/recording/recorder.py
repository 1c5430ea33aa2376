"""Records a drive step by step, for a file that shows why it went as it did (marssim.base.dataset.drive_file)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import cv2
import numpy as np

from envs.drivers.builtin import NavigatorDriver
from envs.drivers.driver import Driver
from envs.drives.episodes import Cause, EpisodeRecord, Watch
from envs.mars_nav import STEP_SECONDS, MarsNavEnv
from envs.recording.failure_cause import TrueDepthMap
from envs.world.look_scores import look_abs_rel, scored_pixels
from envs.world.perception import Sight
from envs.world.referee import DRIVING
from m3depth.evaluation.metrics import capped_depth
from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.dataset.drive_file import (
    FULL_COST,
    MAP_CODES,
    depth_codes,
    encode_drive,
    error_codes,
    height_codes,
    picture_name,
)
from marssim.base.files.png import encode_png
from nav.navigator import Navigator
from nav.path.candidates import Candidates
from nav.reason import reason_of

PIXELS = 128  # along a row of depth, confidence and error, roughly: every n-th of the left eye
THUMBNAIL, QUALITY = 192, 62  # [px] side of a picture of an eye, and its quality as JPEG
MAP_METRES = 24.0  # [m] side of the map around the rover
COST_LEVELS = 25  # levels of the cost on the recorded map; fewer make smaller files
MERGED = 2  # cells of the navigator's map along one of the recorded map
NOT_DECIDED: dict[str, Any] = {
    "action": None, "command": None, "status": None, "reason": None, "risk_level": 0, "map": None, "path": None,
    "candidates": None, "chosen": None,
}  # fmt: skip


class Recorder:
    """Records a drive while it goes on.

    Give `watch` to envs.drives.episodes.run_episode, then ask for the file. It draws nothing from the environment's
    random streams that the drive depends on.

    Attributes:
        cause: Why the drive failed; None before its end, for a drive that reached the goal, and for a driver that is
            not the navigator.
    """

    def __init__(self, then: Watch | None = None) -> None:
        """Start with nothing recorded.

        Args:
            then: Another Watch, called after each record.
        """
        self._then = then
        self._steps: list[dict[str, Any]] = []
        self._pictures: dict[str, bytes] = {}
        self._rover: dict[str, float] = {}
        self._rig: StereoRig | None = None
        self._area: list[float] = []
        self._true_map: TrueDepthMap | None = None
        self.cause: Cause | None = None

    def watch(self, env: MarsNavEnv, driver: Driver, step: int) -> None:
        """Record a step.

        Args:
            env: The environment.
            driver: The driver.
            step: Number of the step.
        """
        if self._steps:
            self._steps[-1].update(self._decision(env, driver, len(self._steps) - 1))
        if step == len(self._steps):
            spec = env.rover_spec
            self._rover = {
                "length": spec.length, "width": spec.width, "max_speed": spec.max_speed,
                "max_yaw_rate": spec.max_yaw_rate, "pan_limit": spec.mount.pan_limit,
            }  # fmt: skip
            assert env.course is not None
            self._area = [*env.course.area]
            self._steps.append({**self._standing(env), **NOT_DECIDED})
            if env.gaze.fresh:
                assert env.sight is not None
                self._look(env, env.sight, step)
        else:  # the driver ended the drive
            self._steps[-1].update(action=None, outcome=env.outcome)
        if isinstance(driver, NavigatorDriver):
            self._true_map = self._true_map or TrueDepthMap(driver.navigator)
            if env.outcome == DRIVING:
                self._true_map.see(env)
            else:
                self.cause = self._true_map.cause(env)
        if self._then:
            self._then(env, driver, step)

    def drive_file(self, record: EpisodeRecord, settings: Mapping[str, Any]) -> bytes:
        """Return the content of the drive's file.

        Args:
            record: The record of the episode, with its cause.
            settings: The settings of the evaluation.
        """
        assert self._rig is not None
        content = {
            "episode": asdict(record), "settings": dict(settings), "step_seconds": STEP_SECONDS, "rover": self._rover,
            "rig": self._rig.to_dict(), "area": self._area, "steps": self._steps,
        }  # fmt: skip
        return encode_drive(content, self._pictures)

    def _standing(self, env: MarsNavEnv) -> dict[str, Any]:
        """Return where the rover stands, and what its last motion met."""
        assert env.vehicle is not None and env.course is not None and env.sight is not None
        state, contacts = env.vehicle.state(), env.vehicle.contacts()
        error = look_abs_rel(env.sight) if env.gaze.fresh else None
        return {
            "pose": _rows(state.pose), "believed_pose": _rows(env.believed_pose),
            "tilt_deg": round(float(np.rad2deg(state.tilt)), 2),
            "distance": round(float(np.hypot(*(env.course.goal - state.position[:2]))), 3),
            "way": round(env.way.length, 3), "clearance": round(env.way.clearance, 3),
            "contact": "chassis" if contacts.chassis else "obstacle" if contacts.obstacle else "none",
            "pan": round(env.gaze.pan, 4), "looked": env.gaze.fresh,
            "abs_rel": None if error is None else round(error, 5), "outcome": env.outcome,
        }  # fmt: skip

    def _look(self, env: MarsNavEnv, sight: Sight, step: int) -> None:
        """Keep the pictures of a look."""
        left, right = sight.left, sight.right
        if left is None or right is None:  # the perception is the ground truth, and took no picture
            picture = env.perception.picture(sight.pose)
            left, right = picture.left, picture.right
        for layer, image in (("left", left), ("right", right)):
            self._pictures[picture_name(layer, step)] = _thumbnail(image)
        part, self._rig = _sampled(sight.rig)
        depth, truth = sight.depth[part], sight.true_depth
        layers = {"depth": depth_codes(depth), "confidence": np.round(sight.confidence[part] * 255).astype(np.uint8)}
        if truth is not None and truth is not sight.depth:
            layers["error"] = error_codes(capped_depth(depth), truth[part], scored_pixels(sight)[part])
        for layer, codes in layers.items():
            self._pictures[picture_name(layer, step)] = encode_png(codes, (cv2.IMWRITE_PNG_COMPRESSION, 9))

    def _decision(self, env: MarsNavEnv, driver: Driver, step: int) -> dict[str, Any]:
        """Return what the driver decided at a step, and keep the map that it decided on."""
        decision: dict[str, Any] = {"action": [round(float(value), 4) for value in env.last_action]}
        if not isinstance(driver, NavigatorDriver) or driver.command is None:
            return decision
        navigator, command = driver.navigator, driver.command
        decision |= {
            "command": {
                "speed": round(command.speed, 4), "yaw_rate": round(command.yaw_rate, 4),
                "pan": None if command.pan is None else round(command.pan, 4),
            },
            "status": command.status, "reason": reason_of(navigator, command), "risk_level": navigator.risk.level,
        }  # fmt: skip
        if navigator.ground is not None:
            middle = np.array(self._steps[step]["believed_pose"])[:2, 3]
            layers, place = _reduced_map(navigator, middle)
            if not self._steps[step]["looked"]:
                layers.pop("height")  # it changes with a look, and is the larger part of the map
            for layer, codes in layers.items():
                self._pictures[picture_name(layer, step)] = encode_png(codes, (cv2.IMWRITE_PNG_COMPRESSION, 9))
            path = navigator.planner.field.path(middle, MAP_METRES)
            decision |= {"map": place, "path": _rounded(path, 2)}
        if navigator.planner.considered is not None:
            considered = navigator.planner.considered
            chosen = None if navigator.motion is None else int(considered.cost.argmin())
            decision |= {"candidates": _listed(considered), "chosen": chosen}
        return decision


def _rows(pose: np.ndarray) -> list[list[float]]:
    """Return the upper three rows of a pose."""
    return _rounded(np.asarray(pose)[:3], 5)


def _rounded(values: np.ndarray, digits: int) -> list[list[float]]:
    return [[round(float(value), digits) for value in row] for row in values]


def _thumbnail(image: np.ndarray) -> bytes:
    """Return an image (H, W, 3) as a small JPEG."""
    small = cv2.resize(image, (THUMBNAIL, THUMBNAIL), interpolation=cv2.INTER_AREA)
    bgr = np.ascontiguousarray(small[..., ::-1])
    return cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, QUALITY))[1].tobytes()


def _sampled(rig: StereoRig) -> tuple[tuple[slice, slice], StereoRig]:
    """Return which pixels of an image are kept, some PIXELS along a row, and the cameras of them."""
    c = rig.camera
    n = max(1, c.width // PIXELS)
    first = n // 2
    part = slice(first, None, n)
    rows, columns = len(range(c.height)[part]), len(range(c.width)[part])
    camera = PinholeCamera(columns, rows, c.fx / n, c.fy / n, (c.cx - first) / n, (c.cy - first) / n)
    return (part, part), replace(rig, camera=camera)


def _reduced_map(navigator: Navigator, middle: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Return the judged ground around a place as MAP_CODES and its heights as codes (n, n), and where they lie."""
    ground, elevation = navigator.ground, navigator.map
    assert ground is not None
    cell = elevation.config.cell
    cells = round(MAP_METRES / cell / MERGED) * MERGED
    x, y = elevation.cell_of(middle) - cells // 2
    free, costly = MAP_CODES["free"], MAP_CODES["costly"]
    share = np.clip(np.nan_to_num(ground.cost) / FULL_COST, 0, 1)
    code = np.where(
        ground.known,
        np.round(free + (costly - free) * np.round(share * COST_LEVELS) / COST_LEVELS),
        MAP_CODES["unknown"],
    )
    code = np.where(ground.inflated & ground.known, MAP_CODES["too_near"], code)
    code = np.where(ground.blocked, MAP_CODES["blocked"], code).astype(np.uint8)
    height = height_codes(np.where(elevation.measured, elevation.top, np.nan))

    def merged(codes: np.ndarray) -> np.ndarray:
        """Return the highest codes of the cells around the place, north up."""
        around = np.pad(codes, cells)[y + cells : y + 2 * cells, x + cells : x + 2 * cells]
        return around.reshape(cells // MERGED, MERGED, cells // MERGED, MERGED).max(axis=(1, 3))[::-1]

    west, south = (round(float(value), 3) for value in elevation.origin + cell * np.array([x, y]))
    place = {"west": west, "south": south, "cell": cell * MERGED, "cells": cells // MERGED}
    return {"map": merged(code), "height": merged(height)}, place


def _listed(candidates: Candidates) -> dict[str, Any]:
    """Return candidates as drive.json has them."""

    def numbers(values: np.ndarray) -> list[float]:
        return [round(float(value), 4) for value in values]  # infinite ones become null

    free = np.isfinite(candidates.cost)
    parts = {name: numbers(np.where(free, part, 0)) for name, part in candidates.parts.items()}
    names = ("curvature", "turn", "free", "end", "cost")
    return {**{name: numbers(getattr(candidates, name)) for name in names}, "parts": parts}
