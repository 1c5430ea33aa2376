from dataclasses import replace
from itertools import count

import numpy as np
import pytest
import torch

from m3depth import M3Depth
from m3depth.evaluation.cost import measured
from m3depth.network.device import fast_dtype
from m3depth.stereo.classical import SGBM
from m3depth.training.config import TrainConfig, recipe_defaults
from m3depth.training.loop import backward
from m3depth.training.run import Run
from m3depth.training.samples import PackedCache, make_batch
from marssim.base.camera import NATECAM
from marssim.base.dataset.sample import StereoSample

pytestmark = pytest.mark.benchmark


def images(height=512, width=512):
    rng = np.random.default_rng(0)
    texture = rng.integers(0, 255, (height, width + 32, 3)).astype(np.uint8)
    return texture[:, :width], texture[:, 20 : width + 20]


def test_inference(clock, capsys):
    """The network as it ships, with its number of refinement steps, and what the process holds meanwhile."""
    left, right = images()
    network, sgbm = M3Depth.from_pretrained(), SGBM()
    steps = network.config.refine_steps
    clock(f"M3Depth as shipped, {steps} steps, 512 x 512", lambda: network.infer(left, right, NATECAM))
    out, cost = measured(network.infer, left, right, NATECAM)
    assert out.depth.shape == (512, 512)
    if cost.peak_mib is not None:
        with capsys.disabled():
            print(f"\npeak memory of the process meanwhile: {cost.peak_mib:.0f} MiB", end="")
    clock("OpenCV SGBM, padded, filled, with normals, 512 x 512", lambda: sgbm.infer(left, right, NATECAM))


def test_training_step_and_its_loading(clock, capsys, tmp_path):
    """A whole step as m3depth.train takes it, and what its crops cost the thread that loads them meanwhile."""
    config = TrainConfig(data=(tmp_path,), out=tmp_path, max_steps=1, device="cpu")
    cache = PackedCache([random_sample(seed) for seed in range(2)], 1 << 30)
    steps = count()
    loading = clock("making 4 crops of 256 x 448, augmented", lambda: crops(cache, config, next(steps)))
    stepping = clock("M3Depth lite, a training step of 4 crops of 256 x 448", training_step(config, cache), 3)
    with capsys.disabled():
        print(f"\n{config.batch / stepping:.2f} crops/s; loading is {loading / stepping:.1%} of a step", end="")


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@pytest.mark.parametrize(
    ("preset", "recipe", "batch", "parts"),
    [("lite", "own", 64, 1), ("paper", "paper", 12, 2), ("paper", "paper", 12, 3), ("paper", "own", 4, 1)],
)
def test_training_step_on_a_gpu(clock, capsys, tmp_path, preset, recipe, batch, parts):
    """lite with a batch that fills the card; the paper's preset by its own recipe, in parts, and by that of lite."""
    own = TrainConfig(data=(tmp_path,), out=tmp_path)
    config = replace(
        recipe_defaults(["--recipe", recipe]) or own, data=own.data, out=own.out, max_steps=1, device="cuda",
        preset=preset, batch=batch, accumulate=parts,
    )  # fmt: skip
    torch.cuda.reset_peak_memory_stats()
    step = training_step(config, PackedCache([random_sample(seed) for seed in range(2)], 1 << 30))

    def whole():
        step()
        torch.cuda.synchronize()

    size = " x ".join(map(str, config.crop))
    stepping = clock(f"M3Depth {preset}, a training step of {batch} crops of {size}, --accumulate {parts}", whole)
    with capsys.disabled():
        held = torch.cuda.max_memory_allocated() / 2**30
        print(f"\n{batch / stepping:.1f} crops/s, {held:.1f} GiB, {torch.cuda.get_device_name()}", end="")


def crops(cache, config, step):
    return make_batch(cache, step, config.batch, config.crop, config.augment, config.seed)


def training_step(config, cache):
    """A function that takes one step, of crops that are there already."""
    run = Run(config, torch.device(config.device))
    batch = crops(cache, config, 0).to(run.device)

    def step():
        run.optimizer.zero_grad()
        backward(run.model, batch, config, fast_dtype(run.device))
        run.optimizer.step()

    return step


def random_sample(seed):
    rng = np.random.default_rng(seed)
    left, right = images()
    depth = rng.uniform(2, 12, (512, 512)).astype(np.float32)
    normal = np.broadcast_to(np.float32([0, -0.6, -0.8]), (512, 512, 3))
    yes, none = np.ones((512, 512), bool), np.zeros((512, 512), np.int32)
    disparity = NATECAM.depth_to_disparity(depth)
    return StereoSample(left, right, depth, disparity, normal, yes, ~yes, none, NATECAM, {})
