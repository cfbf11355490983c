"""Watches the tables folder: looks often, at once where the system tells, and says when to read."""

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
"""Between two looks when nothing tells; what a network file system or a dead watcher needs."""
SOON_S: Final = 0.1
"""Between two looks while something changes."""
STEP_MS: Final = 250
"""Between two looks of the watcher at what the system has told; each wakes a thread, whether anything has."""
SLOW_S: Final = 10.0
"""A look that takes longer is worth a word: a file system that does not answer."""


class Watch:
    """Follows the table files of the axes of one configuration; one loop, looks in a thread."""

    def __init__(self) -> None:
        self._files: dict[str, FileDebounce] = {}
        self._names: Mapping[str, str] = {}
        self._folder = Path()
        self._stamps: Mapping[str, FileStamp] = {}
        self._looked_s = time.monotonic()
        self._woken = asyncio.Event()

    def follow(self, folder: Path, names: Mapping[str, str]) -> None:
        """Follow these files from now on: the name of the table of each axis, and the folder of all."""
        if folder == self._folder and names == self._names:
            return  # not woken: who follows after each reading would look and read without a rest
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
        """Axes whose file has changed or gone, and is not still yet."""
        return self._axes_in(FileStability.MOVING)

    @property
    def still(self) -> Mapping[str, FileStamp | None]:
        """The sight as which each file that was seen may be read, by name; None as long as it moves."""
        seen = {name: stamp for name, stamp in self._stamps.items() if name in self._files}
        return {
            name: None if self._state(name) is FileStability.MOVING else stamp for name, stamp in seen.items()
        }

    @property
    def silent_s(self) -> float:
        """How long the folder has not been seen."""
        return time.monotonic() - self._looked_s

    def wake(self) -> None:
        """Look again at once."""
        self._woken.set()

    async def scan(self) -> bool:
        """Look at all files; returns whether any is ready to be read."""
        folder, names = self._folder, list(self._files)
        stamps = await in_thread(partial(scan, folder, names))
        if folder != self._folder or set(names) != self._files.keys():
            return False  # others are followed by now
        self._stamps, self._looked_s = stamps, time.monotonic()
        return any(self._state(name) is FileStability.READY for name in names)

    def take(self, before: Mapping[str, FileStamp], waiting: Collection[str] = (), *, began_s: float) -> None:
        """Note that files were read; ``before`` are the sights that were seen just before.

        ``began_s``: when the reading began (``time.monotonic``). What a look saw before is older than these
        sights: beside it a file that stands still would seem to move.

        The files of axes in ``waiting`` could not be, and are to be read as soon as they stand still.
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
        """What was seen last, by name of the file."""
        return self._stamps

    async def rest(self) -> None:
        """Wait until it is time for the next look."""
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
    """Call ``wake`` whenever the system tells of a change in a folder; never returns.

    Where it cannot tell, as of a folder that is not there, the looks that a watch takes by itself have to do;
    why it cannot is said once.
    """
    from watchfiles import awatch

    reported = ""
    while True:
        try:
            await in_thread(
                folder.stat
            )  # awatch looks on the loop: a folder that does not answer would stop all
            async for _ in awatch(folder, watch_filter=None, debounce=STEP_MS, step=STEP_MS, recursive=False):
                reported = ""
                wake()
        except (OSError, RuntimeError) as error:
            if str(error) != reported:
                reported = str(error)
                complain(reported)
        await asyncio.sleep(EVERY_S)
