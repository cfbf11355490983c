"""An RTU line with two drives that fall ill in the ways that wiring knows, and two controllers before it."""

import contextlib
import json
import os
import select
import socket
import threading
import time
import tty
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any, Final

from gateway.modbus.rtu import RtuRequestDecoder, encode_rtu
from tests.support.config import axis, gateway_toml, line, registers, tab, tcp, written
from tests.support.ports import free_port
from tests.support.processes import SECONDS, Running, ending, running

GARBAGE: Final = bytes.fromhex("FE 9C 38 F0 E6 80")
"""As a receiver hears that samples at another rate: no frame of six bytes has this check sum."""
EVERY_S: Final = 0.05
"""Between two looks at the status, of which there is a new one five times a second."""
TRIES: Final = 3
ANSWER_S: Final = 10.0
"""So long a controller waits for an answer before it asks again."""


class Health(Enum):
    """What a drive does when it is asked."""

    WELL = "well"
    SILENT = "silent"
    GARBLED = "garbled"


class Port:
    """A serial port: the program that is tested opens ``path``, the test has the other end."""

    def __init__(self) -> None:
        self.fd, self._slave = os.openpty()
        for fd in (self.fd, self._slave):
            tty.setraw(fd)
        self.path = os.ttyname(self._slave)

    def close(self) -> None:
        """Close both ends."""
        os.close(self.fd)
        os.close(self._slave)


class Drives:
    """Two drives on one wire, unit ids 1 and 2; homed, and standing where they were told."""

    def __init__(self) -> None:
        self.port = Port()
        self.health = {1: Health.WELL, 2: Health.WELL}
        self.counts = {1: 0, 2: 0}
        self.takes_s = {1: 0.0, 2: 0.0}
        """How long a drive takes for its answer."""
        self.needs_silence_s = 0.0
        """A request that comes sooner after an answer is not heard."""
        self.asked: list[bytes] = []
        self._ending, self._ended = os.pipe()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Take the drives from the wire."""
        os.write(self._ended, b"x")
        self._thread.join(SECONDS)
        for fd in (self._ending, self._ended):
            os.close(fd)
        self.port.close()

    def _serve(self) -> None:
        decoder, now_ns, answered_s = RtuRequestDecoder(), 0, -1.0
        while True:
            ready, _, _ = select.select([self.port.fd, self._ending], [], [])
            if self._ending in ready:
                return
            now_ns += 10**9  # each read begins after a silence
            came_s = time.monotonic()
            for unit_id, pdu in decoder.feed(os.read(self.port.fd, 300), now_ns):
                self.asked.append(pdu)
                if came_s - answered_s < self.needs_silence_s:
                    continue
                health = self.health.get(unit_id, Health.SILENT)
                select.select([self._ending], [], [], self.takes_s.get(unit_id, 0.0))
                if health is Health.WELL:
                    answered_s = time.monotonic()  # before: no silence seems shorter than it is
                    os.write(self.port.fd, encode_rtu(unit_id, self._reply(unit_id, pdu)))
                elif health is Health.GARBLED:
                    os.write(self.port.fd, GARBAGE)

    def _reply(self, unit_id: int, pdu: bytes) -> bytes:
        if pdu[0] == 0x10:
            self.counts[unit_id] = int.from_bytes(pdu[6:10], "big", signed=True)
            return pdu[:5]
        address = int.from_bytes(pdu[1:3], "big")
        if address == 300:
            return bytes.fromhex("03 02 0001")
        return bytes.fromhex("03 04") + self.counts[unit_id].to_bytes(4, "big", signed=True)


class SickLine:
    """The configuration, and what it is connected to."""

    def __init__(self, folder: Path) -> None:
        self.drives, self.plc = Drives(), Port()
        http, self.cnc_port, self.panel_port = (free_port() for _ in range(3))
        self.address = f"http://127.0.0.1:{http}/"
        serial = {"baudrate": 115200, "parity": "even"}
        wires = line(
            {"rtu": self.drives.port.path, **serial},
            # Controllers may be silent: a test that opens a page on a busy machine asks nothing for seconds.
            {
                "cnc": {**tcp(self.cnc_port), "timeout_ms": 300, "silent_after_s": 0},
                "panel": {**tcp(self.panel_port), "timeout_ms": 300, "silent_after_s": 0},
                "plc": {"rtu": self.plc.path, **serial, "role": "monitor"},
            },
            name="xy",
            response_timeout_ms=300,
            drain_ms=20,
        )
        axes = [
            axis(
                name,
                {**registers(command=100, actual=200), "bits.homed": {"address": 300, "bit": 0}},
                line="xy",
                unit_id=unit_id,
                referenced="drive-bit",
                compensation="on",
                table=f"{name}.tab",
                budget_us=1000000,
            )
            for unit_id, name in enumerate("xy", start=1)
        ]
        tables = {f"{name}.tab": tab(0.0, 0.05, 0.1, name=name.upper()) for name in "xy"}
        text = gateway_toml(wires, *axes, name="mill-1", http=f"127.0.0.1:{http}")
        self.config = written(folder, text, tables)

    def close(self) -> None:
        """Take everything apart."""
        self.drives.close()
        self.plc.close()

    @contextlib.contextmanager
    def running(self) -> Iterator[Running]:
        """Start the gateway; yields it once its page is there and the line is open."""
        with running("run", str(self.config)) as gateway:
            gateway.until_each("line-up", "http-ready", "relay-reached")
            with ending(gateway):
                yield gateway

    def get(self, path: str) -> tuple[int, bytes]:
        """Return code and body of what the gateway answers at a path."""
        try:
            with urllib.request.urlopen(f"{self.address}{path}", timeout=SECONDS) as answer:
                return answer.status, answer.read()
        except urllib.error.HTTPError as error:
            with error:
                return error.code, error.read()

    def status(self) -> dict[str, Any]:
        """Return the status."""
        found: dict[str, Any] = json.loads(self.get("status")[1])
        return found

    def until(
        self, is_so: Callable[[dict[str, Any]], bool], meanwhile: Callable[[], object]
    ) -> dict[str, Any]:
        """Go on with something until the status is so; returns it then."""
        while True:
            meanwhile()
            status = self.status()
            if is_so(status):
                return status
            time.sleep(EVERY_S)

    def until_trouble(self, kind: str, meanwhile: Callable[[], object]) -> dict[str, Any]:
        """Go on with something until a kind of trouble is there; returns that."""
        status = self.until(lambda status: kind in kinds(status), meanwhile)
        found: dict[str, Any] = next(each for each in status["troubles"] if each["kind"] == kind)
        return found


def kinds(status: dict[str, Any]) -> list[str]:
    """Return the kinds of trouble, worst first."""
    return [trouble["kind"] for trouble in status["troubles"]]


class Client:
    """A Modbus/TCP controller that asks one thing after the other, and again where nothing comes.

    It connects again where its connection has ended: a gateway that stood still on a busy machine ends it.
    """

    def __init__(self, port: int) -> None:
        self._port = port
        self._connection = self._connected()
        self._number = 0

    def _connected(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self._port), timeout=ANSWER_S)

    def ask(self, unit_id: int, pdu: str) -> bytes:
        """Send a request, written in hex; returns the PDU of its reply, b"" at the end of the connection."""
        for _ in range(TRIES):  # a drive that is late on a busy machine: what waited for it is not sent
            self._number = self._number % 60_000 + 1
            request, number = bytes.fromhex(pdu), self._number.to_bytes(2, "big")
            head = number + bytes(2) + (len(request) + 1).to_bytes(2, "big") + bytes((unit_id,))
            try:
                self._connection.sendall(head + request)
                while reply := self._connection.recv(300):
                    if reply[:2] == number:
                        return reply[7:]
            except TimeoutError:
                continue
            except ConnectionError:
                self._connection.close()
                self._connection = self._connected()
                continue
            return b""
        raise TimeoutError(f"no reply to {pdu} of unit id {unit_id}")

    def read(self, unit_id: int) -> bytes:
        """Ask where an axis is."""
        return self.ask(unit_id, "03 00C8 0002")

    def move(self, unit_id: int, counts: int) -> bytes:
        """Command a position."""
        return self.ask(unit_id, f"10 0064 0002 04 {counts:08X}")

    def close(self) -> None:
        """Hang up."""
        self._connection.close()
