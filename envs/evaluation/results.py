"""What an evaluation writes from the records of its episodes: results.json, the report, the plots and the pages."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import product
from typing import Any

from envs.drives.episodes import EpisodeRecord
from envs.drives.metrics import paired_difference, summarise
from envs.drives.report import write_report
from envs.evaluation.config import EvaluateConfig
from envs.evaluation.driving import record_of_task
from envs.evaluation.suite_drives import suite_results
from envs.recording.drive_page import DRIVES, write_drive_pages
from envs.recording.results_page import write_results_page
from marssim.base.files.json_file import as_json, write_json


def write_results(
    config: EvaluateConfig, provenance: Mapping[str, Any], test_errors: Mapping[str, float]
) -> tuple[dict[str, Any], list[EpisodeRecord]]:
    """Write results.json, results.md, the plots and the maps from the records of all episodes.

    Args:
        config: The settings.
        provenance: Entries of results.json: settings, digests of files, runtime and versions.
        test_errors: Abs Rel of perceptions on their test set.

    Returns:
        The content of results.json, and the records.

    Raises:
        DatasetError: A record is missing, damaged, or of another episode.
    """
    records = [record_of_task(config, task) for task in config.tasks]
    content = {
        "config": as_json(asdict(config)),
        **provenance,
        "code": dict(Counter(record.code for record in records)),
        "test_set_abs_rel": test_errors,
        "results": _results(config, records),
        "differences": _differences(config, records),
        **suite_results(config, records),
    }
    write_json(config.out / "results.json", content)
    write_report(config.out, content, records)
    for broken in write_drive_pages(config.out / DRIVES)[1]:
        print(f"warning: {broken}", file=sys.stderr)
    write_results_page(config.out, content, records, [task.file for task in config.tasks])
    return content, records


def _results(config: EvaluateConfig, records: Sequence[EpisodeRecord]) -> list[dict[str, Any]]:
    """Return a row for each cell, driver and perception."""
    rows = []
    for cell in config.cells:
        for driver, perception in product(config.driver, config.perception):
            drives = [r for r in records if (r.driver, r.perception, r.cell) == (driver, perception, cell.name)]
            if drives:  # a shard may have none
                rows.append({"driver": driver, "perception": perception, "cell": cell.content(), **summarise(drives)})
    return rows


def _differences(config: EvaluateConfig, records: Sequence[EpisodeRecord]) -> list[dict[str, Any]]:
    """Return success and SPL of every driver and perception less those of the first, paired, over all cells."""
    groups = list(product(config.driver, config.perception))
    drives = {group: [r for r in records if (r.driver, r.perception) == group] for group in groups}
    first = groups[0]
    return [
        {
            "driver": group[0], "perception": group[1], "less": list(first),
            **paired_difference(drives[group], drives[first]),
        }
        for group in groups[1:]
    ]  # fmt: skip
