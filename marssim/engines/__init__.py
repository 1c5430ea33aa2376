"""The ray tracers and rasterizers that the simulator calls."""
