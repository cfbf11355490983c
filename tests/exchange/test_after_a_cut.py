"""W6 over the end of a gateway: a line whose drives may still answer somebody else falls silent first."""

from gateway.exchange.line import LineExchange
from gateway.exchange.plan import ControllerPlan, LineTiming
from tests.exchange.line_bench import Bench, Port, axis_plan
from tests.exchange.staged_bench import RUN_PDU, STOP_PDU, StagedBench

FIRST, SECOND = bytes.fromhex("03 0700 0001"), bytes.fromhex("03 0701 0001")
PATIENT = ControllerPlan("plc", timeout_ms=5000.0)
TIMING = LineTiming(drain_ms=50.0)


def awaits_late_reply(line: LineExchange) -> None:
    line.rest.expect_late_reply()


def is_owed(bench: Bench) -> bool:
    return bench.line.rest.needs_silence


def test_nothing_is_sent_before_the_silence_and_what_waits_goes_then_in_its_order() -> None:
    bench = Bench(axis_plan(), timing=TIMING, before_up=awaits_late_reply)
    port = Port(PATIENT)
    bench.send(FIRST, port)
    bench.wait(49)
    bench.send(SECOND, port)
    assert (bench.link.sent, port.replies) == ([], [])
    assert is_owed(bench)
    bench.wait(1)
    assert bench.link.sent == [(1, FIRST)]
    assert not is_owed(bench)
    bench.serve()
    assert bench.seen == [FIRST, SECOND]


def test_a_late_reply_begins_the_silence_anew_and_a_line_that_is_never_silent_is_used_all_the_same() -> None:
    bench = Bench(axis_plan(), timing=TIMING, before_up=awaits_late_reply)
    bench.send(FIRST, Port(PATIENT))
    for _ in range(4):  # at 30, 60, 90 and 120 ms; three times the silence are 150 ms
        bench.wait(30)
        bench.line.stray(bench.now_ns)
        assert bench.link.sent == []
    assert bench.leaves_after(30) == (1, FIRST)


def test_m3_a_stop_does_not_wait_for_the_silence_goes_again_after_it_and_withdraws_queued_moves() -> None:
    bench = StagedBench(serial=False, timing=TIMING, before_up=awaits_late_reply)
    bench.send(FIRST, Port(PATIENT))
    bench.send(RUN_PDU)
    panel = Port(ControllerPlan("panel", timeout_ms=20.0))
    bench.send(STOP_PDU, panel)
    assert bench.link.sent == [(1, STOP_PDU)]
    bench.line.reply(1, bytes.fromhex("86 04"), bench.now_ns)  # it may answer whoever was here before
    assert panel.replies == []
    bench.wait(50)
    assert bench.link.sent == [(1, STOP_PDU)] * 2
    bench.line.reply(1, STOP_PDU, bench.now_ns)
    assert panel.take() == STOP_PDU
    assert bench.port.take() == bytes.fromhex("86 06")  # the move that the stop has overtaken


def test_a_cable_that_is_lost_meanwhile_begins_it_anew() -> None:
    bench = Bench(axis_plan(), timing=TIMING, before_up=awaits_late_reply)
    bench.wait(49)
    bench.line.link_down(bench.now_ns)
    assert is_owed(bench)
    bench.wait(1000)
    bench.line.link_up(bench.now_ns)
    bench.send(FIRST, Port(PATIENT))
    assert bench.leaves_after(50) == (1, FIRST)


def test_a_stop_of_the_gateway_leaves_nothing_owed_but_what_is_on_the_wire_or_still_late() -> None:
    bench = Bench(axis_plan(), timing=TIMING)
    bench.line.link_down(bench.now_ns)
    assert not is_owed(bench)
    bench.line.link_up(bench.now_ns)
    bench.send(FIRST)
    bench.line.stop(bench.now_ns)
    bench.wait(1000)  # time-out
    assert bench.line.is_idle
    bench.line.link_down(bench.now_ns)
    assert is_owed(bench)
