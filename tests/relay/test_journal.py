"""Notes on their way to the log."""

import asyncio

from gateway.catalogue import exchange_events
from gateway.catalogue.entry import Severity
from gateway.catalogue.process_events import STATUS
from gateway.exchange.events import Event
from gateway.ipc.log_thread import CAPACITY, LogThread
from gateway.ipc.notes import Note
from gateway.relay.journal import Journal
from gateway.relay.run import _Log


def test_without_a_writer_the_newest_notes_are_kept() -> None:
    journal = Journal(None)
    for number in range(CAPACITY + 5):
        journal.note(STATUS, number=number)
    notes = journal.recent()
    assert len(notes) == CAPACITY
    assert notes[-1].fields == {"number": CAPACITY + 4}


def test_an_event_of_the_exchange_is_a_note_at_once() -> None:
    written: list[Note] = []
    told: list[Note] = []
    journal = Journal(written.append)
    journal.on_note = told.append
    journal.exchange_event("xyz", Event(exchange_events.WITHDRAWN, "x", "too late"))
    [note] = written
    assert (note.event, note.severity) == ("withdrawn", Severity.WARNING)
    assert note.fields == {"line": "xyz", "axis": "x", "detail": "too late"}
    assert told == written
    assert journal.recent() == ()


def test_good_news_is_no_warning() -> None:
    written: list[Note] = []
    journal = Journal(written.append)
    journal.exchange_event("xyz", Event(exchange_events.BUDGET_OVERRUN, "x", "1200 µs"))
    journal.exchange_event("xyz", Event(exchange_events.BUDGET_KEPT, "x", "100 exchanges"))
    assert [(note.event, note.severity) for note in written] == [
        ("budget-overrun", Severity.WARNING),
        ("budget-kept", Severity.INFO),
    ]


def test_what_the_loop_would_print_itself_goes_into_the_log() -> None:
    written: list[Note] = []
    loop = asyncio.new_event_loop()
    with LogThread(written.append) as log:
        loop.set_exception_handler(_Log(log).unexpected)
        loop.call_soon(int, "no number")
        loop.call_soon(loop.stop)
        loop.run_forever()
    loop.close()
    [note] = written
    assert (note.event, note.severity) == ("unexpected", Severity.ERROR)
    assert "Exception in callback" in str(note.fields["detail"])
    assert "ValueError: invalid literal for int() with base 10: 'no number'" in str(note.fields["traceback"])
