"""What is compared: each candidate between a controller and drives on loopback TCP, or on pseudo terminals.

Every candidate is started once and kept for all rounds, as it would run in service; its first exchanges are
not counted. A fresh start each round would measure imports and cold caches.
"""

import shutil
import socket
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from bench.building import Programs
from bench.errors import BenchError
from bench.gateway_process import start_gateway
from bench.gateway_setup import Controller, GatewaySetup, LineSetup
from bench.measuring import Way
from bench.places import BENCH, ROOT
from bench.processes import Command, Processes
from gateway.simulator.pty import Pty

DIRECT: Final = "direct"
C_RELAY: Final = "relay in C"
SOCAT: Final = "socat"
MODBUS_PROXY: Final = "modbus-proxy"
PYMODBUS: Final = "pymodbus forwarder"
GATEWAY: Final = "gateway"
COMPILED: Final = "gateway compiled"
WITHOUT_TABLE: Final = ", no table"


@dataclass(frozen=True, slots=True)
class Tools:
    """What candidates are started with. ``relay_cpus``: where whatever stands in the middle runs."""

    programs: Programs
    compared_python: Path
    compiled: Path
    relay_cpus: tuple[int, ...] | None

    def packages(self, *, is_compiled: bool) -> Path:
        """Return where a gateway is imported from."""
        return self.compiled if is_compiled else ROOT


_given: set[int] = set()


def free_port() -> int:
    """Return a port of loopback that nobody uses, and that was not returned before."""
    while True:
        with socket.create_server(("127.0.0.1", 0)) as server:
            port: int = server.getsockname()[1]
        if port not in _given:
            _given.add(port)
            return port


Start = Callable[[Processes, Tools, int], Way]
"""Starts a candidate in front of a drive's TCP port; returns the way in."""


def _direct(_processes: Processes, _tools: Tools, drive: int) -> Way:
    return Way.tcp(drive)


def _c_relay(processes: Processes, tools: Tools, drive: int) -> Way:
    port = free_port()
    command: Command = [tools.programs.relay, f"listen:{port}", f"tcp:127.0.0.1:{drive}"]
    return Way.tcp(port, pids=(processes.start("relay-in-c", command, cpus=tools.relay_cpus).pid,))


def socat_program() -> str:
    """Return where socat is.

    Raises:
        BenchError: it is not installed.
    """
    program = shutil.which("socat")
    if program is None:
        raise BenchError("socat is not installed; as root: apt-get install socat")
    return program


def _socat(processes: Processes, tools: Tools, drive: int) -> Way:
    port = free_port()
    listen = f"TCP-LISTEN:{port},bind=127.0.0.1,reuseaddr,fork,nodelay"
    command = [socat_program(), listen, f"TCP:127.0.0.1:{drive},nodelay"]
    processes.start("socat", command, cpus=tools.relay_cpus)
    return Way.tcp(port)


def _modbus_proxy(processes: Processes, tools: Tools, drive: int) -> Way:
    port = free_port()
    program = tools.compared_python.with_name("modbus-proxy")
    command: Command = [program, "--bind", f"tcp://127.0.0.1:{port}", "--modbus", f"tcp://127.0.0.1:{drive}"]
    processes.start("modbus-proxy", command, cpus=tools.relay_cpus)
    return Way.tcp(port)


def _pymodbus(processes: Processes, tools: Tools, drive: int) -> Way:
    port = free_port()
    command: Command = [tools.compared_python, BENCH / "forwarder.py", str(port), str(drive)]
    processes.start("pymodbus-forwarder", command, cpus=tools.relay_cpus)
    return Way.tcp(port)


def _gateway(*, points: int = 201, is_compiled: bool = False) -> Start:
    def start(processes: Processes, tools: Tools, drive: int) -> Way:
        port = free_port()
        setup = GatewaySetup((LineSetup((Controller(tcp_port=port),), drive_port=drive),), points=points)
        name = f"gateway{'-compiled' if is_compiled else ''}-{points}"
        packages = tools.packages(is_compiled=is_compiled)
        gateway = start_gateway(processes, name, setup, cpus=tools.relay_cpus, packages=packages)
        return Way.tcp(port, pids=(gateway.relay_pid,))

    return start


def _whole_gateway(*, is_compiled: bool = False) -> Start:
    """Both processes, as an installation has them: with the page, which nobody looks at."""

    def start(processes: Processes, tools: Tools, drive: int) -> Way:
        port, page_port = free_port(), free_port()
        line = LineSetup((Controller(tcp_port=port),), drive_port=drive)
        name = f"gateway-whole{'-compiled' if is_compiled else ''}"
        gateway = start_gateway(
            processes,
            name,
            GatewaySetup((line,), http_port=page_port),
            is_whole=True,
            cpus=tools.relay_cpus,
            packages=tools.packages(is_compiled=is_compiled),
        )
        return Way.tcp(port, pids=gateway.pids_once_whole(page_port))

    return start


TCP_CANDIDATES: Final[dict[str, Start]] = {
    DIRECT: _direct,
    C_RELAY: _c_relay,
    SOCAT: _socat,
    GATEWAY: _gateway(),
    GATEWAY + WITHOUT_TABLE: _gateway(points=0),
    COMPILED: _gateway(is_compiled=True),
    COMPILED + WITHOUT_TABLE: _gateway(points=0, is_compiled=True),
    MODBUS_PROXY: _modbus_proxy,
    PYMODBUS: _pymodbus,
}

WHOLE_CANDIDATES: Final[dict[str, Start]] = {
    DIRECT: _direct,
    C_RELAY: _c_relay,
    SOCAT: _socat,
    GATEWAY: _whole_gateway(),
    COMPILED: _whole_gateway(is_compiled=True),
}


@dataclass(frozen=True, slots=True)
class Cable:
    """Two pseudo terminals: the controller's and the drive's end of the middle's two serial ports."""

    near: Pty
    far: Pty


StartOnPtys = Callable[[Processes, Tools, Cable], None]
"""Starts a candidate between two serial ports."""


def _c_relay_on_ptys(processes: Processes, tools: Tools, cable: Cable) -> None:
    command: Command = [tools.programs.relay, f"tty:{cable.near.path}", f"tty:{cable.far.path}"]
    processes.start("relay-in-c-ptys", command, cpus=tools.relay_cpus)


def _socat_on_ptys(processes: Processes, tools: Tools, cable: Cable) -> None:
    command = [socat_program(), f"{cable.near.path},raw,echo=0", f"{cable.far.path},raw,echo=0"]
    processes.start("socat-ptys", command, cpus=tools.relay_cpus)


def gateway_on_ptys(*, points: int = 201, baudrate: int = 115200, is_compiled: bool = False) -> StartOnPtys:
    """Return how the gateway is started between two serial ports."""

    def start(processes: Processes, tools: Tools, cable: Cable) -> None:
        near = (Controller(tty=cable.near.path),)
        line = LineSetup(near, drive_tty=cable.far.path, baudrate=baudrate)
        name = f"gateway-ptys{'-compiled' if is_compiled else ''}-{points}-{baudrate}"
        setup = GatewaySetup((line,), points=points)
        packages = tools.packages(is_compiled=is_compiled)
        start_gateway(processes, name, setup, cpus=tools.relay_cpus, packages=packages)

    return start


PTY_CANDIDATES: Final[dict[str, StartOnPtys]] = {
    C_RELAY: _c_relay_on_ptys,
    SOCAT: _socat_on_ptys,
    GATEWAY: gateway_on_ptys(),
    GATEWAY + WITHOUT_TABLE: gateway_on_ptys(points=0),
    COMPILED: gateway_on_ptys(is_compiled=True),
}
