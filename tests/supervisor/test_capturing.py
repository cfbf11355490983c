"""Frames that are written by themselves when something happens: which event, how often, how many files."""

import asyncio
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from gateway.catalogue.entry import EventEntry
from gateway.catalogue.process_events import CAPTURE_FAILED
from gateway.config.load import Loaded, load
from gateway.ipc.handlers import RequestHandlers
from gateway.ipc.messages import Done
from gateway.ipc.server import ControlServer
from gateway.recording import traffic
from gateway.recording.trace_buffer import REPLY, SEGMENTS, TEXT, TraceBuffer
from gateway.supervisor.capturing import Capturing, write_capture
from tests.config.config_bench import GOOD, written

ON = """
[capture]
on = ["drive-silent", "captured", "capture-failed"]
keep = 2
"""
WHEN = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)


def configured(folder: Path) -> Loaded:
    return load(written(folder, GOOD + ON))


async def test_what_the_tape_holds_is_written_and_the_oldest_files_give_way(tmp_path: Path) -> None:
    loaded = configured(tmp_path)
    state = tmp_path / "state"
    trace_buffer = TraceBuffer("xyz", SEGMENTS * 4096, 0, 0)
    trace_buffer.put(TEXT, 5, 0, traffic.encode(traffic.Up("xyz", 5)))
    trace_buffer.put(REPLY, 7, 1, bytes.fromhex("830B"))
    trace_buffer.show()
    desk = RequestHandlers(lambda _request, _peer: Done(), tapes=lambda: {"xyz": trace_buffer.descriptor})
    server = ControlServer(state, desk)
    await server.open()
    files = []
    for second in range(3):
        when = WHEN.replace(second=second)
        file, entries = await asyncio.to_thread(write_capture, state, loaded, "drive-silent", when)
        assert entries == 2
        files.append(file)
    await server.close()
    trace_buffer.close()
    assert [file.name for file in files] == [
        f"capture-20260102T03040{second}Z-drive-silent.jsonl" for second in range(3)
    ]
    assert sorted(state.glob("capture-*")) == files[1:]
    header, *entries_read = [traffic.decode(line) for line in files[2].read_bytes().splitlines()]
    assert isinstance(header, traffic.Header)
    assert (header.format, header.config) == (traffic.CAPTURED, (tmp_path / "gateway.toml").read_text())
    assert entries_read == [traffic.Up("xyz", 5), traffic.Reply("xyz", 7, 1, "830b"), traffic.End(2)]


@pytest.mark.parametrize(
    ("events", "expected"),
    [
        (["drive-answers"], []),
        (["captured", "capture-failed"], []),
        (["drive-silent", "drive-silent"], ["drive-silent"]),
    ],
    ids=["another event", "its own events", "once for several"],
)
async def test_which_events_are_heard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, events: list[str], expected: list[str]
) -> None:
    """Nobody runs there, so what was tried is told as a failure."""
    monkeypatch.setattr("gateway.supervisor.capturing.AFTER_S", 0.0)
    said: asyncio.Queue[tuple[EventEntry, Any]] = asyncio.Queue()
    capturing = Capturing(tmp_path / "state", lambda event, **fields: said.put_nowait((event, fields)))
    capturing.happened("drive-silent")  # before there is a configuration nothing is asked for
    capturing.follow(configured(tmp_path))
    running = asyncio.create_task(capturing.run())
    for event in events:
        capturing.happened(event)
    for event in expected:
        entry, fields = await asyncio.wait_for(said.get(), 30.0)
        assert entry is CAPTURE_FAILED
        assert fields["on"] == event
        assert "no gateway runs" in fields["detail"]
    capturing.happened("drive-silent") if expected else None  # within the same minute
    running.cancel()
    await asyncio.wait([running])
    assert said.empty()


async def test_a_capture_that_cannot_be_written_says_where_and_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.supervisor.capturing.AFTER_S", 0.0)
    monkeypatch.setattr("gateway.supervisor.capturing.PREFIX", "nowhere/capture-")
    state = tmp_path / "state"
    trace_buffer = TraceBuffer("xyz", SEGMENTS * 4096, 0, 0)
    server = ControlServer(
        state, RequestHandlers(lambda _request, _peer: Done(), tapes=lambda: {"xyz": trace_buffer.descriptor})
    )
    await server.open()
    said: asyncio.Queue[str] = asyncio.Queue()
    capturing = Capturing(state, lambda event, **fields: said.put_nowait(fields["detail"]))
    capturing.follow(configured(tmp_path))
    running = asyncio.create_task(capturing.run())
    capturing.happened("drive-silent")
    detail = await asyncio.wait_for(said.get(), 30.0)
    running.cancel()
    await asyncio.wait([running])
    await server.close()
    trace_buffer.close()
    assert detail.startswith(f"{state}/nowhere/capture-")
    assert "drive-silent.jsonl: No such file or directory; " in detail
