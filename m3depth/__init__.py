"""M3Depth: stereo depth and surface normals for Mars terrain.

`import m3depth` loads no torch; `m3depth.M3Depth` does, when it is first asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from m3depth.stereo.prediction import Prediction

if TYPE_CHECKING:
    from m3depth.network.model import M3Depth

__all__ = ["M3Depth", "Prediction"]


def __getattr__(name: str) -> Any:
    if name == "M3Depth":
        from m3depth.network.model import M3Depth

        return M3Depth
    raise AttributeError(f"module 'm3depth' has no attribute {name!r}")
