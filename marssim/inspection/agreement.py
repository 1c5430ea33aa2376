"""Do two G-buffer makers see the same? Depth, surface ids, and the image shift between them to a hundredth of a pixel.

A maker that is half a pixel off still agrees within 0.5 % of depth on nearly every pixel, so the shift is measured by
itself: the least-squares (u, v) that explains the difference of two images by the reference's own slopes, which are
taken from rays half a pixel to either side. On smooth ground the image is 1 / Z, which is linear on planes; at
silhouettes it is 1 or 0, whether a pixel shows a rock or ground, and whether it shows sky. On planes of known tilt the
reference is their closed form. PyBullet's depth is made exact after it is drawn, so that its G-buffer has no shift on
smooth ground whatever was drawn; there and on planes the depth is looked at as it was drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import GROUND, SKY
from marssim.render.geometry.gbuffer import GBuffer
from marssim.render.renderers.renderer import Renderer

STEP = 0.5  # [px] of the rays beside a pixel's centre
BEND = 0.05  # change of 1 / Z within a pixel, relative, from which a pixel is no smooth ground
DEPTH_TOLERANCE = 5e-3
LEAST_SURFACE, LEAST_DEPTH, MOST_SHIFT = 0.99, 0.99, 0.05

Shifted = Callable[[float, float], np.ndarray]


@dataclass(frozen=True)
class Agreement:
    """surface: share of pixels of the same surface id; depth: share within 0.5 % of depth, of those that both see; each
    of the view that agrees least. smooth, silhouette: (2,) shift in u and v [px] over all views together, NaN where no
    pixel tells."""

    views: int
    surface: float
    depth: float
    smooth: np.ndarray
    silhouette: np.ndarray

    @property
    def good(self) -> bool:
        """99 % of the pixels of each view agree in surface and depth, and no shift reaches 0.05 px."""
        shift = np.concatenate([self.smooth, self.silhouette])
        return self.surface >= LEAST_SURFACE and self.depth >= LEAST_DEPTH and small(shift)

    def report(self) -> dict[str, Any]:
        """Plain numbers, for JSON; None for a shift that no pixel tells."""
        shifts = {"smooth_px": self.smooth, "silhouette_px": self.silhouette}
        plain = {name: [None if np.isnan(v) else float(v) for v in shift] for name, shift in shifts.items()}
        return {"views": self.views, "surface": self.surface, "depth": self.depth, **plain, "good": self.good}


def small(shift: np.ndarray) -> bool:
    """Is a shift (N,) [px] known, and too small to matter?"""
    return bool((np.abs(shift) < MOST_SHIFT).all())


class ShiftFit:
    """Normal equations of the shift, added up over images."""

    def __init__(self) -> None:
        self.matrix, self.right = np.zeros((2, 2)), np.zeros(2)

    def add(self, image: np.ndarray, reference: Shifted, where: np.ndarray) -> None:
        """image: (H, W); reference(du, dv): (H, W), what it is held against, seen (du, dv) [px] beside the centres."""
        slope = [reference(STEP * du, STEP * dv) - reference(-STEP * du, -STEP * dv) for du, dv in ((1, 0), (0, 1))]
        system = np.stack([s[where] for s in slope], axis=1) / (2 * STEP)
        self.matrix += system.T @ system
        self.right += system.T @ (image - reference(0, 0))[where]

    @property
    def shift(self) -> np.ndarray:
        """(2,) [px] in u and v; NaN if the images have no slope to tell it by."""
        if np.linalg.matrix_rank(self.matrix) < 2:
            return np.full(2, np.nan)
        return np.linalg.solve(self.matrix, self.right)


class BesideCentres:
    """Depth and surface of a view, looked up along rays (du, dv) [px] beside the pixel centres, each traced once."""

    def __init__(self, tracer: Renderer, camera: PinholeCamera, pose: np.ndarray) -> None:
        self._tracer, self._camera, self._pose = tracer, camera, pose
        self._seen: dict[tuple[float, float], tuple[np.ndarray, np.ndarray]] = {}

    def _at(self, du: float, dv: float) -> tuple[np.ndarray, np.ndarray]:
        if (du, dv) not in self._seen:
            camera = self._camera
            rays = camera.rays() + np.array([du / camera.fx, dv / camera.fy, 0])
            depth, _, _, surface = self._tracer.trace(rays.reshape(-1, 3), self._pose)
            shape = (camera.height, camera.width)
            self._seen[du, dv] = depth.reshape(shape), surface.reshape(shape)
        return self._seen[du, dv]

    def inverse_depth(self, du: float, dv: float) -> np.ndarray:
        """(H, W) 1 / Z, 0 in the sky."""
        return 1 / self._at(du, dv)[0].astype(float)

    def rock(self, du: float, dv: float) -> np.ndarray:
        """(H, W) 1 where a rock is seen."""
        return (self._at(du, dv)[1] > GROUND).astype(float)

    def sky(self, du: float, dv: float) -> np.ndarray:
        """(H, W) 1 where the sky is seen."""
        return (self._at(du, dv)[1] == SKY).astype(float)

    def smooth(self) -> np.ndarray:
        """(H, W) bool: ground without an edge between this pixel and its neighbours' middle."""
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
class Draws(Protocol):
    """A maker whose G-buffer is more exact than what it draws."""

    def drawn(self, camera: PinholeCamera, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Depth (H, W) [m] as drawn, arbitrary in the sky, and (H, W) SKY, GROUND, or another number for rocks."""


@dataclass
class _Tally:
    """What is added up over the views of one maker."""

    surface: list[float] = field(default_factory=list)
    depth: list[float] = field(default_factory=list)
    smooth: ShiftFit = field(default_factory=ShiftFit)
    silhouette: ShiftFit = field(default_factory=ShiftFit)

    def add(
        self, maker: Renderer, shot: GBuffer, beside: BesideCentres, camera: PinholeCamera, pose: np.ndarray
    ) -> None:
        seen = maker.render(camera, pose)
        both = seen.hit & shot.hit
        self.surface.append(float((seen.surface == shot.surface).mean()))
        close = np.abs(seen.depth[both] / shot.depth[both] - 1) < DEPTH_TOLERANCE
        self.depth.append(float(close.mean()) if len(close) else 1.0)
        depth, surface = raw_depth(maker, seen, camera, pose)
        where = beside.smooth() & (surface == GROUND)
        self.smooth.add(1 / np.where(where, depth, 1), beside.inverse_depth, where)
        everywhere = np.ones(both.shape, dtype=bool)
        self.silhouette.add((seen.surface > GROUND).astype(float), beside.rock, everywhere)
        self.silhouette.add((seen.surface == SKY).astype(float), beside.sky, everywhere)


def raw_depth(maker: Renderer, seen: GBuffer, camera: PinholeCamera, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth (H, W) float64 and surface (H, W), as drawn where the maker draws; seen: what it rendered of the view."""
    return maker.drawn(camera, pose) if isinstance(maker, Draws) else (seen.depth.astype(float), seen.surface)


def agreements(
    makers: Mapping[str, Renderer], tracer: Renderer, camera: PinholeCamera, poses: Iterable[np.ndarray]
) -> dict[str, Agreement]:
    """Hold what each maker renders against `tracer`'s rays, over all poses (4, 4) camera to world together."""
    tallies = {name: _Tally() for name in makers}
    for pose in poses:
        shot, beside = tracer.render(camera, pose), BesideCentres(tracer, camera, pose)
        for name, maker in makers.items():
            tallies[name].add(maker, shot, beside, camera, pose)
    return {
        name: Agreement(
            len(tally.depth), min(tally.surface, default=0.0), min(tally.depth, default=0.0), tally.smooth.shift,
            tally.silhouette.shift,
        )
        for name, tally in tallies.items()
    }  # fmt: skip
