"""Watches the tables folder: polls it, reacts to system notifications, and decides when to read."""

import asyncio
import contextlib
import time
from collections.abc import Callable, Collection, Mapping
from functools import partial
from pathlib import Path
from typing import Final

from gateway.supervisor.debounce import FileDebounce, FileStability, FileStamp
from gateway.supervisor.file_stamps import scan
from gateway.supervisor.in_thread import in_thread

EVERY_S: Final = 1.0
"""Poll interval without a notification: needed for network file systems and for a dead watcher."""
SOON_S: Final = 0.1
"""Poll interval while something changes."""
STEP_MS: Final = 250
"""Interval at which the watcher checks for system notifications; each check wakes a thread."""
SLOW_S: Final = 10.0
"""A slower poll is reported: the file system does not respond."""


class Watch:
    """Follows the table files of one configuration; on one loop, polls in a thread."""

    def __init__(self) -> None:
        self._files: dict[str, FileDebounce] = {}
        self._names: Mapping[str, str] = {}
        self._folder = Path()
        self._signed = False
        self._stamps: Mapping[str, FileStamp] = {}
        self._looked_s = time.monotonic()
        self._woken = asyncio.Event()

    def follow(self, folder: Path, names: Mapping[str, str], *, signed: bool = False) -> None:
        """Follow these files from now on: the name of each axis's table, and the common folder.

        ``signed``: each must have a signature.
        """
        self._signed = signed
        if folder == self._folder and names == self._names:
            return  # not woken: a caller that follows after each reading would poll without a pause
        if folder != self._folder:
            self._files, self._stamps = {}, {}
        self._folder, self._names = folder, dict(names)
        followed = set(names.values())
        self._files = {name: self._files.get(name) or FileDebounce() for name in followed}
        self.wake()

    @property
    def folder(self) -> Path:
        """The folder that is watched."""
        return self._folder

    @property
    def moving(self) -> frozenset[str]:
        """Axes whose file has changed or gone, and is not stable yet."""
        return self._axes_in(FileStability.MOVING)

    @property
    def unread(self) -> frozenset[str]:
        """Axes whose file is not the one that was last read."""
        return frozenset(
            axis
            for axis, name in self._names.items()
            if (stamp := self._stamps.get(name)) is not None and not self._files[name].is_read(stamp)
        )

    @property
    def overdue(self) -> frozenset[str]:
        """Axes whose file has been changing for very long."""
        now_s = time.monotonic()
        return frozenset(axis for axis in self.moving if self._files[self._names[axis]].is_overdue(now_s))

    @property
    def still(self) -> Mapping[str, FileStamp | None]:
        """The stamp with which each file may be read, by name; None while the file changes."""
        seen = {name: stamp for name, stamp in self._stamps.items() if name in self._files}
        return {
            name: None if self._state(name) is FileStability.MOVING else stamp for name, stamp in seen.items()
        }

    @property
    def silent_s(self) -> float:
        """How long no poll of the folder has succeeded."""
        return time.monotonic() - self._looked_s

    def wake(self) -> None:
        """Poll immediately."""
        self._woken.set()

    async def scan(self) -> bool:
        """Poll all files; return whether any is ready to be read."""
        folder, names = self._folder, list(self._files)
        stamps = await in_thread(partial(scan, folder, names, signed=self._signed))
        if folder != self._folder or set(names) != self._files.keys():
            return False  # other files are followed by now
        self._stamps, self._looked_s = stamps, time.monotonic()
        return any(self._state(name) is FileStability.READY for name in names)

    def take(self, before: Mapping[str, FileStamp], waiting: Collection[str] = (), *, began_s: float) -> None:
        """Note that files were read; ``before`` are their stamps just before reading.

        ``began_s``: when the reading began (``time.monotonic``). Earlier polls are older than these stamps:
        with them, a stable file would seem to change.

        The files of axes in ``waiting`` could not be read; they are to be read when they are stable.
        """
        taken = {name: stamp for name, stamp in before.items() if name in self._files}
        for name, stamp in taken.items():
            self._files[name].take(stamp, time.monotonic())
        if self._looked_s < began_s:
            self._stamps = {**self._stamps, **taken}
        for axis in waiting:
            if axis in self._names:
                self._files[self._names[axis]].forget()

    @property
    def stamps(self) -> Mapping[str, FileStamp]:
        """The newest stamps, by name of the file."""
        return self._stamps

    async def rest(self) -> None:
        """Wait until the next poll is due."""
        wait_s = SOON_S if self.moving else EVERY_S
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(wait_s):  # wait_for of Python 3.11 would lose a cancellation here
                await self._woken.wait()
        self._woken.clear()

    def _state(self, name: str) -> FileStability:
        stamp = self._stamps.get(name)
        return FileStability.SAME if stamp is None else self._files[name].observe(stamp, time.monotonic())

    def _axes_in(self, state: FileStability) -> frozenset[str]:
        return frozenset(axis for axis, name in self._names.items() if self._state(name) is state)


async def wake_on_change(folder: Path, wake: Callable[[], None], complain: Callable[[str], None]) -> None:
    """Call ``wake`` at each system notification of a change in a folder; never returns.

    If the system cannot notify, as for a missing folder, the watch only polls. The reason is reported once.
    """
    from watchfiles import awatch

    reported = ""
    while True:
        try:
            await in_thread(
                folder.stat
            )  # awatch reads the folder on the loop: a folder that does not respond would block it
            async for _ in awatch(folder, watch_filter=None, debounce=STEP_MS, step=STEP_MS, recursive=False):
                reported = ""
                wake()
        except (OSError, RuntimeError) as error:
            if str(error) != reported:
                reported = str(error)
                complain(reported)
        await asyncio.sleep(EVERY_S)
