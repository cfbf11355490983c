"""The supervisor's ear, on a real socket: what it keeps, what it passes on, and how it comes back."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path

from gateway.ipc.address import Peer, socket_path
from gateway.ipc.handlers import RequestHandlers
from gateway.ipc.messages import Happened, Pong, Request
from gateway.ipc.server import ControlServer
from gateway.status.model import RelayModel
from gateway.supervisor.link import RelayLink
from tests.support.status_models import relay_model_of

PATIENCE_S = 30.0
STATUS = relay_model_of({"gateway": {"name": "mill-1", "relay": "up", "snapshot_age_s": 0.0}})


def pong(request: Request, _peer: Peer) -> Pong:
    return Pong(name="mill-1", gateway_version="", pid=1)


class Heard:
    """What a link told."""

    def __init__(self) -> None:
        self.ups = 0
        self.lost: list[str] = []
        self.events: list[Happened] = []
        self.snapshots = 0

    def up(self) -> None:
        self.ups += 1

    def snapshot(self) -> None:
        self.snapshots += 1


@contextlib.asynccontextmanager
async def linked(state: Path) -> AsyncIterator[tuple[RelayLink, Heard]]:
    heard = Heard()

    def lost(why: str) -> None:
        assert not link.is_up  # whoever publishes it now says so too
        heard.lost.append(why)

    link = RelayLink(socket_path(state), heard.up, lost, heard.events.append, heard.snapshot)
    task = asyncio.create_task(link.run())
    try:
        yield link, heard
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


@contextlib.asynccontextmanager
async def relay(state: Path, status: RelayModel = STATUS) -> AsyncIterator[ControlServer]:
    server = ControlServer(state, RequestHandlers(pong, status=lambda: status))
    await server.open()
    try:
        yield server
    finally:
        await server.close()


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - nobody is told
            await asyncio.sleep(0)


async def test_the_newest_snapshot_stays_when_the_relay_is_lost_and_says_so(tmp_path: Path) -> None:
    async with linked(tmp_path) as (link, heard):
        async with relay(tmp_path) as server:
            await until(lambda: link.snapshot == STATUS)
            assert link.is_up
            assert heard.snapshots
            server.publish_event(
                Happened(event="line-up", severity="info", fields={"line": "xyz"}, wall_s=1.0)
            )
            await until(lambda: bool(heard.events))
            assert heard.events[0].fields == {"line": "xyz"}
        await until(lambda: bool(heard.lost))
        await until(lambda: not link.is_up)
        assert link.snapshot == STATUS
        assert heard.lost == ["the connection was closed"]
        age_s = link.snapshot_age_s
        assert age_s is not None
        later = relay_model_of({"gateway": {"name": "mill-2"}})
        async with relay(tmp_path, later):
            await until(lambda: link.snapshot == later)
        assert heard.ups == 2


async def test_who_wants_snapshots_more_often_gets_them_over_the_same_connection(tmp_path: Path) -> None:
    async with linked(tmp_path) as (link, heard), relay(tmp_path) as server:
        await until(lambda: heard.snapshots == 1)
        link.want(0.05)
        [session] = server._clients.sessions
        before = asyncio.get_running_loop().time()
        await until(lambda: heard.snapshots == 6)
        assert asyncio.get_running_loop().time() - before < 4.0  # five of those that come each second
        assert server._clients.sessions == {session}
        assert (heard.ups, heard.lost) == (1, [])


async def test_a_relay_that_is_not_there_yet_is_waited_for_without_a_word(tmp_path: Path) -> None:
    async with linked(tmp_path) as (link, heard):
        await asyncio.sleep(0)
        async with relay(tmp_path):
            await until(lambda: heard.ups == 1)
        assert link.dropped == 0
    assert [why for why in heard.lost if why != "the connection was closed"] == []
