"""Notes on their way through the thread that writes them, into a pipe that nobody reads for a while."""

import contextlib
import fcntl
import os
import select
from collections.abc import Iterator

import pytest

from gateway.catalogue.entry import Severity
from gateway.ipc.log import LogEntry
from gateway.ipc.log_thread import CAPACITY, LogThread

PIPE = 4096
PATIENCE_S = 30.0


class Pipe:
    """A pipe of one page; what does not fit makes the writer wait."""

    def __init__(self) -> None:
        self.read_fd, self.write_fd = os.pipe()
        fcntl.fcntl(self.write_fd, fcntl.F_SETPIPE_SZ, PIPE)

    def write(self, entry: LogEntry) -> None:
        """Write a note as its event, its number and as many spaces as it wants."""
        spaces = " " * int(str(entry.fields.get("spaces", 0)))
        rest = f"{entry.event} {entry.fields['count']}{spaces}\n".encode()
        while rest:
            rest = rest[os.write(self.write_fd, rest) :]

    def until(self, last: str) -> list[str]:
        """Read up to a line; returns all of them without the spaces."""
        text = b""
        while not text.rstrip(b" \n").endswith(last.encode()):
            ready, _, _ = select.select([self.read_fd], [], [], PATIENCE_S)
            assert ready, f"{last} does not come"
            text += os.read(self.read_fd, 65_536)
        return [line.rstrip() for line in text.decode().splitlines()]


@pytest.fixture
def pipe() -> Iterator[Pipe]:
    pipe = Pipe()
    yield pipe
    for descriptor in (pipe.read_fd, pipe.write_fd):
        with contextlib.suppress(OSError):
            os.close(descriptor)


def entry(number: int, spaces: int = 0) -> LogEntry:
    return LogEntry(Severity.INFO, "tick", {"count": number, "spaces": spaces})


def stall(log: LogThread, pipe: Pipe) -> None:
    """Write a note, number 0, that does not fit; returns when the thread waits with it."""
    log.write(entry(0, 2 * PIPE))
    ready, _, _ = select.select([pipe.read_fd], [], [], PATIENCE_S)
    assert ready


@pytest.mark.parametrize("dropped", [0, 1, 7])
def test_of_what_waits_for_the_reader_the_newest_are_kept_and_the_others_counted(
    pipe: Pipe, dropped: int
) -> None:
    last = CAPACITY + dropped
    with LogThread(pipe.write) as log:
        stall(log, pipe)
        for number in range(1, last + 1):
            log.put(entry(number))
        log.wake()
        lines = pipe.until(f"tick {last}")
    told = [f"notes-dropped {dropped}"] if dropped else []
    assert lines == ["tick 0", *told, *(f"tick {number}" for number in range(dropped + 1, last + 1))]


def test_each_hole_has_its_own_count(pipe: Pipe) -> None:
    with LogThread(pipe.write) as log:
        for _ in range(2):
            stall(log, pipe)
            for number in range(1, CAPACITY + 4):
                log.put(entry(number))
            assert pipe.until(f"tick {CAPACITY + 3}")[:3] == ["tick 0", "notes-dropped 3", "tick 4"]


def test_what_is_put_is_written_after_the_next_wake_in_its_order(pipe: Pipe) -> None:
    with LogThread(pipe.write) as log:
        for first in range(0, 300, 3):
            log.put(entry(first))
            log.put(entry(first + 1))
            log.wake()
            log.wake()
            assert pipe.until(f"tick {first + 1}") == [f"tick {first}", f"tick {first + 1}"]
            log.write(entry(first + 2))
            assert pipe.until(f"tick {first + 2}") == [f"tick {first + 2}"]


def test_an_end_writes_what_was_put_before_it_began() -> None:
    written: list[LogEntry] = []
    log = LogThread(written.append)
    notes = [entry(number) for number in range(CAPACITY)]
    for each in notes[:500]:
        log.put(each)
    with log:
        for each in notes[500:]:
            log.put(each)
    assert written == notes


async def test_an_end_does_not_wait_for_a_reader_that_has_stalled(pipe: Pipe) -> None:
    log = LogThread(pipe.write)
    async with log:
        stall(log, pipe)
        log.put(entry(1))
    # Here although nobody has read; and nothing is out of order when somebody does at last.
    assert pipe.until("tick 1") == ["tick 0", "tick 1"]
    log.close(PATIENCE_S)
