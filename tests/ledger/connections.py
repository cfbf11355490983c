"""Controllers over Modbus/TCP, through the port of the gateway: they pipeline, drip and hang up."""

from collections import deque
from typing import Any, Final

from gateway.exchange.line import LineExchange
from gateway.exchange.plan import ControllerPlan
from gateway.exchange.ports import ControllerPort
from gateway.modbus.mbap import MbapCounters, encode_mbap
from gateway.relay.controller_port import MbapControllerPort
from gateway.transport.channel import Channel
from tests.ledger.controllers import Master
from tests.ledger.exchanges import Controller
from tests.ledger.frames import open_mbap
from tests.ledger.ledger import Ledger
from tests.ledger.stillness import Stillness

NOTICED_MS: Final = 5.0
"""After so long a controller has seen that its connection is closed, and connects again."""


class Doorway:
    """What is known of the requests of one connection before the line has them."""

    def __init__(self, ledger: Ledger, book: Controller, stillness: Stillness) -> None:
        self.ledger, self.book, self.stillness = ledger, book, stillness
        self.written_ns: deque[int] = deque()
        """When each request's first byte was sent."""


class BookedLine(LineExchange):
    """A line that has the ledger told of what comes over connections, past it."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.doorways: dict[ControllerPort, Doorway] = {}

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
        way = self.doorways.get(port)
        if way is None:
            super().request(port, transaction_id, unit_id, pdu, now_ns, why_given_up=why_given_up)
            return
        ledger, stillness = way.ledger, way.stillness
        request = ledger.arrived(way.book, transaction_id, unit_id, pdu, way.written_ns.popleft())
        if why_given_up:
            ledger.is_to_be_given_up(request, why_given_up, stillness)
        else:
            ledger.is_to_be_sent(request, stillness)
        super().request(port, transaction_id, unit_id, pdu, now_ns, why_given_up=why_given_up)
        if why_given_up:
            ledger.given_up(request, why_given_up)

    def controller_gone(self, port: ControllerPort, now_ns: int, *, is_broken: bool = False) -> None:
        super().controller_gone(port, now_ns, is_broken=is_broken)
        way = self.doorways.pop(port, None)
        if way is not None:
            way.ledger.gone(way.book)


class Connection(Channel):
    """A TCP connection of a controller, as the gateway's port has it (``Channel``)."""

    def __init__(
        self, master: "TcpMaster", plan: ControllerPlan, line: BookedLine, doorway: Doorway, now_ns: int
    ) -> None:
        self._master = master
        self.peer = "192.168.0.7:40000"
        self.doorway = doorway
        self.is_closed = False
        """By either end."""
        beats = doorway.stillness.beats
        self.port = MbapControllerPort(plan, line, MbapCounters(), lambda peer: None, beats=beats)
        line.doorways[self.port] = doorway
        self.port.opened(self, now_ns)

    def write(self, data: bytes) -> None:
        """See ``Channel``; the gateway may not know yet that nobody reads it any more."""
        if not self.is_closed:
            self._master.heard(data)
        else:
            self._master.missed(self.doorway.book, data)

    def has_gone(self, *, asks: bool) -> bool:
        return self.is_closed

    def close(self) -> None:
        self._master.was_closed(self)


class TcpMaster(Master):
    """Modbus/TCP: several requests at once, answered by their numbers."""

    def __init__(self, *args: object, stillness: Stillness, **others: object) -> None:
        super().__init__(*args, **others)  # type: ignore[arg-type]
        self._stillness = stillness
        self._last_id = 0
        self._open: dict[int, tuple[int, bytes]] = {}
        self._burst = 0
        self._connection = self._connected()

    def _connected(self) -> Connection:
        """Connect: requests of one connection are never those of another."""
        self.book = self._new_book()
        doorway = Doorway(self._ledger, self.book, self._stillness)
        assert isinstance(self._line, BookedLine)
        return Connection(self, self.plan, self._line, doorway, self._clock.now_ns)

    def go_on(self) -> None:
        """Send the next requests, as many as are pipelined this time."""
        if self._connection.is_closed:
            self._connection = self._connected()
        self._burst += 1
        many = 1 if self._is_rest else self._rng.choice([1, 1, 2, 3, 5, 8])
        frames: list[bytes] = []
        for _ in range(many):
            if frames and not self._is_request_next():
                break  # a pause waits for the replies
            step = self._next_step()
            if step is None:
                break
            self._last_id = self._last_id % 0xFFFF + 1
            self._open[self._last_id] = step
            frames.append(encode_mbap(self._last_id, *step))
        if frames:
            self._write(frames)

    def _write(self, frames: list[bytes]) -> None:
        """Write frames as one; or the last of them in two parts, at once, late or too late."""
        burst, chance, rest_ms = self._burst, self._rng.random(), 0.0
        data = b"".join(frames)
        cut = len(data) - self._rng.randrange(1, len(frames[-1])) if chance < 0.12 else len(data)
        if chance < 0.02:
            rest_ms = self._rng.uniform(0.1, 2.5) * self.plan.timeout_ms
            self._ledger.book.seen["half requests"] += 1
        now_ns = self._clock.now_ns
        self._connection.doorway.written_ns.extend([now_ns] * len(frames))
        self._send(data[:cut])
        if cut < len(data):
            connection = self._connection
            self._clock.after(rest_ms, lambda: self._send(data[cut:], connection))
        self._clock.after(rest_ms + self.plan.timeout_ms + 1, lambda: self._lost_patience(burst))

    def _send(self, data: bytes, connection: Connection | None = None) -> None:
        connection = connection or self._connection
        if connection.is_closed:
            return
        port = connection.port
        self._stillness.reaches(port, lambda: port.received(data, self._clock.now_ns))

    def _lost_patience(self, burst: int) -> None:
        if burst != self._burst or not self._open:
            return
        step = next(iter(self._open.values()))
        self._open.clear()
        if self._rng.random() < 0.3:
            self._close()
        self._after_trouble(step)
        self.go_on()

    def _close(self) -> None:
        connection = self._connection
        self._ledger.book.seen["connections closed by controllers"] += 1
        connection.is_closed = self.book.is_closed = True
        port = connection.port
        self._stillness.reaches(port, lambda: port.closed("closed", self._clock.now_ns))

    def was_closed(self, connection: Connection) -> None:
        if connection.is_closed:
            return
        self._ledger.book.seen["connections closed by the gateway"] += 1
        connection.is_closed = self.book.is_closed = True
        port, burst = connection.port, self._burst
        port.closed("closed here", self._clock.now_ns)
        self._clock.after(NOTICED_MS, lambda: self._saw_it_closed(burst))

    def _saw_it_closed(self, burst: int) -> None:
        if burst != self._burst:
            return
        step = next(iter(self._open.values()), None)
        self._open.clear()
        if step is not None:
            self._after_trouble(step)
            self.go_on()

    def missed(self, book: Controller, frame: bytes) -> None:
        """A reply went to a connection that this end had closed: it ends a request all the same."""
        transaction_id, unit_id, pdu = open_mbap(frame)
        if transaction_id in book.unanswered:
            self._ledger.replied(book, transaction_id, unit_id, pdu)

    def heard(self, frame: bytes) -> None:
        transaction_id, unit_id, pdu = open_mbap(frame)
        self._ledger.replied(self.book, transaction_id, unit_id, pdu)
        step = self._open.pop(transaction_id, None)
        if step is None:
            return
        if pdu[0] >= 0x80:
            self._after_trouble(step)
        if not self._open:
            self._burst += 1
            self._clock.after(self._pause_ms(), self.go_on)
