"""Reading the registers of a register map, as the gateway itself would read them, and no others."""

from collections.abc import Awaitable, Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import isfinite
from typing import Final, Protocol

from gateway.exchange.added_frames import LATER, AddedFrame, Purpose, read_bit, read_field
from gateway.exchange.axis.axis import Axis
from gateway.exchange.plan import AxisPlan
from gateway.modbus.pdu import ExceptionCode, is_exception
from gateway.modbus.registers import BitField, FieldAccess, PositionField
from gateway.state.plan import LinePlan
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.master import NoReplyError, OtherIdError

NOBODY: Final = frozenset(
    {ExceptionCode.GATEWAY_PATH_UNAVAILABLE, ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND}
)
"""A converter or server that reaches no drive answers with these (application protocol V1.1b3, section 7)."""
LAST_UNIT_ID: Final = 247
"""Of one device: Modbus over serial line V1.02, section 2.2."""
RETURNED: Final = 2
"""This many echoed reads are enough: no other device sends requests here."""
SILENT_READS: Final = 2
"""After this many reads without any reply the drive is not read any more."""


class OnWrongCrc(Enum):
    """A drive's reaction to a read with a wrong CRC."""

    SILENT = "silent"
    REFUSED = "refused"
    """It answers with an exception."""
    ANSWERED = "answered"
    """It executes the request."""


class ProbeMaster(Protocol):
    """One exchange at a time, as with ``ModbusMaster``."""

    async def exchange(self, unit_id: int, pdu: bytes) -> bytes:
        """Send a request and return its reply. Raises NoReplyError."""
        ...


@dataclass(frozen=True, slots=True)
class ProbedRegister:
    """A register to read. ``name`` is its key in the register map, with a number from the second on."""

    name: str
    field: PositionField | None = None
    bit: BitField | None = None

    @property
    def address(self) -> int:
        """Its address."""
        entry = self.field or self.bit
        assert entry is not None
        return entry.address

    def __str__(self) -> str:
        return f"{self.name} ({self.address:#06x})"


@dataclass(frozen=True, slots=True)
class RegisterReading:
    """The result of a read: words, or the error."""

    register: ProbedRegister
    words: bytes = b""
    problem: str = ""
    is_silent: bool = False
    """No drive answered: there was no reply, or another device reported that there is no drive."""
    instead: str = ""
    """The drive's reaction in place of an answer."""
    is_refused: bool = False

    @property
    def raw(self) -> float | None:
        """Content of a position register."""
        field_ = self.register.field
        return field_.unpack(self.words) if self.words and field_ is not None else None

    @property
    def is_set(self) -> bool | None:
        """Value of a bit."""
        bit = self.register.bit
        return bit.is_set(int.from_bytes(self.words, "big")) if self.words and bit is not None else None


@dataclass(frozen=True, slots=True)
class UnusedUnit:
    """The result for a unit id that is not configured."""

    unit_id: int
    is_answered: bool
    """The drive answered the read as its own; else silence, or an exception."""


@dataclass(slots=True)
class AxisReadings:
    """All readings of one axis."""

    plan: AxisPlan
    readings: dict[str, RegisterReading] = field(default_factory=dict)
    again: RegisterReading | None = None
    """The actual position once more, last of all."""
    unused: UnusedUnit | None = None
    """A unit id that is not configured, if it was polled."""
    on_wrong_crc: OnWrongCrc | None = None
    """None: not tested."""
    answering: tuple[int, ...] | None = None
    """The unit ids of its line that answer; None: no scan."""
    echoes: str = ""
    """If sent bytes come back and the configuration does not say so: that, and the remedy."""
    left_out: list[str] = field(default_factory=list)
    """What was not read, and the reason."""

    def of(self, name: str) -> RegisterReading | None:
        """Return one successful reading."""
        reading = self.readings.get(name)
        return reading if reading is not None and reading.words else None

    def bit(self, name: str) -> bool | None:
        """Return the value of a status bit; None if there is none, or it could not be read."""
        reading = self.of(f"bits.{name}")
        return None if reading is None else reading.is_set

    @property
    def answers(self) -> bool:
        """Whether the drive answered any read."""
        return any(not reading.is_silent for reading in self.readings.values())

    @property
    def instead(self) -> str:
        """The drive's reaction in place of answers; "" if it answers, or is silent."""
        readings = self.readings.values()
        is_none = all(reading.is_silent or reading.instead for reading in readings)
        return next((reading.instead for reading in readings if reading.instead), "") if is_none else ""


async def read_axis(master: ProbeMaster, plan: AxisPlan) -> AxisReadings:
    """Read every bit and position of an axis that may be read."""
    found = AxisReadings(plan)
    if not plan.safe_read:
        found.left_out.append("its register map says safe_read = false: nothing is read")
        return found
    axis = Axis(plan)
    for register in _registers(found):
        found.readings[register.name] = await _read(master, axis, register)
        silent = [reading for reading in found.readings.values() if reading.is_silent or reading.instead]
        if len(silent) >= SILENT_READS and len(silent) == len(found.readings):
            found.left_out.append("it does not answer, so the rest was not read")
            return found
    actual = found.of("actual")
    if actual is not None:
        found.again = await _read(master, axis, actual.register)
    return found


async def scan(master: ProbeMaster, line: LinePlan, found: Sequence[AxisReadings]) -> tuple[int, ...]:
    """Return the unit ids from 1 to 247 that answer one read each, and store them in ``found``.

    The read is of the first register of the first readable axis. A drive without that register refuses it,
    which is also an answer. Axes with ``safe_read = false`` are not read.
    """
    first = next(((axis, register) for axis in line.axes for register in registers_of(axis)), None)
    if first is None:
        return ()
    frame = frame_of(Axis(first[0]), first[1])
    untouchable = {axis.unit_id for axis in line.axes if not axis.safe_read}
    answering = tuple(
        [
            unit_id
            for unit_id in range(1, LAST_UNIT_ID + 1)
            if unit_id not in untouchable and await _is_there(master, unit_id, frame.pdu)
        ]
    )
    for each in found:
        each.answering = answering
    return answering


async def _is_there(master: ProbeMaster, unit_id: int, pdu: bytes) -> bool:
    try:
        reply = await master.exchange(unit_id, pdu)
    except OtherIdError:
        return True
    except NoReplyError:
        return False
    return not _is_nobody(reply)


async def ask_unused_unit(master: ProbeMaster, line: LinePlan, found: AxisReadings) -> None:
    """Repeat an answered read of the axis under a unit id that is not configured.

    Only if the answer decides something: on Modbus/TCP with one axis unit id (docs/wire-rules.md, W7).
    """
    axis_ids = {axis.unit_id for axis in line.axes}
    is_mbap = isinstance(line.drives, TcpEndpoint) and not line.drives.rtu
    answered = next((reading for reading in found.readings.values() if reading.words), None)
    if not is_mbap or len(axis_ids) != 1 or answered is None:
        return
    used_ids = axis_ids | line.other_units.unit_ids
    unit_id = next((each for each in range(LAST_UNIT_ID, 0, -1) if each not in used_ids), None)
    if unit_id is None:
        return
    frame = frame_of(Axis(found.plan), answered.register)
    try:
        is_answered = not is_exception(await master.exchange(unit_id, frame.pdu))
    except NoReplyError:
        is_answered = False
    found.unused = UnusedUnit(unit_id, is_answered=is_answered)


async def ask_with_wrong_crc(
    ask: Callable[[int, bytes], Awaitable[bytes]], line: LinePlan, found: AxisReadings
) -> None:
    """Repeat an answered read of the axis with a wrong CRC: a drive must not answer (W12).

    Only on a serial line: only there a gateway sends such frames. ``ask`` is ``exchange_with_wrong_crc`` of a
    ``ModbusMaster``.
    """
    answered = next((reading for reading in found.readings.values() if reading.words), None)
    if answered is None or not isinstance(line.drives, SerialEndpoint):
        return
    frame = frame_of(Axis(found.plan), answered.register)
    try:
        reply = await ask(found.plan.unit_id, frame.pdu)
    except NoReplyError:
        found.on_wrong_crc = OnWrongCrc.SILENT
    else:
        found.on_wrong_crc = OnWrongCrc.REFUSED if is_exception(reply) else OnWrongCrc.ANSWERED


def registers_of(plan: AxisPlan) -> list[ProbedRegister]:
    """Return the readable registers of an axis, bits first; none if its map allows no reads."""
    return list(_registers(AxisReadings(plan))) if plan.safe_read else []


def _registers(found: AxisReadings) -> Iterator[ProbedRegister]:
    plan = found.plan
    for name, bit in plan.bits.items():
        yield ProbedRegister(f"bits.{name}", bit=bit)
    for role, fields in (("actual", plan.actual), ("commanded", plan.commanded), ("command", plan.command)):
        readable = [f for f in fields if f.is_readable]
        if fields and not readable:
            is_written = all(f.access is FieldAccess.WRITE for f in fields)
            why = "it is write-only" if is_written else "it is only part of longer frames"
            found.left_out.append(f"{role}: {why}")
        for number, field_ in enumerate(readable[:1] if role == "command" else readable, start=1):
            register = ProbedRegister(role if number == 1 else f"{role} {number}", field_)
            if field_.words > plan.max_registers:
                found.left_out.append(
                    f"{register}: it has {field_.words} registers, but the drive accepts only "
                    f"{plan.max_registers}"
                )
            else:
                yield register


async def _read(master: ProbeMaster, axis: Axis, register: ProbedRegister) -> RegisterReading:
    frame = frame_of(axis, register)
    try:
        reply = await master.exchange(axis.plan.unit_id, frame.pdu)
        if is_exception(reply) and reply[-1] in LATER:  # as in the gateway
            reply = await master.exchange(axis.plan.unit_id, frame.pdu)
    except OtherIdError as error:
        return RegisterReading(register, problem=str(error), instead=str(error))
    except NoReplyError as error:
        return RegisterReading(register, problem=str(error), is_silent=True)
    if _is_nobody(reply):
        return RegisterReading(register, problem=_exception(reply), is_silent=True)
    if is_exception(reply):
        why = f"the drive refuses to read it: {_exception(reply)}"
        return RegisterReading(register, problem=why, is_refused=True)
    words = frame.words_of(reply)
    if words is None:
        return RegisterReading(
            register, problem=f"the reply does not belong to the request: {reply.hex(' ')}"
        )
    if register.field is not None and not isfinite(register.field.unpack(words)):
        return RegisterReading(
            register, problem=f"{words.hex(' ')} is not a finite {register.field.type.value}: check its type"
        )
    return RegisterReading(register, words)


def frame_of(axis: Axis, register: ProbedRegister) -> AddedFrame:
    """Return the read of a register."""
    if register.field is not None:
        return read_field(axis, Purpose.ACTUAL, register.field)
    assert register.bit is not None
    return read_bit(axis, Purpose.STANDSTILL, register.bit)


def _is_nobody(reply: bytes) -> bool:
    return is_exception(reply) and reply[-1] in NOBODY


def _exception(reply: bytes) -> str:
    code = reply[1] if len(reply) > 1 else 0
    try:
        return f"exception {code} ({ExceptionCode(code).name.lower().replace('_', ' ')})"
    except ValueError:
        return f"exception {code}"
