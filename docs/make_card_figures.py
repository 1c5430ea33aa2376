"""Make two of the model card's figures again, from its clean pairs: `python docs/make_card_figures.py data/clean`.

The rocks' is that of `python -m envs.rocks`, as the card gives it, with `--out out/rocks`.
"""

import shutil
import sys
from pathlib import Path

from m3depth.datasets.open import open_pairs
from m3depth.estimator import load_estimator
from m3depth.evaluation.scoring import evaluate
from m3depth.figures.errors import sparsification_figure
from m3depth.training.samples import Joined
from marssim.scene.presets import PRESETS

HERE = Path(__file__).parent / "images"
ROCKS = Path(__file__).parents[1] / "out" / "rocks" / "rocks.png"

if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    if not ROCKS.is_file():
        raise SystemExit(f"{ROCKS}: not there; run envs.rocks first, as the model card gives it")
    pairs = Joined([open_pairs(Path(sys.argv[1], place), "all") for place in PRESETS])
    done = evaluate(pairs, {"M3Depth": load_estimator("m3depth"), "SGBM": load_estimator("sgbm")})
    sparsification_figure(done.results, HERE / "weights_sparsification.png")
    shutil.copy(ROCKS, HERE / "weights_rocks.png")
