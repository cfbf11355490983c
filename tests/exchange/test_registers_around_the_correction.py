"""Registers that would carry a position around the correction (M10)."""

import pytest

from gateway.exchange.plan import CompensationMode
from gateway.exchange.status import compensation_state
from gateway.modbus.registers import PositionField, RegisterType
from tests.exchange.line_bench import ACTUAL, Bench, axis_plan, read, write

ALIAS = PositionField(0x602A, RegisterType.INT32)
REMAP = PositionField(0x0F10, RegisterType.UINT16)


def test_m10_a_write_to_a_position_that_is_not_mapped_is_refused_while_the_axis_is_corrected() -> None:
    bench = Bench(axis_plan(guarded=(ALIAS,)))
    assert bench.ask(write(ALIAS, 5_000)) == bytes.fromhex("90 02")
    assert bench.ask(bytes.fromhex("06 602B 0005")) == bytes.fromhex("86 02")
    assert bench.seen == []
    assert "0x602a" in bench.events[-1].detail


def test_reading_it_passes_as_it_is_and_is_counted() -> None:
    bench = Bench(axis_plan(guarded=(ALIAS,)))
    bench.move(50_000)
    bench.memory.put(ALIAS, 50_010)
    assert bench.ask(read(ALIAS)) == bytes.fromhex("03 04 0000 C35A")
    assert bench.ask(bytes.fromhex("03 602B 0001")) == bytes.fromhex("03 02 C35A")
    assert bench.line.counters.unmapped_reads == 2


@pytest.mark.parametrize(
    "plan", [{"passes_unmapped": True}, {"compensation": CompensationMode.SHADOW}, {"table": None}]
)
def test_it_passes_where_it_is_allowed_or_nothing_is_corrected(plan: dict[str, object]) -> None:
    bench = Bench(axis_plan(guarded=(ALIAS,), **plan))
    assert bench.ask(write(ALIAS, 5_000)) == write(ALIAS, 5_000)[:5]
    assert bench.seen == [write(ALIAS, 5_000)]


@pytest.mark.parametrize("answer", ["acknowledged", "refused", "silent"])
def test_m10_a_write_to_a_remapping_register_ends_the_compensation_of_its_unit(answer: str) -> None:
    bench = Bench(axis_plan(remapping=(REMAP,)), serial=False, tcp_drive=True)
    bench.move(50_000)
    bench.send(bytes.fromhex("06 0F10 0123"))
    sent = bench.link.take()
    assert sent == bytes.fromhex("06 0F10 0123")
    if answer == "silent":
        bench.wait(1000)
    else:
        bench.line.reply(1, sent if answer == "acknowledged" else bytes.fromhex("86 02"), bench.now_ns)
    bench.port.replies.clear()
    assert "compensation-ended" in bench.kinds()
    assert compensation_state(bench.line.axes[0]) == "off"
    assert bench.command(60_000) == 60_000
    bench.memory.put(ACTUAL, 60_000)
    assert bench.actual() == 60_000


def test_a_frame_to_a_remapping_register_whose_counts_lie_is_refused_and_ends_nothing() -> None:
    bench = Bench(axis_plan(remapping=(REMAP,)))
    assert bench.ask(bytes.fromhex("10 0F10 0001 02 000A 01 02")) == bytes.fromhex("90 03")
    assert bench.seen == []
    assert compensation_state(bench.line.axes[0]) == "active"
