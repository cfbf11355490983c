"""A line's exchange with the timer that it asks for.

Everything that reaches the exchange comes through here, so its next deadline is armed after every call.
"""

import asyncio
from collections.abc import Callable, Sequence
from typing import Final

from gateway.clock import boot_ns
from gateway.compensation.table import CorrectionTable
from gateway.compiled import mypyc_attr
from gateway.exchange.commands import Command
from gateway.exchange.cut_line import CutLine, RequestCutter, Wire
from gateway.exchange.line import LineExchange
from gateway.exchange.ports import ControllerPort
from gateway.relay.controller_port import Requests
from gateway.relay.pulse import Pulse
from gateway.times import NS_PER_MS
from gateway.transport.timer import Timer

LATE_NS: Final = 20 * NS_PER_MS
"""A time-out that is judged so late was not waited for: the process stood still."""


@mypyc_attr(allow_interpreted_subclasses=True)
class TimedExchange(Requests):
    """Passes calls on to a :class:`LineExchange` and calls its ``tick`` at its deadline."""

    def __init__(self, exchange: LineExchange) -> None:
        self._pulse = Pulse(exchange.note_standstill, self._beat)
        super().__init__(self._pulse)
        self._exchange = exchange
        self._timer = Timer(self._tick)
        self._idle: asyncio.Future[None] | None = None
        self.count_bytes: Callable[[], int] = _none
        """How many bytes have come of the drives on their connection."""
        self._counted = 0
        if exchange.cuts is not None:
            exchange.cuts.on_change = self._settle

    @property
    def cuts(self) -> CutLine | None:
        """Cut-through on this line; None: there is none."""
        return self._exchange.cuts

    def follow(self, port: ControllerPort, wire: Wire) -> RequestCutter | None:
        """See ``Requests``."""
        cuts = self._exchange.cuts
        return None if cuts is None else cuts.follow(port, wire)

    @property
    def is_idle(self) -> bool:
        """Whether no exchange is on the wire."""
        return self._exchange.is_idle

    def request(
        self,
        port: ControllerPort,
        transaction_id: int,
        unit_id: int,
        pdu: bytes,
        now_ns: int,
        *,
        why_given_up: str = "",
    ) -> None:
        """Take a whole request of a controller; see ``LineExchange``."""
        self._exchange.request(port, transaction_id, unit_id, pdu, now_ns, why_given_up=why_given_up)
        self._settle()

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """Take the reply that a link expected."""
        self._exchange.reply(unit_id, pdu, now_ns)
        self._settle()

    def stray(self, now_ns: int, *, unit_id: int = -1) -> None:
        """Note bytes from the drives that answer nothing; ``unit_id``: of the whole frame among them."""
        self._exchange.stray(now_ns, unit_id=unit_id)
        self._settle()

    def controller_gone(self, port: ControllerPort, now_ns: int, *, is_broken: bool = False) -> None:
        """Note that a controller's connection or port was lost."""
        self._exchange.controller_gone(port, now_ns, is_broken=is_broken)
        self._settle()

    def rest_first(self, now_ns: int) -> None:
        """Note, before the drives can be reached, that they may still answer somebody else (W6)."""
        self._exchange.rest.owe()

    def link_up(self, now_ns: int) -> None:
        """Note that the drives can be reached."""
        self._counted = self.count_bytes()
        self._exchange.link_up(now_ns)
        self._settle()

    def link_down(self, now_ns: int, reason: str = "", *, is_orderly: bool = False) -> None:
        """Note that the drives cannot be reached; see ``LineExchange``."""
        self._exchange.link_down(now_ns, reason, is_orderly=is_orderly)
        self._settle()

    def unframed(self, now_ns: int) -> None:
        """Note bytes of the drives of which no frame was made yet."""
        self._exchange.unframed()

    def command(
        self, command: Command, now_ns: int, tables: Sequence[CorrectionTable] = ()
    ) -> dict[str, str]:
        """Do what a command asks for; see ``LineExchange``. Raises ControlError."""
        changed = self._exchange.command(command, now_ns, tables)
        self._settle()
        return changed

    def is_due(self, now_ns: int) -> bool:
        """Whether the exchange's deadline has passed."""
        deadline_ns = self._exchange.deadline_ns
        return deadline_ns is not None and now_ns >= deadline_ns

    def late_ns(self, now_ns: int) -> int:
        """Return for how long something has been due that was not done; 0 or less: nothing is."""
        deadline_ns = self._exchange.deadline_ns
        return 0 if deadline_ns is None else now_ns - deadline_ns

    async def stop(self, now_ns: int, timeout_s: float) -> None:
        """Send nothing new; return when the exchange on the wire has ended, or after ``timeout_s``."""
        self._exchange.stop(now_ns)
        if not self._exchange.is_idle:
            self._idle = asyncio.get_running_loop().create_future()
            await asyncio.wait([self._idle], timeout=timeout_s)

    def close(self) -> None:
        """Give the timers back."""
        self._timer.close()
        self._pulse.close()

    def _beat(self) -> None:
        """Called fifty times a second (``pulse``)."""

    def _settle(self) -> None:
        self._timer.arm(self._exchange.deadline_ns)
        if self._idle is not None and self._exchange.is_idle and not self._idle.done():
            self._idle.set_result(None)

    def _tick(self, now_ns: int) -> None:
        if self.late_ns(now_ns) > LATE_NS:
            # What the drives have said meanwhile is there, and is read in this turn of the loop: first that.
            asyncio.get_running_loop().call_soon(self._due_now)
            return
        self._due(now_ns)

    def _due_now(self) -> None:
        self._due(boot_ns())

    def _due(self, now_ns: int) -> None:
        if not self._exchange.is_idle and self.is_due(now_ns):
            count = self.count_bytes()
            if count != self._counted:  # since the last time-out: the connection lives
                self._counted = count
                self.unframed(now_ns)
        self._tick_exchange(now_ns)
        self._settle()

    def _tick_exchange(self, now_ns: int) -> None:
        self._exchange.tick(now_ns)


def _none() -> int:
    return 0
