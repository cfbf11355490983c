"""Complete frames from the bytes of a serial line: requests and replies, as received passively.

Only order and length distinguish requests from replies. A frame counts as the reply to the request before it
if unit id, function code and length fit; else as a request. The CRC decides. A repeated request of function
codes 5, 6 and 22 looks like the reply to the first and counts as that.
"""

from typing import Final, NamedTuple

from gateway.modbus.crc import is_intact
from gateway.modbus.lengths import (
    MAX_ADU,
    MIN_ADU,
    NEEDS_MORE,
    NO_FRAME,
    UNTIL_SILENCE,
    asked_bytes,
    reply_length,
    request_length,
)
from gateway.modbus.pdu import BROADCAST_UNIT_ID, EXCEPTION_BIT

MARK: Final = 0xFF
"""A terminal puts this before a character with a parity or framing error (termios, PARMRK)."""


class Overheard(NamedTuple):
    """A frame."""

    unit_id: int
    pdu: bytes
    is_reply: bool
    request: bytes = b""
    """Of a reply: the PDU of its request, if that was received."""


class Unmarking:
    r"""Removes the error marks of characters from the data of a terminal with PARMRK.

    >>> unmarking = Unmarking()
    >>> unmarking.feed(bytes.fromhex("01 FF FF 03 FF 00 41 05")).hex(" "), unmarking.errors
    ('01 ff 03 41 05', 1)
    """

    def __init__(self) -> None:
        self._rest = b""
        self.errors = 0
        """Number of characters with an error so far."""

    def feed(self, data: bytes) -> bytes:
        """Return the received characters, good and bad."""
        data, self._rest = self._rest + data, b""
        found = bytearray()
        at = 0
        while at < len(data):
            if data[at] != MARK:
                found.append(data[at])
                at += 1
                continue
            size = 2 if data[at + 1 : at + 2] == bytes((MARK,)) else 3
            if at + size > len(data):
                self._rest = data[at:]
                break
            self.errors += size == 3
            found.append(data[at + size - 1])
            at += size
        return bytes(found)


class Overhearing:
    """Extracts frames from the bytes of both directions. Never raises.

    >>> line = Overhearing()
    >>> frames = line.feed(bytes.fromhex("01 03 02 00 00 01 85 B2" "01 03 02 00 07 F9 86"))
    >>> [(frame.pdu.hex(" "), frame.is_reply) for frame in frames]
    [('03 02 00 00 01', False), ('03 02 00 07', True)]
    """

    def __init__(self) -> None:
        self._buffer = b""
        self._asked: tuple[int, bytes] | None = None
        self.frames = 0
        self.good_bytes = 0
        self.bad_bytes = 0
        """Number of bytes that are not part of a frame."""

    def feed(self, data: bytes) -> list[Overheard]:
        """Return the frames that ``data`` completes."""
        self._buffer += data
        found = self._take(is_over=False)
        if len(self._buffer) > MAX_ADU:
            found += self._take(is_over=True)
            self._drop(max(0, len(self._buffer) - MAX_ADU))
        return found

    def silent(self) -> list[Overheard]:
        """Return the frames that silence has ended; the remaining bytes are damaged."""
        found = self._take(is_over=True)
        self._drop(len(self._buffer))
        return found

    def _take(self, *, is_over: bool) -> list[Overheard]:
        found: list[Overheard] = []
        start = 0
        while start < len(self._buffer):
            length, is_reply = self._at(start, is_over=is_over)
            if length > 0:
                self._drop(start)
                found.append(self._frame(length, is_reply=is_reply))
                start = 0
            elif length == NEEDS_MORE and not is_over:
                break
            else:
                start += 1
                if not is_over:
                    self._drop(1)
                    start = 0
        return found

    def _at(self, start: int, *, is_over: bool) -> tuple[int, bool]:
        """Return the length of the good frame at ``start``, or a constant, and whether it is a reply."""
        waits = False
        for length, is_reply in self._lengths(start):
            end = len(self._buffer) if length == UNTIL_SILENCE and is_over else start + length
            is_open = length in (NEEDS_MORE, UNTIL_SILENCE) and not is_over
            if is_open or (length != NO_FRAME and end > len(self._buffer)):
                waits = True
            elif end - start >= MIN_ADU and is_intact(self._buffer[start:end]):
                return end - start, is_reply
        return NEEDS_MORE if waits else NO_FRAME, False

    def _lengths(self, start: int) -> list[tuple[int, bool]]:
        """Return the possible lengths of the frame at ``start``: the expected reply, a request, any reply."""
        data = self._buffer
        if len(data) < start + 2:
            return [(NEEDS_MORE, False)]
        unit_id, function = data[start], data[start + 1]
        found = []
        if self._asked is not None and self._asked[0] == unit_id:
            asked = self._asked[1]
            is_its_kind = function & ~EXCEPTION_BIT == asked[0] & ~EXCEPTION_BIT
            if is_its_kind and self._fits(asked, start):
                found.append((reply_length(asked, data, start), True))
        found.append((request_length(data, start), False))
        if function & ~EXCEPTION_BIT:
            found.append((reply_length(bytes((function & ~EXCEPTION_BIT,)), data, start), True))
        return found

    def _fits(self, asked: bytes, start: int) -> bool:
        """Whether a reply to a read has the requested number of bytes, as far as it was received."""
        count = asked_bytes(asked)
        data = self._buffer
        if count is None or data[start + 1] >= EXCEPTION_BIT or len(data) < start + 3:
            return True
        return data[start + 2] == count

    def _frame(self, length: int, *, is_reply: bool) -> Overheard:
        unit_id, pdu = self._buffer[0], self._buffer[1 : length - 2]
        self._buffer = self._buffer[length:]
        self.frames += 1
        self.good_bytes += length
        request = b""
        if is_reply:
            asked, self._asked = self._asked, None
            if asked is not None and asked[0] == unit_id:
                request = asked[1]
        else:
            self._asked = None if unit_id == BROADCAST_UNIT_ID else (unit_id, pdu)
        return Overheard(unit_id, pdu, is_reply, request)

    def _drop(self, count: int) -> None:
        self._buffer = self._buffer[count:]
        self.bad_bytes += count
