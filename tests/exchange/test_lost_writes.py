"""Writes that were lost, or nobody knows whether they were: nothing is put together from their remains."""

import pytest

from gateway.exchange.plan import ControllerPlan, LineTiming
from gateway.modbus.registers import PositionField, RegisterType
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, Port, axis_plan, read, write

HIGH_1 = bytes.fromhex("06 0607 0001")
LOW_4 = bytes.fromhex("06 0606 0004")
REFUSED = bytes.fromhex("86 04")


def standing_at(counts: int, **plan: object) -> Bench:
    bench = Bench(axis_plan(**plan))
    bench.move(counts)
    return bench


def test_a_half_beyond_travel_joins_nothing_and_the_pair_goes_out_when_it_is_written_again() -> None:
    # From 65 530 to 65 540 = 0x0001_0004: the high half alone makes 131 066, outside the travel.
    bench = standing_at(65_530, travel=(0.0, 100.0))
    told = bench.memory.get(COMMAND)
    assert [bench.ask(half) for half in (HIGH_1, LOW_4)] == [REFUSED, REFUSED]
    assert bench.memory.get(COMMAND) == told
    assert bench.ask(HIGH_1) == HIGH_1  # with the low half right before it
    assert bench.memory.get(COMMAND) == 65_550
    assert bench.ask(LOW_4) == LOW_4


def test_an_axis_crosses_zero_in_halves_with_the_second_pair_where_the_way_there_leaves_its_travel() -> None:
    bench = standing_at(5_000, travel=(-10.0, 10.0))
    # -5 000 = 0xFFFF_EC78: its low half makes 60 536 of 5 000, the high one alone would make 0xFFFF_1388
    low, high = bytes.fromhex("06 0606 EC78"), bytes.fromhex("06 0607 FFFF")
    assert [bench.ask(half) for half in (low, high)] == [REFUSED, REFUSED]
    bench.wait(1000)
    assert [bench.ask(half) for half in (low, high)] == [REFUSED, high]
    assert bench.memory.get(COMMAND) == -5_010


@pytest.mark.parametrize("between", [read(ACTUAL), bytes.fromhex("03 0700 0001")])
def test_halves_that_the_gateway_refused_are_not_joined_over_another_request(between: bytes) -> None:
    bench = standing_at(5_000, travel=(-10.0, 10.0))
    low, high = bytes.fromhex("06 0606 EC78"), bytes.fromhex("06 0607 FFFF")
    assert [bench.ask(half) for half in (low, high)] == [REFUSED, REFUSED]
    bench.wait(1000)
    assert bench.ask(low) == REFUSED
    bench.ask(between)
    assert bench.ask(high) == REFUSED
    assert bench.ask(low) == low
    assert bench.memory.get(COMMAND) == -5_010


def test_halves_that_the_gateway_refused_are_not_joined_over_two_connections() -> None:
    bench = Bench(axis_plan(travel=(-10.0, 10.0), has_one_writer=False), serial=False)
    bench.move(5_000)
    low, high = bytes.fromhex("06 0606 EC78"), bytes.fromhex("06 0607 FFFF")
    assert [bench.ask(half) for half in (low, high, low)] == [REFUSED, REFUSED, low]
    bench.move(5_000)
    told = bench.memory.get(COMMAND)
    assert bench.ask(low) == REFUSED
    other = Port(ControllerPlan("hmi"))
    assert bench.ask(high, other) == REFUSED
    assert bench.ask(low) == REFUSED  # the other half that it would join came from somebody else
    assert bench.memory.get(COMMAND) == told


def test_halves_of_different_commands_are_never_joined() -> None:
    bench = standing_at(65_530, travel=(0.0, 100.0))
    told = bench.memory.get(COMMAND)
    assert bench.ask(HIGH_1) == REFUSED
    bench.wait(300)
    assert bench.ask(LOW_4) == REFUSED
    bench.wait(300)
    assert bench.ask(LOW_4) == REFUSED
    assert bench.memory.get(COMMAND) == told
    assert "write all of it again" in bench.events[-1].detail


def test_a_refused_pair_leaves_nothing_behind_to_join_the_next_half_with() -> None:
    bench = standing_at(5_000, travel=(-300.0, 10.0))
    low, high = bytes.fromhex("06 0606 1770"), bytes.fromhex("06 0607 0000")
    for part in ("06 0606 EC78", "06 0607 7FFF"):  # 0x7FFF_EC78 is far outside
        assert bench.ask(bytes.fromhex(part)) == REFUSED
    assert bench.ask(low) == REFUSED  # with the high half right before it: 0x7FFF_1770
    assert [bench.ask(half) for half in (high, low)] == [REFUSED, low]
    assert bench.memory.get(COMMAND) == 6_010


def test_a_withdrawn_half_is_joined_with_the_one_that_withdrew_it_and_not_with_what_stood_there() -> None:
    bench = standing_at(65_530)
    hmi = Port(ControllerPlan("hmi"))
    bench.send(bytes.fromhex("03 0700 0001"), hmi)
    bench.send(HIGH_1)  # waits behind the other controller's read
    bench.send(LOW_4)  # the serial controller has gone on
    bench.serve()
    assert bench.port.take() == LOW_4
    assert bench.memory.get(COMMAND) == 65_550


def test_a_half_is_not_joined_with_one_that_was_lost_before_a_newer_whole_one() -> None:
    """The part waits for a read, the whole one behind it; both are withdrawn, the newer one first."""
    bench = Bench(axis_plan(), timing=LineTiming(response_timeout_ms=50), serial=False, tcp_drive=True)
    bench.send(HIGH_1)
    assert bench.link.sent[-1][1][0] == 3  # for the other part
    bench.send(write(COMMAND, 50_000))
    bench.line.controller_gone(bench.port, bench.now_ns)
    bench.link.sent.clear()
    bench.wait(60)
    port = Port(ControllerPlan("cnc"))
    bench.send(LOW_4, port)
    bench.serve()
    assert (bench.seen, port.take()) == ([], REFUSED)


def test_a_half_that_a_full_queue_refused_is_lost_until_the_other_follows() -> None:
    bench = Bench(axis_plan(), serial=False)
    bench.move(65_530)
    for number in range(951):  # one is on the wire, 949 have room
        bench.send(bytes.fromhex("03 0700 0001"), transaction_id=number)
    bench.send(HIGH_1, transaction_id=2000)
    bench.serve()
    bench.port.replies.clear()
    bench.wait(300)
    assert bench.ask(LOW_4) == REFUSED


def test_a_half_that_the_drive_did_not_answer_is_lost_until_the_other_follows() -> None:
    bench = Bench(axis_plan(), serial=False, tcp_drive=True)
    bench.move(65_530)
    bench.unanswered(HIGH_1, 1000)
    bench.wait(300)
    assert bench.ask(LOW_4) == REFUSED
    assert bench.ask(HIGH_1) == HIGH_1
    assert bench.memory.get(COMMAND) == 65_550


@pytest.mark.parametrize("stands_at", [0, 1, -1, 300, 65_536, 131_072])
def test_the_first_pair_after_a_start_arrives_wherever_the_drive_stands(stands_at: int) -> None:
    bench = Bench(axis_plan())
    bench.memory.put(COMMAND, stands_at)
    bench.memory.put(ACTUAL, stands_at)
    bench.ask(bytes.fromhex("06 0606 EA60"))  # 60 000 = 0x0000_EA60
    assert bench.ask(bytes.fromhex("06 0607 0000")) == bytes.fromhex("06 0607 0000")
    assert bench.memory.get(COMMAND) in (60_010, 59_990)
    assert COMMAND.unpack(bench.ask(read(COMMAND))[2:]) == 60_000


def test_a_whole_write_mends_a_torn_position() -> None:
    bench = standing_at(65_530, travel=(0.0, 100.0))
    bench.ask(HIGH_1)
    bench.move(70_000)
    assert bench.ask(LOW_4) == LOW_4  # 70 000 is 0x0001_1170, so this is 65 540, backward
    assert bench.memory.get(COMMAND) == 65_530


def lost_acknowledgement() -> Bench:
    """An axis that was sent from 50 000 back to 20 000, got there, and whose reply was lost."""
    bench = Bench(axis_plan(), serial=False, tcp_drive=True)
    bench.move(50_000)
    bench.send(write(COMMAND, 20_000))
    bench.serve_reads()
    bench.memory.answer(bench.link.take())
    bench.wait(1000)
    bench.port.take()
    bench.memory.put(ACTUAL, 19_990)
    bench.wait(1000)
    return bench


def test_the_same_target_after_a_lost_acknowledgement_is_the_same_words() -> None:
    bench = lost_acknowledgement()
    assert bench.sent_for(write(COMMAND, 20_000)) == write(COMMAND, 19_990)
    assert bench.actual() == 20_000


def test_the_same_target_after_a_lost_acknowledgement_is_the_same_words_beside_a_standing_error() -> None:
    bench = lost_acknowledgement()
    bench.memory.put(ACTUAL, 19_993)  # 3 counts beside where it was sent, with 2 of hysteresis
    assert bench.sent_for(write(COMMAND, 20_000)) == write(COMMAND, 19_990)


def test_the_same_target_from_somewhere_else_takes_the_branch_of_its_own_move() -> None:
    bench = lost_acknowledgement()
    bench.memory.put(ACTUAL, 0)  # it was jogged away meanwhile
    assert bench.sent_for(write(COMMAND, 20_000)) == write(COMMAND, 20_010)


def test_the_drives_own_command_register_proves_a_lost_acknowledgement() -> None:
    bench = lost_acknowledgement()
    assert COMMAND.unpack(bench.ask(read(COMMAND))[2:]) == 20_000
    assert bench.actual() == 20_000


@pytest.mark.parametrize("on_forward_branch", [True, False])
def test_after_a_restart_the_target_where_the_axis_stands_does_not_move_it(on_forward_branch: bool) -> None:
    bench = Bench(axis_plan())
    bench.memory.put(ACTUAL, 50_010 if on_forward_branch else 49_990)
    assert bench.command(50_000) == (50_010 if on_forward_branch else 49_990)


def test_the_first_direction_is_decided_on_the_drives_scale() -> None:
    # The axis stands at 50.31 mm of the drive, which is 50.00 mm nominal; 50.10 mm lies forward of it.
    from gateway.compensation.table import make_table
    from gateway.compensation.units import Units

    bench = Bench(axis_plan(table=make_table([0, 100], [0.31, 0.31], [0.29, 0.29], Units.MM)))
    bench.memory.put(ACTUAL, 50_310)
    assert bench.command(50_100) == 50_410


def test_a_request_that_grew_too_old_during_an_added_read_is_not_sent() -> None:
    bench = Bench(axis_plan(), serial=False)
    hasty = Port(ControllerPlan("plc", timeout_ms=100))
    bench.send(write(COMMAND, 50_000), hasty)
    assert bench.link.take() == read(ACTUAL)
    bench.wait(600)
    bench.line.reply(1, bench.memory.answer(read(ACTUAL)), bench.now_ns)
    assert bench.link.sent == []
    assert bench.kinds()[-1] == "withdrawn"


def test_the_same_target_through_another_register_keeps_its_correction() -> None:
    narrow = PositionField(0x0700, RegisterType.INT16)
    coarse = PositionField(0x0702, RegisterType.INT16, scale=100.0)
    bench = Bench(axis_plan(command=(COMMAND, narrow, coarse)))
    bench.move(32_765)
    assert bench.ask(write(narrow, 32_765)) == bytes.fromhex("90 04")  # 32 775 does not fit
    bench.move(32_000)
    assert bench.ask(write(coarse, 320)) == write(coarse, 320)[:5]
    bench.memory.put(ACTUAL, bench.memory.get(coarse) * 100)
    assert bench.actual() == 32_000


def test_a_cyclic_image_with_two_command_fields_never_flips() -> None:
    other = PositionField(0x0608, COMMAND.type, COMMAND.order)
    bench = Bench(axis_plan(command=(COMMAND, other)))
    image = bytes.fromhex("10 0606 0004 08 C350 0000 4E20 0000")  # 50 000 and 20 000
    bench.ask(image)
    first = bench.seen[-1]
    for actual in (10_000, 45_000, 15_000, 30_000):
        bench.memory.put(ACTUAL, actual)
        bench.ask(read(ACTUAL))
        bench.wait(30)
        assert bench.sent_for(image) == first


def test_a_jog_that_was_seen_is_no_place_to_repeat_from() -> None:
    bench = standing_at(50_000)
    bench.actual()
    bench.memory.put(ACTUAL, 80_000)  # somebody jogged the axis
    bench.actual()
    bench.wait(100)
    assert bench.command(50_000) == 49_990  # backward from 80 mm


def test_an_actual_position_that_is_no_number_tells_nothing() -> None:
    reported = PositionField(0x0520, RegisterType.FLOAT32)
    bench = Bench(axis_plan(actual=(reported,)))
    bench.memory.put(reported, 90_000.0)
    bench.ask(read(reported))
    bench.wait(3_600_000)
    bench.memory.write(reported.address, bytes.fromhex("7FC0 0000"))
    assert bench.command(50_000) == 50_000  # half way, flagged: the hour-old position is not used
    assert bench.kinds()[-1] == "direction-unsure"
