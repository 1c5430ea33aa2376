"""The runs of an ablation: planned, trained one after the other, scored and reported."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from m3depth.ablation.config import AblateOptions
from m3depth.ablation.figure import study_figure
from m3depth.ablation.findings import METHOD, findings
from m3depth.ablation.maps import maps_figure, predicted
from m3depth.ablation.studies import BASE, Variant
from m3depth.ablation.tables import markdown
from m3depth.datasets.config import flag
from m3depth.datasets.open import open_folders, open_pairs, reader_config_for
from m3depth.datasets.state import state_of_pairs
from m3depth.evaluation.resume import SavedState
from m3depth.evaluation.scoring import evaluate
from m3depth.network.device import chosen_device
from m3depth.network.model import M3Depth
from m3depth.network.output import padded_size
from m3depth.runtimes.choice import recorded_runtime
from m3depth.stereo.pairs import scored_depths
from m3depth.training.config import RECIPES, TrainConfig, check_config
from m3depth.training.ending import spent_budget
from m3depth.training.loop import LOWER_RATE, train
from m3depth.training.run import saved_progress
from m3depth.training.samples import JoinedPairs
from marssim.base.command.progress import watched
from marssim.base.command.wording import counted
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import as_json, read_json, write_json
from marssim.base.results.claim import PARTIAL, ResultFolder, differences
from marssim.base.results.code_state import source_digest, versions

SETTINGS = "ablation.json"  # the settings that make runs comparable, in the ablation's folder
SCORE = "score.json"  # the figures of a run, in its folder
RESULTS = "results.json"
FAILED = "failed.json"  # why a run failed: its loss was not finite
WEIGHTS = "weights.safetensors"
NETWORK = "network.json"  # the sizes of a run's network
CODE = "code.json"  # the states of the code by which a run was trained and scored


@dataclass(frozen=True)
class PlannedRun:
    """One training run of an ablation.

    Attributes:
        variant: The network and the loss.
        seed: Its seed.
        config: The settings of its training.
    """

    variant: Variant
    seed: int
    config: TrainConfig

    @property
    def folder(self) -> Path:
        """The folder of its training and its score."""
        return self.config.out


def plan(options: AblateOptions) -> list[PlannedRun]:
    """Return all runs, each once: by seed, the unchanged preset first.

    Raises:
        ValueError: A setting cannot work; the message names it.
    """
    by_name = {v.name: v for v in options.trained_variants().values()}
    variants = sorted(by_name.values(), key=lambda variant: variant != BASE)
    runs = []
    for seed in dict.fromkeys(options.seeds):
        for variant in variants:
            folder = _run_folder(options, variant, seed)
            config = replace(
                RECIPES[options.recipe],
                data=options.data,
                out=folder,
                network=folder / NETWORK,
                loss=variant.resolved(options.preset, options.recipe)[1],
                max_steps=options.steps,
                max_minutes=options.minutes,
                batch=options.batch,
                crop=options.crop,
                recompute=options.recompute,
                seed=seed,
                validate_every=0,  # validation would use up the budget of minutes
                validate_samples=0,
                device=options.device,
                reader=options.reader,
            )
            check_config(config)
            runs.append(PlannedRun(variant, seed, config))
    return runs


def padded_crops(options: AblateOptions) -> list[str]:
    """Return a warning for each size to which networks of the studies pad the crops.

    Such a network is trained with padding at the same border of every crop, and errs there in images without padding.
    """
    height, width = options.crop
    padded: dict[tuple[int, int], list[str]] = {}
    for variant in options.trained_variants().values():
        size = padded_size(height, width, variant.resolved(options.preset)[0].size_multiple)
        if size != (height, width):
            padded.setdefault(size, []).append(variant.name)
    return [
        f"crops of {height} x {width} px are padded to {rows} x {columns} for {', '.join(sorted(names))}, which learn "
        "the padding and cannot be compared with the others; choose another --crop"
        for (rows, columns), names in padded.items()
    ]


def ablate(options: AblateOptions) -> dict[str, Any]:
    """Train and score the runs that are missing, and write the tables.

    A run whose loss is not finite is reported and left out of the tables, and the others go on. It is not repeated as
    long as its failed.json exists.

    Returns:
        The content of results.json.

    Raises:
        ValueError: A setting or the data cannot be used; one line that says which.
        OSError: A file cannot be read or written.
        KeyboardInterrupt: After a signal, once the current run is saved.
    """
    runs = plan(options)
    test_folder = options.test or options.data[0]
    training = open_folders(options.data, "train", options.reader)
    test = open_pairs(test_folder, "test", reader_config_for(test_folder, (*options.data, test_folder), options.reader))
    for folder, pairs in zip(options.data, training, strict=True):
        if not len(pairs):
            raise ValueError(f"--data {folder}: split train holds no pairs; name another folder")
    if len(test) < 2:
        raise ValueError(f"{test_folder}: split test holds {counted(len(test), 'pair')}; comparing needs two or more")
    for warning in padded_crops(options):
        print(f"warning: {warning}", file=sys.stderr)
    claimed = _folder(options, [*training, test])
    with claimed.claim(**_places(options)):
        claimed.note(**_places(options))
        _check_earlier(runs, options)
        if lost := _lost(options):
            print(
                f"warning: {options.out / 'results.md'} will lack {lost}, which it has now; name all to keep them, as "
                "runs that are scored are not repeated",
                file=sys.stderr,
            )
        scored = counted(len(test) if options.limit is None else min(options.limit, len(test)), "test pair")
        print(f"{counted(len(runs), 'run')} of {options.budget}, {scored} ({options.out})", file=sys.stderr)
        for number, run in enumerate(runs, start=1):
            print(f"run {number} of {len(runs)}: {run.folder.name}", file=sys.stderr, flush=True)
            _train(run, options, JoinedPairs(training))
            if _score(run, options, test):
                _tables(options, runs, test)
        results = _tables(options, runs, test)
        for name, study in results["studies"].items():
            study_figure(study, options.out / f"{name}.png")
        _draw_maps(options, test)
        return results


def _lost(options: AblateOptions) -> str:
    """Return which studies and seeds of the present report a new one would lack, in words."""
    if not (options.out / RESULTS).is_file():
        return ""
    before = read_json(options.out / RESULTS)
    studies, seeds = before.get("studies"), before.get("seeds")
    lost = (
        [f"the study {name}" for name in studies if name not in options.chosen()] if isinstance(studies, dict) else []
    )
    lost += [f"seed {seed}" for seed in seeds if seed not in options.seeds] if isinstance(seeds, list) else []
    return ", ".join(lost)


def _draw_maps(options: AblateOptions, test: Any) -> None:
    """Draw the maps of each study's rows that are scored and have their weights, with networks of the first seed."""
    runs = options.trained_variants()
    for name, study in options.chosen().items():
        folders = {row.label: _run_folder(options, runs[row.variant.name], options.seeds[0]) for row in study.rows}
        files = {label: path / WEIGHTS for label, path in folders.items()}
        scored = (label for label, path in folders.items() if (path / SCORE).is_file())
        weights = {label: files[label] for label in scored if files[label].is_file()}
        if weights:
            examples = predicted(weights, test, chosen_device(options.device).type)
            maps_figure(examples, options.out / f"{name}_maps.png")


def _run_folder(options: AblateOptions, variant: Variant, seed: int) -> Path:
    return options.out / "runs" / f"{variant.name}-{seed}"


def _folder(options: AblateOptions, datasets: Sequence[Any]) -> ResultFolder:
    """Return the ablation's folder, known by the settings that make its runs comparable."""
    settings = {
        "preset": options.preset,
        "steps": options.steps,
        "minutes": options.minutes,
        "batch": options.batch,
        "crop": list(options.crop),
        "sha256": [state_of_pairs(pairs) for pairs in datasets],
        "limit": options.limit,
        **({"recipe": options.recipe} if options.recipe != "own" else {}),  # which earlier ablations do not name
        **{flag(name): str(value) for name, value in options.reader.changed_fields().items()},
    }
    return ResultFolder(
        options.out, "ablation", SETTINGS, settings, notes=tuple(_places(options)), digests=("sha256",), shared=True,
        results_key="studies", partial=(PARTIAL, f"runs/*/{PARTIAL}"),
    )  # fmt: skip


def _places(options: AblateOptions) -> dict[str, Any]:
    """Return where the data lie, which the report names; the digests tell whether they are the same."""
    return {"data": [str(folder) for folder in options.data], "test": str(options.test or options.data[0])}


def _network(run: PlannedRun, options: AblateOptions) -> dict[str, Any]:
    """Return the sizes of a run's network, as network.json has them."""
    return as_json(asdict(run.variant.resolved(options.preset)[0]))


def _check_earlier(runs: Sequence[PlannedRun], options: AblateOptions) -> None:
    """Raise ValueError if a run that was begun before has another network, or was scored with another loss."""
    for run in runs:
        network, score = run.folder / NETWORK, run.folder / SCORE
        if network.is_file() and (other := differences(read_json(network), _network(run, options))):
            raise ValueError(f"{network}: the run is of another network ({'; '.join(other)}); choose another --out")
        if score.is_file() and (other := differences(read_json(score)["loss"], as_json(asdict(run.config.loss)))):
            raise ValueError(f"{score}: the run is of another loss ({'; '.join(other)}); choose another --out")


def _train(run: PlannedRun, options: AblateOptions, samples: Any) -> None:
    """Train to the end of the budget, unless that is done, has failed, or is scored already.

    Raises:
        KeyboardInterrupt: A signal ended the training.
    """
    failed = run.folder / FAILED
    if failed.is_file():
        print(f"{read_json(failed)['error']} (delete {failed} to try it again)", file=sys.stderr, flush=True)
        return
    write_json(run.folder / NETWORK, _network(run, options), sort_keys=False)
    if (run.folder / SCORE).is_file() or spent_budget(run.config, *saved_progress(run.folder)):
        return
    _note_code(run.folder)
    try:
        train(run.config, samples, [])
    except MemoryError as error:
        _, separator, reason = str(error).partition("; ")
        if not separator:  # not of a step
            raise
        more = "" if options.recompute else ", or add --recompute"
        raise MemoryError(f"take fewer or smaller crops with --batch or --crop{more}; {reason}") from None
    except FloatingPointError as error:
        message = f"{run.folder.name}: {str(error).removesuffix(LOWER_RATE)}; it stays out of the tables"
        print(message, file=sys.stderr, flush=True)
        write_json(failed, {"error": message})


def _score(run: PlannedRun, options: AblateOptions, test: Any) -> bool:
    """Score a finished run on the test pairs, and return whether anything was to be scored."""
    if (run.folder / SCORE).is_file():
        return False
    steps, seconds = saved_progress(run.folder)
    if not spent_budget(run.config, steps, seconds):
        return False
    model = M3Depth.from_pretrained(run.folder / WEIGHTS)
    device = chosen_device(options.device)
    _note_code(run.folder)
    code = read_json(run.folder / CODE)["code"]
    runtime = recorded_runtime(["m3depth"], "pytorch", options.device)
    saved_state = SavedState(
        run.folder, {"--test": state_of_pairs(test), "--limit": options.limit, "code": code, "runtime": runtime}
    )
    methods = {METHOD: model.to(device)}
    evaluation = evaluate(test, methods, limit=options.limit, progress=_watched, saved_state=saved_state)
    about = {
        "code": ", ".join(code),
        "device": device.type,
        "runtime": runtime,
        "parameters": sum(p.numel() for p in model.parameters()),
        "steps": steps,
        "minutes": seconds / 60,
        "loss": asdict(run.config.loss),
    }
    write_json(
        run.folder / SCORE,
        {**about, "result": evaluation.results[METHOD], "per_pair": evaluation.pairs},
        sort_keys=False,
    )
    saved_state.remove()
    return True


def _watched(indices: Sequence[int]) -> Iterator[int]:
    """Yield the indices of the pairs, and print the progress."""
    return watched(indices, "pair", "score")


def _note_code(folder: Path) -> None:
    """Add the state of the code to those by which a run was trained and scored."""
    file, now = folder / CODE, source_digest(("marssim", "m3depth"))
    before = read_json(file)["code"] if file.is_file() else []
    if now not in before:
        write_json(file, {"code": [*before, now]})


def _tables(options: AblateOptions, runs: Sequence[PlannedRun], test: Any) -> dict[str, Any]:
    """Write results.json and results.md of the runs scored so far, and return the content of the first."""
    scores: dict[str, dict[int, dict[str, Any]]] = {run.variant.name: {} for run in runs}
    for run in runs:
        if (run.folder / SCORE).is_file():
            scores[run.variant.name][run.seed] = read_json(run.folder / SCORE)
    by_variant = {name: scores[run.name] for name, run in options.trained_variants().items()}
    studies = {name: findings(study, by_variant) for name, study in options.chosen().items()}
    about = {
        **read_json(options.out / SETTINGS),
        "seeds": list(dict.fromkeys(options.seeds)),
        "depth_range_m": scored_depths(test),
        "versions": versions(),
        "failed": [run.folder.name for run in runs if (run.folder / FAILED).is_file()],
    }
    results = {**about, "studies": studies}
    write_json(options.out / RESULTS, results, sort_keys=False)
    write_atomically(options.out / "results.md", markdown(about, studies).encode())
    return results
