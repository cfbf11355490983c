"""Puts the simulated system in the place of the real one: two modules, before anything else is imported.

What takes no part, and what tests it instead:

- ``gateway.system`` (clocks, waiting, bytes, timers): ``tests/transport/test_system.py``.
- ``gateway.transport.devices`` (pyserial, termios, drivers): ``tests/transport/test_serial.py``.
"""

import importlib
import sys
from typing import Final

STANDINS: Final = {
    "gateway.system": "tests.year.system",
    "gateway.transport.devices": "tests.year.serial_ports",
}


def install() -> None:
    """Put them there.

    Raises:
        RuntimeError: the gateway has been imported already.
    """
    if any(name.startswith("gateway") for name in sys.modules):
        raise RuntimeError("the simulated system comes first: run python -m tests.year")
    for name, standin in STANDINS.items():
        package, _, module = name.rpartition(".")
        parent = importlib.import_module(package)
        sys.modules[name] = found = importlib.import_module(standin)
        setattr(parent, module, found)
