"""Measure how well two renderers agree in depth, surface ids and image position, the last to a hundredth of a pixel.

A renderer that is half a pixel off still agrees within 0.5 % of depth on nearly every pixel, so the image shift is
measured separately: it is the (u, v) that explains the difference of two images best, in least squares, by the slopes
of the reference, which come from rays half a pixel to either side. On smooth ground the image is 1 / Z, which is linear
on planes. At silhouettes it is 1 or 0: whether a pixel shows a rock, and whether it shows the sky. On planes of known
tilt the reference is their closed form (tilted_planes.py).

PyBullet's depth is corrected after it is drawn, so that its G-buffer would show no shift on smooth ground whatever was
drawn. On planes its depth is therefore compared as it was drawn. On ground it cannot be: PyBullet draws flat triangles,
without the relief.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND, SKY
from marssim.render.geometry.gbuffer import Footprint, GBuffer
from marssim.render.renderers.renderer import Renderer

STEP = 0.5  # distance of the rays beside a pixel's centre [px]
BEND = 0.05  # relative change of 1 / Z within a pixel above which the pixel is not smooth ground
DEPTH_TOLERANCE = 5e-3  # relative difference up to which two depths agree
LEAST_SURFACE = 0.99  # least share of pixels of the same surface id
LEAST_DEPTH = 0.99  # least share of pixels whose depths agree
MOST_SHIFT = 0.05  # shift from which two renderers disagree [px]

ShiftedImage = Callable[[float, float], np.ndarray]  # returns an image as seen (du, dv) beside pixel centres [px]


@dataclass(frozen=True)
class Agreement:
    """How well a renderer agrees with the reference."""

    views: int
    """Number of views."""
    surface: float
    """Share of pixels of the same surface id, in the view that agrees least."""
    depth: float
    """Share of pixels within 0.5 % of depth, of those where both hit a surface, in the view that agrees least."""
    smooth: np.ndarray
    """(2,) shift in u and v on smooth ground, over all views [px]; NaN if no pixel determines it."""
    silhouette: np.ndarray
    """(2,) shift in u and v at silhouettes, over all views [px]; NaN if no pixel determines it."""

    @property
    def good(self) -> bool:
        """Whether 99 % of the pixels of each view agree in surface and depth, and no shift reaches 0.05 px."""
        shift = np.concatenate([self.smooth, self.silhouette])
        return self.surface >= LEAST_SURFACE and self.depth >= LEAST_DEPTH and small(shift)

    def report(self) -> dict[str, Any]:
        """Return plain numbers, for JSON; None for a shift that no pixel determines."""
        shifts = {"smooth_px": self.smooth, "silhouette_px": self.silhouette}
        plain = {name: [None if np.isnan(v) else float(v) for v in shift] for name, shift in shifts.items()}
        return {"views": self.views, "surface": self.surface, "depth": self.depth, **plain, "good": self.good}


def small(shift: np.ndarray) -> bool:
    """Return whether all shifts (N,) [px] are known and less than 0.05 px."""
    return bool((np.abs(shift) < MOST_SHIFT).all())


class ShiftFit:
    """Least-squares fit of the image shift, summed over images."""

    def __init__(self) -> None:
        self.matrix, self.right = np.zeros((2, 2)), np.zeros(2)

    def add(self, image: np.ndarray, reference: ShiftedImage, where: np.ndarray) -> None:
        """Add an image to the fit.

        Args:
            image: (H, W) the image that may be shifted.
            reference: Returns the reference (H, W), seen (du, dv) beside the pixel centres [px].
            where: (H, W) bool, the pixels that count.
        """
        slope = [reference(STEP * du, STEP * dv) - reference(-STEP * du, -STEP * dv) for du, dv in ((1, 0), (0, 1))]
        system = np.stack([s[where] for s in slope], axis=1) / (2 * STEP)
        self.matrix += system.T @ system
        self.right += system.T @ (image - reference(0, 0))[where]

    @property
    def shift(self) -> np.ndarray:
        """(2,) shift in u and v [px]; NaN if the images have no slope that determines it."""
        if np.linalg.matrix_rank(self.matrix) < 2:
            return np.full(2, np.nan)
        return np.linalg.solve(self.matrix, self.right)


class BesideCentres:
    """Depth and surface of a view along rays beside the pixel centres. Each offset (du, dv) [px] is traced once."""

    def __init__(self, tracer: Renderer, camera: PinholeCamera, pose: np.ndarray) -> None:
        self._tracer, self._camera, self._pose = tracer, camera, pose
        self._traced: dict[tuple[float, float], tuple[np.ndarray, np.ndarray]] = {}

    def _at(self, du: float, dv: float) -> tuple[np.ndarray, np.ndarray]:
        if (du, dv) not in self._traced:
            camera = self._camera
            rays = camera.rays() + np.array([du / camera.fx, dv / camera.fy, 0])
            hits = self._tracer.trace(
                rays.reshape(-1, 3), self._pose, Footprint.from_camera(camera, self._pose), sunlit=False
            )
            shape = (camera.height, camera.width)
            self._traced[du, dv] = hits.depth.reshape(shape), hits.surface.reshape(shape)
        return self._traced[du, dv]

    def inverse_depth(self, du: float, dv: float) -> np.ndarray:
        """Return 1 / Z (H, W) [1/m], which is 0 in the sky. du, dv: offset from the pixel centres [px]."""
        return 1 / self._at(du, dv)[0].astype(float)

    def rock(self, du: float, dv: float) -> np.ndarray:
        """Return an image (H, W) that is 1 on rocks and 0 elsewhere. du, dv: offset from the pixel centres [px]."""
        return (self._at(du, dv)[1] > GROUND).astype(float)

    def sky(self, du: float, dv: float) -> np.ndarray:
        """Return an image (H, W) that is 1 in the sky and 0 elsewhere. du, dv: offset from the pixel centres [px]."""
        return (self._at(du, dv)[1] == SKY).astype(float)

    def smooth(self) -> np.ndarray:
        """Return where the pixel (H, W) shows ground without an edge inside it."""
        middle = self.inverse_depth(0, 0)
        beside = [self._at(*at) for at in ((STEP, 0), (-STEP, 0), (0, STEP), (0, -STEP))]
        ground = self._at(0, 0)[1] == GROUND
        bend = np.zeros(middle.shape)
        for depth, surface in beside:
            ground &= surface == GROUND
            bend += np.abs(1 / depth - middle)
        with np.errstate(divide="ignore", invalid="ignore"):
            return ground & (bend / middle < BEND)


@runtime_checkable
class DrawingRenderer(Protocol):
    """A renderer that draws a picture and then corrects its depth."""

    def drawn(self, camera: PinholeCamera, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return depth and surface of a view as drawn.

        Args:
            camera: The camera.
            pose: (4, 4) camera to world.

        Returns:
            Depth (H, W) [m], arbitrary in the sky, and surface (H, W): SKY, GROUND, or another number on rocks.
        """


@dataclass
class _AgreementSums:
    """The shares of each view of one renderer, and the fits of its shifts over all views."""

    surface: list[float] = field(default_factory=list)
    depth: list[float] = field(default_factory=list)
    smooth: ShiftFit = field(default_factory=ShiftFit)
    silhouette: ShiftFit = field(default_factory=ShiftFit)

    def add(
        self, renderer: Renderer, expected: GBuffer, beside: BesideCentres, camera: PinholeCamera, pose: np.ndarray
    ) -> None:
        """Add a view.

        Args:
            renderer: The renderer.
            expected: The view as the reference renders it.
            beside: The view as the reference sees it beside the pixel centres.
            camera: The camera of the view.
            pose: (4, 4) camera to world.
        """
        view = renderer.render(camera, pose)
        both = view.hit & expected.hit
        self.surface.append(float((view.surface == expected.surface).mean()))
        close = np.abs(view.depth[both] / expected.depth[both] - 1) < DEPTH_TOLERANCE
        self.depth.append(float(close.mean()) if len(close) else 1.0)
        where = beside.smooth() & (view.surface == GROUND)
        self.smooth.add(1 / np.where(where, view.depth, 1).astype(float), beside.inverse_depth, where)
        everywhere = np.ones(both.shape, dtype=bool)
        self.silhouette.add((view.surface > GROUND).astype(float), beside.rock, everywhere)
        self.silhouette.add((view.surface == SKY).astype(float), beside.sky, everywhere)

    def agreement(self) -> Agreement:
        """Return the agreement over all views."""
        least_surface, least_depth = min(self.surface, default=0.0), min(self.depth, default=0.0)
        return Agreement(len(self.depth), least_surface, least_depth, self.smooth.shift, self.silhouette.shift)


def raw_depth(
    renderer: Renderer, view: GBuffer, camera: PinholeCamera, pose: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return depth and surface of a view before any correction.

    Args:
        renderer: The renderer.
        view: What it rendered of the view.
        camera: The camera of the view.
        pose: (4, 4) camera to world.

    Returns:
        Depth (H, W) float64 [m] and surface (H, W), as drawn if the renderer is one that draws.
    """
    if isinstance(renderer, DrawingRenderer):
        return renderer.drawn(camera, pose)
    return view.depth.astype(float), view.surface


def agreements(
    renderers: Mapping[str, Renderer], tracer: Renderer, camera: PinholeCamera, poses: Iterable[np.ndarray]
) -> dict[str, Agreement]:
    """Compare renderers with the rays of a reference.

    Args:
        renderers: The renderers of one scene, by name.
        tracer: The reference, a renderer of the same scene.
        camera: The camera of all views.
        poses: (4, 4) camera to world, of each view.

    Returns:
        The agreement of each renderer over all views.
    """
    sums = {name: _AgreementSums() for name in renderers}
    for pose in poses:
        expected, beside = tracer.render(camera, pose), BesideCentres(tracer, camera, pose)
        for name, renderer in renderers.items():
            sums[name].add(renderer, expected, beside, camera, pose)
    return {name: part.agreement() for name, part in sums.items()}
