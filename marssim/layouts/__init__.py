"""The folder layouts of well-known stereo benchmarks, as marssim.export writes them."""
