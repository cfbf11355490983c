"""A log whose reader may stall: only its own thread waits for it, never the caller.

Standard error is a pipe to a journal, to a pager, or a terminal that was stopped with Ctrl-S. When it is
full, writing blocks until its reader continues. The interpreter does not wait for this thread at its end. So
``write`` must not use Python's buffered streams: the interpreter needs their locks at that time.
"""

import asyncio
import contextlib
import signal
import threading
from collections import deque
from collections.abc import Callable
from itertools import count
from typing import Final, Self

from gateway.catalogue.process_events import NOTES_DROPPED
from gateway.ipc.log import LogEntry, log_entry

CAPACITY: Final = 1000
"""Entries that wait for the reader; if there are more, the newest are kept."""
CLOSE_S: Final = 1.0
"""Time that an end waits for a stalled reader."""


class LogThread:
    """Writes entries in order with ``write``, which may block and is called in the thread only.

    If the buffer overflows, an entry in place of the lost ones says how many are missing. Only one thread may
    put entries. As a context manager it runs the thread.
    """

    def __init__(self, write: Callable[[LogEntry], None]) -> None:
        self._write = write
        self._numbers = count(1)
        self._entries: deque[tuple[int, LogEntry]] = deque(maxlen=CAPACITY)
        """Numbered: a gap shows how many were dropped, without a counter that two threads change."""
        self._last = 0
        self._nothing_to_do = threading.Lock()
        """The thread waits for this lock while it has nothing to write."""
        self._is_closing = False
        # Not of an executor: the interpreter would wait for such a thread at exit, without limit.
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)

    def __enter__(self) -> Self:
        """As :meth:`start`."""
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        """As :meth:`close`."""
        self.close()

    async def __aenter__(self) -> Self:
        """As :meth:`start`."""
        self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        """As :meth:`close`; the loop handles signals meanwhile."""
        await asyncio.to_thread(self.close)

    def start(self) -> None:
        """Start the thread. It keeps the present scheduling.

        The thread blocks all signals. In a process whose other threads block a signal to wait for it, the
        signal would reach this thread and end the process.
        """
        self._nothing_to_do.acquire()
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
        try:
            self._thread.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)

    def put(self, entry: LogEntry) -> None:
        """Take an entry, at the cost of an append; it is written after the next :meth:`wake`."""
        self._entries.append((next(self._numbers), entry))

    def wake(self) -> None:
        """Have all entries written soon."""
        if self._entries:
            self._let_go()

    def write(self, entry: LogEntry) -> None:
        """Take an entry and have it written immediately; never blocks."""
        self.put(entry)
        self._let_go()

    def close(self, wait_s: float = CLOSE_S) -> None:
        """Have the rest written; after ``wait_s`` return without what is left."""
        self._is_closing = True
        self._let_go()
        self._thread.join(wait_s)

    def _let_go(self) -> None:
        with contextlib.suppress(RuntimeError):  # released already; the thread has not run yet
            self._nothing_to_do.release()

    def _run(self) -> None:
        while True:
            is_closing = self._is_closing
            while self._entries:
                self._write_oldest()
            if is_closing:
                return
            self._nothing_to_do.acquire()

    def _write_oldest(self) -> None:
        number, entry = self._entries.popleft()
        if dropped := number - self._last - 1:
            self._write(log_entry(NOTES_DROPPED, {"count": dropped}, entry.wall_s))
        self._last = number
        self._write(entry)
