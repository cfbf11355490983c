"""What readings of an axis at standstill show about its register map and its numbers. No requests here."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final

from gateway.commissioning.probe.readings import (
    LAST_UNIT_ID,
    AxisReadings,
    OnWrongCrc,
    ProbedRegister,
    RegisterReading,
)
from gateway.compensation.correction_spec import spec_of_table
from gateway.compensation.settings import AxisSettings
from gateway.exchange.field_counts import counts_of
from gateway.exchange.plan import ALARM_BIT, DONE_BIT, HOMED_BIT, MOVING_BIT, AxisPlan, Reference
from gateway.metrology.scale import TRIAL_MOVE
from gateway.modbus.registers import PositionField, WordOrder

FORBID: Final = (
    "write checks_crc = false into its registers, so that the gateway does not use cut-through to it"
)
UNSEEN: Final = (
    "Map another register, or remove this one from the map: without it the gateway cannot read the "
    "position before a move. It then assumes the direction, with a flag, and refuses distances with "
    "exception 6"
)
HIGH_WORD: Final = 0x10000


class Weight(Enum):
    """Severity: an error is wrong, a warning must be known before the first move."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"


@dataclass(frozen=True, slots=True)
class ProbeFinding:
    """One sentence: what was found, and the remedy."""

    weight: Weight
    text: str


@dataclass(frozen=True, slots=True)
class MachinePosition:
    """A position on the drive's scale in machine units, with its nominal position on either branch."""

    raw: float
    corrected: float
    forward: float
    backward: float


def other_order(field: PositionField) -> PositionField:
    """Return the field with its words swapped."""
    is_high = field.order is WordOrder.HIGH_FIRST
    return replace(field, order=WordOrder.LOW_FIRST if is_high else WordOrder.HIGH_FIRST)


def machine_position(settings: AxisSettings, field: PositionField, raw: float) -> float:
    """Return the machine position in a register's content, in units."""
    return (counts_of(field, raw) - settings.zero_counts) / settings.counts_per_unit


def position_of(plan: AxisPlan, reading: RegisterReading) -> MachinePosition:
    """Return the meaning of a reading; nominal positions are on the controller's scale."""
    field, raw = reading.register.field, reading.raw
    assert field is not None
    assert raw is not None
    settings = plan.settings
    corrected = machine_position(settings, field, raw)
    forward = backward = corrected
    if plan.table is not None:
        spec = spec_of_table(plan.table, settings)
        forward, backward = (spec.map_at(share).nominal(corrected) for share in (1.0, 0.0))
    offset = settings.machine_offset
    return MachinePosition(raw, corrected, forward - offset, backward - offset)


def findings_of(found: AxisReadings) -> list[ProbeFinding]:
    """Return all that is wrong, and all that must be known before the first move."""
    findings = [*_echoes(found), *_answers(found), *_bits(found)]
    for name in ("actual", "commanded", "command"):
        reading = found.of(name)
        if reading is not None:
            findings += _position_findings(found, reading)
    return [
        *findings,
        *_word_order_unclear(found),
        *_agreement(found),
        *_steadiness(found),
        *_scale(found),
        *_unit_ids(found),
        *_check_sums(found),
    ]


def _check_sums(found: AxisReadings) -> Iterator[ProbeFinding]:
    """Whether the map gives the drive's reaction to a wrong CRC."""
    did, is_mapped = found.on_wrong_crc, found.plan.checks_crc
    if did is OnWrongCrc.ANSWERED:
        text = "it executes a read with a wrong CRC: noise can move it"
        yield _warning(text) if not is_mapped else _error(f"{text}; {FORBID}")
    elif did is OnWrongCrc.REFUSED and is_mapped:
        yield _error(f"it answers a read with a wrong CRC, but the standard requires silence; {FORBID}")
    elif did is OnWrongCrc.SILENT and not is_mapped:
        yield _remark("it does not answer frames with a wrong CRC, although its map says checks_crc = false")


def _remark(text: str) -> ProbeFinding:
    return ProbeFinding(Weight.NOTE, text)


def _error(text: str) -> ProbeFinding:
    return ProbeFinding(Weight.ERROR, text)


def _warning(text: str) -> ProbeFinding:
    return ProbeFinding(Weight.WARNING, text)


def _echoes(found: AxisReadings) -> Iterator[ProbeFinding]:
    if found.echoes:
        yield _error(
            f"{found.echoes}; otherwise the gateway takes the returned write for its acknowledgement"
        )


def _answers(found: AxisReadings) -> Iterator[ProbeFinding]:
    if found.instead:
        yield _error(
            f"unit id {found.plan.unit_id} {found.instead}, so its replies cannot be used: update the "
            "firmware of the drive or its converter, or use a converter that returns the transaction id; "
            "if it speaks RTU over TCP, use rtu_over_tcp"
        )
        return
    if found.readings and not found.answers:
        problem = next(iter(found.readings.values())).problem
        yield _error(
            f"no drive answers as unit id {found.plan.unit_id} here: {problem}; {_who_answers(found)}; check "
            "that the drive is on, its unit id, and on a serial line baud rate, parity, wiring A/B and "
            "termination"
        )
        return
    for reading in found.readings.values():
        if reading.problem:
            unseen = f". {UNSEEN}" if reading.is_refused and reading.register.name == "actual" else ""
            yield _error(f"{reading.register}: {reading.problem}{unseen}")
    if not found.plan.actual:
        yield _warning("no actual position is mapped: the gateway cannot see where the axis is")
    for why in found.left_out:
        yield _warning(why)


def _who_answers(found: AxisReadings) -> str:
    if found.answering is None:
        return "use pitch-gateway probe --scan to find the unit ids that answer"
    if not found.answering:
        return "no other unit id answers either"
    return f"{ids_text(found.answering)} instead"


def ids_text(answering: Sequence[int]) -> str:
    """Return which unit ids answer.

    >>> ids_text([1, 3]), ids_text([2])
    ('unit ids 1, 3 answer', 'unit id 2 answers')
    """
    if len(answering) == 1:
        return f"unit id {answering[0]} answers"
    if len(answering) == LAST_UNIT_ID:
        return f"all unit ids from 1 to {LAST_UNIT_ID} answer, because the drive ignores them"
    return f"unit ids {', '.join(map(str, answering))} answer"


def _bits(found: AxisReadings) -> Iterator[ProbeFinding]:
    homed, done = found.bit(HOMED_BIT), found.bit(DONE_BIT)
    moving, alarm = found.bit(MOVING_BIT), found.bit(ALARM_BIT)
    if alarm:
        yield _error("the drive reports an alarm: clear it at the drive first, or correct bits.alarm")
    if found.plan.referenced is Reference.DRIVE_BIT and homed is False:
        yield _warning("the drive is not homed: positions pass 1:1 until it is")
    if moving and done:
        yield _error("the drive reports moving and done together: correct bits.moving or bits.done")
    if moving:
        yield _warning("the axis moves: probe again at standstill")


def _is_inside(settings: AxisSettings, position: float) -> bool:
    assert settings.travel is not None
    low, high = settings.travel
    return low - settings.travel_margin <= position <= high + settings.travel_margin


def _position_findings(found: AxisReadings, reading: RegisterReading) -> Iterator[ProbeFinding]:
    """Whether a position can be one of this axis, as mapped and with its words swapped."""
    settings, field, raw = found.plan.settings, reading.register.field, reading.raw
    assert field is not None
    assert raw is not None
    here = machine_position(settings, field, raw)
    if settings.travel is None:
        if _looks_swapped(field, raw):
            yield _swapped(reading, "is a multiple of 65536 as mapped")
        return
    low, high = settings.travel
    units = settings.units.value
    if _is_inside(settings, here):
        yield from _outside_table(found.plan, reading.register, here)
        return
    if field.words > 1 and not field.type.is_float:
        swapped = machine_position(settings, field, other_order(field).unpack(reading.words))
        if _is_inside(settings, swapped):
            yield _swapped(
                reading,
                f"is at {here:.10g} {units} as mapped, but at {swapped:.10g} {units} with the "
                "other word order",
            )
            return
    text = (
        f"{reading.register} is at machine position {here:.10g} {units}, outside travel {low:g} to {high:g}: "
        "check counts_per_unit, zero_counts and machine_offset, the address and the type"
    )
    yield _warning(text) if reading.register.name == "command" else _error(text)


def _word_order_unclear(found: AxisReadings) -> Iterator[ProbeFinding]:
    """Whether the axis is where a wrong word order would not show, such as at 0 after homing."""
    unclear = [
        f"{reading.register} is {reading.raw:.0f}"
        for reading in map(found.of, ("actual", "commanded"))
        if reading is not None and _reads_either_way(found.plan.settings, reading)
    ]
    if unclear:
        yield _warning(
            "jog the axis and probe again: the word order is not clear, because both word orders give a "
            f"plausible position ({', '.join(unclear)})"
        )


def _reads_either_way(settings: AxisSettings, reading: RegisterReading) -> bool:
    field, raw = reading.register.field, reading.raw
    if field is None or raw is None or field.words == 1 or field.type.is_float:
        return False
    swapped = other_order(field).unpack(reading.words)
    if swapped == raw:
        return True
    return settings.travel is not None and all(
        _is_inside(settings, machine_position(settings, field, either)) for either in (raw, swapped)
    )


def _looks_swapped(field: PositionField, raw: float) -> bool:
    return field.words > 1 and not field.type.is_float and raw != 0 and raw % HIGH_WORD == 0


def _swapped(reading: RegisterReading, why: str) -> ProbeFinding:
    field = reading.register.field
    assert field is not None
    return _error(
        f"{reading.register}: the word order looks wrong: it {why}; "
        f'try words = "{other_order(field).order.value}"'
    )


def _outside_table(plan: AxisPlan, register: ProbedRegister, here: float) -> Iterator[ProbeFinding]:
    table = plan.table
    if (
        table is None
        or plan.settings.modulo
        or register.name != "actual"
        or table.first <= here <= table.last
    ):
        return
    yield _warning(
        f"{register} is at machine position {here:.10g}, outside its table ({table.first:g} to "
        f"{table.last:g}), where outside = {plan.settings.outside.kind.value} applies"
    )


def _agreement(found: AxisReadings) -> Iterator[ProbeFinding]:
    """Whether the positions of an axis at standstill are about equal."""
    actual = found.of("actual")
    if actual is None or found.bit(MOVING_BIT):
        return
    settings = found.plan.settings
    near = settings.max_correction
    here = position_of(found.plan, actual).corrected
    for name in ("commanded", "command"):
        reading = found.of(name)
        if reading is None:
            continue
        there = position_of(found.plan, reading).corrected
        if abs(there - here) > near:
            hint = (
                "this is normal after homing, a jog or power-up; otherwise check its address and scale"
                if name == "command"
                else "check its address, its word order and its scale"
            )
            yield _warning(
                f"{reading.register} is at {there:.10g} and {actual.register} at {here:.10g} "
                f"{settings.units.value}: {hint}"
            )


def _steadiness(found: AxisReadings) -> Iterator[ProbeFinding]:
    """Two readings of an axis at standstill differ by its jitter; by 65536 if the words are swapped."""
    first, second = found.of("actual"), found.again
    if first is None or second is None or found.bit(MOVING_BIT):
        return
    if second.problem:
        yield _error(f"{second.register}, read again: {second.problem}")
        return
    field = first.register.field
    assert field is not None
    assert first.raw is not None
    assert second.raw is not None
    jump = second.raw - first.raw
    swapped = other_order(field)
    if field.words > 1 and not field.type.is_float and abs(jump) >= HIGH_WORD:
        small = swapped.unpack(second.words) - swapped.unpack(first.words)
        if abs(small) < HIGH_WORD:
            yield _swapped(
                first,
                f"jumps by {jump:.0f} between two readings, but by {small:.0f} with the other word order",
            )
            return
    moved = abs(counts_of(field, jump) / found.plan.settings.counts_per_unit)
    if moved > found.plan.settings.hysteresis:
        yield _warning(
            f"{first.register} changed by {moved:.10g} {found.plan.settings.units.value} between two "
            "readings: the axis moves, or hysteresis is smaller than its jitter"
        )


def _scale(found: AxisReadings) -> Iterator[ProbeFinding]:
    """What a person must compare: no single position shows a scale that is wrong by a factor of ten."""
    actual, settings = found.of("actual"), found.plan.settings
    if actual is None or actual.raw is None or settings.travel is None:
        return
    units, counts = settings.units.value, settings.counts_per_unit
    here = position_of(found.plan, actual).corrected
    if not _is_inside(settings, here):
        return  # reported already
    low, high = sorted(settings.zero_counts + end * counts for end in settings.travel)
    field = actual.register.field
    assert field is not None
    yield _remark(
        f"check that the axis is really at {here:.6g} {units}: {actual.register} reads "
        f"{counts_of(field, actual.raw):.10g} counts, and travel is {low:.10g} to {high:.10g} counts. Even "
        f"a counts_per_unit that is wrong by ten looks good here: move by {TRIAL_MOVE[settings.units]:g} "
        f"{units} and check with pitch-gateway signtest --moved"
    )


def _unit_ids(found: AxisReadings) -> Iterator[ProbeFinding]:
    """The meaning of the answer from an unused unit id for ``other_units``."""
    if found.unused is None:
        return
    unused, own = found.unused.unit_id, found.plan.unit_id
    if found.unused.is_answered:
        yield _remark(
            f"the drive answers also for unit id {unused}: it ignores unit ids, so requests to other unit "
            f"ids than {own} reach it. The gateway refuses those that would move it, unless other_units "
            "names their unit id"
        )
    else:
        yield _remark(
            "if this address has further devices, name their unit ids in the line, as in other_units = [7, "
            "8]; otherwise writes to them are refused if they look like positions of this axis. Unit id "
            f"{unused}, which has no axis, does not answer, so the drive checks unit ids"
        )
