"""Score methods on all pairs of a folder without true depth, and write the table. A stopped run continues."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from m3depth.estimator import Estimator
from m3depth.evaluation.report import on_fewer_pixels
from m3depth.evaluation.resume import SavedState
from m3depth.evaluation.without_truth.pairs import ImagePair
from m3depth.evaluation.without_truth.scoring import means, score_pair, table
from marssim.base.command.progress import watched
from marssim.base.command.signals import stop_on_signal
from marssim.base.command.wording import counted
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import write_json
from marssim.base.files.markdown import in_table

FIGURE = "qualitative.png"  # the methods side by side, which the caller draws
RULES = (
    "Without true depth: of the pixels that the left eye measures and the right eye does not leave unknown, the share "
    "on which their disparities agree within 1 px (sky in the right eye does not agree), which favours a method that "
    "leaves the hard pixels unknown; the same share on the pixels that count for every method, which compares them; "
    "the mean difference of the normalised images where the right one is warped by the disparity, on the pixels that "
    "SGBM matched and the method measured, which are others for each method; its ratio to SGBM's on the same pixels, "
    "which compares them; the shares of sky and unknown pixels. "
    "Masked pixels do not count, nor, in all but the shares of sky and unknown pixels, those whose match is masked."
)


def score_without_truth(
    pairs: Sequence[ImagePair],
    methods: Mapping[str, Estimator],
    out: Path,
    about: Mapping[str, Any],
    saved_state: SavedState,
    align_rows: bool = False,
) -> None:
    """Score the methods on pairs, write results.json and results.md, and print the table.

    Args:
        pairs: The pairs.
        methods: The methods, by the name of their column.
        out: The folder, which the caller has claimed.
        about: What the results say about the run.
        saved_state: Where the scores so far are saved, and loaded from; the caller removes it when the figure is drawn.
        align_rows: Whether to align the rows of each pair first.

    Raises:
        DatasetError: A file of a pair cannot be used.
        EstimatorError: A method returned no whole Prediction.
        KeyboardInterrupt: After a signal (stop_on_signal), once the current pair is scored and saved.
    """
    records: list[dict[str, Any]] = (saved_state.load() or {"pairs": []})["pairs"]
    rest = pairs[len(records) :]
    if rest:
        first = rest[0].read()
        for method in methods.values():
            first.infer(method)(first.left, first.right, first.rig)  # warms it up
    with stop_on_signal() as signals:
        for pair in watched(rest, "pair", "evaluate"):
            records.append({"pair": pair.name, **score_pair(methods, pair.read(), align_rows)})
            saved_state.save_now_and_then(lambda: {"pairs": records})
            if signals:
                saved_state.save({"pairs": records})
                raise KeyboardInterrupt
    saved_state.save({"pairs": records})
    results = means(records, list(methods))
    write_json(out / "results.json", {**about, "methods": results, "per_pair": records}, sort_keys=False)
    scored = f"{counted(len(records), 'pair')} of `{about['data']}`{on_fewer_pixels(about)}"
    parts = [f"# Evaluation without true depth\n\n{scored}. {RULES}\n"]
    parts.append(f"\n![The methods side by side]({FIGURE})\n")
    parts.append(f"\nMeans over the pairs:\n\n{table(results, markdown=True)}\n")
    for name in methods:
        rows = {record["pair"]: record[name] for record in records}
        parts.append(f"\n## {in_table(name)}\n\n{table(rows, markdown=True)}\n")
    write_atomically(out / "results.md", "".join(parts).encode())
    print(table(results))
    print(f"{counted(len(records), 'pair')} without true depth; the scores of each are in {out / 'results.md'}")
