"""Check the files of a dataset and show what is in it, or compare the renderers.

    python -m marssim.verify data/gale                        hashes and statistics: verify.json, statistics.png
    python -m marssim.verify data/gale --sample 00000/00      one sample: figure, point cloud, mesh
    python -m marssim.verify data/gale --view                 then all pairs in 3-D, in the browser
    python -m marssim.verify --cross-check --scene jezero     how well all renderers agree: cross_check.json

The command hashes every file of every sample, and names each wrong file in a line. The statistics come from a part of
the samples, whose number --statistics-of sets. Results go to out/verify, into a folder for each dataset. The exit code
is 0 if all is well, 1 if something is wrong, and 2 if there is no dataset or a flag has a bad value.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from marssim.base.camera import NATECAM
from marssim.base.command.limits import check_least
from marssim.base.command.progress import progress
from marssim.base.command.run import run_command, writing_to
from marssim.base.command.wording import STARTS_OVER, counted
from marssim.base.compute.threads import in_threads
from marssim.base.dataset.dataset import SPLITS, StereoDataset
from marssim.base.dataset.sample import StereoSample, read_sample
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, write_json
from marssim.base.images.pointcloud import coloured_points, encode_glb, encode_ply, surface_mesh
from marssim.base.results.claim import ResultFolder
from marssim.base.results.lock import check_unused
from marssim.base.results.out_folder import check_folder
from marssim.base.view.show import check_viewer, show
from marssim.inspection.cross_check import cross_check
from marssim.inspection.cross_check import table as table_of_renderers
from marssim.inspection.integrity import Finding, check_extra, check_index, check_samples, check_trajectories
from marssim.inspection.shots import dataset_shots
from marssim.inspection.statistics import SampleStatistics, table
from marssim.inspection.statistics import __doc__ as definitions
from marssim.scene.place_file import PLACE_VALUES, load_place
from marssim.scene.presets import PRESETS

RESULTS = Path("out/verify")  # default folder of the results
SHOWN = 50  # findings that are printed; verify.json has all of them


@dataclass(frozen=True)
class VerifyConfig:
    """Check a dataset, show what is in it, or compare the renderers."""

    data: tyro.conf.Positional[Path | None] = None
    """Folder of the dataset, as marssim.generate writes it."""
    out: Path | None = None
    """Folder for the results. It may lie in the dataset, but not among its scenes. The default is
    out/verify/NAME-DIGEST, with the name of the dataset's folder and the first digits of its digest, and out/verify for
    --cross-check."""
    statistics_of: int = 200
    """Approximate number of samples in the statistics, spread evenly over the splits, at least one of each; 0 makes no
    statistics."""
    workers: int = 2
    """Number of threads that hash and decode, 1 or more."""
    sample: str | None = None
    """Name of a sample, SCENE/VIEW like 00003/05, that is drawn instead of checking the dataset."""
    max_range: float = 30.0
    """Farthest depth [m], above 0, in the clouds of --view, and in the point cloud and the mesh of --sample."""
    view: bool = False
    """At the end, show the clouds and cameras of the pairs, or of --sample, on a page in the browser, until Ctrl-C. It
    needs the extra `view`."""
    cross_check: bool = False
    """Render random views of --scene, and tilted planes, with each renderer, and compare them with Embree's rays. A
    dataset that is given too is checked before. The shares in the table
    are those of the view that agrees least, the shifts those of all views together."""
    views: int = 10
    """Number of views of --cross-check, 1 or more."""
    scene: Annotated[str, tyro.conf.arg(metavar=PLACE_VALUES)] = PRESETS[0]
    """Place of --cross-check: a preset, or a JSON file of your own place."""
    seed: int = 0
    """Seed of the scene and the views of --cross-check, 0 or more."""

    def __post_init__(self) -> None:
        check_least(self, statistics_of=0, workers=1, views=1, seed=0)
        if not self.max_range > 0:
            raise ValueError(f"max_range must be positive, got {self.max_range}")
        if self.data is None and self.sample is not None:
            raise ValueError(f"--sample {self.sample}: give the folder of the dataset too")
        if self.data is None and self.view:
            raise ValueError("view shows the pairs of a dataset: give its folder too")
        if self.max_range != VerifyConfig.max_range and self.sample is None and not self.view:
            raise ValueError("--max-range is of the clouds of --sample and --view: give one of them too")
        if self.data is None and not self.cross_check:
            raise ValueError("give the folder of a dataset, or --cross-check; --help explains both")
        for name in ("views", "scene", "seed"):
            if not self.cross_check and getattr(self, name) != getattr(VerifyConfig, name):
                raise ValueError(f"--{name} describes the views of --cross-check; give it too, or leave --{name} out")
        if self.cross_check:
            load_place(self.scene)  # raises for a place that cannot be read
        if self.data is not None and self.out is not None:
            data, out = self.data.resolve(), self.out.resolve()
            # else the next run would report the results as files that the index does not list
            if out == data or out.is_relative_to(data / "scenes"):
                raise ValueError(
                    f"--out {self.out}: the dataset's own folder or one of its scenes; choose another folder"
                )

    def results(self, dataset: StereoDataset | None = None) -> Path:
        """Return the folder for the results of a dataset, or of --cross-check if there is none."""
        if self.out is not None:
            return self.out
        return RESULTS if dataset is None else RESULTS / f"{dataset.path.resolve().name}-{dataset.digest[:8]}"


def verify_dataset(config: VerifyConfig, dataset: StereoDataset) -> tuple[list[Finding], dict[str, SampleStatistics]]:
    """Hash every file, then take statistics over some of the samples whose files are as recorded.

    Args:
        config: The number of samples in the statistics, the number of threads, and the folder of the results.
        dataset: The dataset.

    Returns:
        All findings, and the statistics of "all" and of each split.

    Raises:
        DatasetError: The dataset is of an older version that cannot be checked.
    """
    findings, intact = check_index(dataset), []
    with progress(len(dataset), "pair", "check") as bar:
        for name, problems in check_samples(dataset, config.workers):
            findings += problems
            if not problems:
                intact.append(name)
            bar.update()
    findings += check_trajectories(dataset) + check_extra(dataset, config.results(dataset))
    statistics = {name: SampleStatistics() for name in ("all", *SPLITS)}
    split = {sample["name"]: sample["split"] for sample in dataset.index["samples"]}
    chosen = spread({name: split[name] for name in intact}, config.statistics_of)
    read = partial(_read, dataset.path)
    with progress(len(chosen), "pair", "statistics") as bar:
        for name, sample in zip(chosen, in_threads(read, chosen, config.workers)):
            if isinstance(sample, Finding):
                findings.append(sample)
            else:
                for part in (statistics["all"], statistics[split[name]]):
                    part.add(sample)
            bar.update()
    return findings, statistics


def spread(split: dict[str, str], number: int) -> list[str]:
    """Choose about `number` names: the same share of each split, at least one, evenly spread.

    Args:
        split: Split of each sample, by name.
        number: Approximate number of names to choose.
    """
    chosen = []
    for part in SPLITS:
        names = [name for name, its_split in split.items() if its_split == part]
        count = min(len(names), int(np.ceil(number * len(names) / max(1, len(split)))))
        chosen += [names[i] for i in np.linspace(0, len(names) - 1, count).round().astype(int)]
    return sorted(chosen)


def show_sample(config: VerifyConfig, dataset: StereoDataset, name: str) -> list[Path]:
    """Write the figure, the point cloud and the mesh of a sample.

    Args:
        config: The folder of the results and the farthest depth.
        dataset: The dataset.
        name: Name of the sample, "scene/view".

    Returns:
        The files that were written.

    Raises:
        DatasetError: There is no such sample, or one of its files is broken.
        OSError: A file cannot be written.
    """
    from marssim.inspection.figures import sample_figure  # not at the top, since it loads matplotlib

    if name not in dataset.names:
        like = f"names look like {dataset.names[0]}" if dataset.names else "it has none at all"
        raise DatasetError(f"--sample {name}: {dataset.path} has no such sample; {like}")
    sample = read_sample(dataset.path / "scenes" / name)
    flat, out = name.replace("/", "_"), config.results(dataset)
    files = {out / f"sample_{flat}.png": sample_figure(sample, name)}
    camera = sample.rig.camera
    points, colours = coloured_points(sample.left, sample.depth, camera, config.max_range)
    if len(points):
        files[out / f"sample_{flat}.ply"] = encode_ply(points, colours)
    vertices, faces, pixel = surface_mesh(sample.depth, sample.normal, camera, config.max_range)
    if len(faces):
        files[out / f"sample_{flat}.glb"] = encode_glb(vertices, faces, sample.left.reshape(-1, 3)[pixel])
    for path, data in files.items():
        write_atomically(path, data)
    return list(files)


def verify(config: VerifyConfig) -> bool:
    """Check the dataset, draw the sample or compare the renderers; print and write the results.

    Returns:
        Whether all is well.
    """
    all_well = True
    if config.view:
        check_viewer()
    if config.data is not None:
        if config.sample is not None:
            dataset = StereoDataset(config.data)
            with _folder(config.results(dataset), "sample").claim():
                for path in show_sample(config, dataset, config.sample):
                    print(path)
        else:
            check_unused(config.data)
            dataset = StereoDataset(config.data)
            with _folder(config.results(dataset), "report").claim():
                all_well = _report(config, dataset)
    if config.cross_check:
        with _folder(config.results(), "cross-check").claim():
            checks, notes = cross_check(load_place(config.scene), config.seed, config.views, NATECAM.camera)
            print(f"{counted(config.views, 'view')} of {config.scene}, seed {config.seed}, against Embree's rays")
            print("\n".join([table_of_renderers(checks), *notes]))
            report = {name: check.report() for name, check in checks.items()}
            content = {"scene": config.scene, "seed": config.seed, "renderers": report, "notes": notes}
            write_json(config.results() / "cross_check.json", content)
        all_well &= all(check.good for check in checks.values())
    if config.view and config.data is not None:
        dataset = StereoDataset(config.data)
        names = dataset.names if config.sample is None else [config.sample]
        show(dataset_shots(dataset.path, names, config.max_range), dataset.path.resolve().name)
    return all_well


def _folder(path: Path, thing: str) -> ResultFolder:
    """Return a folder for results, which may lie in the dataset that they describe."""
    return ResultFolder(path, thing, check_place=check_folder)


def _report(config: VerifyConfig, dataset: StereoDataset) -> bool:
    """Check a dataset, print and write the results, and return whether all is well."""
    from marssim.inspection.figures import statistics_figure  # not at the top, since it loads matplotlib

    out = config.results(dataset)
    findings, statistics = verify_dataset(config, dataset)
    pairs = {name: sum(s["split"] == name for s in dataset.index["samples"]) for name in SPLITS}
    pairs = {"all": len(dataset), **pairs}
    for finding in findings[:SHOWN]:
        print(finding)
    if len(findings) > SHOWN:
        print(f"and {len(findings) - SHOWN} more, see {out / 'verify.json'}")
    if statistics["all"].samples:
        print(table(statistics, pairs))
        print(statistics["all"].cover.table())
        figure = statistics_figure(statistics, f"{dataset.path.resolve().name}: {counted(len(dataset), 'pair')}")
        write_atomically(out / "statistics.png", figure)
    report = {
        "schema": "marssim-verify",
        "version": 1,
        "dataset": str(config.data),
        "digest": dataset.digest,
        "good": not findings,
        "findings": [asdict(finding) for finding in findings],
        "pairs": pairs,
        "statistics": {name: part.report() for name, part in statistics.items() if part.samples},
        "definitions": definitions,
    }
    write_json(out / "verify.json", report)
    verdict = _wrong({finding.path for finding in findings}) or "all files are as the index records them"
    print(f"{config.data}: {counted(len(dataset), 'pair')}, {verdict}; see {out}")
    return not findings


def _wrong(files: set[str]) -> str:
    """Return how many files are wrong and how to mend them; "" if none is."""
    if not files:
        return ""
    parts = [f"{counted(len(files), 'file')} wrong"]
    if any(file.startswith("scenes/") for file in files):
        parts.append("delete the folders of these samples, and repeat the command that made the dataset")
    if others := sorted(file for file in files if not file.startswith("scenes/")):
        parts.append(f"not of samples: {', '.join(others[:3])}{' and others' * (len(others) > 3)}")
    return "; ".join(parts)


def _read(root: Path, name: str) -> StereoSample | Finding:
    """Return a sample, or the finding on its broken file."""
    try:
        return read_sample(root / "scenes" / name)
    except DatasetError as error:
        message = str(error).removeprefix(f"{root / 'scenes' / name}/")
        file, _, problem = message.partition(": ")
        return Finding(f"scenes/{name}/{file}", problem)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    all_well = True

    def work(config: VerifyConfig) -> None:
        nonlocal all_well
        with writing_to(config.out or RESULTS):
            all_well = verify(config)

    return run_command(work, VerifyConfig, "python -m marssim.verify", __doc__, args, STARTS_OVER) or (
        0 if all_well else 1
    )


if __name__ == "__main__":
    sys.exit(main())
