"""What somebody's frame changes beside the stop in it, or was refused in it: it is never run (M3)."""

import pytest

from gateway.drives.motion import MotionPlan, TriggerPlan
from gateway.exchange.plan import CompensationMode, Role
from tests.exchange.staged_bench import (
    DEEDS,
    JOG_PDU,
    RUN_PDU,
    STOP,
    StagedBench,
    StagedDrive,
    staged_plan,
    sticky,
)
from tests.exchange.test_writers import HOLD_MS, MODE_ABSOLUTE, controller, move, refusal, writer

SPAN_TRIGGER = 0x0608
"""A trigger right behind the target: one frame writes both."""
RUN_SPAN = bytes.fromhex("06 0608 0001")


class SpanDrive(StagedDrive):
    """As the other one, with its trigger right behind the target."""

    def write(self, address: int, data: bytes) -> None:
        super().write(address, data)
        words = len(data) // 2
        if address <= SPAN_TRIGGER < address + words:
            at = 2 * (SPAN_TRIGGER - address)
            self.act(int.from_bytes(data[at : at + 2], "big"))


def span_bench(**changes: object) -> StagedBench:
    motion = MotionPlan(is_staged=True, triggers=(TriggerPlan(SPAN_TRIGGER, deeds=DEEDS),))
    bench = StagedBench(staged_plan(motion=motion, **changes), serial=False)
    bench.drive = bench.memory = SpanDrive()
    return bench


def image(counts: int, trigger: int) -> bytes:
    """Target and trigger in one frame; the lower word comes first."""
    low, high = counts & 0xFFFF, counts >> 16
    return bytes.fromhex("10 0606 0003 06") + b"".join(n.to_bytes(2, "big") for n in (low, high, trigger))


@pytest.mark.parametrize("role", [Role.MOTION, Role.OPERATOR])
@pytest.mark.parametrize("compensation", [CompensationMode.ON, CompensationMode.OFF])
def test_m3_what_a_stop_of_another_writes_beside_never_runs(
    role: Role, compensation: CompensationMode
) -> None:
    bench = span_bench(compensation=compensation)
    cnc, panel = controller("cnc"), controller("panel", role=role)
    move(bench, cnc, 4_000)
    stop = image(9_000, STOP)
    assert bench.ask(stop, panel) == stop[:5]  # a stop is never refused
    assert bench.ask(RUN_SPAN, cnc) == refusal(RUN_SPAN)
    assert [kind for kind, _ in bench.drive.moves] == ["stop"]
    assert writer(bench) == "cnc"
    move(bench, cnc, 5_000)
    assert bench.ask(RUN_SPAN, cnc) == RUN_SPAN
    [_, (kind, counts)] = bench.drive.moves
    assert (kind, abs(counts - 5_000) <= 10) == ("absolute", True)


def test_m3_a_target_beside_ones_own_stop_comes_in_place_of_that_of_another_one() -> None:
    bench = span_bench(compensation=CompensationMode.OFF)
    cnc, panel = controller("cnc"), controller("panel")
    move(bench, cnc, 4_000)
    for port, counts in ((panel, 9_000), (cnc, 5_000)):
        stop = image(counts, STOP)
        assert bench.ask(stop, port) == stop[:5]
    assert bench.ask(RUN_SPAN, cnc) == RUN_SPAN
    assert bench.drive.moves[2:] == [("absolute", 5_000)]


@pytest.mark.parametrize("role", [Role.MOTION, Role.OPERATOR])
def test_m3_a_stop_of_another_one_with_the_target_that_stands_there_takes_nothing(role: Role) -> None:
    bench = span_bench()
    cnc, panel = controller("cnc"), controller("panel", role=role)
    move(bench, cnc, 4_000)
    stop = image(4_000, STOP)
    assert bench.ask(stop, panel) == stop[:5]
    assert bench.ask(RUN_SPAN, cnc) == RUN_SPAN
    assert [kind for kind, _ in bench.drive.moves] == ["stop", "absolute"]


def test_m3_ones_own_stop_with_another_target_takes_nothing() -> None:
    bench = span_bench()
    cnc = controller("cnc")
    move(bench, cnc, 4_000)
    stop = image(5_000, STOP)
    assert bench.ask(stop, cnc) == stop[:5]
    assert bench.ask(RUN_SPAN, cnc) == RUN_SPAN
    assert [kind for kind, _ in bench.drive.moves] == ["stop", "absolute"]


def test_m3_a_mode_that_was_refused_in_fc23_is_not_forgotten_for_another_fc23() -> None:
    """Both read the same; what they write is not the same, and each loss counts."""
    bench = StagedBench(staged_plan(motion=sticky()))
    cnc, panel = controller("cnc"), controller("panel")
    assert bench.ask(MODE_ABSOLUTE, cnc) == MODE_ABSOLUTE
    move(bench, cnc, 4_000, runs=True)
    bench.settle(is_polled=False)
    mode = bytes.fromhex("17 005C 0001 0700 0001 02 0002")
    distance = bytes.fromhex("17 005C 0001 0606 0002 04 0064 0000")
    for pdu in (mode, distance):
        assert bench.ask(pdu, panel) == refusal(pdu)
    bench.wait(HOLD_MS + 1_000)
    assert bench.ask(distance, panel)[0] == 0x17
    assert bench.ask(RUN_PDU, panel) == refusal(RUN_PDU)  # it would be a place
    assert len(bench.drive.moves) == 1


LET_GO = bytes.fromhex("06 050E 0000")


def test_m3_whoever_jogs_may_let_go_although_another_one_took_the_axis_over() -> None:
    bench = StagedBench()
    pendant, cnc, other = controller("pendant"), controller("cnc"), controller("other")
    assert bench.ask(JOG_PDU, pendant) == JOG_PDU
    bench.wait(HOLD_MS + 1_000)  # the button is still held
    move(bench, cnc, 4_000)
    assert bench.ask(LET_GO, other) == refusal(LET_GO)
    assert bench.ask(LET_GO, pendant) == LET_GO
    assert bench.ask(JOG_PDU, pendant) == refusal(JOG_PDU)
    assert writer(bench) == "cnc"
    assert bench.ask(RUN_PDU, cnc) == RUN_PDU
    assert bench.ask(LET_GO, pendant) == refusal(LET_GO)  # its jog has ended: this is another move
    assert [kind for kind, _ in bench.drive.moves] == ["jog", "absolute"]
