"""A gateway as processes, between a controller and drives that the test plays."""

import contextlib
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

from gateway.ipc.address import socket_path
from gateway.modbus.mbap import encode_mbap
from tests.support.commands import typed
from tests.support.config import one_axis, written
from tests.support.ports import free_port
from tests.support.processes import SECONDS, Running, ending, running


class Drive:
    """Acknowledges FC16 unless it is silent; keeps what it was told, in counts."""

    def __init__(self, listening: socket.socket) -> None:
        self.told: list[int] = []
        self.is_silent = False
        self._listening = listening
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._listening.accept()
            except OSError:
                return
            with connection, contextlib.suppress(OSError):
                while data := connection.recv(300):
                    self.told.append(int.from_bytes(data[13:17], "big", signed=True))
                    if not self.is_silent:
                        connection.sendall(data[:4] + bytes((0, 6)) + data[6:12])


class Master:
    """Commands positions, and sees every answer."""

    def __init__(self, port: int, drive: Drive, unit_id: int = 1) -> None:
        self._unit_id = unit_id
        self._connection = socket.create_connection(("127.0.0.1", port), timeout=SECONDS)
        self._drive = drive
        self._number = 0

    def move(self, counts: int) -> int:
        """Command a position; returns what the drive was told."""
        self.send(counts)
        assert self._connection.recv(300) == encode_mbap(
            self._number, self._unit_id, bytes.fromhex("10 0064 0002")
        )
        return self._drive.told[-1]

    def is_refused(self, counts: int) -> bool:
        """Command a position; returns whether the answer is that it cannot be."""
        self.send(counts)
        return self._connection.recv(300) == encode_mbap(self._number, self._unit_id, bytes.fromhex("90 04"))

    def is_answered_with_an_exception(self) -> bool:
        """Return whether what was sent last is answered with any exception."""
        answer = self._connection.recv(300)
        return len(answer) == 9 and answer[7] == 0x90

    def send(self, counts: int) -> None:
        """Command a position, and leave the answer where it is."""
        self._number = self._number % 60_000 + 1
        pdu = bytes.fromhex("10 0064 0002 04") + counts.to_bytes(4, "big", signed=True)
        self._connection.sendall(encode_mbap(self._number, self._unit_id, pdu))

    def close(self) -> None:
        self._connection.close()


class Site:
    """A configuration with a drive behind it."""

    def __init__(self, folder: Path, drives: int, port: int, drive: Drive) -> None:
        self.config = written(folder, one_axis(drives, port))
        self.table = folder / "tables" / "x.tab"
        self.socket = socket_path(folder / "state")
        self.port = port
        self.drive = drive

    def port_is_open(self) -> bool:
        """Whether the gateway listens."""
        try:
            self.master().close()
        except ConnectionError:  # refused, or reset by a listener that closes just now
            return False
        return True

    def serve_page(self) -> str:
        """Have the status served over TCP too; returns where."""
        address = f"127.0.0.1:{free_port()}"
        self.config.write_text(self.config.read_text().replace('listen = ""', f'listen = "{address}"'))
        return f"http://{address}"

    def change(self, old: str, new: str) -> None:
        """Replace what stands in the configuration."""
        text = self.config.read_text()
        assert old in text
        self.config.write_text(text.replace(old, new))

    def compile(self) -> None:
        """Compile the configuration, as somebody does who starts relay and supervisor by themselves."""
        done = typed("check", "--compile", str(self.config))
        assert done.returncode == 0, done.stderr

    def master(self) -> Master:
        return Master(self.port, self.drive)


@contextlib.contextmanager
def site_in(folder: Path) -> Iterator[Site]:
    """Lay out a configuration with a drive that answers."""
    port = free_port()
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield Site(folder, listening.getsockname()[1], port, Drive(listening))


@contextlib.contextmanager
def gateway_of(site: Site) -> Iterator[tuple[Running, Master]]:
    """``run`` with both processes, which have found each other; ends it, well, unless the test has."""
    with running("run", str(site.config)) as gateway:
        gateway.until_each("line-up", "relay-reached")
        with contextlib.closing(site.master()) as master, ending(gateway):
            yield gateway, master


@contextlib.contextmanager
def relay_of(site: Site) -> Iterator[tuple[Running, Master]]:
    """``relay`` alone, from what was compiled; ends it, well, unless the test has."""
    with running("relay", str(site.config)) as relay:
        relay.until("line-up")
        with contextlib.closing(site.master()) as master, ending(relay):
            yield relay, master
