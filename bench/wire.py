"""A serial wire with a baud rate, as a process of its own: joins the masters of two pseudo terminals.

    python -m bench.wire BAUDRATE LEFT_FD RIGHT_FD

The wire is the simulator's: every byte takes the time of its ten bits (no parity, one stop bit), one after
the other, in each direction by itself.
"""

import asyncio
import os
import sys

from gateway.simulator.wire import SerialWire
from gateway.transport.endpoints import SerialEndpoint


async def join(baudrate: int, left_fd: int, right_fd: int) -> None:
    """Carry bytes until the process is stopped."""
    for fd in (left_fd, right_fd):
        os.set_blocking(fd, False)
    wire = SerialWire(left_fd, right_fd, SerialEndpoint("wire", baudrate))
    try:
        await asyncio.get_running_loop().create_future()
    finally:
        wire.close()


if __name__ == "__main__":
    asyncio.run(join(*map(int, sys.argv[1:4])))
