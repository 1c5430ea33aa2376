import subprocess
import sys

import torch
from torch import nn

from m3depth.network.stereo_network import _Undrawn

LOADING = """
import sys
from m3depth import M3Depth
M3Depth.from_pretrained()
print([name for name in ("torch._dynamo", "sympy") if name in sys.modules])
"""


def test_loading_weights_does_not_import_the_compiler_of_pytorch():
    done = subprocess.run([sys.executable, "-c", LOADING], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_weights_that_are_not_drawn_have_their_shapes():
    with torch.device("meta"), _Undrawn():
        layer = nn.Conv2d(3, 5, 7)
        nn.init.normal_(layer.weight, std=0.1)
        nn.init.zeros_(tensor=layer.bias)
        assert (layer.weight + 1).shape == (5, 3, 7, 7) and layer.bias.is_meta
