"""A drive behind a Modbus/TCP converter, which answers 0x0A or 0x0B in its place (W8, W11, M9)."""

from typing import Any, Final

import pytest

from gateway.exchange.axis.motion import MotionState
from gateway.exchange.axis.reference import ReferenceEvent
from gateway.exchange.plan import LineTiming, Reference
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Memory, axis_plan, read, write
from tests.exchange.record_bench import RecordBench
from tests.exchange.staged_bench import RUN_PDU, RUN_RELATIVE_PDU, STATUS, StagedBench, staged_plan
from tests.exchange.test_link_loss import HOMED, READ_HOMED

READ_STATUS: Final = b"\x03" + STATUS.to_bytes(2, "big") + b"\x00\x01"
LOST_MS: Final = 1_000
TIMES: Final = LineTiming(response_timeout_ms=200.0, retry_ms=500.0)


class Converter(Memory):
    """Passes requests on to its drive; if it has a code for a request, it answers with that itself."""

    def __init__(self, drive: Memory) -> None:
        super().__init__()
        self.drive, self.words = drive, drive.words
        self.codes: list[int] = []
        """For the next requests, one each."""
        self.refused: dict[bytes, int] = {}
        """Codes of the drive's own for some requests."""
        self.is_drive_off = False

    def answer(self, pdu: bytes) -> bytes:
        code = self.codes.pop(0) if self.codes else 0x0B if self.is_drive_off else self.refused.get(pdu, 0)
        return bytes((pdu[0] | 0x80, code)) if code else self.drive.answer(pdu)


def behind_converter(bench: Bench) -> Converter:
    converter = bench.memory = Converter(bench.memory)
    return converter


def staged(**plan: Any) -> tuple[StagedBench, Converter]:
    """An axis at 20 000, seen there; its converter is reached by TCP."""
    bench = StagedBench(staged_plan(lost_ms=LOST_MS, **plan), tcp_drive=True, serial=False, timing=TIMES)
    converter = behind_converter(bench)
    bench.go_to(50_000, 20_000)
    return bench, converter


def switch_off(bench: StagedBench, converter: Converter, seconds: float) -> list[bytes]:
    """Switch the drive off for a while, in which its controller polls its status; return the answers."""
    converter.is_drive_off = True
    answers = []
    for _ in range(int(5 * seconds)):
        answers.append(bench.ask(READ_STATUS))
        bench.wait(200)
    converter.is_drive_off = False
    return answers


def until_it_answers(bench: StagedBench) -> None:
    """Let the controller poll until the next trial finds the drive."""
    for _ in range(50):
        bench.wait(200)
        if bench.ask(READ_STATUS)[0] == 3:
            return
    raise AssertionError("it was not tried again within 10 s")


def test_w11_a_drive_that_its_converter_does_not_reach_is_silent_and_dead_after_three_requests() -> None:
    bench, converter = staged()
    bench.seen.clear()
    assert set(switch_off(bench, converter, 1.0)) == {b"\x83\x0b"}
    assert bench.seen == [READ_STATUS] * 3  # two more came before the trial was due
    assert bench.kinds()[-2:] == ["drive-silent", "drive-backed-off"]
    bench.wait(500)
    assert bench.ask(READ_STATUS)[0] == 3
    assert "drive-answers" in bench.kinds()


def test_w11_a_converter_that_answers_at_once_makes_a_drive_dead_no_sooner_than_time_outs() -> None:
    bench, converter = staged()
    converter.codes = [0x0B] * 4
    for _ in range(4):
        assert bench.ask(READ_STATUS) == b"\x83\x0b"
        bench.wait(1)
    bench.stage(60_000)
    assert bench.trigger() == ("absolute", 60_010)
    assert "drive-backed-off" not in bench.kinds()


@pytest.mark.parametrize("own", [read(ACTUAL), READ_STATUS])
def test_w11_each_trial_that_a_converter_answers_takes_another_register(own: bytes) -> None:
    """A drive may have a code of its own for one register that looks like that of a converter."""
    bench, converter = staged()
    switch_off(bench, converter, 1.0)
    converter.refused = {own: 0x0B}
    replies = []
    for _ in range(3):
        bench.wait(10_000)
        replies.append(bench.ask(write(COMMAND, 60_000)))
    assert replies[-1] == write(COMMAND, 60_000)[:5]


def test_m9_the_silence_of_a_drive_begins_with_the_first_answer_of_its_converter() -> None:
    """An added read and its repeat take 400 ms each."""
    bench = Bench(axis_plan(referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}, lost_ms=LOST_MS))
    bench.memory.words[HOMED.address] = 1 << HOMED.bit
    bench.ask(READ_HOMED)
    bench.reach(50_000)
    bench.wait(1_500)
    bench.send(write(COMMAND, 60_000))
    for _ in range(2):
        [(unit_id, pdu)] = bench.link.sent
        bench.link.sent.clear()
        assert pdu == READ_HOMED
        bench.wait(400)
        bench.line.reply(unit_id, b"\x83\x0b", bench.now_ns)
    reach = bench.line.axes[0].reach
    assert reach.silent_since_ns is not None
    assert bench.now_ns - reach.silent_since_ns == 800 * MS


def test_m2_a_drive_that_was_off_holds_no_target_any_more() -> None:
    bench, converter = staged()
    bench.stage(60_000)
    switch_off(bench, converter, 3.0)
    bench.drive.put(COMMAND, 0)  # what its register holds after it was switched on
    until_it_answers(bench)
    assert bench.refused(RUN_PDU) == 4


def test_m2_a_target_outlasts_a_silence_that_is_shorter_than_lost_ms() -> None:
    bench, converter = staged()
    bench.stage(60_000)
    assert switch_off(bench, converter, 0.4) == [b"\x83\x0b"] * 2
    assert bench.trigger() == ("absolute", 60_010)


def test_m9_a_drive_that_was_off_has_lost_its_reference() -> None:
    bench = Bench(axis_plan(referenced=Reference.SET_POSITION, lost_ms=LOST_MS), timing=TIMES)
    bench.line.axes[0].declare_referenced()
    converter = behind_converter(bench)
    assert bench.command(50_000) == 50_010
    converter.is_drive_off = True
    for _ in range(8):
        bench.ask(bytes.fromhex("03 0700 0001"))
        bench.wait(300)
    converter.is_drive_off = False
    bench.wait(600)
    assert bench.command(60_000) == 60_000
    assert "reference-lost" in bench.kinds()


@pytest.mark.parametrize("code", [0x0A, 0x0B])
def test_w8_a_read_that_did_not_reach_the_drive_is_repeated_and_then_ends_its_request(code: int) -> None:
    bench, converter = staged()
    bench.drive.stand_at(30_000)
    bench.wait(5_000)
    bench.stage(1_000)
    for _ in range(3):  # a drive that was not reached has not refused to report its position
        bench.seen.clear()
        converter.codes = [code, code]
        assert bench.ask(RUN_RELATIVE_PDU) == bytes((0x86, code))
        assert bench.seen == [read(ACTUAL)] * 2
        bench.ask(READ_STATUS)
        bench.stage(1_000)
    bench.ask(RUN_RELATIVE_PDU)
    assert bench.drive.moves[-1][0] == "relative"


def homed(*codes: int) -> tuple[Bench, Converter]:
    """An axis whose drive reports it as homed, at 50 000; its next reads are answered with these codes."""
    bench = Bench(axis_plan(referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}))
    converter = behind_converter(bench)
    converter.words[HOMED.address] = 1 << HOMED.bit
    bench.ask(READ_HOMED)
    assert bench.reach(50_000) == 50_010
    bench.wait(1_500)  # too old for the next target
    bench.seen.clear()
    converter.codes = list(codes)
    return bench, converter


@pytest.mark.parametrize("code", [4, 5, 6, 8, 0x0A, 0x0B])
def test_w8_a_homed_bit_that_a_busy_drive_does_not_report_is_read_once_more(code: int) -> None:
    bench, _ = homed(code)
    assert bench.ask(write(COMMAND, 60_000)) == write(COMMAND, 60_000)[:5]
    assert bench.seen == [READ_HOMED, READ_HOMED, read(ACTUAL), write(COMMAND, 60_010)]


@pytest.mark.parametrize("code", [4, 5, 6, 8, 0x0A, 0x0B])
def test_m9_a_target_waits_for_the_homed_bit_and_is_no_guess(code: int) -> None:
    bench, _ = homed(code, code)
    assert bench.ask(write(COMMAND, 60_000)) == bytes((0x90, code))
    assert bench.seen == [READ_HOMED, READ_HOMED]
    assert bench.ask(write(COMMAND, 60_000)) == write(COMMAND, 60_000)[:5]
    assert bench.memory.get(COMMAND) == 60_010


def test_m9_a_read_is_not_refused_for_a_homed_bit_that_a_busy_drive_does_not_report() -> None:
    bench, _ = homed(6, 6)
    bench.line.axes[0].reference.happens(ReferenceEvent.SILENCE)
    assert ACTUAL.unpack(bench.ask(read(ACTUAL))[2:]) == 50_000
    assert bench.seen == [READ_HOMED, READ_HOMED, read(ACTUAL)]


def test_m9_a_drive_that_refuses_to_report_its_homed_bit_counts_as_not_homed() -> None:
    bench, _ = homed(2)
    assert bench.command(60_000) == 60_000


def test_w8_a_busy_drive_at_the_start_does_not_void_the_record() -> None:
    bench = RecordBench(axis_plan(referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}))
    bench.memory.words[HOMED.address] = 1 << HOMED.bit
    bench.ask(READ_HOMED)
    bench.move(50_000, 20_000)
    bench.reach(20_000)
    drive = Converter(bench.memory)
    drive.codes = [6, 6]
    again = RecordBench(*bench.plans, records=bench.records, memory=drive, start_ns=bench.now_ns)
    assert again.actual() == 20_000
    assert again.told[0].startswith("goes on from its record")
    assert again.line.axes[0].motion.state is MotionState.IN_WINDOW
