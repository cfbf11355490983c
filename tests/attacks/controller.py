"""A controller that does its work while others attack, in a process of its own, with its drive beside it.

``python -m tests.attacks.controller`` prints the port of its drive, then reads commands, a line each:
``connect PORT [CA CERTIFICATE KEY]``, ``work N`` (N moves, each read back), ``carry-on`` (until the next
line), ``quit``. Each work is answered with a line of JSON, see :class:`Work`.
"""

import contextlib
import io
import json
import select
import socket
import ssl
import sys
import threading
import time
from dataclasses import asdict, dataclass, field

UNIT_ID = 1
ADDRESS = 100
CYCLE_S = 0.005
PATIENCE_S = 15.0
LOWEST, HIGHEST, STEP = 10_000, 90_000, 1_000
"""Counts. ``tests.support.config.RAMP`` adds a thousandth: 10 000 counts become 10 010."""


@dataclass
class Work:
    """What came of some moves."""

    moves: int = 0
    lost: int = 0
    """Requests without an answer."""
    wrong: list[str] = field(default_factory=list)
    p50_us: float = 0.0
    p99_us: float = 0.0
    max_us: float = 0.0


class Drive:
    """Takes FC16 of two registers and reads them back with FC03; keeps every other frame that arrives."""

    def __init__(self) -> None:
        self.told = 0
        self.writes = 0
        self.foreign: list[str] = []
        listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = listening.getsockname()[1]
        threading.Thread(target=self._serve, args=(listening,), daemon=True).start()

    def _serve(self, listening: socket.socket) -> None:
        while True:
            connection, _ = listening.accept()
            with connection, contextlib.suppress(OSError):
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                while data := connection.recv(300):
                    connection.sendall(self._answer(data))

    def _answer(self, data: bytes) -> bytes:
        pdu = data[7:]
        if pdu[:6] == b"\x10" + ADDRESS.to_bytes(2, "big") + b"\x00\x02\x04" and data[6] == UNIT_ID:
            self.told = int.from_bytes(pdu[6:10], "big", signed=True)
            self.writes += 1
            answer = pdu[:5]
        elif pdu == b"\x03" + ADDRESS.to_bytes(2, "big") + b"\x00\x02" and data[6] == UNIT_ID:
            answer = b"\x03\x04" + self.told.to_bytes(4, "big", signed=True)
        else:
            self.foreign.append(data.hex())
            answer = bytes((pdu[0] | 0x80, 1))
        return data[:4] + (len(answer) + 1).to_bytes(2, "big") + data[6:7] + answer


class Controller:
    """Moves to and fro, reads back after each move."""

    def __init__(self, drive: Drive, connection: socket.socket, commands: io.FileIO) -> None:
        self._drive = drive
        self._connection = connection
        self._commands = commands
        self._number = 0
        self._nominal = LOWEST
        self._step = STEP

    def work(self, moves: int | None) -> Work:
        """Do so many moves, or those until there is a line to read."""
        work = Work()
        took_ns: list[int] = []
        while work.moves < moves if moves is not None else not self._is_told():
            began_ns = time.perf_counter_ns()
            try:
                self._move(work)
            except TimeoutError:
                work.lost += 1
            except OSError as error:
                work.wrong.append(f"the connection ended: {error}")
                break
            took_ns.append(time.perf_counter_ns() - began_ns)
            work.moves += 1
            time.sleep(CYCLE_S)  # the cycle of a controller, not a wait for something
        work.wrong += [f"the drive got {frame}" for frame in self._drive.foreign]
        self._drive.foreign = []
        if took_ns:
            took_ns.sort()
            work.p50_us, work.p99_us, work.max_us = (
                took_ns[min(len(took_ns) - 1, int(len(took_ns) * share))] / 2000 for share in (0.5, 0.99, 1.0)
            )
        return work

    def _is_told(self) -> bool:
        return bool(select.select((self._commands,), (), (), 0)[0])

    def _move(self, work: Work) -> None:
        if not LOWEST <= self._nominal + self._step <= HIGHEST:
            self._step = -self._step
        self._nominal += self._step
        writes = self._drive.writes
        position = self._nominal.to_bytes(4, "big")
        self._expect(b"\x10\x00\x64\x00\x02\x04" + position, b"\x10\x00\x64\x00\x02", work)
        told, corrected = self._drive.told, self._nominal + self._nominal // 1000
        if told != corrected or self._drive.writes != writes + 1:
            work.wrong.append(
                f"{self._nominal}: the drive was told {told}, {self._drive.writes - writes} times"
            )
        self._expect(b"\x03\x00\x64\x00\x02", b"\x03\x04" + position, work)

    def _expect(self, request: bytes, reply: bytes, work: Work) -> None:
        self._number = self._number % 0xFFFF + 1
        head = self._number.to_bytes(2, "big") + b"\x00\x00"
        tail = bytes((UNIT_ID,))
        self._connection.sendall(head + (len(request) + 1).to_bytes(2, "big") + tail + request)
        wanted = head + (len(reply) + 1).to_bytes(2, "big") + tail + reply
        found = b""
        while len(found) < len(wanted):
            piece = self._connection.recv(len(wanted) - len(found))
            if not piece:
                raise ConnectionError("closed by the gateway")
            found += piece
        if found != wanted:
            work.wrong.append(f"{request.hex()} was answered {found.hex()}")


def connected(port: int, files: list[str]) -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if not files:
        return connection
    authority, certificate, key = files
    context = ssl.create_default_context(cafile=authority)
    context.load_cert_chain(certificate, key)
    return context.wrap_socket(connection, server_hostname="127.0.0.1")


def main() -> None:
    drive = Drive()
    print(drive.port, flush=True)
    controller: Controller | None = None
    # Without a buffer: it would hide the line that ends ``carry-on`` from select, when both came at once.
    commands = io.FileIO(sys.stdin.fileno(), closefd=False)
    for line in iter(commands.readline, b""):
        match line.decode().split():
            case ["connect", port, *files]:
                controller = Controller(drive, connected(int(port), files), commands)
                print("{}", flush=True)
            case ["work", moves] if controller:
                print(json.dumps(asdict(controller.work(int(moves)))), flush=True)
            case ["carry-on"] if controller:
                print(json.dumps(asdict(controller.work(None))), flush=True)
            case ["quit"]:
                return


if __name__ == "__main__":
    main()
