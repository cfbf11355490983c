"""A position that a controller commands over TCP, and what comes of it on a serial line that a test holds."""

import os
import socket
import time

from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu

REQUEST = bytes.fromhex("10 0064 0002 04") + (50_000).to_bytes(4, "big")
MOVE = bytes.fromhex("10 0064 0002 04") + (50_050).to_bytes(4, "big")


def moved_on_wire(port: int, wire: int) -> bytes:
    """Command a position; returns what came over the wire, and acknowledges it."""
    with socket.create_connection(("127.0.0.1", port), timeout=30) as controller:
        controller.sendall(encode_mbap(1, 1, REQUEST))
        heard = b""
        end_s = time.monotonic() + 10
        while len(heard) < 13 and time.monotonic() < end_s:
            heard += os.read(wire, 300)
        os.write(wire, encode_rtu(1, REQUEST[:5]))
        assert controller.recv(300)[7:] == REQUEST[:5]
        return heard
