"""docs/concepts/result-files.md names every key of the results."""

import re
from pathlib import Path

import pytest

from envs.drives.episodes import EpisodeRecord
from envs.drives.metrics import summarise
from m3depth.evaluation.scores import Scores

PAGE = (Path(__file__).parents[2] / "docs/concepts/result-files.md").read_text(encoding="utf-8")
RECORD = {
    "driver": "navigator", "perception": "sgbm", "cell": "k=0", "episode": 0, "outcome": "goal", "steps": 9,
    "distance": 0.5, "start_distance": 9.0, "shortest": 9.0, "path_length": 9.5, "min_clearance": 1.0,
    "max_tilt_deg": 3.0, "reward": 1.0, "step_seconds": 0.1, "perception_seconds": 0.1, "redraws": 0, "goal": [9, 0],
}  # fmt: skip
OF_ROW = {"driver", "perception", "cell"}  # beside those of summarise
OF_METHOD = {"median_image", "seconds", "memory_mib", "gets_truth", "normals_are_fitted", "as_recorded"}


def keys(heading: str) -> set[str]:
    """Return the words in the first column of the table under a heading of columns."""
    table = PAGE.partition(f"| {heading} | What it holds |\n|---|---|\n")[2].partition("\n\n")[0]
    return {key for row in table.splitlines() for key in re.findall(r"`(\w+)`", row.split("|")[1])}


@pytest.mark.parametrize(
    ("heading", "expected"),
    [
        ("Key of a row in `results`", OF_ROW | set(summarise([EpisodeRecord(**RECORD)]))),
        ("Key of a method", OF_METHOD | set(Scores().result())),
    ],
)
def test_the_tables_name_every_key(heading, expected):
    assert keys(heading) == expected
