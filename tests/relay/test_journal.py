"""Notes on their way to the log."""

import asyncio
import json
import sys

import pytest

from gateway.exchange.events import Event, EventKind
from gateway.ipc.notes import LogFormat, Note, Severity, note_writer
from gateway.relay.journal import CAPACITY, Journal


def test_without_a_writer_the_newest_notes_are_kept() -> None:
    journal = Journal(None)
    for number in range(CAPACITY + 5):
        journal.note(Severity.INFO, "tick", number=number)
    notes = journal.recent()
    assert len(notes) == CAPACITY
    assert notes[-1].fields == {"number": CAPACITY + 4}


def test_dropped_notes_are_counted_and_said() -> None:
    written: list[Note] = []
    journal = Journal(written.append)
    for number in range(CAPACITY + 5):
        journal.note(Severity.INFO, "tick", number=number)
    journal.flush()
    assert (written[0].event, written[0].fields) == ("notes-dropped", {"count": 5})
    assert written[1].fields == {"number": 5}
    assert len(written) == CAPACITY + 1


async def test_notes_are_written_by_a_task_and_the_rest_at_the_end() -> None:
    written: list[Note] = []
    arrived = asyncio.Event()

    def write(note: Note) -> None:
        written.append(note)
        arrived.set()

    journal = Journal(write)
    journal.start()
    journal.exchange_event("xyz", Event(EventKind.WITHDRAWN, "x", "too late"))
    async with asyncio.timeout(5):
        await arrived.wait()
    journal.note(Severity.INFO, "last")
    await journal.stop()
    assert [note.event for note in written] == ["withdrawn", "last"]
    assert written[0].severity is Severity.WARNING
    assert written[0].fields == {"line": "xyz", "axis": "x", "detail": "too late"}


def test_a_service_logs_json_lines(capsys: pytest.CaptureFixture[str]) -> None:
    write = note_writer(LogFormat.JSON)
    write(Note(Severity.WARNING, "line-down", {"line": "xyz"}, 0.0))
    assert json.loads(capsys.readouterr().err) == {
        "event": "line-down",
        "level": "warning",
        "line": "xyz",
        "timestamp": "1970-01-01T00:00:00.000+00:00",
    }


def test_a_person_reads_plain_lines(capsys: pytest.CaptureFixture[str]) -> None:
    write = note_writer(LogFormat.CONSOLE)
    write(Note(Severity.INFO, "ready", {"addresses": "127.0.0.1:1502"}, 0.0))
    line = capsys.readouterr().err
    assert "ready" in line
    assert "127.0.0.1:1502" in line
    assert "\x1b" not in line or sys.stderr.isatty()
