"""Attacks on the wait for the silence before a frame. Each test fails where it finds a fault."""

from gateway.exchange.plan import ControllerPlan, LineTiming
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Port, axis_plan, monitor, read, write
from tests.exchange.staged_bench import RUN_PDU, STOP_PDU, StagedBench, staged_plan
from tests.exchange.test_silence_before_a_frame import HALF, OTHER, SILENCE_MS, WORD, holds


def passes(bench: Bench, ms: float) -> None:
    """The silence ends; the alarm has not come yet: the loop reads first."""
    bench.now_ns += int(ms * MS)


def test_w1_a_request_read_behind_the_silence_but_before_its_alarm_does_not_overtake_its_controllers_own() -> None:
    bench = Bench(serial=False)
    holds(bench)
    bench.send(WORD, transaction_id=1)
    passes(bench, 2)
    bench.send(OTHER, transaction_id=2)
    bench.wait(0)  # now the alarm comes
    assert bench.link.sent == [(1, WORD)]


def test_m3_a_trigger_read_then_does_not_run_the_target_before() -> None:
    bench = StagedBench(serial=False)
    bench.go_to(10_000)
    holds(bench)
    bench.send(write(COMMAND, 20_000), transaction_id=1)
    passes(bench, 2)
    bench.send(RUN_PDU, transaction_id=2)
    bench.wait(0)
    assert [pdu[0] for _, pdu in bench.link.sent] == [0x10], "the trigger overtook its target"


def test_m3_a_stop_read_then_overtakes_the_waiting_trigger() -> None:
    bench = StagedBench(serial=False)
    bench.stage(10_000)
    plc = Port(ControllerPlan("plc"))
    holds(bench)
    bench.send(RUN_PDU)
    passes(bench, 2)
    bench.send(STOP_PDU, plc)
    bench.serve()
    bench.wait(10)
    bench.serve()
    assert [kind for kind, _ in bench.drive.moves] == ["stop"], bench.drive.moves


def test_m3_nothing_read_then_goes_before_a_waiting_stop() -> None:
    bench = StagedBench(serial=False)
    bench.stage(10_000)
    plc = Port(ControllerPlan("plc"))
    holds(bench)
    bench.send(STOP_PDU, plc)
    passes(bench, 2)
    bench.send(OTHER)
    assert bench.link.sent == [(1, STOP_PDU)]


def behind_a_silent_unit(serial: bool) -> Bench:
    """Unit 1 answers; unit 2 has not answered."""
    timing = LineTiming(response_timeout_ms=20, drain_ms=5, retry_ms=1000)
    bench = Bench(axis_plan(), staged_plan(name="y", unit_id=2), serial=serial, timing=timing)
    bench.port.patience_ns = 300 * MS
    plc = Port(ControllerPlan("plc", timeout_ms=20))
    bench.memory.put(COMMAND, 0x00018005)
    bench.send(OTHER, plc, unit_id=2)
    bench.link.sent.clear()
    bench.wait(20)
    bench.wait(20)
    bench.events.clear()
    return bench


def test_a_request_with_a_prerequisite_is_sent_although_another_unit_is_silent() -> None:
    for serial in (True, False):
        bench = behind_a_silent_unit(serial)
        reads = 0
        bench.send(HALF)
        for _ in range(100):
            if not bench.link.sent:
                bench.wait(1)
                continue
            unit_id, pdu = bench.link.sent.pop()
            if pdu[0] != 3:
                break
            reads += 1
            bench.now_ns += MS
            holds(bench)
            bench.line.reply(unit_id, bench.memory.answer(pdu), bench.now_ns)
        else:
            raise AssertionError(f"read {reads} times, never written; {bench.kinds()}")
        assert reads <= 2
