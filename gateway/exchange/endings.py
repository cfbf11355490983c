"""How an exchange ends for its controller: answered, failed, refused, withdrawn; what that leaves behind."""

from collections.abc import Callable
from functools import partial
from typing import Final

from gateway.exchange.access import only_reads
from gateway.exchange.answering import answer, note_discrete
from gateway.exchange.counters import LineCounters
from gateway.exchange.dispatch import Units
from gateway.exchange.events import Event, EventKind
from gateway.exchange.groups import end_remapped
from gateway.exchange.life import Exchange
from gateway.exchange.losses import lose
from gateway.exchange.news import AxisNews
from gateway.exchange.writers import Writers
from gateway.modbus.pdu import BROADCAST_UNIT_ID, ExceptionCode, exception_pdu, is_exception

LOST: Final = ExceptionCode.SERVER_DEVICE_FAILURE
NO_RESPONSE: Final = ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND
REMAPPED: Final = "its drive's registers were moved about; corrected again after a restart of the gateway"


class Endings:
    """The ends of a line's exchanges."""

    def __init__(
        self,
        units: Units,
        writers: Writers,
        counters: LineCounters,
        news: AxisNews,
        on_event: Callable[[Event], None],
    ) -> None:
        self._units = units
        self._writers = writers
        self._counters = counters
        self._news = news
        self._on_event = on_event

    def reply(self, exchange: Exchange, pdu: bytes) -> None:
        """Give the controller its reply, if it still waits for one."""
        port = exchange.port
        if port is None or exchange.is_orphan:
            return
        if not (port.plan.serial and exchange.unit_id == BROADCAST_UNIT_ID):  # nobody answers a broadcast
            port.send_reply(exchange.transaction_id, exchange.unit_id, pdu)

    def answer(self, exchange: Exchange, pdu: bytes, now_ns: int) -> None:
        """Give the controller a drive's reply, turned back, and take note of what it says."""
        self._counters.exchanges += 1
        self._counters.exceptions += is_exception(pdu)
        if not exchange.rewritings:
            self.reply(exchange, pdu)
            note_discrete(self._units.get(exchange.unit_id), exchange.pdu, pdu, exchange.sent_ns)
            return
        for rewriting in exchange.rewritings:
            answer(rewriting, pdu, now_ns, partial(self.reply, exchange))
            self._counters.unmapped_reads += rewriting.reads_unmapped
        self.end_if_remapped(exchange)

    def fail(self, exchange: Exchange, code: ExceptionCode) -> None:
        """Say that a drive cannot be had: an exception on TCP, silence on a serial line (W7)."""
        if exchange.port is not None and not exchange.port.plan.serial:
            self.reply(exchange, exception_pdu(exchange.pdu[0], code))

    def fail_unsent(self, exchange: Exchange) -> None:
        """Say that there is no way to the drives (W7)."""
        self.note_unsent(exchange, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)
        self.fail(exchange, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)

    def refuse(self, exchange: Exchange, code: int) -> None:
        """Answer what the gateway itself refuses, on serial lines too (W7)."""
        self._count_refused(exchange)
        self.reply(exchange, exception_pdu(exchange.pdu[0], code))

    def deny(self, exchange: Exchange, code: int) -> None:
        """Answer what a controller has no right to: what it may not reach is as good as absent (W7)."""
        if code == ExceptionCode.GATEWAY_PATH_UNAVAILABLE:
            self._count_refused(exchange)
            self.fail(exchange, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)
        else:
            self.refuse(exchange, code)

    def _count_refused(self, exchange: Exchange) -> None:
        self._counters.refused += 1
        if exchange.port is not None:
            name = exchange.port.plan.name
            self._counters.refused_by[name] = self._counters.refused_by.get(name, 0) + 1

    def refuse_unsent(self, exchange: Exchange, code: int) -> None:
        """Refuse a request that might have moved something: it never reached the drive (M3)."""
        self.note_unsent(exchange, code)
        self.refuse(exchange, code)

    def withdrawn(self, exchange: Exchange, reason: str, code: int = LOST) -> None:
        """Take note of a request that its controller does not wait for any more (W5)."""
        self.note_unsent(exchange, code)
        self._counters.withdrawn += 1
        if exchange.port is not None:
            name = exchange.port.plan.name
            self._on_event(Event(EventKind.WITHDRAWN, None, f"a request of {name} was not sent: {reason}"))

    def overtaken(self, exchange: Exchange, reason: str) -> None:
        """Withdraw what a stop has overtaken; its controller still waits, and is told (M3)."""
        self.withdrawn(exchange, reason, ExceptionCode.SERVER_DEVICE_BUSY)
        self.refuse(exchange, ExceptionCode.SERVER_DEVICE_BUSY)

    def note_unsent(self, exchange: Exchange, code: int) -> None:
        """Take note of a request that never reached the drive (M3)."""
        if exchange.port is not None and not only_reads(exchange.pdu):
            self._writers.lose(exchange, code)
            self._news.look(self._units.axes_of(exchange.unit_id))

    def lost(self, exchange: Exchange, now_ns: int) -> None:
        """Take note of an exchange whose reply never came."""
        lose(exchange, NO_RESPONSE, now_ns)
        if exchange.added is not None:
            self.note_unsent(exchange, NO_RESPONSE)
        self.end_if_remapped(exchange)

    def end_if_remapped(self, exchange: Exchange) -> None:
        """End the compensation of a unit whose registers may mean something else now, acknowledged or not."""
        if exchange.added is None:
            for axis in end_remapped(exchange.rewritings):
                self._on_event(Event(EventKind.COMPENSATION_ENDED, axis.plan.name, REMAPPED))
