"""RTU requests out of a byte stream: the side on which the gateway is the slave.

A request ends where its own bytes say, and its check sum decides. Where the bytes say nothing (function codes
without a rule, lengths that contradict the rule) it ends where the line falls silent. After damage the next
good request is looked for at every later byte, so that one lost frame does not cost the next.
"""

from gateway.modbus.crc import is_intact
from gateway.modbus.lengths import (
    MAX_ADU,
    MIN_ADU,
    NEEDS_MORE,
    NO_FRAME,
    request_length,
)
from gateway.modbus.rtu_line import FAST_SILENCE_NS, Frame, RtuDecoder


def _intact_length(data: bytes, start: int) -> int:
    """Return the length of the good request at ``start``, or a constant: NO_FRAME with a bad check sum."""
    length = request_length(data, start)
    if length <= 0:
        return length
    end = start + length
    if end > len(data):
        return NEEDS_MORE
    return length if is_intact(data[start:end]) else NO_FRAME


def _find(data: bytes, start: int) -> int:
    """Return the offset of the first good request at or behind ``start``, or -1."""
    for offset in range(start, len(data) - MIN_ADU + 1):
        if _intact_length(data, offset) > 0:
            return offset
    return -1


class RtuRequestDecoder(RtuDecoder):
    r"""Bytes from a controller in, whole requests out. Never raises; see ``RtuDecoder`` for silence.

    >>> decoder = RtuRequestDecoder()
    >>> decoder.feed(bytes.fromhex("01 06 31 00 00 0F C7 32"), now_ns=0)
    [(1, b'\x061\x00\x00\x0f')]
    """

    __slots__ = ("_after_silence", "_frame_end_ns", "_is_behind_frame")

    def __init__(self, silence_ns: int = FAST_SILENCE_NS, give_up_ns: int | None = None) -> None:
        super().__init__(silence_ns, give_up_ns)
        self._after_silence = 0
        """Offset of the first waiting byte that came after the last silence."""
        self._frame_end_ns = -silence_ns
        self._is_behind_frame = False
        """Whether the waiting bytes follow a good frame without a silence."""

    def one(self, data: bytes, now_ns: int) -> bytes:
        """Return the PDU of ``data`` where that is one good request and nothing else.

        Else b"", and nothing was taken: :meth:`feed` takes it.
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
        if not self._buffer:
            self._after_silence = 0
            self._is_behind_frame = now_ns - self._frame_end_ns < self._silence_ns
        elif now_ns - self._last_byte_ns >= self._silence_ns:
            self._after_silence = len(self._buffer)
        self._buffer += data
        frames = self._take_frames()
        if frames:
            self._frame_end_ns = now_ns
        if len(self._buffer) > MAX_ADU:
            self.counters.oversized += 1
            self._drop(len(self._buffer) - MAX_ADU)
        self._await_silence(now_ns)
        return frames

    def _take_frames(self) -> list[Frame]:
        """Take good requests from the front, past damage, up to bytes that must wait."""
        frames: list[Frame] = []
        while self._buffer:
            length = _intact_length(self._buffer, 0)
            if length <= 0:
                next_good = self._next_good(is_hopeless=length == NO_FRAME)
                if next_good < 0:
                    break
                self._drop(next_good)
            else:
                frames.append(self._take(length))
        return frames

    def _next_good(self, *, is_hopeless: bool) -> int:
        """Where the next good request begins, if those waiting in front of it may be given up for it."""
        if is_hopeless or len(self._buffer) > MAX_ADU:
            return _find(self._buffer, 1)
        fresh = self._after_silence
        return fresh if fresh and _intact_length(self._buffer, fresh) > 0 else -1

    def _take(self, length: int) -> Frame:
        frame = self._buffer[0], self._buffer[1 : length - 2]
        self._buffer = self._buffer[length:]
        self._after_silence = max(0, self._after_silence - length)
        self._is_behind_frame = True
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
        """Return offset and length of what is a frame now that the line is silent.

        All that waits, or all that came since the last silence; else the first good request behind damage.
        """
        for start in (0, self._after_silence):
            frame = self._buffer[start:]
            if not MIN_ADU <= len(frame) <= MAX_ADU or frame[1] == 0 or not is_intact(frame):
                continue
            # Shorter than its own bytes say: perhaps an adapter only makes a pause.
            if has_given_up or _intact_length(frame, 0) != NEEDS_MORE:
                return start, len(frame)
        start = _find(self._buffer, 1)
        return None if start < 0 else (start, _intact_length(self._buffer, start))
