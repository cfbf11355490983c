"""A relay with a TLS listener, a drive, and who connects to it."""

import asyncio
import contextlib
import ssl
from pathlib import Path
from typing import Any

from gateway.exchange.plan import ControllerPlan, Role
from gateway.modbus.mbap import encode_mbap
from gateway.relay.gateway import Relay
from gateway.state.plan import ControllerLink, GatewayPlan, LinePlan, RoleRights, TlsPlan
from gateway.transport.certificates import TlsFiles
from gateway.transport.endpoints import TcpEndpoint
from tests.support.certificates import Shop, client_context
from tests.support.relay import TIMING, Bench, RawEnd, axis_plan, eventually, first_controller, until_up

WRITE = bytes.fromhex("10 0064 0002 04 0000C350")
"""50 000 counts, for which the drive has to be told 50 050."""
CORRECTED = bytes.fromhex("10 0064 0002 04 0000C382")
WRITTEN = bytes.fromhex("10 0064 0002")
READ_ACTUAL = bytes.fromhex("03 006E 0002")
READ = bytes.fromhex("03 00C8 0001")


def answers(data: bytes) -> bytes:
    """A drive that takes every write, stands at 50 050 counts, and whose other registers hold 7."""
    if data[7] == 0x10:
        pdu = WRITTEN
    else:
        pdu = bytes.fromhex("03 04 0000C382" if data[7:] == READ_ACTUAL else "03 02 0007")
    return data[:4] + (len(pdu) + 1).to_bytes(2, "big") + data[6:7] + pdu


class Site:
    """A relay with a TLS listener, and who connects to it."""

    def __init__(self, bench: Bench, folder: Path) -> None:
        self.bench, self.folder = bench, folder
        self.shop = Shop(folder)
        certificate, key = self.shop.server()
        self.files = TlsFiles(str(certificate), str(key), str(self.shop.path), str(self.shop.revoke()))
        self.drive: RawEnd
        self.relay: Relay
        self.relay_plan: GatewayPlan

    async def start(self, **changes: str) -> None:
        self.drive, where = await self.bench.drive("tcp", answers)
        files = TlsFiles(**{**{name: getattr(self.files, name) for name in TlsFiles.__slots__}, **changes})
        roles = {"Operator": RoleRights(Role.MOTION), "Beobachter Süd": RoleRights(Role.MONITOR)}
        link = ControllerLink(
            ControllerPlan("cnc", Role.MOTION, timeout_ms=500.0),
            TcpEndpoint("127.0.0.1", 0),
            tls=TlsPlan(files, roles),
        )
        self.relay_plan = GatewayPlan("bench", (LinePlan("line", where, (link,), (axis_plan(),), TIMING),))
        self.relay = await self.bench.relay(where, (link,), (axis_plan(),))
        await until_up(self.relay)

    def recorded(self, path: Path) -> list[bytes]:
        return path.read_bytes().splitlines(keepends=True)

    @property
    def port(self) -> int:
        return self.relay.address("line", "cnc").port

    @property
    def status(self) -> dict[str, Any]:
        status = first_controller(self.relay)["tls"]
        assert isinstance(status, dict)
        return status

    def told(self, event: str) -> list[str]:
        return [str(note.fields["detail"]) for note in self.bench.notes if note.event == event]

    async def connect(
        self, shown: tuple[Path, Path] | None, context: ssl.SSLContext | None = None
    ) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        context = context or client_context(self.shop.path, shown)
        return self._kept(
            await asyncio.open_connection("127.0.0.1", self.port, ssl=context, server_hostname="127.0.0.1")
        )

    async def connect_plain(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        return self._kept(await asyncio.open_connection("127.0.0.1", self.port))

    def _kept(
        self, stream: tuple[asyncio.StreamReader, asyncio.StreamWriter]
    ) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """Close it in the end, whatever became of it."""

        async def close() -> None:
            stream[1].close()
            with contextlib.suppress(OSError):
                await stream[1].wait_closed()

        self.bench.stack.push_async_callback(close)
        return stream

    async def is_refused(
        self, shown: tuple[Path, Path] | None, context: ssl.SSLContext | None = None
    ) -> None:
        """Connect in vain: an end before anything is answered, in the handshake or behind it."""
        with contextlib.suppress(OSError):
            reader, writer = await self.connect(shown, context)
            writer.write(encode_mbap(1, 1, READ))
            async with asyncio.timeout(30):
                with contextlib.suppress(OSError):
                    assert await reader.read(100) == b""
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()
        await eventually(lambda: not first_controller(self.relay)["connections"])


async def ask(stream: tuple[asyncio.StreamReader, asyncio.StreamWriter], pdu: bytes) -> bytes:
    reader, writer = stream
    writer.write(encode_mbap(7, 1, pdu))
    async with asyncio.timeout(30):
        head = await reader.readexactly(7)
        assert head[:4] == b"\0\x07\0\0"
        return await reader.readexactly(int.from_bytes(head[4:6], "big") - 1)
