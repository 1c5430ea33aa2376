"""Makes the pairs of a manifest, scores weights and SGBM on them, and writes one table of all.

    python docs/scoring/score_manifest.py --data data/manifest --out out/scores --weights shipped mine.safetensors
    python docs/scoring/score_manifest.py --data data/manifest --out out/trial --sizes 512 --sets clean dust --limit 2

Every part, one size, set and place, is a dataset DATA/SIZE/SET/PLACE of marssim.generate. It is scored by
m3depth.evaluate, into OUT/depth/SIZE/SET/PLACE, and by envs.rocks, into OUT/map/SIZE/SET/PLACE: there without weights
that need the true depth, which no rover has. The same command goes on where it was stopped, and leaves out what is
scored already by the same code, weights, runtime and pairs. OUT/summary.md and OUT/summary.json hold the parts that
this call asks for; manifest_summary.py defines their figures.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from manifest_summary import markdown, summary

from envs.rocks import main as count_rocks
from m3depth.estimator import EstimatorName
from m3depth.evaluate import main as evaluate
from m3depth.evaluation.resume import UNFINISHED
from m3depth.kinds.networks import load_network
from m3depth.runtimes.choice import RuntimeChoice, joined_runtimes, recorded_runtime
from m3depth.weights import SHIPPED_WEIGHTS, check_weights_file, weights_file
from marssim.base.command.limits import check_least
from marssim.base.command.run import run_command
from marssim.base.dataset.dataset import StereoDataset
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, read_json, write_json
from marssim.base.results.code_state import source_digest, versions
from marssim.generate import main as generate

MANIFEST = SHIPPED_WEIGHTS.with_name("manifest.json")
CODE = {"depth": ("marssim", "m3depth"), "map": ("marssim", "m3depth", "nav", "envs")}  # packages that give the scores
BEGUN = "state.json"  # in a folder of scores: what they depend on
DONE = "scored.json"  # the same, written when they are complete


@dataclass(frozen=True)
class Options:
    """Makes the pairs of a manifest, scores weights and SGBM on them, and writes one table of all."""

    data: Path
    """Folder for the datasets; what it holds of them is kept."""
    out: Path
    """Folder for the scores, summary.md and summary.json."""
    weights: tuple[Path, ...] = (Path("shipped"),)
    """Weights files (.safetensors) to score, each in rows of its own; the word shipped names the package's."""
    sizes: tuple[str, ...] = ()
    """Sizes of the manifest to take, as 512; without any, all."""
    sets: tuple[str, ...] = ()
    """Sets of the manifest to take, as clean; without any, all."""
    baselines: tuple[str, ...] = ("sgbm", "sgbm-hh")
    """Classical methods whose depth is scored too, as --baselines of m3depth.evaluate names them. The navigator's map
    has SGBM alone."""
    estimator: tuple[str, ...] = ()
    """Further methods whose depth is scored, as --estimator of m3depth.evaluate names them."""
    map: bool = True
    """Whether the navigator's map is scored as well as the depth, which takes longer than the depth."""
    max_pixels: int | None = None
    """Largest number of pixels of an image that networks work on for the scores of depth, as --max-pixels of
    m3depth.evaluate; without it, all. The navigator's map has all."""
    limit: int | None = None
    """Most pairs of each size, set and place, for a trial: the first ones. --data must not hold more of them. Without
    it, all."""
    runtime: RuntimeChoice = "auto"
    """Program that runs M3Depth, as --runtime of m3depth.evaluate names it. Parts that another one scored are scored
    again."""
    workers: int = 2
    """Number of processes that render."""
    manifest: Path = MANIFEST
    """The manifest: a JSON file of the form of m3depth/weights/manifest.json."""

    def __post_init__(self) -> None:
        check_least(self, limit=1, workers=1)
        if not self.weights or len(set(self.weights)) < len(self.weights):
            raise ValueError("weights must name one file or more, each once")


@dataclass(frozen=True)
class Part:
    """One size, set and place of a manifest.

    Attributes:
        size: Name of the size.
        name: Name of the set.
        place: The place.
        made_as: The set whose pairs these are, which may be degraded afterwards.
        pairs: Number of pairs.
        generate: Flags of marssim.generate, without the folder, the pairs and the workers.
        evaluate: Further flags of m3depth.evaluate.
        degrade: The degradation of the images before they are scored, or None.
    """

    size: str
    name: str
    place: str
    made_as: str
    pairs: int
    generate: tuple[str, ...]
    evaluate: tuple[str, ...]
    degrade: str | None

    def dataset(self, data: Path) -> Path:
        """Return the folder of the pairs; data: the folder of all datasets."""
        return data / self.size / self.made_as / self.place

    def scores(self, out: Path, kind: str) -> Path:
        """Return the folder of the scores of a kind, "depth" or "map"; out: the folder of all scores."""
        return out / kind / self.size / self.name / self.place


def parts_of(manifest: Mapping[str, Any], sizes: Sequence[str] = (), sets: Sequence[str] = ()) -> list[Part]:
    """Return the parts of a manifest, in its order.

    Args:
        manifest: Its content.
        sizes: The sizes to take; none for all.
        sets: The sets to take; none for all.

    Raises:
        ValueError: A size or set is unknown, or none of the sets has one of the sizes.
        KeyError: The manifest lacks an entry.
    """
    for flag, wanted, available in (("--sizes", sizes, manifest["sizes"]), ("--sets", sets, manifest["sets"])):
        for name in wanted:
            if name not in available:
                raise ValueError(f"{flag} {name}: unknown; the manifest has {', '.join(available)}")
    parts = []
    for size, of_size in manifest["sizes"].items():
        for name, of_set in manifest["sets"].items():
            if (sizes and size not in sizes) or (sets and name not in sets):
                continue
            made_as = of_set.get("of", name)
            made = manifest["sets"][made_as]
            pairs = made["sizes"].get(size, {}) if "sizes" in made else of_size["pairs"]
            for place, count in pairs.items():
                seed = made.get("seeds", manifest["seeds"])[place]
                flags = ["--scene", place, "--seed", str(seed)]
                flags += [*manifest["generate"], *of_size["generate"], *made["generate"]]
                part = Part(
                    size, name, place, made_as, count, tuple(flags), tuple(of_size["evaluate"]), of_set.get("degrade")
                )
                parts.append(part)
    if not parts:
        raise ValueError(f"--sets {' '.join(sets)}: the manifest has none of them at the size {' or '.join(sizes)}")
    return parts


def make(part: Part, options: Options) -> StereoDataset:
    """Render the pairs of a part that are missing, and return the dataset."""
    folder = part.dataset(options.data)
    present = len(StereoDataset(folder)) if (folder / "dataset.json").is_file() else 0
    if options.limit is not None and present > options.limit:
        raise DatasetError(f"--limit {options.limit}: {folder} holds {present} pairs; give another --data")
    pairs = max(present, min(part.pairs, options.limit or part.pairs))
    flags = ["--out", str(folder), "--pairs", str(pairs), "--workers", str(options.workers), *part.generate]
    _run(generate, flags)
    return StereoDataset(folder)


def weights_by_kind(options: Options) -> dict[str, list[Path]]:
    """Return the weights files that give each kind of scores, a key of CODE."""
    files = [weights_file(path) for path in options.weights]
    for path in files:
        check_weights_file(path)
    return {"depth": files, "map": [path for path in files if not load_network(path).takes_truth]}


def score(part: Part, dataset: StereoDataset, options: Options, weights: Mapping[str, Sequence[Path]]) -> None:
    """Score the weights and SGBM on a part, in the depth and in the navigator's map, unless that is done already.

    Args:
        part: The part.
        dataset: Its pairs.
        options: The command's flags.
        weights: As of weights_by_kind.
    """
    data = str(dataset.path)
    common = ["--split", "all", *(["--limit", str(options.limit)] if options.limit else [])]
    common += ["--degrade", part.degrade] if part.degrade else []
    common += ["--runtime", options.runtime]
    methods = [f"m3depth:{path}" for path in weights["map"]]
    further = ["--estimator", *options.estimator] if options.estimator else []
    further += ["--max-pixels", str(options.max_pixels)] if options.max_pixels else []
    estimators = [EstimatorName.parse(text, "--estimator", labelled=True, fillable=True) for text in options.estimator]
    commands = {
        "depth": (
            evaluate,
            ["--weights", *map(str, weights["depth"]), "--baselines", *options.baselines, *further, *part.evaluate],
        ),
        "map": (count_rocks, ["--perception", *methods, "sgbm", "ground_truth"]),
    }
    for kind in kinds_of(options):
        command, flags = commands[kind]
        out = part.scores(options.out, kind)
        state = {
            "flags": [*common, *flags],
            "pairs": dataset.digest,
            "weights": [EstimatorName(f"m3depth:{path}").digest() for path in weights[kind]],
            "code": source_digest(CODE[kind]),
        }
        names = [f"m3depth:{path}" for path in weights[kind]]
        if kind == "depth":
            state["estimators"] = [estimator.digest() for estimator in estimators]
            names += [estimator.name for estimator in estimators]
        state["runtime"] = recorded_runtime(names, options.runtime)
        done = out / DONE
        if done.is_file() and read_json(done) == state:
            continue
        done.unlink(missing_ok=True)
        begun = out / BEGUN
        if not (begun.is_file() and read_json(begun) == state):  # by other code, say, which evaluate refuses
            (out / UNFINISHED).unlink(missing_ok=True)
            write_json(begun, state)
        print(f"score_manifest: {kind} of {part.size}/{part.name}/{part.place}", file=sys.stderr)
        _run(command, ["--data", data, "--out", str(out), *common, *flags])
        write_json(done, state)


def kinds_of(options: Options) -> tuple[str, ...]:
    """Return the kinds of scores that are asked for, keys of CODE."""
    return tuple(kind for kind in CODE if kind == "depth" or options.map)


class CommandFailed(Exception):
    """A command has failed, and has printed why; the argument is its exit code."""


def _run(command: Callable[[list[str]], int], flags: list[str]) -> None:
    """Run a command. Raises CommandFailed."""
    if code := command(flags):
        raise CommandFailed(code)


def work(options: Options) -> None:
    """Make the parts, score them, and write the summary."""
    try:
        parts = parts_of(read_json(options.manifest), options.sizes, options.sets)
    except (KeyError, TypeError, AttributeError) as error:
        raise DatasetError(f"--manifest {options.manifest}: an entry is missing or malformed: {error}") from None
    weights = weights_by_kind(options)
    for part in parts:
        score(part, make(part, options), options, weights)
    kinds = kinds_of(options)
    results = [
        {
            "size": part.size, "set": part.name, "place": part.place,
            **{kind: read_json(part.scores(options.out, kind) / "results.json") for kind in kinds},
        }
        for part in parts
    ]  # fmt: skip
    content = {
        "limit": options.limit, "max_pixels": options.max_pixels, "weights": [*map(str, options.weights)],
        "runtime": joined_runtimes(result[kind]["runtime"] for result in results for kind in kinds),
        "versions": versions(), **summary(results),
    }  # fmt: skip
    write_json(options.out / "summary.json", content, sort_keys=False)
    write_atomically(options.out / "summary.md", markdown(content).encode())
    print(f"{len(parts)} parts; the table is {options.out / 'summary.md'}")


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code: 2 for a mistake of the user, else that of a command that failed."""
    try:
        return run_command(work, Options, "python docs/scoring/score_manifest.py", __doc__, args)
    except CommandFailed as failed:
        return int(failed.args[0])


if __name__ == "__main__":
    sys.exit(main())
