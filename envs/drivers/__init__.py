"""Drivers of MarsNav-v0: the navigator, simple baselines, trained policies and your own.

__init__.pyi lists the public names with their types. Each is loaded at its first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
