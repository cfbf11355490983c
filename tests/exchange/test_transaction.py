"""A transaction from its arrival to its end: each step in each phase, and its effect on its axis (M7)."""

from itertools import pairwise, product
from typing import Any, Final

import pytest

from gateway.catalogue import exchange_events
from gateway.drives.motion import Action, ModePlan, MotionPlan
from gateway.exchange.access import Access
from gateway.exchange.added_frames import read_word
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.impossible import ImpossibleEventError
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.axis.reference import ReferenceState
from gateway.exchange.counters import LineCounters
from gateway.exchange.decode import AxisCommand, DecodedRequest, Part, Staging
from gateway.exchange.effects import leave
from gateway.exchange.events import Event
from gateway.exchange.plan import CompensationMode, ControllerPlan, Reference
from gateway.exchange.request import NOTHING_PREFETCHED, Request
from gateway.exchange.transaction import (
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
from gateway.exchange.unit import FieldHit, UnitMap
from gateway.modbus.registers import BitField
from gateway.times import NEVER_NS
from tests.exchange.axis_bench import WRITE, an_axis, end, kinds, reached, see, target
from tests.exchange.line_bench import COMMAND, MS, Bench, Link, Port, axis_plan, write
from tests.exchange.staged_bench import RUN_PDU, StagedBench
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
    """The transactions of a line, and the sent frames."""

    def __init__(self) -> None:
        self.link = Link()
        self.events: list[Event] = []
        self.counters = LineCounters()
        self.transactions = Transactions(
            self.counters, self.events.append, lambda *_: None, lambda _: None, self.link
        )
        self.port = Port(ControllerPlan("cnc"))

    def send(self, transaction: Transaction, step: Step, at_ns: int = 1) -> bool:
        """Send as much of it as the step does."""
        piece = {Step.PIECE: PIECE, Step.LAST_PIECE: REST}.get(step, b"")
        return self.transactions.send(transaction, step, 1, PDU, at_ns, patience_ns=MS, piece=piece)

    def left(self) -> list[bytes]:
        """Return the bytes and requests sent so far."""
        return [
            *(pdu for _, pdu in self.link.sent),
            *([self.link.left_early] if self.link.left_early else []),
        ]

    def a_transaction(self, phase: Phase = Phase.WAITING) -> Transaction:
        """Return a transaction in a phase; the frames sent for it are forgotten."""
        transaction = Transaction(self.port, 1, 1, PDU, 0)
        if phase is Phase.PREREQUISITE:
            transaction.added = read_word(Axis(axis_plan()), 0x10)
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
        """Return a stop in the given state."""
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
    """Return the step or outcome of a row by its name."""
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
def test_each_step_of_a_transaction_leads_where_the_table_says(cell: tuple[str, str], after: str) -> None:
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


def test_a_request_sent_in_pieces_is_sent_once_and_gets_its_deadline_with_the_last_piece() -> None:
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
def test_a_stop_is_sent_early_once_and_once_more_at_most(cell: tuple[str, str], after: str) -> None:
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


def test_a_stop_that_replaces_one_that_was_not_sent_yet_stays_a_first_one() -> None:
    line = Line()
    stop = line.a_stop(Stopping.FIRST)
    line.transactions.replace(line.a_stop(Stopping.FIRST), stop)
    assert stop.stopping is Stopping.FIRST


def test_no_sequence_of_steps_sends_a_request_twice() -> None:
    """All sequences of steps from the arrival to the end: its own frame is sent once at most in each."""
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


# --- impossible events in production -----------------------------------------------------------------------


@pytest.mark.usefixtures("in_production")
@pytest.mark.parametrize(("phase", "step"), list(product(Phase, SENDS)), ids=str)
def test_a_request_that_may_not_be_sent_is_not_sent_in_production_and_is_reported(
    phase: Phase, step: Step
) -> None:
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
def test_only_a_pure_stop_is_sent_a_second_time(stopping: Stopping) -> None:
    line = Line()
    assert line.transactions.once_more(line.a_stop(stopping)) is None
    assert [each.detail for each in line.events] == [f"stop: goes-again cannot be in {stopping.value}"]
    line.transactions.stop_goes_on(stop := line.a_stop(Stopping.EARLY), StopEvent.LEAVES_EARLY)
    assert stop.stopping is Stopping.EARLY
    assert line.counters.internal_faults == 2


@pytest.mark.usefixtures("in_production")
@pytest.mark.parametrize(("phase", "outcome"), list(product(Phase, Outcome)), ids=str)
def test_a_transaction_with_an_impossible_end_ends_once_and_is_reported(
    phase: Phase, outcome: Outcome
) -> None:
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
def test_m3_a_target_that_was_sent_is_lost_if_its_end_is_impossible() -> None:
    """The drive may hold it or not, so its trigger is refused."""
    bench = StagedBench()
    bench.send(write(COMMAND, 50_000))
    sent = bench.line._transactions.free_wire()
    assert sent is not None
    assert bench.link.take() == write(COMMAND, 50_000)
    bench.line._transactions.finish(sent, Outcome.NEVER_SENT, bench.now_ns, code=0x0B)
    assert bench.kinds()[-1] == "internal-fault"
    assert bench.ask(RUN_PDU) == bytes.fromhex("86 0B")


@pytest.mark.usefixtures("in_production")
def test_a_line_that_would_send_a_request_twice_reports_it_and_continues() -> None:
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


# --- replies to the controller and frames to the drive -----------------------------------------------------


def test_a_transaction_that_was_not_sent_is_on_the_wire_to_its_own_unit() -> None:
    assert Transaction(Port(ControllerPlan("cnc")), 1, 5, PDU, 0).wire_unit_id == 5


def test_the_content_is_parsed_again_when_a_forwarded_request_is_whole() -> None:
    line = Line()
    transaction = line.a_transaction(Phase.LEAVING)
    transaction.frames = ()
    assert transaction.frames == ()
    line.transactions.come_whole(transaction, line.port, PDU, 5)
    assert transaction.frames is None


def test_a_request_is_given_up_with_its_controller_but_not_a_stop() -> None:
    line = Line()
    request, stop = line.a_transaction(), line.a_stop(Stopping.FIRST)
    assert (request.why_given_up(1), stop.why_given_up(1)) == ("", "")
    request.give_up()
    stop.give_up()
    assert (request.why_given_up(1), stop.why_given_up(1)) == ("its controller gave up on it", "")


@pytest.mark.parametrize("is_asked_for", [False, True])
def test_the_time_of_added_frames_is_counted_separately_from_that_in_the_queue(is_asked_for: bool) -> None:
    transaction = Line().a_transaction()
    if is_asked_for:
        transaction.knowledge()
    transaction.start(7)
    assert (transaction.queue_ns, transaction.added_ns) == ((0, 7) if is_asked_for else (7, 0))


def test_a_refusal_reaches_a_controller_on_a_serial_line_with_any_code() -> None:
    """A serial line stays silent only if the controller has no right to the unit (W7)."""
    for ended in ("refuse", "overtaken", "refuse_absent"):
        line = Line()
        port = line.port = Port(ControllerPlan("cnc", serial=True))
        transaction = line.a_transaction()
        if ended == "refuse":
            line.transactions.refuse(transaction, 0x0A, 1)
        elif ended == "overtaken":
            line.transactions.overtaken(transaction, "why", 1)
        else:
            line.transactions.refuse_absent(transaction, 1)
        replies = {"refuse": b"\x83\x0a", "overtaken": b"\x83\x06"}
        assert [pdu for _, _, pdu in port.replies] == ([replies[ended]] if ended in replies else [])


def test_a_request_that_was_never_sent_whole_ends_without_an_answer() -> None:
    line = Line()
    transaction = line.a_transaction(Phase.LEAVING)
    line.transactions.never_left(transaction, 1)
    assert transaction.phase is Phase.ENDED
    assert line.port.replies == []


def test_withdrawn_requests_are_counted_and_reported_once_a_second() -> None:
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


# === effects of its end on its axis: what is proven, and what stays open =================================

NOMINAL: Final = COMMAND.pack(50_000)
CORRECTED: Final = COMMAND.pack(50_010)
MODE: Final = 0x32
STAGED: Final = MotionPlan(is_staged=True, modes=(ModePlan(MODE, actions={1: Action.ABSOLUTE}),))
ACK, REFUSED, SILENT, BROADCAST = Outcome.ACKNOWLEDGED, Outcome.EXCEPTION, Outcome.NO_REPLY, Outcome.BROADCAST
OPEN: Final = (SILENT, BROADCAST, Outcome.OTHER_REPLY)


def writes(axis: Axis, action: Action = Action.IGNORE, **changes: Any) -> AxisCommand:
    """A command that writes the command field of the axis."""
    unit = UnitMap([axis])
    hits: tuple[FieldHit, ...] = unit.written(COMMAND.address, 2).by_axis[0].commands
    return AxisCommand(axis, action, 0, hits, **changes)


# --- when it is sent ---------------------------------------------------------------------------------------


def test_a_frame_of_unknown_meaning_is_reported_with_the_mode_that_is_known() -> None:
    axis = an_axis(motion=STAGED)
    axis.rules.store_read(MODE, 9)
    command = AxisCommand(axis, Action.UNKNOWN, 0, words={0x30: 7})
    frame = DecodedRequest(
        UnitMap([axis]), WRITE, Access(write_address=COMMAND.address, write_quantity=2), {}
    )
    assert leave(Request(frame, [command], NOTHING_PREFETCHED, 0, arrived_ns=0), 1 * MS) == 1
    [event] = axis.take_events()
    assert event.kind.name == "unknown-mode"
    assert "0x0030 = 0x0007, 0x0032 = 0x0009" in event.detail


# --- when it was obeyed ------------------------------------------------------------------------------------


def test_the_beginning_of_a_stream_is_reported_when_its_first_setpoint_is_acknowledged() -> None:
    axis = an_axis()
    axis.reports.begin_stream(0.5, 0.0)
    command = AxisCommand(axis, Action.ABSOLUTE, 0)
    command.targets.append(target(axis, 50_000))
    end(command, SILENT, 0x0B, 1 * MS)
    assert "stream-began" not in kinds(axis)
    end(command, ACK, 0, 2 * MS)
    assert "stream-began" in kinds(axis)


def test_acknowledged_registers_and_coils_are_known() -> None:
    axis = an_axis(motion=STAGED)
    axis.rules.store_read(0x31, 5)
    end(AxisCommand(axis, words={MODE: 1}, coils={0x40: 1}, unclear_words=frozenset({0x31})), ACK, 0, 1 * MS)
    assert (axis.rules.word(MODE), axis.rules.coil(0x40), axis.rules.word(0x31)) == (1, 1, None)


@pytest.mark.parametrize("outcome", OPEN)
def test_registers_and_coils_are_unknown_if_the_drive_may_have_taken_them(outcome: Outcome) -> None:
    axis = an_axis(motion=STAGED)
    axis.rules.store_words({MODE: 1, 0x31: 5}, 0)
    axis.rules.store_coils({0x40: 1})
    command = AxisCommand(axis, words={MODE: 2}, coils={0x40: 0}, unclear_words=frozenset({0x31}))
    end(command, outcome, 0x0B, 1 * MS)
    assert (axis.rules.word(MODE), axis.rules.coil(0x40), axis.rules.word(0x31)) == (None, None, None)


def test_registers_and_coils_are_unchanged_if_an_exception_proves_it() -> None:
    """Code 1: the drive does not know the function."""
    axis = an_axis(motion=STAGED)
    axis.rules.store_words({MODE: 1}, 0)
    end(AxisCommand(axis, Action.OTHER_MOTION, words={MODE: 2}), REFUSED, 1, 1 * MS)
    assert axis.rules.word(MODE) == 1
    axis = reached("arrived")
    end(AxisCommand(axis, Action.OTHER_MOTION), REFUSED, 1, 2 * MS)
    assert axis.motion.state is MotionState.ARRIVED


def test_a_run_ends_a_homing_and_marks_the_staged_target_as_run() -> None:
    axis = an_axis(referenced=Reference.HOMING, bits={"homed": BitField(0x30, 3)}, motion=STAGED)
    axis.begin_homing(1 * MS, is_certain=True)
    axis.targets.mark_staged()
    end(AxisCommand(axis, Action.RELATIVE, 0), ACK, 0, 2 * MS)
    assert axis.reference.state is ReferenceState.NOT_REFERENCED
    assert not axis.targets.holds_unrun
    assert axis.targets.last_run is Action.RELATIVE


@pytest.mark.parametrize("outcome", [ACK, SILENT])
@pytest.mark.parametrize(
    ("action", "passes", "is_unsure"),
    [(Action.STORED, False, True), (Action.STORED, True, False), (Action.OTHER_MOTION, False, False)],
)
def test_an_axis_is_unsure_after_a_stored_position(
    outcome: Outcome, action: Action, passes: bool, is_unsure: bool
) -> None:
    bench = Bench(axis_plan(compensation=CompensationMode.SHADOW if passes else CompensationMode.ON))
    bench.move(20_000, 50_000)
    [axis] = bench.line.axes
    was_unsure = [axis.compensation.is_unsure]
    end(AxisCommand(axis, action), outcome, 0x0B, bench.now_ns)
    was_unsure.append(axis.compensation.is_unsure)
    assert was_unsure == [False, is_unsure]


@pytest.mark.parametrize("outcome", [ACK, SILENT])
@pytest.mark.parametrize(("mode", "is_unsure"), [(CompensationMode.ON, True), (CompensationMode.OFF, False)])
def test_an_axis_is_unsure_after_a_run_of_uncorrected_words(
    outcome: Outcome, mode: CompensationMode, is_unsure: bool
) -> None:
    axis = an_axis(compensation=mode)
    see(axis, 20_000)
    was_unsure = axis.compensation.is_unsure
    command = AxisCommand(axis)
    command.run_uncorrected()
    end(command, outcome, 0x0B, 2 * MS)
    assert axis.motion.state is MotionState.UNKNOWN
    assert axis.compensation.is_unsure is (was_unsure or is_unsure)


def test_an_axis_with_an_unknown_motion_of_corrected_words_keeps_its_branch() -> None:
    axis = reached("arrived")
    was_unsure = axis.compensation.is_unsure
    command = AxisCommand(axis)
    command.go_anywhere()
    end(command, ACK, 0, 2 * MS)
    assert axis.motion.state is MotionState.UNKNOWN
    assert axis.compensation.is_unsure is was_unsure


@pytest.mark.parametrize("outcome", [ACK, SILENT])
@pytest.mark.parametrize("is_incomplete", [False, True])
def test_a_field_with_untracked_words_is_unknown(outcome: Outcome, is_incomplete: bool) -> None:
    axis = reached("arrived")
    image = axis.fields[0]
    if is_incomplete:
        image.lose_all_words()
    epoch = image.epoch
    command = AxisCommand(axis)
    command.untracked.append(image)
    end(command, outcome, 0x0B, 2 * MS)
    assert image.nominal_words is None
    assert axis.motion.state is MotionState.UNKNOWN
    assert image.epoch == epoch + is_incomplete  # words that were lost before are older than these


# --- when it was not ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("outcome", OPEN)
def test_the_words_are_unknown_after_a_part_or_a_staged_target_without_an_answer(outcome: Outcome) -> None:
    axis = an_axis(motion=STAGED)
    image = axis.fields[0]
    image.settle(NOMINAL, NOMINAL)
    part = AxisCommand(axis)
    part.buffered_parts.append(Part(image, 0, NOMINAL[:2]))
    end(part, outcome, 0x0B, 1 * MS)
    assert (image.nominal_words, image.corrected_words) == (NOMINAL, None)
    staging = AxisCommand(axis)
    staging.stagings.append(Staging(image, NOMINAL, CORRECTED, image.epoch))
    end(staging, outcome, 0x0B, 2 * MS)
    assert image.nominal_words is None
    assert image.may_be_corrected


def test_the_words_are_unchanged_if_an_exception_proves_it() -> None:
    axis = an_axis(motion=STAGED)
    image = axis.fields[0]
    image.settle(NOMINAL, NOMINAL)
    command = AxisCommand(axis)
    command.buffered_parts.append(Part(image, 0, NOMINAL[:2]))
    command.stagings.append(Staging(image, NOMINAL, CORRECTED, image.epoch))
    end(command, REFUSED, 1, 1 * MS)
    assert (image.nominal_words, image.corrected_words) == (NOMINAL, NOMINAL)


@pytest.mark.parametrize("outcome", OPEN)
def test_a_motion_without_an_answer_may_have_begun(outcome: Outcome) -> None:
    axis = reached("arrived")
    end(AxisCommand(axis, Action.OTHER_MOTION), outcome, 0x0B, 2 * MS)
    assert axis.motion.state is MotionState.UNKNOWN
    staged = reached("arrived", an_axis(motion=STAGED))
    end(AxisCommand(staged, Action.ABSOLUTE, 0), outcome, 0x0B, 2 * MS)
    assert staged.motion.state is MotionState.UNKNOWN


@pytest.mark.parametrize(("outcome", "is_set"), [(ACK, True), (SILENT, False)])
def test_a_stop_that_sets_the_position_too_may_have_done_so(outcome: Outcome, is_set: bool) -> None:
    axis = an_axis(referenced=Reference.SET_POSITION)
    command = AxisCommand(axis, Action.STOP, sets_position_too=True)
    end(command, outcome, 0x0B, 2 * MS)
    assert axis.reference.is_referenced is is_set
    absolute = reached("arrived")
    end(AxisCommand(absolute, Action.STOP), outcome, 0x0B, 3 * MS)
    assert absolute.reference.is_referenced
    end(AxisCommand(absolute, Action.STOP, sets_position_too=True), outcome, 0x0B, 4 * MS)
    assert not absolute.reference.is_referenced


@pytest.mark.parametrize(
    ("outcome", "mode", "is_blocked"),
    [
        (SILENT, CompensationMode.ON, True),
        (SILENT, CompensationMode.OFF, True),
        (REFUSED, CompensationMode.ON, True),
        (REFUSED, CompensationMode.OFF, False),  # its controller knows, and no word of ours is in the drive
        (BROADCAST, CompensationMode.ON, False),
        (ACK, CompensationMode.ON, False),
    ],
)
def test_a_staged_target_that_was_lost_blocks_its_triggers(
    outcome: Outcome, mode: CompensationMode, is_blocked: bool
) -> None:
    axis = an_axis(motion=STAGED, compensation=mode)
    end(writes(axis), outcome, 4, 2 * MS)
    assert axis.interlock.is_blocked is is_blocked


def test_a_run_of_the_target_from_before_a_lost_link_keeps_it() -> None:
    axis = reached("out-of-reach", an_axis(motion=STAGED))
    same = target(axis, 50_000)._replace(move=None)
    for run, after in (
        (same, MotionState.SUPERSEDED),
        (same._replace(nominal_words=COMMAND.pack(1)), MotionState.UNKNOWN),
    ):
        command = AxisCommand(axis, Action.ABSOLUTE, 0)
        command.runs.append(run)
        end(command, ACK, 0, 9 * MS)
        assert axis.motion.state is after
