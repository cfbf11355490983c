"""Unit ids that have no axis, on Modbus/TCP: none of them carries a target past the correction."""

from dataclasses import replace
from typing import Any

import pytest

from gateway.config.build import shipped_stops
from gateway.drives.motion import Action, MotionPlan, Operation, TriggerPlan
from gateway.exchange.plan import OtherUnits
from gateway.modbus.registers import PositionField, RegisterType
from gateway.status.line import UnitIds
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, axis_plan, read, write
from tests.exchange.staged_bench import RUN_PDU, STOP_PDU, StagedBench, staged_plan

STOPS = OtherUnits(stops=shipped_stops())
LIMIT = PositionField(0x0700, RegisterType.INT32)
OTHER = bytes.fromhex("06 2000 0001")


def bench_of(*plans: Any, other_units: OtherUnits = STOPS, **options: Any) -> Bench:
    return Bench(*(plans or (axis_plan(),)), serial=False, tcp_drive=True, other_units=other_units, **options)


def sent_to(bench: Bench, unit_id: int, pdu: bytes) -> list[tuple[int, bytes]]:
    """Send a request to a unit id; return what reached the drives. A refusal is told apart by its answer."""
    bench.line.request(bench.port, 1, unit_id, pdu, bench.now_ns)
    sent, bench.link.sent = bench.link.sent, []
    if sent:
        bench.line.reply(unit_id, bench.memory.answer(sent[0][1]), bench.now_ns)
    return sent


@pytest.mark.parametrize("unit_id", [2, 17, 254])
def test_a_target_to_another_unit_id_of_a_drive_that_may_not_look_at_it_is_refused(unit_id: int) -> None:
    bench = bench_of()
    assert sent_to(bench, unit_id, write(COMMAND, 70_000)) == []
    assert bench.port.take() == bytes((0x90, 0x0A))
    assert sent_to(bench, unit_id, bytes.fromhex("06 0607 0001")) == []  # a part of it
    assert bench.port.take() == bytes((0x86, 0x0A))
    assert bench.kinds().count("unknown-unit") == 1
    assert bench.line.unit_ids.requests == {str(unit_id): 2}


def test_a_limit_of_the_axis_is_refused_too() -> None:
    bench = bench_of(axis_plan(limits=(LIMIT,)))
    assert sent_to(bench, 17, write(LIMIT, 70_000)) == []
    assert bench.port.take() == bytes((0x90, 0x0A))


def test_what_touches_nothing_of_the_axis_passes_and_is_counted() -> None:
    bench = bench_of()
    for pdu in (OTHER, read(ACTUAL), OTHER):
        assert sent_to(bench, 17, pdu) == [(17, pdu)]
    assert bench.line.unit_ids == UnitIds(heard=[17], strangers=[17], requests={"17": 3})
    [event] = [event for event in bench.events if event.kind.name == "unknown-unit"]
    assert event.detail == "a controller addresses unit id 17, which has no axis; the axes are x (unit id 1)"


def test_a_device_that_is_named_gets_everything_and_is_not_counted() -> None:
    bench = bench_of(other_units=OtherUnits(frozenset({17})))
    assert sent_to(bench, 17, write(COMMAND, 70_000)) == [(17, write(COMMAND, 70_000))]
    assert bench.line.unit_ids == UnitIds(heard=[17], strangers=[], requests={})
    assert sent_to(bench, 18, write(COMMAND, 70_000)) == []


def test_behind_a_converter_of_several_axes_every_unit_id_passes() -> None:
    bench = bench_of(axis_plan(), axis_plan(name="y", unit_id=2))
    assert sent_to(bench, 17, write(COMMAND, 70_000)) == [(17, write(COMMAND, 70_000))]
    assert bench.line.unit_ids.requests == {"17": 1}


def test_on_a_wire_every_drive_knows_its_unit_id() -> None:
    bench = Bench(axis_plan(), serial=False)
    assert sent_to(bench, 17, write(COMMAND, 70_000)) == [(17, write(COMMAND, 70_000))]
    assert bench.line.unit_ids == UnitIds(heard=[17], strangers=[17], requests={})


def test_a_trigger_is_refused_and_the_stop_of_any_known_drive_passes() -> None:
    bench = StagedBench(serial=False, tcp_drive=True, other_units=STOPS)
    bench.link.sent.clear()
    assert sent_to(bench, 17, RUN_PDU) == []
    assert bench.port.take() == bytes((0x86, 0x0A))
    assert sent_to(bench, 17, STOP_PDU) == [(17, STOP_PDU)]  # of this drive itself: 0x3E8 to 0x050E
    bench.port.replies.clear()
    assert sent_to(bench, 17, bytes.fromhex("06 6002 0040")) == [(17, bytes.fromhex("06 6002 0040"))]


def test_a_stop_of_another_drive_that_is_a_start_of_this_one_is_refused() -> None:
    # Register 0x27 of an ESS-RS: 0x100 stops. Here it is the trigger of a drive that starts with it.
    trigger = TriggerPlan(0x27, deeds={0x100: Operation(Action.ABSOLUTE)})
    plan = replace(staged_plan(), motion=MotionPlan(is_staged=True, triggers=(trigger,)))
    bench = bench_of(plan)
    bench.link.sent.clear()
    assert sent_to(bench, 17, bytes.fromhex("06 0027 0100")) == []
    assert bench.port.take() == bytes((0x86, 0x0A))


def test_an_axis_that_is_not_corrected_is_written_under_any_unit_id() -> None:
    bench = bench_of(axis_plan(table=None))
    assert sent_to(bench, 17, write(COMMAND, 70_000)) == [(17, write(COMMAND, 70_000))]
