"""Stereo datasets of others, read where they lie. `m3depth.datasets.open.open_pairs` opens them all."""
