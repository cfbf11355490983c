"""What the relay's watchdog takes for progress, with real sockets and a real loop."""

import asyncio
import contextlib
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gateway.ipc.service_manager import ServiceManager
from gateway.relay.watchdog import Accepting, WatchdogFeeder
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.null_modem import NullModem
from gateway.transport.serial import SerialPort
from gateway.transport.tcp import TcpListener
from tests.support.relay import LOOPBACK, RawEnd


@contextlib.contextmanager
def knocking(where: TcpEndpoint) -> Iterator[None]:
    with socket.create_connection((where.host, where.port), timeout=30):
        yield


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(30):
        while not condition():  # noqa: ASYNC110 - nothing tells of it
            await asyncio.sleep(0)


async def test_a_listener_that_accepts_nobody_is_found() -> None:
    listener = TcpListener(LOOPBACK, (), RawEnd, lambda host, why: None)
    await listener.open()
    accepting = Accepting(listener)
    [where] = listener.addresses
    assert [accepting.why_stuck() for _ in range(3)] == ["", "", ""]  # nobody knocks
    with knocking(where):
        await until(lambda: bool(listener.peers))
        assert [accepting.why_stuck() for _ in range(3)] == ["", "", ""]
    loop = asyncio.get_running_loop()
    loop.remove_reader(listener.sockets[0].fileno())  # the bug: the loop does not look any more
    with knocking(where):
        said = [accepting.why_stuck() for _ in range(3)]
    assert said == ["", *[f"{where}: connections wait, and none is accepted"] * 2]
    await listener.close()
    assert accepting.why_stuck() == "a listener was closed"


async def test_the_watchdog_is_fed_while_nothing_is_stuck_and_again_afterwards(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ear:
        ear.bind(f"{tmp_path}/notify")
        ear.setblocking(False)
        manager = ServiceManager(f"{tmp_path}/notify", watchdog_ns=4_000_000)
        why = [""]
        told: list[str] = []
        feeder = WatchdogFeeder(manager, lambda now_ns: why[0], told.append, lambda: "all is well")
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(30):
            assert await loop.sock_recv(ear, 300) == b"WATCHDOG=1\nSTATUS=all is well"
            assert await loop.sock_recv(ear, 300) == b"WATCHDOG=1"
            why[0] = "line xyz: nothing moves"
            while (heard := await loop.sock_recv(ear, 300)) == b"WATCHDOG=1":
                pass
            assert heard == b"STATUS=line xyz: nothing moves"
            why[0] = ""
            assert await loop.sock_recv(ear, 300) == b"WATCHDOG=1\nSTATUS=all is well"
        feeder.stop()
        manager.close()
        assert told == ["line xyz: nothing moves"]


@pytest.mark.parametrize("is_pulled", [True, False])
async def test_a_port_is_dropped_when_it_is_lost_and_not_when_it_is_closed(*, is_pulled: bool) -> None:
    cable = NullModem()
    opened: list[int] = []
    lost: list[str] = []
    port = SerialPort(SerialEndpoint(cable.near, 115200), RawEnd(), lambda why: None)
    port.on_open = opened.append
    port.on_lost = lambda: lost.append("lost")
    await port.open()
    if is_pulled:
        cable.close()
        await until(lambda: bool(lost))
    await port.close()
    cable.close()
    assert (len(opened), lost) == (1, ["lost"] if is_pulled else [])
