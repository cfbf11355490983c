"""What a look at a standing axis tells, with drives that are memory."""

from dataclasses import replace
from typing import Any

import pytest

from gateway.commissioning.probe.judgement import Weight, findings_of, position_of
from gateway.commissioning.probe.readings import AxisReadings, read_axis
from gateway.compensation.settings import AxisSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Form
from gateway.exchange.plan import AxisPlan, CompensationMode, Reference
from gateway.modbus.registers import BitField, BitTable, FieldAccess, PositionField, RegisterType, WordOrder
from gateway.transport.master import OtherIdError, SilentError

COMMAND, ACTUAL, COMMANDED, STATUS = 0x100, 0x110, 0x120, 0x130
HIGH, LOW = WordOrder.HIGH_FIRST, WordOrder.LOW_FIRST


def int32(address: int, order: WordOrder = HIGH) -> PositionField:
    return PositionField(address, RegisterType.INT32, order)


def axis(**changes: Any) -> AxisPlan:
    """1000 counts/mm, travel 0 to 300 mm, 0.01 mm added forward and 0.03 mm taken away backward."""
    plan = AxisPlan(
        name="x",
        unit_id=7,
        settings=AxisSettings(Units.MM, 1000.0, travel=(0.0, 300.0), machine_offset=100.0),
        table=make_table([0.0, 300.0], [0.01, 0.01], [-0.03, -0.03], Units.MM),
        compensation=CompensationMode.ON,
        referenced=Reference.DRIVE_BIT,
        command=(int32(COMMAND),),
        actual=(int32(ACTUAL),),
        commanded=(int32(COMMANDED),),
        bits={
            "homed": BitField(STATUS, 0),
            "done": BitField(STATUS, 1),
            "moving": BitField(STATUS, 2),
            "alarm": BitField(STATUS, 3),
        },
    )
    return replace(plan, **changes)


class Memory:
    """Registers and bits that can be read; whatever else is asked fails the test."""

    def __init__(self, plan: AxisPlan) -> None:
        self.words: dict[int, int] = {STATUS: 0b0011}
        self.inputs: set[int] = set()
        self.asked: list[bytes] = []
        self.later: dict[int, bytes] = {}
        """What is at an address when it is read again."""
        self.is_silent = False
        self.nobody = 0
        """The exception by which a converter says that no drive is there."""
        self.has_other_ids = False
        for field in (*plan.command, *plan.actual, *plan.commanded):
            self.put(field, 50_000)

    def put(self, field: PositionField, raw: float) -> None:
        data = field.pack(raw)
        for i in range(field.words):
            self.words[field.address + i] = int.from_bytes(data[2 * i : 2 * i + 2], "big")

    async def exchange(self, unit_id: int, pdu: bytes) -> bytes:
        assert unit_id == 7
        self.asked.append(pdu)
        function, address, quantity = pdu[0], int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
        assert function in (1, 2, 3, 4), "only reads"
        if self.is_silent:
            raise SilentError("no reply within 100 ms")
        if self.nobody:
            return bytes((function | 0x80, self.nobody))
        if self.has_other_ids:
            raise OtherIdError(f"answers, with transaction id 0 (asked with {len(self.asked)})")
        if function in (1, 2):
            return bytes((function, 1, address in self.inputs))
        if address not in self.words:
            return bytes((function | 0x80, 2))
        if address in self.later and self.asked.count(pdu) > 1:
            return bytes((function, 2 * quantity)) + self.later[address]
        data = b"".join(self.words[address + i].to_bytes(2, "big") for i in range(quantity))
        return bytes((function, 2 * quantity)) + data


async def look(plan: AxisPlan, memory: Memory) -> tuple[AxisReadings, list[str], list[str]]:
    """Return what was read, the errors and the warnings."""
    found = await read_axis(memory, plan)
    findings = findings_of(found)
    errors = [finding.text for finding in findings if finding.weight is Weight.ERROR]
    return found, errors, [finding.text for finding in findings if finding.weight is Weight.WARNING]


async def test_a_good_axis_has_no_findings_and_is_placed_on_both_branches() -> None:
    plan = axis()
    found, errors, warnings = await look(plan, Memory(plan))
    assert (errors, warnings) == ([], [])
    reading = found.of("actual")
    assert reading is not None
    place = position_of(plan, reading)
    # 50 000 counts are machine position 50 mm; 0.01 mm were added forward: 49.99, less the offset of 100.
    assert place.corrected == 50.0
    assert place.forward == pytest.approx(-50.01)
    assert place.backward == pytest.approx(-49.97)


async def test_an_adapter_that_returns_what_is_sent_is_named_first() -> None:
    plan = axis()
    found = await read_axis(Memory(plan), plan)
    found.echoes = "set echo = true: the adapter returns what is sent"
    first, *others = findings_of(found)
    assert (first.weight, {other.weight for other in others}) == (Weight.ERROR, {Weight.NOTE})
    assert first.text == (
        "set echo = true: the adapter returns what is sent; otherwise the gateway takes the returned write "
        "for its acknowledgement"
    )


async def test_a_drive_that_answers_with_another_transaction_id_is_not_called_off() -> None:
    plan = axis()
    memory = Memory(plan)
    memory.has_other_ids = True
    found, errors, warnings = await look(plan, memory)
    assert (found.answers, len(memory.asked)) == (True, 2)
    said = "unit id 7 answers, with transaction id 0 (asked with 1), so its replies cannot be used: update "
    assert [error.startswith(said) for error in errors] == [True]
    assert "is on" not in errors[0]
    assert warnings == []


async def test_each_register_is_asked_for_once_and_the_actual_position_twice() -> None:
    plan = axis(reads_with=Form.FC04)
    memory = Memory(plan)
    await look(plan, memory)
    read = bytes.fromhex("04 0110 0002")
    assert memory.asked.count(read) == 2
    assert memory.asked[-1] == read
    assert len(memory.asked) == 4 + 3 + 1
    assert {pdu[0] for pdu in memory.asked} == {4}


async def test_words_in_the_wrong_order_are_found_by_the_travel() -> None:
    plan = axis(actual=(int32(ACTUAL, HIGH),))
    memory = Memory(plan)
    memory.put(int32(ACTUAL, LOW), 50_000)
    _, errors, _ = await look(plan, memory)
    # 50 000 = 0x0000C350; with its words turned 0xC3500000 = -1 018 167 296 counts.
    [error] = errors
    assert error == (
        "actual (0x0110): the word order looks wrong: it is at -1018167.296 mm as mapped, but at 50 mm "
        'with the other word order; try words = "low-first"'
    )


async def test_without_travel_a_whole_number_of_65536_gives_the_order_away() -> None:
    settings = replace(axis().settings, travel=None)
    plan = axis(settings=settings, actual=(int32(ACTUAL, LOW),))
    memory = Memory(plan)
    memory.put(int32(ACTUAL, HIGH), 1234)
    _, errors, _ = await look(plan, memory)
    assert [text for text in errors if "word order looks wrong" in text and '"high-first"' in text]


@pytest.mark.parametrize(
    ("raw", "said"),
    [
        (0, "actual (0x0110) is 0, commanded (0x0120) is 0"),
        (0x00030003, "actual (0x0110) is 196611, commanded (0x0120) is 196611"),
        # 65 538 = 0x00010002 is 131 073 = 0x00020001 with its words turned: 65.538 and 131.073 mm.
        (65_538, "actual (0x0110) is 65538, commanded (0x0120) is 65538"),
    ],
)
async def test_where_both_word_orders_are_good_that_is_said(raw: int, said: str) -> None:
    plan = axis()
    memory = Memory(plan)
    for field in (*plan.actual, *plan.commanded, *plan.command):
        memory.put(field, raw)
    _, errors, warnings = await look(plan, memory)
    assert errors == []
    [warning] = warnings
    assert warning == (
        "jog the axis and probe again: the word order is not clear, because both word orders give a "
        f"plausible position ({said})"
    )


async def test_one_word_and_floats_have_no_order_to_be_told() -> None:
    for kind in (RegisterType.INT16, RegisterType.FLOAT32):
        plan = axis(actual=(PositionField(ACTUAL, kind),), commanded=(), command=())
        memory = Memory(axis())
        memory.put(plan.actual[0], 0)
        _, _, warnings = await look(plan, memory)
        assert warnings == []


async def test_jitter_in_the_high_word_gives_the_order_away() -> None:
    settings = replace(axis().settings, travel=(-1e9, 1e9))
    plan = axis(settings=settings, table=None, actual=(int32(ACTUAL, LOW),), commanded=(), command=())
    memory = Memory(plan)
    memory.put(int32(ACTUAL, HIGH), 100)
    memory.later[ACTUAL] = int32(ACTUAL, HIGH).pack(103)
    _, errors, _ = await look(plan, memory)
    # Three counts up are 3 × 65536 with the words the other way round.
    [error] = errors
    assert error == (
        "actual (0x0110): the word order looks wrong: it jumps by 196608 between two readings, but by 3 "
        'with the other word order; try words = "high-first"'
    )


async def test_an_axis_that_is_outside_its_travel_either_way_has_a_wrong_scale() -> None:
    plan = axis()
    memory = Memory(plan)
    memory.put(plan.actual[0], 5_000_000)
    _, errors, _ = await look(plan, memory)
    assert errors[0].startswith(
        "actual (0x0110) is at machine position 5000 mm, outside travel 0 to 300: check counts_per_unit"
    )


async def test_outside_its_table_an_axis_is_told_what_holds() -> None:
    plan = axis(table=make_table([100.0, 200.0], [0.01, 0.01], [0.0, 0.0], Units.MM))
    _, errors, warnings = await look(plan, Memory(plan))
    assert errors == []
    [warning] = warnings
    assert warning == (
        "actual (0x0110) is at machine position 50, outside its table (100 to 200), where outside = hold "
        "applies"
    )


async def test_a_drive_that_does_not_answer_is_not_asked_for_ever() -> None:
    plan = axis()
    memory = Memory(plan)
    memory.is_silent = True
    found, errors, _ = await look(plan, memory)
    assert not found.answers
    assert len(memory.asked) == 2
    [error] = errors
    assert error.startswith(
        "no drive answers as unit id 7 here: no reply within 100 ms; use pitch-gateway probe"
    )


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (10, "exception 10 (gateway path unavailable)"),
        (11, "exception 11 (gateway target device failed to respond)"),
    ],
)
async def test_a_converter_that_reaches_no_drive_is_not_taken_for_one(code: int, said: str) -> None:
    memory = Memory(axis())
    memory.nobody = code
    found, errors, _ = await look(axis(), memory)
    assert not found.answers
    [error] = errors
    assert error == (
        f"no drive answers as unit id 7 here: {said}; use pitch-gateway probe --scan to find "
        "the unit ids that answer; check that the drive is on, its unit id, and on a serial line baud rate, "
        "parity, wiring A/B and termination"
    )


async def test_a_position_is_held_against_the_travel_in_counts() -> None:
    """Wrong by ten it would be at 5 mm, which is as good: only a move tells."""
    found, _, _ = await look(axis(), Memory(axis()))
    [note] = [finding.text for finding in findings_of(found) if finding.weight is Weight.NOTE]
    assert note == (
        "check that the axis is really at 50 mm: actual (0x0110) reads 50000 counts, and travel is 0 to "
        "300000 counts. Even a counts_per_unit that is wrong by ten looks good here: move by 1 mm and "
        "check with pitch-gateway signtest --moved"
    )


async def test_a_register_that_the_drive_does_not_have_is_named() -> None:
    plan = axis()
    memory = Memory(plan)
    del memory.words[COMMANDED]
    _, errors, _ = await look(plan, memory)
    assert errors == ["commanded (0x0120): the drive refuses to read it: exception 2 (illegal data address)"]


async def test_a_drive_that_refuses_to_tell_its_actual_position_is_named() -> None:
    plan = axis()
    memory = Memory(plan)
    del memory.words[ACTUAL]
    _, errors, _ = await look(plan, memory)
    [error] = errors
    assert error == (
        "actual (0x0110): the drive refuses to read it: exception 2 (illegal data address). Map another "
        "register, or remove this one from the map: without it the gateway cannot read the position before "
        "a move. It then assumes the direction, with a flag, and refuses distances with exception 6"
    )


@pytest.mark.parametrize("code", [5, 6])
async def test_a_drive_that_is_busy_is_asked_once_more(code: int) -> None:
    plan = axis()
    memory = Memory(plan)
    answer = memory.exchange
    refused: list[bytes] = []

    async def exchange(unit_id: int, pdu: bytes) -> bytes:
        reply = await answer(unit_id, pdu)
        if int.from_bytes(pdu[1:3], "big") == ACTUAL and not refused:
            refused.append(pdu)
            return bytes((pdu[0] | 0x80, code))
        return reply

    memory.exchange = exchange  # type: ignore[method-assign]
    found, errors, _ = await look(plan, memory)
    assert errors == []
    assert found.of("actual") is not None


@pytest.mark.parametrize(
    ("status", "weight", "said"),
    [
        (0b0010, "warning", "the drive is not homed: positions pass 1:1 until it is"),
        (0b1011, "error", "the drive reports an alarm"),
        (0b0111, "error", "moving and done together"),
        (0b0101, "warning", "the axis moves: probe again at standstill"),
    ],
)
async def test_bits_are_judged(status: int, weight: str, said: str) -> None:
    plan = axis()
    memory = Memory(plan)
    memory.words[STATUS] = status
    _, errors, warnings = await look(plan, memory)
    assert any(said in text for text in (errors if weight == "error" else warnings))


async def test_bits_that_are_inputs_or_inverted_are_read_as_such() -> None:
    bits = {
        "homed": BitField(5, table=BitTable.INPUT),
        "done": BitField(6, table=BitTable.COIL, is_inverted=True),
    }
    plan = axis(bits=bits)
    memory = Memory(plan)
    memory.inputs = {5}
    found, errors, _ = await look(plan, memory)
    assert errors == []
    assert (found.bit("homed"), found.bit("done"), found.bit("alarm")) == (True, True, None)
    assert [pdu.hex() for pdu in memory.asked[:2]] == ["0200050001", "0100060001"]


async def test_positions_that_disagree_are_said_with_the_reason() -> None:
    plan = axis()
    memory = Memory(plan)
    memory.put(plan.commanded[0], 60_000)
    memory.put(plan.command[0], 0)
    _, errors, warnings = await look(plan, memory)
    assert errors == []
    assert warnings[0].startswith(
        "commanded (0x0120) is at 60 and actual (0x0110) at 50 mm: check its address"
    )
    assert warnings[1].startswith(
        "command (0x0100) is at 0 and actual (0x0110) at 50 mm: this is normal after homing, a jog"
    )


async def test_an_axis_that_moves_though_it_should_stand_is_said() -> None:
    plan = axis()
    memory = Memory(plan)
    memory.later[ACTUAL] = plan.actual[0].pack(50_400)
    _, _, warnings = await look(plan, memory)
    assert warnings[0].startswith("actual (0x0110) changed by 0.4 mm between two readings")


async def test_what_may_not_be_read_is_left_alone_and_said() -> None:
    plan = axis(safe_read=False)
    memory = Memory(plan)
    _, _, warnings = await look(plan, memory)
    assert memory.asked == []
    assert "its register map says safe_read = false: nothing is read" in warnings


async def test_fields_that_cannot_be_read_or_are_too_long_are_left_out() -> None:
    write_only = PositionField(COMMAND, RegisterType.INT32, access=FieldAccess.WRITE)
    plan = axis(command=(write_only,), actual=(PositionField(ACTUAL, RegisterType.INT64),), max_registers=2)
    memory = Memory(axis())
    _, _, warnings = await look(plan, memory)
    assert "command: it is write-only" in warnings
    assert "actual (0x0110): it has 4 registers, but the drive accepts only 2" in warnings
    assert not [pdu for pdu in memory.asked if pdu[1:3] in (b"\x01\x00", b"\x01\x10")]


async def test_a_position_that_stands_only_in_frames_from_its_own_address_is_read() -> None:
    """As on a drive where an address is a command, and none behind it is memory."""
    alone = PositionField(ACTUAL, RegisterType.INT32, access=FieldAccess.READ, block=ACTUAL)
    inside = PositionField(COMMAND, RegisterType.INT32, block=COMMAND - 1)
    memory = Memory(axis())
    _, _, warnings = await look(axis(command=(inside,), actual=(alone,)), memory)
    assert [pdu for pdu in memory.asked if pdu[1:3] == b"\x01\x10"] == [bytes.fromhex("03 0110 0002")] * 2
    assert not [pdu for pdu in memory.asked if pdu[1:3] == b"\x01\x00"]
    assert "command: it is only part of longer frames" in warnings


async def test_a_float_that_is_none_is_no_position() -> None:
    plan = axis(actual=(PositionField(ACTUAL, RegisterType.FLOAT32),))
    memory = Memory(axis())
    memory.words |= {ACTUAL: 0x7FC0, ACTUAL + 1: 0}
    _, errors, _ = await look(plan, memory)
    assert errors == ["actual (0x0110): 7f c0 00 00 is not a finite float32: check its type"]
