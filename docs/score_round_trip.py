"""Scores the way of raw pairs to depth against truth: a table of docs/results/depth.md.

    python docs/score_round_trip.py --rig-file rig.json --out out/round_trip

The pairs are rendered as the cameras of the rig take them, written with every calibration that holds its lenses,
rectified with each by m3depth.rectify's function, and predicted. The same scenes are also rendered as a rectified pair
in the view that rectification chose, and predicted likewise. Both are compared with the true depth of that view, at the
pixels that both know. OUT/summary.md has the table, OUT/pairs.jpg a raw image, the rectified one and the rendered one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import tyro

from m3depth.prediction.one_pair import Method, predict_pair, prepare
from m3depth.prediction.options import PredictOptions
from m3depth.rectification.pair import RectifiedPair, fitting, rectify_pair
from m3depth.rectification.raw_image import RawImage, read_raw_pair
from m3depth.rectification.row_errors import fit_rows
from marssim.base.calibration.calibration_files import FORMS
from marssim.base.calibration.orientation import RectifiedView
from marssim.base.calibration.read_pair import read_raw_calibration
from marssim.base.camera import MAX_DEPTH, MIN_DEPTH
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.dataset.sample import RAW
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import write_json
from marssim.generate import generate_dataset
from marssim.generation.config import GenerateConfig, parse_generate
from marssim.generation.scene_views import draw_scene
from marssim.inspection.integrity import CALIBRATION
from marssim.render.geometry.gbuffer import Footprint
from marssim.render.renderers.by_name import make_renderer
from marssim.render.sensor import Sensor
from marssim.render.stereo import light_at_detector
from marssim.render.surfaces.shading import Shader

EXACT = ("--sensor.vertical-offset", 0, 0, "--sensor.rotation-deg", 0, 0)  # what is left of errors of calibration
COLUMNS = {
    "rows_raw_px": "rows of matches, raw", "rows_px": "rectified", "rows_rendered_px": "rendered",
    "rows_fitted_px": "six terms", "abs_rel": "Abs Rel", "abs_rel_rendered": "Abs Rel, rendered pair", "ratio": "ratio",
    "known": "pixels",
}  # fmt: skip
SAME_VIEW = 1e-6  # [px] up to which two views are one


@dataclass(frozen=True)
class Options:
    """Scores the way of raw pairs to depth against truth."""

    rig_file: tuple[Path, ...]
    """Rig file, as marssim.generate takes it."""
    out: Path
    """Folder for the dataset, summary.md, summary.json and pairs.jpg."""
    scenes: int = 6
    """Number of scenes, one pair each, of all places in turn."""
    seed: int = 2301
    """Seed of the scenes."""
    estimator: str = "m3depth"
    """Method that predicts, as m3depth.predict names it."""


@dataclass(frozen=True)
class Rendered:
    """A pair that was rendered in a rectified view.

    Attributes:
        left, right: (H, W, 3) uint8 images.
        depth: (H, W) true depth [m].
        rows: Median distance of the rows of matches [px].
    """

    left: np.ndarray
    right: np.ndarray
    depth: np.ndarray
    rows: float


def main(options: Annotated[Options, tyro.conf.arg(name="")]) -> None:
    """Make the pairs, score each with each calibration, and write the table."""
    flags = ["--out", options.out / "data", "--scene", "mixed", "--pairs", options.scenes, "--views-per-scene", 1]
    flags += ["--seed", options.seed, "--renderer", "scan", "--raw", "--rig-file", *options.rig_file, *EXACT]
    config = parse_generate("score_round_trip", __doc__, [str(flag) for flag in flags])
    dataset = generate_dataset(config)
    predicting = PredictOptions((Path("left"), Path("right")), out=options.out, estimator=options.estimator)
    method = Method.from_options(predicting)
    scores: dict[str, list[dict[str, float]]] = {}
    for number in range(len(dataset)):
        for form, score in _scores(config, dataset, number, predicting, method, options.out):
            scores.setdefault(form, []).append(score)
            print(dataset.names[number], form, score, flush=True)
    write_json(options.out / "summary.json", {"scores": scores, "method": method.record})
    write_atomically(options.out / "summary.md", _table(scores).encode())
    print(_table(scores))


def _scores(
    config: GenerateConfig, dataset: StereoDataset, number: int, predicting: PredictOptions, method: Method, out: Path
) -> list[tuple[str, dict[str, float]]]:
    """Return the scores of one pair with each calibration."""
    folder = dataset.path / "scenes" / dataset.names[number]
    images = read_raw_pair(*(folder / name for name in RAW))
    rendered: tuple[RectifiedView, Rendered, np.ndarray] | None = None
    found = []
    for form, names in FORMS.items():
        files = [dataset.path / CALIBRATION / name for name in names]
        if not files[0].is_file():
            continue
        pair = rectify_pair(*images, fitting(read_raw_calibration(files), *images))
        assert pair.view is not None and pair.matches is not None
        if rendered is None or not _same(rendered[0], pair.view):
            truth = _render(config, dataset, number, pair.view)
            whole = np.ones(truth.depth.shape, bool)
            rendered = pair.view, truth, _depth(truth.left, truth.right, whole, whole, pair, predicting, method)
            _write_example(out / "pairs.jpg", images[0].pixels, pair.left, truth.left)
        _, truth, reference = rendered
        depth = _depth(pair.left, pair.right, pair.left_valid, pair.right_valid, pair, predicting, method)
        scored = (truth.depth >= MIN_DEPTH) & (truth.depth <= MAX_DEPTH) & pair.left_valid
        both = scored & np.isfinite(depth) & np.isfinite(reference)
        error, other = (float(np.abs(z[both] / truth.depth[both] - 1).mean()) for z in (depth, reference))
        fitted = fit_rows(pair.matches.left, pair.matches.right, (config.rig.camera.width, config.rig.camera.height), 6)
        score = {
            "rows_raw_px": pair.matches.before.median, "rows_px": pair.matches.after.median,
            "rows_rendered_px": truth.rows, "rows_fitted_px": np.nan if fitted is None else fitted[0].size,
            "abs_rel": error, "abs_rel_rendered": other, "ratio": error / other, "known": both.sum() / scored.sum(),
        }  # fmt: skip
        found.append((form, {name: round(float(value), 5) for name, value in score.items()}))
    return found


def _render(config: GenerateConfig, dataset: StereoDataset, number: int, view: RectifiedView) -> Rendered:
    """Return the pair of a sample as rendered in a view, with the surface and the detectors of the sample."""
    meta = dataset[number].meta
    scene, pose, sensor = draw_scene(config, meta["scene"]), np.array(meta["pose"]), Sensor(**meta["sensor"])
    renderer, shader = make_renderer(config.renderer, scene), Shader(scene)
    footprint = Footprint.from_camera(config.rig.camera, pose)
    views, light = [], []
    for camera, at in ((view.left, pose), (view.right, config.rig.right_pose(pose))):
        views.append(renderer.render(camera, at, footprint))
        light.append(light_at_detector(renderer, shader, camera, at, views[-1], footprint, sensor.sun_glare))
    renderer.close()
    left, right = sensor.expose_pair(*light, views[0].hit, np.random.default_rng(number))
    whole = np.ones(left.shape[:2], bool)
    matches = rectify_pair(*(RawImage(Path(name), image, whole) for name, image in (("left", left), ("right", right))))
    return Rendered(left, right, views[0].depth, np.nan if matches.matches is None else matches.matches.after.median)


def _depth(
    left: np.ndarray, right: np.ndarray, left_valid: np.ndarray, right_valid: np.ndarray, pair: RectifiedPair,
    predicting: PredictOptions, method: Method,
) -> np.ndarray:  # fmt: skip
    """Return the predicted depth (H, W) [m] of a pair in the view of `pair`."""
    assert pair.calibration is not None
    prepared = prepare(left, right, pair.calibration, predicting, thorough=False)
    prepared = replace(prepared, left_valid=left_valid, right_valid=right_valid)
    return predict_pair(prepared, method, predicting).prediction.depth


def _same(first: RectifiedView, second: RectifiedView) -> bool:
    a, b = ([view.left.fx, view.left.cx, view.left.cy, view.right.cx] for view in (first, second))
    return bool(np.allclose(a, b, rtol=0, atol=SAME_VIEW))


def _write_example(path: Path, *images: np.ndarray) -> None:
    """Write images side by side, unless the file is there."""
    if not path.is_file():
        gap = np.full((images[0].shape[0], 8, 3), 255, np.uint8)
        row = np.hstack([part for image in images for part in (image, gap)][:-1])
        cv2.imwrite(str(path), row[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])


def _table(scores: dict[str, list[dict[str, float]]]) -> str:
    """Return the means over the pairs as a table of Markdown; the ratio is that of the means."""
    lines = [f"| calibration | {' | '.join(COLUMNS.values())} |", "|---" * (len(COLUMNS) + 1) + "|"]
    for form, pairs in scores.items():
        means: dict[str, Any] = {name: float(np.mean([pair[name] for pair in pairs])) for name in COLUMNS}
        means["ratio"] = means["abs_rel"] / means["abs_rel_rendered"]
        lines.append(f"| {form} | {' | '.join(f'{value:.4f}' for value in means.values())} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main(tyro.cli(Options))
