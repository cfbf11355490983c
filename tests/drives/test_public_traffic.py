"""What public programs send to each drive, through the gateway and to a drive that is plain memory."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from gateway.drives.library import names, shipped
from gateway.drives.public import Sequence, SequenceKind, public_traffic
from gateway.exchange.status import axes_status, line_status
from gateway.modbus.registers import BitField, BitTable, PositionField
from tests.contract.through import axis_plan, table_of
from tests.exchange.line_bench import MOVE_MS, Bench, Memory, monitor

CORRECTION_MM = 0.05
CORRECTION_COUNTS = 50
"""The same at every place, in both directions: 1000 counts make a millimetre."""


class Replaying(Memory):
    """Knows nothing of the drive: takes what it is told, and shows the state that a test gives it.

    With ``has_two_images`` what it shows lies at the addresses of what it is told, as in FHPP.
    """

    def __init__(self, *, has_two_images: bool = False) -> None:
        super().__init__()
        self.on: set[tuple[BitTable, int]] = set()
        self.state = Memory() if has_two_images else self

    def answer(self, pdu: bytes) -> bytes:
        function, address = pdu[0], int.from_bytes(pdu[1:3], "big")
        if function in (1, 2):
            table = BitTable.COIL if function == 1 else BitTable.INPUT
            quantity = int.from_bytes(pdu[3:5], "big")
            value = sum(1 << n for n in range(quantity) if (table, address + n) in self.on)
            data = value.to_bytes((quantity + 7) // 8, "little")
            return bytes((function, len(data))) + data
        if function == 5:
            (self.on.add if pdu[3] else self.on.discard)((BitTable.COIL, address))
            return pdu
        if function == 15:
            bits = int.from_bytes(pdu[6:], "little")
            for n in range(int.from_bytes(pdu[3:5], "big")):
                (self.on.add if bits >> n & 1 else self.on.discard)((BitTable.COIL, address + n))
            return pdu[:5]
        if function == 43:
            return self._object(pdu)
        if function == 3 and self.state is not self:
            return self.state.answer(pdu)
        return super().answer(pdu)

    def _object(self, pdu: bytes) -> bytes:
        """Read or write an object: two bytes are the word at its index, two more the one after it."""
        index, size = int.from_bytes(pdu[5:7], "big"), pdu[11]
        if pdu[2]:
            for word in range(0, size, 2):
                self.words[index + word // 2] = int.from_bytes(pdu[12 + word : 14 + word], "little")
            return pdu[:11] + bytes(1)
        words = (self.words.get(index + n, 0).to_bytes(2, "little") for n in range((size + 1) // 2))
        return pdu[:12] + b"".join(words)[:size]

    def show(self, bit: BitField, value: bool) -> None:
        """Show a bit of the drive's state."""
        value ^= bit.is_inverted
        if bit.table is not BitTable.REGISTER:
            (self.on.add if value else self.on.discard)((bit.table, bit.address))
            return
        word = self.state.words.get(bit.address, 0) & ~(1 << bit.bit)
        self.state.words[bit.address] = word | value << bit.bit


class Machine(Bench):
    """The gateway with a shipped profile, before a drive that stands at 0, is homed and has no alarm."""

    def __init__(self, drive: str, **changes: Any) -> None:
        plan = replace(axis_plan(drive, 1, table_of(CORRECTION_MM, CORRECTION_MM)), **changes)
        told, shown = {field.address for field in plan.command}, {field.address for field in plan.actual}
        self.drive = Replaying(has_two_images=bool(told & shown))
        self.positions = (*plan.actual[:1], *plan.commanded[:1])
        self.bits = plan.bits
        for name, bit in plan.bits.items():
            self.drive.show(bit, name in {"homed", "done"})
        super().__init__(plan, memory=self.drive)

    def play(self, sequence: Sequence) -> None:
        """Send its frames, each of which the drive acknowledges; what the motor does is over at the end."""
        for frame in sequence.frames:
            pdu = bytes.fromhex(frame)
            reply = self.ask(pdu)
            assert reply[0] == pdu[0], f"{frame} -> {reply.hex(' ')}"
        if sequence.target is not None and sequence.kind is SequenceKind.ABSOLUTE:
            for field in self.positions:
                self.drive.state.put(field, round(self.told(sequence) * sequence.target.scale))
        self.wait(MOVE_MS)

    def told(self, sequence: Sequence) -> int:
        """Return what the drive was told, where the target of a sequence stands."""
        target = sequence.target
        assert target is not None
        return round(self.drive.get(PositionField(target.address, target.type, target.words)))

    @property
    def counters(self) -> tuple[int, int]:
        """What was not understood, and what was refused."""
        status = line_status(self.line, 0)
        return status.unknown_modes, status.refused


def _all() -> Iterator[tuple[str, Sequence]]:
    for name in names():
        for sequence in public_traffic(name):
            yield name, sequence


def _of(*kinds: SequenceKind) -> "pytest.MarkDecorator":
    found = [(name, each) for name, each in _all() if each.kind in kinds and not each.refused]
    ids = [f"{name}-{each.what}" for name, each in found]
    return pytest.mark.parametrize(("drive", "sequence"), found, ids=ids)


def _first_absolute(drive: str) -> Sequence | None:
    return next((each for each in public_traffic(drive) if each.kind is SequenceKind.ABSOLUTE), None)


def _go(machine: Machine, drive: str, expected: int = CORRECTION_COUNTS) -> None:
    """Make an absolute move, which is corrected by so many counts."""
    absolute = _first_absolute(drive)
    if absolute is not None and absolute.target is not None:
        machine.play(absolute)
        assert machine.told(absolute) == _corrected(absolute, expected)


@pytest.mark.parametrize(("drive", "sequence"), list(_all()), ids=lambda each: getattr(each, "what", each))
def test_a_sequence_is_whole(drive: str, sequence: Sequence) -> None:
    assert sequence.source in shipped(drive).sources
    assert (sequence.target is not None) is (sequence.kind in {SequenceKind.ABSOLUTE, SequenceKind.RELATIVE})
    assert sequence.frames


@_of(SequenceKind.ABSOLUTE)
def test_the_target_of_an_absolute_move_is_corrected(drive: str, sequence: Sequence) -> None:
    machine = Machine(drive)
    machine.play(sequence)
    assert sequence.target is not None
    assert machine.told(sequence) == _corrected(sequence)
    assert _setpoint_counts(machine) == round(sequence.target.counts * sequence.target.scale)
    assert machine.counters == (0, 0)


@_of(SequenceKind.RELATIVE)
def test_a_distance_stays_where_the_correction_is_the_same(drive: str, sequence: Sequence) -> None:
    machine = Machine(drive)
    _go(machine, drive)
    machine.play(sequence)
    assert sequence.target is not None
    assert machine.told(sequence) == sequence.target.counts
    assert machine.counters == (0, 0)


@_of(SequenceKind.STOP)
def test_a_stop_passes_as_it_is_and_the_next_target_is_corrected(drive: str, sequence: Sequence) -> None:
    machine = Machine(drive)
    _go(machine, drive)
    before = len(machine.seen)
    machine.play(sequence)
    assert _written(machine.seen[before:]) == [bytes.fromhex(frame) for frame in sequence.frames]
    _go(machine, drive)
    assert machine.counters == (0, 0)


@_of(SequenceKind.STOP)
def test_a_stop_goes_before_what_waits(drive: str, sequence: Sequence) -> None:
    """Its first frame overtakes a panel's question that the line has no time for yet."""
    machine = Machine(drive)
    machine.send(bytes.fromhex("03 0000 0001"), monitor())
    machine.send(bytes.fromhex("03 0001 0001"), monitor())
    stop = bytes.fromhex(sequence.frames[0])
    machine.send(stop)
    machine.serve()
    assert machine.seen[-2:] == [stop, bytes.fromhex("03 0001 0001")]


@_of(SequenceKind.ENABLE, SequenceKind.FAULT_RESET)
def test_what_moves_nothing_leaves_the_reference(drive: str, sequence: Sequence) -> None:
    machine = Machine(drive)
    _go(machine, drive)
    before = len(machine.seen)
    machine.play(sequence)
    written = [_without_target(drive, pdu) for pdu in _written(machine.seen[before:])]
    assert written == [_without_target(drive, bytes.fromhex(frame)) for frame in sequence.frames]
    _go(machine, drive)
    assert machine.counters == (0, 0)


@_of(SequenceKind.SET_POSITION)
def test_what_renames_the_place_ends_the_reference(drive: str, sequence: Sequence) -> None:
    machine = Machine(drive)
    _go(machine, drive)
    machine.play(sequence)
    assert not _is_referenced(machine)
    _go(machine, drive, 0)
    assert machine.counters == (0, 0)


@_of(SequenceKind.HOMING, SequenceKind.JOG)
def test_after_homing_and_a_jog_nobody_says_where_the_axis_was_sent(drive: str, sequence: Sequence) -> None:
    machine = Machine(drive)
    _go(machine, drive)
    machine.play(sequence)
    assert _setpoint_counts(machine) is None
    assert machine.counters == (0, 0)
    _go(machine, drive)


@_of(SequenceKind.STORED)
def test_a_stored_move_is_refused_for_it_carries_no_correction(drive: str, sequence: Sequence) -> None:
    machine = Machine(drive)
    _go(machine, drive)
    *before, start = map(bytes.fromhex, sequence.frames)
    for pdu in before:
        assert machine.ask(pdu)[0] == pdu[0]
    seen = len(machine.seen)
    assert machine.ask(start) == bytes((start[0] | 0x80, 4))
    assert start not in machine.seen[seen:]
    _go(machine, drive)


@pytest.mark.parametrize(
    ("drive", "sequence"),
    [(d, s) for d, s in _all() if s.refused],
    ids=lambda each: getattr(each, "what", each),
)
def test_what_would_move_a_stored_position_is_refused(drive: str, sequence: Sequence) -> None:
    machine = Machine(drive)
    replies = [machine.ask(bytes.fromhex(frame)) for frame in sequence.frames]
    assert any(reply[0] & 0x80 for reply in replies)


def _without_target(drive: str, pdu: bytes) -> bytes:
    """Blot out the target where a frame holds it: an image carries it along in whatever it says."""
    absolute = _first_absolute(drive)
    if absolute is None or absolute.target is None or pdu[0] != 16:
        return pdu
    target = absolute.target
    at = 6 + 2 * (target.address - int.from_bytes(pdu[1:3], "big"))
    end = at + 2 * target.type.words
    return pdu[:at] + bytes(end - at) + pdu[end:] if at >= 6 and end <= len(pdu) else pdu


def _written(pdus: list[bytes]) -> list[bytes]:
    """Leave out what only asks."""
    return [pdu for pdu in pdus if pdu[0] not in {1, 2, 3, 4}]


def _corrected(sequence: Sequence, correction_counts: int = CORRECTION_COUNTS) -> int:
    """Return what the drive has to be told for the target of a sequence."""
    target = sequence.target
    assert target is not None
    return round((target.counts * target.scale + correction_counts) / target.scale)


def _setpoint_counts(machine: Machine) -> int | None:
    """Return where the gateway takes the axis to have been sent, in the controller's counts."""
    [axis] = axes_status(machine.line, machine.now_ns).values()
    setpoint_mm = axis.nominal_setpoint
    return None if setpoint_mm is None else round(1000 * setpoint_mm)


def _is_referenced(machine: Machine) -> bool:
    [axis] = axes_status(machine.line, machine.now_ns).values()
    return str(axis.compensation) != "unreferenced"
