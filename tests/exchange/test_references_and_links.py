"""A drive that went away may have forgotten where it is; a link that came back may bring late replies."""

import pytest

from gateway.compensation.settings import Reversal, ReversalKind
from gateway.exchange.plan import LineTiming, Reference
from gateway.modbus.registers import BitField, PositionField, RegisterType
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, axis_plan, read, stream_plan, write

HOMED = BitField(0x1003, 6)
READ_HOMED = bytes.fromhex("03 1003 0001")


def homed_bench(**plan: object) -> Bench:
    bench = Bench(
        axis_plan(referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}, **plan),
        timing=LineTiming(drain_ms=1),
        serial=False,
    )
    bench.memory.words[HOMED.address] = 1 << HOMED.bit
    bench.ask(READ_HOMED)
    assert bench.reach(50_000) == 50_010
    return bench


def go_silent(bench: Bench) -> None:
    bench.unanswered(bytes.fromhex("03 0700 0001"), 1000, 1)


def test_after_a_silence_the_homed_bit_is_asked_before_anything_is_corrected() -> None:
    bench = homed_bench()
    go_silent(bench)
    bench.memory.words[HOMED.address] = 0  # it was switched off and on
    assert bench.frames(write(COMMAND, 5_000)) == [READ_HOMED, write(COMMAND, 5_000)]
    assert bench.kinds()[-2:] == ["drive-answers", "reference-lost"]


def test_after_a_silence_a_drive_that_is_still_homed_goes_on_being_corrected() -> None:
    bench = homed_bench()
    go_silent(bench)
    assert bench.actual() == 50_000
    assert READ_HOMED in bench.seen[-2:]


def test_a_homed_bit_that_could_not_be_read_is_asked_again_with_the_next_request() -> None:
    bench = Bench(axis_plan(referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}))
    bench.line.link_down(bench.now_ns)
    bench.line.link_up(bench.now_ns)
    assert bench.link.take() == READ_HOMED
    bench.wait(1000)
    bench.wait(1000)
    bench.memory.words[HOMED.address] = 1 << HOMED.bit
    assert bench.command(50_000) == 50_010


def test_where_nothing_may_be_read_a_silence_ends_the_reference() -> None:
    bench = homed_bench(added_frames=False, home_approach=1)
    go_silent(bench)
    assert bench.kinds()[-1] == "reference-lost"
    assert bench.command(60_000) == 60_000


def test_silence_is_counted_for_each_unit_by_itself() -> None:
    bench = Bench(serial=False, tcp_drive=True)
    for _ in range(3):
        bench.send(bytes.fromhex("03 0700 0001"), unit_id=9)
        bench.wait(1000)
        bench.link.sent.clear()
        bench.port.replies.clear()
        bench.ask(bytes.fromhex("03 0700 0001"))
    assert bench.kinds() == ["line-up", "drive-silent", "drive-backed-off"]


def test_a_serial_link_that_comes_back_first_falls_silent_when_something_was_outstanding() -> None:
    bench = Bench(timing=LineTiming(drain_ms=50))
    bench.send(bytes.fromhex("03 0700 0001"))
    bench.link.sent.clear()
    bench.line.link_down(bench.now_ns)
    bench.now_ns += 5 * MS
    bench.line.link_up(bench.now_ns)
    bench.send(bytes.fromhex("03 0701 0001"))
    assert bench.leaves_after(50)[1] == bytes.fromhex("03 0701 0001")


@pytest.mark.parametrize("unit_id", [0, 255])
@pytest.mark.parametrize("request_pdu", [write(COMMAND, 50_000), read(ACTUAL)])
def test_a_tcp_drive_is_not_reached_around_its_axis_by_0_or_255(unit_id: int, request_pdu: bytes) -> None:
    bench = Bench(axis_plan(), serial=False, tcp_drive=True)
    bench.send(request_pdu, unit_id=unit_id)
    assert bench.link.sent == []
    assert bench.port.take() == bytes((request_pdu[0] | 0x80, 0x0A))
    bench.send(bytes.fromhex("03 0700 0001"), unit_id=unit_id)
    assert bench.link.sent == [(unit_id, bytes.fromhex("03 0700 0001"))]


def test_the_done_bit_in_the_reply_to_a_write_is_that_of_the_move_before() -> None:
    done = BitField(0x0031, 0)
    bench = Bench(axis_plan(bits={"done": done}))
    bench.move(80_000)
    bench.memory.words[done.address] = 1
    # FC23 writes 50 000 and reads the status word, in which the drive has not begun to move yet
    bench.ask(bytes.fromhex("17 0031 0001 0606 0002 04 C350 0000"))
    bench.memory.put(ACTUAL, 60_000)
    bench.wait(30)
    assert bench.command(70_000) == 70_010  # retargeted on the way down: forward from 60 mm, not from 50 mm


def test_a_done_bit_that_was_cleared_without_a_target_means_that_something_else_moved_the_axis() -> None:
    done = BitField(0x0031, 0)
    bench = Bench(axis_plan(bits={"done": done}))
    bench.move(50_000)
    for word in (1, 0, 1):  # reached; then jogged to 80 mm
        bench.memory.words[done.address] = word
        bench.ask(bytes.fromhex("03 0031 0001"))
    bench.memory.put(ACTUAL, 80_000)
    bench.wait(30)
    assert bench.command(60_000) == 59_990


def test_an_axis_with_a_done_bit_but_no_actual_position_keeps_its_branch_until_it_is_done() -> None:
    done = BitField(0x0031, 0)
    bench = Bench(axis_plan(actual=(), bits={"done": done}, home_approach=1))
    bench.ask(write(COMMAND, 50_000))
    assert bench.command(20_000) == 20_010
    bench.ask(bytes.fromhex("03 0031 0001"))
    bench.memory.words[done.address] = 1
    bench.ask(bytes.fromhex("03 0031 0001"))
    assert bench.command(10_000) == 9_990


def test_a_stream_goes_on_with_its_correction_after_its_link_blinked() -> None:
    bench = Bench(stream_plan(home_approach=1, reload_distance=0.001), timing=LineTiming(drain_ms=1))
    for counts in (0, 1000, 2000, 3000):
        bench.ask(write(COMMAND, counts))
    bench.memory.put(ACTUAL, 2710)  # it lags by 300 counts
    bench.line.link_down(bench.now_ns)
    bench.line.link_up(bench.now_ns)
    assert bench.sent_for(write(COMMAND, 3010)) == write(COMMAND, 3020)


def test_a_dwell_is_no_part_of_a_reversal_by_time() -> None:
    plan = stream_plan(home_approach=1, reload_distance=0.001, reversal=Reversal(ReversalKind.TIME_MS, 200.0))
    bench = Bench(plan)
    for counts in (0, 1000, 2000):
        bench.ask(write(COMMAND, counts))
    for _ in range(20):
        bench.wait(50)
        bench.ask(write(COMMAND, 2000))
    bench.wait(2)
    assert bench.command(1990) == 2000  # still wholly on the forward branch


def test_an_equal_setpoint_advances_no_blend() -> None:
    plan = stream_plan(home_approach=1, reload_distance=0.001, reversal=Reversal(ReversalKind.CYCLES, 10))
    bench = Bench(plan, tcp_drive=True)
    for counts in (0, 1000, 2000, 1990):
        bench.ask(write(COMMAND, counts))
    told = bench.memory.get(COMMAND)
    for _ in range(5):
        bench.line.link_down(bench.now_ns)
        bench.line.link_up(bench.now_ns)
        assert bench.command(1990) == told


def test_nothing_without_a_function_code_does_anything() -> None:
    bench = Bench(axis_plan())
    bench.send(b"")
    assert bench.link.sent == []
    bench.send(bytes.fromhex("03 0700 0001"))
    bench.line.reply(1, b"", bench.now_ns)
    assert bench.port.replies == []
    bench.line.reply(1, bytes.fromhex("03 02 0000"), bench.now_ns)
    assert bench.port.take() == bytes.fromhex("03 02 0000")


def test_an_axis_that_is_homed_later_is_corrected_from_then_on_without_anybody_reading_the_bit() -> None:
    bench = Bench(axis_plan(referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}))
    assert bench.kinds() == ["line-up", "reference-lost"]
    assert bench.reach(10_000) == 10_000
    bench.memory.words[HOMED.address] = 1 << HOMED.bit
    bench.wait(1000)
    assert bench.reach(50_000) == 50_010


def test_a_reference_that_was_lost_unseen_is_noticed_before_the_next_target() -> None:
    bench = homed_bench()
    bench.memory.words[HOMED.address] = 0
    bench.wait(1001)
    assert bench.command(20_000) == 20_000


def test_a_homed_bit_seen_a_moment_ago_is_not_read_again() -> None:
    bench = homed_bench()
    bench.ask(READ_HOMED)
    bench.actual()
    frames = len(bench.seen)
    bench.ask(write(COMMAND, 20_000))
    assert READ_HOMED not in bench.seen[frames:]


def test_nobody_answers_a_broadcast_on_a_controllers_serial_line() -> None:
    bench = Bench(axis_plan(), tcp_drive=True)
    bench.send(bytes.fromhex("06 0700 0001"), unit_id=0)
    assert bench.link.take() == bytes.fromhex("06 0700 0001")
    bench.line.reply(0, bytes.fromhex("06 0700 0001"), bench.now_ns)
    bench.send(write(COMMAND, 5), unit_id=0)
    assert bench.link.sent == []
    assert bench.port.replies == []


def test_a_frame_that_nobody_asked_for_makes_the_line_fall_silent_first() -> None:
    bench = Bench(timing=LineTiming(drain_ms=50))
    bench.ask(bytes.fromhex("03 0700 0001"))
    bench.line.stray(bench.now_ns, unit_id=1)  # the drive answered twice
    bench.send(bytes.fromhex("03 0701 0001"))
    assert bench.leaves_after(50)[1] == bytes.fromhex("03 0701 0001")
    assert bench.kinds()[-1] == "late-reply"


def test_noise_on_an_idle_line_holds_nothing_up() -> None:
    bench = Bench(timing=LineTiming(drain_ms=50))
    bench.line.stray(bench.now_ns)
    bench.send(bytes.fromhex("03 0701 0001"))
    assert bench.link.take() == bytes.fromhex("03 0701 0001")


def test_a_stream_that_is_homed_on_the_way_blends_from_1_to_1_and_never_by_its_lag() -> None:
    plan = stream_plan(
        referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}, home_approach=1, reload_distance=1.0
    )
    bench = Bench(plan)
    for counts in (0, 1000, 2000, 3000):
        assert bench.command(counts) == counts
        bench.memory.put(ACTUAL, counts - 300)  # from now on the axis lags by 300 counts
    bench.memory.words[HOMED.address] = 1 << HOMED.bit
    bench.ask(READ_HOMED)
    told = []
    for counts in (3010, 3510, 4010, 4510):
        bench.ask(write(COMMAND, counts))
        told.append(bench.memory.get(COMMAND) - counts)
    # sin² from 0 to +10 counts over 1 mm from the first setpoint on; 5 half way
    assert told == [0, 5, 10, 10]


def test_a_frame_that_remaps_and_commands_at_once_ends_the_compensation_too() -> None:

    beside = PositionField(0x0608, RegisterType.UINT16)
    bench = Bench(axis_plan(remapping=(beside,)))
    bench.ask(bytes.fromhex("10 0606 0003 06 C350 0000 0001"))
    assert bench.command(60_000) == 60_000
