"""The rover's environment MarsNav-v0, its drivers, and drives to compare them by.

    import gymnasium
    env = gymnasium.make("envs:MarsNav-v0")

`import envs` registers the environment and loads no torch, physics or renderer. If torch is imported later, its threads
do not wait long in loops (marssim.base.compute.waiting). __init__.pyi lists the public names with their types. Each is
loaded at its first use.
"""

import gymnasium
import lazy_loader

from marssim.base.compute.waiting import wait_briefly
from marssim.base.version import VERSION as __version__  # noqa: F401

wait_briefly()  # before torch is imported, which reads it then

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

gymnasium.register(id="MarsNav-v0", entry_point="envs.mars_nav:MarsNavEnv")
