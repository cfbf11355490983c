"""The machines of a fleet in one process: their drives, and controllers that ask ten times a second.

``python -m bench.fleet_plant DRIVES_PORT FIRST_PORT COUNT PER_S``: all drives are at DRIVES_PORT, the first
gateway is at FIRST_PORT, each further one at the next. It says ``ready`` when the drives listen. On SIGUSR1
it says what the controllers have seen since the last time, as JSON.
"""

import asyncio
import json
import random
import signal
import sys
import time
from typing import Final

from bench.gateway_setup import COMMAND, COUNTS_PER_MM, TRAVEL_MM

AXES: Final = 3
HEAD: Final = 6
"""Bytes of the head of Modbus TCP before those that its length counts."""
READ, WRITE, REFUSED = 3, 16, 0x80
AGAIN_S: Final = 1.0


def frames(buffer: bytearray) -> list[bytes]:
    """Take the whole frames of Modbus TCP out of a buffer."""
    found = []
    while len(buffer) >= HEAD and len(buffer) >= (end := HEAD + int.from_bytes(buffer[4:6], "big")):
        found.append(bytes(buffer[:end]))
        del buffer[:end]
    return found


class Drives(asyncio.Protocol):
    """The drives of one gateway: each remembers its position."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._positions: dict[int, bytes] = {}

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Answer."""
        self._buffer += data
        for frame in frames(self._buffer):
            unit, function = frame[6], frame[7]
            if function == WRITE:
                self._positions[unit] = frame[13:17]
                pdu = frame[7:12]
            else:
                pdu = bytes((READ, 4)) + self._positions.get(unit, bytes(4))
            self._transport.write(frame[:4] + (len(pdu) + 1).to_bytes(2, "big") + frame[6:7] + pdu)


class Seen:
    """What all controllers have seen."""

    def __init__(self) -> None:
        self.round_trips_ns: list[int] = []
        self.refused = 0
        self.late = 0
        """Turns at which the reply to the last request had not come."""
        self.connected = 0

    def said(self) -> str:
        """Return it as JSON, and begin anew."""
        trips = sorted(self.round_trips_ns) or [0]
        figures = {
            "exchanges": len(self.round_trips_ns),
            "p50_ms": trips[len(trips) // 2] / 1e6,
            "p99_ms": trips[len(trips) * 99 // 100] / 1e6,
            "refused": self.refused,
            "late": self.late,
            "connected": self.connected,
        }
        self.round_trips_ns, self.refused, self.late = [], 0, 0
        return json.dumps(figures)


class Controller(asyncio.Protocol):
    """A controller that writes a position and reads it back, in turn."""

    def __init__(self, port: int, each_s: float, seen: Seen) -> None:
        self._port = port
        self._each_s = each_s
        self._seen = seen
        self._loop = asyncio.get_running_loop()
        self._buffer = bytearray()
        self._transport: asyncio.Transport | None = None
        self._count = 0
        self._sent_ns: int | None = None

    async def run(self) -> None:
        """Connect, and again after a loss; send in every turn."""
        await asyncio.sleep(random.random() * self._each_s)
        due_s = self._loop.time()
        while True:
            if self._transport is None:
                try:
                    await self._loop.create_connection(lambda: self, "127.0.0.1", self._port)
                except OSError:
                    await asyncio.sleep(AGAIN_S)
                    continue
            self._send()
            due_s = max(due_s + self._each_s, self._loop.time())
            await asyncio.sleep(due_s - self._loop.time())

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin."""
        assert isinstance(transport, asyncio.Transport)
        self._transport, self._sent_ns = transport, None
        self._seen.connected += 1

    def connection_lost(self, _error: Exception | None) -> None:
        """Connect anew in the next turn."""
        self._transport = None
        self._seen.connected -= 1

    def data_received(self, data: bytes) -> None:
        """Take the reply."""
        self._buffer += data
        for frame in frames(self._buffer):
            if self._sent_ns is not None:
                self._seen.round_trips_ns.append(time.perf_counter_ns() - self._sent_ns)
            self._sent_ns = None
            self._seen.refused += frame[7] >= REFUSED

    def _send(self) -> None:
        if self._transport is None:
            return
        if self._sent_ns is not None:
            self._seen.late += 1
            return
        turn, is_read = divmod(self._count, 2)
        unit = 1 + turn % AXES
        if is_read:
            pdu = bytes((READ, *COMMAND.to_bytes(2, "big"), 0, 2))
        else:
            position = turn * 37 % int(TRAVEL_MM * COUNTS_PER_MM)
            pdu = bytes((WRITE, *COMMAND.to_bytes(2, "big"), 0, 2, 4)) + position.to_bytes(4, "big")
        self._count += 1
        head = (self._count & 0xFFFF).to_bytes(2, "big") + bytes(2) + (len(pdu) + 1).to_bytes(2, "big")
        self._sent_ns = time.perf_counter_ns()
        self._transport.write(head + bytes((unit,)) + pdu)


async def main() -> None:
    """Run until killed."""
    drives_port, first_port, count, per_s = map(int, sys.argv[1:])
    seen = Seen()
    loop = asyncio.get_running_loop()
    server = await loop.create_server(Drives, "127.0.0.1", drives_port, backlog=1024)
    loop.add_signal_handler(signal.SIGUSR1, lambda: print(seen.said(), flush=True))
    print("ready", flush=True)
    controllers = [Controller(first_port + number, 1.0 / per_s, seen) for number in range(count)]
    async with server:
        await asyncio.gather(*(controller.run() for controller in controllers))


if __name__ == "__main__":
    asyncio.run(main())
