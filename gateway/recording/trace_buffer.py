"""The last minutes of a line, in memory that other processes can read: for ``pitch-gateway capture``.

A fixed piece of memory without a name (a memfd) has ``SEGMENTS`` parts, of which the oldest is always
overwritten. An entry costs its bytes and nothing else: no objects stay. Entries are gathered and written many
at a time (:meth:`TraceBuffer.show`). A reader maps the same memory, only reads, and costs the writer nothing,
however often it reads. If a segment is overwritten while it is read, its number changes, and the reader
leaves it out.
"""

import fcntl
import mmap
import os
from collections.abc import Iterator
from struct import Struct
from typing import Final, NamedTuple

from librt.strings import BytesWriter, write_i32_le, write_i64_le

MAGIC: Final = b"pgtape2\n"
BEFORE: Final = b"pgtape1\n"
"""Magic of release 1.0.0, whose command entries differ; they are still read (``recording.traffic``)."""
PAGE: Final = 4096
SEGMENTS: Final = 8
_WHOLE: Final = Struct("<8sQqq")
"""Magic, bytes of a segment, and one moment on both clocks: ns since boot, ns since 1970."""
_SEGMENT: Final = Struct("<QQ")
"""Number of the segment, from 1; 0: it is empty, or is being begun. Bytes in it."""
_FILL: Final = Struct("<Q")
_FILL_OFFSET: Final = 8
_ENTRY: Final = Struct("<IBQq")
"""Bytes of the entry, its kind, its ids (:func:`ids_of`), ns since boot; then its bytes."""
HEAD: Final = _ENTRY.size

REQUEST: Final = 1
REPLY: Final = 2
SENT: Final = 3
ANSWERED: Final = 4
ABANDONED: Final = 5
TICK: Final = 6
TEXT: Final = 7
"""An entry in the format of a recording (``recording.traffic``)."""
PACED: Final = 8
"""Its bytes are the time, little-endian."""
_KINDS: Final = frozenset((REQUEST, REPLY, SENT, ANSWERED, ABANDONED, TICK, TEXT, PACED))

MOST_GATHERED: Final = 1 << 14
"""Most bytes that are gathered before they are shown."""


class Raw(NamedTuple):
    """An entry in the format of the trace buffer."""

    kind: int
    t: int
    ids: int
    data: bytes


def ids_of(port: int, transaction: int, unit: int) -> int:
    """Return the port number, transaction id and unit id of a request in one number.

    >>> hex(ids_of(3, 0x0102, 0xFA))
    '0x30102fa'
    """
    return port << 24 | transaction << 8 | unit


class NoTraceBufferError(Exception):
    """Memory that is no trace buffer of this release."""


class TraceBuffer:
    """The writer's end. It never takes more than ``size`` bytes."""

    def __init__(self, name: str, size: int, now_ns: int, wall_ns: int) -> None:
        self._segment_size = max(size // SEGMENTS // PAGE, 1) * PAGE
        whole = PAGE + SEGMENTS * self._segment_size
        writing = os.memfd_create(f"tape-{name}", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        try:
            os.ftruncate(writing, whole)
            fcntl.fcntl(writing, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW)
            self._map = mmap.mmap(writing, whole)
            self.descriptor = os.open(f"/proc/self/fd/{writing}", os.O_RDONLY | os.O_CLOEXEC)
            """The descriptor for readers."""
        finally:
            os.close(writing)
        _WHOLE.pack_into(self._map, 0, MAGIC, self._segment_size, now_ns, wall_ns)
        self.number = 0
        """Number of the current segment, from 1 on."""
        self._gathered = BytesWriter()
        """Entries that are not shown yet; they belong before ``_at``."""
        self._begin = self._at = self._end = 0
        self._begin_segment()

    def put(self, kind: int, t_ns: int, ids: int, data: bytes) -> None:
        """Take an entry; the next :meth:`show` shows it. An entry too long for a segment is left out."""
        size = HEAD + len(data)
        if self._at + size > self._end:
            if size > self._segment_size - _SEGMENT.size:
                return
            self._begin_segment()
        gathered = self._gathered
        write_i32_le(gathered, size)  # an entry in the format of ``_ENTRY``
        gathered.append(kind)
        write_i64_le(gathered, ids)
        write_i64_le(gathered, t_ns)
        gathered.write(data)
        self._at += size
        if len(gathered) > MOST_GATHERED:
            self.show()

    def show(self) -> None:
        """Show all entries to readers."""
        gathered = self._gathered
        if not len(gathered):
            return
        self._map[self._at - len(gathered) : self._at] = gathered.getvalue()
        gathered.truncate(0)
        _FILL.pack_into(self._map, self._begin + _FILL_OFFSET, self._at - self._begin - _SEGMENT.size)

    def close(self) -> None:
        """Release it; readers still see its content."""
        self.show()
        self._map.close()
        os.close(self.descriptor)

    def _begin_segment(self) -> None:
        """Begin the next segment, in place of the oldest."""
        self.show()
        self._begin = PAGE + self.number % SEGMENTS * self._segment_size
        _SEGMENT.pack_into(self._map, self._begin, 0, 0)
        self.number += 1
        _SEGMENT.pack_into(self._map, self._begin, self.number, 0)
        self._at = self._begin + _SEGMENT.size
        self._end = self._begin + self._segment_size


class RingReader:
    """The reader's end, over a descriptor that the caller owns."""

    def __init__(self, descriptor: int) -> None:
        """Map a trace buffer.

        Raises:
            NoTraceBufferError: it is none, or of another release.
        """
        size = os.fstat(descriptor).st_size
        if size < PAGE + SEGMENTS * PAGE:
            raise NoTraceBufferError(f"memory of {size} bytes is not a trace buffer")
        self._map = mmap.mmap(descriptor, size, flags=mmap.MAP_SHARED, prot=mmap.PROT_READ)
        magic, self._segment_size, self._ns, self._wall_ns = _WHOLE.unpack_from(self._map)
        if magic not in (MAGIC, BEFORE) or size != PAGE + SEGMENTS * self._segment_size:
            self._map.close()
            raise NoTraceBufferError(
                "it is not a trace buffer of this release: command and gateway must be of the same release"
            )
        self._number = self._read = 0
        """The segment that was read last, and how far."""

    def wall_ns(self, t_ns: int) -> int:
        """Return the time of day of an entry, in ns since 1970, by the clock when the trace buffer began."""
        return int(self._wall_ns + t_ns - self._ns)

    def new(self) -> tuple[list[Raw], bool]:
        """Return the entries since the last call, and whether earlier ones are lost."""
        found: list[Raw] = []
        segments = sorted(self._segments())
        is_lost = bool(self._number) and all(number > self._number for number, _ in segments)
        for number, begin in segments:
            if number < self._number:
                continue
            skip = self._read if number == self._number else 0
            data = self._copy(number, begin)
            if data is None:
                is_lost = True
                continue
            found += _entries(data[skip:])
            self._number, self._read = number, len(data)
        return found, is_lost

    def newest(self, count: int) -> list[Raw]:
        """Return the newest ``count`` entries and the texts before them, of two segments at most."""
        found: list[Raw] = []
        for number, begin in sorted(self._segments())[-2:]:
            found += _entries(self._copy(number, begin) or b"")
        texts = [raw for raw in found[:-count] if raw.kind == TEXT]
        return texts + found[-count:]

    def close(self) -> None:
        """Release the memory."""
        self._map.close()

    def _segments(self) -> Iterator[tuple[int, int]]:
        for index in range(SEGMENTS):
            begin = PAGE + index * self._segment_size
            number, _ = _SEGMENT.unpack_from(self._map, begin)
            if number:
                yield number, begin

    def _copy(self, number: int, begin: int) -> bytes | None:
        """Return the content of a segment; None if it was overwritten meanwhile."""
        _, fill = _SEGMENT.unpack_from(self._map, begin)
        start = begin + _SEGMENT.size
        data = self._map[start : start + min(fill, self._segment_size - _SEGMENT.size)]
        after, _ = _SEGMENT.unpack_from(self._map, begin)
        return data if after == number else None


def _entries(data: bytes) -> Iterator[Raw]:
    at = 0
    while at + HEAD <= len(data):
        size, kind, ids, t_ns = _ENTRY.unpack_from(data, at)
        if not HEAD <= size <= len(data) - at or kind not in _KINDS:
            return
        yield Raw(kind, t_ns, ids, data[at + HEAD : at + size])
        at += size
