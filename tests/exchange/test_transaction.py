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
    outcome_of_reply,
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
    assert transaction.phase is Phase.ENDED
    line.transactions.finish(transaction, Outcome.NO_REPLY, 2 * MS, code=code)
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
    bench.line._turn.put_on_wire(sent, PDU, 1, bench.now_ns)
    assert bench.link.sent == [(1, PDU)]
    assert [each.detail for each in bench.events] == ["transaction: frame cannot be in sent"]
    bench.line.reply(1, b"\x03\x02\0\x07", bench.now_ns + MS)
    assert bench.port.take() == b"\x03\x02\0\x07"
    bench.line._turn.put_on_wire(sent, PDU, 1, bench.now_ns + MS)
    assert (bench.link.sent, bench.line.is_idle) == ([(1, PDU)], True)
    assert bench.line.counters.internal_faults == 2


# --- what its controller and the drive are told ------------------------------------------------------------


def test_a_transaction_that_was_not_sent_is_on_the_wire_to_its_own_unit() -> None:
    assert Transaction(Port(ControllerPlan("cnc")), 1, 5, PDU, 0).wire_unit_id == 5


def test_the_content_is_parsed_once_and_anew_when_a_forwarded_request_is_whole() -> None:
    line = Line()
    transaction = line.a_transaction(Phase.LEAVING)
    transaction.set_frames(())
    assert transaction.frames == ()
    line.transactions.come_whole(transaction, line.port, PDU, 5)
    assert transaction.frames is None


def test_what_its_controller_gave_up_on_is_given_up_but_not_a_stop() -> None:
    line = Line()
    request, stop = line.a_transaction(), line.a_stop(Stopping.FIRST)
    assert (request.why_given_up(1), stop.why_given_up(1)) == ("", "")
    request.give_up()
    stop.give_up()
    assert (request.why_given_up(1), stop.why_given_up(1)) == ("its controller gave up on it", "")


@pytest.mark.parametrize("is_asked_for", [False, True])
def test_the_time_of_added_frames_is_apart_from_that_in_the_queue(is_asked_for: bool) -> None:
    transaction = Line().a_transaction()
    if is_asked_for:
        transaction.knowledge()
    transaction.start(7)
    assert (transaction.queue_ns, transaction.added_ns) == ((0, 7) if is_asked_for else (7, 0))


def test_a_refusal_reaches_a_controller_on_a_serial_line_with_any_code() -> None:
    """Only where the unit may not be spoken to a serial line stays silent (W7)."""
    for end in ("refuse", "overtaken", "refuse_absent"):
        line = Line()
        port = line.port = Port(ControllerPlan("cnc", serial=True))
        transaction = line.a_transaction()
        if end == "refuse":
            line.transactions.refuse(transaction, 0x0A, 1)
        elif end == "overtaken":
            line.transactions.overtaken(transaction, "why", 1)
        else:
            line.transactions.refuse_absent(transaction, 1)
        replies = {"refuse": b"\x83\x0a", "overtaken": b"\x83\x06"}
        assert [pdu for _, _, pdu in port.replies] == ([replies[end]] if end in replies else [])


def test_what_never_left_ends_without_an_answer() -> None:
    line = Line()
    transaction = line.a_transaction(Phase.LEAVING)
    line.transactions.never_left(transaction, 1)
    assert transaction.phase is Phase.ENDED
    assert line.port.replies == []


def test_what_was_withdrawn_is_counted_and_reported_once_a_second() -> None:
    line = Line()
    for at_ns in (1, 2):
        line.transactions.withdraw(line.a_transaction(), "it is late", at_ns)
    line.transactions.withdraw(Transaction(None, 0, 1, PDU, 0), "it is late", 3)  # of the gateway itself
    assert line.counters.withdrawn == 3
    [event] = line.events
    assert event.kind is exchange_events.WITHDRAWN
    assert event.detail == "a request of cnc was not sent: it is late"


@pytest.mark.parametrize(
    ("reply", "found"),
    [(b"\x83\x02", (Outcome.EXCEPTION, 2)), (b"\x03\x02\0\0", (Outcome.ACKNOWLEDGED, 0))],
)
def test_without_mapped_content_an_exception_is_the_only_refusal(
    reply: bytes, found: tuple[Outcome, int]
) -> None:
    assert outcome_of_reply(Line().a_transaction(Phase.SENT), reply) == found
