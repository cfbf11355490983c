"""Notes on their way to the log."""

import asyncio

from gateway.catalogue import exchange_events
from gateway.catalogue.entry import Severity
from gateway.catalogue.process_events import STATUS
from gateway.exchange.events import Event
from gateway.ipc.log import LogEntry
from gateway.ipc.log_thread import CAPACITY, LogThread
from gateway.relay.journal import Journal
from gateway.relay.run import _Log


def test_without_a_writer_the_newest_notes_are_kept() -> None:
    journal = Journal(None)
    for number in range(CAPACITY + 5):
        journal.log(STATUS, number=number)
    notes = journal.recent()
    assert len(notes) == CAPACITY
    assert notes[-1].fields == {"number": CAPACITY + 4}


def test_an_event_of_the_exchange_is_a_note_at_once() -> None:
    written: list[LogEntry] = []
    told: list[LogEntry] = []
    journal = Journal(written.append)
    journal.on_entry = told.append
    journal.exchange_event("xyz", Event(exchange_events.WITHDRAWN, "x", "too late"))
    [entry] = written
    assert (entry.event, entry.severity) == ("withdrawn", Severity.WARNING)
    assert entry.fields == {"line": "xyz", "axis": "x", "detail": "too late"}
    assert told == written
    assert journal.recent() == ()


def test_good_news_is_no_warning() -> None:
    written: list[LogEntry] = []
    journal = Journal(written.append)
    journal.exchange_event("xyz", Event(exchange_events.BUDGET_OVERRUN, "x", "1200 µs"))
    journal.exchange_event("xyz", Event(exchange_events.BUDGET_KEPT, "x", "100 exchanges"))
    assert [(entry.event, entry.severity) for entry in written] == [
        ("budget-overrun", Severity.WARNING),
        ("budget-kept", Severity.INFO),
    ]


def test_what_the_loop_would_print_itself_goes_into_the_log() -> None:
    written: list[LogEntry] = []
    loop = asyncio.new_event_loop()
    with LogThread(written.append) as log:
        loop.set_exception_handler(_Log(log).unexpected)
        loop.call_soon(int, "no number")
        loop.call_soon(loop.stop)
        loop.run_forever()
    loop.close()
    [entry] = written
    assert (entry.event, entry.severity) == ("unexpected", Severity.ERROR)
    assert "Exception in callback" in str(entry.fields["detail"])
    assert "ValueError: invalid literal for int() with base 10: 'no number'" in str(entry.fields["traceback"])
