"""RAFT-Stereo: one disparity map, corrected step by step by recurrent units at three resolutions.

Lipson, Teed and Deng: "RAFT-Stereo: Multilevel Recurrent Field Transforms for Stereo Matching", 3DV 2021,
arXiv:2109.07547; the sizes are those of its released model.

A feature encoder describes both images at 1/4, a context encoder the left one at 1/4, 1/8 and 1/16. All pixels of a row
are correlated once, and averaged over 2, 4 and 8 columns of the right image. Each step looks up the scores around the
current disparity, updates the states from coarse to fine, each from its neighbours' and the finest also from what was
looked up, and adds a correction. Learned weights upsample each map. The flow's second component, which the released
model computes and sets to zero, is left out, and the steps' disparities do not pass on their gradient.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from m3depth.network.refinement import ConvGRU
from m3depth.rivals.config import RaftStereoConfig
from m3depth.rivals.recurrent import SCALES, MotionEncoder, RecurrentStereo, correction_head, enlarged, halved


class Update(nn.Module):
    """One step: the three states from coarse to fine, and the correction of the disparity."""

    def __init__(self, config: RaftStereoConfig) -> None:
        super().__init__()
        hidden = config.hidden
        samples = config.lookup_levels * (2 * config.lookup_radius + 1)
        self.motion = MotionEncoder(samples, config.motion, hidden)
        self.units = nn.ModuleList([ConvGRU(hidden, size * hidden) for size in (2, 2, 1)])
        self.head = correction_head(hidden, config.head)

    def forward(
        self, states: list[Tensor], contexts: list[Tensor], cells: Tensor, scores: Tensor
    ) -> tuple[list[Tensor], Tensor]:
        """Return the new states, and the corrected disparity.

        Args:
            states: (B, hidden, ...) at 1/4, 1/8 and 1/16.
            contexts: (B, 3 hidden, ...) likewise, added to the gates.
            cells: (B, 1, h, w) disparity [cells].
            scores: (B, samples, h, w) around it.
        """
        fine, middle, coarse = states
        coarse = self.units[2](coarse, halved(middle), contexts[2])
        middle = self.units[1](middle, torch.cat([halved(fine), enlarged(coarse, middle)], 1), contexts[1])
        motion = self.motion(cells, scores)
        fine = self.units[0](fine, torch.cat([motion, enlarged(middle, fine)], 1), contexts[0])
        return [fine, middle, coarse], cells + self.head(fine).float()


class RaftStereo(RecurrentStereo):
    """RAFT-Stereo."""

    def __init__(self, config: RaftStereoConfig) -> None:
        super().__init__(config)
        self.gates = nn.ModuleList([nn.Conv2d(config.hidden, 3 * config.hidden, 3, padding=1) for _ in range(SCALES)])
        self.update = Update(config)

    def inputs(self, contexts: list[Tensor]) -> tuple[list[Tensor], ...]:
        """Return the parts of the gates that do not change from step to step, (B, 3 hidden, ...) each."""
        return ([gate(context) for gate, context in zip(self.gates, contexts, strict=True)],)
