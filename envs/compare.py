"""Check and compare results of a suite, your own and those of others.

    python -m envs.compare --check their/results.json
    python -m envs.compare out/mine out/theirs --out out/comparison

One table has all methods of all files, compared on the episodes that all of them have driven. The others are compared
to the first method of the first file, or to --reference. Further tables have the steps, looks, time, near misses,
collisions and ways of each method; the failures: how they ended, and why, if they were recorded; the errors of the
depth on the way; and the correlation of success and SPL with these errors: which metric of the depth goes with drives.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from envs.comparison.conduct import conduct_of, conduct_table
from envs.comparison.depth_metrics import (
    condition_dots,
    correlate,
    correlation_table,
    depth_table,
    dots_without_each_course,
    one_sided,
    only_with_intervals,
)
from envs.comparison.methods import methods_of, under_conditions, with_first
from envs.comparison.repeats import repeat_in_words, repeats_of
from envs.comparison.report import compare_methods, comparison_notes, comparison_table, failures_of
from envs.comparison.suite_results import SuiteResults, read_results, results_file
from envs.drives.report import failure_table
from envs.suites.suite import load_suite
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER, counted
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, write_json
from marssim.base.files.markdown import in_table
from marssim.base.results.claim import ResultFolder


@dataclass(frozen=True)
class CompareConfig:
    """Check results of a suite, and compare them."""

    results: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Results of envs.evaluate --suite: files results.json, or the folders that hold them."""
    out: Path | None = None
    """Folder for comparison.json, comparison.md, comparison.png and depth_metrics.png. Left out: the tables are only
    printed."""
    track: Literal["eyes", "drivers", "both"] = "both"
    """Methods to compare: eyes (the navigator drives, so only the perception counts), drivers (all see true depth), or
    both (any driver with any perception)."""
    condition: tuple[str, ...] = ()
    """Conditions to compare the methods in; the table's row `all` is then over these alone. Left out: all that they
    drove."""
    reference: str | None = None
    """Method that the others are compared to, as the tables name it, such as "navigator, sgbm". Left out: the first one
    of the first file."""
    suite: str | None = None
    """Name or file of the suite, for one that is not in the package."""
    check: bool = False
    """Only check the files: that they keep to the schema, hold every episode that they name once, say what drove it,
    and contradict neither themselves nor the suite, in settings, episodes and figures. Says how many episodes of the
    split each of them holds."""

    def __post_init__(self) -> None:
        if not self.results:
            raise ValueError("name one file results.json or more")
        read: dict[Path, Path] = {}
        for path in self.results:
            file = results_file(path).resolve()
            if file in read:
                raise ValueError(
                    f"the file {path} is given twice{f', also as {read[file]}' if read[file] != path else ''}"
                )
            read[file] = path
        for name, default in (("out", None), ("track", "both"), ("condition", ()), ("reference", None)):
            if self.check and getattr(self, name) != default:
                raise ValueError(f"--{name} is for a comparison; with --check, the files are only checked")


def compare(config: CompareConfig) -> dict[str, Any]:
    """Compare the methods of the files.

    Returns:
        The content of comparison.json: suite, split, track; rows, notes and failures, as envs.comparison.report has
        them; repeats and conduct, as repeats_of and conduct_of have them; dots, correlations and one_sided, as
        envs.comparison.depth_metrics has them.

    Raises:
        DatasetError: A file cannot be true, two are of different suites or splits, parts of several evaluations cannot
            be told apart, or --out is a dataset.
        FolderInUse: Another command writes to --out.
        ValueError: No method is on the track, no method drove a condition or is the reference, or the methods have no
            episode in common.
    """
    files = [read_results(path, config.suite) for path in config.results]
    for file in files[1:]:
        if (file.suite, file.split) != (files[0].suite, files[0].split):
            raise DatasetError(
                f"{file.path}: is of {file.suite}, {file.split}, and {files[0].path} of {files[0].suite}, "
                f"{files[0].split}"
            )
    methods = methods_of(files, config.track)
    if not methods:
        raise ValueError(f"no method of these files is on the track {config.track}")
    methods = under_conditions(with_first(methods, config.reference), config.condition)
    dots = condition_dots(methods)
    content: dict[str, Any] = {
        "suite": files[0].suite, "split": files[0].split, "track": config.track, "rows": compare_methods(methods),
        "notes": comparison_notes(methods), "repeats": repeats_of(methods), "conduct": conduct_of(methods),
        "failures": failures_of(methods), "dots": dots,
        "correlations": only_with_intervals(correlate(dots, dots_without_each_course(methods))),
        "one_sided": one_sided(dots),
    }  # fmt: skip
    if config.out is not None:
        with ResultFolder(config.out, "comparison").claim():
            _write(config.out, content)
    return content


def _write(out: Path, content: Mapping[str, Any]) -> None:
    from envs.comparison.plots import plot_comparison, plot_depth_metrics  # not at the top, since it loads matplotlib

    write_json(out / "comparison.json", content)
    write_atomically(out / "comparison.md", page(content).encode())
    plot_comparison(out / "comparison.png", content["rows"])
    plot = out / "depth_metrics.png"
    if content["correlations"]:
        plot_depth_metrics(plot, content["dots"], content["correlations"])
    else:
        plot.unlink(missing_ok=True)  # of other methods


def page(content: Mapping[str, Any]) -> str:
    """Return the content of comparison.md from that of comparison.json."""
    head = f"Suite {content['suite']}, split {content['split']}, track {content['track']}.\n\n"
    sentences = [*content["notes"], *map(repeat_in_words, content["repeats"])]
    notes = "".join(f"- {in_table(sentence)}\n" for sentence in sentences)
    tables = f"{comparison_table(content['rows'])}\n{notes}"
    failures = failure_table([{**row, "method": in_table(row["method"])} for row in content["failures"]])
    correlations = correlation_table(content["correlations"], content["one_sided"])
    conduct = conduct_table(content["conduct"])
    parts = (head + tables, conduct, failures, depth_table(content["dots"]), correlations)
    return "\n".join(part for part in parts if part)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(_work, CompareConfig, "python -m envs.compare", __doc__, args, STARTS_OVER)


def _work(config: CompareConfig) -> None:
    if not config.check:
        print(page(compare(config)), end="")
        return
    if config.suite is not None:
        load_suite(config.suite)  # a wrong one is no fault of the files
    refused = 0
    for path in config.results:
        try:
            print(_in_words(read_results(path, config.suite)), flush=True)
        except DatasetError as error:
            if len(config.results) == 1:
                raise
            refused += 1
            print(f"error: {error}", file=sys.stderr)
    if refused:
        raise DatasetError(f"{refused} of {counted(len(config.results), 'file')} were refused")


def _in_words(file: SuiteResults) -> str:
    """Return a line on the content of a file."""
    driven = len(next(iter(file.episodes.values())))
    methods = "; ".join(", ".join(method) for method in file.episodes)
    whole = f"all {driven} episodes" if driven == file.of_split else f"{driven} of {file.of_split} episodes"
    part = "" if file.part is None or file.part["parts"] == 1 else f"one of {file.part['parts']} parts, with "
    return f"{file.path}: {part}{whole} of {file.suite}, {file.split}, by {methods}"


if __name__ == "__main__":
    sys.exit(main())
