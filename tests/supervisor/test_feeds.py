"""What a reader of the status gets: the newest model, the newest events, and how many it missed."""

import asyncio

from gateway.catalogue.entry import Severity
from gateway.ipc.log import LogEntry
from gateway.status.model import GatewayStatus, Model
from gateway.supervisor.broadcast import EVENTS_KEPT, Broadcast, News


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
