"""Writing a recording to a file: only an append on the hot path, everything else in a thread of its own.

A full disk, or a disk so slow that the buffer overflows, ends the recording with an event, and never the
gateway. A recording with a gap could not be replayed, so no entry is ever left out.
"""

import asyncio
import errno
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final

from gateway.files import create
from gateway.recording.traffic import End, Entry, Header, encode

CAPACITY: Final = 50_000
"""Entries that may wait for the disk: about ten seconds of the fastest line seen so far."""
WRITE_EVERY_S: Final = 0.2
STOP_S: Final = 5.0
"""Time that a stop waits for the disk."""
DEFAULT_MAX_BYTES: Final = 1_000_000_000


class Recorder:
    """Writes one file; ``on_lost`` gets a sentence when it ends before it was stopped."""

    def __init__(
        self, path: Path, header: Header, max_bytes: int = DEFAULT_MAX_BYTES, capacity: int = CAPACITY
    ) -> None:
        self.path = path
        self.on_lost: Callable[[str], None] = _ignore
        self.entries = 0
        """Number of entries written so far, without the header."""
        self._header = header
        self._max_bytes = max_bytes
        self._capacity = capacity
        self._waiting: list[Entry] = []
        self._is_on = False
        self._file_fd = -1
        self._bytes = 0
        self._failure: OSError | None = None
        self._thread = ThreadPoolExecutor(1, "recorder")
        self._task: asyncio.Task[None] | None = None

    @property
    def is_on(self) -> bool:
        """Whether it records."""
        return self._is_on

    def open(self) -> None:
        """Create the file: if that fails, nothing else needs to start.

        Raises:
            OSError: the file exists, or cannot be created or written.
        """
        # The configuration in it may hold passwords.
        self._file_fd = create(self.path)
        try:
            self._append(encode(self._header))
        except OSError:
            os.close(self._file_fd)
            self._file_fd = -1
            self.path.unlink()
            raise

    def start(self) -> None:
        """Begin; create the file if that has not been done.

        Raises:
            OSError: as :meth:`open`.
        """
        if self._file_fd < 0:
            self.open()
        self._is_on = True
        self._task = asyncio.create_task(self._run())

    def put(self, entry: Entry) -> None:
        """Take an entry; never blocks."""
        if not self._is_on:
            return
        if len(self._waiting) >= self._capacity:
            self._lose(f"{self._capacity} entries wait for a disk that is too slow")
            return
        self._waiting.append(entry)

    async def stop(self) -> None:
        """Write the rest and the end."""
        if self._task is None:
            return
        self._task.cancel()
        await asyncio.wait([self._task])
        self._task = None
        try:
            async with asyncio.timeout(STOP_S):
                await self._write_waiting()
                await self._in_thread(self._write_end)
        except TimeoutError:
            self._lose(f"the disk did not answer within {STOP_S:g} s")
        self._is_on = False
        self._thread.submit(os.close, self._file_fd)  # after any write that still hangs
        self._thread.shutdown(wait=False)

    async def discard(self) -> None:
        """Stop, and remove the file: nothing that it should record has happened."""
        if self._task is not None:
            self._is_on = False
            await self.stop()
            self.path.unlink(missing_ok=True)

    async def _run(self) -> None:
        while self._is_on:
            await asyncio.sleep(WRITE_EVERY_S)
            # Shielded: stop() must not write a batch again that is being written.
            await asyncio.shield(self._write_waiting())

    async def _write_waiting(self) -> None:
        batch, self._waiting = self._waiting, []
        await self._in_thread(partial(self._write, batch))

    async def _in_thread(self, work: Callable[[], None]) -> None:
        if not self._is_on:
            return
        try:
            await asyncio.get_running_loop().run_in_executor(self._thread, work)
        except OSError as error:
            self._lose(error.strerror or str(error))

    def _write_end(self) -> None:
        self._append(encode(End(self.entries)))

    def _write(self, batch: list[Entry]) -> None:
        """Write whole entries. Only in the thread, as everything below."""
        self._append(b"".join(map(encode, batch)))
        self.entries += len(batch)

    def _append(self, data: bytes) -> None:
        if self._failure is not None:  # nothing may follow a gap
            raise self._failure
        try:
            self._write_all(data)
        except OSError as error:
            self._failure = error
            os.ftruncate(self._file_fd, self._bytes)  # an incomplete entry is useless
            raise
        self._bytes += len(data)

    def _write_all(self, data: bytes) -> None:
        if self._bytes + len(data) > self._max_bytes:
            raise OSError(errno.EFBIG, f"the recording has reached its limit of {self._max_bytes} bytes")
        view = memoryview(data)
        while view:
            view = view[os.write(self._file_fd, view) :]

    def _lose(self, why: str) -> None:
        if self._is_on:
            self._is_on = False
            self._waiting = []
            self.on_lost(
                f"{self.path}: {why}; it has the first {self.entries} entries, which can be replayed. The "
                "gateway continues without it"
            )


def _ignore(why: str) -> None:
    pass
