"""A serial wire with a baud rate, as a process of its own: joins the masters of two pseudo terminals.

    python -m bench.wire BAUDRATE LEFT_FD RIGHT_FD [FIFO_PRIORITY]

The wire is the simulator's: every byte takes the time of its ten bits (no parity, one stop bit), one after
the other, in each direction by itself. Says one line of JSON when it is stopped: how often bytes came behind
others after a pause that is too short to stand between two frames, and the longest of those pauses.
"""

import asyncio
import json
import os
import selectors
import signal
import sys

from gateway.modbus.rtu_line import silence_ns
from gateway.simulator.pacing import PacedWire
from gateway.simulator.wire import SerialWire
from gateway.times import NS_PER_US
from gateway.transport.endpoints import SerialEndpoint


class HeardWire(PacedWire):
    """A wire that knows where its sender was silent inside of a frame."""

    def __init__(self, line: SerialEndpoint) -> None:
        super().__init__(line.baudrate, line.bits_per_character)
        self.pauses = self.longest_ns = 0
        # Whoever sends a frame begins it behind a whole silence; half of one stands between two frames.
        self._silence_ns = silence_ns(line.baudrate, line.bits_per_character) // 2

    def send(self, data: bytes, now_ns: int) -> None:
        """See ``PacedWire``."""
        pause_ns = now_ns - self._free_at_ns(self._busy_bytes) if self._busy_bytes else 0
        if 0 < pause_ns < self._silence_ns:
            self.pauses += 1
            self.longest_ns = max(self.longest_ns, pause_ns)
        super().send(data, now_ns)


async def join(baudrate: int, left_fd: int, right_fd: int, priority: int = 0) -> None:
    """Carry bytes until the process is stopped."""
    if priority:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    for fd in (left_fd, right_fd):
        os.set_blocking(fd, False)
    line = SerialEndpoint("wire", baudrate)
    wire = SerialWire(left_fd, right_fd, line)
    heard = [HeardWire(line), HeardWire(line)]
    wire.to_left.wire, wire.to_right.wire = heard
    loop = asyncio.get_running_loop()
    stopped = asyncio.Event()
    loop.add_signal_handler(signal.SIGTERM, stopped.set)
    try:
        await stopped.wait()
    finally:
        wire.close()
    longest_us = max(each.longest_ns for each in heard) // NS_PER_US
    said = {"pauses": sum(each.pauses for each in heard), "longest_us": longest_us}
    sys.stdout.write(json.dumps(said) + "\n")


def exact_loop() -> asyncio.AbstractEventLoop:
    """Return a loop whose timers are not rounded up to a millisecond, as those over epoll are."""
    return asyncio.SelectorEventLoop(selectors.SelectSelector())


if __name__ == "__main__":
    with asyncio.Runner(loop_factory=exact_loop) as runner:
        runner.run(join(*map(int, sys.argv[1:5])))
