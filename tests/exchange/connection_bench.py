"""A line whose link is a connection: either end may close it, and requests wait for the next one."""

from typing import Any

from gateway.catalogue import exchange_events
from gateway.catalogue.entry import EventEntry
from gateway.exchange.plan import AxisPlan, ControllerPlan, LineTiming
from tests.exchange.line_bench import MS, Bench, Link, Port

S = 1000 * MS


class Connection(Link):
    """A connection that records what the exchange requests of it."""

    def __init__(self, *, is_serial: bool = False) -> None:
        super().__init__(is_serial=is_serial)
        self.connects = True
        self.wanted = 0
        self.renewed = 0
        self.hung_up: list[bool] = []

    def want(self) -> None:
        self.wanted += 1

    def renew(self) -> None:
        self.renewed += 1

    def hang_up(self, *, returns: bool) -> None:
        self.hung_up.append(returns)


class ConnectionBench(Bench):
    """Time-outs of the controller: 1000 ms; of the drive: 200 ms.

    ``settled``: the server has shown that it does not close the connection after an answer.
    """

    def __init__(
        self, *plans: AxisPlan, serial: bool = False, rtu: bool = False, settled: bool = True, **timing: Any
    ) -> None:
        times: dict[str, Any] = {"response_timeout_ms": 200.0, "drain_ms": 50.0, **timing}
        self.connection = Connection(is_serial=rtu)
        super().__init__(*plans, timing=LineTiming(**times), serial=serial, link=self.connection)
        for _ in range(2 * settled):
            self.ask(bytes.fromhex("03 0700 0001"))
            self.until(21)
        self.events.clear()
        self.seen.clear()

    def serve(self) -> None:
        """Let the drive answer everything, while its server leaves the connection open."""
        while self.link.sent:
            self.serve_one()
            if self.line.rest.is_closing:
                self.until(21)

    def serve_one(self) -> None:
        """Let the drive answer the first request that was sent."""
        unit_id, pdu = self.link.sent.pop(0)
        self.seen.append(pdu)
        self.now_ns += MS
        self.line.reply(unit_id, self.memory.answer(pdu), self.now_ns)

    def peer_closes(self) -> None:
        """Let the server close the connection in order."""
        self.line.link_down(self.now_ns, "closed by its peer", is_orderly=True)

    def breaks(self, reason: str = "Connection reset by peer") -> None:
        self.line.link_down(self.now_ns, reason)

    def returns(self, after_ms: float, then_ms: float = 0) -> None:
        """Establish the next connection after so long; then let more time pass."""
        self.until(after_ms)
        self.line.link_up(self.now_ns)
        self.until(then_ms)

    def returns_and_serves(self, after_ms: float) -> None:
        """Establish the next connection after so long, and let the drive answer the waiting requests."""
        self.returns(after_ms)
        self.serve()

    def until(self, ms: float) -> None:
        """Let time pass, and tick at each deadline in between."""
        end_ns = self.now_ns + int(ms * MS)
        while (due_ns := self.line.deadline_ns) is not None and due_ns <= end_ns:
            self.now_ns = max(due_ns, self.now_ns)
            self.line.tick(self.now_ns)
        self.now_ns = end_ns

    def told(self, kind: EventEntry = exchange_events.LINE_DOWN) -> list[str]:
        """Details of the events of a kind."""
        return [event.detail for event in self.events if event.kind is kind]


def controller(name: str = "plc", *, serial: bool = False, timeout_ms: float = 1000.0) -> Port:
    return Port(ControllerPlan(name, timeout_ms=timeout_ms, serial=serial))
