"""The supervisor: its threads, its feeds, its link to the relay."""

import asyncio
import contextlib
import threading
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest

from gateway.catalogue.entry import Severity
from gateway.config.load import load
from gateway.ipc.address import Peer, socket_path
from gateway.ipc.handlers import RequestHandlers
from gateway.ipc.log import LogEntry
from gateway.ipc.messages import Happened, Ping, Pong, Request, Status, decode_request, encode
from gateway.ipc.server import ControlServer
from gateway.state.plan import shape_of
from gateway.status.model import GatewayStatus, Model, RelayModel
from gateway.supervisor.broadcast import EVENTS_KEPT, Broadcast, News
from gateway.supervisor.in_thread import in_thread
from gateway.supervisor.interventions import Cause
from gateway.supervisor.link import RelayLink
from gateway.supervisor.supervisor import Supervisor
from tests.support.config import RAMP, one_axis
from tests.support.status_models import relay_model_of


async def test_a_mistake_of_ours_is_told_and_ends_nothing(tmp_path: Path) -> None:
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "x.tab").write_text(RAMP)
    (tmp_path / "state").mkdir(mode=0o700)
    config = tmp_path / "gateway.toml"
    config.write_text(one_axis(drives=1, port=2))
    pong = Pong(name="trial", gateway_version="0", pid=1, shape=shape_of(load(config).plan))

    async def relay_of_nobodys(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer as a relay of this shape whose status has no axes at all."""
        request = decode_request(await reader.readline())
        writer.write(encode(pong if isinstance(request, Ping) else Status(status=RelayModel())))
        writer.close()

    notes: list[LogEntry] = []
    supervisor = Supervisor(config, tmp_path / "state", notes.append)
    listening = await asyncio.start_unix_server(relay_of_nobodys, socket_path(tmp_path / "state"))
    async with listening:
        running = asyncio.create_task(supervisor.run())
        for _ in range(2):  # the second time it is there as before
            outcome = await asyncio.wait_for(supervisor.reload(Cause("http")), 30.0)
            assert "an error in the supervisor: KeyError: 'x' (tables.py:" in outcome.problems[0]
        assert not running.done()
        model = supervisor.broadcast.model
        assert model is not None
        assert model.supervisor is not None
        assert "an error in the supervisor" in str(model.supervisor.tables_folder.problem)
        assert model.axes == {}
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
    assert "reload-refused" in [note.event for note in notes]


# Work in a thread of its own: what comes of it, and who waits for it.


def test_what_comes_of_it_is_returned_or_raised() -> None:
    assert asyncio.run(in_thread(lambda: 3)) == 3
    with pytest.raises(ZeroDivisionError):
        asyncio.run(in_thread(lambda: 1 // 0))


def test_who_is_cancelled_does_not_wait_for_what_never_returns() -> None:
    begun, never = threading.Event(), threading.Event()

    def hang() -> None:
        begun.set()
        never.wait()

    async def cancelled() -> None:
        hanging = asyncio.create_task(in_thread(hang))
        await asyncio.to_thread(begun.wait)
        hanging.cancel()
        with pytest.raises(asyncio.CancelledError):
            await hanging

    asyncio.run(cancelled())
    assert not never.is_set()
    never.set()


def test_what_is_nearly_done_is_finished_before_the_loop_ends() -> None:
    begun, may_end = threading.Event(), threading.Event()
    finished: list[bool] = []

    def slow() -> None:
        begun.set()
        may_end.wait()
        finished.append(True)

    async def cancelled() -> None:
        working = asyncio.create_task(in_thread(slow))
        await asyncio.to_thread(begun.wait)
        working.cancel()
        await asyncio.sleep(0)
        may_end.set()
        with pytest.raises(asyncio.CancelledError):
            await working

    asyncio.run(cancelled())
    assert finished == [True]


# What a reader of the status gets: the newest model, the newest events, and how many it missed.


def entry(number: int) -> LogEntry:
    return LogEntry(Severity.WARNING, "drive-silent", {"line": "xyz", "n": number}, 1_000_000_000.25)


def named(name: str) -> Model:
    return Model(gateway=GatewayStatus(name=name))


async def test_a_reader_that_is_behind_gets_the_newest_model_and_the_newest_events() -> None:
    broadcast = Broadcast()
    with broadcast.open() as feed:
        for number in range(EVENTS_KEPT + 3):
            broadcast.publish_event(entry(number))
            broadcast.publish(named(str(number)))
        news = await feed.next()
    assert news.model == named(str(EVENTS_KEPT + 2))
    assert [told.number for told in news.events] == list(range(4, EVENTS_KEPT + 4))
    assert news.dropped == 3


async def test_nothing_comes_twice() -> None:
    broadcast = Broadcast()
    with broadcast.open() as feed:
        broadcast.publish_event(entry(1))
        assert len((await feed.next()).events) == 1
        waiting = asyncio.ensure_future(feed.next())
        await asyncio.sleep(0)
        assert not waiting.done()
        broadcast.publish(named(""))
        assert await waiting == News((), named(""), 0)


async def test_whoever_comes_later_gets_the_model_there_is_and_can_look_at_what_happened() -> None:
    broadcast = Broadcast()
    broadcast.publish(named("1"))
    broadcast.publish_event(entry(7))
    with broadcast.open() as feed:
        assert (await feed.next()).model == named("1")
    assert [told.entry.fields["n"] for told in broadcast.recent] == [7]
    broadcast.publish(named("2"))  # nobody reads any more


def test_models_come_as_often_as_the_most_curious_wants_them() -> None:
    told: list[float] = []
    broadcast = Broadcast(told.append)
    with broadcast.wanting(0.5):
        with broadcast.wanting(0.05):
            assert told == [0.5, 0.2]  # five times a second at most
        with broadcast.wanting(0.5), broadcast.wanting(3600.0):
            pass
    assert told[2:] == [0.5, 0.5, 0.5, 0.5, 0.5, 1.0]  # and once a second in any case


def test_an_event_as_data_has_its_own_fields_beside_what_all_have() -> None:
    broadcast = Broadcast()
    broadcast.publish_event(entry(7))
    assert broadcast.recent[0].as_data() == {
        "number": 1,
        "time": "2001-09-09T01:46:40.250+00:00",
        "event": "drive-silent",
        "severity": "warning",
        "line": "xyz",
        "n": 7,
    }


# The supervisor's ear, on a real socket: what it keeps, what it passes on, and how it comes back.


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
