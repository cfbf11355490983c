"""The record of an axis in its own file, mapped into memory: writing it waits for no disk.

The kernel keeps the content if the process dies, at any instruction. A machine that loses power may lose the
last half minute; the record then does not match the position of the drive. A file that cannot be used does
not prevent the start: the relay reports it, the axis starts without a record, and the relay tries it again
later. If another program truncates the file while it is mapped (a restored backup does), the next store would
end the process with SIGBUS. So each store checks the length of the file first.
"""

import mmap
import os
import time
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from gateway import system
from gateway.backoff import Backoff
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.record import FindTable, Record, digest_of_axis
from gateway.exchange.axis.record_layout import RECORD_SIZE, RecordSlots, Remembered, header, why_not_readable
from gateway.exchange.plan import CompensationMode

SUFFIX: Final = ".record"
FIRST_WAIT_S: Final = 5.0
LONGEST_WAIT_S: Final = 300.0
"""A full disk may make an attempt slow, and frames wait meanwhile."""
Report = Callable[[str], None]


def record_path(state: Path, axis: str) -> Path:
    """Return the file that holds the record of an axis."""
    return state / f"axis-{axis}{SUFFIX}"


def why_not_kept(axis: Axis, saved: Remembered | None = None) -> str:
    """Return why the axis has no record, "" if it has one.

    ``saved``: that of the previous run. A stream without a table needs it until its correction has faded out.
    """
    if axis.plan.compensation is CompensationMode.SHADOW:
        return "the axis is in shadow mode"
    fades = saved is not None and saved.was_corrected and axis.compensation.is_stream
    if axis.plan.table is None and not fades:
        return "the axis has no table"
    return "" if axis.plan.actual else "no register of the actual position is mapped"


class AxisRecord:
    """The record file of one axis, from opening to closing."""

    def __init__(self, axis: Axis, path: Path) -> None:
        self.path = path
        self._axis = axis
        self._report: Report = _ignore
        self._find_table: FindTable | None = None
        self._fd = -1
        self._map: mmap.mmap | None = None
        self._slots: RecordSlots | None = None
        self.problem = ""
        """Why no record is kept, although there should be one; "" if it is kept."""
        self._backoff = Backoff(FIRST_WAIT_S, LONGEST_WAIT_S)
        self._due_s = 0.0
        """When it is tried again; monotonic."""

    def open(self, report: Report, find_table: FindTable | None = None, *, is_used: bool = True) -> None:
        """Map the file, created if it is missing, and let the axis keep its record in it.

        Args:
            report: gets why the record of the previous run is not used, or why the axis has none.
            find_table: finds a table by its digest; without it only the configured table is found.
            is_used: the record of the previous run may be used.
        """
        self._report, self._find_table = report, find_table
        if why := self._open(is_used=is_used, is_start=True):
            self._lose(why)

    def try_again(self, now_s: float) -> None:
        """Keep a record from now on, if that was not possible so far; to be called every few seconds."""
        if not self.problem or now_s < self._due_s:
            return
        if self._slots is None:
            why = self._open(is_used=False, is_start=False)
        elif not (why := self._make_whole()):
            self._keep()
        if why:
            self._lose(why)
        elif self._axis.recall.record is not None:
            self._report(f"{self.path} can be written again: it holds from now on")

    def _keep(self) -> None:
        """Keep a record from now on, in the file as it is."""
        assert self._slots is not None
        self.problem = ""
        self._backoff.reset()
        if not why_not_kept(self._axis):
            self._axis.recall.attach(Record(self._slots, None, self._find_table))

    def _lose(self, why: str) -> None:
        """Report once that no record is kept."""
        if not self.problem:
            self._report(f"{why}: no record is kept, and a restart begins without one")
        self.problem = why
        self._due_s = time.monotonic() + self._backoff.next_s()

    def _open(self, *, is_used: bool, is_start: bool) -> str:
        """Do what :meth:`open` says; return why no record can be kept, "" if it can.

        ``is_start``: the gateway starts, so that the content of the file counts.
        """
        axis, report = self._axis, self._report if is_start else _ignore
        why_none = why_not_kept(axis)
        if why_none and not self.path.exists():
            self.problem = ""
            return ""
        try:
            self._fd, mapped, wrong = _mapped(self.path, axis.plan.name)
        except OSError as error:
            if is_start:
                axis.recall.start_without()
            return f"{self.path}: {error.strerror or error}"
        if wrong:
            report(f"{self.path}: {wrong}; it is made anew, and the axis starts without its record")
        self.problem = ""
        self._backoff.reset()
        self._map = mapped
        digest = digest_of_axis(axis.plan)
        slots = self._slots = RecordSlots(memoryview(mapped), digest, system.boot_id(), self._may_store)
        saved, reason = slots.read(), ""
        why_none = why_not_kept(axis, saved)
        if saved is None and slots.is_damaged and not wrong:
            reason = "both of its copies are damaged"
        elif saved is None and slots.was_emptied and not why_none:
            reason = "the run before did not know any more where the axis was"
        elif saved is not None and saved.scale_digest != digest:
            reason = "what a count means, or a register of the axis, was changed in the configuration"
        elif saved is not None and why_none:
            reason = why_none
        elif saved is not None and not is_used:
            reason = "this run is recorded, and a recording begins with nothing"
        if reason:
            report(f"{self.path}: {reason}; the axis starts without its record")
            saved = None
        record = Record(slots, saved, self._find_table)  # empties the record if the saved one is not used
        if is_start and (wrong or reason):
            axis.recall.start_without()
        if not why_none:
            axis.recall.attach(record)
        return ""

    def content(self) -> bytes:
        """Return the current record, compressed; empty if the axis has none."""
        kept = self._map is not None and self._axis.recall.record is not None
        return zlib.compress(bytes(self._map), 1) if kept and self._map is not None else b""

    def begin(self) -> None:
        """Start a record for an axis that had none; old content is not used."""
        if self._slots is None:
            if why := self._open(is_used=False, is_start=False):
                self._lose(why)
        else:
            self._axis.recall.attach(Record(self._slots, None, self._find_table))

    def close(self) -> None:
        """Detach the record from the axis as it is, and close the file."""
        self._axis.recall.attach(None)
        if self._slots is not None and self._map is not None:
            self._slots.release()
            with suppress(OSError):
                self._map.flush()
            self._map.close()
            os.close(self._fd)
        self._slots = self._map = None

    def _may_store(self) -> bool:
        """Whether the file is as long as its mapping; a truncated file is extended again."""
        if os.lseek(self._fd, 0, os.SEEK_END) >= RECORD_SIZE:
            return True
        if self.problem:
            return False
        if why := self._make_whole():
            self._lose(why)
            return False
        self._report(f"{self.path} was cut while it was in use; it is made anew, and holds from now on")
        return True

    def _make_whole(self) -> str:
        """Extend the truncated file again; return why that is impossible, "" if it is not."""
        assert self._map is not None
        assert self._slots is not None
        try:
            os.posix_fallocate(self._fd, 0, RECORD_SIZE)
        except OSError as error:
            return f"{self.path} was cut, and {error.strerror or error}"
        name = header(self._axis.plan.name)
        self._map[: len(name)] = name
        self._slots.begin_anew()
        return ""


def _ignore(why: str) -> None:
    """Report nothing, as long as the file was not opened."""


def _mapped(path: Path, name: str) -> tuple[int, mmap.mmap, str]:
    """Map a record; return its file, its mapping, and what was wrong with the old content, "" if nothing.

    All blocks are allocated before the file is mapped: so a full disk is an error here, and never during a
    store.

    Raises:
        OSError: the file cannot be opened, allocated or mapped.
    """
    was_there = path.exists()
    flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    fd = os.open(path, flags, 0o600)
    try:
        size = os.fstat(fd).st_size
        wrong = why_not_readable(os.pread(fd, RECORD_SIZE, 0), name, size) if size else ""
        if was_there and not size:
            wrong = "it is empty, because the run before could not write it"
        if wrong or not size:
            os.ftruncate(fd, 0)
        os.posix_fallocate(fd, 0, RECORD_SIZE)
        mapped = mmap.mmap(fd, RECORD_SIZE)
    except BaseException:  # after any error the file may not stay open
        os.close(fd)
        raise
    mapped[: len(header(name))] = header(name)
    return fd, mapped, wrong
