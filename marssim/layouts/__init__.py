"""The folder layouts of well-known stereo benchmarks."""
