"""RTU replies from a byte stream: the side on which the gateway is the master.

One reply is expected at a time. It has the unit id and function code of its request, with bit 7 set for an
exception. Some drives refuse every read with the function byte 0x81. For a drive with mapped registers it
counts only if its map declares it: it may be late and refuse another request. A reply ends where its own
bytes say, with the request as the context, and its CRC decides. It never ends at the first length whose CRC
happens to be right: about one reply in two hundred has such a length too early.

Devices that take odd frames (see ``rtu_requests``) answer with such frames too. While such a reply is
expected, the decoder does not search inside bytes that begin like it before the line is silent.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from gateway.modbus.crc import append_crc, is_intact
from gateway.modbus.lengths import (
    MAX_ADU,
    MIN_ADU,
    NEEDS_MORE,
    NO_FRAME,
    asked_bytes,
    reply_length,
)
from gateway.modbus.pdu import EXCEPTION_BIT, FunctionCode
from gateway.modbus.rtu_line import FAST_SILENCE_NS, Frame, RtuDecoder
from gateway.modbus.rtu_requests import NO_UNITS

REFUSED_READ: Final = 0x81
"""The function byte with which some drives refuse every read."""
READS: Final = frozenset(
    {
        FunctionCode.READ_COILS,
        FunctionCode.READ_DISCRETE_INPUTS,
        FunctionCode.READ_HOLDING_REGISTERS,
        FunctionCode.READ_INPUT_REGISTERS,
    }
)
TELLING: Final = frozenset({FunctionCode.READ_HOLDING_REGISTERS, FunctionCode.READ_INPUT_REGISTERS})
"""Requests whose own bytes cannot be their reply; see ``RtuReplyDecoder.returned``."""
TELLING_PDU: Final = 5
TELLING_ADU: Final = 8
"""With unit id and CRC."""
THREE_BYTES: Final = TELLING_ADU - 5
"""The byte count of a reply of that length."""
RETURNED_OFTEN: Final = 3
"""This many echoes in a row are no chance: one may be another master with the same request."""
NOBODY: Final[Mapping[int, int]] = MappingProxyType({})


class RtuReplyDecoder(RtuDecoder):
    r"""Bytes from the drives in, at most one reply for each request out. Never raises.

    With ``echo`` the adapter receives what it sends: the request comes back first, and is removed.
    ``refused_reads``: the function byte with which the drive of a unit id refuses reads, 0 for its own code
    with bit 7. For a unit id that is not in it the byte is unknown, and 0x81 counts. ``odd_units``: unit ids
    of devices that answer with odd frames.

    >>> decoder = RtuReplyDecoder()
    >>> decoder.expect(1, bytes.fromhex("03 02 00 00 02"))
    >>> decoder.feed(bytes.fromhex("01 03 04 00 B1 1F 40 A3 D4"), now_ns=0)
    [(1, b'\x03\x04\x00\xb1\x1f@')]
    """

    __slots__ = (
        "_echo",
        "_good_reply",
        "_has_echo",
        "_has_returned",
        "_heard",
        "_is_answered",
        "_lone_echo",
        "_odd_units",
        "_refused_reads",
        "_request",
        "_stray",
        "_unit_id",
        "late_unit_id",
        "returned",
    )

    def __init__(
        self,
        silence_ns: int = FAST_SILENCE_NS,
        give_up_ns: int | None = None,
        *,
        echo: bool = False,
        refused_reads: Mapping[int, int] = NOBODY,
        odd_units: frozenset[int] = NO_UNITS,
    ) -> None:
        super().__init__(silence_ns, give_up_ns)
        self._odd_units = odd_units
        self._refused_reads = refused_reads
        self._has_echo = echo
        self._has_returned = False
        """The present request has come back."""
        self._echo = b""
        self._lone_echo = b""
        self._heard = b""
        self._unit_id = 0
        self._request = b""
        self._stray = b""
        self._is_answered = False
        self._good_reply = b""
        """The newest whole reply: the replies to all writes of one position are equal, and need no new CRC
        check."""
        self.late_unit_id = -1
        """Unit id of the newest whole frame that matched no request; less than 0: none came."""
        self.returned = 0
        """Without ``echo``: reads of registers in a row that came back, byte for byte, before any reply.

        Writes show nothing: an acknowledgement repeats its request (FC05, 06, 08, 22), or does so with some
        drives (FC15, 16). Nor do reads of coils: the reply to a read of 17 to 24 of them may be equal to its
        request. A reply to a read of registers has as many data bytes as its third byte says. A request has
        the high byte of its address there, so it is as long as such a reply if that byte is 3. Registers
        never have 3 bytes, but even then the request does not count. A returned request is removed: with a
        silent drive it would be the only thing received, and count as the reply."""

    @property
    def is_expecting(self) -> bool:
        """Whether a reply is expected."""
        return bool(self._request)

    @property
    def stray_bytes(self) -> int:
        """Bytes so far that came while nothing was expected: compare it before and after ``feed``."""
        return self.counters.stray_bytes

    def expect(self, unit_id: int, request_pdu: bytes) -> None:
        """Expect the reply to this request, and nothing else. Call it when the request is sent."""
        if len(self._buffer):
            self.cancel()
        self._unit_id = unit_id
        self._request = request_pdu
        self._stray = b""
        self._lone_echo = b""
        if self._has_echo:
            self._echo = append_crc(bytes((unit_id,)) + request_pdu)

    def expect_unechoed(self, unit_id: int, request_pdu: bytes) -> None:
        """The same for a request whose echo, if any, the caller removes."""
        self.expect(unit_id, request_pdu)
        self._echo = b""

    @property
    def is_at_reply(self) -> bool:
        """Whether the next byte is the first one of the expected reply."""
        return bool(self._request) and not self._buffer and not self._echo

    def expect_echo(self, unit_id: int, request_pdu: bytes) -> None:
        """Expect only the echo of a request without a reply, if there is an echo."""
        if self._has_echo:
            self._lone_echo = append_crc(bytes((unit_id,)) + request_pdu)
            self._heard = b""

    def cancel(self) -> None:
        """Expect nothing any more: all further bytes are stray."""
        self._drop(len(self._buffer))
        self._expect_nothing()
        self._is_answered = False

    def reset(self) -> None:
        """Forget the waiting bytes and the expected reply: the line is a new one."""
        super().reset()
        self.returned = 0
        self._expect_nothing()
        self._is_answered = False

    def one(self, data: bytes) -> bytes:
        """Return the PDU of ``data`` if that is exactly the expected reply.

        Otherwise return b"" and take nothing: :meth:`feed` takes it.
        """
        size = len(data)
        if len(self._buffer) or len(self._echo) or not self._is_ours(data):
            return b""
        if reply_length(self._request, data) != size or not self._fits(data):
            return b""
        if data != self._good_reply and not is_intact(data):
            return b""
        if self.returned:
            self._end_row()
        self._good_reply = data
        self._request = b""
        self._is_answered = True
        return data[1 : size - 2]

    def feed(self, data: bytes, now_ns: int) -> list[Frame]:
        """Return the reply, if ``data`` completes it."""
        pdu = self.one(data)
        return [(data[0], pdu)] if len(pdu) else self._append(data, now_ns)

    def _is_ours(self, data: bytes, start: int = 0) -> bool:
        """Whether unit id and function byte at ``start`` are those of the expected reply."""
        if len(data) < start + 2 or data[start] != self._unit_id or not len(self._request):
            return False
        function = data[start + 1]
        return function == self._request[0] or (function >= EXCEPTION_BIT and self._is_refusal(function))

    def _is_refusal(self, function: int) -> bool:
        """Whether a function byte is that of an exception to the expected reply."""
        asked = self._request[0]
        if function == asked | EXCEPTION_BIT:
            return True
        return asked in READS and function == self._refused_reads.get(self._unit_id, REFUSED_READ)

    def _fits(self, data: bytes, start: int = 0) -> bool:
        """Whether a reply to a read has as many bytes as requested.

        A reply has no number on a serial line: only this distinguishes a late or repeated reply. One that
        does not fit is passed on (W1) if no other comes.
        """
        asked = asked_bytes(self._request)
        return asked is None or data[start + 1] >= EXCEPTION_BIT or data[start + 2] == asked

    def _append(self, data: bytes, now_ns: int) -> list[Frame]:
        if not self._request:
            self._count_stray(self._without_lone_echo(data))
            return []
        had_bytes = len(self._buffer)
        self._buffer += data
        if had_bytes < TELLING_ADU <= len(self._buffer) and not self._has_echo:
            self._take_return()
        frames = self._take_reply() if self._pass_echo() else []
        most = MAX_ADU + len(self._echo)
        if len(self._buffer) > most:
            self.counters.oversized += 1
            self._drop(len(self._buffer) - most)
        self._await_silence(now_ns)
        return frames

    def _tells(self) -> bool:
        """Whether the bytes of the request cannot be its reply."""
        request = self._request
        return len(request) == TELLING_PDU and request[0] in TELLING and request[1] != THREE_BYTES

    def _take_return(self) -> None:
        """Remove the request if it has come back first and cannot be the reply."""
        sent = append_crc(bytes((self._unit_id,)) + self._request)
        if self._tells() and self._buffer[:TELLING_ADU] == sent:
            self.returned += 1
            self._has_returned = True
            self.counters.echoes += 1
            self._buffer = self._buffer[TELLING_ADU:]

    def _end_row(self) -> None:
        """Record a reply without anything before it."""
        if self._tells() and not self._has_returned:
            self.returned = 0
        self._has_returned = False

    def _without_lone_echo(self, data: bytes) -> bytes:
        """Remove the echo of an unanswered request; bytes that may still become one wait."""
        if not self._lone_echo:
            return data
        heard, self._heard = self._heard + data, b""
        if len(heard) < len(self._lone_echo) and self._lone_echo.startswith(heard):
            self._heard = heard
            return b""
        if heard.startswith(self._lone_echo):
            heard = heard[len(self._lone_echo) :]
            self.counters.echoes += 1
        self._lone_echo = b""
        return heard

    def _pass_echo(self) -> bool:
        """Remove the own request from the waiting bytes; False while it may still be incomplete."""
        if not self._echo:
            return True
        start = self._buffer.find(self._echo)
        if start < 0:
            return len(self._buffer) >= len(self._echo)
        self._drop(start)
        self._buffer = self._buffer[len(self._echo) :]
        self._echo = b""
        self.counters.echoes += 1
        return True

    def _take_reply(self) -> list[Frame]:
        """Take the first whole good reply, unless an earlier byte may begin one that is still incomplete."""
        start = 0
        while start < len(self._buffer):
            length = self._intact_length(start)
            if length > 0 and self._is_ours(self._buffer, start) and self._fits(self._buffer, start):
                return [self._take(start, length)]
            if length > 0 and self._is_ours(self._buffer, start):
                start += length  # an odd drive, or the reply to another request: the silence decides
            elif length > 0:
                self._skip_foreign(start, length)
                start = 0
            elif self._is_ours(self._buffer, start) and (length != NO_FRAME or self._may_be_odd):
                break
            else:
                start += 1
        return []

    @property
    def _may_be_odd(self) -> bool:
        """Whether the expected reply may be an odd frame."""
        return self._unit_id in self._odd_units

    def _settle(self, *, has_given_up: bool) -> list[Frame]:
        """Take what is a reply after the silence, wherever it begins."""
        data = self._buffer
        is_whole = MIN_ADU <= len(data) <= MAX_ADU
        if is_whole and data[0] != self._unit_id and data[0] in self._odd_units and is_intact(data):
            self._skip_foreign(0, len(data))
            return []
        for start in range(len(self._buffer) - MIN_ADU + 1):
            if not self._is_ours(self._buffer, start):
                continue
            length = self._intact_length(start)
            if length > 0 and (has_given_up or self._fits(self._buffer, start)):
                return [self._take(start, length)]
            if length > 0:
                continue
            rest = self._buffer[start:]
            is_over = length != NEEDS_MORE or (self._may_be_odd and self._is_echo(rest))
            is_over = has_given_up or (is_over and self._fits(self._buffer, start))
            if is_over and len(rest) <= MAX_ADU and self._may_end_oddly(rest[1]) and is_intact(rest):
                return [self._take(start, len(rest))]
            if self._may_be_odd and not has_given_up:
                break  # it may continue after a pause: no search inside it
        return []

    def _is_echo(self, frame: bytes) -> bool:
        """Whether a drive repeats the request byte for byte: then its reply is complete."""
        return frame == append_crc(bytes((self._unit_id,)) + self._request)

    def _may_end_oddly(self, function: int) -> bool:
        """Whether a reply with this function byte may have another length than its code says."""
        return not self._may_be_odd or (function | EXCEPTION_BIT) == (self._request[0] | EXCEPTION_BIT)

    def _intact_length(self, start: int) -> int:
        """Return the length of the good reply at ``start``, or a constant: NO_FRAME with a wrong CRC."""
        length = reply_length(self._request, self._buffer, start)
        if length <= 0:
            return length
        end = start + length
        if end > len(self._buffer):
            return NEEDS_MORE
        return length if is_intact(self._buffer[start:end]) else NO_FRAME

    def _take(self, start: int, length: int) -> Frame:
        """Take the reply; bytes before it are noise, bytes after it belong to no request."""
        if self.returned and not start:
            self._end_row()
        self._drop(start)
        frame = self._buffer[0], self._buffer[1 : length - 2]
        rest = self._buffer[length:]
        self._expect_nothing()
        self._is_answered = True
        self._count_stray(rest)
        return frame

    def _skip_foreign(self, start: int, length: int) -> None:
        self._drop(start)
        self.late_unit_id = self._buffer[0]
        self._buffer = self._buffer[length:]
        self.counters.foreign += 1

    def _count_stray(self, data: bytes) -> None:
        # Zeros after a reply come from a switching driver; after a time-out they may be part of a reply.
        if self._is_answered and not any(data):
            self.counters.glitch_bytes += len(data)
            return
        self.counters.stray_bytes += len(data)
        self._stray = (self._stray + data)[-MAX_ADU:]
        if len(self._stray) >= MIN_ADU and is_intact(self._stray):
            self.counters.stray_frames += 1
            self.late_unit_id = self._stray[0]
            self._stray = b""

    def _expect_nothing(self) -> None:
        self._has_returned = False
        self._request = b""
        self._echo = b""
        self._buffer = b""
        self.deadline_ns = None
