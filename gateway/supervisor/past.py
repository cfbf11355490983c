"""Data for the next supervisor: a day of each axis, and the acknowledged alarms.

The day is lines of text in files under ``history`` in the state folder, appended every ten seconds. Age and
size are bounded: whole files are removed, the oldest first. The gateway runs without these files. If they
cannot be written, the status reports it, the supervisor retries, and everything else continues.
"""

import asyncio
import contextlib
import errno
import math
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final

from gateway.catalogue.publishing_events import ACKNOWLEDGEMENTS_LOST
from gateway.files import FileMissingError, FileRefusedError, read_regular_file
from gateway.state.folder import FolderProblem, problem_of, write_whole
from gateway.supervisor.event_log import LogEvent
from gateway.supervisor.in_thread import in_thread
from gateway.supervisor.recent_history import PositionSample, RecentHistory

FOLDER_NAME: Final = "history"
ACKNOWLEDGED_NAME: Final = "acknowledged.json"
DAY_S: Final = 86_400
EVERY_S: Final = 10.0
"""Between two positions of an axis that are kept for a day."""
SOON_S: Final = 1.0
"""Between two checks whether something is due."""
FILE_S: Final = 3600.0
"""Longest time in one file, so that data older than a day is removed in small parts."""
FILE_BYTES: Final = 1_000_000
MOST_BYTES: Final = 16_000_000
"""Of all files. 32 axes need 14 MB for a day; more axes get less than a day."""
FREE_BYTES: Final = 1_000_000
"""Space left free on the disk, for tables and for the retained data of the axes."""
HEAD: Final = "time,axis,nominal,correction,compensation"
SUFFIX: Final = ".csv"


@dataclass(frozen=True, slots=True)
class Noted:
    """The position of an axis at a time of day; lengths in its unit."""

    wall_s: float
    nominal: float | None
    correction: float | None
    compensation: str


class Past:
    """Keeps the history in a state folder; one for each supervisor."""

    def __init__(self, state: Path, recent: RecentHistory, log: LogEvent) -> None:
        self._state = state
        self._recent = recent
        self._log = log
        self._folder = state / FOLDER_NAME
        self._file: Path | None = None
        """The file that is being written; None: nothing was written yet."""
        self._kept_version = 0
        self._kept_s = -math.inf
        self._woken = asyncio.Event()
        self.problem: FolderProblem | None = None
        """Why the history cannot be kept at present."""

    async def recall(self) -> None:
        """Restore the alarms that were acknowledged before a restart; call it first."""
        path = self._state / ACKNOWLEDGED_NAME
        try:
            content = await in_thread(partial(read_regular_file, path, FILE_BYTES, "acknowledged alarms"))
            self._recent.acknowledged.restore(content, time.monotonic())
        except FileMissingError:
            return  # usually there is none
        except FileRefusedError as error:  # it may become readable again: the content stays
            self._log(ACKNOWLEDGEMENTS_LOST, file=str(path), detail=str(error))
        except ValueError as error:
            self._log(ACKNOWLEDGEMENTS_LOST, file=str(path), detail=str(error))
            self._kept_version = -1  # it is written anew

    def wake(self) -> None:
        """Write acknowledgements immediately, not only when positions are due."""
        self._woken.set()

    async def run(self) -> None:
        """Keep history and acknowledgements until cancelled."""
        while True:
            await self.write_new(time.monotonic(), time.time())
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(SOON_S):
                    await self._woken.wait()
            self._woken.clear()

    async def write_new(self, now_s: float, wall_s: float) -> None:
        """Write new acknowledgements, and the positions if they are due.

        ``now_s`` is monotonic, ``wall_s`` is the time of day.
        """
        acknowledged = self._recent.acknowledged
        work: list[partial[None]] = []
        version = acknowledged.version
        if version != self._kept_version:
            work.append(partial(write_whole, self._state / ACKNOWLEDGED_NAME, acknowledged.encoded()))
        text = "".join(self._lines(now_s, wall_s)) if now_s - self._kept_s >= EVERY_S else ""
        if text:
            self._kept_s = now_s
            work.append(partial(self._append, text, wall_s))
        try:
            for each in work:
                await in_thread(each)
        except OSError as error:
            self.problem = problem_of(error, self._folder)
        else:
            self._kept_version = version
            self.problem = None if work else self.problem

    def _lines(self, now_s: float, wall_s: float) -> Iterator[str]:
        for axis, seen in self._recent.newest().items():
            if now_s - seen.at_s < EVERY_S:  # otherwise the relay is silent, and there is a gap
                noted = _noted(seen, now_s, wall_s)
                yield f"{time_text(noted.wall_s)},{axis},{values_text(noted)}\n"

    def _append(self, text: str, wall_s: float) -> None:
        """Append lines to the newest file; blocks. Raises OSError: then none of them is written."""
        with contextlib.suppress(FileExistsError):
            self._folder.mkdir(mode=0o700)  # never the state folder itself: it must not reappear
        files = self._make_room(wall_s, len(HEAD) + 1 + len(text))
        disk = os.statvfs(self._folder)
        if disk.f_bavail * disk.f_frsize < FREE_BYTES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._folder))
        file = self._file if self._file in files else files[-1] if files else None
        begun_s = None if file is None else _begun_s(file)
        if (
            file is None
            or begun_s is None
            or not 0 <= wall_s - begun_s < FILE_S
            or file.stat().st_size + len(text) > FILE_BYTES
        ):
            file = self._folder / f"{datetime.fromtimestamp(wall_s, UTC):%Y%m%dT%H%M%SZ}{SUFFIX}"
            text = f"{HEAD}\n{text}"
        elif file != self._file:
            text = f"\n{text}"  # a killed process may have left half a line
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        descriptor = os.open(file, flags, 0o600)
        try:
            before = os.fstat(descriptor).st_size
            content = text.encode("ascii")
            if os.write(descriptor, content) < len(content):
                os.ftruncate(descriptor, before)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(file))
        finally:
            os.close(descriptor)
        self._file = file

    def _make_room(self, wall_s: float, length: int) -> list[Path]:
        """Remove what is too old or too much; return the remaining files, oldest first."""
        files = _files(self._folder)
        total = sum(file.stat().st_size for file in files) + length
        while files:
            begun_s = _begun_s(files[0])
            if total <= MOST_BYTES and begun_s is not None and wall_s - begun_s <= DAY_S + FILE_S:
                break
            total -= files[0].stat().st_size
            files.pop(0).unlink()
        return files

    async def of(self, axis: str, span_s: float, now_s: float, wall_s: float) -> Sequence[Noted] | None:
        """Return the positions of an axis in a span until now, oldest first; None: there is no such axis.

        The newest ten minutes, as far as this process has run, have one position a second; earlier, one every
        ten seconds.
        """
        kept = self._recent.history(axis)
        if kept is None:
            return None
        newest = [_noted(seen, now_s, wall_s) for seen in kept]
        newest = [noted for noted in newest if noted.wall_s >= wall_s - span_s]
        until_s = newest[0].wall_s if newest else wall_s
        before = await in_thread(partial(read_positions, self._folder, axis, wall_s - span_s, until_s))
        return [*before, *newest]


def read_positions(folder: Path, axis: str, since_s: float, until_s: float) -> list[Noted]:
    """Return the positions of an axis between two times from a folder's files, oldest first; blocks."""
    since, until = time_text(since_s), time_text(until_s)
    found: list[Noted] = []
    for file in _files(folder):
        try:
            if file.stat().st_mtime < since_s:
                continue
            content = read_regular_file(file, 2 * FILE_BYTES, "a day of the axes")
        except (FileRefusedError, OSError):
            continue  # just removed, or not ours
        for line in content.decode("ascii", "replace").splitlines():
            parts = line.split(",")
            if len(parts) == HEAD.count(",") + 1 and parts[1] == axis and since <= parts[0] < until:
                with contextlib.suppress(ValueError):
                    wall_s = datetime.fromisoformat(parts[0]).timestamp()
                    found.append(Noted(wall_s, _number(parts[2]), _number(parts[3]), parts[4]))
    return sorted(found, key=lambda noted: noted.wall_s)


def time_text(wall_s: float) -> str:
    """Return a time of day in UTC; the texts sort in the order of time.

    >>> time_text(0.25)
    '1970-01-01T00:00:00Z'
    """
    return f"{datetime.fromtimestamp(wall_s, UTC):%Y-%m-%dT%H:%M:%SZ}"


def values_text(noted: Noted) -> str:
    """Return the values of a position as in a line of the file; unknown ones are empty.

    >>> values_text(Noted(0.0, -120.0, 0.0221, "active")), values_text(Noted(0.0, None, None, "off"))
    ('-120.000000,0.0221000,active', ',,off')
    """
    nominal = "" if noted.nominal is None else f"{noted.nominal:.6f}"
    correction = "" if noted.correction is None else f"{noted.correction:.7f}"
    return f"{nominal},{correction},{noted.compensation}"


def _number(text: str) -> float | None:
    return float(text) if text else None


def _noted(seen: PositionSample, now_s: float, wall_s: float) -> Noted:
    return Noted(wall_s - (now_s - seen.at_s), seen.nominal, seen.correction, seen.compensation)


def _files(folder: Path) -> list[Path]:
    return sorted(file for file in folder.glob(f"*{SUFFIX}") if _begun_s(file) is not None)


def _begun_s(file: Path) -> float | None:
    """Return when a file was begun, from its name; None: the file is not ours."""
    with contextlib.suppress(ValueError):
        return datetime.strptime(file.stem, "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC).timestamp()
    return None
