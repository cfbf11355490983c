"""``/events``: what a reader is told, in which order, how often, and what a slow one costs."""

import asyncio
import json
import time
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from gateway.catalogue.entry import Severity
from gateway.ipc.log import LogEntry
from gateway.supervisor.broadcast import EVENTS_KEPT
from gateway.supervisor.http.answers import Limits
from tests.supervisor.http.http_bench import STATUS, Line, Served, large_model, model, serving, until
from tests.support.status_models import model_of


def entry(number: int) -> LogEntry:
    return LogEntry(Severity.WARNING, "drive-silent", {"line": "xyz", "n": number}, 1_000_000_000.25)


async def reading(served: Served, query: str = "", last_id: str | None = None) -> Line:
    line = await served.connect()
    more = "" if last_id is None else f"Last-Event-ID: {last_id}\r\n"
    await line.say(f"GET /events{query} HTTP/1.1\r\nHost: localhost\r\n{more}\r\n")
    head = await line.until(b"\r\n\r\n")
    assert b"content-type: text/event-stream" in head
    assert b"cache-control: no-store" in head
    return line


async def messages(line: Line, count: int) -> list[dict[str, Any]]:
    """Return so many messages, without comments and without the first one, which says when to come back."""
    found: list[dict[str, Any]] = []
    while len(found) < count:
        text = (await line.until(b"\n\n")).decode()
        # A chunk of HTTP begins with its length in a line of its own.
        fields = dict(row.split(": ", 1) for row in text.splitlines() if ": " in row and row[0] != ":")
        if "event" in fields:
            found.append({**fields, "data": json.loads(fields["data"])})
    return found


async def test_what_happened_lately_comes_first_then_the_status_then_what_happens(tmp_path: Path) -> None:
    newest = model()  # it holds the second in which it was made
    async with serving(tmp_path, newest=newest) as served:
        served.broadcast.publish_event(entry(1))
        served.broadcast.publish_event(entry(2))
        line = await reading(served)
        first, second, status = await messages(line, 3)
        assert [first["event"], second["event"], status["event"]] == ["event", "event", "status"]
        assert first["data"] == {
            "number": 1,
            "time": "2001-09-09T01:46:40.250+00:00",
            "event": "drive-silent",
            "severity": "warning",
            "line": "xyz",
            "n": 1,
        }
        assert status["data"] == json.loads(json.dumps(newest))
        assert "id" not in status
        served.broadcast.publish_event(entry(3))
        assert (await messages(line, 1))[0]["data"]["n"] == 3


async def test_whoever_comes_back_gets_what_it_missed_and_nothing_twice(served: Served) -> None:
    for number in range(4):
        served.broadcast.publish_event(entry(number))
    all_of_them = await messages(await reading(served), 4)
    ids = [message["id"] for message in all_of_them]
    assert len(set(ids)) == 4
    back = await reading(served, last_id=ids[1])
    assert [message["data"]["n"] for message in await messages(back, 2)] == [2, 3]
    # The id of another process says nothing about the numbers of this one; nor does what is none.
    for other in ("4bee-2", f"x{ids[1]}", f"{ids[1]}x", "", "-", "9" * 5000, f"{ids[1].split('-')[0]}-²"):
        again = await reading(served, last_id=other)
        assert [message["data"]["n"] for message in await messages(again, 4)] == [0, 1, 2, 3]


async def test_events_that_nobody_keeps_any_more_are_counted(served: Served) -> None:
    served.broadcast.publish_event(entry(0))
    (first,) = await messages(await reading(served), 1)
    for number in range(1, EVENTS_KEPT + 4):
        served.broadcast.publish_event(entry(number))
    missed, oldest = await messages(await reading(served, last_id=first["id"]), 2)
    # 0 was seen; of 1 to 259 the newest 256 are kept, from 4 on.
    assert (missed["event"], missed["data"]) == ("missed", {"events": 3})
    assert oldest["data"]["n"] == 4


@pytest.mark.parametrize(("query", "kinds"), [("?events", {"event"}), ("?status", {"status"})])
async def test_a_reader_may_choose(tmp_path: Path, query: str, kinds: set[str]) -> None:
    async with serving(tmp_path, tcp=Limits(status_every_s=0.0), newest=model()) as served:
        served.broadcast.publish_event(entry(0))
        line = await reading(served, query)
        heard: list[dict[str, Any]] = []
        for number in range(5):
            heard += await messages(line, 1)
            served.broadcast.publish(model_of(model()))
            served.broadcast.publish_event(entry(number))
        assert {message["event"] for message in heard} == kinds


async def test_of_many_models_only_the_newest_comes(tmp_path: Path) -> None:
    async with serving(tmp_path, tcp=Limits(status_every_s=0.2), newest=model(age_s=0.0)) as served:
        began_s = time.monotonic()
        line = await reading(served)
        assert (await messages(line, 1))[0]["data"]["gateway"]["snapshot_age_s"] == 0.0
        for number in range(1, 101):
            served.broadcast.publish(model_of(model(age_s=number / 100)))
        served.broadcast.publish_event(entry(0))
        (event,) = await messages(line, 1)
        assert event["event"] == "event"  # which does not wait for its turn
        (newest,) = await messages(line, 1)
        assert newest["data"]["gateway"]["snapshot_age_s"] == 1.0
        assert time.monotonic() - began_s >= 0.2


async def test_a_quiet_reader_hears_that_somebody_is_still_there(tmp_path: Path) -> None:
    async with serving(tmp_path, tcp=Limits(heartbeat_s=0.05)) as served:
        began_s = time.monotonic()
        line = await reading(served, "?events")
        stop = asyncio.create_task(_publish_for_ever(served))
        await line.until(*[b": nothing new\n\n"] * 4)
        assert time.monotonic() - began_s >= 4 * 0.05
    # It ends although there is a new model in every turn of the loop.
    stop.cancel()


async def _publish_for_ever(served: Served) -> None:
    while True:
        served.broadcast.publish(model_of(model()))
        await asyncio.sleep(0)


async def test_one_reader_too_many_is_told_so(tmp_path: Path) -> None:
    async with serving(tmp_path, tcp=Limits(event_readers=2)) as served:
        first = await reading(served)
        await reading(served)
        await asyncio.gather(*(line.until(b"retry: 2000\n\n") for line in served.lines))
        third = await served.ask("/events")
        assert (third.status, third.data) == (
            503,
            {"problem": "2 clients already read the events; try again later"},
        )
        assert (await served.ask("/metrics")).status == 200
        first.close()
        await until(lambda: len(served.broadcast._subscribers) == 1)
        await (await reading(served)).until(b"retry: 2000\n\n")


async def test_a_reader_that_takes_nothing_costs_its_feed_and_is_dropped(tmp_path: Path) -> None:
    limits = Limits(status_every_s=0.0, stalled_s=0.2, sweep_s=0.01)
    async with serving(tmp_path, tcp=limits) as served:
        slow = await reading(served)
        slow.writer.transport.pause_reading()  # type: ignore[attr-defined]
        quick = await reading(served, "?status")
        whole = model_of(model())
        whole.gateway.name = "a" * 100_000
        sent = 0
        async with asyncio.timeout(20):
            while len(served.broadcast._subscribers) == 2:
                served.broadcast.publish(replace(whole, gateway=replace(whole.gateway, uptime_s=float(sent))))
                sent += 1
                # Whoever reads gets each of them all the same.
                assert (await messages(quick, 1))[0]["data"]["gateway"]["uptime_s"] == sent - 1
        assert sent > 10
        slow.writer.transport.resume_reading()  # type: ignore[attr-defined]
        # What it was sent before it stopped, and no more: the buffers of two sockets, and one message.
        assert len(await slow.rest()) < 20_000_000


async def test_an_answer_that_nobody_takes_is_dropped(tmp_path: Path) -> None:
    limits = Limits(stalled_s=0.2, sweep_s=0.01)
    async with serving(tmp_path, tcp=limits) as served:
        served.broadcast.publish(large_model())
        line = await served.connect()
        line.writer.transport.pause_reading()  # type: ignore[attr-defined]
        await line.say(STATUS)
        await until(lambda: served.connections() == 1)
        await until(lambda: served.connections() == 0)
