"""OpenVINO, imported so that it reports nothing to anybody.

Where its package openvino_telemetry is installed, which comes with it, OpenVINO sends a message to Google Analytics as
soon as it is imported, from a forked process, and keeps an identifier of the user in the home folder. It does without
where that package is missing, and so it seems to be while this module imports OpenVINO.

From here, import `openvino` with the parts that this package uses.
"""

from __future__ import annotations

import sys
from typing import Any

_modules: dict[str, Any] = sys.modules
_TELEMETRY = "openvino_telemetry"
_loaded = _modules.get(_TELEMETRY)
_modules[_TELEMETRY] = None  # Python takes it for a module that does not exist
try:
    import openvino
    import openvino.frontend.pytorch.ts_decoder
    import openvino.passes
finally:
    _modules.pop(_TELEMETRY)
    if _loaded is not None:
        _modules[_TELEMETRY] = _loaded

__all__ = ["openvino"]
