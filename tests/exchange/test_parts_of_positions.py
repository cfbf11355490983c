"""Partial writes, masks, cuts: whatever part is written or read, the drive sees whole corrected positions."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.exchange.plan import Reference
from gateway.modbus.registers import BitField
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, axis_plan, read, write
from tests.soak import repeated


def moved(counts: int = 50_000) -> Bench:
    bench = Bench(axis_plan())
    bench.move(counts)
    return bench


@pytest.mark.parametrize(
    ("request_hex", "told", "reply"),
    [
        # 50 000 is 0000 C350. Low word C738: 51 000, forward from 50 000: 51 010, C742; the echo is FC06's.
        ("06 0606 C738", "10 0606 0002 04 C742 0000", "06 0606 C738"),
        # 0001 C350 is 115 536, outside the table: hold, +10, 0001 C35A.
        ("06 0607 0001", "10 0606 0002 04 C35A 0001", "06 0607 0001"),
        # A block that ends inside the position is widened.
        (
            "10 0604 0003 06 1111 2222 C738",
            "10 0604 0004 08 1111 2222 C742 0000",
            "10 0604 0003",
        ),
        # FC22 is applied to the nominal word: and FF00, or 0038: C338, 49 976, backward: 49 966, C32E.
        ("16 0606 FF00 0038", "10 0606 0002 04 C32E 0000", "16 0606 FF00 0038"),
        # FC23 writes 60 000, EA60, corrected, and what it reads back afterwards is turned back.
        (
            "17 0606 0002 0606 0002 04 EA60 0000",
            "17 0606 0002 0606 0002 04 EA6A 0000",
            "17 04 EA60 0000",
        ),
        # A read that cuts the position is widened, and its answer is cut again.
        ("03 0520 0001", "03 0520 0002", "03 02 C350"),
        ("03 0521 0003", "03 0520 0004", "03 06 0000 0000 0000"),
    ],
)
def test_whatever_part_is_written_or_read_the_drive_sees_whole_positions(
    request_hex: str, told: str, reply: str
) -> None:
    bench = moved()
    assert bench.ask(bytes.fromhex(request_hex)) == bytes.fromhex(reply)
    assert bench.seen[-1] == bytes.fromhex(told)


def test_a_half_of_an_unknown_position_is_completed_from_the_drive() -> None:
    bench = Bench(axis_plan())
    bench.memory.put(COMMAND, 0x00018005)
    bench.ask(bytes.fromhex("06 0606 8009"))
    assert bench.seen[0] == read(COMMAND)
    assert bench.memory.get(COMMAND) == 0x00018009 + 10


@pytest.mark.parametrize("part", ["06 0606 0009", "06 0607 0001"])
def test_a_part_is_refused_if_the_drive_may_hold_another_rest_of_the_position(part: str) -> None:
    bench = Bench(axis_plan())
    # 0x10005 may stand for 0x0FFFB: its high word is not certain, and its low word never is
    bench.memory.put(COMMAND, 0x00010005)
    assert bench.ask(bytes.fromhex(part)) == bytes.fromhex("86 04")
    assert bench.memory.get(COMMAND) == 0x00010005


def test_a_half_of_an_unknown_position_is_refused_if_no_read_may_be_added() -> None:
    bench = Bench(axis_plan(added_frames=False))
    assert bench.ask(bytes.fromhex("06 0606 0009")) == bytes.fromhex("86 04")
    assert bench.seen == []
    assert "the rest is not known" in bench.events[-1].detail


def test_a_drives_exception_to_a_recast_half_comes_back_in_the_controllers_function() -> None:
    bench = moved()
    bench.memory.put(ACTUAL, 50_010)
    bench.ask(read(ACTUAL))
    bench.wait(1)
    bench.send(bytes.fromhex("06 0606 0001"))
    bench.answers(bytes.fromhex("90 03"))
    assert bench.port.take() == bytes.fromhex("86 03")


def test_a_cut_read_beyond_the_drives_limit_is_refused() -> None:
    bench = Bench(axis_plan(max_registers=4))
    assert bench.ask(bytes.fromhex("03 0521 0004")) == bytes.fromhex("83 02")
    assert bench.seen == []


def test_writing_a_register_that_reports_a_position_is_refused() -> None:
    bench = Bench(axis_plan())
    assert bench.ask(write(ACTUAL, 0)) == bytes.fromhex("90 02")
    assert bench.seen == []


@pytest.mark.parametrize(
    "lie",
    [
        "10 0606 0002 02 C350",
        "10 0606 0003 04 C350 0000",
        "10 0606 0002 04 C350",
        "10 0605 0001 04 C350 0000",
    ],
)
def test_a_write_to_a_position_with_contradicting_counts_is_refused(lie: str) -> None:
    bench = Bench(axis_plan())
    assert bench.ask(bytes.fromhex(lie)) == bytes.fromhex("90 03")
    assert bench.seen == []


@settings(max_examples=repeated(500))
@given(
    st.lists(st.tuples(st.sampled_from(["low", "high", "mask", "whole"]), st.integers(0, 65535)), max_size=12)
)
def test_any_sequence_of_parts_leaves_the_drive_the_corrected_whole(writes: list[tuple[str, int]]) -> None:
    bench = moved(1000)
    nominal = 1000
    for kind, number in writes:
        word = number.to_bytes(2, "big")
        if kind == "low":
            bench.ask(bytes.fromhex("06 0606") + word)
            nominal = nominal & ~0xFFFF | number
        elif kind == "high":
            bench.ask(bytes.fromhex("06 0607") + (number & 0xFF).to_bytes(2, "big"))
            nominal = nominal & 0xFFFF | (number & 0xFF) << 16
        elif kind == "mask":
            bench.ask(bytes.fromhex("16 0606 00FF") + word)
            nominal = nominal & ~0xFFFF | (nominal & 0x00FF) | (number & 0xFF00)
        else:
            bench.ask(write(COMMAND, number))
            nominal = number
        assert bench.memory.get(COMMAND) in (nominal + 10, nominal - 10)
        bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
        assert COMMAND.unpack(bench.ask(read(COMMAND))[2:]) == nominal
        assert bench.actual() == nominal


# --- words of an axis that passes 1:1, beside corrected ones -----------------------------------------------

HOMED = BitField(0x005C, 4)
STATUS = bytes.fromhex("03 005C 0001")


def unreferenced(counts: int, **changes: object) -> Bench:
    """Return an axis at a target whose link was lost, and whose homed bit is clear since: its words are
    unknown."""
    bench = Bench(axis_plan(referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}, **changes))
    bench.memory.words[HOMED.address] = 1 << 4
    bench.ask(STATUS)
    bench.move(1000)
    bench.actual()
    assert bench.reach(counts) == counts + 10
    bench.cut(50)
    bench.memory.words[HOMED.address] = 0
    bench.ask(STATUS)
    bench.seen.clear()
    return bench


PARTS = ["06 0606 FFF0", "10 0606 0001 02 FFF0", "16 0606 0000 FFF0"]
"""The low word FFF0 by FC06, FC16 and FC22."""


@pytest.mark.parametrize("part", PARTS)
def test_a_part_beside_a_corrected_word_is_refused_if_the_rest_is_unknown(part: str) -> None:
    """M1, M9: 65530 is 65540 forward, 0004 0001: its high word is not that of 65530, 0000.

    FFF0 beside 0001 would be 131056, and 65520 was meant.
    """
    bench = unreferenced(65_530)
    assert bench.memory.get(COMMAND) == 65_540
    request = bytes.fromhex(part)
    assert bench.ask(request) == bytes((request[0] | 0x80, 4))
    assert all(pdu[0] == 3 for pdu in bench.seen)
    assert bench.memory.get(COMMAND) == 65_540
    # All of it in one frame goes out as it came, and parts of it are completed from then on.
    whole = bytes.fromhex("10 0606 0002 04 FFF0 0000")
    assert bench.ask(whole) == whole[:5]
    assert bench.seen[-1] == whole
    assert bench.ask(bytes.fromhex("06 0606 FFF1")) == bytes.fromhex("06 0606 FFF1")
    assert bench.memory.get(COMMAND) == 65_521


def test_a_part_beside_a_corrected_word_is_sent_as_a_whole_position_if_the_rest_is_certain() -> None:
    """M1, M9: 50000 is 50010 forward, C35A 0000, and no correction reaches the next high word.

    The low word C738 is 51000 then, and goes out as it came, with the rest.
    """
    bench = unreferenced(50_000)
    assert bench.ask(bytes.fromhex("06 0606 C738")) == bytes.fromhex("06 0606 C738")
    assert bench.seen[-2:] == [read(COMMAND), bytes.fromhex("10 0606 0002 04 C738 0000")]


def test_a_part_is_refused_without_a_reference_if_no_read_may_be_added() -> None:
    """M1, M9, W8: the same where the gateway adds no frames."""
    bench = unreferenced(50_000, added_frames=False)
    assert bench.ask(bytes.fromhex("06 0606 C738")) == bytes.fromhex("86 04")
    assert bench.seen == []


def test_a_part_passes_unchanged_without_a_reference_if_no_target_was_corrected() -> None:
    """M9: of an axis that was never corrected a part goes out 1:1, and nothing is read."""
    bench = Bench(axis_plan(referenced=Reference.SET_POSITION))
    assert bench.ask(bytes.fromhex("06 0606 C738")) == bytes.fromhex("06 0606 C738")
    assert bench.seen == [bytes.fromhex("06 0606 C738")]
