"""What a start makes of its records is written at once: a relay that is killed right then has said it."""

import threading

from gateway.catalogue.entry import Severity
from gateway.ipc.log import LogEntry
from gateway.ipc.log_thread import LogThread
from gateway.relay.run import noting

PATIENCE_S = 30.0


async def test_what_a_start_restores_is_written_without_waiting_for_the_next_waking() -> None:
    written: list[str] = []
    is_written = threading.Event()

    def write(entry: LogEntry) -> None:
        written.append(entry.event)
        if entry.event == "restored":
            is_written.set()

    with LogThread(write) as log:
        entry = noting(log)
        entry(LogEntry(Severity.INFO, "line-up", {}, 0.0))
        entry(LogEntry(Severity.INFO, "restored", {}, 0.0))
        assert is_written.wait(PATIENCE_S)
        assert written == ["line-up", "restored"]
