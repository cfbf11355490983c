"""Halves that an old connection left behind: those of a newer one never complete them (M1, M3)."""

from dataclasses import replace

import pytest

from gateway.drives.motion import Form
from gateway.exchange.axis.registers import Completeness, FieldImage, Loss
from gateway.exchange.plan import ControllerPlan
from gateway.modbus.registers import FieldAccess
from tests.exchange.line_bench import COMMAND, Bench, Port, axis_plan
from tests.exchange.staged_bench import ONLY_ABSOLUTE, StagedBench, staged_plan

HIGH_1 = bytes.fromhex("06 0607 0001")
LOW_4 = bytes.fromhex("06 0606 0004")
REFUSED = bytes.fromhex("86 04")
READ = bytes.fromhex("03 0700 0001")


@pytest.mark.parametrize("is_broken", [False, True])
def test_m1_a_half_that_was_refused_is_not_completed_over_a_newer_connection(*, is_broken: bool) -> None:
    # From 65 530 to 65 540 = 0x0001_0004: the high half alone makes 131 066, outside the travel.
    bench = Bench(axis_plan(travel=(0.0, 100.0)), serial=False)
    bench.move(65_530)
    told = bench.memory.get(COMMAND)
    assert bench.ask(HIGH_1) == REFUSED
    bench.line.controller_gone(bench.port, bench.now_ns, is_broken=is_broken)
    bench.port = Port(ControllerPlan("cnc"))
    assert bench.ask(LOW_4) == REFUSED  # before: 06 0606 0004, and the drive at 65 550
    assert bench.memory.get(COMMAND) == told
    assert bench.ask(HIGH_1) == HIGH_1  # both of its own, one right behind the other
    assert bench.memory.get(COMMAND) == 65_550


def test_m1_a_half_that_was_withdrawn_with_its_connection_is_not_completed_either() -> None:
    bench = Bench(axis_plan(), serial=False)
    bench.move(65_530)
    told = bench.memory.get(COMMAND)
    bench.send(READ, Port(ControllerPlan("hmi")))
    bench.send(HIGH_1)  # waits behind the other controller's read
    bench.line.controller_gone(bench.port, bench.now_ns)
    newer = Port(ControllerPlan("cnc"))
    assert bench.ask(LOW_4, newer) == REFUSED
    assert bench.memory.get(COMMAND) == told


@pytest.mark.parametrize("is_broken", [False, True])
def test_m1_a_half_on_the_wire_when_its_connection_broke_off_is_not_completed(*, is_broken: bool) -> None:
    bench = StagedBench(serial=False)
    image = bench.line.axes[0].fields[0]
    image.lose_all_words()  # nothing is known of its drive: halves go out as they came
    bench.send(HIGH_1)
    assert bench.link.sent[-1][1] == HIGH_1
    bench.line.controller_gone(bench.port, bench.now_ns, is_broken=is_broken)
    bench.serve()
    # A controller that has closed its connection may go on with the other half.
    expected = Completeness.ALL_LOST if is_broken else Completeness.PARTS_BUFFERED
    assert image.completeness is expected


@pytest.mark.parametrize("before", Completeness)
def test_a_connection_that_breaks_off_tears_what_was_acknowledged_in_part(before: Completeness) -> None:
    image = FieldImage(COMMAND)
    image.settle(bytes(4), bytes(4))
    match before:
        case Completeness.ALL_LOST:
            image.lose_all_words(5)
        case Completeness.PART_REFUSED:
            image.lose(Loss.REFUSED_UNWRITTEN, 0, b"\0\1", arrived_ns=5, follows_ns=0, now_ns=6)
        case Completeness.PARTS_LOST:
            image.lose(Loss.WITHDRAWN, 0, b"\0\1", arrived_ns=5, follows_ns=0, now_ns=6)
        case Completeness.PARTS_BUFFERED:
            image.buffer(0, b"\0\1", 5, 0)
    assert image.completeness is before
    image.forget_parts()
    after = Completeness.ALL_LOST if before is Completeness.PARTS_BUFFERED else before
    assert image.completeness is after
    completed = {
        Completeness.WHOLE: bytes.fromhex("0000 0004"),
        Completeness.PART_REFUSED: bytes.fromhex("0000 0004"),
    }
    # Of another connection, whose request before this one came at 0 or never.
    assert image.completed(1, b"\0\4", 10, 0) == completed.get(after)


def test_m1_half_of_a_field_that_reads_as_something_else_is_not_completed_from_there() -> None:
    target = replace(COMMAND, access=FieldAccess.WRITE)
    bench = Bench(axis_plan(command=(target,), actual=(replace(COMMAND, access=FieldAccess.READ),)))
    bench.memory.put(COMMAND, 0x0005_4020)
    assert bench.ask(bytes.fromhex("06 0606 9000")) == bytes.fromhex("86 04")
    assert bench.seen == []


def test_m1_halves_that_the_drive_acknowledged_may_come_slowly() -> None:
    bench = StagedBench(staged_plan(writes_with=Form.FC06, motion=ONLY_ABSOLUTE))
    for part in ("06 0606 FFFA", "06 0607 0000"):
        assert bench.ask(bytes.fromhex(part)) == bytes.fromhex(part)
        bench.wait(700)
    bench.trigger()
    assert bench.drive.moves == [("absolute", 65_540)]


def test_w4_a_recast_half_is_answered_in_its_own_form_whatever_the_drive_says() -> None:
    bench = Bench(axis_plan())
    bench.move(50_000)
    bench.send(bytes.fromhex("06 0606 1234"))
    bench.serve_reads()
    bench.answers(bytes.fromhex("10 0606 0000"))
    assert bench.port.take() == bytes.fromhex("86 04")
