"""What must hold in every state and for every event; the numbers are those of docs/verify.md.

All arithmetic is the drive's own (``tests.verify.screw``). Where a rule excuses something, the excuse is a
reason that the gateway gives aloud: an axis that is flagged unsure, that is not referenced, that is off.
"""

from typing import TYPE_CHECKING, Any, Final

from gateway.catalogue import exchange_events
from gateway.drives.motion import NextTarget
from gateway.exchange.plan import Late, Role
from gateway.exchange.transaction import Phase, Stopping
from gateway.modbus.pdu import is_exception
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from gateway.times import NS_PER_MS, NS_PER_S
from tests.exchange.line_bench import ACTUAL, COMMAND, write
from tests.exchange.staged_bench import COMMANDED, JOG, MODE, RUN, RUN_RELATIVE, STATUS, STOP, STORED, TRIGGER
from tests.verify import facts, gantries
from tests.verify.errors import BrokenRuleError

if TYPE_CHECKING:
    from tests.verify.snapshot import Said
    from tests.verify.world import Aim, Asked, Axis, Belief, Run, Side, Tried, Wire, World

ROUNDING: Final = 0.5 + 1e-6
ONE: Final = 1.0 + 1e-6
"""These two are in steps of a register."""
SLOPE_COUNTS: Final = 3.0
"""What rounding on two scales and an inverse on a steep slope may put a reading beside the branches."""
PASSING: Final = frozenset({"unreferenced", "off", "no-table", "shadow"})
"""States in which positions go through 1:1 (M9)."""
PASSED_STORED: Final = "no-table"
"""What a position that the drive keeps is run as, where its map lets it pass: 1:1."""
NEVER_WRITTEN: Final = 3
"""Both words, and neither was lost on its way (``Belief.lost``)."""
NEAR_COUNTS: Final = 100
UNWRITTEN: Final = 8
"""Of what was lost of a target: a word was refused, with proof that nothing was written."""
"""Beside a target by less than any correction is long (M6)."""
CORRECTION_COUNTS: Final = 350
"""No table of the worlds adds more."""
STOP_TICKS: Final = 12
OLD_TICKS: Final = 3
"""A word that was lost so long ago belongs to no word that comes now: 200 ms."""
PATIENCE_TICKS: Final = 1
"""So long a controller waits for an answer."""
MOST_UNASKED: Final = 2
"""So many reads are answered in one silence, and not sent."""
LIMIT: Final = PositionField(0x0610, RegisterType.INT32, WordOrder.LOW_FIRST)
"""A position that the drive compares its own with."""
LIMIT_COUNTS: Final = 9507
WARM: Final = 2
"""Number of the screw that is warm, or beside which another axis stands, where the axis has such a term."""
NO_PATH: Final = 0x0A
NO_ANSWER: Final = 0x0B
LOST: Final = 4
BUSY: Final = 6
MASK: Final = 0x16
BOTH: Final = 0x17
"""Writes, and then reads."""
LOOKS: Final = (
    b"\x03" + STATUS.to_bytes(2, "big") + b"\x00\x01",
    b"\x03" + ACTUAL.address.to_bytes(2, "big") + b"\x00\x02",
)
"""What the gateway reads by itself behind a restart."""
READABLE: Final = frozenset(
    {(ACTUAL.address, 2), (COMMAND.address, 2), (COMMANDED.address, 2), (STATUS, 1), (TRIGGER, 1), (MODE, 1)}
)
STOP_PDU: Final = b"\x06" + TRIGGER.to_bytes(2, "big") + STOP.to_bytes(2, "big")
RUN_PDU: Final = b"\x06" + TRIGGER.to_bytes(2, "big") + RUN.to_bytes(2, "big")
RELATIVE_PDU: Final = b"\x06" + TRIGGER.to_bytes(2, "big") + RUN_RELATIVE.to_bytes(2, "big")
ODD_PDUS: Final = frozenset(RUN_PDU[:3] + value.to_bytes(2, "big") for value in (JOG, STORED, 999))
"""What makes an axis move in another way than to a target."""
COIL_RUN_PDU: Final = b"\x05" + TRIGGER.to_bytes(2, "big") + b"\xff\0"
COIL_IDLE_PDU: Final = b"\x05" + TRIGGER.to_bytes(2, "big") + b"\0\0"
MODE_HEAD: Final = b"\x06" + MODE.to_bytes(2, "big")
RUNS: Final = frozenset({RUN_PDU, RELATIVE_PDU, COIL_RUN_PDU})
ENDS: Final = frozenset({COMMAND.address, COMMAND.address + 1})


def is_stop(pdu: bytes) -> bool:
    """Whether a request stops the axis."""
    return pdu == STOP_PDU


def runs_distance(world: "World", number: int, pdu: bytes) -> bool:
    """Whether a request makes an axis go a distance, as its mode register stands."""
    runs = pdu == RUN_PDU or (writes_target(pdu) and not world.design.is_staged)
    return pdu == RELATIVE_PDU or (runs and world.state.axes[number].mode == 2)


def writes_target(pdu: bytes) -> bool:
    """Whether a request writes a word of the target."""
    return pdu[0] in (6, 16, MASK, BOTH) and written_at(pdu) in ENDS


def written_at(pdu: bytes) -> int:
    """Return the first register that a request writes."""
    return pdu[5] << 8 | pdu[6] if pdu[0] == BOTH else pdu[1] << 8 | pdu[2]


def words_written(pdu: bytes) -> bytes:
    """Return the words that a request writes which lays no mask."""
    return pdu[10:] if pdu[0] == BOTH else pdu[6:] if pdu[0] == 16 else pdu[3:5]


def masked(word: bytes, pdu: bytes) -> bytes:
    """Return what a mask makes of a word."""
    keep, put = pdu[3] << 8 | pdu[4], pdu[5] << 8 | pdu[6]
    return (((word[0] << 8 | word[1]) & keep) | (put & ~keep)).to_bytes(2, "big")


# --- frames that leave --------------------------------------------------------------------------------


def judge_frame(world: "World", unit_id: int, pdu: bytes, stopping: Stopping = Stopping.NO) -> "Wire":
    """Find out why a frame has left (2). Raises BrokenRuleError.

    ``stopping``: of the same stop, asked for twice, one may go once more and the other for the first time.
    """
    from tests.verify.world import Wire

    number = facts.number_of(world, unit_id)
    unsent = (find(world, *each) for each in world.state.order)
    turn = next((each.axis for each in unsent if not each.is_sent), None)
    if world.design.groups and turn is not None:
        _break_off_silent(world, turn)
    state = world.state
    asked_for = [each for own in state.asked for each in own if each.pdu == pdu and not each.is_sent]
    twice = len({each.goes_again for each in asked_for}) > 1
    firsts = dict.fromkeys(Role, True)  # all but stops leave in the order in which they came, by role
    plans = world.design.controllers
    for port, transaction_id in sorted(state.order, key=lambda each: plans[each[0]].role is Role.MONITOR):
        request, plan = find(world, port, transaction_id), plans[port]
        is_stopping = is_stop(request.pdu)
        rights = plan.rights  # for who has none nothing leaves (W9)
        has_none = rights.is_read_only or (bool(rights.unit_ids) and unit_id not in rights.unit_ids)
        has_none |= plan.role is Role.MONITOR and request.pdu[0] != 3
        if request.is_sent or has_none or not (is_stopping or firsts[plan.role]):
            continue
        firsts[plan.role] &= is_stopping
        if is_stopping and request.goes_again is not (stopping is Stopping.AGAIN) and twice:
            continue
        if request.axis == number and _is_frame_of(pdu, request.pdu):
            if stopping is Stopping.AGAIN and not (request.goes_again or state.owed_stops):
                raise BrokenRuleError("a stop is sent for the first time, and as one that goes again (M3)")
            return _sent(world, port, request, unit_id, pdu)
    if is_stop(pdu) and state.owed_stops:
        world.state = state._replace(owed_stops=state.owed_stops - 1)
    elif pdu[0] == 3:
        _judge_own_read(world, number, pdu)
    else:
        _judge_restaging(world, number, pdu)
    return Wire(unit_id, pdu, -1, 0, None)


def _break_off_silent(world: "World", number: int) -> None:
    """A drive of a beam whose turn has come was silent so long that nobody knows it any more (M11)."""
    if facts.was_out_of_reach(world, number):
        gantries.broken_off(world)


def _sent(world: "World", port: int, request: "Asked", unit_id: int, pdu: bytes) -> "Wire":
    """Judge a frame that a controller has asked for."""
    from tests.verify.world import Wire

    number = request.axis
    if is_stop(pdu):
        world.tally.stop_ticks = max(world.tally.stop_ticks, request.ticks)
        if request.ticks > STOP_TICKS:
            raise BrokenRuleError(f"a stop had to wait for {request.ticks} ticks (2)")
    elif _is_late(world, request) and world.design.plans[number].late is Late.REJECT:
        raise BrokenRuleError(f"sent, and it is late: {pdu.hex(' ')} (2)")
    elif request.is_owed and pdu[0] != 3 and 2 * request.ticks > PATIENCE_TICKS and not world.design.retry_ms:
        raise BrokenRuleError(f"sent too late behind the silence of its own drive: {pdu.hex(' ')} (2, W6)")
    elif request.ticks > PATIENCE_TICKS:
        raise BrokenRuleError(f"sent after its controller had given it up: {pdu.hex(' ')} (2, W5)")
    reads_place = pdu[0] == 3 and (pdu[1] << 8 | pdu[2], 2) in READABLE
    moves_or_reads = pdu in RUNS or writes_target(pdu) or reads_place
    if facts.is_other_motion(pdu):
        gantries.broken_off(world)
    moves_or_reads &= not gantries.is_fixed(world)
    if moves_or_reads and not request.is_bit_asked and facts.has_to_ask(world, number, is_target=pdu[0] != 3):
        raise BrokenRuleError(
            f"sent before the bit was read on which the reference hangs: {pdu.hex(' ')} (M9)"
        )
    if pdu[0] != 3:
        note_run(world, number, is_recalled=False)
    run = world.state.axes[number].run
    if world.design.is_stream and pdu[0] != 3 and run is not None and not run.is_told:
        note_run(world, number, is_set_out=False)
    _replace(world, port, request._replace(is_sent=True))
    belief = world.state.beliefs[port][number]
    is_half = writes_target(pdu) and len(request.pdu) == 5
    is_old = bool(belief.lost & 4 and belief.lost & _others(request.pdu))
    is_completed = is_half and pdu[0] == 16 and is_old
    if is_completed and belief.ticks - request.ticks >= OLD_TICKS:
        raise BrokenRuleError(f"a word is joined with one that was lost long ago: {pdu.hex(' ')} (4)")
    if pdu[0] in (6, 16) and _limit_hit(pdu):
        _judge_limit(world, number, pdu)
    aim = _aim(world, port, number, pdu, request)
    axis = world.state.axes[number]
    is_again = aim is not None and axis.run is not None and axis.run.nominal_counts == aim.nominal_counts
    if is_again and axis.is_owed_look:
        raise BrokenRuleError(
            f"its done bit has fallen, and nobody has looked where it is: {pdu.hex(' ')} (M4)"
        )
    if aim is not None and pdu not in RUNS:
        _note_tried(world, number, pdu, aim)
    return Wire(unit_id, pdu, port, request.transaction_id, aim, request.pdu)


def _limit_hit(pdu: bytes) -> bool:
    return written_at(pdu) in (LIMIT.address, LIMIT.address + 1)


def _note_limit(world: "World", number: int, told_counts: int | None) -> None:
    axes = list(world.state.axes)
    axes[number] = axes[number]._replace(told_limit_counts=told_counts)
    world.state = world.state._replace(axes=tuple(axes))


def _judge_limit(world: "World", number: int, pdu: bytes) -> None:
    """A limit leaves half-way between the branches, and whole (1, M1). Raises BrokenRuleError."""
    state = world.state
    if world.said(number).compensation in PASSING:
        return
    if pdu[0] == 6:
        raise BrokenRuleError(f"a part of a limit leaves alone: {pdu.hex(' ')} (M1)")
    half_way, found = sum(world.screws[state.table].corrected(LIMIT_COUNTS)) / 2, LIMIT.unpack(pdu[6:])
    if abs(found - half_way) > ROUNDING:
        raise BrokenRuleError(f"limit {LIMIT_COUNTS} becomes {found}: {half_way:.2f} would be right (1)")


def _is_late(world: "World", request: "Asked") -> bool:
    """Whether a request that moves an axis, or prepares to, has waited longer than its axis allows."""
    deadline_ns = world.design.plans[request.axis].deadline_ms * facts.MS
    is_move = request.pdu in RUNS or writes_target(request.pdu)
    return bool(deadline_ns) and is_move and request.ticks * world.tick_ns > deadline_ns


def run_pdu(world: "World", run: "Run | None") -> bytes:
    """Return the request that makes a drive go to the last target again, where writing it does."""
    return b"" if run is None else write(COMMAND, run.nominal_counts // world.design.step_counts)


def judge_phase(world: "World", wire: "Wire") -> None:
    """A request is where its frame is, and each moment that it was held up counts. BrokenRuleError."""
    found = world.on_its_way()
    if found is None:
        return
    if wire.owner >= 0:
        request = find(world, wire.owner, wire.transaction_id)
        if found.phase is not Phase.SENT or found.may_follow != {Phase.ENDED}:
            raise BrokenRuleError(f"a frame has left in phase {found.phase.value} (2)")
        # Requests that come at one instant are told apart by some ns; parts of one wait for no line.
        if (
            not world.design.is_bytes
            and request.ticks < 20
            and abs(found.held_up_ns - request.ticks * world.tick_ns) > 1000
        ):
            raise BrokenRuleError(
                f"a request waited for {request.ticks} ticks, and its figures say {found.held_up_ns} ns (11)"
            )
    elif found.phase is Phase.PREREQUISITE and found.may_follow != {Phase.WAITING, Phase.ENDED}:
        raise BrokenRuleError("nothing may follow a frame that was needed first (2)")


def _judge_own_read(world: "World", number: int, pdu: bytes) -> None:
    if (pdu[1] << 8 | pdu[2], pdu[3] << 8 | pdu[4]) not in READABLE:
        raise BrokenRuleError(f"a read that nothing names: {pdu.hex(' ')} (W8)")
    waiting = [find(world, port, transaction_id) for port, transaction_id in world.state.order]
    has_trials = world.design.retry_ms > 0  # read as well before what is read then, and for its group (W11)
    has_trials_or_peers = has_trials or bool(world.design.groups)  # the first of a beam asks for all (M11)
    unsent = [each for each in waiting if not each.is_sent and (each.axis == number or has_trials_or_peers)]
    if not (unsent or world.state.is_starting):
        raise BrokenRuleError(f"a read for nothing: {pdu.hex(' ')} (W8)")
    if not (world.state.is_starting or has_trials):
        _judge_need(world, number, pdu, unsent)
    if pdu[1] << 8 | pdu[2] == STATUS and unsent and unsent[0].axis == number:
        _note_bit_asked(world, number)


def _note_bit_asked(world: "World", number: int) -> None:
    """The bit is read for the request whose turn it is: the first that has not left."""
    for port, transaction_id in world.state.order:
        request = find(world, port, transaction_id)
        if not request.is_sent and request.axis == number:
            _replace(world, port, request._replace(is_bit_asked=True))
            return


def _judge_need(world: "World", number: int, pdu: bytes, unsent: "list[Asked]") -> None:
    """A read of the gateway's own needs a request that cannot go without it (W8)."""
    address, axis = pdu[1] << 8 | pdu[2], world.state.axes[number]
    moving = [each for each in unsent if each.pdu in RUNS or writes_target(each.pdu)]
    is_distance = any(runs_distance(world, number, each.pdu) for each in moving)
    run = axis.run
    if is_distance and address == ACTUAL.address and axis.goes_counts is not None and run is not None:
        note_run(
            world, number, uncertainty=max(run.uncertainty, 1)
        )  # no place on the way is the base of a distance (M5)
    # Beside its target a reading that is a moment old tells no direction.
    is_beside = any(abs(axis.stands_counts - each) <= CORRECTION_COUNTS for each in world.design.targets)
    is_beside |= "nudge" in world.design.happenings or "mode-absolute" in world.design.menu
    may_look = is_distance or axis.is_owed_look or is_beside or world.design.is_stream
    is_there = run is not None and run.is_acked and abs(axis.stands_counts - run.end_counts) <= NEAR_COUNTS
    is_again = is_there and not world.design.is_stream  # which begins anew after what it does not know
    is_again &= len(moving) == 1 and moving[0].pdu == run_pdu(world, run)
    is_again &= run is None or run.uncertainty < 2
    is_again &= not (
        world.design.groups and gantries.is_anew(world, number)
    )  # it is made anew, for another one
    is_again &= "calm" not in world.design.happenings  # a drive that gave up has said done, and goes again
    why = ""
    if address == COMMAND.address:
        is_needed = any(len(each.pdu) == 5 and writes_target(each.pdu) for each in moving)
        why = "" if is_needed else "no part of a target waits"
    elif address == COMMANDED.address:
        why = "" if is_distance else "no distance waits"
    elif address == ACTUAL.address:
        is_seen = run is not None and run.is_told and run.seen == 3 and run.state == "active"
        is_seen &= run is None or run.uncertainty < 2
        if not moving:
            why = "no target waits"
        elif world.design.is_buffered:
            pass  # one that was done with the target before last, and stands there, is taken for moved
        elif is_seen and not is_distance and not facts.is_unseen(world, number):
            why = "the axis was seen to stand at its target a moment ago"
        elif facts.is_just_read(world, number) and axis.goes_counts is None and not may_look:
            why = "it was read at this very moment"
        elif (
            is_again
            and not (axis.is_owed_look or facts.owes_proof(world, number))
            and not facts.is_unseen(world, number)
        ):
            why = "the same target is the same words"
    elif address == STATUS and not is_distance:
        why = facts.why_no_bit(world, number, is_target=bool(moving), is_read=len(moving) < len(unsent))
    if why:
        raise BrokenRuleError(f"a read for nothing, {why}: {pdu.hex(' ')} (W8)")


def note_run(world: "World", number: int, **changes: Any) -> None:
    """Note something of the last motion of an axis."""
    axis = world.state.axes[number]
    if axis.run is not None:
        axes = list(world.state.axes)
        axes[number] = axis._replace(run=axis.run._replace(**changes))
        world.state = world.state._replace(axes=tuple(axes))


def _others(half: bytes) -> int:
    """Return the bit of the word that a half does not write."""
    return 2 if (half[1] << 8 | half[2]) == COMMAND.address else 1


def _note_tried(world: "World", number: int, pdu: bytes, aim: "Aim") -> None:
    from tests.verify.world import Tried

    axes = list(world.state.axes)
    axis = axes[number]
    end_counts = world.design.written(axis.target_counts, pdu)
    made = _made_with(axis, aim, aim.nominal_counts, end_counts)
    tried = Tried(aim.nominal_counts, end_counts, made.table, made.state, made.is_gain_half)
    axes[number] = axis._replace(tried=tried)
    world.state = world.state._replace(axes=tuple(axes))


def _made_with(axis: "Axis", aim: "Aim", nominal: int, end: int) -> "Aim | Run | Tried":
    """Return what the words of a target were made with: a repeat keeps those of an older correction (M4)."""
    for before in (aim.tried, axis.run):
        if before is not None and (before.nominal_counts, before.end_counts) == (nominal, end):
            return before
    return aim


def _is_of_another(world: "World", made: "Aim | Run | Tried", aim: "Aim", nominal: int, end: int) -> bool:
    """Whether the words of a target were made with another switch, table or gain, and say so."""
    if (made.state in PASSING) is (aim.state in PASSING):
        is_same = (made.table, made.is_gain_half) == (aim.table, aim.is_gain_half)
        if made is aim or aim.state in PASSING or is_same:
            return False
    right = (nominal, nominal) if aim.state in PASSING else _branches(world, nominal, aim)
    return all(abs(end - each) > ROUNDING for each in right)


def _is_tried(aim: "Aim", nominal: int, end: int) -> bool:
    tried = aim.tried
    return tried is not None and (tried.nominal_counts, tried.end_counts) == (nominal, end)


def _is_frame_of(frame: bytes, request: bytes) -> bool:
    if frame == request:
        return True
    if BOTH in (frame[0], request[0]):
        return frame[:10] == request[:10] and len(frame) == len(request)
    if frame[0] == request[0] == 16 and _limit_hit(request):
        return frame[:6] == request[:6]
    if frame[0] != 16 or not writes_target(request):
        return False
    return frame[:6] == b"\x10" + COMMAND.address.to_bytes(2, "big") + b"\0\x02\x04"


def _judge_restaging(world: "World", number: int, pdu: bytes) -> None:
    """A write that no controller has asked for: only a staged target right before its trigger (M2)."""
    shown = pdu.hex(" ")
    if not world.design.is_staged:
        raise BrokenRuleError(f"a write that nobody has asked for, and it moves the axis: {shown} (2, W5)")
    is_passing = world.said(number).compensation in PASSING
    why = f"a write that nobody has asked for: {shown} (2)"
    for port, transaction_id in world.state.order:
        request = find(world, port, transaction_id)
        if not request.is_sent and request.axis != number and world.design.groups and request.pdu in RUNS:
            why = _judge_peer_restaging(world, port, request, number, shown)
            if not why:
                return
        if request.is_sent or request.axis != number or not writes_target(pdu):
            continue
        belief = world.state.beliefs[port][number]
        is_strange = request.pdu[:3] == RUN_PDU[:3] and request.pdu not in RUNS
        if is_strange and not belief.lost and pdu[6:] == COMMAND.pack(belief.steps):
            return  # before something runs of which nobody knows what it means, the words of the controller
        if request.pdu not in RUNS:
            continue
        if world.state.beliefs[port][number].lost and not is_passing:
            why = f"a target that was lost is written anew: {shown} (4)"
        elif request.restaged is not None and _is_still_in_force(world, number, request.restaged):
            why = f"the staged target was written anew twice: {shown} (2)"
        else:
            state = world.state
            in_force = (world.said(number).compensation, state.table, state.is_gain_half)
            _replace(world, port, request._replace(restaged=in_force))
            return
    raise BrokenRuleError(why)


def _is_still_in_force(world: "World", number: int, made_with: tuple[str, int, bool]) -> bool:
    """Whether a target need not be written anew once more: of a group all go by what holds as they go."""
    if not world.design.groups:
        return True
    return not gantries.is_doubtful(world) and made_with == gantries.in_force(world, number)


def _judge_peer_restaging(world: "World", port: int, request: "Asked", number: int, shown: str) -> str:
    """Judge a write of the target of another axis, for the first trigger of its group (M11)."""
    if gantries.is_fixed(world) and not gantries.is_doubtful(world):
        return f"a target is written anew for another axis, and one has gone: {shown} (M11)"
    found = gantries.in_force(world, number)
    if (number, found) in request.restaged_peers and not gantries.is_doubtful(world):
        return f"the staged target of another axis was written anew twice: {shown} (2)"
    if world.state.beliefs[port][number].lost and found[0] not in PASSING:
        return f"a target that was lost is written anew: {shown} (4)"
    others = tuple(each for each in request.restaged_peers if each[0] != number)
    _replace(world, port, request._replace(restaged_peers=(*others, (number, found))))
    return ""


def _replace(world: "World", port: int, request: "Asked") -> None:
    asked = list(world.state.asked)
    asked[port] = tuple(request if a.transaction_id == request.transaction_id else a for a in asked[port])
    world.state = world.state._replace(asked=tuple(asked))


def _aim(world: "World", port: int, number: int, pdu: bytes, request: "Asked") -> "Aim | None":
    from tests.verify.world import Aim

    state = world.state
    axis, belief = state.axes[number], state.beliefs[port][number]
    is_run = pdu in RUNS
    if not (is_run or (writes_target(pdu) and not world.design.is_staged)):
        return None
    if not is_run:
        belief = _written(belief, request.pdu, pdu)
    is_lost = bool(belief.lost) or any(
        world.state.beliefs[port][i].lost & 4 and (world.design.is_staged or facts.is_own_blocked(world, i))
        for i in range(len(state.axes))
        if i != number and world.design.groups
    )
    base = None
    if runs_distance(world, number, pdu):
        run = axis.run
        if run is not None and run.is_told and not run.is_unsure and axis.commanded_counts == run.end_counts:
            base = (run.nominal_counts, True)
        else:
            base = (axis.commanded_counts, False)
    run = axis.run
    if world.design.groups:
        is_known = not belief.lost & NEVER_WRITTEN
        gantries.leaves(world, number, belief.steps * world.design.step_counts, is_known=is_known)
        state = world.state
        compensation, table, is_gain_half = gantries.in_force(world, number)
    else:
        compensation, table, is_gain_half = request.restaged or (
            world.said(number).compensation, state.table, state.is_gain_half,
        )  # fmt: skip
    if is_run and belief.lost == NEVER_WRITTEN and world.design.plans[number].motion.passes_stored_moves:
        is_lost, compensation = True, PASSED_STORED  # a position that the drive keeps
    target = belief.steps * world.design.step_counts
    is_kept = base is not None or target in (each.nominal_counts for each in (run, axis.tried) if each)
    return Aim(
        target,
        axis.stands_counts,
        compensation,
        world.is_sending_unsure() or (is_kept and world.said(number).direction == "unsure"),
        table,
        is_gain_half,
        is_lost,
        base,
        _arrived(axis),
        axis.tried,
        gantries.others_in_force(world, number),
    )


def _written(belief: "Belief", request: bytes, frame: bytes) -> "Belief":
    """Return what a controller believes once a request of it is there, and how it was sent."""
    if request[0] == MASK:
        low = masked(belief.low.to_bytes(2, "big"), request)
        return belief._replace(low=low[0] << 8 | low[1])  # what was lost a mask does not make up for
    data = words_written(request)
    if len(data) == 4:
        return belief._replace(low=data[0] << 8 | data[1], high=data[2] << 8 | data[3], lost=0)
    word = data[0] << 8 | data[1]
    mine = 1 if written_at(request) == COMMAND.address else 2
    lost = belief.lost & ~mine
    if belief.lost & UNWRITTEN:  # completed with what the drive holds: each word has to come anew (M3)
        lost = lost if lost & 3 else 0
    elif frame[0] == 16 or not lost & 3:  # whole: completed with a word that was lost a moment ago, too (M1)
        lost = 0
    if mine == 1:
        return belief._replace(low=word, lost=lost)
    return belief._replace(high=word, lost=lost)


# --- motions ------------------------------------------------------------------------------------------


def judge_motion(world: "World", number: int, end: int, wire: "Wire") -> "Run":
    """Judge where the drive is about to go (0, 1, 4). Raises BrokenRuleError."""
    aim, before = wire.aim, world.state
    for state, table, is_gain_half in () if aim is None else aim.others:
        assert aim is not None
        other = aim._replace(state=state, table=table, is_gain_half=is_gain_half)
        try:
            return _judge_motion(world, number, end, wire._replace(aim=other))
        except BrokenRuleError:
            world.state = before
    return _judge_motion(world, number, end, wire)


def _judge_motion(world: "World", number: int, end: int, wire: "Wire") -> "Run":
    from tests.verify.world import Run

    aim = wire.aim
    if aim is None:
        raise BrokenRuleError(f"the drive goes to {end} and no controller has said so (0)")
    axis = world.state.axes[number]
    is_passing = aim.state in PASSING
    if aim.is_lost and not is_passing:
        raise BrokenRuleError(f"a target that was lost runs: the drive goes to {end} (4)")
    if aim.base is not None:
        nominal = _judge_distance(world, axis, end, aim)
    else:
        nominal = aim.nominal_counts
        _judge_target(world, axis, end, aim)
        if aim.is_lost:  # 1:1, and a word of it never came
            nominal = end
    was = aim.arrived
    is_other = was is not None and was.nominal_counts != nominal
    # No record says that its done bit was up, and of targets so near only that tells which was reached.
    is_beside = was is not None and abs(was.nominal_counts - nominal) <= world.design.beside_counts
    has_arrived = was is not None and was.seen == 3 and not (was.is_restarted and is_beside)
    if was is not None and is_other and was.is_told and has_arrived and aim.is_unsure and not is_passing:
        raise BrokenRuleError(
            f"an axis that was seen to have arrived at {was.end_counts} is taken for unsure (M6)"
        )
    if aim.is_unsure and not is_passing and aim.base is None and not world.design.is_stream:
        _judge_uncertainty(world, number, aim)
    is_certain = aim.base is None or aim.base[1]
    # What it is told again is no surer than it was, though it was moved by something else since.
    kept = axis.run
    is_flagged = kept is None and world.said(number).direction == "unsure"
    if "nudge" in world.design.happenings and kept is not None and kept.is_unsure:
        is_flagged |= (kept.nominal_counts, kept.end_counts) == (nominal, end)
    is_unsure = aim.is_unsure or is_flagged or not is_certain
    made = aim if aim.base is not None else _made_with(axis, aim, nominal, end)
    if world.design.groups and not world.design.is_stream:
        gantries.goes(world, number, nominal, is_kept=_is_of_another(world, made, aim, nominal, end))
        axis = world.state.axes[number]
    if made is not aim and is_passing:  # words of before: who is off does not say how sure they were
        is_unsure = True
    is_set_out = axis.stopped is not None and not axis.stopped.is_recalled
    if world.design.is_stream:
        is_set_out = axis.run is not None and axis.run.is_told and axis.run.nominal_counts != nominal
    run = Run(nominal, end, False, is_unsure, made.table, made.state, is_gain_half=made.is_gain_half)
    run = run._replace(is_set_out=is_set_out, was_lost=aim.is_lost)
    before = axis.run
    is_again = before is not None and (before.nominal_counts, before.end_counts) == (nominal, end)
    return run._replace(uncertainty=before.uncertainty) if before is not None and is_again else run


def _judge_uncertainty(world: "World", number: int, aim: "Aim") -> None:
    """A branch is assumed only where no reading could tell: for want of one, or beside its branches (M6)."""
    plan, axis = world.design.plans[number], world.state.axes[number]
    run = axis.run
    is_again = run is not None and run.nominal_counts == aim.nominal_counts and run.is_unsure
    is_again |= aim.tried is not None and aim.tried[0] == aim.nominal_counts
    has_lost = ("declare" in world.design.happenings and run is not None and not run.is_told) or (
        "homed_bit" in world.design.happenings
    )
    if run is not None and (run.state in PASSING or has_lost):
        # The same words as before the reference was lost, or found: no reading tells (M4).
        is_again |= run.nominal_counts == aim.nominal_counts
    may_fail = world.design.refuses_reads or world.design.answers_before
    is_queue = plan.next_target is NextTarget.QUEUED  # it may have others to go to first
    if may_fail or not plan.actual or is_again or is_queue:
        return
    settings = plan.settings
    reach = settings.max_speed * world.reading_age_ns / NS_PER_S * abs(settings.counts_per_unit)
    if run is None and abs(aim.nominal_counts - aim.from_counts) <= reach:
        return  # an axis that something else may be moving can have passed its target since it was read
    if (
        not settings.max_speed
        and world.reading_age_ns > settings.fresh_ms * NS_PER_MS
        and _may_have_passed(axis, aim)
    ):
        return
    low, high = sorted(_branches(world, aim.nominal_counts, aim))
    beside = world.design.beside_counts
    for way in (axis.stopped, axis.run):
        if way is not None and (way is axis.stopped or (way.is_set_out and way.is_told)):
            _judge_side(world, axis, way, aim)
    if not any(low - beside <= each <= high + beside for each in (aim.from_counts, axis.stands_counts)):
        raise BrokenRuleError(
            f"target {aim.nominal_counts} is taken for unsure, and the axis stands at {aim.from_counts}, "
            f"beyond {low:.1f} to {high:.1f}: a reading tells (M6)"
        )


def _may_have_passed(axis: "Axis", aim: "Aim") -> bool:
    """Whether a target lies on the way on which an axis of unknown speed is (M6)."""
    if axis.run is None:
        return True
    ahead, away = axis.run.end_counts - aim.from_counts, aim.nominal_counts - aim.from_counts
    return ahead * away > 0 and abs(away) <= abs(ahead) + 2 * SLOPE_COUNTS


def _judge_side(world: "World", axis: "Axis", way: "Run", aim: "Aim") -> None:
    """On a way of which it was known where it began a reading tells the nominal place exactly (M6)."""
    is_same = (way.table, way.is_gain_half) == (aim.table, aim.is_gain_half) and way.state == aim.state
    if way.is_recalled or way.is_unsure or not is_same or way.uncertainty:
        return
    ends = _branches(world, way.nominal_counts, aim)
    is_forward = abs(way.end_counts - ends[0]) <= abs(way.end_counts - ends[1])
    for stands in (aim.from_counts, axis.stands_counts):
        place = 2 * stands - _branches(world, stands, aim)[0 if is_forward else 1]
        if abs(place - aim.nominal_counts) <= world.design.beside_counts + SLOPE_COUNTS:
            return
    raise BrokenRuleError(
        f"target {aim.nominal_counts} is taken for unsure, and the axis is on its way to "
        f"{way.nominal_counts}, at nominal {place:.1f} (M6)"
    )


def _is_another_away(world: "World", axis: "Axis") -> bool:
    """Whether another axis does not stand where its last target sent it."""
    others = (each for each in world.state.axes if each is not axis)
    return any(each.run is not None and each.stands_counts != each.run.end_counts for each in others)


def _judge_target(world: "World", axis: "Axis", end: int, aim: "Aim") -> None:
    run, nominal = axis.run, aim.nominal_counts
    held = axis.held
    if held is not None and held.nominal_counts == nominal:
        in_position = world.design.plans[0].settings.in_position_counts
        stands_there = abs(axis.stands_counts - held.end_counts) <= in_position
        if stands_there and end != held.end_counts:
            raise BrokenRuleError(
                f"target {nominal} was told as {held.end_counts}, where its axis stands over a lost "
                f"reference, and becomes {end} (0, M4)"
            )
        is_far = abs(held.end_counts - nominal) > ROUNDING and axis.goes_counts is None
        if is_far and not stands_there and aim.state == "unreferenced" and end == held.end_counts:
            raise BrokenRuleError(
                f"target {nominal} goes to {end} as before its reference was lost, and its axis stands at "
                f"{axis.stands_counts} of another zero (M9)"
            )
    if run is not None and run.nominal_counts == nominal and not aim.is_lost:
        if end == run.end_counts:
            return
        is_other = (run.table, run.is_gain_half) != (aim.table, aim.is_gain_half)
        is_other |= (run.state in PASSING) is not (aim.state in PASSING)
        is_away = axis.stands_counts != run.end_counts  # it was looked for, and not found there (M6)
        is_known = run.has_blinked or (run.is_told and run.uncertainty < 2)  # else it may be anywhere
        is_excused = (
            run.is_unsure or aim.is_unsure or (is_other and (run.is_restarted or is_away or not is_known))
        )
        # Of a group the targets of before a lost reference count all, or none (M11).
        is_lost = "unreferenced" in (run.state, aim.state)
        is_excused |= bool(world.design.groups) and is_other and is_lost and _is_another_away(world, axis)
        number = next(each for each, other in enumerate(world.state.axes) if other is axis)
        is_excused |= bool(world.design.groups) and is_other and gantries.is_anew(world, number)
        is_excused |= bool(world.design.groups) and is_other and run.was_lost
        # A stream begins anew with the offset that its drive has by then; what is more is motion.
        is_excused |= world.design.is_stream and not run.is_told
        if not is_excused:
            raise BrokenRuleError(
                f"the same target {nominal} again moves the drive from {run.end_counts} to {end} (0, M4)"
            )
    if world.design.is_stream:
        _judge_setpoint(world, axis, end, aim)
        return
    if aim.state in PASSING:
        if end != nominal and not _is_tried(aim, nominal, end) and not aim.is_lost:
            raise BrokenRuleError(f"target {nominal} of an axis that is {aim.state} becomes {end} (M9)")
        return
    if world.design.is_staged and _is_tried(aim, nominal, end):
        return  # its drive was switched off and on and holds it: given again it is the same words (M4)
    _judge_branch(world, axis, end, aim, nominal)


def _judge_setpoint(world: "World", axis: "Axis", end: int, aim: "Aim") -> None:
    """A setpoint has an offset up to that of the branches; the first has that of its drive (M6)."""
    nominal, stands = aim.nominal_counts, axis.stands_counts
    screw = world.screws[aim.table]
    offsets = [0.0, *(1000 * each for each in (*screw.forward_mm, *screw.backward_mm))]
    beside = world.design.beside_counts
    if not min(offsets) - beside <= end - nominal <= max(offsets) + beside:
        raise BrokenRuleError(f"setpoint {nominal} becomes {end}, which no table of it says (1)")
    if axis.run is None and axis.is_fresh:
        here = [0.0, *(each - stands for each in screw.corrected(stands))]
        offset = min(max(stands - nominal, min(here)), max(here))
        if abs(end - nominal - offset) > beside:
            raise BrokenRuleError(
                f"a stream begins with setpoint {nominal}, the drive stands at {stands}, and it is sent as "
                f"{end}: an offset of {offset:.1f} would be right (M6)"
            )


def _judge_distance(world: "World", axis: "Axis", end: int, aim: "Aim") -> int:
    assert aim.base is not None
    base, is_certain = aim.base
    distance = aim.nominal_counts
    if aim.state in PASSING:
        # Switched off with the next target: where it stands corrected, still through its nominal position.
        low, high = _band(world, base)
        is_through = low - SLOPE_COUNTS <= end - distance <= high + SLOPE_COUNTS
        if "switch" in world.design.happenings and (end == base + distance if is_certain else is_through):
            return end
        if end - axis.commanded_counts != distance:
            raise BrokenRuleError(f"a distance of {distance} becomes {end - axis.commanded_counts} (M9)")
        return end
    if is_certain:
        _judge_branch(world, axis, end, aim, base + distance, tolerance=ONE)
        return base + distance
    forward, backward = _branches(world, base, aim)
    low, high = sorted((2 * base - forward, 2 * base - backward))
    places = range(int(low - SLOPE_COUNTS) + distance, int(high + SLOPE_COUNTS) + distance + 1)
    far = {each: min(abs(end - branch) for branch in _branches(world, each, aim)) for each in places}
    nominal = min(far, key=lambda each: far[each])
    if far[nominal] <= ONE * world.design.step_counts:
        return nominal
    raise BrokenRuleError(f"a distance of {distance} from {base} ends at {end}, which is on no branch (1)")


def _branches(world: "World", nominal: int, aim: "Aim") -> tuple[float, float]:
    share = 0.5 if aim.is_gain_half else 1.0
    forward, backward = world.screws[aim.table].corrected(nominal)
    return nominal + share * (forward - nominal), nominal + share * (backward - nominal)


def _arrived(axis: "Axis") -> "Run | None":
    """Return the motion at whose end an axis stands."""
    run = axis.run
    if run is None or axis.goes_counts is not None:
        return None
    return run if axis.stands_counts == run.end_counts else None


def _judge_branch(
    world: "World", axis: "Axis", end: int, aim: "Aim", nominal: int, *, tolerance: float = ROUNDING
) -> None:
    forward, backward = _branches(world, nominal, aim)
    tolerance, one = tolerance * world.design.step_counts, ONE * world.design.step_counts
    beside = world.design.beside_counts
    is_forward, is_backward = abs(end - forward) <= tolerance, abs(end - backward) <= tolerance
    if aim.is_unsure:
        if is_forward or is_backward or abs(end - (forward + backward) / 2) <= tolerance:
            return
        if _is_tried(aim, nominal, end):
            return  # the drive may hold these words: given again they are the same (M4)
        raise BrokenRuleError(
            f"target {nominal} becomes {end}: {forward:.2f} or {backward:.2f} would be right (1)"
        )
    if (is_forward or is_backward) and abs(end - axis.stands_counts) <= one:
        return  # a register's step is no motion: it stands there already (0)
    low, high = sorted((forward, backward))
    may_be_forward = may_be_backward = False
    for place, run in {(aim.from_counts, aim.arrived), (axis.stands_counts, _arrived(axis))}:
        is_same_map = run is not None and (run.table, run.is_gain_half) == (aim.table, aim.is_gain_half)
        if run is not None and is_same_map and run.state not in PASSING:
            may_be_forward |= nominal >= run.nominal_counts
            may_be_backward |= nominal <= run.nominal_counts
        is_certain = run is not None and run.is_told and not run.is_unsure
        if run is None or not (is_certain and is_same_map and run.state not in PASSING):
            is_at_forward, is_at_backward = (abs(place - each) <= beside for each in (forward, backward))
            # Where it stands on one branch already it has come there on that one (M6).
            may_be_forward |= place <= high + beside and (is_at_forward or not is_at_backward)
            may_be_backward |= place >= low - beside and (is_at_backward or not is_at_forward)
    if (is_forward and may_be_forward) or (is_backward and may_be_backward):
        return
    what = "is on the wrong branch" if is_forward or is_backward else "is on no branch"
    raise BrokenRuleError(
        f"target {nominal}, the drive stands at {axis.stands_counts} and goes to {end}, which {what}: "
        f"{forward:.2f} forward, {backward:.2f} backward, and nothing says that it is unsure (1)"
    )


# --- records ------------------------------------------------------------------------------------------


def is_of_record(world: "World", number: int, wire: "Wire | None") -> bool:
    """Whether the record says where the axis stands or goes, for the gateway that is killed now (5).

    Of a target that was on the wire it does where the axis stood at its last target, and is on no place of
    both. A drive that takes stops may have been stopped on its way, by whoever took the gateway's place.
    """
    axis, plan = world.state.axes[number], world.design.plans[number]
    run = axis.run
    if run is None:
        return False
    is_there = axis.goes_counts is None and axis.stands_counts == run.end_counts
    if world.design.is_stream:
        is_sent = wire is None or wire.pdu[0] == 3 or wire.is_obeyed
        return is_there and is_sent and (run.is_told or run.is_set_out)
    is_going = axis.goes_counts == run.end_counts and not plan.has_rules
    if wire is None or wire.pdu[0] == 3 or wire.unit_id != plan.unit_id:
        is_known = run.is_told or run.is_recalled
        return (
            is_known and (is_there or is_going) and (wire is None or wire.pdu[0] == 3 or not plan.has_rules)
        )
    aim = wire.aim
    if aim is not None and aim.base is not None and aim.state == "active":  # a distance, at its end (M5)
        return aim.base[1] and wire.is_obeyed and is_there and not aim.is_unsure
    was = None if wire.aim is None else wire.aim.arrived
    if wire.aim is None or was is None or not wire.is_obeyed or wire.aim.is_unsure or plan.has_rules:
        return False
    is_far = abs(was.end_counts - run.end_counts) > CORRECTION_COUNTS
    was_there = was.seen == 3 or (world.design.judges_proof and was.seen & 1 == 1)
    return was.is_told and was_there and was.state == "active" and is_far and (is_there or is_going)


def _judge_record(world: "World", number: int) -> None:
    """The axis was seen where its record says: it goes on from it, and says so (5). BrokenRuleError."""
    axis, name = world.state.axes[number], world.design.plans[number].name
    run = axis.run
    assert run is not None
    if run.end_counts not in (axis.stands_counts, axis.goes_counts):
        return
    is_told = any(event.kind is exchange_events.RESTORED and event.axis == name for event in world.told)
    if not is_told and not world.design.groups:
        raise BrokenRuleError(
            f"the axis was killed on its way to {run.end_counts}, is seen at {axis.stands_counts}, and its "
            "record does not count (5)"
        )
    if run.is_open:  # it reads what it should (``_recall_stop``), and is flagged
        note_run(world, number, is_recalled=False, is_open=False)
        return
    # The same target again is the same words, and needs no read: the record says what the drive holds.
    is_acked = axis.goes_counts is None and not world.design.plans[number].has_rules and not run.uncertainty
    seen = run.kept_seen if axis.goes_counts is None else 0
    is_told = axis.tried is None or not world.design.is_stream  # its setpoint after that one is lost still
    note_run(world, number, is_told=is_told, is_recalled=False, is_acked=is_acked, seen=seen)


def _recall_stop(world: "World", number: int) -> None:
    """A record that counts says where the axis is, and on which way it was stopped. BrokenRuleError."""
    axis, name = world.state.axes[number], world.design.plans[number].name
    found = [e for e in world.told if e.kind is exchange_events.RESTORED and e.axis == name]
    is_told, run = bool(found), axis.run
    is_there = run is not None and axis.goes_counts is None and axis.stands_counts == run.end_counts
    if is_told and run is not None and is_there and run.state == "active" and not run.is_unsure:
        told_mm = float(found[0].detail.split(": nominal ")[1].split()[0])
        if abs(told_mm * world.screws[0].counts_per_mm - run.nominal_counts) > 1:
            raise BrokenRuleError(
                f"the axis goes on from its record at {told_mm} mm, and target {run.nominal_counts} has sent "
                "it there (5)"
            )
    if axis.stopped is not None and axis.stopped.is_recalled and is_told:
        axes = list(world.state.axes)
        axes[number] = axis._replace(stopped=axis.stopped._replace(is_recalled=False))
        world.state = world.state._replace(axes=tuple(axes))


# --- answers ------------------------------------------------------------------------------------------


def _is_native(sent: bytes, reply: bytes) -> bool:
    if sent[0] in (3, BOTH):
        return reply[0] == sent[0] and len(reply) == 2 + 2 * (sent[3] << 8 | sent[4])
    return reply == (sent[:5] if sent[0] == 16 else sent)


def note_answer(world: "World", wire: "Wire", reply: bytes) -> None:
    """Take note of what the drive has answered, before its controller sees it."""
    number = facts.number_of(world, wire.unit_id)
    if facts.was_out_of_reach(world, number):
        gantries.broken_off(world)
    _note_answer(world, wire, reply)
    is_refused = reply[1:] == b"\x01" or _proves_nothing_written(world, number, reply)
    is_refused &= reply[0] == wire.pdu[0] | 0x80
    gantries.ended(world, wire, is_native=_is_native(wire.pdu, reply), is_refused=is_refused)
    if wire.pdu[0] == 3 and wire.pdu[1:3] == MODE_HEAD[1:] and _is_native(wire.pdu, reply):
        know_rules(world, facts.number_of(world, wire.unit_id))
    is_read = wire.pdu[0] == 3 and _is_native(wire.pdu, reply)
    if is_read and wire.pdu[1] << 8 | wire.pdu[2] == ACTUAL.address:
        number = facts.number_of(world, wire.unit_id)
        axes = list(world.state.axes)
        axes[number] = axes[number]._replace(has_crept=False)
        if axes[number].is_owed_look:  # that the bit is down is nothing new from now on
            axes[number] = axes[number]._replace(is_owed_look=False, was_done=False)
        world.state = world.state._replace(axes=tuple(axes))
        axis = world.state.axes[number]
        run = axis.run
        if run is not None and run.lost_ns and axis.stands_counts == run.end_counts:
            plan = world.design.plans[number]
            if axis.goes_counts is None and wire.sent_ns - run.lost_ns >= plan.done_drop_ms * facts.MS:
                note_run(world, number, is_told=True, lost_ns=0, seen=3 if run.is_done_since else 1)
        if axis.run is not None and axis.run.is_recalled:
            _judge_record(world, number)
        _recall_stop(world, number)
        _note_moved_away(world, number)
    if world.design.judges_proof and facts.was_out_of_reach(world, facts.number_of(world, wire.unit_id)):
        _note_out_of_reach(world, facts.number_of(world, wire.unit_id))
    if is_read and world.design.judges_proof:
        _note_proof(world, wire)
    facts.answered(world, wire, reply, is_native=_is_native(wire.pdu, reply))


def _note_moved_away(world: "World", number: int) -> None:
    """A referenced axis that is seen elsewhere was moved by somebody: nothing is a repeat any more (M4)."""
    axis, plan = world.state.axes[number], world.design.plans[number]
    held, said = axis.held, world.said(number)
    if held is None or said.compensation in PASSING:
        return
    if abs(axis.stands_counts - held.end_counts) > plan.settings.max_correction_counts:
        axes = list(world.state.axes)
        axes[number] = axis._replace(held=None)
        world.state = world.state._replace(axes=tuple(axes))


def forget_stop(world: "World", number: int) -> None:
    """Nobody knows where the axis was stopped: something else may move it."""
    axes = list(world.state.axes)
    if axes[number].stopped is not None:
        axes[number] = axes[number]._replace(stopped=None)
        world.state = world.state._replace(axes=tuple(axes))


def _note_out_of_reach(world: "World", number: int) -> None:
    """A target that no reply had proved is not known any more: the same one again begins at its own place."""
    run = world.state.axes[number].run
    if run is not None and not run.is_told:
        note_run(world, number, is_unsure=True)


def _note_proof(world: "World", wire: "Wire") -> None:
    """A target without an answer is told once it is read back, or the axis is seen to come there (M7)."""
    number, address = facts.number_of(world, wire.unit_id), wire.pdu[1] << 8 | wire.pdu[2]
    axis = world.state.axes[number]
    run, tried, before = axis.run, axis.tried, axis.read_counts
    is_tried = run is not None and tried is not None and tried[:2] == (run.nominal_counts, run.end_counts)
    if address == ACTUAL.address:
        axes = list(world.state.axes)
        axes[number] = axis._replace(read_counts=axis.stands_counts)
        world.state = world.state._replace(axes=tuple(axes))
    if run is None or not is_tried or run.is_told or facts.was_out_of_reach(world, number):
        return
    near, end = world.design.beside_counts, run.end_counts
    is_proven = address == COMMAND.address and wire.owner >= 0 and axis.target_counts == end
    if address == ACTUAL.address and before is not None:
        is_proven = abs(axis.stands_counts - end) <= near < abs(before - end)
    if is_proven:
        note_run(world, number, is_told=True, seen=int(address == ACTUAL.address))


def _note_answer(world: "World", wire: "Wire", reply: bytes) -> None:
    if wire.owner < 0 or wire.pdu[0] == 3:
        return
    number = facts.number_of(world, wire.unit_id)
    request = _find(world, wire.owner, wire.transaction_id)
    if is_stop(wire.pdu) and not wire.is_early and world.state.axes[number].hush_ticks:
        owe_echo(world, wire)
    if not _is_native(wire.pdu, reply):
        if _limit_hit(wire.request):  # an exception does not prove that nothing was written (M7)
            _note_limit(world, number, None)
        if request is not None:
            note_lost(world, wire.owner, request, proof=_proves_nothing_written(world, number, reply))
        if wire.aim is not None:
            _judge_untold(world, number, wire.aim, reply)
            note_other_lost(world, number, wire)
            _forget(world, number, wire)
        forget_stop(world, number)
        return
    if _limit_hit(wire.request) and wire.request[0] == 16:
        _note_limit(world, number, int(COMMAND.unpack(wire.request[6:])))
    if writes_target(wire.request):
        beliefs = [list(own) for own in world.state.beliefs]
        for port, own in enumerate(beliefs):
            if port == wire.owner:
                own[number] = _written(own[number], wire.request, wire.pdu)
            else:
                own[number] = own[number]._replace(lost=3)
        world.state = world.state._replace(beliefs=tuple(tuple(own) for own in beliefs))
    is_doubtful = _is_doubtful_edge(world, number, wire)
    if wire.aim is not None and number and world.design.plans[0].cross:
        world.state = world.state._replace(table=WARM)  # it is known from now on where the other axis is
    if wire.aim is not None:
        axes = list(world.state.axes)
        run = axes[number].run
        if run is not None:
            # Words of before that go out again without a reference mean nothing to the gateway (M9).
            means_nothing = wire.aim.state == "unreferenced" and run.state not in PASSING
            is_word = wire.pdu[0] == 6 and writes_target(wire.pdu)  # the gateway may not know the rest of it
            is_told = not (wire.aim.is_lost or means_nothing or is_word or is_doubtful)
            waits = axes[number].next_run
            if waits is not None:
                waits = waits._replace(is_told=is_told, is_acked=is_told)
                axes[number] = axes[number]._replace(next_run=waits, tried=None)
            else:
                is_set_out = run.is_set_out and is_told
                is_as_sent = (wire.aim.state in PASSING) is (world.said(number).compensation in PASSING)
                run = run._replace(is_told=is_told, is_held=is_told, is_set_out=is_set_out)
                run = run._replace(is_acked=is_told and is_as_sent)
                axes[number] = axes[number]._replace(run=run, tried=None)
            world.state = world.state._replace(axes=tuple(axes))


def _is_doubtful_edge(world: "World", number: int, wire: "Wire") -> bool:
    """Whether what a frame does hangs on a register of which the gateway was never told what it holds.

    A trigger that acts as it rises may have been up already; what passes 1:1 may be a distance, and from
    where that begins is not asked.
    """
    axis, aim = world.state.axes[number], wire.aim
    if world.design.edge and wire.pdu[:3] in (RUN_PDU[:3], COIL_RUN_PDU[:3]):
        know_rules(world, number)
        return not axis.knows_rules
    if wire.pdu[:3] == MODE_HEAD:
        know_rules(world, number)
    if "mode-absolute" not in world.design.menu or world.design.is_staged or aim is None:
        return False
    return aim.state in PASSING and not (axis.knows_rules and (aim.base is None or aim.base[1]))


def know_rules(world: "World", number: int) -> None:
    """The gateway is told what a trigger or a mode register holds."""
    axes = list(world.state.axes)
    axes[number] = axes[number]._replace(knows_rules=True)
    world.state = world.state._replace(axes=tuple(axes))


def _judge_untold(world: "World", number: int, aim: "Aim", reply: bytes) -> None:
    """Only the full native success makes a target so (M7). Raises BrokenRuleError."""
    target, before = world.said(number).target_counts, world.before[number].target_counts
    if aim.base is None and target == aim.nominal_counts != before:
        raise BrokenRuleError(f"target {target} was answered with {reply.hex(' ')}, and it is told (M7)")


def note_other_lost(world: "World", number: int, wire: "Wire") -> None:
    """After another target that was lost nobody knows which of both its drive holds over a lost reference."""
    axes = list(world.state.axes)
    held = axes[number].held
    if held is not None and wire.aim is not None and wire.aim.nominal_counts != held.nominal_counts:
        axes[number] = axes[number]._replace(held=None)
        world.state = world.state._replace(axes=tuple(axes))


def _forget(world: "World", number: int, wire: "Wire", *, was_told: bool = False) -> None:
    """Nobody knows any more whether the last motion is the one that the axis is on.

    Of a distance that went without an answer a look tells whether it has run (M5).

    Of two targets nearer to each other than the hysteresis no reading tells which of them was reached.
    """
    is_whole = wire.pdu[0] in (16, BOTH)
    end = world.design.unpacked(words_written(wire.pdu)) if is_whole else None
    axes = list(world.state.axes)
    run = axes[number].run
    if run is not None:
        is_near = end is not None and 0 < abs(end - run.end_counts) <= world.design.beside_counts
        is_distance = wire.aim is not None and wire.aim.base is not None and axes[number].goes_counts is None
        lost_ns = world.now_ns if (run.is_told or was_told) and is_distance else 0
        run = run._replace(is_told=False, is_acked=False, seen=0, is_unsure=run.is_unsure or is_near)
        run = run._replace(lost_ns=lost_ns, is_done_since=False)
        if wire.aim is not None and wire.aim.base is not None and axes[number].goes_counts is not None:
            axes[number] = axes[number]._replace(is_lost_distance=True)
        axes[number] = axes[number]._replace(run=run)
        world.state = world.state._replace(axes=tuple(axes))


def note_silence(world: "World", wire: "Wire") -> None:
    """Take note of a frame that was not answered in time."""
    gantries.ended(world, wire, is_native=False)
    number = facts.number_of(world, wire.unit_id)
    before = world.state.axes[number].run
    was_told = before is not None and before.is_told
    axes = tuple(
        axis
        if axis.run is None
        else axis._replace(run=axis.run._replace(is_told=False, is_acked=False, seen=0))
        for axis in world.state.axes
    )
    world.state = world.state._replace(axes=axes)
    if wire.owner < 0:
        return
    if wire.aim is not None:
        _forget(world, number, wire, was_told=was_told)
    request = _find(world, wire.owner, wire.transaction_id)
    if request is None:
        return
    note_lost(world, wire.owner, request)
    if world.design.controllers[wire.owner].serial:
        end(world, wire.owner, request)


def begin_to_hush(world: "World", number: int, ticks: int) -> None:
    """A drive did not answer: on a serial line it is asked nothing before it was silent for a while (W6)."""
    if not world.design.is_serial:
        return
    _set_hush(world, number, ticks)
    may_stay_unasked(world, number)


def may_stay_unasked(world: "World", number: int) -> None:
    """A frame to a drive was not answered: requests to it that may have needed it first have failed too."""
    asked = tuple(
        tuple(each._replace(is_owed=each.is_owed or each.axis == number) for each in own)
        for own in world.state.asked
    )
    world.state = world.state._replace(asked=asked)


def go_on_hushing(world: "World", number: int) -> None:
    """A frame of a drive came late: its silence begins anew."""
    ticks = world.state.axes[number].hush_ticks
    if ticks:
        begin_to_hush(world, number, max(ticks, 1))


def hush(world: "World") -> None:
    """A tick has passed."""
    for number, axis in enumerate(world.state.axes):
        if axis.hush_ticks:
            _set_hush(world, number, axis.hush_ticks - 1)


def end_hush(world: "World") -> None:
    """No drive owes a silence of its own."""
    for number in range(len(world.state.axes)):
        _set_hush(world, number, 0)


def _set_hush(world: "World", number: int, ticks: int) -> None:
    axes = list(world.state.axes)
    unasked = axes[number].unasked if ticks else 0
    axes[number] = axes[number]._replace(hush_ticks=ticks, unasked=unasked)
    world.state = world.state._replace(axes=tuple(axes))


def _judge_unasked(world: "World", request: "Asked") -> None:
    """What is answered at once and not sent, as if its drive had not answered, has a reason (2, W6)."""
    if request.pdu[0] != 3 or world.design.retry_ms > 0:
        return
    if not request.is_owed:
        raise BrokenRuleError(f"answered for a drive that owes no silence: {request.pdu.hex(' ')} (2, W6)")
    axis = world.state.axes[request.axis]
    if request.ticks or not axis.hush_ticks:
        return  # it has waited: a frame that it needed first may have been left unanswered
    if axis.unasked >= MOST_UNASKED:
        raise BrokenRuleError(f"answered a third time, and nobody has asked: {request.pdu.hex(' ')} (2, W6)")
    axes = list(world.state.axes)
    axes[request.axis] = axis._replace(unasked=axis.unasked + 1)
    world.state = world.state._replace(axes=tuple(axes))


def owe_echo(world: "World", wire: "Wire") -> None:
    """Of a stop that left twice two echoes may come: nothing else goes to its drive before (W6)."""
    number = facts.number_of(world, wire.unit_id)
    ticks = world.design.response_ticks + 1
    begin_to_hush(world, number, max(ticks, world.state.axes[number].hush_ticks))


def owe_early_stop(world: "World", wire: "Wire") -> None:
    """A stop that left early and was not answered leaves once more, for whoever waits for it still (M3)."""
    if not wire.is_early:
        return
    owe_echo(world, wire)
    request = None if wire.owner < 0 else _find(world, wire.owner, wire.transaction_id)
    if request is None:
        world.state = world.state._replace(owed_stops=min(world.state.owed_stops + 1, 2))
        return
    asked = list(world.state.asked)
    again = request._replace(is_sent=False, goes_again=True)
    asked[wire.owner] = tuple(again if each is request else each for each in asked[wire.owner])
    world.state = world.state._replace(asked=tuple(asked))


def judge_waiting(world: "World") -> None:
    """Where nothing is on the wire and the line is at rest nobody waits (2). Raises BrokenRuleError."""
    state = world.state
    is_slow = world.design.response_ticks > 1  # a request may be given up while another one is answered
    if state.wire is not None or not state.is_up or world.is_resting() or is_slow:
        return
    way = world.on_its_way()
    if way is not None and way.phase is Phase.LEAVING:
        return
    for port, transaction_id in state.order:
        request, plan = find(world, port, transaction_id), world.design.controllers[port]
        is_passing = world.said(0).compensation in PASSING and not facts.is_own_blocked(world, 0)
        if request.is_broadcast and not is_passing:
            refuse_broadcast(world, port, request)
            continue
        waits_for_gap = plan.role is Role.MONITOR and request.ticks <= PATIENCE_TICKS
        if not (waits_for_gap or (plan.serial and (request.is_sent or plan.rights.unit_ids))):
            raise BrokenRuleError(f"nothing is under way, and a controller waits: {request.pdu.hex(' ')} (2)")


def _proves_nothing_written(world: "World", number: int, reply: bytes) -> bool:
    """Whether a drive's exception says that what stood there stands there still (M7)."""
    is_exact = len(reply) == 2 and reply[1] in (2, 3, 4)
    return is_exact and world.design.plans[number].exception_writes_nothing


def note_lost(world: "World", port: int, request: "Asked", *, proof: bool = False) -> None:
    """Take note of a write of a target of which nobody can say that it is in the drive (4).

    ``proof``: its drive has said that it was not written. Then the other words of a half may be completed
    from what stands there, and only triggers wait until each word came anew (M3).
    """
    if not writes_target(request.pdu):
        return
    is_low = written_at(request.pdu) == COMMAND.address
    is_whole = request.pdu[0] != 6  # so is what is laid over a word that has to be known
    word = 0 if is_whole else request.pdu[3] << 8 | request.pdu[4]
    beliefs = [list(own) for own in world.state.beliefs]
    i, belief = request.axis, beliefs[port][request.axis]
    if proof and not is_whole and not belief.lost & 4:
        if world.design.is_staged:
            beliefs[port][i] = belief._replace(lost=3 | UNWRITTEN)
    elif is_whole:
        beliefs[port][i] = belief._replace(lost=7, ticks=OLD_TICKS)
    elif is_low:
        beliefs[port][i] = belief._replace(low=word, lost=belief.lost | 5, ticks=0)
    else:
        beliefs[port][i] = belief._replace(high=word, lost=belief.lost | 6, ticks=0)
    world.state = world.state._replace(beliefs=tuple(tuple(own) for own in beliefs))


def _find(world: "World", port: int, transaction_id: int) -> "Asked | None":
    return next(
        (a for a in world.state.asked[port] if a.transaction_id == transaction_id and a.is_sent), None
    )


def find(world: "World", port: int, transaction_id: int) -> "Asked":
    """Return an open request."""
    return next(a for a in world.state.asked[port] if a.transaction_id == transaction_id)


def end(world: "World", port: int, request: "Asked") -> None:
    """Take a request out of those that are open."""
    asked = list(world.state.asked)
    asked[port] = tuple(a for a in asked[port] if a.transaction_id != request.transaction_id)
    order = tuple(each for each in world.state.order if each != (port, request.transaction_id))
    world.state = world.state._replace(asked=tuple(asked), order=order)


def judge_reply(world: "World", port: int, transaction_id: int, pdu: bytes, answered: "Wire | None") -> None:
    """Judge what a controller is answered (2, 3). Raises BrokenRuleError."""
    request = next((a for a in world.state.asked[port] if a.transaction_id == transaction_id), None)
    if request is None and (port, transaction_id) in world.state.given_up:
        given_up = tuple(each for each in world.state.given_up if each != (port, transaction_id))
        world.state = world.state._replace(given_up=given_up)
        world.refusals.append(pdu[1])
        if not is_exception(pdu):
            raise BrokenRuleError(f"what its controller had given up was carried out: {pdu.hex(' ')} (2, W5)")
        return  # to one that its controller has given up meanwhile
    if request is None or _is_behind_patience(world, port, request):
        raise BrokenRuleError(f"no controller waits for this reply: {pdu.hex(' ')} (W6)")
    end(world, port, request)
    is_own = answered is not None and answered.owner == port and answered.transaction_id == transaction_id
    if is_exception(pdu):
        world.tally.refusals.add(pdu[1])
        if not is_own:
            world.refusals.append(pdu[1])
        _judge_refusal(world, port, request, pdu, is_own=is_own)
        if not is_own:
            note_lost(world, port, request)
            if not request.is_sent:
                facts.never_sent(world, port, request, pdu[1])
        return
    if not is_own:
        raise BrokenRuleError(f"the gateway answers for the drive: {pdu.hex(' ')} (W4)")
    assert answered is not None
    _judge_form(world, request.pdu, pdu)
    if world.design.answers_before and not _is_native(request.pdu, pdu):
        return  # passed on as it is, and no proof of anything (W4)
    if pdu[0] == 3:
        _note_seen(world, answered, pdu)
    if pdu[0] == 3 and _limit_hit(request.pdu):
        told = world.state.axes[request.axis].told_limit_counts
        found = int(COMMAND.unpack(pdu[2:6]))
        is_passing = world.said(request.axis).compensation in PASSING  # then it reads as it is (M9)
        if told is not None and found != told and not is_passing:
            raise BrokenRuleError(f"a limit was written as {told}, and {found} is read back (3, M1)")
    if pdu[0] == 3 and (request.pdu[1] << 8 | request.pdu[2]) == COMMAND.address:
        belief, found = world.state.beliefs[port][request.axis], int(COMMAND.unpack(pdu[2:6]))
        is_known = world.design.is_answered and world.design.is_staged and not belief.lost
        if is_known and found != belief.steps:
            raise BrokenRuleError(f"{belief.steps} was written, and {found} is read back (3, M1)")
    if pdu[0] in (3, BOTH) and (request.pdu[1] << 8 | request.pdu[2]) == ACTUAL.address:
        number = facts.number_of(world, answered.unit_id)
        step_counts = world.design.plans[number].actual[0].scale
        _judge_reading(world, number, int(ACTUAL.unpack(pdu[2:6])) * step_counts, step_counts)


def _judge_refusal(world: "World", port: int, request: "Asked", pdu: bytes, *, is_own: bool) -> None:
    """An exception has a reason (2). Raises BrokenRuleError."""
    axis, plan = world.design.plans[request.axis], world.design.controllers[port]
    is_blocked = request.pdu in RUNS and facts.is_own_blocked(world, request.axis)
    is_late = axis.late is Late.REJECT and (_is_late(world, request) or is_blocked)
    is_hushed = request.is_owed  # answered at once, for its drive is silent: nobody has looked at its target
    if world.design.groups and not (is_own or request.is_sent or is_hushed):
        _break_off_silent(world, request.axis)
    if not (is_own or request.is_sent):
        gantries.never_left(world, request)
    if request.pdu == RUN_PDU and pdu[1] == LOST and not is_own:
        _judge_refused_run(world, request)
    if axis.deadline_ms and not is_own and pdu[1] == BUSY and not is_late:
        raise BrokenRuleError(f"refused as late, and it is not: {request.pdu.hex(' ')} (2)")
    is_as_lost = is_blocked and "to-all" in world.design.menu  # triggers are refused as their target was (M3)
    if plan.serial and not is_own and pdu[1] == NO_PATH and not is_as_lost:
        raise BrokenRuleError(f"a serial controller is answered {pdu.hex(' ')}: silence says that (W7)")
    may_write = not (plan.rights.is_read_only or plan.role is Role.MONITOR)
    if not may_write and request.pdu[0] != 3 and pdu[1] != 1:
        raise BrokenRuleError(f"what has no right to write is answered {pdu.hex(' ')} (W9)")
    if pdu[1] == NO_ANSWER and not (is_own or request.is_sent):
        _judge_unasked(world, request)
    # The newest of a stop that is repeated stands for those before it: they count as unanswered.
    same = [each for each in world.state.asked[port] if each.pdu == request.pdu]
    is_repeated = pdu[1] == NO_ANSWER and bool(same) and world.design.retry_ms > 0
    if is_stop(request.pdu) and not request.is_sent and pdu[1] != NO_PATH and not is_repeated:
        raise BrokenRuleError(f"a stop was refused with {pdu[1]} (2, M3)")


def _judge_refused_run(world: "World", request: "Asked") -> None:
    """A trigger is refused only where its target, or that of its group, may have been lost (4, M3)."""
    design = world.design
    is_simple = "low" in design.menu and design.answers == ("ack",) and len(design.targets) == 1
    is_simple = is_simple and design.is_answered  # a drive that is silent for long may have lost it
    if is_simple and not world.state.beliefs[0][request.axis].lost:
        raise BrokenRuleError("a trigger is refused, and its target came whole and was acknowledged (4, M3)")


def judge_refusals(world: "World", counted: int) -> None:
    """Each request that the gateway refused is counted once (8). Raises BrokenRuleError.

    That a drive cannot be had is none. On a serial line what may not be reached is as silent as that, and of
    a controller that has gone nobody hears what it was refused.
    """
    absent = [each for each in world.refusals if each in (NO_PATH, NO_ANSWER)]
    refused = len(world.refusals) - len(absent)
    is_unclear = (
        any(plan.serial for plan in world.design.controllers) or "disconnect" in world.design.happenings
    )
    if counted < refused or (counted > refused and not (absent or is_unclear)):
        raise BrokenRuleError(f"{refused} requests were refused, and {counted} were counted (8)")


def refuse_broadcast(world: "World", port: int, request: "Asked") -> None:
    """A broadcast carries no position that each axis corrects differently, and nobody hears that (W7)."""
    end(world, port, request)
    note_lost(world, port, request)
    facts.never_sent(world, port, request, NO_PATH)


def note_broadcast(world: "World", wire: "Wire") -> None:
    """All drives have heard a frame, and none of them answers: its controller waits for nothing."""
    end(world, wire.owner, find(world, wire.owner, wire.transaction_id))
    if writes_target(wire.pdu):
        beliefs = [list(own) for own in world.state.beliefs]
        beliefs[wire.owner][0] = _written(beliefs[wire.owner][0], wire.request, wire.pdu)
        world.state = world.state._replace(beliefs=tuple(tuple(own) for own in beliefs))
    if wire.aim is not None:
        note_run(world, 0, is_told=False, is_acked=False)


def _is_behind_patience(world: "World", port: int, request: "Asked") -> bool:
    """Whether a serial controller would take a reply for the one to its next request (W6)."""
    plan = world.design.controllers[port]
    return plan.serial and request.ticks * world.tick_ns > plan.timeout_ms * NS_PER_MS


def judge_answered(world: "World", wire: "Wire") -> None:
    """What the drive has answered has reached its controller (2, W1). Raises BrokenRuleError."""
    request = _find(world, wire.owner, wire.transaction_id) if wire.owner >= 0 else None
    if request is None:
        return
    if _is_behind_patience(world, wire.owner, request):
        end(world, wire.owner, request)
    elif world.design.has_record and wire.pdu in LOOKS:
        # The gateway's own read behind a restart looks the same: the one of the controller is still to come.
        _replace(world, wire.owner, request._replace(is_sent=False))
    else:
        raise BrokenRuleError(f"the drive has answered, and nobody is told: {wire.pdu.hex(' ')} (2, W1)")


def _judge_form(world: "World", request: bytes, reply: bytes) -> None:
    """What is acknowledged is so in the form in which it was asked, with its own words (W4, M1)."""
    is_odd = "garble" in world.design.answers or "split_odd" in world.design.happenings
    if is_odd or world.design.answers_before or request[0] in (3, BOTH):
        return
    expected = request[:5] if request[0] == 16 else request
    if reply != expected:
        raise BrokenRuleError(f"{request.hex(' ')} is acknowledged with {reply.hex(' ')} (2, W4)")


def _note_seen(world: "World", read: "Wire", reply: bytes) -> None:
    """Take note of what shows that an axis has arrived."""
    number = facts.number_of(world, read.unit_id)
    axis, address = world.state.axes[number], read.pdu[1] << 8 | read.pdu[2]
    run = axis.run
    if address == ACTUAL.address:
        facts.see_proof(world, number)
        axis = world.state.axes[number]
    if address == ACTUAL.address and axis.is_owed_look:
        axis = axis._replace(is_owed_look=False, was_done=False)  # that the bit is down is nothing new
        axes = list(world.state.axes)
        axes[number] = axis
        world.state = world.state._replace(axes=tuple(axes))
    if address == STATUS and "creep" in world.design.happenings:
        # Behind a target that was not answered the bit may be down for that: the same words go out again.
        is_seen = not axis.is_done and axis.goes_counts is None and axis.was_done and axis.tried is None
        axis = axis._replace(is_seen_undone=is_seen, is_owed_look=axis.is_owed_look or is_seen)
        axes = list(world.state.axes)
        axes[number] = axis
        world.state = world.state._replace(axes=tuple(axes))
    if address == STATUS and axis.is_lost_distance and not axis.is_done:
        axis = axis._replace(is_known_moving=True)
        axes = list(world.state.axes)
        axes[number] = axis
        world.state = world.state._replace(axes=tuple(axes))
    is_done = address == STATUS and axis.is_done and axis.goes_counts is None
    if is_done and run is not None and run.lost_ns:
        dropped = read.sent_ns - run.lost_ns >= world.design.plans[number].done_drop_ms * facts.MS
        note_run(world, number, is_done_since=dropped or run.is_done_since)
    if run is not None and address == STATUS and world.design.is_done_doubtful:
        is_early = axis.is_done and axis.stands_counts != run.end_counts
        is_late = not axis.is_done and run.uncertainty > 0
        run = run._replace(uncertainty=2 if is_early or is_late else max(run.uncertainty, int(axis.is_done)))
        note_run(world, number, uncertainty=run.uncertainty)
    if run is None or not run.is_told or axis.stands_counts != run.end_counts:
        return
    seen = run.seen
    if address == ACTUAL.address:
        seen |= 1
    elif address == STATUS and axis.is_done and world.design.drop_ticks == 1:
        seen |= 2  # of a bit that drops later nobody knows at once of which motion it is
    plan = world.design.plans[number]
    if not (plan.actual or plan.done_is_in_position) and seen & 2:
        seen = 3
    axes = list(world.state.axes)
    axes[number] = axis._replace(run=run._replace(seen=seen))
    world.state = world.state._replace(axes=tuple(axes))


def judge_dry_run(world: "World", number: int, refusal: str) -> None:
    """A dry run ends where the axis was seen at its last target, and not on a way. Raises BrokenRuleError."""
    axis = world.state.axes[number]
    run = axis.run
    if run is None or not run.is_told:
        return
    is_there = axis.goes_counts is None and axis.stands_counts == run.end_counts
    if not refusal and not is_there and not run.seen:
        raise BrokenRuleError(f"a dry run ended on the way to {run.end_counts} (3)")
    if refusal and is_there and run.seen == 3 and world.state.wire is None:
        raise BrokenRuleError(f"a dry run does not end at {run.end_counts}: {refusal} (3)")


def _judge_reading(world: "World", number: int, read_counts: float, step_counts: float) -> None:
    """``step_counts``: what the register read can tell; a target between its steps reads rounded."""
    axis, said = world.state.axes[number], world.said(number)
    run, stands = axis.run, axis.stands_counts
    if axis.goes_counts is not None or axis.next_run is not None:
        return
    is_told = run is not None and run.is_told and stands == run.end_counts
    if world.design.is_stream and (said.compensation in PASSING or not is_told):
        return  # an offset that fades, and a drive that lags
    if said.compensation in PASSING:
        is_as_it_is = abs(read_counts - stands) <= ROUNDING * step_counts
        is_known = run is not None or not world.state.is_wanted
        if is_as_it_is or (is_known and said.compensation != "shadow"):
            return  # a fade leads to 1:1, and a target that was told holds; a dry run has neither
        raise BrokenRuleError(
            f"an axis that is {said.compensation} stands at {stands} and reads {read_counts} (3)"
        )
    if run is not None and is_told and run.state not in PASSING:
        if abs(read_counts - run.nominal_counts) > ROUNDING * step_counts:
            raise BrokenRuleError(
                f"the axis stands where target {run.nominal_counts} has sent it, at {stands}, and reads "
                f"{read_counts} (3)"
            )
        return
    if said.direction == "unsure":
        return
    low, high = _band(world, stands)
    slack = SLOPE_COUNTS * max(step_counts, world.design.step_counts)
    if not low - slack <= read_counts <= high + slack:
        raise BrokenRuleError(
            f"the drive stands at {stands} and reads {read_counts}: {low:.1f} to {high:.1f} (3)"
        )


def _band(world: "World", stands: int) -> tuple[float, float]:
    """Nominal positions that a place of the drive may stand for; 1:1 is one of them, at first."""
    spread = 0.0
    found = [float(stands)]
    for screw in world.screws:
        forward, backward = screw.corrected(stands)
        spread = max(spread, abs(forward - backward))
        found += [2 * stands - forward, 2 * stands - backward]
    return min(found) - spread, max(found) + spread


def judge_direction(world: "World", number: int, said: "Said") -> None:
    """What is said of the direction is that of the branch on which the axis stands (8). BrokenRuleError."""
    axis = world.state.axes[number]
    run = axis.run
    is_lost = axis.is_lost_distance and axis.is_known_moving and axis.goes_counts is not None
    if is_lost and said.compensation in ("active", "blocked") and said.direction != "unsure":
        raise BrokenRuleError(f"a distance was lost and runs, and it is said: {said.direction} (8, M5)")
    if run is None or not run.is_told or run.is_unsure or run.state != "active" or world.design.is_stream:
        return
    if axis.next_run is not None or "homed_bit" in world.design.happenings:
        return  # it goes on from there; or its reference was lost and found where it stands
    if said.compensation != "active" or axis.stands_counts != run.end_counts or axis.goes_counts is not None:
        return
    is_same = (run.table, run.is_gain_half) == (world.state.table, world.state.is_gain_half)
    if not is_same or not world.state.is_wanted:
        return
    share = 0.5 if run.is_gain_half else 1.0
    branches = world.screws[run.table].corrected(run.nominal_counts)
    names = ("forward", "backward") if world.screws[run.table].counts_per_mm > 0 else ("backward", "forward")
    for name, corrected in zip(names, branches, strict=True):
        end = run.nominal_counts + share * (corrected - run.nominal_counts)
        if abs(run.end_counts - end) <= ONE * world.design.step_counts and said.direction != name:
            raise BrokenRuleError(
                f"the axis has come to {run.end_counts} {name}, and it is said: {said.direction} (8)"
            )


# --- two ways through ---------------------------------------------------------------------------------


def compare(first: "Side", second: "Side") -> None:
    """Hold the fast path against the slow one (7). Raises BrokenRuleError."""
    frames: tuple[Any, Any] = (first.link.sent, second.link.sent)
    if frames[0] != frames[1]:
        shown = [" | ".join(f"{unit_id} {pdu.hex(' ')}" for unit_id, pdu in each) for each in frames]
        raise BrokenRuleError(
            f"the fast path sends {shown[0] or 'nothing'}, the slow one {shown[1] or 'nothing'} (7)"
        )
    for one, other in zip(first.replies, second.replies, strict=True):
        if one != other:
            shown = [" | ".join(pdu.hex(" ") for _, pdu in each) for each in (one, other)]
            raise BrokenRuleError(f"the fast path answers {shown[0]}, the slow one {shown[1]} (7)")
    if first.link.is_abandoned is not second.link.is_abandoned:
        raise BrokenRuleError("only one of both ways gives the reply up (7)")


def is_settled(world: "World") -> bool:
    """Whether everything is as it should be: referenced, corrected, standing where it was sent (6)."""
    state = world.state
    if not (world.is_quiet and state.is_up):
        return False
    for number, axis in enumerate(state.axes):
        said, run = world.said(number), axis.run
        if said.compensation != "active" or said.direction in ("unsure", "unknown"):
            return False
        if run is None or not run.is_told or run.is_unsure or axis.stands_counts != run.end_counts:
            return False
    return True
