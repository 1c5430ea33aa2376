"""Compare all renderers with Embree's rays, on random views of a scene and on tilted planes."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.command.progress import watched
from marssim.engines.bullet import import_pybullet
from marssim.engines.egl import probe
from marssim.inspection.agreement import Agreement, agreements, small
from marssim.inspection.tilted_planes import plane_shift
from marssim.render.renderers.by_name import make_renderer
from marssim.render.renderers.renderer import Renderer
from marssim.scene.scene import Scene, SceneConfig, build_scene
from marssim.scene.viewpoint import ViewConfig, draw_pose

REFERENCE = "embree"  # the renderer that the others are compared with


@dataclass(frozen=True)
class RendererCheck:
    """How well one renderer agrees with Embree and with tilted planes."""

    views: Agreement | None
    """Agreement with Embree on random views; None for Embree itself."""
    planes: np.ndarray
    """(2,) shift in u and v on tilted planes [px]; NaN where they do not determine it."""

    @property
    def good(self) -> bool:
        """Whether the views agree (see Agreement.good) and no shift on planes reaches 0.05 px."""
        return (self.views is None or self.views.good) and small(self.planes)

    def report(self) -> dict[str, Any]:
        """Return plain numbers, for JSON."""
        views = {} if self.views is None else self.views.report()
        return {**views, "planes_px": [None if np.isnan(v) else float(v) for v in self.planes], "good": self.good}


def cross_check(
    place: SceneConfig, seed: int, views: int, camera: PinholeCamera
) -> tuple[dict[str, RendererCheck], list[str]]:
    """Compare all renderers that work here.

    Args:
        place: The place that the scene is drawn from.
        seed: Seed of the scene and of the views.
        views: Number of views.
        camera: The camera of all views.

    Returns:
        The checks by renderer, Embree last, and a line of text on each renderer that does not work here.
    """
    working, notes = _working_renderers()
    rng = np.random.default_rng(seed)
    scene = build_scene(place, rng)
    poses = [draw_pose(scene, ViewConfig(), rng) for _ in range(views)]
    planes = {name: plane_shift(make, camera) for name, make in working.items()}
    with ExitStack() as stack:
        renderers = {name: stack.enter_context(closing(make(scene))) for name, make in working.items()}
        tracer = renderers.pop(REFERENCE)
        agreement = agreements(renderers, tracer, camera, watched(poses, "view", "cross-check"))
    return {name: RendererCheck(agreement.get(name), planes[name]) for name in working}, notes


def _working_renderers() -> tuple[dict[str, Callable[[Scene], Renderer]], list[str]]:
    """Return a function for each renderer that works here, which makes it of a scene, and a line on each other one."""
    working: dict[str, Callable[[Scene], Renderer]] = {}
    notes = []
    try:
        import_pybullet()
    except ImportError as error:
        notes.append(f"pybullet is left out: {error}")
    else:
        working["pybullet"] = partial(make_renderer, "pybullet")
        egl = probe()
        if egl.works:
            working["pybullet, EGL"] = partial(make_renderer, "pybullet", egl=True)
            notes.append(f"EGL draws with {egl.message}")
        else:
            notes.append(f"pybullet, EGL is left out, since EGL does not work here: {egl.message}")
    working["scan"] = partial(make_renderer, "scan")
    working[REFERENCE] = partial(make_renderer, REFERENCE)
    return working, notes


def table(checks: dict[str, RendererCheck]) -> str:
    """Return the checks as text, a line for each renderer."""
    head = "same surface   depth within 0.5 %   shift (u, v) [px] at silhouettes, on smooth ground, on tilted planes"
    rows = [f"{'':14}   {head}"]
    for name, check in checks.items():
        views = check.views
        shares = f"{'':12}   {'':18}" if views is None else f"{views.surface:12.3%}   {views.depth:18.3%}"
        shifts = [None, None] if views is None else [views.silhouette, views.smooth]
        pairs = "".join(
            f"   {'':17}" if s is None else f"   ({s[0]:+.4f}, {s[1]:+.4f})" for s in [*shifts, check.planes]
        )
        rows.append(f"{name:14}   {shares}{pairs}   {'agrees' if check.good else 'DISAGREES'}")
    return "\n".join(rows)
