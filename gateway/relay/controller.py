"""One configured controller: its listener or serial port, and its open connections."""

from collections.abc import Callable
from datetime import datetime
from functools import partial
from ipaddress import ip_network
from typing import Final

from msgspec import UNSET

from gateway.catalogue.entry import EventEntry
from gateway.catalogue.line_events import (
    ADAPTER_ECHOES,
    CONNECTION_CLOSED,
    CONNECTION_MALFORMED,
    PORT_NOT_OPEN,
    SERIAL_LATENCY,
)
from gateway.clock import boot_ns, now_utc
from gateway.exchange.cut_through.forward import SerialTiming
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import ControllerPlan
from gateway.modbus.mbap import MbapCounters
from gateway.modbus.rtu_echo import ReplyEcho
from gateway.modbus.rtu_line import RtuCounters
from gateway.relay.controller_port import Asked, MbapControllerPort, RtuControllerPort
from gateway.relay.fd_store import FdSlot, open_kept, store_port
from gateway.relay.journal import Journal
from gateway.relay.last_minute import LastMinute
from gateway.relay.pulse import Beats
from gateway.relay.refusals import Refusals
from gateway.relay.tls_admission import TlsAdmission
from gateway.relay.watchdog import Accepting
from gateway.state.plan import ControllerLink
from gateway.status.line import ControllerStatus, PortMinute
from gateway.times import NS_PER_MS, NS_PER_S
from gateway.transport.channel import Receiver
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint, host_of
from gateway.transport.framing import RETURNS, frame_silence_ns, request_decoder
from gateway.transport.serial import SerialPort
from gateway.transport.serial_channel import character_ns
from gateway.transport.tcp import TcpListener

GARBAGE: Final = "it sent a header of impossible length; its connection was closed"
HALF_FRAME_GRACE_NS: Final = 2 * NS_PER_S
"""Time that an incomplete request may take beyond its controller's time-out; then the connection is
closed."""


class TcpController:
    """A controller that connects over TCP; it may have several connections."""

    def __init__(
        self,
        line: str,
        link: ControllerLink,
        endpoint: TcpEndpoint,
        exchange: LineExchange,
        journal: Journal,
        *,
        beats: Beats,
    ) -> None:
        self.plan: ControllerPlan = link.plan
        self.endpoint = endpoint
        self._exchange = exchange
        self._beats = beats
        self._log = _noter(journal, line, link.plan.name)
        self._asked = Asked()
        self._counters = MbapCounters()
        self._rtu_counters = RtuCounters()
        self._refusals = Refusals(self._log)
        self._closings = Refusals(self._log, event=CONNECTION_CLOSED)
        self._admission = None
        if link.tls is not None:
            log = partial(journal.log, line=line, controller=link.plan.name)
            self._admission = TlsAdmission(link, link.tls, self._port, self._refusals, log)
        self._listener = TcpListener(
            endpoint,
            map(ip_network, link.allow),
            self._receiver,
            self._refusals.add,
            limits=link.limits,
            patience_ns=int(link.plan.timeout_ms * NS_PER_MS) + HALF_FRAME_GRACE_NS,
            on_closed=self._closings.add,
            acknowledged_within_ns=int(link.plan.timeout_ms * NS_PER_MS),
        )
        self._slot: FdSlot | None = None
        self._accepting = Accepting(self._listener)

    def use_slot(self, slot: FdSlot) -> None:
        """Take the stored sockets of this listener, and store the new ones; call it before :meth:`open`."""
        self._slot = slot

    def why_stuck(self) -> str:
        """Return why no controller can connect any more, "" if all is well; to be called regularly."""
        return self._accepting.why_stuck()

    @property
    def addresses(self) -> tuple[TcpEndpoint, ...]:
        """The addresses of its listener."""
        return self._listener.addresses

    async def drained(self) -> None:
        """Wait for replies that were not written yet; on TCP there are none."""

    async def open(self) -> None:
        """Open the listener.

        Raises:
            TransportError: with the remedy.
        """
        if self._admission is not None:
            self._admission.open()
        if self._slot is None:
            await self._listener.open()
            return
        await open_kept(self._listener, self.endpoint, self._slot, self._log)

    def stop_accepting(self) -> None:
        """Accept no more connections."""
        self._listener.stop_accepting()

    async def close(self) -> None:
        """Close the listener and its connections."""
        if self._admission is not None:
            self._admission.close()
        await self._listener.close()

    def status(self) -> ControllerStatus:
        """Return this controller's part of the status."""
        mbap, rtu = self._counters, self._rtu_counters
        is_rtu = self.endpoint.rtu
        return ControllerStatus(
            name=self.plan.name,
            role=self.plan.role.value,
            address=[str(address) for address in self.addresses] or str(self.endpoint),
            connections=self._listener.peers,
            asked_s=_age_s(self._asked),
            refused_connections=self._listener.refused,
            malformed=rtu.damaged if is_rtu else mbap.bad_headers + mbap.skipped_frames,
            dropped_bytes=rtu.dropped_bytes if is_rtu else mbap.dropped_bytes,
            tls=UNSET if self._admission is None else self._admission.status(now_utc()),
        )

    def tick(self, now: datetime) -> None:
        """Report certificates that expire soon; to be called at least every ten seconds."""
        if self._admission is not None:
            self._admission.tick(now)

    def _receiver(self) -> Receiver:
        return self._port(self.plan) if self._admission is None else self._admission.connection()

    def _port(self, plan: ControllerPlan) -> Receiver:
        if self.endpoint.rtu:
            decoder = request_decoder(self.endpoint)
            decoder.counters = self._rtu_counters
            return RtuControllerPort(
                plan, self._exchange, decoder, gap_ns=0, beats=self._beats, asked=self._asked
            )
        return MbapControllerPort(
            plan, self._exchange, self._counters, self._malformed, beats=self._beats, asked=self._asked
        )

    def _malformed(self, peer: str) -> None:
        self._refusals.count(CONNECTION_MALFORMED, host_of(peer), GARBAGE)


class SerialController:
    """A controller on a serial port."""

    def __init__(
        self,
        line: str,
        link: ControllerLink,
        endpoint: SerialEndpoint,
        exchange: LineExchange,
        journal: Journal,
        *,
        beats: Beats,
        odd_units: frozenset[int],
    ) -> None:
        self.plan: ControllerPlan = link.plan
        self.endpoint = endpoint
        log = _noter(journal, line, link.plan.name)
        self._asked = Asked()
        self._port = RtuControllerPort(
            self.plan,
            exchange,
            request_decoder(endpoint, odd_units),
            frame_silence_ns(endpoint),
            wire_of(endpoint),
            beats=beats,
            asked=self._asked,
            echo=ReplyEcho(is_configured=endpoint.echo),
            on_echo=lambda: log(ADAPTER_ECHOES, f"{endpoint}: {RETURNS}"),
        )
        self._port.ends_by_silence = True
        self._serial = SerialPort(
            endpoint,
            self._port,
            lambda why: log(PORT_NOT_OPEN, why),
            lambda why: log(SERIAL_LATENCY, why),
        )
        self._minute = LastMinute(self._port.counters)

    def use_slot(self, slot: FdSlot) -> None:
        """Take the stored descriptor of this port, and store the new one; call it before :meth:`open`."""
        store_port(self._serial, self.endpoint, slot)

    def why_stuck(self) -> str:
        """Return why the port is not used any more, "" if all is well."""
        return "" if self._serial.is_kept_up else f"{self.endpoint} is not kept open any more"

    @property
    def addresses(self) -> tuple[TcpEndpoint, ...]:
        """None: a serial port has no listener."""
        return ()

    async def drained(self) -> None:
        """Wait until every reply has been sent after its silence."""
        await self._port.drained()

    async def open(self) -> None:
        """Open the port; if it is absent, open it as soon as it appears.

        Raises:
            TransportError: in use, no permission, or not a serial port.
        """
        await self._serial.open()

    def stop_accepting(self) -> None:
        """Nothing to do: the exchange accepts no more requests."""

    async def close(self) -> None:
        """Close the port."""
        await self._serial.close()

    def status(self) -> ControllerStatus:
        """Return this controller's part of the status."""
        status = ControllerStatus(
            name=self.plan.name,
            role=self.plan.role.value,
            address=str(self.endpoint),
            state="up" if self._serial.is_open else "down",
            failure=self._serial.failure,
            opens=self._serial.opens,
            asked_s=_age_s(self._asked),
            notes=list(self._serial.notes),
            latency=self._serial.latency,
            echo=RETURNS if self._port.returns_replies else "",
            minute=PortMinute(**self._minute.grown(boot_ns())),
        )
        for name, count in self._port.counters().items():
            setattr(status, name, count)
        return status

    def tick(self, now: datetime) -> None:
        """Sample the framing counters; a serial port has no certificates."""
        self._minute.tick(boot_ns())


Controller = TcpController | SerialController


def make_controller(
    line: str,
    link: ControllerLink,
    exchange: LineExchange,
    journal: Journal,
    *,
    beats: Beats,
    odd_units: frozenset[int],
) -> Controller:
    """Return the server of a configured controller; ``odd_units`` as in ``OtherUnits``."""
    if isinstance(link.endpoint, TcpEndpoint):
        return TcpController(line, link, link.endpoint, exchange, journal, beats=beats)
    return SerialController(line, link, link.endpoint, exchange, journal, beats=beats, odd_units=odd_units)


def wire_of(endpoint: SerialEndpoint) -> SerialTiming:
    """Return the timing of a serial line for cut-through."""
    return SerialTiming(character_ns(endpoint), frame_silence_ns(endpoint))


def _age_s(asked: Asked) -> float | None:
    """Return the age of the newest request in seconds; None: no request since the start."""
    return round((boot_ns() - asked.newest_ns) / NS_PER_S, 3) if asked.newest_ns else None


def _noter(journal: Journal, line: str, controller: str) -> Callable[[EventEntry, str], None]:
    def log(event: EventEntry, detail: str) -> None:
        journal.log(event, line=line, controller=controller, detail=detail)

    return log
