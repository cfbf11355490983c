"""RTU requests from a byte stream: the side on which the gateway is the slave.

A request ends where its own bytes say, and its CRC decides. If the bytes say nothing (function codes without
a rule, lengths that contradict the rule), it ends with a silence. After damage every later byte is tried as
the beginning of the next good request: so one lost frame does not cost the next.

Some devices take *odd frames*, of another length than their function code says: ``05 03 01 01 30 B8`` starts
some inverters. This applies only to the unit ids of such devices. If the expected length gives no right CRC,
but all bytes from one silence to the next do, these bytes are one frame. The decoder does not search inside
it: bytes that another device would take for a request may be there. Requests that follow it without a silence
are separated from it by all their CRCs, and must be complete to the end: so no stop is lost with it.
"""

from typing import Final

from gateway.modbus.crc import INTACT, SEAM, is_intact, residue_after
from gateway.modbus.lengths import (
    MAX_ADU,
    MIN_ADU,
    NEEDS_MORE,
    NO_FRAME,
    UNTIL_SILENCE,
    request_length,
)
from gateway.modbus.rtu_line import FAST_SILENCE_NS, Frame, RtuDecoder

NO_UNITS: Final[frozenset[int]] = frozenset()
MAX_BURST: Final = 2 * MAX_ADU
"""Most bytes without a silence that may wait where an odd frame begins: the longest one, and requests after
it."""


def _intact_length(data: bytes, start: int) -> int:
    """Return the length of the good request at ``start``, or a constant: NO_FRAME with a wrong CRC."""
    length = request_length(data, start)
    if length <= 0:
        return length
    end = start + length
    if end > len(data):
        return NEEDS_MORE
    return length if is_intact(data[start:end]) else NO_FRAME


def _find(data: bytes, start: int, last: int) -> int:
    """Return the offset of the first good request from ``start`` to ``last``, or -1."""
    for offset in range(start, min(last, len(data) - MIN_ADU) + 1):
        if _intact_length(data, offset) > 0:
            return offset
    return -1


class RtuRequestDecoder(RtuDecoder):
    r"""Bytes from a controller in, whole requests out. Never raises; see ``RtuDecoder`` for silence.

    >>> decoder = RtuRequestDecoder()
    >>> decoder.feed(bytes.fromhex("01 06 31 00 00 0F C7 32"), now_ns=0)
    [(1, b'\x061\x00\x00\x0f')]
    """

    __slots__ = ("_after_silence", "_frame_end_ns", "_is_behind_frame", "_is_truncated", "_odd_units")

    def __init__(
        self,
        silence_ns: int = FAST_SILENCE_NS,
        give_up_ns: int | None = None,
        odd_units: frozenset[int] = NO_UNITS,
    ) -> None:
        """``odd_units``: unit ids of devices that take odd frames (see the module)."""
        super().__init__(silence_ns, give_up_ns)
        self._odd_units = odd_units
        self._after_silence = 0
        """Offset of the first waiting byte after the last silence."""
        self._frame_end_ns = -silence_ns
        self._is_behind_frame = False
        """Whether the waiting bytes follow a good frame without a silence."""
        self._is_truncated = False
        """Whether the first waiting byte is in the middle of a burst that was too long."""

    def one(self, data: bytes, now_ns: int) -> bytes:
        """Return the PDU of ``data`` if that is exactly one good request.

        Otherwise return b"" and take nothing: :meth:`feed` takes it.
        """
        size = len(data)
        if len(self._buffer) or size < MIN_ADU or request_length(data) != size or not is_intact(data):
            return b""
        self._frame_end_ns = now_ns
        return data[1 : size - 2]

    def feed(self, data: bytes, now_ns: int) -> list[Frame]:
        """Return the requests that ``data`` completes, in their order."""
        pdu = self.one(data, now_ns)
        if len(pdu):
            return [(data[0], pdu)]
        return self._append(data, now_ns) if data else []

    def _append(self, data: bytes, now_ns: int) -> list[Frame]:
        frames: list[Frame] = []
        was_silent = now_ns - self._last_byte_ns >= self._silence_ns
        if self._buffer and was_silent and self._awaits_end():
            frames = self._settle(has_given_up=False)  # the call at a silence may come late
        if not self._buffer:
            self._after_silence = 0
            self._is_behind_frame = now_ns - self._frame_end_ns < self._silence_ns
            self._is_truncated = False
        elif was_silent:
            self._after_silence = len(self._buffer)
        self._buffer += data
        frames += self._take_frames()
        if frames:
            self._frame_end_ns = now_ns
        if len(self._buffer) > MAX_ADU and not self._awaits_end():
            self.counters.oversized += 1
            self._drop(len(self._buffer) - MAX_ADU)
            self._is_truncated = True
        self._await_silence(now_ns)
        return frames

    def _take_frames(self) -> list[Frame]:
        """Take good requests from the front, after damage too, up to bytes that must wait."""
        frames: list[Frame] = []
        while self._buffer:
            length = _intact_length(self._buffer, 0)
            if length <= 0:
                next_good = self._next_good(is_hopeless=length == NO_FRAME)
                if next_good < 0:
                    break
                if self._awaits_end():
                    frames.append(self._take(next_good))  # odd, from the silence before to the one after it
                else:
                    self._drop(next_good)
            else:
                frames.append(self._take(length))
        return frames

    def _next_good(self, *, is_hopeless: bool) -> int:
        """Return where the next good request begins, if the bytes before it may be given up; else -1."""
        fresh = self._after_silence
        awaits_end = self._awaits_end()
        if not awaits_end and (is_hopeless or len(self._buffer) > MAX_ADU):
            return _find(self._buffer, 1, self._last_to_search())
        if not fresh or _intact_length(self._buffer, fresh) <= 0:
            return -1
        # After an incomplete odd frame, the bytes since the silence may be its rest.
        return fresh if not awaits_end or self._is_intact(0, fresh) else -1

    # --- odd frames -----------------------------------------------------------------------------------------

    def _may_be_odd(self, start: int) -> bool:
        """Whether an odd frame may begin at ``start``, which follows a silence or a good frame."""
        data = self._buffer
        if len(data) <= start or data[start] not in self._odd_units or (start == 0 and self._is_truncated):
            return False
        return len(data) == start + 1 or data[start + 1] != 0

    def _awaits_end(self) -> bool:
        """Whether an odd frame may be waiting: no search before a silence has ended it."""
        return len(self._odd_units) > 0 and len(self._buffer) <= MAX_BURST and self._may_be_odd(0)

    def _last_to_search(self) -> int:
        """Return the last offset at which a good request is searched for after damage."""
        fresh = self._after_silence
        return fresh if fresh and self._may_be_odd(fresh) else len(self._buffer)

    def _is_intact(self, start: int, end: int) -> bool:
        return MIN_ADU <= end - start <= MAX_ADU and is_intact(self._buffer[start:end])

    def _odd_length(self, start: int, *, has_given_up: bool) -> int:
        """Return the length of the odd frame at ``start`` after a silence, or a constant.

        NEEDS_MORE: the silence may be a pause of an adapter. One frame in 256 ends with a 0, and then the
        bytes before it have a right CRC too. So all waiting bytes are tried as one frame before any part of
        them: zeros after a CRC may belong to it.
        """
        end = len(self._buffer)
        if self._is_intact(start, end):
            return end - start if self._is_over(start, has_given_up=has_given_up) else NEEDS_MORE
        before_damage = NO_FRAME
        residue = residue_after(self._buffer[start : start + MIN_ADU - 1], SEAM)
        for at in range(start + MIN_ADU, min(start + MAX_ADU, end - MIN_ADU) + 1):
            residue = residue_after(self._buffer[at - 1 : at], residue)
            if residue != INTACT:
                continue
            if self._are_whole(at, has_given_up=has_given_up):
                return at - start
            # Damage that further bytes cannot repair: two right CRCs in a row are no chance.
            if has_given_up and before_damage == NO_FRAME and _intact_length(self._buffer, at) > 0:
                before_damage = at - start
        return before_damage

    def _is_over(self, start: int, *, has_given_up: bool) -> bool:
        """Whether an odd frame that is good so far is complete.

        If its function code has no rule for its length it ends with the silence, as for any unit.
        """
        return has_given_up or _intact_length(self._buffer, start) == UNTIL_SILENCE

    def _are_whole(self, start: int, *, has_given_up: bool) -> bool:
        """Whether whole requests fill the bytes from ``start`` to the end; a silence may end the last."""
        while start < len(self._buffer):
            length = _intact_length(self._buffer, start)
            if length <= 0:
                may_end = length == UNTIL_SILENCE or self._may_be_odd(start)
                is_last = may_end and self._is_intact(start, len(self._buffer))
                is_over = is_last and self._is_over(start, has_given_up=has_given_up)
                return is_over or not any(self._buffer[start:])
            start += length
        return True

    def _whole_from(self, start: int, last: int) -> int:
        """Return the first offset, ``last`` at most, from which whole requests reach to the end, or -1."""
        for at in range(start, min(last, len(self._buffer) - MIN_ADU) + 1):
            if _intact_length(self._buffer, at) > 0 and self._are_whole(at, has_given_up=True):
                return at
        return -1

    def _take(self, length: int) -> Frame:
        frame = self._buffer[0], self._buffer[1 : length - 2]
        self._buffer = self._buffer[length:]
        self._after_silence = max(0, self._after_silence - length)
        self._is_behind_frame = True
        self._is_truncated = False
        return frame

    def _drop(self, count: int) -> None:
        self._after_silence = max(0, self._after_silence - count)
        super()._drop(count)

    def _settle(self, *, has_given_up: bool) -> list[Frame]:
        if self._is_behind_frame and not any(self._buffer):
            self._drop(len(self._buffer))
            return []
        frames: list[Frame] = []
        while (found := self._ended_by_silence(has_given_up=has_given_up)) is not None:
            start, length = found
            self._drop(start)
            frames.append(self._take(length))
            frames += self._take_frames()
        return frames

    def _ended_by_silence(self, *, has_given_up: bool) -> tuple[int, int] | None:
        """Return offset and length of the frame that the silence has ended.

        All waiting bytes, or all since the last silence; else the first good request after damage.
        """
        fresh = self._after_silence
        length = self._length_to_silence(0, has_given_up=has_given_up)
        if length != NO_FRAME:
            return (0, length) if length > 0 else None
        length = self._length_to_silence(fresh, has_given_up=has_given_up)
        if self._awaits_end():
            return self._behind_damage(fresh, length, has_given_up=has_given_up)
        if length != NO_FRAME:
            return (fresh, length) if length > 0 else None
        last = self._last_to_search()
        start = _find(self._buffer, 1, last)
        if start < 0 and has_given_up:
            start = self._whole_from(last + 1, len(self._buffer))
        return None if start < 0 else (start, _intact_length(self._buffer, start))

    def _length_to_silence(self, start: int, *, has_given_up: bool) -> int:
        """Return the length of the frame from ``start`` to the silence, or a constant.

        NEEDS_MORE: it may continue; NO_FRAME: the bytes are no frame.
        """
        if self._odd_units and self._may_be_odd(start):
            return self._odd_length(start, has_given_up=has_given_up)
        frame = self._buffer[start:]
        if not MIN_ADU <= len(frame) <= MAX_ADU or frame[1] == 0 or not is_intact(frame):
            return NO_FRAME
        # Shorter than its own bytes say: the silence may be a pause of an adapter.
        is_over = has_given_up or _intact_length(frame, 0) != NEEDS_MORE
        return len(frame) if is_over else NO_FRAME

    def _behind_damage(self, fresh: int, length: int, *, has_given_up: bool) -> tuple[int, int] | None:
        """Return as :meth:`_ended_by_silence`, if an odd frame began and did not end well.

        ``length`` is that of a frame after the last silence, or a constant. If there is one, the bytes before
        it are over. Of these, only requests count that are whole to the end, as no part of a frame is. So a
        stop is not lost after damage, and no bytes inside a damaged frame are executed.
        """
        is_behind = length != NO_FRAME
        if fresh and not is_behind:
            length = _intact_length(self._buffer, fresh)
            is_behind = length > 0
        if not is_behind and not has_given_up:
            return None
        split = self._odd_length(0, has_given_up=True) if is_behind else NO_FRAME
        if 0 < split < fresh:
            return 0, split
        start = self._whole_from(1, fresh if is_behind else len(self._buffer))
        if start > 0:
            return start, _intact_length(self._buffer, start)
        return (fresh, length) if is_behind and length > 0 else None
