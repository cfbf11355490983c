"""What a person beside the machine could have written down of each axis, and what follows from it (8, 9).

Nothing of it is worked out by the gateway: what the drive was told and what it answered, what it was seen to
say, for how long it said nothing, what of a target was lost. What the status and the events say has to agree.
"""

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final, NamedTuple

from gateway.catalogue import exchange_events
from gateway.catalogue.entry import EventEntry
from gateway.exchange.events import Event
from gateway.exchange.plan import AxisPlan, Reference, Role
from gateway.exchange.rights import UNLIMITED
from tests.exchange.line_bench import ACTUAL
from tests.exchange.staged_bench import (
    HOME,
    JOG,
    MODE,
    RUN,
    RUN_RELATIVE,
    STOP,
    STORED,
    TRIGGER,
    ZERO,
)
from tests.verify import rules
from tests.verify.errors import BrokenRuleError

if TYPE_CHECKING:
    from tests.verify.snapshot import Said
    from tests.verify.world import Asked, Wire, World

MS: Final = 1_000_000
SETTLE_NS: Final = 100 * MS
"""A bit that is still set so soon after a homing command may be that of the homing before (M9)."""
BIT_COUNTS_NS: Final = 1000 * MS
"""A homed bit that was seen longer ago is read again before a target."""
OTHER_MOTIONS: Final = frozenset({HOME, JOG, STORED, ZERO})
NO_REPLY: Final = 0x0B
LOST: Final = 4
"""Exception code of what was lost without one."""
TOLD_AFTER: Final[dict[EventEntry, tuple[Callable[["Said"], bool], bool]]] = {
    exchange_events.AXIS_BLOCKED: (lambda said: said.is_own_blocked, True),
    exchange_events.AXIS_RELEASED: (lambda said: said.is_own_blocked, False),
    exchange_events.DIRECTION_UNSURE: (lambda said: said.direction == "unsure", True),
}
"""Events that tell of a change of what is said, with what is said afterwards."""


class Facts(NamedTuple):
    """What is known of one axis."""

    is_found: bool
    """Its positions mean something (M9)."""
    is_told: bool
    """Somebody has said so, or the opposite, since the start."""
    is_homing: bool = False
    """A homing command was obeyed, and not yet its end seen."""
    homing_ns: int = 0
    """When it was, or a bit that shows that it has begun; 0: long ago."""
    is_doubted: bool = True
    """The homed bit may have changed since it was seen."""
    seen_ns: int = 0
    """When it was seen."""
    is_moving: bool = False
    """The drive has said that it moves, and not yet the opposite."""
    is_alarmed: bool = False
    silent_since_ns: int = 0
    silent_until_ns: int = 0
    """The first and the last request since then that it left unanswered; 0: it answers."""
    told_found: bool | None = None
    """What was told of it last."""
    restaged_ns: int = 0
    """When it was told that a target was written anew: once a minute."""
    hunts_ns: int = 0
    """When it was told last that its branch changes all the time; 0: never."""
    has_told_began: bool = False
    """It was told with what offset its stream has begun: once, until it begins anew."""
    is_mode_lost: bool = False
    """The writing of its mode register was not acknowledged."""
    has_to_decide: bool = False
    """Its place was read, or something was sent that moves it: that decides a record which is open yet."""
    was_strange: bool = False
    """A value that no register map knows has passed while it was corrected."""
    has_told_unknown: bool = False
    """It was told of the value that no register map knows: once for the same contents."""
    is_recalling: bool = False
    """It is not decided yet whether the record of the run before counts."""
    block: str = ""
    """Whether a target was lost: for its own sake, or because another axis of the group had lost its own."""
    block_code: int = 0
    """Exception code of the loss; 0: not known."""
    is_owed_proof: bool = False
    """Reach or reference of it, or of its group, was lost or came back, and nobody has read its place since:
    its target of before counts only by proof."""
    is_stale: bool = False
    """Something was lost since the frame on the wire has left."""
    read_ns: int = 0
    """When its place was read, if it was told nothing since."""
    uncounted_ns: int = 0
    """When its place was read last before its reference changed; a reading of that moment is not newer."""
    heard_ns: int = 0
    """When it was told something that it acknowledged, or said where it is."""


def first(plan: AxisPlan) -> Facts:
    """Return what is known of an axis at the start."""
    is_found = plan.referenced is Reference.ABSOLUTE
    is_told = plan.referenced is not Reference.DRIVE_BIT
    return Facts(is_found, is_told, told_found=is_found if is_told else None)


def _of(world: "World", number: int) -> Facts:
    found = world.state.axes[number].facts
    assert found is not None
    return found


def note(world: "World", number: int, facts: Facts) -> None:
    """Write down what is known of an axis now."""
    axes = list(world.state.axes)
    was = axes[number].facts
    if was is not None and was.is_found is not facts.is_found:
        # It may have been counted from another zero.
        facts = facts._replace(read_ns=0, uncounted_ns=facts.read_ns)
        owe_proof(world, range(len(axes)) if world.design.groups else ())
        axes = list(world.state.axes)
        facts = facts._replace(is_owed_proof=True)
    if was != facts:
        axes[number] = axes[number]._replace(facts=facts)
        world.state = world.state._replace(axes=tuple(axes))


def owe_proof(world: "World", numbers: Iterable[int]) -> None:
    """Reach or reference of some axes was lost or came back."""
    axes = list(world.state.axes)
    for number in numbers:
        known = axes[number].facts
        if known is not None:
            axes[number] = axes[number]._replace(facts=known._replace(is_owed_proof=True))
    world.state = world.state._replace(axes=tuple(axes))


def owes_proof(world: "World", number: int) -> bool:
    """Whether a target of before a loss counts only once the place of its axis was read."""
    return _of(world, number).is_owed_proof


def see_proof(world: "World", number: int) -> None:
    """The place of an axis was read."""
    if _of(world, number).is_owed_proof:
        note(world, number, _of(world, number)._replace(is_owed_proof=False))


def number_of(world: "World", unit_id: int) -> int:
    """Return which axis has a unit id; worlds with broadcasts have one."""
    if not unit_id:
        return 0
    return next(i for i, plan in enumerate(world.design.plans) if plan.unit_id == unit_id)


# --- what happens -------------------------------------------------------------------------------------


def answered(world: "World", wire: "Wire", reply: bytes, *, is_native: bool) -> None:
    """The drive has answered a frame."""
    number = number_of(world, wire.unit_id)
    plan = world.design.plans[number]
    facts = _heard_again(_of(world, number), plan)
    is_place = wire.pdu[0] == 3 and wire.pdu[1] << 8 | wire.pdu[2] == ACTUAL.address
    if is_native and (wire.aim is not None or is_place):
        facts = facts._replace(heard_ns=wire.sent_ns if is_place else world.now_ns)
    if wire.pdu[0] != 3:
        facts = facts._replace(read_ns=0)
    elif is_place and is_native:
        is_decided = facts.is_told and facts.is_found and not world.design.is_stream
        facts = facts._replace(read_ns=wire.sent_ns, has_to_decide=facts.has_to_decide or is_decided)
    if wire.pdu[0] == 3:
        facts = _read(world, facts, plan, wire, reply)
    else:
        facts = _reference_after(facts, plan, wire, world.now_ns, is_obeyed=is_native)
    _owe_look(world, number, facts)
    note(world, number, facts)
    if wire.pdu[0] == 16 and wire.owner < 0 and is_native:
        _written_anew(world, number)
    if wire.pdu[0] != 3:
        code = reply[1] if len(reply) == 2 and reply[0] & 0x80 else LOST
        _target_ended(world, number, wire, code, is_native=is_native)


def left(world: "World", wire: "Wire") -> None:
    """A frame has left: after all that was lost so far."""
    mine = number_of(world, wire.unit_id)
    if _is_run(wire.pdu) and _of(world, mine).is_mode_lost and world.said(mine).compensation == "active":
        raise BrokenRuleError("a trigger leaves whose mode was lost (4, M3)")
    if wire.aim is not None or _triggered(wire.pdu) in OTHER_MOTIONS:
        note(world, mine, _of(world, mine)._replace(has_to_decide=True))
    if _triggered(wire.pdu) == 999 and world.said(mine).compensation == "active":
        note(world, mine, _of(world, mine)._replace(was_strange=True))
    for number in range(len(world.state.axes)):
        note(world, number, _of(world, number)._replace(is_stale=False))


def unanswered(
    world: "World", wire: "Wire", *, is_cut: bool = False, has_said_something: bool = False
) -> None:
    """The drive has not answered a frame in time.

    ``is_cut``: because the link went; ``has_said_something``: what may be a late answer to another one ended
    the wait, so that it was not silent.
    """
    number = number_of(world, wire.unit_id)
    plan = world.design.plans[number]
    facts = _of(world, number)
    facts = facts._replace(read_ns=0)
    if is_cut:
        facts = _fell_silent(world, facts, plan)
    if wire.pdu[0] != 3:
        facts = _reference_after(facts, plan, wire, world.now_ns, is_obeyed=False)
    if not is_cut and not has_said_something:
        facts = _fell_silent(world, facts, plan, wire.sent_ns)
    note(world, number, facts)
    rules.note_other_lost(world, number, wire)
    if wire.pdu[0] != 3:
        _target_ended(world, number, wire, NO_REPLY, is_native=False)


def link_lost(world: "World", unit_ids: set[int]) -> None:
    """The way to the drives was lost; of some a frame was on it."""
    for number, plan in enumerate(world.design.plans):
        if plan.unit_id not in unit_ids:
            note(world, number, _fell_silent(world, _of(world, number), plan))
    owe_proof(world, range(len(world.design.plans)))


def link_found(world: "World") -> None:
    """The drives can be reached again: so long they may have been switched off."""
    for number, plan in enumerate(world.design.plans):
        facts = _of(world, number)
        if facts.silent_since_ns:
            facts = facts._replace(silent_until_ns=world.now_ns)
        note(world, number, _heard_again(facts, plan))


def declared(world: "World", number: int) -> None:
    """A person says that the axis stands where its drive says."""
    if world.design.plans[number].referenced is not Reference.DRIVE_BIT:
        rules.note_run(world, number, is_acked=False)  # somebody was there: to look once more does no harm
        note(world, number, _of(world, number)._replace(is_found=True, is_homing=False))


def never_sent(world: "World", port: int, request: "Asked", code: int) -> None:
    """A request was lost before it had left; of who may not write nothing is lost (W9)."""
    plan = world.design.controllers[port]
    if plan.rights != UNLIMITED or plan.role is not Role.MOTION:
        return
    number = request.axis
    if _is_mode(request.pdu):
        note(world, number, _of(world, number)._replace(is_mode_lost=True))
    is_run = _is_run(request.pdu) or (_is_target(request.pdu) and not world.design.is_staged)
    if _is_target(request.pdu) or (is_run and world.design.groups and not _blocked_peers(world, number)):
        _lose(world, number, code, is_run=is_run)
        if world.state.wire is not None:
            note(world, number, _of(world, number)._replace(is_stale=True))


def _owe_look(world: "World", number: int, facts: Facts) -> None:
    """After an alarm that was seen nobody knows where the axis is."""
    axis, plan = world.state.axes[number], world.design.plans[number]
    is_old = world.now_ns - facts.read_ns > plan.settings.fresh_ms * MS
    is_new = facts.is_alarmed and not _of(world, number).is_alarmed
    if is_new:
        rules.note_run(world, number, is_acked=False, is_told=False)
        axis = world.state.axes[number]
    if is_new and is_old and plan.referenced is Reference.ABSOLUTE and facts.is_found:
        axes = list(world.state.axes)
        axes[number] = axis._replace(is_owed_look=True)
        world.state = world.state._replace(axes=tuple(axes))


WITHIN_MINUTE_NS: Final = 50 * 1000 * MS
"""Well within the minute in which it is not told again."""


def _written_anew(world: "World", number: int) -> None:
    """A staged target was written anew, which is told once a minute (9)."""
    facts, name = _of(world, number), world.design.plans[number].name
    is_told = any(event.kind is exchange_events.RESTAGED and event.axis == name for event in world.told)
    age_ns = world.now_ns - facts.restaged_ns
    if is_told and age_ns < WITHIN_MINUTE_NS:
        raise BrokenRuleError("restaged is told again within a minute (9)")
    if not is_told and not facts.restaged_ns:
        raise BrokenRuleError("restaged is not told (9)")
    if is_told:
        note(world, number, facts._replace(restaged_ns=world.now_ns))


def restarted(world: "World", wire: "Wire | None", *, has_record: bool) -> None:
    """The gateway was started again; its record says nothing of what else moves an axis, on the wire (5)."""
    for number, plan in enumerate(world.design.plans):
        is_mine = wire is not None and wire.unit_id == plan.unit_id
        is_unknown = wire is not None and is_mine and _triggered(wire.pdu) in OTHER_MOTIONS
        is_written = has_record and world.records.read(plan.name) is not None
        note(world, number, first(plan)._replace(is_recalling=is_written and not is_unknown))


def _fell_silent(world: "World", facts: Facts, plan: AxisPlan, sent_ns: int = 0) -> Facts:
    """``sent_ns``: when the request left that was not answered; none where the link went."""
    if plan.referenced is Reference.ABSOLUTE and not (world.design.judges_proof or world.design.groups):
        return facts
    since_ns = facts.silent_since_ns or sent_ns or world.now_ns
    return facts._replace(silent_since_ns=since_ns, silent_until_ns=world.now_ns, is_doubted=True)


def was_out_of_reach(world: "World", number: int) -> bool:
    """Whether a drive that has just answered was silent for so long that it may have been switched off."""
    facts = _of(world, number)
    return bool(facts.silent_since_ns) and _was_lost_long(facts, world.design.plans[number])


def _was_lost_long(facts: Facts, plan: AxisPlan) -> bool:
    return facts.silent_until_ns - facts.silent_since_ns > plan.lost_ms * MS


def _heard_again(facts: Facts, plan: AxisPlan) -> Facts:
    if not facts.silent_since_ns:
        return facts
    if _was_lost_long(facts, plan):
        facts = _lost(facts, plan)._replace(is_owed_proof=True)
    return facts._replace(silent_since_ns=0, silent_until_ns=0)


def _lost(facts: Facts, plan: AxisPlan) -> Facts:
    """The drive may have been switched off, or has given up."""
    is_found = facts.is_found and plan.referenced in (Reference.ABSOLUTE, Reference.DRIVE_BIT)
    return facts._replace(is_found=is_found, is_homing=False, homing_ns=0, is_doubted=True)


def _read(world: "World", facts: Facts, plan: AxisPlan, wire: "Wire", reply: bytes) -> Facts:
    """Somebody has read the status word, or was refused."""
    address = wire.pdu[1] << 8 | wire.pdu[2]
    if all(bit.address != address for bit in plan.bits.values()):
        return facts
    is_own = wire.owner < 0
    if is_own and "distance" in world.design.menu:
        return facts  # whether it stands
    is_answer = reply[0] == 3 and len(reply) == 2 + 2 * (wire.pdu[3] << 8 | wire.pdu[4])
    word = reply[2] << 8 | reply[3] if is_answer else None
    if word is None and not is_own:
        return facts
    for name, bit in plan.bits.items():
        if bit.address != address:
            continue
        is_set = word is not None and bit.is_set(word)
        if name == _end_of_homing(plan):
            facts = _bit_seen(facts, plan, wire.sent_ns, is_set=is_set)
        elif name == "moving" and not is_own:
            facts = facts._replace(is_moving=is_set)
        elif name == "alarm" and not is_own:
            facts = _lost(facts, plan) if is_set and not facts.is_alarmed else facts
            facts = facts._replace(is_alarmed=is_set, is_moving=False if is_set else facts.is_moving)
    return facts


def _end_of_homing(plan: AxisPlan) -> str:
    return "done" if plan.referenced is Reference.HOMING and "homed" not in plan.bits else "homed"


def _bit_seen(facts: Facts, plan: AxisPlan, asked_ns: int, *, is_set: bool) -> Facts:
    is_early = facts.is_homing and asked_ns - facts.homing_ns < SETTLE_NS
    if plan.referenced is Reference.DRIVE_BIT:
        if is_set and is_early:
            return facts
        if is_set:
            facts = facts._replace(is_homing=False)
        return facts._replace(
            is_found=is_set, is_told=True, is_doubted=False, seen_ns=asked_ns,
            homing_ns=0 if not is_set or not facts.is_homing else facts.homing_ns,
        )  # fmt: skip
    if plan.referenced is not Reference.HOMING or not facts.is_homing:
        return facts
    if not is_set:
        return facts._replace(homing_ns=0)
    return facts if is_early else facts._replace(is_found=True, is_homing=False, homing_ns=0)


def _reference_after(facts: Facts, plan: AxisPlan, wire: "Wire", now_ns: int, *, is_obeyed: bool) -> Facts:
    """What a command leaves of the reference. Not obeyed: nobody knows whether it was."""
    if wire.owner < 0:
        return facts
    value = _triggered(wire.pdu)
    way = plan.referenced
    if _is_mode(wire.pdu):
        return facts._replace(is_mode_lost=not is_obeyed)
    if value in (HOME, ZERO):  # counted from another zero, a stream begins anew
        facts = facts._replace(has_told_began=False)
    if value is None or value in (RUN, RUN_RELATIVE):
        is_other = is_obeyed and wire.aim is not None
        return facts._replace(is_homing=False, homing_ns=0, is_moving=False) if is_other else facts
    if value == HOME:
        facts = facts._replace(is_homing=is_obeyed, homing_ns=now_ns if is_obeyed else 0, is_doubted=True)
        facts = facts if way is Reference.ABSOLUTE else facts._replace(is_found=False)
    elif value == ZERO:
        is_at_rest = is_obeyed and not facts.is_moving
        facts = facts._replace(is_homing=False, homing_ns=0, is_doubted=True)
        facts = facts._replace(is_found=way is Reference.SET_POSITION and is_at_rest)
    else:
        facts = facts._replace(is_homing=False, homing_ns=0)
    return facts._replace(is_moving=False)


def _triggered(pdu: bytes) -> int | None:
    if pdu in (rules.COIL_RUN_PDU, rules.COIL_IDLE_PDU):
        return RUN if pdu == rules.COIL_RUN_PDU else 0
    if pdu[0] != 6 or pdu[1] << 8 | pdu[2] != TRIGGER:
        return None
    return pdu[3] << 8 | pdu[4]


def _is_mode(pdu: bytes) -> bool:
    return pdu[0] == 6 and pdu[1] << 8 | pdu[2] == MODE


def is_other_motion(pdu: bytes) -> bool:
    """Whether a frame stops an axis, or moves it otherwise than to a target."""
    return _triggered(pdu) in OTHER_MOTIONS | {STOP, 999}


def _is_run(pdu: bytes) -> bool:
    return _triggered(pdu) in (RUN, RUN_RELATIVE)


def _is_target(pdu: bytes) -> bool:
    return rules.writes_target(pdu)


def is_unseen(world: "World", number: int) -> bool:
    """Whether somebody may have moved an axis since anything was heard of it (M6)."""
    return world.now_ns - _of(world, number).heard_ns > world.design.plans[number].unseen_ms * MS


def is_just_read(world: "World", number: int) -> bool:
    """Whether the place of an axis was read at this very moment."""
    facts = _of(world, number)
    return facts.read_ns == world.now_ns != facts.uncounted_ns


def why_no_bit(world: "World", number: int, *, is_target: bool, is_read: bool) -> str:
    """Return why the bit on which a reference hangs need not be read (W8, M9); empty where it must."""
    facts, plan = _of(world, number), world.design.plans[number]
    if plan.referenced is Reference.HOMING:
        return "" if facts.is_homing and is_target else "no homing has to end before a target"
    if plan.referenced is not Reference.DRIVE_BIT:
        return "no bit decides"
    is_old = not facts.is_found or world.now_ns - facts.seen_ns > BIT_COUNTS_NS
    if facts.is_doubted or world.design.jog_is_jump or (is_target and is_old):
        return ""
    return "the bit was seen, and nothing has happened since"


def is_found(world: "World", number: int) -> bool:
    """Whether an axis knows where it is, as far as anybody has seen."""
    return _of(world, number).is_found


def has_to_ask(world: "World", number: int, *, is_target: bool) -> bool:
    """Whether the bit on which a reference hangs has to be read before a position passes (M9)."""
    facts, plan = _of(world, number), world.design.plans[number]
    if not (plan.safe_read and plan.added_frames) or world.design.jog_is_jump:
        return False
    if plan.referenced is Reference.HOMING:
        is_lost = bool(facts.silent_since_ns) and _was_lost_long(facts, plan)
        return is_target and facts.is_homing and not is_lost
    if plan.referenced is not Reference.DRIVE_BIT:
        return False
    is_old = not facts.is_found or world.now_ns - facts.seen_ns > BIT_COUNTS_NS
    return facts.is_doubted or (is_target and is_old)


# --- targets that were lost ---------------------------------------------------------------------------


def is_own_blocked(world: "World", number: int) -> bool:
    """Whether a target of an axis was lost for its own sake."""
    return _of(world, number).block == "own"


def _blocked_peers(world: "World", number: int) -> bool:
    if not world.design.groups:
        return False
    return any(_of(world, i).block == "own" for i in range(len(world.state.axes)) if i != number)


def _lose(world: "World", number: int, code: int, *, is_run: bool) -> None:
    if not (world.design.is_staged or world.design.groups):
        return
    facts = _of(world, number)
    is_own = not (is_run and _blocked_peers(world, number))
    block = "own" if is_own or facts.block == "own" else "of-group"
    code = facts.block_code if facts.block else code
    note(world, number, facts._replace(block=block, block_code=code))


def _target_ended(world: "World", number: int, wire: "Wire", code: int, *, is_native: bool) -> None:
    pdu = wire.request or wire.pdu
    is_target, is_run = _is_target(pdu), _is_run(pdu)
    facts = _of(world, number)
    is_stale = facts.is_stale
    note(world, number, facts._replace(is_stale=False))
    if not is_native:
        is_passing = (
            wire.aim is not None and wire.aim.state in rules.PASSING and world.passes_unchanged(number)
        )
        if code != NO_REPLY and is_passing and is_target:
            return  # its drive refused what passed 1:1: that is between it and its controller (M9)
        if is_target or (is_run and world.design.groups and not _blocked_peers(world, number)):
            _lose(world, number, code, is_run=is_run or not world.design.is_staged)
    elif is_target and not is_stale and wire.owner >= 0 and not world.state.beliefs[wire.owner][number].lost:
        note(world, number, _of(world, number)._replace(block="", block_code=0))


# --- what has to be said ------------------------------------------------------------------------------


def judge(
    world: "World",
    before: "tuple[Said, ...]",
    after: "tuple[Said, ...]",
    told: list[Event],
    *,
    is_restart: bool,
) -> None:
    """Hold what is said against what is known (8) and against what was told (9). Raises BrokenRuleError."""
    for number, plan in enumerate(world.design.plans):
        said = after[number]
        _judge_reference(world, number, said)
        is_off = said.compensation in ("off", "shadow")
        if "remap" not in world.design.menu and is_off is world.state.is_wanted:
            raise BrokenRuleError(f"it is said: {said.compensation}, whatever was switched (8)")
        _judge_block(world, number, said)
        rules.judge_direction(world, number, said)
        if not is_restart:
            _judge_events(world, plan.name, before[number], said, told)
            _judge_told_reference(world, number, said, told)
        _judge_told_once(world, number, [event.kind for event in told if event.axis == plan.name])


def _judge_reference(world: "World", number: int, said: "Said") -> None:
    facts = _of(world, number)
    if facts.silent_since_ns and _was_lost_long(facts, world.design.plans[number]):
        return  # it is lost with the next request
    members = range(len(world.state.axes)) if world.design.groups else (number,)
    is_found = all(_of(world, i).is_found for i in members)
    if said.is_referenced is not is_found:
        what = "is referenced" if said.is_referenced else "is not referenced"
        raise BrokenRuleError(f"it is said that the axis {what}, and nobody has a reason to think so (8, M9)")
    if said.is_reference_told is not facts.is_told:
        what = "is" if facts.is_told else "is not"
        raise BrokenRuleError(
            f"the bit on which its reference hangs {what} known, and it is said otherwise (8)"
        )


def _judge_block(world: "World", number: int, said: "Said") -> None:
    design = world.design
    if not world.is_quiet or world.state.given_up or len(design.controllers) > 1 or not design.judges_blocks:
        return
    is_blocked = bool(_of(world, number).block) or _blocked_peers(world, number)
    if said.is_blocked and "low" in design.menu:
        return  # of words that were joined with others before they were lost nobody knows enough
    if said.is_blocked is not is_blocked:
        what = "are refused, and no target was lost" if said.is_blocked else "pass, and a target was lost"
        raise BrokenRuleError(f"it is said that triggers {what} (8, M3)")


def _judge_events(world: "World", name: str, before: "Said", after: "Said", told: list[Event]) -> None:
    """Each change is told once: at once, or with the answer to the frame that leaves with it."""
    own = [event.kind for event in told if event.axis == name]
    owed = set(world.state.owed)
    for kind, (what, value) in TOLD_AFTER.items():
        was, is_now = what(before) is value, what(after) is value
        is_back = False
        if kind is exchange_events.DIRECTION_UNSURE:
            # What fell and rose again while a frame was on its way is no change for who is told of it.
            fell = (name, f"no {kind.name}")
            is_back = is_now and not was and fell in owed
            if world.state.wire is None or is_now:
                owed.discard(fell)
            elif was:
                owed.add(fell)
        is_due = (is_now and not was and not is_back) or (name, kind.name) in owed
        others = sum(each is not kind and each in TOLD_AFTER and TOLD_AFTER[each][0] is what for each in own)
        most = is_due + others + (kind is exchange_events.DIRECTION_UNSURE and not was)
        if own.count(kind) > most and kind is not exchange_events.AXIS_BLOCKED:  # told with each refusal, too
            raise BrokenRuleError(f"{kind.name} is told {own.count(kind)} times, and it is not new (9)")
        owed.discard((name, kind.name))
        if is_due and is_now and kind not in own:
            if world.state.wire is None:
                raise BrokenRuleError(f"{kind.name} is not told, and it is so now (9)")
            owed.add((name, kind.name))
    if owed != set(world.state.owed):
        world.state = world.state._replace(owed=tuple(sorted(owed)))


def _judge_told_once(world: "World", number: int, told: list[EventEntry]) -> None:
    """A record is decided once, and of what nobody knows is told once (9)."""
    facts = _of(world, number)
    decided = told.count(exchange_events.RESTORED) + told.count(exchange_events.RECORD_NOT_USED)
    if decided > facts.is_recalling:
        raise BrokenRuleError("a record is decided, and there is none that is open (9)")
    unknown = told.count(exchange_events.UNKNOWN_MODE)
    if unknown + facts.has_told_unknown > 1:
        raise BrokenRuleError("unknown-mode is told again for the same contents (9)")
    is_open = facts.is_recalling and not decided
    if is_open and facts.has_to_decide and world.state.wire is None and not world.design.groups:
        raise BrokenRuleError("the record is not decided, and what decides it has come (5)")
    if exchange_events.STREAM_BEGAN in told:
        if facts.has_told_began:
            raise BrokenRuleError("stream-began is told again, and nothing has ended it (9)")
        facts = facts._replace(has_told_began=True)
        note(world, number, facts)
    if exchange_events.BRANCH_HUNTS in told:
        if facts.hunts_ns and world.now_ns - facts.hunts_ns < WITHIN_MINUTE_NS:
            raise BrokenRuleError("branch-hunts is told again within a minute (9)")
        facts = facts._replace(hunts_ns=world.now_ns)
        note(world, number, facts)
    if decided or unknown:
        is_recalling = facts.is_recalling and not decided
        facts = facts._replace(
            is_recalling=is_recalling, has_told_unknown=facts.has_told_unknown or bool(unknown)
        )
        note(world, number, facts)
    wire = world.state.wire
    if "strange" in world.design.menu and wire is None and facts.was_strange and not facts.has_told_unknown:
        raise BrokenRuleError("what no register map knows has passed, and unknown-mode is not told (9)")


def _judge_told_reference(world: "World", number: int, said: "Said", told: list[Event]) -> None:
    """Found and lost are told in turn, and what was told last is so."""
    was = is_found = _of(world, number).told_found
    for event in told:
        is_new = {exchange_events.AXIS_REFERENCED: True, exchange_events.REFERENCE_LOST: False}.get(
            event.kind
        )
        if is_new is None or event.axis != world.design.plans[number].name:
            continue
        if is_new is is_found:
            raise BrokenRuleError(f"{event.kind.name} is told, and it is not new (9)")
        is_found = is_new
    if is_found is not was:
        note(world, number, _of(world, number)._replace(told_found=is_found))
    if world.state.wire is None and said.is_reference_told and is_found is not said.is_referenced:
        raise BrokenRuleError(f"the reference is {said.is_referenced}, and what was told is {is_found} (9)")


__all__ = ["STOP", "STORED", "Facts", "answered", "declared", "first", "judge", "never_sent", "unanswered"]
