"""The silence before a frame: at least 3.5 characters after the last byte of a serial line.

Modbus over serial line V1.02, 2.5.1.1. The silence is counted from the last byte on *this* port, in either
direction: so a quiet line sends immediately.
"""

import asyncio
from collections.abc import Callable

from gateway.clock import boot_ns
from gateway.exchange.ports import Stamps
from gateway.transport.channel import Channel
from gateway.transport.timer import Timer


class WireWriter:
    """Writes frames to a channel, and knows from when the next one may follow (``Stamps.next_ns``).

    ``gap_ns`` is the silence that the other end needs on any connection. ``wire_gap_ns`` is what the
    characters of a wire need; it does not apply without a wire (a pseudo terminal, TCP).
    """

    def __init__(self, gap_ns: int, wire_gap_ns: int = 0) -> None:
        self._requested_gap_ns = gap_ns
        self._wire_gap_ns = wire_gap_ns
        self._gap_ns = gap_ns
        self._channel: Channel | None = None
        self.stamps = Stamps()

    def opened(self, channel: Channel, now_ns: int) -> None:
        """Write to ``channel`` from now on. The traffic before is unknown: begin with a silence."""
        self._channel = channel
        wire_ns_per_byte = self.stamps.wire_ns_per_byte = channel.wire_ns_per_byte
        self._gap_ns = max(self._requested_gap_ns, self._wire_gap_ns if wire_ns_per_byte else 0)
        self.stamps.next_ns = now_ns + self._gap_ns if self._gap_ns else 0

    def closed(self) -> None:
        """Forget the channel."""
        self._channel = None

    def heard(self, now_ns: int) -> None:
        """Restart the silence: bytes arrived."""
        gap_ns = self._gap_ns
        if gap_ns and now_ns + gap_ns > self.stamps.next_ns:
            self.stamps.next_ns = now_ns + gap_ns

    def may_begin(self, now_ns: int) -> bool:
        """Whether a frame may begin now."""
        return self._channel is not None and now_ns >= self.stamps.next_ns

    def write(self, data: bytes) -> None:
        """Write a frame, or a piece of one: the bytes of a piece follow those of earlier pieces."""
        stamps = self.stamps
        stamps.ready_ns = stamps.sent_ns = now_ns = boot_ns()
        if self._channel is not None:
            self._channel.write(data)
            stamps.sent_ns = boot_ns()
            if self._gap_ns:
                end_ns = max(now_ns, stamps.next_ns - self._gap_ns) + len(data) * stamps.wire_ns_per_byte
                stamps.next_ns = end_ns + self._gap_ns


class PacedReplies:
    """Writes the replies to one controller, each after its silence. At most one reply waits for it.

    A controller that has given up must not get the reply: it would take it for that to its next request. So
    a reply that waits is dropped when the next one comes, when :meth:`discard` is called, and at the time
    until which the controller waits. Before it is written late, the loop reads what the controller has sent.

    ``on_write`` is called with each reply before it is written.
    """

    def __init__(self, wire: WireWriter, on_write: Callable[[bytes], None] = lambda _reply: None) -> None:
        self._wire = wire
        self._on_write = on_write
        self._waiting = b""
        self._by_ns = 0
        """The waiting reply is not sent after this time."""
        self._timer = Timer(self._rang)
        self._drained: asyncio.Future[None] | None = None

    def send(self, frame: bytes, by_ns: int) -> None:
        """Send a reply now if the silence is over, else as soon as it is, but not after ``by_ns``."""
        stamps = self._wire.stamps
        now_ns = boot_ns()
        if now_ns < stamps.next_ns:
            stamps.ready_ns = stamps.sent_ns = now_ns
            self._waiting, self._by_ns = frame, by_ns
            self._timer.arm(stamps.next_ns)
        else:
            self._waiting = b""
            self._write(frame)

    @property
    def is_waiting(self) -> bool:
        """Whether a reply waits for its silence."""
        return len(self._waiting) > 0

    def discard(self) -> None:
        """Drop a waiting reply: it was not sent."""
        self._waiting = b""
        self._timer.arm(None)
        self._settle()

    async def drained(self) -> None:
        """Wait until the waiting reply has been sent after its silence."""
        if self._waiting:
            self._drained = asyncio.get_running_loop().create_future()
            await self._drained

    def close(self) -> None:
        """Drop a waiting reply and release the timer."""
        self.discard()
        self._timer.close()

    def _rang(self, now_ns: int) -> None:
        # First the loop reads, in this same cycle, what the controller has sent meanwhile.
        asyncio.get_running_loop().call_soon(self._due)

    def _due(self) -> None:
        now_ns, next_ns = boot_ns(), self._wire.stamps.next_ns
        if self._waiting and now_ns < next_ns <= self._by_ns:
            self._timer.arm(next_ns)
            return
        frame, self._waiting = self._waiting, b""
        if frame and max(now_ns, next_ns) <= self._by_ns:
            self._write(frame)
        self._settle()

    def _write(self, frame: bytes) -> None:
        self._on_write(frame)
        self._wire.write(frame)

    def _settle(self) -> None:
        if self._drained is not None and not self._drained.done():
            self._drained.set_result(None)
