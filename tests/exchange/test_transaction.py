"""A transaction from its arrival to its end: each step in each phase, and that nothing is sent twice."""

from itertools import pairwise, product
from typing import Final

import pytest

from gateway.catalogue import exchange_events
from gateway.exchange.added_frames import read_word
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.impossible import ImpossibleEventError
from gateway.exchange.counters import LineCounters
from gateway.exchange.events import Event
from gateway.exchange.plan import ControllerPlan
from gateway.exchange.transaction import (
    NEVER_NS,
    PHASE_AFTER,
    STOP_AFTER,
    Phase,
    Step,
    StopEvent,
    Stopping,
    Transaction,
    Transactions,
)
from tests.exchange.line_bench import MS, Bench, Link, Port, axis_plan
from tests.support.tables import walk

PDU: Final = b"\x03\0\0\0\1"
PIECE: Final = b"\x01\x03\0"
REST: Final = b"\0\0\1\x84\x0a"
"""Of the frame whose PDU is ``PDU``, to unit id 1; its check sum by hand."""
PHASE_WALK: Final = """
              waiting       prerequisite  leaving  sent   ended
frame         sent          x             x        x      x
added-frame   prerequisite  x             x        x      x
answered      x             waiting       x        x      x
begins        leaving       x             x        x      x
piece         x             x             leaving  x      x
last-piece    x             x             sent     x      x
acknowledged  x             x             x        ended  x
exception     x             x             x        ended  x
other-reply   x             x             x        ended  x
no-reply      x             x             x        ended  x
broadcast     x             x             x        ended  x
never-sent    ended         ended         ended    x      x
"""
"""By hand, from W5 and W12: where each step and each outcome leads. An x cannot be."""
STOP_WALK: Final = """
                 no     first  early  again  once
found            first  x      x      x      x
found-with-more  once   x      x      x      x
leaves-early     x      early  x      x      x
replaces         x      again  x      again  .
goes-again       x      again  again  again  x
"""
"""By hand, from M3. In the last row a cell is how the other transaction begins; a dot changes nothing."""
SENDS: Final = {Step.FRAME: PDU, Step.ADDED_FRAME: PDU, Step.PIECE: PIECE, Step.LAST_PIECE: PDU}


class Line:
    """The transactions of a line, and what leaves."""

    def __init__(self) -> None:
        self.link = Link()
        self.events: list[Event] = []
        self.counters = LineCounters()
        self.transactions = Transactions(
            self.counters, self.events.append, lambda *_: None, lambda _: None, self.link
        )
        self.port = Port(ControllerPlan("cnc"))

    def send(self, transaction: Transaction, step: Step, at_ns: int = 1) -> bool:
        """Let it leave, as far as the step says."""
        piece = {Step.PIECE: PIECE, Step.LAST_PIECE: REST}.get(step, b"")
        return self.transactions.send(transaction, step, 1, PDU, at_ns, patience_ns=MS, piece=piece)

    def left(self) -> list[bytes]:
        """Return what has left."""
        return [
            *(pdu for _, pdu in self.link.sent),
            *([self.link.left_early] if self.link.left_early else []),
        ]

    def a_transaction(self, phase: Phase = Phase.WAITING) -> Transaction:
        """Return one that has come so far, after which nothing is known to have left."""
        transaction = Transaction(self.port, 1, 1, PDU, 0)
        if phase is Phase.PREREQUISITE:
            transaction.need(read_word(Axis(axis_plan()), 0x10))
            self.send(transaction, Step.ADDED_FRAME)
        elif phase is Phase.LEAVING:
            self.transactions.begin(transaction)
        elif phase is Phase.SENT:
            self.send(transaction, Step.FRAME)
        elif phase is Phase.ENDED:
            self.transactions.go_on(transaction, Outcome.NEVER_SENT)
        assert transaction.phase is phase
        self.link.sent.clear()
        return transaction

    def a_stop(self, stopping: Stopping) -> Transaction:
        """Return a stop that has come so far."""
        stop = self.a_transaction()
        if stopping is Stopping.ONCE:
            self.transactions.stop_goes_on(stop, StopEvent.FOUND_WITH_MORE)
        elif stopping is not Stopping.NO:
            self.transactions.stop_goes_on(stop, StopEvent.FOUND)
        if stopping is Stopping.EARLY:
            self.transactions.stop_goes_on(stop, StopEvent.LEAVES_EARLY)
        elif stopping is Stopping.AGAIN:
            again = self.transactions.once_more(stop)
            assert again is not None
            stop = again
        assert stop.stopping is stopping
        return stop


def step_of(name: str) -> Step | Outcome:
    """Return what a row is called."""
    return Step(name) if name in {each.value for each in Step} else Outcome(name)


def take(line: Line, transaction: Transaction, event: Step | Outcome) -> bool:
    """Take a step as the line does."""
    if event is Step.BEGINS:
        return line.transactions.begin(transaction)
    if event is Step.LAST_PIECE and transaction.phase is Phase.LEAVING:
        line.send(transaction, Step.PIECE)
    if isinstance(event, Step) and event in SENDS:
        return line.send(transaction, event)
    return line.transactions.go_on(transaction, event)


@pytest.mark.parametrize(("cell", "after"), walk(PHASE_WALK).items(), ids=str)
def test_a_transaction_goes_on_as_the_table_says(cell: tuple[str, str], after: str) -> None:
    phase, event = Phase(cell[0]), step_of(cell[1])
    line = Line()
    transaction = line.a_transaction(phase)
    begun = line.left()
    if after == "x":
        assert event not in PHASE_AFTER[phase]
        with pytest.raises(ImpossibleEventError, match=f"transaction: {cell[1]} cannot be in {cell[0]}"):
            take(line, transaction, event)
        assert transaction.phase is phase
        assert line.left() == begun
        return
    assert PHASE_AFTER[phase][event] is Phase(after)
    assert take(line, transaction, event)
    assert transaction.phase is Phase(after)
    assert (line.left() != begun) is (event in SENDS)


def test_the_tables_have_no_other_rows() -> None:
    phases, stops = walk(PHASE_WALK), walk(STOP_WALK)
    found = {
        (phase.value, event.value): then.value
        for phase, row in PHASE_AFTER.items()
        for event, then in row.items()
    }
    assert found == {cell: after for cell, after in phases.items() if after != "x"}
    found = {
        (state.value, event.value): "." if then is None else then.value
        for state, row in STOP_AFTER.items()
        for event, then in row.items()
    }
    assert found == {cell: after for cell, after in stops.items() if after != "x"}
    assert set(phases) == {(p.value, e.value) for p in Phase for e in (*Step, *Outcome)}
    assert set(stops) == {(s.value, e.value) for s in Stopping for e in StopEvent}


def test_what_leaves_in_pieces_leaves_once_and_has_its_deadline_elsewhere_before() -> None:
    line = Line()
    transaction = line.a_transaction()
    transaction.arrived_ns = 5 * MS
    assert line.transactions.begin(transaction)
    assert (line.left(), line.transactions.current) == ([], transaction)
    assert line.send(transaction, Step.PIECE, 6 * MS)
    assert (transaction.sent_ns, transaction.deadline_ns) == (5 * MS, NEVER_NS)
    assert line.send(transaction, Step.LAST_PIECE, 7 * MS)
    assert (transaction.sent_ns, transaction.deadline_ns) == (7 * MS, 8 * MS)
    assert line.link.sent == [(1, PDU)]


@pytest.mark.parametrize(("cell", "after"), walk(STOP_WALK).items(), ids=str)
def test_a_stop_leaves_early_once_and_once_more_at_most(cell: tuple[str, str], after: str) -> None:
    stopping, event = Stopping(cell[0]), StopEvent(cell[1])
    line = Line()
    waited = line.a_stop(Stopping.AGAIN)
    stop = line.a_stop(stopping)

    def step() -> Transaction | None:
        if event is StopEvent.GOES_AGAIN:
            return line.transactions.once_more(stop)
        if event is StopEvent.REPLACES:
            line.transactions.replace(waited, stop)
        else:
            line.transactions.stop_goes_on(stop, event)
        return None

    if after == "x":
        with pytest.raises(ImpossibleEventError, match=f"stop: {event.value} cannot be in {stopping.value}"):
            step()
        assert stop.stopping is stopping
        return
    again = step()
    if event is StopEvent.GOES_AGAIN:
        assert again is not None
        assert (again.phase, again.stopping) == (Phase.WAITING, Stopping(after))
        assert (again.unit_id, again.pdu, again.port) == (stop.unit_id, stop.pdu, stop.port)
        assert (again is not stop, stop.stopping) == (True, stopping)
    else:
        assert stop.stopping is (stopping if after == "." else Stopping(after))


def test_a_stop_that_replaces_one_that_waits_for_nothing_is_as_it_came() -> None:
    line = Line()
    stop = line.a_stop(Stopping.FIRST)
    line.transactions.replace(line.a_stop(Stopping.FIRST), stop)
    assert stop.stopping is Stopping.FIRST


def test_no_way_leads_to_sending_twice() -> None:
    """Walked to the end: on each way from the arrival its own frame leaves once at most."""
    ways: list[tuple[Step | Outcome, ...]] = [()]
    reached: dict[tuple[Step | Outcome, ...], Phase] = {(): Phase.WAITING}
    own = {Step.FRAME, Step.LAST_PIECE}
    for _ in range(7):
        longer = []
        for way in ways:
            for event, then in PHASE_AFTER[reached[way]].items():
                longer.append((*way, event))
                reached[longer[-1]] = then
        ways = longer
    for way, phase in reached.items():
        sent = [event for event in way if event in own]
        assert len(sent) <= 1
        if sent:
            assert phase in {Phase.SENT, Phase.ENDED}
            assert not set(way[way.index(sent[0]) + 1 :]) & set(SENDS)
        for before, event in pairwise(way):
            assert event is not Step.LAST_PIECE or before in {Step.BEGINS, Step.PIECE}


# --- what cannot be, in production -------------------------------------------------------------------------


@pytest.mark.usefixtures("in_production")
@pytest.mark.parametrize(("phase", "step"), list(product(Phase, SENDS)), ids=str)
def test_what_may_not_leave_does_not_leave_in_production_and_is_told(phase: Phase, step: Step) -> None:
    if step in PHASE_AFTER[phase]:
        return
    line = Line()
    transaction = line.a_transaction(phase)
    begun = line.left()
    assert not line.send(transaction, step)
    assert (line.left(), transaction.phase) == (begun, phase)
    [event] = line.events
    assert (event.kind, event.axis) == (exchange_events.INTERNAL_FAULT, None)
    assert event.detail == f"transaction: {step.value} cannot be in {phase.value}"
    assert line.counters.internal_faults == 1


@pytest.mark.usefixtures("in_production")
@pytest.mark.parametrize("stopping", [Stopping.NO, Stopping.ONCE])
def test_only_what_does_nothing_but_stop_leaves_a_second_time(stopping: Stopping) -> None:
    line = Line()
    assert line.transactions.once_more(line.a_stop(stopping)) is None
    assert [each.detail for each in line.events] == [f"stop: goes-again cannot be in {stopping.value}"]
    line.transactions.stop_goes_on(stop := line.a_stop(Stopping.EARLY), StopEvent.LEAVES_EARLY)
    assert stop.stopping is Stopping.EARLY
    assert line.counters.internal_faults == 2


@pytest.mark.usefixtures("in_production")
@pytest.mark.parametrize(("phase", "outcome"), list(product(Phase, Outcome)), ids=str)
def test_what_ends_in_a_way_that_cannot_be_ends_once_and_is_told(phase: Phase, outcome: Outcome) -> None:
    line = Line()
    transaction = line.a_transaction(phase)
    code = 0x0B
    line.transactions.finish(transaction, outcome, 2 * MS, code=code)
    line.transactions.finish(transaction, Outcome.NO_REPLY, 2 * MS, code=code)
    assert transaction.phase is Phase.ENDED
    faults = 1 + (outcome not in PHASE_AFTER[phase])
    assert line.counters.internal_faults == faults
    assert [each.kind for each in line.events] == [exchange_events.INTERNAL_FAULT] * faults


@pytest.mark.usefixtures("in_production")
def test_a_line_that_would_send_a_request_twice_does_not_tells_it_and_goes_on() -> None:
    bench = Bench(axis_plan())
    bench.events.clear()
    bench.line.request(bench.port, 1, 1, PDU, bench.now_ns)
    sent = bench.line._transactions.current
    assert sent is not None
    assert bench.link.sent == [(1, PDU)]
    bench.line._put_on_wire(sent, PDU, 1, bench.now_ns)
    assert bench.link.sent == [(1, PDU)]
    assert [each.detail for each in bench.events] == ["transaction: frame cannot be in sent"]
    bench.line.reply(1, b"\x03\x02\0\x07", bench.now_ns + MS)
    assert bench.port.take() == b"\x03\x02\0\x07"
    bench.line._put_on_wire(sent, PDU, 1, bench.now_ns + MS)
    assert (bench.link.sent, bench.line.is_idle) == ([(1, PDU)], True)
    assert bench.line.counters.internal_faults == 2
