"""The trace buffers of a running gateway, read through its socket, as entries of a recording."""

import heapq
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from gateway.files import create
from gateway.ipc.client import NoGatewayError, borrow
from gateway.ipc.messages import GetTapes, Tapes
from gateway.recording import traffic
from gateway.recording.trace_buffer import (
    ABANDONED,
    ANSWERED,
    PACED,
    REPLY,
    REQUEST,
    SENT,
    TEXT,
    NoTraceBufferError,
    Raw,
    RingReader,
)

Timed = tuple[int, traffic.Entry]
"""An entry with its time in ns since boot; an output has the time of its input."""


class NoCaptureError(Exception):
    """The gateway has no trace buffers, or none that can be read; with the remedy."""


def frame_entry(line: str, ports: Mapping[int, tuple[str, str, str]], raw: Raw) -> traffic.Entry:
    """Return the entry of a frame; ``ports`` are controller, peer and role of each port.

    Raises:
        KeyError: a request of a port that is not among them.
    """
    kind, t_ns, ids, pdu = raw
    port, transaction, unit = ids >> 24, ids >> 8 & 0xFFFF, ids & 0xFF
    if kind == REQUEST:
        controller, peer, role = ports[port]
        return traffic.Request(line, t_ns, port, controller, transaction, unit, pdu.hex(), peer, role)
    if kind == REPLY:
        return traffic.Reply(line, t_ns, unit, pdu.hex())
    if kind == SENT:
        return traffic.Sent(line, unit, pdu.hex())
    if kind == ANSWERED:
        return traffic.Answered(line, port, transaction, unit, pdu.hex())
    if kind == PACED:
        return traffic.Paced(line, int.from_bytes(pdu, "little"))
    return traffic.Abandoned(line) if kind == ABANDONED else traffic.Tick(line, t_ns)


class _Line:
    """The trace buffer of one line, read while it grows."""

    def __init__(self, name: str, reader: RingReader) -> None:
        self.name = name
        self.reader = reader
        self._ports: dict[int, tuple[str, str, str]] = {}

    def new(self) -> tuple[list[Timed], bool]:
        """Return the new entries, and whether earlier ones are lost."""
        raws, is_lost = self.reader.new()
        return list(self._entries(raws)), is_lost

    def newest(self, count: int) -> list[Timed]:
        """Return the newest entries."""
        return list(self._entries(self.reader.newest(count)))[-count:]

    def _entries(self, raws: Iterable[Raw]) -> Iterator[Timed]:
        for raw in raws:
            if raw.kind == TEXT:
                try:
                    entry = traffic.decode(raw.data)
                except traffic.WrongEntryError as error:
                    of_another = "command and gateway must be of the same release"
                    raise NoCaptureError(f"{error}; {of_another}") from None
                if isinstance(entry, traffic.Port):
                    self._ports[entry.port] = entry.controller, entry.peer, entry.role
                else:
                    yield raw.t, entry
            elif raw.kind != REQUEST or raw.ids >> 24 in self._ports:
                yield raw.t, frame_entry(self.name, self._ports, raw)
            # Otherwise the entry that names the sender is overwritten. Such a request comes before anything
            # that a replay could begin with.


class Capture:
    """The trace buffers of all lines, or of one."""

    def __init__(self, socket: Path, only: str | None = None) -> None:
        """Open them.

        Raises:
            NoGatewayError: no gateway, or one that does not know this request.
            NoCaptureError: it has none, none of that name, or trace buffers of another release.
        """
        reply, descriptors = borrow(socket, GetTapes())
        try:
            if not isinstance(reply, Tapes) or len(reply.lines) != len(descriptors):
                raise NoGatewayError(f"the gateway at {socket} did not answer with its trace buffers")
            if not reply.lines:
                raise NoCaptureError(
                    "set size_mb in [capture] and restart the gateway: it keeps no frames now"
                )
            if only is not None and only not in reply.lines:
                raise NoCaptureError(f"there is no line {only}; there are {', '.join(reply.lines)}")
            chosen = zip(reply.lines, descriptors, strict=True)
            self._lines = [_Line(name, RingReader(fd)) for name, fd in chosen if only in (None, name)]
        except NoTraceBufferError as error:
            raise NoCaptureError(str(error)) from None
        finally:
            for descriptor in descriptors:
                os.close(descriptor)

    def new(self) -> tuple[list[Timed], bool]:
        """Return the entries since the last call, in order, and whether earlier ones are lost."""
        read = [line.new() for line in self._lines]
        merged = heapq.merge(*(entries for entries, _ in read), key=lambda each: each[0])
        return list(merged), any(is_lost for _, is_lost in read)

    def newest(self, count: int) -> list[Timed]:
        """Return the newest entries of the first line, oldest first."""
        return self._lines[0].newest(count)

    def wall_ns(self, t_ns: int) -> int:
        """Return the time of day of an entry, in ns since 1970."""
        return self._lines[0].reader.wall_ns(t_ns)

    def close(self) -> None:
        """Release the memory."""
        for line in self._lines:
            line.reader.close()


def write_recording(path: Path, header: traffic.Header, entries: Iterable[traffic.Entry]) -> int:
    """Write a new file for ``replay``, readable by this user only; return the number of its entries.

    Raises:
        OSError: it exists, or cannot be written whole; then there is none.
    """
    descriptor = create(path)
    number = 0
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(traffic.encode(header))
            for entry in entries:
                file.write(traffic.encode(entry))
                number += 1
            file.write(traffic.encode(traffic.End(number)))
    except OSError:
        path.unlink()
        raise
    return number
