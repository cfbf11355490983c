"""What the first trigger of a group fixes for all of its axes (M11).

Forward, the table adds 10 counts, backward it subtracts 10 (``line_bench.LOST_MOTION``): 50 000 is sent as 50
010.
"""

from collections.abc import Callable
from typing import Any, Final

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import MotionPlan, TriggerPlan
from gateway.exchange.axis.gantry import GANTRY_AFTER, GantryEvent, GantryState
from gateway.exchange.commands import ClearTable, Disable, EndDryRun, SetTable, TableFor
from gateway.exchange.control import ControlError
from gateway.exchange.plan import CompensationMode, ControllerPlan, Reference
from gateway.exchange.status import axis_status
from gateway.modbus.registers import PositionField
from tests.exchange.gantry_bench import STATUS_PDU, GantryBench
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Port, axis_plan, read, stream_plan, write
from tests.exchange.staged_bench import (
    ALARM_BIT,
    BITS,
    DEEDS,
    HOME_PDU,
    JOG_PDU,
    ONLY_ABSOLUTE,
    RUN,
    RUN_PDU,
    RUN_RELATIVE_PDU,
    STATUS,
    STOP_PDU,
    TRIGGER,
    ZERO_PDU,
    StagedBench,
    staged_plan,
    sticky,
)
from tests.support.tables import walk

STATES: Final = {"o": GantryState.OPEN, "s": GantryState.SENT, "u": GantryState.UNDER_WAY}
WALK: Final = """
          o s u
left      s . .
went      . u .
whole     . o o
unproven  . u .
refused   . o .
again     . . o
ended     . o o
expired   . . o
"""
"""By hand, from M11; a dot: nothing changes."""


def test_the_table_of_a_group_is_what_the_rule_says() -> None:
    found = {(state, event): then for state, row in GANTRY_AFTER.items() for event, then in row.items()}
    assert found == {(STATES[s], GantryEvent(e)): STATES.get(cell) for (s, e), cell in walk(WALK).items()}
    assert len(found) == len(GantryState) * len(GantryEvent)


def gantry(**changes: Any) -> GantryBench:
    """Return a gantry that has gone to 50 mm, corrected."""
    bench = GantryBench(**changes)
    assert bench.go(50_000) == [50_010, 50_010]
    return bench


def bit_gantry(**changes: Any) -> GantryBench:
    return gantry(referenced=Reference.DRIVE_BIT, **changes)


# --- between the triggers ----------------------------------------------------------------------------------


def test_a_switch_between_two_triggers_waits_until_both_axes_have_started() -> None:
    bench = gantry()
    bench.begin(60_000)
    bench.switch(is_on=False)
    assert bench.group() == {
        "state": "under-way", "has_gone": True, "is_put_off": True, "is_skewed": False, "skew": None,
    }  # fmt: skip
    bench.log.clear()
    bench.run(2)
    assert bench.log == [(2, "06 05 0e 00 01")]  # no read and no write of our own
    assert bench.ends() == [60_010, 60_010]
    assert bench.kinds().count("group-held") == 1
    assert bench.group()["state"] == "open"
    bench.settle()
    assert bench.go(60_000) == [60_010, 60_010]  # the same again is the same words (M4)
    assert bench.go(70_000) == [70_000, 70_000]


def test_a_homed_bit_that_falls_between_two_triggers_waits_too() -> None:
    bench = bit_gantry()
    bench.begin(60_000)
    bench.lose_homed_bit(2)
    bench.wait(1_200)
    lost = bench.kinds().count("reference-lost")
    bench.to(2, STATUS_PDU)
    assert bench.kinds().count("reference-lost") == lost + 2  # it is told at once
    bench.log.clear()
    bench.run(2)
    assert bench.log == [(2, "06 05 0e 00 01")]
    assert bench.ends() == [60_010, 60_010]
    bench.settle()
    assert bench.go(70_000) == [70_000, 70_000]


def test_a_homed_bit_that_falls_and_rises_between_two_triggers_is_a_lost_reference_afterwards() -> None:
    bench = bit_gantry()
    bench.begin(60_000)
    bench.lose_homed_bit(2)
    bench.to(2, STATUS_PDU)
    bench.drives[2].set_bits(is_done=True)
    bench.not_homed.clear()
    bench.wait(200)
    bench.to(2, STATUS_PDU)
    assert bench.run(2) == [60_010, 60_010]
    bench.settle()
    assert [axis.compensation.accepted for axis in bench.line.axes] == [None, None]
    assert bench.go(70_000) == [70_010, 70_010]


def set_tables(bench: GantryBench, height_mm: float | None) -> None:
    if height_mm is None:
        bench.line.command(ClearTable(axes=("y2",)), bench.now_ns)
        return
    table = make_table([0, 100], [height_mm] * 2, [-height_mm] * 2, Units.MM)
    wanted = tuple(TableFor(name, "y.tab", "csv", "0" * 64) for name in ("y1", "y2"))
    bench.line.command(SetTable(tables=wanted), bench.now_ns, [table, table])


@pytest.mark.parametrize(
    ("change", "then_added"),
    [
        (lambda bench: bench.gain(0.5), 5),
        (lambda bench: bench.gain(0.0), 0),
        (lambda bench: set_tables(bench, 0.02), 20),
        (lambda bench: set_tables(bench, None), 0),
    ],
    ids=["gain 0.5", "gain 0", "twice the height", "no table"],
)
def test_a_gain_or_another_table_between_two_triggers_waits(
    change: Callable[[GantryBench], None], then_added: int
) -> None:
    bench = gantry()
    bench.begin(60_000)
    change(bench)
    assert bench.run(2) == [60_010, 60_010]
    bench.settle()
    assert bench.go(70_000) == [70_000 + then_added] * 2


def test_a_target_staged_after_the_first_axis_has_started_uses_the_fixed_values() -> None:
    """Stage, run, stage, run: the axis that waits has to follow the one that went."""
    bench = gantry()
    bench.start(1, 60_000)
    bench.switch(is_on=False)
    assert bench.start(2, 60_000) == [60_010, 60_010]


def test_enabling_between_two_triggers_waits_as_well() -> None:
    bench = gantry()
    bench.switch(is_on=False)
    assert bench.go(60_000) == [60_000, 60_000]
    bench.start(1, 70_000)
    bench.switch(is_on=True)
    assert bench.start(2, 70_000) == [70_000, 70_000]
    bench.settle()
    assert bench.go(80_000) == [80_010, 80_010]


# --- before the first trigger is sent ----------------------------------------------------------------------


def reversed_gantry(**changes: Any) -> GantryBench:
    """Return a gantry with targets staged forward at 50 mm, and then read at 70: each target must be written
    again, backward."""
    bench = gantry(**changes)
    bench.stage_all(60_000)
    assert [drive.get(COMMAND) for drive in bench.drives.values()] == [60_010, 60_010]
    turn_back(bench)
    return bench


def turn_back(bench: GantryBench) -> None:
    """Stop both axes, and put them to 70 mm."""
    for unit_id in (1, 2):
        bench.to(unit_id, STOP_PDU)
        bench.drives[unit_id].put(ACTUAL, 70_010)
        bench.drives[unit_id].set_bits(is_done=True)
    bench.wait(300)
    bench.log.clear()


ANEW = "10 06 06 00 02 04 ea 56 00 00"
"""59 990, 0000 EA56."""
BOTH_ANEW: Final = [(2, ANEW), (1, ANEW), (1, "06 05 0e 00 01")]


def writes(bench: GantryBench) -> list[tuple[int, str]]:
    """Return the writes to the drives, in order."""
    return [each for each in bench.log if not each[1].startswith("03")]


def test_each_staged_target_is_written_again_before_the_first_trigger_is_sent() -> None:
    bench = reversed_gantry()
    bench.run(1)
    assert writes(bench) == BOTH_ANEW
    bench.log.clear()
    bench.run(2)
    assert bench.log == [(2, "06 05 0e 00 01")]
    assert bench.ends() == [59_990, 59_990]


@pytest.mark.parametrize(
    ("answer", "code"), [(bytes.fromhex("90 04"), 4), (bytes.fromhex("90 06"), 6), (None, 0x0B)]
)
def test_the_first_trigger_is_refused_if_writing_a_target_again_fails(
    answer: bytes | None, code: int
) -> None:
    bench = reversed_gantry()
    moves = bench.counts_of_moves()
    bench.refuses.append((2, bytes.fromhex("10 0606"), answer))
    bench.send(RUN_PDU, unit_id=1)
    bench.serve()
    assert [each[2] for each in bench.port.replies] in ([bytes((0x86, code))], [])
    bench.port.replies.clear()
    assert bench.counts_of_moves() == moves
    bench.wait(3_000)
    assert bench.to(1, RUN_PDU)[0] == 0x86
    assert bench.counts_of_moves() == moves
    assert bench.go(80_000) == [80_010, 80_010]


def test_the_first_trigger_is_refused_if_no_frames_may_be_added() -> None:
    bench = GantryBench(added_frames=False)
    bench.go(50_000)
    assert bench.go(60_000) == [60_010, 60_010]
    bench.stage_all(70_000)
    bench.gain(0.5)
    moves = bench.counts_of_moves()
    bench.log.clear()
    assert bench.to(1, RUN_PDU) == bytes.fromhex("86 04")
    assert bench.log == []
    assert bench.counts_of_moves() == moves


def test_the_homed_bits_of_all_are_read_before_the_first_trigger_is_sent() -> None:
    bench = bit_gantry()
    bench.stage_all(60_000)
    bench.lose_homed_bit(2)
    bench.wait(1_200)  # an older bit does not count
    bench.log.clear()
    bench.run(1, 2)
    assert (2, "03 00 5c 00 01") in bench.log[: bench.log.index((1, "06 05 0e 00 01"))]
    assert bench.ends() == [60_000, 60_000]


@pytest.mark.parametrize("unit_id", [1, 2])
def test_a_switch_before_the_first_trigger_is_sent_counts_for_both(unit_id: int) -> None:
    """While its own target, or that of the other axis, is written again for it."""
    bench = reversed_gantry()
    bench.send(RUN_PDU, unit_id=1)
    while bench.link.sent != [(unit_id, bytes.fromhex(ANEW))]:
        asked_id, pdu = bench.link.sent.pop(0)
        bench.line.reply(asked_id, bench.drives[asked_id].answer(pdu), bench.now_ns)
    bench.switch(is_on=False)
    bench.serve()
    assert bench.port.take() == RUN_PDU
    assert bench.run(2) == [60_000, 60_000]


@pytest.mark.parametrize("lost", [1, 2])
def test_no_drive_is_read_for_a_first_trigger_that_is_refused(lost: int) -> None:
    """Its own target was lost, or that of the other axis. The homed bits are older than a second."""
    bench = bit_gantry()
    bench.stage_all(60_000)
    bench.lose_target(lost, 70_000)
    bench.wait(1_200)
    bench.log.clear()
    assert bench.to(1, RUN_PDU) == bytes.fromhex("86 04")
    assert bench.log == []


def test_no_drive_is_read_for_a_first_trigger_whose_drive_holds_no_target() -> None:
    bench = GantryBench(referenced=Reference.DRIVE_BIT)
    bench.stage(2, 60_000)
    bench.wait(1_200)
    bench.log.clear()
    assert bench.to(1, RUN_PDU) == bytes.fromhex("86 04")
    assert bench.log == []


# --- what ends the decision --------------------------------------------------------------------------------


def half_gone() -> GantryBench:
    """Return a gantry whose first axis has gone to 60 mm; then the compensation is switched off."""
    bench = gantry()
    bench.begin(60_000)
    bench.switch(is_on=False)
    return bench


def test_the_same_target_again_does_not_end_the_decision() -> None:
    bench = half_gone()
    for _ in range(3):
        bench.start(1, 60_000)
    assert bench.run(2) == [60_010, 60_010]


@pytest.mark.parametrize(
    ("first", "then", "end"), [(RUN_PDU, RUN_RELATIVE_PDU, 40_000), (RUN_RELATIVE_PDU, RUN_PDU, 20_000)]
)
def test_the_same_words_with_another_meaning_begin_a_new_decision(
    first: bytes, then: bytes, end: int
) -> None:
    """To 20 mm and 20 mm further, or from 50 mm 20 mm further and to 20 mm."""
    bench = gantry()
    bench.stage_all(20_000)
    bench.to(1, first)
    bench.drives[1].arrive()
    bench.switch(is_on=False)
    bench.to(1, then)
    assert bench.ends() == [end, 50_010]


def test_a_distance_that_is_run_again_begins_a_new_decision() -> None:
    bench = gantry()
    for unit_id in (1, 2):
        bench.stage(unit_id, 5_000)
        assert bench.to(unit_id, RUN_RELATIVE_PDU) == RUN_RELATIVE_PDU
    assert bench.group()["state"] == "open"
    bench.settle()
    assert bench.to(1, RUN_RELATIVE_PDU) == RUN_RELATIVE_PDU
    bench.switch(is_on=False)
    assert bench.to(2, RUN_RELATIVE_PDU) == RUN_RELATIVE_PDU
    assert bench.ends() == [60_010, 60_010]


@pytest.mark.parametrize("pdu", [STOP_PDU, HOME_PDU, bytes.fromhex("06 050E 012C")])
@pytest.mark.parametrize("unit_id", [1, 2])
def test_a_stop_a_homing_and_a_jog_end_the_decision(pdu: bytes, unit_id: int) -> None:
    bench = half_gone()
    bench.to(unit_id, pdu)
    assert bench.group()["state"] == "open"
    assert not bench.group()["is_put_off"]
    bench.drives[1].put(ACTUAL, 55_000)
    bench.settle()
    assert bench.go(80_000) == [80_000, 80_000]


def test_after_ten_seconds_deferred_changes_come_into_force() -> None:
    bench = half_gone()
    for _ in range(9):
        bench.wait(1_000)
        bench.to(1, read(ACTUAL))
    assert bench.group()["is_put_off"]
    bench.wait(1_100)
    assert not bench.group()["is_put_off"]
    bench.to(1, read(ACTUAL))  # whoever reads sees what is in force
    assert bench.line.axes[0].member.fixed is None
    assert bench.run(2) == [60_010, 60_000]


def test_a_lost_link_ends_the_decision() -> None:
    bench = half_gone()
    bench.cut(500)
    assert bench.group()["state"] == "open"
    assert bench.to(2, RUN_PDU)[0] == 0x86  # what it holds nobody knows


def test_a_first_trigger_that_its_drive_refused_fixes_nothing() -> None:
    bench = gantry()
    bench.stage_all(60_000)
    bench.refuses.append((1, RUN_PDU, bytes.fromhex("86 01")))
    assert bench.to(1, RUN_PDU) == bytes.fromhex("86 01")
    assert bench.group()["state"] == "open"
    assert bench.to(2, RUN_PDU) == bytes.fromhex("86 01")  # M3
    assert "group-skewed" not in bench.kinds()


def test_a_broadcast_trigger_is_the_trigger_of_all_axes() -> None:
    bench = gantry()
    bench.stage_all(60_000)
    bench.send(RUN_PDU, unit_id=0)
    bench.serve()
    assert bench.group()["state"] == "open"
    assert bench.ends() == [60_010, 60_010]


def test_a_target_that_a_broadcast_has_run_is_not_written_again() -> None:
    """y2 runs nothing with the next trigger of y1, so nothing is read or written for it. Gain 0.5: +5."""
    bench = gantry()
    bench.stage_all(60_000)
    bench.send(RUN_PDU, unit_id=0)
    bench.serve()
    bench.settle()
    bench.gain(0.5)
    bench.log.clear()
    assert bench.start(1, 70_000) == [70_005, 60_010]
    assert [unit_id for unit_id, _ in bench.log if unit_id == 2] == []


def test_a_target_that_a_broadcast_has_run_blocks_nothing_after_a_lost_link() -> None:
    bench = gantry()
    bench.stage_all(60_000)
    bench.send(RUN_PDU, unit_id=0)
    bench.serve()
    bench.settle()
    bench.cut(50)
    assert bench.start(1, 70_000) == [70_010, 60_010]


# --- a later one that is refused ---------------------------------------------------------------------------


def test_a_later_trigger_that_its_drive_refuses_is_reported_with_the_skew() -> None:
    bench = half_gone()
    bench.refuses.append((2, RUN_PDU, bytes.fromhex("86 04")))
    assert bench.to(2, RUN_PDU) == bytes.fromhex("86 04")
    event = next(each for each in bench.events if each.kind.name == "group-skewed")
    assert event.axis == "y2"
    assert event.detail == "y1 has moved, and its own target was refused (exception 0x04): skewed by +10 mm"
    found = bench.group()
    assert (found["state"], found["is_skewed"], found["skew"]) == ("under-way", True, 10.0)
    # Levelled: written again, and run by what was fixed, though it was switched off meanwhile.
    assert bench.start(2, 60_000) == [60_010, 60_010]
    assert bench.group()["is_skewed"] is False


def test_a_later_trigger_of_a_lost_target_is_reported_with_the_skew_too() -> None:
    bench = gantry()
    bench.start(1, 60_000)
    bench.lose_target(2, 60_000)
    assert bench.to(2, RUN_PDU) == bytes.fromhex("86 04")
    assert bench.group()["skew"] == 10.0


# --- drives that move with each write ----------------------------------------------------------------------


def movers(**changes: Any) -> GantryBench:
    plans = [axis_plan(name=f"y{unit}", unit_id=unit, **changes) for unit in (1, 2)]
    bench = GantryBench(*plans)
    assert bench.write_all(50_000) == [50_010, 50_010]
    return bench


def test_the_first_target_fixes_the_values_for_movers() -> None:
    bench = movers()
    bench.write(1, 60_000)
    bench.switch(is_on=False)
    assert bench.write(2, 60_000) == [60_010, 60_010]
    assert bench.write_all(70_000) == [70_000, 70_000]


def test_another_target_that_is_refused_begins_no_new_round() -> None:
    """y1 stays where the round has sent it, so y2 is levelled with the fixed values."""
    bench = movers()
    bench.write(1, 60_000)
    bench.switch(is_on=False)
    bench.lose_target(2, 60_000)
    assert bench.to(1, write(COMMAND, 70_000)) == bytes.fromhex("90 04")
    assert bench.write(2, 60_000) == [60_010, 60_010]


HALVES: Final = {60_000: ("EA60", "0000"), 150_000: ("49F0", "0002")}


def halves(bench: GantryBench, unit_id: int, counts: int) -> None:
    low, high = HALVES[counts]
    for address, word in (("0606", low), ("0607", high)):
        bench.to(unit_id, bytes.fromhex(f"06 {address} {word}"))
        bench.wait(20)


@pytest.mark.parametrize("after", [(1, 0), (1, 1), (2, 0)])
def test_the_halves_of_a_target_for_movers_use_one_decision(after: tuple[int, int]) -> None:
    """Switched off after the low word of y1, after its high one, or after the low one of y2."""
    bench = movers()
    for unit_id in (1, 2):
        for number, (address, word) in enumerate((("0606", "49F0"), ("0607", "0002"))):
            bench.to(unit_id, bytes.fromhex(f"06 {address} {word}"))
            bench.wait(20)
            if (unit_id, number) == after:
                bench.switch(is_on=False)
    assert bench.ends() == [150_010, 150_010]
    for unit_id in (1, 2):
        halves(bench, unit_id, 60_000)
    assert bench.ends() == [60_000, 60_000]


def test_a_low_word_that_stays_alone_ends_the_decision_after_200_ms() -> None:
    bench = movers()
    for unit_id in (1, 2):
        bench.to(unit_id, bytes.fromhex("06 0606 EA60"))
    bench.switch(is_on=False)
    bench.wait(250)
    for unit_id in (1, 2):
        bench.to(unit_id, bytes.fromhex("06 0606 EE48"))
    assert bench.ends() == [61_000, 61_000]


@pytest.mark.parametrize(("ms", "end"), [(200, 150_010), (201, 150_000)])
def test_a_high_word_uses_the_decision_of_its_low_word_for_200_ms(ms: int, end: int) -> None:
    """No position is read, which would take time."""
    plans = [axis_plan(name=f"y{unit}", unit_id=unit, actual=()) for unit in (1, 2)]
    bench = GantryBench(*plans, serial=False)
    bench.write_all(50_000)
    bench.to(1, bytes.fromhex("06 0606 49F0"))
    bench.switch(is_on=False)
    bench.wait(ms)
    bench.to(1, bytes.fromhex("06 0607 0002"))
    halves(bench, 2, 150_000)
    assert bench.ends() == [end, end]


def test_an_alarm_between_the_words_of_a_target_begins_a_new_round() -> None:
    """y1 has stopped anywhere: the high word belongs to no target that it goes to."""
    bench = GantryBench(*(axis_plan(name=f"y{unit}", unit_id=unit, bits=BITS) for unit in (1, 2)))
    bench.write_all(50_000)
    bench.to(1, bytes.fromhex("06 0606 EA60"))
    assert bench.ends() == [60_010, 50_010]
    bench.switch(is_on=False)
    bench.drives[1].words[STATUS] |= 1 << ALARM_BIT
    bench.to(1, STATUS_PDU)
    bench.to(1, bytes.fromhex("06 0607 0000"))
    assert bench.write(2, 60_000) == [60_000, 60_000]


def test_a_whole_target_after_a_masked_write_begins_a_new_round() -> None:
    """C350, its low byte masked to 60: 50 016."""
    bench = movers()
    bench.to(1, bytes.fromhex("16 0606 FF00 0060"))
    assert bench.ends() == [50_026, 50_010]
    bench.switch(is_on=False)
    assert bench.write_all(60_000) == [60_000, 60_000]


def test_a_stream_changes_over_between_whole_rounds() -> None:
    plans = [stream_plan(name=f"y{unit}", unit_id=unit) for unit in (1, 2)]
    bench = GantryBench(*plans)
    for number in range(60):
        for unit_id in (1, 2):
            bench.to(unit_id, write(COMMAND, 50 * number))
            if number == 40 and unit_id == 1:
                bench.switch(is_on=False)
        first, second = bench.ends()
        assert first == second
    assert bench.ends() == [2950, 2950]


def test_repeats_of_one_axis_alone_defer_no_change_for_ever() -> None:
    bench = movers()
    bench.switch(is_on=False)
    for _ in range(150):
        bench.write(1, 50_000)
        bench.wait(100)
    bench.write(1, 60_000)
    assert bench.drives[1].get(COMMAND) == 60_000


def test_the_homed_bits_of_all_movers_are_read_before_the_first_target() -> None:
    bits = {"homed": BITS["homed"]}
    bench = movers(referenced=Reference.DRIVE_BIT, bits=bits)
    bench.wait(1_200)
    bench.drives[2].write(STATUS, b"\0\0")
    bench.log.clear()
    bench.write(1, 60_000)
    bench.write(2, 60_000)
    assert (2, "03 00 5c 00 01") in bench.log[: bench.log.index((1, write(COMMAND, 60_000).hex(" ")))]
    assert bench.ends() == [60_000, 60_000]


def test_a_dry_run_does_not_end_between_two_triggers() -> None:
    bench = GantryBench(compensation=CompensationMode.SHADOW)
    bench.go(50_000)
    bench.start(1, 60_000)
    bench.drives[1].arrive()
    bench.wait(300)
    bench.poll(STATUS_PDU, read(ACTUAL))
    with pytest.raises(ControlError, match="one axis of its group has gone"):
        bench.line.command(EndDryRun(axes=("y1",)), bench.now_ns)
    assert bench.start(2, 60_000) == [60_000, 60_000]
    bench.settle()
    bench.line.command(EndDryRun(axes=("y1",)), bench.now_ns)
    assert bench.go(70_000) == [70_010, 70_010]


def test_a_kill_ends_the_decision() -> None:
    """The target of the other axis is then unknown: its trigger is refused, and M11 begins again."""
    bench = half_gone()
    after = GantryBench()
    after.drives = bench.drives
    moves = after.counts_of_moves()
    assert after.to(2, RUN_PDU) == bytes.fromhex("86 04")
    assert after.counts_of_moves() == moves
    after.settle()
    assert after.go(70_000) == [70_010, 70_010]


def test_three_axes_follow_the_first() -> None:
    plans = [staged_plan(name=f"y{unit}", unit_id=unit) for unit in (1, 2, 3)]
    bench = GantryBench(*plans)
    bench.go(50_000)
    bench.stage_all(60_000)
    bench.run(2)
    bench.switch(is_on=False)
    bench.run(3)
    assert bench.group()["state"] == "under-way"
    assert bench.run(1) == [60_010] * 3
    assert bench.group()["state"] == "open"


def test_two_pipelined_triggers_follow_one_decision() -> None:
    bench = reversed_gantry(serial=False)
    for unit_id in (1, 2):
        bench.line.request(bench.port, unit_id, unit_id, RUN_PDU, bench.now_ns)
    while not (bench.link.sent[0][0] == 1 and bench.link.sent[0][1] == RUN_PDU):
        unit_id, pdu = bench.link.sent.pop(0)
        bench.line.reply(unit_id, bench.drives[unit_id].answer(pdu), bench.now_ns)
    bench.switch(is_on=False)  # the first is on its way: what holds is fixed
    bench.serve()
    assert [reply[2] for reply in bench.port.replies] == [RUN_PDU, RUN_PDU]
    assert bench.ends() == [59_990, 59_990]


def test_a_first_trigger_that_was_refused_may_come_again() -> None:
    """The target of y2 alone was lost: y1 is refused as well, and both run once y2 has another target."""
    settings = {"travel": (0.0, 100.0), "travel_margin": 0.0}
    bench = gantry(**settings)
    bench.stage(1, 60_000)
    bench.lose_target(2, 60_000)
    moves = bench.counts_of_moves()
    assert bench.to(1, RUN_PDU) == bytes.fromhex("86 04")
    assert bench.counts_of_moves() == moves
    bench.stage(2, 60_000)
    assert bench.run(1, 2) == [60_010, 60_010]


def test_m6_a_repeat_of_the_target_to_which_an_axis_goes_is_not_passed_on_the_way() -> None:
    """Its words are fixed by the first trigger. Its reading is old by then, and its speed is not known."""
    bench = GantryBench(max_speed=0.0)
    bench.go(50_000)
    bench.begin(90_000)
    bench.run(2)
    bench.wait(100)
    bench.stage(1, 90_000)
    bench.stage(2, 90_000)
    bench.run(2)
    bench.wait(100)
    bench.run(1)
    assert not any(axis.is_unsure for axis in bench.line.axes)


def test_an_axis_with_an_alarm_between_two_triggers_is_still_run_corrected() -> None:
    bench = GantryBench(referenced=Reference.SET_POSITION)
    for unit_id in (1, 2):
        assert bench.to(unit_id, ZERO_PDU) == ZERO_PDU
    assert bench.go(50_000) == [50_010, 50_010]
    bench.begin(60_000)
    lost = bench.kinds().count("reference-lost")
    bench.drives[2].set_bits(is_done=True, is_alarmed=True)
    bench.to(2, STATUS_PDU)
    assert bench.kinds().count("reference-lost") == lost + 2
    assert bench.run(2) == [60_010, 60_010]
    bench.settle()
    assert bench.go(70_000) == [70_000, 70_000]


def test_an_axis_without_a_group_has_no_group_status() -> None:
    bench = Bench(axis_plan())
    assert axis_status(bench.line.axes[0], bench.now_ns).group is None


# --- what its peers are prepared for -----------------------------------------------------------------------


def run_both(bench: GantryBench, pdu: bytes) -> list[bytes]:
    """Run both axes by a trigger, and return the answers."""
    return [bench.to(unit_id, pdu) for unit_id in (1, 2)]


def test_the_other_axis_gets_an_absolute_target_after_a_distance_as_such() -> None:
    """Prepared as 70 000 + 60 000, the other axis would have left its travel: both were refused for ever."""
    bench = gantry(travel=(0.0, 100.0))
    bench.stage_all(20_000)
    assert run_both(bench, RUN_RELATIVE_PDU) == [RUN_RELATIVE_PDU] * 2
    bench.settle()
    bench.stage_all(60_000)
    assert bench.run(1, 2) == [59_990, 59_990]


def test_the_other_axis_gets_a_distance_after_an_absolute_target_as_such() -> None:
    bench = gantry(travel=(0.0, 100.0))
    bench.stage_all(-5_000)
    assert run_both(bench, RUN_RELATIVE_PDU) == [RUN_RELATIVE_PDU] * 2
    assert bench.ends() == [44_990, 44_990]


def test_a_distance_of_the_other_axis_is_written_again_before_the_first_trigger_is_sent() -> None:
    """From 50 010 back to 44 990: by -5 020, FFFF EC64."""
    bench = gantry()
    bench.stage_all(-5_000)
    bench.log.clear()
    assert bench.to(1, RUN_RELATIVE_PDU) == RUN_RELATIVE_PDU
    by = "10 06 06 00 02 04 ec 64 ff ff"
    assert writes(bench) == [(2, by), (1, by), (1, "06 05 0e 00 02")]


def test_the_target_of_a_stopped_axis_is_written_again_before_the_first_trigger() -> None:
    bench = gantry()
    bench.begin(60_000)
    bench.run(2)
    turn_back(bench)
    bench.run(1)
    assert writes(bench) == BOTH_ANEW


def test_nothing_is_added_for_a_target_that_the_other_axis_has_run() -> None:
    bench = gantry()
    assert bench.to(2, JOG_PDU) == JOG_PDU
    bench.stage(1, 60_000)
    bench.log.clear()
    bench.run(1)
    assert {unit_id for unit_id, _ in bench.log} == {1}


ABSOLUTE_PDU: Final = bytes.fromhex("06 0700 0001")
JOGGING_PDU: Final = bytes.fromhex("06 0700 0003")
"""A mode in which the drive runs no target."""


@pytest.mark.parametrize(("mode", "written"), [(ABSOLUTE_PDU, BOTH_ANEW), (JOGGING_PDU, BOTH_ANEW[1:])])
def test_the_mode_of_the_other_axis_decides_whether_its_target_is_written_again(
    mode: bytes, written: list[tuple[int, str]]
) -> None:
    bench = GantryBench(motion=sticky())
    bench.poll(ABSOLUTE_PDU)
    bench.go(50_000)
    bench.stage_all(60_000)
    bench.to(2, mode)
    turn_back(bench)
    bench.run(1)
    assert writes(bench) == written


@pytest.mark.parametrize("added_frames", [True, False])
def test_an_unknown_mode_of_the_other_axis_is_read_once_at_most(*, added_frames: bool) -> None:
    """Its drive refuses to report it, or no read may be added: its target stays as it is."""
    bench = GantryBench(motion=sticky(), added_frames=added_frames)
    bench.to(1, ABSOLUTE_PDU)
    bench.stage_all(60_000)
    bench.log.clear()
    bench.refuses.append((2, bytes.fromhex("03 0700"), bytes.fromhex("83 02")))
    bench.run(1)
    assert [pdu for unit_id, pdu in bench.log if unit_id == 2] == ["03 07 00 00 01"] * added_frames


def test_an_axis_that_passes_1_to_1_blocks_no_other_axis() -> None:
    bench = bit_gantry()
    for unit_id in (1, 2):
        bench.lose_homed_bit(unit_id)
        bench.to(unit_id, STATUS_PDU)
    bench.lose_target(1, 60_000)
    bench.stage(2, 60_000)
    assert bench.run(2) == [50_010, 60_000]


def test_the_first_trigger_is_refused_if_another_axis_has_lost_its_staged_target() -> None:
    """y2 was silent for longer than lost_ms between staging and running: its target is unknown."""
    bench = gantry()
    bench.stage_all(70_000)
    for _ in range(3):
        bench.unanswered(STATUS_PDU, 1001, 1001, unit_id=2)
    bench.wait(1000)
    bench.to(2, STATUS_PDU)
    assert run_both(bench, RUN_PDU) == [bytes.fromhex("86 04")] * 2
    assert bench.ends() == [50_010, 50_010]
    assert "group-skewed" not in bench.kinds()


def test_the_first_trigger_is_refused_if_another_axis_lost_its_target_while_positions_passed_1_to_1() -> None:
    bench = bit_gantry()
    for unit_id in (1, 2):
        bench.lose_homed_bit(unit_id)
        bench.to(unit_id, STATUS_PDU)
    bench.lose_target(1, 60_000)
    bench.not_homed.clear()
    bench.settle()
    bench.stage(2, 60_000)
    assert bench.to(2, RUN_PDU) == bytes.fromhex("86 04")
    assert bench.ends() == [50_010, 50_010]
    bench.stage_all(60_000)
    assert bench.run(1, 2) == [60_010, 60_010]


def test_in_a_dry_run_staged_targets_that_cannot_be_computed_run_as_they_came() -> None:
    """150 mm is beyond the travel, which is checked only for an axis that is corrected."""
    bench = GantryBench(compensation=CompensationMode.SHADOW, travel=(0.0, 100.0))
    bench.stage_all(150_000)
    bench.log.clear()
    assert bench.run(1, 2) == [150_000, 150_000]
    assert bench.log == [(1, "06 05 0e 00 01"), (2, "06 05 0e 00 01")]


def test_the_staged_target_of_another_axis_is_rendered_once_for_a_trigger() -> None:
    """y2 was seen less than 20 ms before the trigger, and more before its rewritten target was acknowledged.

    It is not read again. With half the gain 30 000 is 29 995, from above.
    """
    bench = gantry(max_speed=20.0, fresh_ms=20.0)
    bench.stage_all(60_000)
    bench.run(1, 2)
    bench.drives[1].arrive()
    bench.wait(1_000)
    bench.poll(STATUS_PDU, read(ACTUAL))
    bench.stage_all(30_000)
    bench.gain(0.5)
    bench.drives[2].pass_by(55_000)
    bench.to(2, read(ACTUAL))
    seen = bench.line.axes[1].motion.actual
    assert seen is not None
    bench.now_ns = seen.seen_ns + int(19.1 * MS)
    bench.log.clear()
    assert bench.run(1, 2) == [29_995, 29_995]
    assert bench.log == [
        (2, "10 06 06 00 02 04 75 2b 00 00"),
        (1, "10 06 06 00 02 04 75 2b 00 00"),
        (1, "06 05 0e 00 01"),
        (2, "06 05 0e 00 01"),
    ]


# --- targets of before a loss ------------------------------------------------------------------------------


@pytest.mark.parametrize(("y2_stands_at", "end"), [(50_010, 50_010), (50_050, 50_000)])
def test_all_targets_of_a_group_from_before_a_loss_count_or_none(y2_stands_at: int, end: int) -> None:
    """If each axis is at its target, both keep their words. If y2 is 40 counts beside it, both targets are
    rendered again."""
    bench = bit_gantry()
    for unit_id in (1, 2):
        bench.lose_homed_bit(unit_id)
    bench.wait(1_200)
    bench.poll()
    bench.drives[2].put(ACTUAL, y2_stands_at)
    bench.stage_all(50_000)
    assert bench.run(1, 2) == [end, end]


def test_the_positions_of_all_movers_are_read_before_the_first_target() -> None:
    bench = GantryBench(
        *(
            axis_plan(name=f"y{unit}", unit_id=unit, referenced=Reference.DRIVE_BIT, bits=BITS)
            for unit in (1, 2)
        )
    )
    bench.write_all(70_000)
    bench.settle()
    assert bench.ends() == [70_010, 70_010]
    bench.drives[1].words[STATUS] = 0  # y1 says that it is not homed any more
    bench.wait(1_200)
    bench.to(1, STATUS_PDU)
    bench.drives[2].put(ACTUAL, 69_600)  # y2 is 0.4 mm short of it
    for unit_id in (1, 2):
        assert bench.to(unit_id, write(COMMAND, 70_000)) == write(COMMAND, 70_000)[:5]
    assert bench.ends() == [70_000, 70_000]


# --- a first trigger that the drive may have obeyed ---------------------------------------------------------


UNCONFIRMED: Final = [None, bytes.fromhex("86 04"), bytes.fromhex("86 05"), bytes.fromhex("86 0B")]
"""Silence, and exceptions that prove nothing of a drive whose map does not say nothing-written."""


def perhaps_gone(answer: bytes | None, **changes: Any) -> GantryBench:
    """The drive obeyed the first trigger, but its reply does not prove it; the second one is refused (M3)."""
    bench = gantry(**{"lost_ms": 5_000.0, **changes})
    bench.stage_all(60_000)
    bench.obeys_secretly(RUN_PDU, answer)
    bench.wait(1_000)
    bench.port.replies.clear()
    assert bench.drives[1].moves[-1] == ("absolute", 60_010)
    assert bench.to(2, RUN_PDU)[0] == 0x86
    assert bench.ends() == [60_010, 50_010]
    return bench


@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
@pytest.mark.parametrize("answer", UNCONFIRMED)
def test_a_trigger_that_may_have_been_obeyed_fixes_the_decision(
    answer: bytes | None, order: tuple[int, int]
) -> None:
    bench = perhaps_gone(answer)
    assert bench.group()["state"] == "under-way"
    bench.switch(is_on=False)
    assert bench.group()["is_put_off"]
    bench.stage_all(60_000)
    assert bench.run(*order) == [60_010, 60_010]
    bench.settle()
    assert bench.group() == {
        "state": "open", "has_gone": False, "is_put_off": False, "is_skewed": False, "skew": None,
    }  # fmt: skip
    assert bench.go(70_000) == [70_000, 70_000]


def test_an_unknown_skew_is_reported_immediately() -> None:
    bench = gantry()
    bench.stage_all(60_000)
    bench.obeys_secretly(RUN_PDU)
    event = next(each for each in bench.events if each.kind.name == "group-skewed")
    assert event.axis == "y1"
    assert event.detail == (
        "its trigger was sent, and the drive may have obeyed it (exception 0x0b): the skew is not known"
    )
    assert (bench.group()["is_skewed"], bench.group()["skew"]) == (True, None)


@pytest.mark.parametrize("answer", [bytes.fromhex("86 01"), bytes.fromhex("86 04")])
def test_an_exception_that_proves_nothing_was_executed_fixes_nothing(answer: bytes) -> None:
    bench = gantry(exception_writes_nothing=True)
    bench.stage_all(60_000)
    bench.refuses.append((1, RUN_PDU, answer))
    assert bench.to(1, RUN_PDU) == answer
    assert bench.group()["state"] == "open"
    assert "group-skewed" not in bench.kinds()


def test_after_ten_seconds_all_targets_are_rendered_again_also_of_an_axis_that_may_have_started() -> None:
    """Its words are those of another switch, and the other axis has no words of that target: both are sent
    1:1."""
    bench = perhaps_gone(None)
    bench.switch(is_on=False)
    for _ in range(11):
        bench.wait(1_000)
        bench.poll()
    assert bench.group()["state"] == "open"
    bench.stage_all(60_000)
    assert bench.run(1, 2) == [60_000, 60_000]


def may_have_gone(**changes: Any) -> GantryBench:
    """Do as :func:`perhaps_gone`, then switch the compensation off."""
    bench = perhaps_gone(None, **changes)
    bench.switch(is_on=False)
    return bench


@pytest.mark.parametrize("before", [half_gone, may_have_gone])
def test_another_target_for_an_axis_that_has_or_may_have_started_ends_the_decision(
    before: Callable[[], GantryBench],
) -> None:
    bench = before()
    bench.stage(1, 70_000)
    assert bench.group()["state"] == "open"
    bench.stage(2, 70_000)
    assert bench.run(1, 2) == [70_000, 70_000]


def test_a_part_of_another_target_does_not_end_the_decision() -> None:
    """A distance may have been run. Its successor is lost to a wrong count (90 03), then comes in parts."""
    bench = gantry()
    bench.stage_all(5_000)
    bench.obeys_secretly(RUN_RELATIVE_PDU, bytes.fromhex("86 04"))
    bench.port.replies.clear()
    assert bench.to(1, bytes.fromhex("10 0606 0002 02 EA60")) == bytes.fromhex("90 03")
    bench.to(1, bytes.fromhex("06 0606 EA60"))
    assert bench.group()["state"] == "under-way"
    bench.to(1, bytes.fromhex("06 0607 0000"))
    assert bench.group()["state"] == "open"


@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
def test_a_drive_that_cannot_be_reached_ends_the_decision_and_no_axis_keeps_its_words(
    order: tuple[int, int],
) -> None:
    bench = perhaps_gone(None, lost_ms=1_000.0)
    bench.switch(is_on=False)
    bench.stage_all(60_000)
    assert bench.run(*order) == [60_000, 60_000]


def test_a_stop_ends_the_decision_of_an_axis_that_may_have_started() -> None:
    bench = perhaps_gone(None)
    bench.switch(is_on=False)
    bench.stop(1)
    assert bench.group()["state"] == "open"


def test_a_homed_bit_that_falls_after_an_axis_may_have_started_refuses_nothing() -> None:
    bench = bit_gantry(lost_ms=5_000.0)
    bench.stage_all(60_000)
    bench.obeys_secretly(RUN_PDU)
    bench.wait(1_000)
    bench.port.replies.clear()
    bench.lose_homed_bit(2)
    bench.to(2, STATUS_PDU)
    bench.stage_all(60_000)
    assert bench.run(1, 2) == [60_010, 60_010]


@pytest.mark.parametrize(("lost_ms", "end"), [(5_000.0, 60_010), (1_000.0, 60_000)])
def test_a_mover_that_may_have_started_fixes_the_values_too(lost_ms: float, end: int) -> None:
    """If its drive could not be reached for ``lost_ms``, no axis keeps its words."""
    bench = movers(lost_ms=lost_ms)
    bench.obeys_secretly(write(COMMAND, 60_000))
    bench.wait(1_000)
    bench.port.replies.clear()
    bench.switch(is_on=False)
    assert bench.to(2, write(COMMAND, 60_000))[0] == 0x90  # M3
    for unit_id in (1, 2):
        assert bench.to(unit_id, write(COMMAND, 60_000)) == write(COMMAND, 60_000)[:5]
    assert bench.ends() == [end, end]


# --- words of another switch, table or gain ----------------------------------------------------------------


def apart(bench: GantryBench, elsewhere: float = 50_010) -> GantryBench:
    """Only y1 goes to 60 mm, y2 stays where it is; then the compensation is switched off."""
    bench.start(1, 60_000)
    bench.settle()
    for _ in range(11):
        bench.wait(1_000)
        bench.poll(STATUS_PDU, read(ACTUAL))
    assert bench.ends() == [60_010, elsewhere]
    bench.switch(is_on=False)
    bench.log.clear()
    return bench


@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
def test_no_axis_keeps_its_words_if_one_uses_the_requested_values(order: tuple[int, int]) -> None:
    """y1 got 60 010 for it before the switch; y2 gets 60 000."""
    bench = apart(gantry())
    bench.stage_all(60_000)
    assert bench.run(*order) == [60_000, 60_000]


def test_without_added_frames_each_target_written_again_uses_the_requested_values() -> None:
    """y1 was written with its previous words, because the words of y2 were not known yet: it is refused
    once."""
    bench = GantryBench(added_frames=False)
    bench.go(50_000)
    bench.go(55_000)
    apart(bench, elsewhere=55_010)
    bench.stage_all(60_000)
    assert bench.to(1, RUN_PDU) == bytes.fromhex("86 04")
    bench.stage_all(60_000)
    assert bench.run(1, 2) == [60_000, 60_000]


def test_no_axis_moves_if_all_keep_their_words() -> None:
    bench = apart(gantry())
    bench.stage(1, 60_000)
    bench.stage(2, 50_000)
    assert bench.run(1, 2) == [60_010, 50_010]


def test_targets_that_are_only_run_again_are_not_written_again() -> None:
    bench = gantry()
    bench.switch(is_on=False)
    bench.log.clear()
    bench.run(2, 1)
    assert bench.log == [(2, "06 05 0e 00 01"), (1, "06 05 0e 00 01")]


def test_all_targets_are_rendered_again_after_a_new_gain() -> None:
    """y1 goes backward for it, from 60 010."""
    bench = apart(gantry())
    bench.switch(is_on=True)
    bench.gain(0.5)
    bench.stage_all(60_000)
    assert bench.run(1, 2) == [59_995, 60_005]


@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
@pytest.mark.parametrize("staging", [(1, 2), (2, 1)])
@pytest.mark.parametrize(
    ("change", "ends", "then"),
    [
        (lambda bench: bench.gain(0.5), [60_005, 59_995], [70_005, 70_005]),
        (lambda bench: bench.switch(is_on=False), [60_000, 60_000], [70_000, 70_000]),
        (lambda bench: set_tables(bench, 0.02), [60_020, 60_020], [70_020, 70_020]),
    ],
)
def test_an_axis_that_has_started_and_one_that_may_have_both_use_the_requested_values(
    order: tuple[int, int],
    staging: tuple[int, int],
    change: Callable[[GantryBench], None],
    ends: list[int],
    then: list[int],
) -> None:
    """y2 goes to 60 mm. The trigger of y1 is refused without proof, and y1 stays at 50.

    Then gain, switch or table change, and both get 60 mm again. The target of y1 is rendered again, because
    it was read at 50: so y2 may not keep its words. With half the gain y2 goes backward for it, from 60 010.
    """
    bench = gantry(lost_ms=60_000.0)
    bench.stage_all(60_000)
    bench.run(2)
    bench.drives[2].arrive()
    bench.refuses.append((1, RUN_PDU, bytes.fromhex("86 04")))
    assert bench.to(1, RUN_PDU) == bytes.fromhex("86 04")
    for _ in range(11):
        bench.wait(1_000)
        bench.poll(STATUS_PDU, read(ACTUAL))
    change(bench)
    for unit_id in staging:
        bench.stage(unit_id, 60_000)
    assert bench.run(*order) == ends
    bench.settle()
    assert bench.go(70_000) == then


def test_all_targets_are_rendered_again_after_enabling() -> None:
    bench = gantry()
    bench.switch(is_on=False)
    bench.go(60_000)
    bench.start(1, 70_000)
    bench.settle()
    for _ in range(11):
        bench.wait(1_000)
        bench.poll()
    bench.switch(is_on=True)
    bench.stage_all(70_000)
    assert bench.run(1, 2) == [70_010, 70_010]


def test_a_mover_keeps_no_words_after_one_that_used_the_requested_values() -> None:
    bench = movers()
    bench.switch(is_on=False)
    bench.write(2, 60_000)
    assert bench.write(1, 50_000) == [50_000, 60_000]


def test_movers_that_get_the_same_targets_again_keep_their_words() -> None:
    bench = movers()
    bench.switch(is_on=False)
    for _ in range(3):
        bench.write_all(50_000)
    assert bench.ends() == [50_010, 50_010]


def test_a_mover_that_kept_its_words_follows_one_that_did_not() -> None:
    """When the first target is sent, it is unknown whether the other axis gets the same again."""
    bench = movers()
    bench.write(1, 60_000)
    bench.wait(10_100)
    bench.switch(is_on=False)
    assert bench.write(1, 60_000) == [60_010, 50_010]
    bench.write(2, 60_000)
    assert bench.write(1, 60_000) == [60_000, 60_000]


def test_a_mover_keeps_no_words_beside_one_that_has_no_target_yet() -> None:
    bench = GantryBench(*(axis_plan(name=f"y{unit}", unit_id=unit) for unit in (1, 2)))
    bench.write(1, 50_000)
    bench.wait(10_100)
    bench.switch(is_on=False)
    bench.hides.append((1, bytes.fromhex("10 06 06"), bytes.fromhex("90 04")))
    assert bench.to(1, write(COMMAND, 50_000)) == bytes.fromhex("90 04")
    assert bench.ends() == [50_000, 0]
    bench.write(2, 60_000)
    assert bench.write(1, 50_000) == [50_000, 60_000]


def test_the_repeat_of_an_axis_is_rendered_again_after_a_distance_of_another_one() -> None:
    bench = apart(gantry())
    bench.stage(2, 10_000)
    assert bench.to(2, RUN_RELATIVE_PDU) == RUN_RELATIVE_PDU
    assert bench.start(1, 60_000) == [60_000, 60_000]


def test_a_mover_keeps_no_words_beside_one_that_something_else_has_moved() -> None:
    """y2 was jogged away, so its next target is a new one. y1 may not keep the words of another switch."""
    bench = movers()
    bench.poll(read(ACTUAL))
    bench.drives[2].put(ACTUAL, 40_000)
    bench.poll(read(ACTUAL))
    bench.switch(is_on=False)
    assert bench.write_all(50_000) == [50_000, 50_000]


@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
def test_a_mover_keeps_no_words_beside_one_that_was_moved_unseen(order: tuple[int, int]) -> None:
    """y2 is read before the first one goes. With half the gain 50 000 is 50 005, or 49 995 from above."""
    bench = movers()
    bench.poll(read(ACTUAL))
    bench.wait(20_000)
    bench.drives[2].put(ACTUAL, 40_000)
    bench.gain(0.5)
    bench.log.clear()
    for unit_id in order:
        bench.write(unit_id, 50_000)
    frames = [(unit_id, frame[:8]) for unit_id, frame in bench.log]
    assert frames.index((2, "03 05 20")) < frames.index((order[0], "10 06 06"))
    assert [abs(end - 50_000) for end in bench.ends()] == [5, 5]


def test_movers_at_their_targets_keep_their_words_after_a_long_pause() -> None:
    bench = movers()
    bench.poll(read(ACTUAL))
    bench.wait(20_000)
    bench.gain(0.5)
    assert bench.write_all(50_000) == [50_010, 50_010]


def test_a_mover_keeps_no_words_beside_one_that_has_lost_its_target() -> None:
    """Targets of both were refused, and only y1 got the next one: the next target of y2 is no repeat."""
    bench = movers(travel=(0.0, 100.0))
    bench.write_all(150_000)
    assert bench.write(1, 60_000) == [60_010, 50_010]
    bench.poll(read(ACTUAL))
    bench.wait(10_100)
    bench.switch(is_on=False)
    assert bench.write_all(60_000) == [60_000, 60_000]


def test_no_target_is_written_to_a_stopped_mover_for_another_axis() -> None:
    """Its old target would be right with half the gain only after another write, and that would move it."""
    motion = MotionPlan(triggers=(TriggerPlan(TRIGGER, deeds=DEEDS),))
    bench = GantryBench(*(staged_plan(name=f"y{unit}", unit_id=unit, motion=motion) for unit in (1, 2)))
    bench.write_all(50_000)
    bench.settle()
    bench.write_all(60_000)
    bench.drives[2].pass_by(53_000)
    bench.stop(2)
    bench.gain(0.5)
    bench.log.clear()
    bench.write(1, 53_000)
    assert [frame for unit_id, frame in bench.log if unit_id == 2 and frame[:2] == "10"] == []


def test_a_mover_that_was_taken_over_holds_up_no_other() -> None:
    """The words of the former writer are void. Each axis waits for none of the others: one must be first."""
    bench = movers()
    bench.wait(60_000)
    bench.port = Port(ControllerPlan("panel"))
    assert bench.write(1, 60_000) == [60_010, 50_010]
    assert bench.write(2, 60_000) == [60_010, 60_010]


@pytest.mark.parametrize("stopped", [1, 2])
def test_a_target_keeps_no_words_beside_one_that_was_stopped(stopped: int) -> None:
    bench = gantry()
    bench.stop(stopped)
    bench.settle()
    bench.switch(is_on=False)
    for unit_id in (1, 2):
        bench.start(unit_id, 50_000)
    assert bench.ends() == [50_000, 50_000]


Y_TRIGGER = TRIGGER + 1
Y_COMMAND = COMMAND.__class__(TRIGGER + 2, COMMAND.type, COMMAND.order)
Y_ACTUAL = ACTUAL.__class__(0x0720, ACTUAL.type, ACTUAL.order)
STOP_Y1_AND_MOVE_Y2 = bytes.fromhex("10 050E 0004 08 03E8 0001") + write(Y_COMMAND, 60_000)[6:]


def started_on_one_unit_id() -> StagedBench:
    """A beam on one unit id: both targets are 50 000, and y2 has been run."""
    y_motion = MotionPlan(is_staged=True, triggers=(TriggerPlan(Y_TRIGGER, deeds=DEEDS),))
    y = staged_plan(name="y2", motion=y_motion, command=(Y_COMMAND,), actual=(Y_ACTUAL,), commanded=())
    bench = StagedBench(staged_plan(name="y1"), y, groups=[("y1", "y2")], serial=False)
    for place in (COMMAND, Y_COMMAND):
        assert bench.ask(write(place, 50_000)) == write(place, 50_000)[:5]
    run_y = bytes.fromhex("06 050F 0001")
    assert bench.ask(run_y) == run_y
    return bench


def test_a_stop_is_sent_although_its_frame_runs_a_target_that_is_refused() -> None:
    """M3: the axes y1 and y2 are on one unit id. y2 has run, y1 has lost its target."""
    bench = started_on_one_unit_id()
    bench.unanswered(write(COMMAND, 60_000), 1000, 1000)
    assert bench.ask(STOP_Y1_AND_MOVE_Y2) == STOP_Y1_AND_MOVE_Y2[:5]
    assert bench.drive.moves[-1] == ("stop", 0)


def test_a_target_beside_a_stop_begins_a_new_round_as_any_other() -> None:
    """y2 has started, then all is switched off. A frame stops y1 and sends y2 on; then y1 follows, 1:1."""
    bench = started_on_one_unit_id()
    bench.line.command(Disable(axes=("y1",)), bench.now_ns)
    assert bench.ask(STOP_Y1_AND_MOVE_Y2) == STOP_Y1_AND_MOVE_Y2[:5]
    assert bench.drive.get(Y_COMMAND) == 60_000
    assert bench.run(60_000) == ("absolute", 60_000)


@pytest.mark.parametrize(
    "motion",
    [
        MotionPlan(triggers=(TriggerPlan(TRIGGER, deeds=DEEDS),)),
        MotionPlan(starts_on=frozenset({COMMAND.address})),
        MotionPlan(starts_on=frozenset({COMMAND.address}), is_staged=True),
    ],
    ids=["moves with each write", "starts on a word", "starts on a word, staged"],
)
def test_a_group_continues_after_a_refused_target_if_one_frame_writes_and_runs(motion: MotionPlan) -> None:
    """M11: both axes get a target beyond the travel, then an allowed one. Neither waits for the other."""
    plans = [axis_plan(name=f"y{n}", unit_id=n, motion=motion, travel=(0.0, 100.0)) for n in (1, 2)]
    bench = Bench(*plans, groups=[("y1", "y2")])
    for counts, is_allowed in ((50_000, True), (150_000, False), (60_000, True), (70_000, True)):
        request = write(COMMAND, counts)
        for unit_id in (1, 2):
            expected = request[:5] if is_allowed else bytes.fromhex("90 04")
            assert bench.ask(request, unit_id=unit_id) == expected


FIRST, SECOND = (PositionField(address, COMMAND.type, COMMAND.order) for address in (0x0600, 0x0602))


def both(counts: float) -> bytes:
    """One frame with a target for two axes on one unit id."""
    return bytes.fromhex("10 0600 0004 08") + FIRST.pack(counts) + SECOND.pack(counts)


@pytest.mark.parametrize("is_answered", [True, False])
def test_one_frame_for_both_axes_is_sent_after_the_one_before_was_refused_or_lost(
    *, is_answered: bool
) -> None:
    """M11: each axis gets its target with the other one, so neither is waited for. 60 000 is 60 010."""
    y1 = axis_plan(name="y1", command=(FIRST,), travel=(0.0, 100.0))
    y2 = axis_plan(name="y2", command=(SECOND,), actual=(Y_ACTUAL,), travel=(0.0, 100.0))
    bench = Bench(y1, y2, groups=[("y1", "y2")], serial=False)
    if is_answered:
        assert bench.ask(both(150_000)) == bytes.fromhex("90 04")
    else:
        assert bench.unanswered(both(50_000), 1000, 1000) == [bytes.fromhex("90 0b")]
        bench.wait(3_000)
    assert bench.ask(both(60_000)) == both(60_000)[:5]
    assert [bench.memory.get(place) for place in (FIRST, SECOND)] == [60_010, 60_010]


GO_COMMAND = PositionField(TRIGGER + 1, COMMAND.type, COMMAND.order)
GO_PLANS = tuple(
    staged_plan(name=f"y{n}", unit_id=n, motion=ONLY_ABSOLUTE, command=(GO_COMMAND,), travel=(0.0, 100.0))
    for n in (1, 2)
)


def frame_of(trigger: int, counts: float) -> bytes:
    """One frame that writes a target and does something."""
    return bytes.fromhex("10 050E 0003 06") + trigger.to_bytes(2, "big") + write(GO_COMMAND, counts)[6:]


def test_a_staged_target_that_never_ran_blocks_no_frames_that_write_and_run() -> None:
    bench = Bench(*GO_PLANS, groups=[("y1", "y2")])
    assert bench.ask(write(GO_COMMAND, 55_000), unit_id=2) == write(GO_COMMAND, 55_000)[:5]
    for counts, is_allowed in ((150_000, False), (60_000, True), (70_000, True)):
        request = frame_of(RUN, counts)
        for unit_id in (1, 2):
            assert bench.ask(request, unit_id=unit_id) == (
                request[:5] if is_allowed else bytes.fromhex("90 04")
            )


def test_two_axes_that_have_both_lost_their_targets_continue_with_frames_that_write_and_run() -> None:
    """Both targets were written alone, and lost: one of the two has to be the first."""
    bench = Bench(*GO_PLANS, groups=[("y1", "y2")])
    for unit_id in (1, 2):
        assert bench.ask(write(GO_COMMAND, 150_000), unit_id=unit_id) == bytes.fromhex("90 04")
    request = frame_of(RUN, 60_000)
    for unit_id in (1, 2):
        assert bench.ask(request, unit_id=unit_id) == request[:5]


def test_an_axis_that_has_lost_nothing_waits_for_one_that_has() -> None:
    bench = Bench(*GO_PLANS, groups=[("y1", "y2")])
    assert bench.ask(write(GO_COMMAND, 150_000), unit_id=2) == bytes.fromhex("90 04")
    request = frame_of(RUN, 60_000)
    for unit_id, reply in ((1, bytes.fromhex("90 04")), (2, request[:5]), (1, request[:5])):
        assert bench.ask(request, unit_id=unit_id) == reply


@pytest.mark.parametrize(("waits_ms", "is_flagged"), [(20, False), (60, True)])
def test_m11_an_axis_that_passed_its_target_before_its_own_trigger_is_flagged(
    waits_ms: int, is_flagged: bool
) -> None:
    """Both move at 200 mm/s, and are read 10 mm before their new target: in 60 ms they go 12 mm."""
    bench = GantryBench(max_speed=200.0)
    for counts in (10_000, 20_000):
        bench.stage_all(counts)
        bench.run(1, 2)
        bench.settle()
    bench.stage_all(90_000)
    bench.run(1, 2)
    for drive in bench.drives.values():
        drive.pass_by(30_000)
    bench.poll(read(ACTUAL))
    bench.stage_all(40_000)
    bench.run(1)
    bench.wait(waits_ms)
    assert bench.run(2) == [40_010, 40_010]
    assert bench.line.axes[1].is_unsure is is_flagged
