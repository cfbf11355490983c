"""Calls ``tick`` of a line's exchange at its deadline, on the loop."""

import asyncio
from collections.abc import Callable

from gateway.clock import boot_ns
from gateway.exchange.line import LineExchange
from gateway.exchange.ports import Alarm
from gateway.transport.timer import Timer


class LineAlarm(Alarm):
    """The alarm of one line. ``count_bytes`` returns the bytes received on the drive connection."""

    def __init__(self, exchange: LineExchange, count_bytes: Callable[[], int]) -> None:
        self._exchange = exchange
        self._count_bytes = count_bytes
        self._counted = 0
        """Bytes received until the last time-out, on the connection of ``_up_ns``."""
        self._up_ns = 0
        """When that connection was made."""
        self._timer = Timer(self._rang)
        self._is_closed = False
        self._idle: asyncio.Future[None] | None = None
        exchange.alarm = self

    def arm(self, deadline_ns: int | None) -> None:
        """See ``Alarm``."""
        self._timer.arm(deadline_ns)
        if self._idle is not None and self._exchange.is_idle and not self._idle.done():
            self._idle.set_result(None)

    def late_ns(self, now_ns: int) -> int:
        """Return how long the due work is overdue; 0 or less: nothing is overdue."""
        deadline_ns = self._exchange.deadline_ns
        return 0 if deadline_ns is None else now_ns - deadline_ns

    async def idle(self, timeout_s: float) -> None:
        """Return when the exchange on the wire has ended, or after ``timeout_s``."""
        if not self._exchange.is_idle:
            self._idle = asyncio.get_running_loop().create_future()
            await asyncio.wait([self._idle], timeout=timeout_s)

    def close(self) -> None:
        """Release the timer; nothing is done after this."""
        self._is_closed = True
        self._timer.close()

    def _rang(self, now_ns: int) -> None:
        # First the loop reads, in this same cycle, what the drives have sent: it ends a silence, or a wait.
        asyncio.get_running_loop().call_soon(self._due)

    def _due(self) -> None:
        exchange, now_ns = self._exchange, boot_ns()
        if self._is_closed:
            return
        if not exchange.is_idle and self.late_ns(now_ns) >= 0:
            up_ns = exchange.link_state.up_ns
            before = self._counted if up_ns == self._up_ns else 0
            self._up_ns, self._counted = up_ns, self._count_bytes()
            if self._counted != before:  # received since the last time-out: the connection works
                exchange.unframed(now_ns)
        exchange.tick(now_ns)
