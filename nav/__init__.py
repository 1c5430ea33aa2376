"""Depth in, wheel command out: map, traversability, planner and controller of a rover. numpy, scipy and OpenCV only.

The names are listed, with their types, in __init__.pyi. Each is loaded when it is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
