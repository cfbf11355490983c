"""The silence before a frame: at least 3.5 characters after the last byte of a serial line.

Modbus over serial line V1.02, 2.5.1.1. The silence is counted from the last byte on *this* port, in either
direction: so a quiet line sends immediately.
"""

import asyncio
from collections import deque

from gateway.clock import boot_ns
from gateway.exchange.ports import Stamps
from gateway.transport.channel import Channel
from gateway.transport.timer import Timer


class PacedSender:
    """Writes frames to a channel, each some time after the last byte on it.

    ``gap_ns`` is the silence that the other end needs on any connection. ``wire_gap_ns`` is what the
    characters of a wire need; it does not apply without a wire (a pseudo terminal, TCP).
    """

    def __init__(self, gap_ns: int, wire_gap_ns: int = 0) -> None:
        self._requested_gap_ns = gap_ns
        self._wire_gap_ns = wire_gap_ns
        self._gap_ns = gap_ns
        self._channel: Channel | None = None
        self._quiet_from_ns = 0
        self._held: deque[bytes] = deque()
        self._timer = Timer(self._send_held)
        self._drained: asyncio.Future[None] | None = None
        self.stamps = Stamps()

    def opened(self, channel: Channel, now_ns: int) -> None:
        """Write to ``channel`` from now on. The traffic before is unknown: begin with a silence."""
        self._channel = channel
        wire_ns_per_byte = self.stamps.wire_ns_per_byte = channel.wire_ns_per_byte
        self._gap_ns = max(self._requested_gap_ns, self._wire_gap_ns if wire_ns_per_byte else 0)
        self._quiet_from_ns = now_ns

    def closed(self) -> None:
        """Forget the channel and the frames that waited for it."""
        self._channel = None
        self.discard()

    def heard(self, now_ns: int) -> None:
        """Restart the silence: bytes arrived."""
        if now_ns > self._quiet_from_ns:
            self._quiet_from_ns = now_ns

    def send(self, frame: bytes) -> None:
        """Send now if the silence is over, else as soon as it is."""
        stamps = self.stamps
        stamps.ready_ns = stamps.sent_ns = now_ns = boot_ns()
        stamps.paced_ns = 0
        if self._held or now_ns < self._quiet_from_ns + self._gap_ns:
            self._held.append(frame)
            self._timer.arm(self._quiet_from_ns + self._gap_ns)
        else:
            self._write(frame, now_ns)

    def may_begin(self, now_ns: int) -> bool:
        """Whether a frame that is written in pieces may begin now, without a wait for the silence."""
        is_quiet = now_ns >= self._quiet_from_ns + self._gap_ns
        return self._channel is not None and not self._held and is_quiet

    def add(self, piece: bytes) -> None:
        """Write a piece of a frame that has begun, or begins now: see :meth:`may_begin`."""
        stamps = self.stamps
        stamps.ready_ns = stamps.sent_ns = now_ns = boot_ns()
        stamps.paced_ns = 0
        if self._channel is not None:
            self._channel.write(piece)
            stamps.sent_ns = boot_ns()
            # The bytes follow those of earlier pieces, which may not all be sent.
            self._quiet_from_ns = max(self._quiet_from_ns, now_ns) + len(piece) * stamps.wire_ns_per_byte

    def discard(self) -> None:
        """Drop the waiting frames; they were never sent."""
        self._held.clear()
        self._timer.arm(None)
        self._settle()

    async def drained(self) -> None:
        """Wait until every frame has been sent after its silence."""
        if self._held:
            self._drained = asyncio.get_running_loop().create_future()
            await self._drained

    def close(self) -> None:
        """Drop the waiting frames and release the timer."""
        self.discard()
        self._timer.close()

    def _write(self, frame: bytes, now_ns: int) -> None:
        if self._channel is not None:
            self._channel.write(frame)
            self.stamps.sent_ns = boot_ns()
            self._quiet_from_ns = now_ns + len(frame) * self.stamps.wire_ns_per_byte

    def _send_held(self, now_ns: int) -> None:
        if self._held and now_ns >= self._quiet_from_ns + self._gap_ns:
            self.stamps.paced_ns = now_ns - self.stamps.ready_ns
            self._write(self._held.popleft(), now_ns)
        if self._held:
            self._timer.arm(self._quiet_from_ns + self._gap_ns)
        self._settle()

    def _settle(self) -> None:
        if not self._held and self._drained is not None and not self._drained.done():
            self._drained.set_result(None)
