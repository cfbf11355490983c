"""The shortest traces to rules that were broken once, as ``make verify`` found them.

Each plays events in a small world of ``tests.verify``; what goes over the wires stands beside them. A drive
counts 1000 per mm on the table ``tests.verify.screw.WORN``.
"""

from dataclasses import replace

import pytest

from gateway.drives.motion import Action, ModePlan, MotionPlan
from gateway.exchange.status import direction_state
from tests.exchange.line_bench import ACTUAL, COMMAND, MOVE_MS, Bench, axis_plan, read, write
from tests.exchange.staged_bench import (
    COMMANDED,
    JOG_PDU,
    MODE,
    RUN_PDU,
    RUN_RELATIVE_PDU,
    STOP_PDU,
    StagedBench,
    staged_plan,
)
from tests.verify.designs import BY_NAME
from tests.verify.explore import play, replay
from tests.verify.screw import WORN
from tests.verify.world import Happening, World

ACK = ("drive", "ack")
REFUSE = ("drive", "refuse")
ARRIVE = ("arrive", 0)
RUN = ("ask", 0, "run", 0)


READ = ("ask", 0, "read", 0)
OBEY = ("drive", "obey")
WAIT = ("wait",)
KILL = ("kill",)


def to(target: int, axis: int = 0) -> Happening:
    """The controller writes one of the targets of the world."""
    return ("ask", 0, "to", axis, target)


def on_the_wire(world: World) -> bytes:
    """The frame that the drive has and has not answered."""
    assert world.state.wire is not None
    return world.state.wire.pdu


def test_a_beam_does_not_go_while_the_target_of_one_of_its_axes_is_lost() -> None:
    """M11: both axes of a group lost their target; the new one of x is no target of y."""
    lost = (
        to(0, axis=0),  # unit 1: 10 0606 0002 04 232F 0000, sent as 10 0606 0002 04 235E 0000
        REFUSE,  # 90 04: blocks both axes, for the sake of x
        to(0, axis=1),  # unit 2: the same
        REFUSE,  # 90 04: y lost one of its own
        to(0, axis=0),
        ACK,  # x has a new one
        RUN,  # 06 050E 0001 is answered 86 04: y has none
    )
    assert ACK not in play(BY_NAME["group"], *lost).happenings()
    anew = (*lost, to(0, axis=1), ACK, RUN)
    assert ACK in play(BY_NAME["group"], *anew).happenings()


def test_a_reading_decides_no_branch_after_two_targets_that_came_without_one() -> None:
    """M6: where the axis stood when its last target came was assumed, so its reading is judged on the drive's
    scale."""
    play(
        BY_NAME["late-start"],
        to(0),  # 10 0606 0002 04 E4A5 FFFF: -7003
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 E425 FFFF: backward to -7131
        ARRIVE,
        to(1),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 03 0520 0002 -> E425 FFFF
        ACK,  # 10 0606 0002 04 23D4 0000; 80 ms pass, and it has not begun to move
        to(0),
        ACK,  # 03 0520 0002 -> E425 FFFF
        ACK,  # 10 0606 0002 04 E502 FFFF: flagged, for nothing tells
        to(1),
        ACK,  # 10 0606 0002 04 23D4 0000, by the reading of 80 ms ago
        to(0),
        ACK,  # 03 0520 0002 -> E425 FFFF: where the backward branch puts -7003
        ACK,  # 10 0606 0002 04 E502 FFFF: forward to -6910, 221 counts away, and not flagged
    )


def test_a_target_given_again_after_its_axis_moved_on_is_flagged_where_nothing_tells_its_branch() -> None:
    """M6: it gets the words of the first time, and its axis has moved on since."""
    play(
        BY_NAME["deaf"],
        to(1),  # 10 0606 0002 04 233B 0000: 9019
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 23E0 0000: forward to 9184; it is on its way at 1501
        to(0),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 03 0520 0002 -> 05DD 0000
        REFUSE,  # 10 0606 0002 04 23D4 0000, forward, -> 90 04: the axis goes on to 9184
        ARRIVE,
        to(0),
        REFUSE,  # 03 0520 0002 -> 83 04
        ACK,  # 10 0606 0002 04 23D4 0000: from 9184 to 9172 is backward, and it is not flagged
    )


def test_a_target_that_is_repeated_while_its_axis_is_on_its_way_keeps_its_branch() -> None:
    """M4: an axis that is slow to begin was not moved by somebody else."""
    play(
        replace(BY_NAME["short"], is_prompt=False),
        to(1),  # 10 0606 0002 04 2330 0000: 9008
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 23D5 0000: forward to 9173
        ARRIVE,
        ("ask", 0, "read", 0),
        ACK,  # 03 0520 0002 -> 23D5 0000
        ("ask", 0, "status", 0),
        ACK,  # 03 005C 0001 -> 0110: it has arrived
        to(0),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 10 0606 0002 04 22E8 0000: backward to 8936; 80 ms pass
        ("wait",),
        ("wait",),  # unseen_ms is 160
        to(0),
        ACK,  # 03 0520 0002 -> 23D5 0000: it has not moved yet
        ACK,  # 10 0606 0002 04 23D4 0000: forward to 9172, and not flagged
    )


def test_a_reading_that_fades_from_an_assumed_start_decides_no_branch_in_the_window_of_its_target() -> None:
    """M6: 9008 was obeyed and not acknowledged, 9007 lies a count beside it: the axis stands where it stood.

    Its reading fades from 1:1, 9173, to 9007 within that count. Forward 9008 is 9173.12, backward 8937.09.
    """
    stands = (
        ("jog", 0),
        READ,
        ACK,  # 03 0520 0002 -> 0BB9 0000: 3001
        to(1),  # 10 0606 0002 04 2330 0000: 9008
        OBEY,  # 10 0606 0002 04 23D5 0000: forward to 9173, not acknowledged
        WAIT,
        WAIT,
        to(0),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 03 0520 0002 -> 2364 0000: 9060, between the branches
        ARRIVE,  # 10 0606 0002 04 235E 0000: half-way to 9054, flagged, lost; it stands at 9173
        WAIT,
        WAIT,
        to(0),
        ACK,  # 03 0520 0002 -> 23D5 0000
        ACK,  # 10 0606 0002 04 23D4 0000: it has come there forward
    )
    world = play(BY_NAME["read-back"], *stands, to(1), ACK)  # 03 0520 0002 -> 23D5 0000
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 23D5 0000")  # not 22E9, as it was sent
    assert world.is_sending_unsure()


def test_a_gateway_that_was_killed_does_not_take_the_start_of_the_last_way_for_known() -> None:
    """M6: its record keeps the fade of the reading, and not that it fades from a start that was assumed.

    9007 is 9172.10 forward and 8936.08 backward, half-way 9054.09; 9019 half-way 9066.24.
    """
    stands = (
        READ,
        ACK,  # 03 0520 0002 -> 0000 0000
        to(0),  # 10 0606 0002 04 232F 0000: 9007
        OBEY,  # 10 0606 0002 04 23D4 0000: forward to 9172, not acknowledged
        ARRIVE,
        KILL,
        to(1),  # 10 0606 0002 04 233B 0000: 9019
        ACK,  # 03 0520 0002 -> 23D4 0000
        ACK,  # 10 0606 0002 04 236A 0000: half-way to 9066, flagged
        KILL,
        ACK,  # 03 0520 0002 -> 23D4 0000: it has not begun to move
    )
    world = play(BY_NAME["killed-near"], *stands, to(0))
    if on_the_wire(world)[0] == 3:
        world.happen(ACK)
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 235E 0000")  # not 22E8, as it was sent
    assert world.is_sending_unsure()


def test_a_gateway_that_was_killed_takes_no_target_for_reached_where_the_way_before_begins_there() -> None:
    """M6: 9007 was given again and not answered before the axis had begun to go from there to 9019.

    9007 is 9172.10 forward and 8936.08 backward, 9019 forward 9184.29.
    """
    under_way = (
        to(0),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 23D4 0000: forward to 9172
        ARRIVE,
        to(1),  # 10 0606 0002 04 233B 0000: 9019
        ACK,  # 03 0520 0002 -> 23D4 0000
        ACK,  # 10 0606 0002 04 23E0 0000: forward to 9184
        to(0),
        ACK,  # 03 0520 0002 -> 23D4 0000: it has not begun to move
        KILL,  # 10 0606 0002 04 23D4 0000 never came
        ACK,  # 03 0520 0002 -> 23D4 0000
        ARRIVE,  # at 9184
    )
    world = play(BY_NAME["killed-near"], *under_way, to(0))
    assert on_the_wire(world) == bytes.fromhex("03 0520 0002")  # not 10 ... 23D4: that would be forward
    world.happen(ACK)  # 03 0520 0002 -> 23E0 0000
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 22E8 0000")


def test_a_record_leaves_open_which_of_two_targets_sent_an_axis_to_one_on_the_way_to_the_other() -> None:
    """M6, 5: the axis may have gone back, or not have begun yet. It was taken to be on its way forward, and
    read 35 where target 203 had sent it. It reads 203, flagged, until it was seen there twice.

    9007 is 9172 forward; 203 is 34.92 backward.
    """
    lost = (
        to(2),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 23D4 0000: the way is 0 to 9172
        to(0),  # 10 0606 0002 04 00CB 0000: 203
        ACK,  # 03 0520 0002 -> 05DD 0000: seen at 1501
        OBEY,  # 10 0606 0002 04 0023 0000: back to 35, not acknowledged
        KILL,
        ACK,  # 03 0520 0002 -> 05DD 0000
        ARRIVE,
        KILL,
        ACK,  # 03 0520 0002 -> 0023 0000
    )
    world = play(BY_NAME["s-killed-onward"], *lost)
    assert [event.kind.name for event in world.told] == ["restored", "direction-unsure"]
    axis = world.sides[0].line.axes[0]
    assert round(axis.motion.nominal_of(35)) == 203


def test_a_record_counts_at_the_second_kill_as_at_the_first() -> None:
    """5: a setpoint is lost, the axis stands at the one before. The start took it up from its record, and
    kept none: after the next one nobody knew its branch."""
    lost = (
        to(0),  # 10 0606 0002 04 03EB 0000: 1003
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,
        to(2),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 10 0606 0002 04 235E 0000: 9054, half of its blend has gone
        to(0),  # 10 0606 0002 04 034C 0000: never acknowledged
        ARRIVE,  # at 9054
    )
    again = (KILL, ACK)  # 03 0520 0002 -> 235E 0000
    for kills in (again, again * 2, again * 3):
        world = play(BY_NAME["s-killed-stream"], *lost, *kills)
        assert [event.kind.name for event in world.told] == ["restored"]
        assert world.said(0).direction == "forward"


STATUS = ("ask", 0, "status", 0)
REBOOT = ("reboot", 0)
HOMED = ("homed", 0)


def test_a_target_written_anew_that_nobody_acknowledged_does_not_run_without_a_reference() -> None:
    """M2, M9: without a reference runs what the controller wrote; -7003 is -7131 backward."""
    lost = (
        REBOOT,
        ("ask", 0, "home", 0),
        ACK,  # 06 050E 0064
        to(0),  # 10 0606 0002 04 E4A5 FFFF: -7003
        HOMED,
        ACK,  # 03 005C 0001 -> 0110: homed
        ACK,  # it goes out as it came: the bit may be that of the homing before
        WAIT,
        WAIT,
        RUN,
        ACK,  # 03 005C 0001 -> 0110
        ACK,  # 03 0520 0002 -> 0000 0000
        OBEY,  # 10 0606 0002 04 E425 FFFF: -7131, never acknowledged
        REBOOT,
        RUN,  # 06 050E 0001
        ACK,  # 03 005C 0001 -> 0010: not homed
    )
    world = play(BY_NAME["homed"], *lost)
    assert world.state.wire is None
    # Written again, it may run.
    world = play(BY_NAME["homed"], *lost, to(0), ACK, ACK, RUN, ACK)
    assert on_the_wire(world) == bytes.fromhex("06 050E 0001")


def _run_again_over_a_homing() -> World:
    """A staged 9007 runs, forward to 9172; the drive is switched off and homed, and 9007 runs once more."""
    again = (
        to(0),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 03 005C 0001 -> 0110: homed
        ACK,  # 10 0606 0002 04 235E 0000: half-way, for it is only staged
        RUN,
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 23D4 0000: forward to 9172
        ACK,  # 06 050E 0001
        REBOOT,
        to(0),
        ACK,  # 03 005C 0001 -> 0010: not homed
        ACK,  # 10 0606 0002 04 232F 0000: as it came
        RUN,
        HOMED,
        ACK,  # 03 005C 0001 -> 0110: homed meanwhile
        ACK,  # 03 0520 0002: where does it stand?
    )
    world = play(BY_NAME["p-home-read"], *again)
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 23D4 0000")
    for happening in (ACK, ACK):
        world.happen(happening)
    return world


def test_the_repeat_of_a_target_of_before_is_a_new_one_where_the_axis_stands_elsewhere() -> None:
    """M6, M9: it stands at 0, from where 9007 is forward."""
    assert _run_again_over_a_homing().said(0).direction == "forward"


def test_an_axis_whose_done_bit_fell_and_rose_is_looked_at_before_any_target() -> None:
    """M4, M6: it stands, and nobody knows where. 9007 is 9172 forward; 5003 is 5108, or 4888 backward."""
    crept = (
        to(0),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 23D4 0000
        ARRIVE,
        STATUS,
        ACK,  # 03 005C 0001 -> 0110: done
        ("blink", 0),
        STATUS,
        ACK,  # 03 005C 0001 -> 0100: not done
        READ,
        ACK,  # 03 0520 0002 -> 23D4 0000: it is there yet
        ("creep", 0),  # 80 ms later it stands at 3001
    )
    design = BY_NAME["s-crept-past"]
    for again in (to(0), to(1)):
        for seen in ((), (STATUS, ACK)):  # 03 005C 0001 -> 0110: done
            world = play(design, *crept, *seen, again)
            assert on_the_wire(world) == bytes.fromhex("03 0520 0002")
    world = play(design, *crept, STATUS, ACK, to(1), ACK)  # 03 0520 0002 -> 0BB9 0000
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 13F4 0000")  # forward, not 1318


def test_an_axis_that_is_read_off_its_way_after_a_while_has_been_moved() -> None:
    """M4, M6: a repeat keeps no branch on which its axis cannot come. 2003 is 2063 or 1855 (backward)."""
    jogged = (
        to(0),  # 10 0606 0002 04 07D3 0000: 2003
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 080F 0000
        ARRIVE,
        ("jog", 0),  # 240 ms later it stands at 3001
        READ,
        ACK,  # 03 0520 0002 -> 0BB9 0000
        to(0),
    )
    world = play(BY_NAME["s-jogged-past"], *jogged)
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 073F 0000")


def test_the_first_setpoint_of_a_stream_given_again_on_its_way_there_is_the_same_words() -> None:
    """M4: its drive may hold it; 9007 less than both branches say at 0 is 8838, and 8854 at 1501."""
    again = (
        to(1),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 03 0520 0002 -> 0000 0000
        OBEY,  # 10 0606 0002 04 2286 0000: 8838, never acknowledged
        WAIT,
        WAIT,
        READ,
        ACK,  # 03 0520 0002 -> 05DD 0000
        to(1),
    )
    world = play(BY_NAME["stream"], *again)
    if on_the_wire(world)[0] == 3:
        world.happen(ACK)
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 2286 0000")


def test_a_reading_in_coarser_steps_than_the_target_is_the_nearest_one_of_an_axis_that_stands_there() -> None:
    """8932 is 9095.98 forward, sent as 9096, which a register in steps of 10 counts tells as 910; 893 is
    nearest to 8932."""
    stands = (
        to(1),  # 10 0606 0002 04 22E4 0000: 8932
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 2388 0000: forward to 9096
        ARRIVE,
        READ,
        ACK,  # 03 0520 0002 -> 038E 0000: 910
    )
    *_, last = replay(BY_NAME["s-coarse"], stands)
    assert last.split() == ["answered", "1", "03", "04", "03", "7d", "00", "00"]  # not 037E, 894


LOW = ("ask", 0, "low", 0, 0)
HIGH = ("ask", 0, "high", 0, 0)
SWITCH = ("switch",)


def test_a_mask_is_not_laid_over_a_corrected_word_of_an_axis_that_has_no_reference() -> None:
    """M1, M9: 9007 was corrected to 9172, 23D4; a mask that sets its high byte to 24 makes 242F, 9263."""
    homed_anew = (
        ("ask", 0, "home", 0),
        ACK,  # 06 050E 0064
        HOMED,
        WAIT,
        WAIT,
        to(0),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 03 005C 0001 -> 0110: homed
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 23D4 0000: forward to 9172
        ("ask", 0, "home", 0),
        ACK,  # 06 050E 0064
        ("ask", 0, "mask", 0, 0),  # 16 0606 00FF 2400
        ACK,  # 03 005C 0001 -> 0000: not homed yet
    )
    world = play(BY_NAME["s-mask-homing"], *homed_anew)
    # As it came it made 24D4 of 23D4: 9428.
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 242F 0000")
    *_, last = replay(BY_NAME["s-mask-homing"], (*homed_anew, ACK))
    assert last.split()[2:] == ["16", "06", "06", "00", "ff", "24", "00"]  # its own echo


def test_a_word_that_is_joined_with_a_lost_one_goes_out_whole_though_compensation_was_switched_off() -> None:
    """M1: the drive never got the low word."""
    joined = (
        LOW,  # 06 0606 232F
        ACK,  # 03 0606 0002 -> 0000 0000: the high word is not certain, so it is answered 86 04
        HIGH,  # 06 0607 0000: with the word before it is 9007
        SWITCH,
        ACK,  # 03 0520 0002 -> 0000 0000
    )
    world = play(BY_NAME["s-words-replaced"], *joined)
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 232F 0000")  # not 06 0607 0000: that is 0


def test_a_lost_word_is_joined_with_none_once_a_newer_one_went_out_as_it_came() -> None:
    """M1, M9: 0019 has replaced 232F in the drive, and was acknowledged."""
    replaced = (
        LOW,  # 06 0606 232F
        ACK,  # 03 0606 0002 -> 0000 0000: answered 86 04
        SWITCH,
        ("ask", 0, "low", 0, 1),
        ACK,  # 06 0606 0019
        HIGH,
    )
    world = play(BY_NAME["s-words-replaced"], *replaced)
    assert on_the_wire(world) == bytes.fromhex("06 0607 0000")  # not 10 ... 232F 0000


def test_an_axis_that_was_nudged_from_where_it_had_arrived_goes_on_from_where_it_was_seen() -> None:
    """M6: 0.3 mm further than 9172 it comes to 9107 backward: 9274 forward, 9037 backward."""
    nudged = (
        to(0),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 23D4 0000: forward to 9172
        ARRIVE,
        READ,
        ACK,  # 03 0520 0002 -> 23D4 0000
        STATUS,
        ACK,  # 03 005C 0001 -> 0110: done
        ("nudge", 0),  # to 9472
        READ,
        ACK,  # 03 0520 0002 -> 2500 0000
        to(1),  # 10 0606 0002 04 2393 0000: 9107
    )
    world = play(BY_NAME["s-nudged"], *nudged)
    if on_the_wire(world)[0] == 3:
        world.happen(ACK)
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 234D 0000")  # 9037


def test_the_words_of_a_distance_are_no_place_when_the_same_words_come_as_an_absolute_target() -> None:
    """M4, M5: the mode of a drive that goes at once falls back after each move.

    At 5000 forward 0.03 + 0.3 * 5/20 = 0.105 mm, so 5105; the distance of 3000 ends at 8000, which is 8150
    there, 3045 on; 3000 as a place comes backward, -0.17 + 0.22 * 3/20 = -0.137 mm, so 2863.
    """
    modes = (ModePlan(MODE, actions={1: Action.ABSOLUTE, 2: Action.RELATIVE_TO_COMMANDED}, resets_to=1),)
    plan = axis_plan(table=WORN.table(), motion=MotionPlan(modes=modes), commanded=(COMMANDED,))
    bench = Bench(plan)
    bench.memory.write(MODE, b"\0\x01")
    assert bench.move(5000) == write(COMMAND, 5105)
    bench.memory.put(COMMANDED, 5105)
    bench.ask(b"\x06" + MODE.to_bytes(2, "big") + b"\0\x02")
    assert bench.ask(write(COMMAND, 3000)) == write(COMMAND, 3000)[:5]
    assert bench.seen[-1] == write(COMMAND, 3045)
    bench.memory.write(MODE, b"\0\x01")
    for place in (ACTUAL, COMMANDED):
        bench.memory.put(place, 8150)
    bench.wait(MOVE_MS)
    bench.ask(write(COMMAND, 3000))
    assert bench.seen[-1] == write(COMMAND, 2863)


def test_a_target_that_could_not_be_written_anew_reads_back_as_it_was_written() -> None:
    """M1: 5000 is staged forward, 5010. Jogged to 9000 it is backward, 4990: the drive refuses that. Its
    register holds 5010, or 4990 should the refusal lie; both are the 5000 that the controller wrote."""
    bench = StagedBench(staged_plan(), serial=False)
    bench.go_to(0)
    bench.stage(5000)
    assert bench.memory.get(COMMAND) == 5010
    bench.ask(JOG_PDU)
    for place in (ACTUAL, COMMANDED):
        bench.memory.put(place, 9000)
    bench.drive.set_bits(is_done=True)
    bench.wait(1200)
    bench.send(RUN_PDU)
    while bench.link.sent:
        unit_id, pdu = bench.link.sent.pop(0)
        reply = bytes.fromhex("90 04") if pdu[0] == 16 else bench.memory.answer(pdu)
        bench.line.reply(unit_id, reply, bench.now_ns)
    assert pdu == write(COMMAND, 4990)
    assert bench.port.take() == bytes.fromhex("86 04")
    for held in (5010, 4990):
        bench.memory.put(COMMAND, held)
        assert bench.ask(read(COMMAND)) == b"\x03\x04" + COMMAND.pack(5000)


def test_an_axis_that_was_told_to_stay_and_is_seen_elsewhere_later_has_been_moved() -> None:
    """M4, M6: it stands at 1000 (1010), is stopped and sent there once more. Somebody jogs it to 3000. Seen
    there after a while, it is sent to 1000 once more: that is backward, 990, and certain."""
    bench = StagedBench(staged_plan(), serial=False)
    bench.go_to(1000)
    bench.ask(STOP_PDU)
    bench.trigger()
    for place in (ACTUAL, COMMANDED):
        bench.memory.put(place, 3000)
    bench.drive.set_bits(is_done=True)
    bench.wait(1200)
    bench.ask(read(ACTUAL))
    bench.trigger()
    assert bench.drive.moves == [("absolute", 1010), ("stop", 1010), ("absolute", 1010), ("absolute", 990)]
    assert direction_state(bench.line.axes[0]) == "backward"


def test_an_axis_that_was_stopped_on_a_way_whose_branch_was_assumed_stays_flagged() -> None:
    """M6: it stands at 1000 (1010), and has not begun to go to -3000 (-3010) when 1000 comes: 990, flagged.
    Stopped before it goes, it reads 1020, so 1000 is backward still; but that branch was assumed, and 990 was
    said to be certain."""
    bench = StagedBench(staged_plan(), serial=False)
    bench.go_to(1000)
    for target in (-3000, 1000):
        bench.stage(target)
        bench.trigger()
    assert direction_state(bench.line.axes[0]) == "unsure"
    bench.ask(STOP_PDU)
    bench.trigger()
    moves = [("absolute", 1010), ("absolute", -3010), ("absolute", 990), ("stop", 1010), ("absolute", 990)]
    assert bench.drive.moves == moves
    assert direction_state(bench.line.axes[0]) == "unsure"


def test_a_distance_from_a_way_whose_branch_was_assumed_is_flagged() -> None:
    """M5, M6: stopped as above, nobody knows whether 1010 is 1000 forward or 1020 backward."""
    bench = StagedBench(staged_plan(), serial=False)
    bench.go_to(1000)
    for target in (-3000, 1000):
        bench.stage(target)
        bench.trigger()
    bench.ask(STOP_PDU)
    bench.wait(1200)
    bench.stage(500)
    bench.trigger(RUN_RELATIVE_PDU)
    assert direction_state(bench.line.axes[0]) == "unsure"


@pytest.mark.parametrize(
    ("meanwhile", "bits", "words"),
    [((), (ACK,), "23D4 0000"), ((REBOOT,), (ACK, ACK), "232F 0000")],
)
def test_a_repeat_that_was_lost_with_the_link_is_kept_where_the_axis_stands_there(
    meanwhile: tuple[Happening, ...], bits: tuple[Happening, ...], words: str
) -> None:
    """M4, M9: 9007 (9172) is repeated, and the link goes before the answer. What stands at 9172 then gets the
    same words. A drive that was switched off counts from another zero: it stands at 0, and without a
    reference goes to 9007."""
    told = (
        READ,
        ACK,  # 03 005C 0001 -> 0110: homed
        ACK,  # 03 0520 0002 -> 0000 0000
        to(1),
        ACK,  # 10 0606 0002 04 23D4 0000: 9007 forward
        ARRIVE,
        to(1),  # 10 0606 0002 04 23D4 0000: the same words, never answered
        ("unplug",),
        *meanwhile,
        ("plug",),
        to(1),
        WAIT,
        *bits,  # 03 005C 0001: homed; not homed, which is asked again for the target
        ACK,  # 03 0520 0002: where does it stand?
    )
    world = play(BY_NAME["s-link-homed"], *told)
    assert on_the_wire(world) == bytes.fromhex(f"10 0606 0002 04 {words}")


def test_an_axis_that_was_moved_away_before_a_dry_run_ended_does_not_run_its_old_words() -> None:
    """M4, M9: staged 9007 stands 1:1 at 9007, where it was seen, and nobody goes to the 9054 that it would
    be. Somebody jogs it to 3001; the dry run ends, and the next reading says so: no repeat any more."""
    told = (
        to(0),
        ACK,  # 10 0606 0002 04 232F 0000: 9007
        RUN,
        ACK,  # 06 050E 0001
        ARRIVE,
        READ,
        ACK,  # 03 0520 0002 -> 232F 0000
        ("jog", 0),
        READ,
        ("end_dry_run",),
        ACK,  # 03 0520 0002 -> 0BB9 0000: 3001
        RUN,
    )
    world = play(BY_NAME["s-dry-run-staged"], *told)
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 23D4 0000")  # 9172, forward
    assert not world.is_sending_unsure()


def test_a_target_that_went_without_a_reference_is_a_new_one_where_its_drive_was_homed_elsewhere() -> None:
    """M4, M6, M9: -7003 went as it came. The drive is switched off and homed while the link is down, and
    stands at 0: from there it is -7131, backward."""
    told = (
        ("unplug",),
        ("plug",),
        REBOOT,
        to(0),
        ACK,  # 03 005C 0001 -> 0010: not homed
        ACK,  # 10 0606 0002 04 E4A5 FFFF: -7003
        HOMED,
        ("unplug",),
        REBOOT,
        ("plug",),
        ("unplug",),
        HOMED,
        ("plug",),
        READ,
        WAIT,
        ACK,  # 03 005C 0001 -> 0110: homed
        ACK,  # 03 0520 0002 -> 0000 0000
        to(0),
    )
    world = play(BY_NAME["s-link-homed"], *told)
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 E425 FFFF")
    world.happen(ACK)
    assert world.said(0).direction == "backward"


def test_one_look_tells_whether_a_target_keeps_its_words_over_a_new_reference() -> None:
    """W8, M9: -7003 went as it came, and the drive was homed meanwhile: given again it is the same words, for
    the axis stands there."""
    told = (
        ("unplug",),
        REBOOT,
        ("plug",),
        HOMED,
        REBOOT,
        to(0),
        ACK,  # 03 005C 0001 -> 0010: not homed
        HOMED,
        ACK,  # 10 0606 0002 04 E4A5 FFFF: -7003
        ARRIVE,
        to(0),
        ACK,  # 03 005C 0001 -> 0110: homed
        ACK,  # 03 0520 0002 -> E4A5 FFFF
    )
    world = play(BY_NAME["s-link-homed"], *told)
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 E4A5 FFFF")


def test_a_repeat_over_a_new_reference_is_a_new_target_where_its_drive_was_switched_off() -> None:
    """M4, M9: 9007 (9172) goes out over a new reference, its answer is lost with the link. Its drive was
    switched off again and counts from another zero, at which it stands: 9007, without a reference."""
    told = (
        to(1),
        ACK,  # 03 005C 0001 -> 0110: homed
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 23D4 0000: 9007 forward
        to(0),
        ("unplug",),  # 03 0520 0002, never answered
        REBOOT,
        ("plug",),
        to(1),
        WAIT,
        ACK,  # 03 005C 0001 -> 0010: not homed
        HOMED,
        ACK,  # 03 005C 0001 -> 0110: homed
        ACK,  # 03 0520 0002: where does it stand?
        ("unplug",),  # 10 0606 0002 04 23D4 0000, never answered
        ("plug",),
        REBOOT,
        to(1),
        ACK,  # 03 005C 0001 -> 0010: not homed
    )
    world = play(BY_NAME["s-link-homed"], *told)
    assert on_the_wire(world) == bytes.fromhex("10 0606 0002 04 232F 0000")
