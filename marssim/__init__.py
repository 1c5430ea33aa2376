"""Mars terrain, its stereo images with ground truth, and datasets of them.

    import marssim
    scene = marssim.build_scene(marssim.preset("gale"), rng=7)
    frame = marssim.render_view(scene, x=2.0, y=-1.0, yaw_deg=30, sun_elevation_deg=10)
    frame.left, frame.depth, frame.normal

    pairs = marssim.StereoDataset("data/utopia", split="train")

The names are listed, with their types, in __init__.pyi. Each is loaded when it is first used, so `import marssim` loads
no renderer and no physics.
"""

import lazy_loader

from marssim.base.version import VERSION as __version__  # noqa: F401

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
