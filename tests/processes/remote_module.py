"""A remote I/O module with a contact: pymodbus's servers, on TCP and on a serial port, for the same coils.

``python -m tests.processes.remote_module PORT LINK WATCHDOG_S``: LINK becomes the name of its serial port.
It opens all contacts WATCHDOG_S after the last write; 0: it has no watchdog.
"""

import asyncio
import contextlib
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pymodbus.client import ModbusTcpClient
from pymodbus.pdu import ModbusPDU
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from gateway.transport.null_modem import NullModem
from tests.support.ports import free_port
from tests.support.processes import ROOT, SECONDS, eventually

UNIT_ID, COILS = 1, 16
WRITE_COIL = 5


def name_port(link: Path, device: str) -> None:
    """Give a serial port a name that lasts, as udev does."""
    link.unlink(missing_ok=True)
    link.symlink_to(device)


async def serve(port: int, link: Path, watchdog_s: float) -> None:
    """Serve until killed."""
    cable = NullModem()
    loop = asyncio.get_running_loop()
    expiry: list[asyncio.TimerHandle] = []
    opening: set[asyncio.Task[Any]] = set()

    def open_all() -> None:
        opening.add(loop.create_task(tcp.context.async_setValues(UNIT_ID, WRITE_COIL, 0, [False] * COILS)))

    def traced(is_reply: bool, pdu: ModbusPDU) -> ModbusPDU:
        if watchdog_s and not is_reply and pdu.function_code == WRITE_COIL:
            for timer in expiry:
                timer.cancel()
            expiry[:] = [loop.call_later(watchdog_s, open_all)]
        return pdu

    coils = [SimData(0, count=COILS, values=False, datatype=DataType.BITS)]
    device = SimDevice(UNIT_ID, simdata=(coils, coils, [SimData(0)], [SimData(0)]))
    tcp = ModbusTcpServer(device, address=("127.0.0.1", port), trace_pdu=traced)
    rtu = ModbusSerialServer(device, port=cable.far, baudrate=115200, trace_pdu=traced)
    rtu.context = tcp.context
    name_port(link, cable.near)
    await asyncio.gather(tcp.serve_forever(), rtu.serve_forever())


class RemoteModule:
    """The module, which can lose its supply and get it back, and somebody who reads its coils over TCP."""

    def __init__(self, folder: Path, watchdog_s: float = 0.0) -> None:
        self.port, self.link = free_port(), folder / "ttyContact"
        self._command = [
            *(sys.executable, "-m", "tests.processes.remote_module"),
            *(str(self.port), str(self.link), str(watchdog_s)),
        ]
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Switch it on; returns when it answers."""
        self._process = subprocess.Popen(self._command, cwd=ROOT, stderr=subprocess.DEVNULL)
        eventually(self._answers, bool)

    def stop(self) -> None:
        """Take its supply away: with it go its serial port and its connections."""
        if self._process is not None:
            self._process.kill()
            self._process.wait(SECONDS)

    def _answers(self) -> bool:
        with contextlib.suppress(OSError):
            socket.create_connection(("127.0.0.1", self.port), timeout=SECONDS).close()
            return self.link.exists()
        return False

    def is_closed(self, coil: int) -> bool:
        """Read a contact."""
        with contextlib.closing(ModbusTcpClient("127.0.0.1", port=self.port)) as client:
            eventually(client.connect, bool)
            return bool(client.read_coils(coil, count=1, device_id=UNIT_ID).bits[0])

    def wait_for(self, coil: int, *, is_closed: bool) -> None:
        """Wait until a contact is closed or open."""
        eventually(lambda: self.is_closed(coil), lambda closed: closed is is_closed)


@contextlib.contextmanager
def module_in(folder: Path, watchdog_s: float = 0.0) -> Iterator[RemoteModule]:
    """A module that is on."""
    module = RemoteModule(folder, watchdog_s)
    module.start()
    try:
        yield module
    finally:
        module.stop()


if __name__ == "__main__":
    asyncio.run(serve(int(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3])))
