import numpy as np
import pytest
import torch

from m3depth import M3Depth
from m3depth.matching import SGBM
from marssim.camera import NATECAM

pytestmark = pytest.mark.benchmark


def images(height=512, width=512):
    rng = np.random.default_rng(0)
    texture = rng.integers(0, 255, (height, width + 32, 3)).astype(np.uint8)
    return texture[:, :width], texture[:, 20 : width + 20]


def test_inference(clock):
    left, right = images()
    network, sgbm = M3Depth.from_preset("lite"), SGBM()
    clock("M3Depth lite, 512 x 512", lambda: network.infer(left, right, NATECAM))
    out = network.infer(left, right, NATECAM)
    assert out.depth.shape == (512, 512)
    clock("OpenCV SGBM, padded, filled, with normals, 512 x 512", lambda: sgbm.infer(left, right, NATECAM))


def test_training_step(clock):
    network = M3Depth.from_preset("lite").train()
    left, right = torch.rand(2, 3, 256, 448), torch.rand(2, 3, 256, 448)
    camera = torch.tensor([[595.9, 595.9, 223.5, 127.5]] * 2)

    def step():
        network.zero_grad()
        network(left, right, camera).disparity.mean().backward()

    seconds = clock("M3Depth lite, forward and backward, 2 crops 256 x 448", step, 3)
    assert seconds > 0
