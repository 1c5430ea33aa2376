"""M3Depth: depth and surface normals of Mars terrain from a stereo pair, and the methods that it is compared with.

    from m3depth import load_estimator
    prediction = load_estimator("m3depth").infer(left, right, rig)  # depth [m], disparity [px], normals, confidence

The names are listed, with their types, in __init__.pyi. Each is loaded when it is first used, so `import m3depth` loads
no torch. If torch is imported later, its threads do not wait long in loops (marssim.base.compute.waiting).
"""

import lazy_loader

from marssim.base.compute.waiting import wait_briefly
from marssim.base.version import VERSION as __version__  # noqa: F401

wait_briefly()  # before torch is imported, which reads it then

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
