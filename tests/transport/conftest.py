"""Both ends of every transport, behind one face."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass

import pytest

from gateway.transport import memory
from gateway.transport.channel import Channel
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.loop import RelayLoop
from gateway.transport.null_modem import NullModem
from gateway.transport.serial import SerialPort
from gateway.transport.tcp import TcpConnector, TcpListener

PATIENCE_S = 30.0
Eventually = Callable[[Callable[[], bool]], Awaitable[None]]


def pytest_asyncio_loop_factories() -> dict[str, Callable[[], asyncio.AbstractEventLoop]]:
    """The loop of the relay, and that of everything else that opens connections and ports."""
    return {"relay": RelayLoop, "asyncio": asyncio.new_event_loop}


class Recorder:
    """A receiver that keeps what it is told; tests wait for a condition on it."""

    def __init__(self) -> None:
        self.channel: Channel | None = None
        self.data = b""
        self.times_ns: list[int] = []
        self.opens = 0
        self.reasons: list[str] = []
        self._changed = asyncio.Event()

    def opened(self, channel: Channel, now_ns: int) -> None:
        self.channel = channel
        self.opens += 1
        self.times_ns.append(now_ns)
        self._changed.set()

    def received(self, data: bytes, now_ns: int) -> None:
        self.data += data
        self.times_ns.append(now_ns)
        self._changed.set()

    def closed(self, reason: str, now_ns: int) -> None:
        self.reasons.append(reason)
        self.times_ns.append(now_ns)
        self._changed.set()

    def write(self, data: bytes) -> None:
        assert self.channel is not None
        self.channel.write(data)

    async def until(self, condition: Callable[["Recorder"], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not condition(self):
                self._changed.clear()
                await self._changed.wait()


async def eventually(condition: Callable[[], bool]) -> None:
    """Let the loop run until something holds that tells nobody when it begins to."""
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - see above
            await asyncio.sleep(0)


@dataclass
class Ends:
    """Two joined ends; ``hang_up`` takes away what is between them."""

    near: Recorder
    far: Recorder
    hang_up: Callable[[], Awaitable[None]]


@contextlib.asynccontextmanager
async def _memory_ends() -> AsyncIterator[Ends]:
    near, far = Recorder(), Recorder()
    channel, _ = memory.connect(near, far)

    async def hang_up() -> None:
        channel.close()

    yield Ends(near, far, hang_up)
    channel.close()
    await near.until(lambda end: bool(end.reasons))


@contextlib.asynccontextmanager
async def _tcp_ends() -> AsyncIterator[Ends]:
    near, far = Recorder(), Recorder()
    listener = TcpListener(TcpEndpoint("127.0.0.1", 0), (), lambda: far, lambda host, why: None)
    await listener.open()
    connector = TcpConnector(listener.addresses[0], near, lambda why: None)
    await connector.open()
    await near.until(lambda end: end.opens == 1)
    await far.until(lambda end: end.opens == 1)
    yield Ends(near, far, listener.close)
    await connector.close()
    await listener.close()


@contextlib.asynccontextmanager
async def _pty_ends() -> AsyncIterator[Ends]:
    cable = NullModem()
    near, far = Recorder(), Recorder()
    ports = [
        SerialPort(SerialEndpoint(device, 115200, "E"), end, lambda why: None)
        for device, end in ((cable.near, near), (cable.far, far))
    ]
    for port in ports:
        await port.open()
    is_cut = False

    async def hang_up() -> None:
        nonlocal is_cut
        is_cut = True
        cable.close()

    yield Ends(near, far, hang_up)
    for port in ports:
        await port.close()
    if not is_cut:
        cable.close()


@pytest.fixture(params=[_memory_ends, _tcp_ends, _pty_ends], ids=["memory", "tcp", "pty"])
async def ends(request: pytest.FixtureRequest) -> AsyncIterator[Ends]:
    async with request.param() as joined:
        yield joined


@pytest.fixture
def make_recorder() -> type[Recorder]:
    return Recorder


@pytest.fixture(name="eventually")
def eventually_fixture() -> Eventually:
    return eventually
