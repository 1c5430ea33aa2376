"""The figures of docs/scoring/score_manifest.py: those of many small evaluations, joined by size and set.

Errors of pixels are means over images, as in m3depth.evaluate; shares of sky and near ground, of rocks and of edges are
over all images together. The 95 % intervals are by the bootstrap over scenes, whose views are drawn together. A ratio
to SGBM's compares both on the same images. Near ground is nearer than 8 m.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from m3depth.evaluation.bootstrap import interval, resampled_means
from m3depth.evaluation.report import marked, number, table
from m3depth.runtimes.choice import runtime_sentence
from marssim.base.command.wording import counted

SGBM = "SGBM"
HEIGHTS = (0.1, 0.2, 0.3, np.inf)  # [m] edges of the intervals of the height of rocks and edges of slabs
RANGES = (0.0, 4.0, 8.0, 15.0)  # [m] edges of the intervals of their distance
IN_DEPTH = "Rocks, edges of slabs and false obstacles in the depth, by docs/concepts/scoring-rules.md"
IN_MAP = "Those in the navigator's map, by envs/rock_map.py"
FRAMES = 40  # frames that false obstacles are counted in
HEIGHT, DISTANCE, FOUND, BOTH_EYES = 0, 1, 2, 4  # places in a RockOutcome

Record = Mapping[str, Any]  # what results.json of m3depth.evaluate or of envs.rocks holds of a pair and a method


@dataclass(frozen=True)
class Term:
    """A figure: the sum of one number over the pairs, divided by the sum of another one.

    Attributes:
        title: Its heading.
        numbers: The two numbers of a pair's record; zeros for a pair without the figure.
        percent: Whether it is a share, shown in %.
        share: Whether it is a share, which is 1 at most; all shown in % are.
        ratio: Whether its ratio to SGBM's is given.
    """

    title: str
    numbers: Callable[[Record], tuple[float, float]]
    percent: bool = False
    ratio: bool = False
    share: bool = False


def _mean(name: str, kind: str | None, record: Record) -> tuple[float, float]:
    """Return a figure of an image and 1, so that the quotient of their sums is the mean over images."""
    value = (record if kind is None else record["kinds"].get(kind, {})).get(name)
    return (0.0, 0.0) if value is None else (value, 1.0)


def _sky(part: str, whole: str, record: Record) -> tuple[float, float]:
    return record["counts"]["sky"][part], record["counts"]["sky"][whole]


def _outcomes(
    kind: str, low: float, high: float, near: float, far: float, record: Record, both_eyes: bool = False
) -> tuple[float, float]:
    """Return how many rocks, or edges, of an interval of heights and of distances are found, and how many there are."""
    outcomes = [
        o[FOUND]
        for o in record[kind]
        if low <= o[HEIGHT] < high and near <= o[DISTANCE] < far and (o[BOTH_EYES] or not both_eyes)
    ]
    return float(sum(outcomes)), float(len(outcomes))


def _false(record: Record) -> tuple[float, float]:
    return float(FRAMES * len(record["false"])), float(record["images"])


HIGH_AND_NEAR = (0.2, np.inf, 0.0, 8.0)  # rocks that decide a drive
PIXELS = {
    "epe_visible": Term("EPE, non-occluded [px]", partial(_mean, "epe", "visible"), ratio=True),
    "abs_rel": Term("Abs Rel", partial(_mean, "abs_rel", None), ratio=True),
    "bad1": Term("bad-1", partial(_mean, "bad1", None), percent=True, ratio=True),
    "normal": Term("normals [°]", partial(_mean, "normal_mean", None), ratio=True),
    "normal_rock": Term("normals on rocks [°]", partial(_mean, "normal_mean", "rock"), ratio=True),
    "normal_slab": Term("normals on slabs [°]", partial(_mean, "normal_mean", "slab"), ratio=True),
    "near_ground_as_sky": Term("near ground as sky", partial(_sky, "ground_as_sky", "ground"), percent=True),
    "missed_sky": Term("sky missed", partial(_sky, "missed", "pixels"), percent=True),
}
ROCKS = {
    "found": Term("rocks of 0.2 m within 8 m found", partial(_outcomes, "rocks", *HIGH_AND_NEAR), percent=True),
    "found_both": Term(
        "of those that both eyes see", partial(_outcomes, "rocks", *HIGH_AND_NEAR, both_eyes=True), percent=True
    ),
    "edges_found_both": Term(
        "edges of slabs, likewise", partial(_outcomes, "edges", *HIGH_AND_NEAR, both_eyes=True), percent=True
    ),
    "false": Term(f"false obstacles in {FRAMES} frames", _false),
}
PLACE_FIGURES = ("epe_visible", "abs_rel", "normal")  # figures that are also given by place


def summary(results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return all figures.

    Args:
        results: For each part "size", "set", "place", and "depth" and "map", the content of results.json of
            m3depth.evaluate and of envs.rocks; all parts without "map" where no map was scored.

    Returns:
        "parts", by size and set: "pairs", "scenes", "depth" and "map" (empty where none was scored) by method, with
        "places", "gets_truth" (whether the true depth was given) and "same_scenes" (the ratio of Abs Rel to that of the
        same views at the smallest size, None there) in "depth". Sizes are named after their width in pixels.
    """
    groups: dict[str, dict[str, list[Mapping[str, Any]]]] = {}
    for result in results:
        groups.setdefault(result["size"], {}).setdefault(result["set"], []).append(result)
    smallest = min(groups, key=int)
    parts: dict[str, Any] = {}
    for size, by_set in groups.items():
        for name, group in by_set.items():
            base = None if size == smallest else groups[smallest].get(name)
            parts.setdefault(size, {})[name] = _joined(group, base)
    return {"parts": parts}


def _joined(group: Sequence[Mapping[str, Any]], base: Sequence[Mapping[str, Any]] | None) -> dict[str, Any]:
    """Return the figures of the places of one size and set; base: the same places at the smallest size, or None."""
    pairs = [(part["place"], pair) for part in group for pair in part["depth"]["per_pair"]]
    scenes = [(place, pair["scene"]) for place, pair in pairs]
    methods = group[0]["depth"]["estimators"]
    depth: dict[str, Any] = {}
    rivals = [pair[SGBM] for _, pair in pairs] if SGBM in methods else None
    for label in methods:
        records = [pair[label] for _, pair in pairs]
        depth[label] = {name: figure(term, records, scenes, rivals) for name, term in PIXELS.items()}
        depth[label] |= _rock_figures([record["counts"]["rocks"] for record in records], scenes)
        depth[label]["gets_truth"] = bool(group[0]["depth"]["methods"][label].get("gets_truth"))
        depth[label]["places"] = {
            part["place"]: {
                name: _quotient(PIXELS[name], [pair[label] for pair in part["depth"]["per_pair"]])
                for name in PLACE_FIGURES
            }
            for part in group
        }
        depth[label]["same_scenes"] = None if base is None else _against(group, base, label)
    maps = [(part["place"], part["map"]) for part in group if "map" in part]
    looks = [(place, pair) for place, scored in maps for pair in scored["per_pair"]]
    labels = {about["name"]: label for label, about in methods.items()}  # envs.rocks calls a method by its flag
    shown = {
        labels.get(name, name): _rock_figures([pair[name] for _, pair in looks], [(p, x["scene"]) for p, x in looks])
        for name in (maps[0][1]["methods"] if maps else ())
    }
    return {"pairs": len(pairs), "scenes": len(set(scenes)), "depth": depth, "map": shown}


def _rock_figures(records: Sequence[Record], scenes: Sequence[Any]) -> dict[str, Any]:
    """Return the figures of ROCKS, and rocks and edges found of how many by height and distance."""
    bins = [
        {
            "from_m": low, "to_m": high, "near_m": near, "far_m": far,
            **{
                kind: [int(sum(x)) for x in zip(*(_outcomes(kind, low, high, near, far, r) for r in records))]
                for kind in ("rocks", "edges")
            },
        }
        for low, high in pairwise(HEIGHTS)
        for near, far in pairwise(RANGES)
    ]  # fmt: skip
    return {**{name: figure(term, records, scenes) for name, term in ROCKS.items()}, "bins": bins}


def _against(group: Sequence[Mapping[str, Any]], base: Sequence[Mapping[str, Any]], label: str) -> float | None:
    """Return Abs Rel over that of the same views in other parts; None if they have no view in common."""
    small = {(part["place"], pair["pair"]): pair[label] for part in base for pair in part["depth"]["per_pair"]}
    both = [
        (pair[label], small[part["place"], pair["pair"]])
        for part in group
        for pair in part["depth"]["per_pair"]
        if (part["place"], pair["pair"]) in small
    ]
    large, less = (_quotient(PIXELS["abs_rel"], side) for side in zip(*both)) if both else (None, None)
    return large / less if large is not None and less else None


def _quotient(term: Term, records: Sequence[Record]) -> float | None:
    """Return a figure of some pairs; None if none of them has it."""
    part, whole = np.array([term.numbers(record) for record in records]).sum(0)
    return float(part / whole) if whole else None


def figure(
    term: Term, records: Sequence[Record], scenes: Sequence[Any], rivals: Sequence[Record] | None = None
) -> dict[str, Any]:
    """Return a figure with its 95 % interval over scenes, and its ratio to that of a rival on the same pairs.

    Args:
        term: The figure.
        records: Of the pairs.
        scenes: The scene of each pair.
        rivals: Records of the rival of the same pairs; None for no ratio.

    Returns:
        "value", "interval"; with rivals, and where the term asks for it, "ratio" over the pairs for which both have the
        figure, and "ratio_interval". None where no pair has the figure. An interval is None for fewer than four scenes
        that have it, and where all samples of them have the same: this does not tell how others would differ.
    """
    numbers = np.array([term.numbers(record) for record in records])  # (pairs, 2)
    most = 1.0 if term.percent or term.share else np.inf
    out: dict[str, Any] = dict(zip(("value", "interval"), _estimate(numbers, scenes, most), strict=True))
    if rivals is not None and term.ratio:
        both = np.hstack([numbers, [term.numbers(record) for record in rivals]])
        out |= zip(("ratio", "ratio_interval"), _estimate(both, scenes, np.inf), strict=True)
    return out


def _estimate(numbers: np.ndarray, scenes: Sequence[Any], most: float) -> tuple[float | None, list[float] | None]:
    """Return a quotient of sums over pairs, or the quotient of two, and its interval; None where it is not known.

    Args:
        numbers: (pairs, 2) numerators and denominators, or (pairs, 4) with those of the second quotient.
        scenes: The scene of each pair. Those count that have a pair without a denominator of 0.
        most: Greatest value that it can have.
    """
    known = (numbers[:, 1::2] > 0).all(axis=1)
    kept = [scene for scene, has in zip(scenes, known, strict=True) if has]
    if not kept:
        return None, None
    sums = np.vstack([numbers[known].sum(axis=0), resampled_means(numbers[known], kept)])
    quotients = sums[:, 0::2] / sums[:, 1::2]  # of all pairs, and of each sample
    if not quotients[0, 1:].all():
        return None, None
    with np.errstate(divide="ignore", invalid="ignore"):
        value, *samples = quotients[:, 0] / quotients[:, 1:].prod(axis=1)
        if np.ptp(samples) <= 1e-12 * value:
            return float(value), None
    return float(value), interval(np.array(samples), value, len(set(kept)), within=(0, most))


def markdown(content: Mapping[str, Any]) -> str:
    """Return the tables of a summary.

    Args:
        content: What `summary` returned, with limit, max_pixels, weights, runtime and versions.
    """
    limit = content["limit"]
    most = content.get("max_pixels")
    fewer = "" if most is None else f" Networks worked on at most {most} pixels of an image for the scores of depth."
    trial = "" if limit is None else f" **A trial: at most {counted(limit, 'pair')} of each place.**"
    lines = [f"# {_title(content['parts'])}", "", " ".join((__doc__ or "").split("\n\n")[1].split()) + fewer + trial]
    for size, by_set in content["parts"].items():
        for name, part in by_set.items():
            lines += [
                "",
                f"## {size} px, {name}",
                "",
                f"{counted(part['pairs'], 'pair')} of {counted(part['scenes'], 'scene')}.",
                "",
            ]
            depth = marked(part["depth"])
            lines += _figure_table(PIXELS, depth)
            same = {label: x["same_scenes"] for label, x in depth.items() if x["same_scenes"] is not None}
            if same:
                ratios = ", ".join(f"{label} {ratio:.3f}" for label, ratio in same.items())
                lines += ["", f"Abs Rel over that of the same views at the smallest size: {ratios}."]
            lines += ["", *_place_table(depth)]
            for methods, where in ((depth, IN_DEPTH), (part["map"], IN_MAP)):
                if methods:
                    lines += ["", f"{where}:", "", *_figure_table(ROCKS, methods), "", *_bin_table(methods)]
    used = ", ".join(f"{name} {value}" for name, value in content["versions"].items() if value is not None)
    return "\n".join([*lines, "", f"{runtime_sentence(content['runtime'])}{used}.", ""])


def _title(parts: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the heading of a page, which says what its pairs are. parts: by size and set."""
    sets = dict.fromkeys(name for by_set in parts.values() for name in by_set)
    return f"Scores on the manifest: {_listed(sets)} pairs of {_listed(parts)} px"


def _listed(words: Iterable[str]) -> str:
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def _figure_table(terms: Mapping[str, Term], methods: Mapping[str, Any]) -> list[str]:
    """Return a table with a row a figure and a column a method, with ratios to SGBM's where they are known."""
    rows = []
    for name, term in terms.items():
        rows.append([term.title, *(_cell(figures[name], "value", "interval", term) for figures in methods.values())])
        if term.ratio and any(figures[name].get("ratio") is not None for figures in methods.values()):
            cells = (
                "" if label == SGBM else _cell(figures[name], "ratio", "ratio_interval")
                for label, figures in methods.items()
            )
            rows.append(["… over SGBM's", *cells])
    return table(["", *methods], rows)


def _place_table(methods: Mapping[str, Any]) -> list[str]:
    places = next(iter(methods.values()))["places"]
    rows = [
        [
            place,
            *("-" if (value := m["places"][place][name]) is None else number(value) for m, name in _columns(methods)),
        ]
        for place in places
    ]
    header = [f"{label}: {PIXELS[name].title}" for label in methods for name in PLACE_FIGURES]
    return table(["place", *header], rows)


def _columns(methods: Mapping[str, Any]) -> list[tuple[Mapping[str, Any], str]]:
    return [(figures, name) for figures in methods.values() for name in PLACE_FIGURES]


def _bin_table(methods: Mapping[str, Any]) -> list[str]:
    """Return how many rocks, and edges of slabs, are found of how many, by height and distance."""
    rows = []
    for index, first in enumerate(next(iter(methods.values()))["bins"]):
        low, high, near, far = (first[key] for key in ("from_m", "to_m", "near_m", "far_m"))
        height = f"{low:g} m and more" if high is None or np.isinf(high) else f"{low:g} to {high:g} m"
        for kind, what in (("rocks", "rocks"), ("edges", "edges of slabs")):
            if first[kind][1]:
                cells = (f"{m['bins'][index][kind][0]} of {m['bins'][index][kind][1]}" for m in methods.values())
                rows.append([f"{what}, {height}, {near:g} to {far:g} m away", *cells])
    return table(["found", *methods], rows)


def _cell(figures: Mapping[str, Any], value: str, bounds: str, term: Term | None = None) -> str:
    """Return a figure with its interval."""
    shown = partial(_shown, percent=term is not None and term.percent)
    if figures[value] is None:
        return "-"
    limits = figures[bounds]
    return shown(figures[value]) + ("" if limits is None else f" ({shown(limits[0])} to {shown(limits[1])})")


def _shown(value: float, percent: bool) -> str:
    return f"{100 * value:.3g} %" if percent else number(value)
