"""The real module whose place ``serial_ports`` takes: its results and its errors are those of the gateway."""

import importlib.util
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gateway.transport.devices import Opened, why_not_opened
else:
    _spec = importlib.util.spec_from_file_location(
        "tests.year._devices", Path(__file__).parents[2] / "gateway/transport/devices.py"
    )
    _module = importlib.util.module_from_spec(_spec)
    sys.modules[_spec.name] = _module
    _spec.loader.exec_module(_module)
    Opened, why_not_opened = _module.Opened, _module.why_not_opened

__all__ = ["Opened", "why_not_opened"]
