"""Drives that answer as a script says, behind every kind of line."""

from collections.abc import Callable
from contextlib import AsyncExitStack
from typing import Final

from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu
from gateway.transport.channel import Channel
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.null_modem import NullModem
from gateway.transport.serial import SerialPort
from gateway.transport.tcp import TcpListener

KINDS: Final = ("tcp", "rtu_over_tcp", "rtu")
ASK: Final = bytes.fromhex("03 0010 0001")
ANSWER: Final = bytes.fromhex("03 02 0007")


class Drive:
    """The other end: ``script`` gets what arrived, and what it returns is sent."""

    def __init__(self, script: Callable[[bytes], bytes | None]) -> None:
        self.script = script
        self.channel: Channel | None = None
        self.heard_ns: list[int] = []

    def opened(self, channel: Channel, now_ns: int) -> None:
        self.channel = channel

    def received(self, data: bytes, now_ns: int) -> None:
        self.heard_ns.append(now_ns)
        answer = self.script(data)
        if answer and self.channel is not None:
            self.channel.write(answer)

    def closed(self, reason: str, now_ns: int) -> None:
        self.channel = None


class Rig:
    """Opens drives of every kind, and closes them."""

    def __init__(self) -> None:
        self.stack = AsyncExitStack()

    async def drive(self, kind: str, drive: Drive) -> TcpEndpoint | SerialEndpoint:
        if kind == "rtu":
            cable = NullModem()
            self.stack.callback(cable.close)
            port = SerialPort(SerialEndpoint(cable.far), drive, lambda why: None)
            await port.open()
            self.stack.push_async_callback(port.close)
            return SerialEndpoint(cable.near, 115200)
        listener = TcpListener(TcpEndpoint("127.0.0.1", 0), (), lambda: drive, lambda host, why: None)
        await listener.open()
        self.stack.push_async_callback(listener.close)
        where = listener.addresses[0]
        return TcpEndpoint(where.host, where.port, rtu=kind == "rtu_over_tcp")


def framed(kind: str, request: bytes, pdu: bytes) -> bytes:
    """Frame a reply to a request."""
    if kind == "tcp":
        return encode_mbap(int.from_bytes(request[:2], "big"), request[6], pdu)
    return encode_rtu(request[0], pdu)
