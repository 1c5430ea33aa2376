"""A rover's navigator: depth goes in, wheel commands come out. Needs numpy, scipy and OpenCV only.

It holds the elevation map, the traversability, the planner and the controller. __init__.pyi lists the public names with
their types. Each is loaded at its first use.
"""

import lazy_loader

from marssim.base.version import VERSION as __version__  # noqa: F401

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
