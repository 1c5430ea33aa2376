"""A network that has every part and trains in a second."""

from m3depth.network.config import M3DepthConfig

SMALL = M3DepthConfig(
    channels=(8, 8, 16), wavelet_levels=(1, 1), match_channels=16, hypotheses=8, groups=8, volume_width=8,
    residual_width=8, normal_widths=(8, 8, 8), normal_context=3, refine_steps=2, hidden=8, motion=8, lookup_channels=8,
    fine_width=8,
)  # fmt: skip
