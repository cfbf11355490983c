"""A log whose reader may stall: whoever notes something never waits, a thread of its own does.

Standard error is a pipe to a journal, to a pager, or a terminal that was stopped with Ctrl-S. When it is
full, writing blocks until somebody reads. The interpreter does not wait for this thread at its end. What it
calls must not write through Python's buffered streams: the interpreter wants their locks then.
"""

import asyncio
import contextlib
import threading
from collections import deque
from collections.abc import Callable
from itertools import count
from typing import Final, Self

from gateway.catalogue.process_events import NOTES_DROPPED
from gateway.ipc.log import LogEntry, log_entry

CAPACITY: Final = 1000
"""Notes that wait for the reader; of more the newest are kept."""
CLOSE_S: Final = 1.0
"""So long an end waits for a reader that has stalled."""


class LogThread:
    """Writes notes in their order with ``write``, which may block, and is called in the thread only.

    Where the buffer ran over, a note says how many are missing, in their place. It is for one thread that
    notes; a context, too, in which it writes.
    """

    def __init__(self, write: Callable[[LogEntry], None]) -> None:
        self._write = write
        self._numbers = count(1)
        self._notes: deque[tuple[int, LogEntry]] = deque(maxlen=CAPACITY)
        """Numbered: a gap tells how many were dropped, without a counter that two threads change."""
        self._last = 0
        self._nothing_to_do = threading.Lock()
        """Held while the thread has nothing to do; it waits for it."""
        self._is_closing = False
        # Not of an executor: those threads are waited for at exit, however long that takes.
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
        """As :meth:`close`; the loop hears signals meanwhile."""
        await asyncio.to_thread(self.close)

    def start(self) -> None:
        """Begin to write. The thread keeps the signal mask and the scheduling of now."""
        self._nothing_to_do.acquire()
        self._thread.start()

    def put(self, entry: LogEntry) -> None:
        """Take a note for the price of an append; it is written after the next :meth:`wake`."""
        self._notes.append((next(self._numbers), entry))

    def wake(self) -> None:
        """Have everything written that was put, soon."""
        if self._notes:
            self._let_go()

    def write(self, entry: LogEntry) -> None:
        """Take a note and have it written at once; never blocks."""
        self.put(entry)
        self._let_go()

    def close(self, wait_s: float = CLOSE_S) -> None:
        """Have the rest written; returns after ``wait_s`` at the latest, then without what is left."""
        self._is_closing = True
        self._let_go()
        self._thread.join(wait_s)

    def _let_go(self) -> None:
        with contextlib.suppress(RuntimeError):  # it was let go already, and has not come by yet
            self._nothing_to_do.release()

    def _run(self) -> None:
        while True:
            is_closing = self._is_closing
            while self._notes:
                self._write_oldest()
            if is_closing:
                return
            self._nothing_to_do.acquire()

    def _write_oldest(self) -> None:
        number, entry = self._notes.popleft()
        if dropped := number - self._last - 1:
            self._write(log_entry(NOTES_DROPPED, {"count": dropped}, entry.wall_s))
        self._last = number
        self._write(entry)
