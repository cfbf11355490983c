"""All places of a listener are taken, and a host comes again: whose peer is gone, and whose is only quiet."""

import asyncio
import contextlib
import socket
import struct
from collections.abc import AsyncIterator
from functools import partial
from itertools import product
from typing import TYPE_CHECKING

import pytest

from gateway.clock import boot_ns
from gateway.times import NS_PER_MS, NS_PER_S
from gateway.transport.connections import Closing
from gateway.transport.endpoints import TcpEndpoint
from gateway.transport.limits import ConnectionLimits
from gateway.transport.peer_probe import LONGEST_NS, PeerProbe, PeerState, PeerVerdict, verdict
from gateway.transport.tcp import Refusal, TcpListener

if TYPE_CHECKING:
    from tests.transport.conftest import Eventually, Recorder

BEGAN_NS = 1_000 * NS_PER_S
PATIENCE_NS = 500 * NS_PER_MS


def seen(
    now_ms: int,
    *,
    sent_ms: int = -9_000,
    heard_ms: int = -8_000,
    repeated: bool = False,
    probed: bool = False,
) -> PeerState:
    """Return what is seen, in ms since the peer is asked."""
    now, sent, heard = (BEGAN_NS + ms * NS_PER_MS for ms in (now_ms, sent_ms, heard_ms))
    return PeerState(now, sent, heard, is_repeated=repeated, is_probed=probed)


@pytest.mark.parametrize(
    ("what", "probed_ms", "expected"),
    [
        # Quiet alone tells nothing, however long.
        (seen(0), None, PeerVerdict.UNKNOWN),
        (seen(10_000), None, PeerVerdict.UNKNOWN),
        # Something came: it is there, also where a probe after it waits.
        (seen(40, heard_ms=30), None, PeerVerdict.THERE),
        (seen(900, heard_ms=0, probed=True), 10, PeerVerdict.THERE),
        # A probe that is not acknowledged counts from when it was seen to be out.
        (seen(509, probed=True), 10, PeerVerdict.UNKNOWN),
        (seen(510, probed=True), 10, PeerVerdict.GONE),
        # What was sent once may be acknowledged late on purpose, and counts for nothing.
        (seen(2_000, sent_ms=-100, heard_ms=-200), None, PeerVerdict.UNKNOWN),
        # What was sent once more counts from then, also where that was before it was asked.
        (seen(99, sent_ms=-400, heard_ms=-900, repeated=True), None, PeerVerdict.UNKNOWN),
        (seen(100, sent_ms=-400, heard_ms=-900, repeated=True), None, PeerVerdict.GONE),
        # It acknowledged something since, and lost the rest.
        (seen(200, sent_ms=-400, heard_ms=-300, repeated=True), None, PeerVerdict.UNKNOWN),
        # Nobody can tell: it stays.
        (seen(LONGEST_NS // NS_PER_MS), None, PeerVerdict.THERE),
    ],
)
def test_a_peer_is_gone_where_it_is_silent(
    what: PeerState, probed_ms: int | None, expected: PeerVerdict
) -> None:
    probed_ns = None if probed_ms is None else BEGAN_NS + probed_ms * NS_PER_MS
    assert verdict(what, BEGAN_NS, probed_ns, PATIENCE_NS) is expected


def test_without_anything_out_no_peer_is_ever_gone() -> None:
    for now_ms, heard_ms in product((0, 499, 500, 5_000, 60_000), (-100_000, -1, 0, 400)):
        what = seen(now_ms, heard_ms=min(heard_ms, now_ms))
        assert verdict(what, BEGAN_NS, None, PATIENCE_NS) is not PeerVerdict.GONE


class Door:
    """A listener with one place, whose controller is patient for 100 ms."""

    def __init__(self, make_recorder: "type[Recorder]") -> None:
        self.receivers: list[Recorder] = []
        self.refused: list[Refusal] = []
        self.closed: list[Closing] = []
        self._make = make_recorder
        self.listener = TcpListener(
            TcpEndpoint("127.0.0.1", 0),
            (),
            self._receiver,
            lambda _host, why: self.refused.append(why),
            limits=ConnectionLimits(max_connections=1, connects_per_s=100_000.0),
            on_closed=lambda _host, why: self.closed.append(why),
            acknowledged_within_ns=100 * NS_PER_MS,
        )

    def _receiver(self) -> "Recorder":
        receiver = self._make()
        self.receivers.append(receiver)
        return receiver

    @property
    def opens(self) -> int:
        return sum(receiver.opens for receiver in self.receivers)

    def has_opened(self, number: int) -> bool:
        return self.opens == number

    @property
    def where(self) -> tuple[str, int]:
        return self.listener.addresses[0].host, self.listener.addresses[0].port

    async def comes(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        return await asyncio.open_connection(*self.where)

    async def is_refused(self) -> None:
        """Come, and be closed at once."""
        before = len(self.refused)
        reader, writer = await self.comes()
        with contextlib.suppress(ConnectionResetError):
            assert await reader.read() == b""
        writer.close()
        assert self.refused[before:] == [Refusal.TOO_MANY]

    async def is_refused_for(self, seconds: float) -> None:
        """Come again and again. The kernel asks a peer that was quiet for a second, so it takes longer."""
        until_ns = boot_ns() + int(seconds * NS_PER_S)
        while boot_ns() < until_ns:
            await self.is_refused()
            await asyncio.sleep(0.02)


@pytest.fixture
async def door(make_recorder: "type[Recorder]") -> AsyncIterator[Door]:
    door = Door(make_recorder)
    await door.listener.open()
    yield door
    await door.listener.close()


async def test_a_peer_that_is_only_quiet_keeps_its_place(door: Door, eventually: "Eventually") -> None:
    reader, writer = await door.comes()
    await eventually(lambda: door.opens == 1)
    await door.is_refused_for(4.0)
    door.receivers[0].write(b"still here")
    assert await reader.readexactly(10) == b"still here"
    assert (door.closed, door.opens) == ([], 1)
    writer.close()


async def test_a_peer_that_takes_nothing_is_there_all_the_same(door: Door, eventually: "Eventually") -> None:
    """A full window: its system acknowledges the probes of that, and nothing else."""
    with socket.socket() as peer:
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        peer.connect(door.where)
        await eventually(lambda: door.opens == 1)
        door.receivers[0].write(bytes(8_000_000))
        await door.is_refused_for(4.0)
        assert (door.closed, door.receivers[0].reasons) == ([], [])


@pytest.mark.parametrize("how", ["closed", "reset"])
async def test_the_place_of_a_gone_peer_is_free_at_once(
    door: Door, eventually: "Eventually", how: str
) -> None:
    """Also where the loop has not read it yet: it learns of both in the same turn."""
    for number in range(1, 21):
        peer = socket.create_connection(door.where)
        await eventually(partial(door.has_opened, number))
        peer.sendall(b"stop")
        if how == "reset":
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        peer.close()
    assert (door.refused, door.closed) == ([], [])
    await eventually(lambda: not door.listener.peers)
    if how == "closed":
        assert [receiver.data for receiver in door.receivers] == [b"stop"] * 20


async def test_all_is_set_as_it_was_when_a_peer_was_asked(door: Door, eventually: "Eventually") -> None:
    options = (socket.TCP_KEEPIDLE, socket.TCP_KEEPCNT, socket.TCP_USER_TIMEOUT)
    with socket.create_connection(door.where) as peer:
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        await eventually(lambda: door.opens == 1)
        before = [peer.getsockopt(socket.IPPROTO_TCP, option) for option in options]
        began_ns = boot_ns()
        probe = PeerProbe(peer, 100 * NS_PER_MS, began_ns)
        assert [peer.getsockopt(socket.IPPROTO_TCP, option) for option in options] == [1, 100, 60_000]
        while probe.check(boot_ns()) is PeerVerdict.UNKNOWN:  # noqa: ASYNC110 - the kernel tells nobody
            await asyncio.sleep(0.01)
        assert probe.check(boot_ns()) is PeerVerdict.THERE
        # The peer has said something a moment ago, so the probe left a second after that.
        assert boot_ns() - began_ns < 3 * NS_PER_S
        probe.end()
        assert [peer.getsockopt(socket.IPPROTO_TCP, option) for option in options] == before
