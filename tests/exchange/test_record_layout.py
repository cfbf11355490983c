"""The bytes of a record: whatever happens to them, the newest good record is read, or none."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.compensation.correction_spec import NOTHING, CorrectionSpec
from gateway.exchange.axis.record_layout import (
    PAGE,
    RECORD_SIZE,
    SLOT_SIZE,
    SLOTS_AT,
    RecordSlots,
    Remembered,
    header,
    why_not_readable,
)
from tests.exchange.line_bench import COMMAND, axis_plan, stream_plan, write
from tests.exchange.record_bench import RecordBench


def read(data: bytes | bytearray) -> Remembered | None:
    return RecordSlots(memoryview(bytearray(data)), bytes(16)).read()


def two_generations() -> tuple[bytes, bytes]:
    """Return the record before and after a target was sent: two different generations."""
    bench = RecordBench(stream_plan())
    for counts in (50_000, 50_200, 50_100):
        bench.move(counts)
    before = bytes(bench.records.buffers["x"])
    bench.send(write(COMMAND, 50_050))
    after = bytes(bench.records.buffers["x"])
    assert read(before) != read(after)
    return before, after


BEFORE, AFTER = two_generations()
AT = next(at for at in SLOTS_AT if BEFORE[at : at + SLOT_SIZE] != AFTER[at : at + SLOT_SIZE])
"""Offset of the newer generation."""


def test_only_one_slot_is_written_at_a_time_and_each_has_a_page_of_its_own() -> None:
    changed = {i // PAGE for i in range(RECORD_SIZE) if BEFORE[i] != AFTER[i]}
    assert changed == {AT // PAGE}
    assert SLOT_SIZE < PAGE
    assert {at // PAGE for at in SLOTS_AT} == {1, 2}


@settings(max_examples=400)
@given(st.integers(0, SLOT_SIZE - 1), st.integers(1, 255), st.sampled_from(SLOTS_AT))
def test_a_flipped_byte_in_one_slot_makes_the_other_count(place: int, flip: int, at: int) -> None:
    data = bytearray(AFTER)
    data[at + place] ^= flip
    assert read(data) == (read(BEFORE) if at == AT else read(AFTER))


def test_flipped_bytes_in_both_slots_leave_no_record() -> None:
    for place in range(SLOT_SIZE):
        data = bytearray(AFTER)
        for at in SLOTS_AT:
            data[at + place] ^= 0x10
        assert read(data) is None
        assert RecordSlots(memoryview(data), bytes(16)).is_damaged


@pytest.mark.parametrize("rest", ["old", "zeros"])
def test_a_store_cut_off_at_any_byte_leaves_the_generation_before(rest: str) -> None:
    """Bytes are stored upwards, and the check sum stands last; a page is cleared before, or is not."""
    for cut in range(SLOT_SIZE):
        data = bytearray(BEFORE)
        tail = bytes(SLOT_SIZE - cut) if rest == "zeros" else BEFORE[AT + cut : AT + SLOT_SIZE]
        data[AT : AT + SLOT_SIZE] = AFTER[AT : AT + cut] + tail
        found = read(data)
        # The last bytes may happen to be the same in both: then all of it is there.
        assert found == (read(AFTER) if data == AFTER else read(BEFORE))


def test_a_buffer_of_zeros_is_no_record_and_no_damage() -> None:
    slots = RecordSlots(memoryview(bytearray(RECORD_SIZE)), bytes(16))
    assert slots.read() is None
    assert not slots.is_damaged
    assert slots.generation == 0


@settings(max_examples=300)
@given(st.binary(min_size=SLOT_SIZE, max_size=SLOT_SIZE), st.sampled_from(SLOTS_AT))
def test_any_other_bytes_are_no_record(garbage: bytes, at: int) -> None:
    data = bytearray(RECORD_SIZE)
    data[at : at + SLOT_SIZE] = garbage
    assert read(data) is None


def test_a_slot_copied_to_the_place_of_the_other_is_no_record() -> None:
    data = bytearray(RECORD_SIZE)
    other = next(at for at in SLOTS_AT if at != AT)
    data[other : other + SLOT_SIZE] = AFTER[AT : AT + SLOT_SIZE]
    assert read(data) is None


def test_numbers_are_read_as_they_were_written() -> None:
    bench = RecordBench(axis_plan())
    bench.move(50_000, 20_000)
    axis = bench.line.axes[0]
    record = bench.records.read()
    assert record is not None
    compensation = axis.compensation
    assert (record.nominal_counts, record.corrected_counts) == compensation.accepted
    assert isinstance(record.nominal_counts, int)
    assert record.fade == compensation.readback.fade
    assert record.anchor_counts == compensation.readback.anchor_counts
    state = compensation.state
    numbers = (record.state.position, record.state.extreme, record.state.progress, record.state.change)
    assert numbers == (state.position, state.travel.extreme, state.progress, state.change)
    assert record.state.direction == state.travel.direction.value
    assert record.state.spec.digest == axis.correction.requested.table_digest
    assert record.state.spec.was_requested


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "it has 0 bytes and not 12288"),
        (bytes(RECORD_SIZE - 1), "it has 12287 bytes and not 12288"),
        (bytes(RECORD_SIZE), "it is no record of an axis"),
        (header("y").ljust(RECORD_SIZE, b"\0"), "it belongs to axis y"),
        (
            header("x").replace(b"\x03\x00", b"\x04\x00", 1).ljust(RECORD_SIZE, b"\0"),
            "it has version 4, and this release reads versions 1 to 3",
        ),
    ],
)
def test_a_file_that_is_no_record_is_refused_with_the_reason(data: bytes, reason: str) -> None:
    assert why_not_readable(data, "x") == reason
    assert why_not_readable(header("x").ljust(RECORD_SIZE, b"\0"), "x") == ""


def tilted(tilt: float) -> CorrectionSpec:
    return replace(NOTHING, offset=0.5, tilt=tilt)


def keep(slots: RecordSlots, tilt: float) -> None:
    spec = tilted(tilt)
    slots.write(_SAYS, None, (spec, None, None, None, spec))


_SAYS = (
    *(False, False, False, False, False, 0, 1.0, 2.0, 3.0, 4.0),
    *(0, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0),
    *(0.0, False, 0.0, 0.0, 0.0, 0.0),
)


def test_the_slope_of_a_line_is_in_a_tail_that_only_its_first_store_adds() -> None:
    buffer = bytearray(RECORD_SIZE)
    slots = RecordSlots(memoryview(buffer), bytes(16))
    found = []
    tails = []
    for tilt in (0.0, -1e-4, -2e-4, 0.0, 0.0, 3e-4):
        keep(slots, tilt)
        record = RecordSlots(memoryview(buffer), bytes(16)).read()
        assert record is not None
        found.append((record.state.spec.offset, record.state.spec.tilt))
        both = (buffer[at + SLOT_SIZE : at + SLOT_SIZE + 8] for at in SLOTS_AT)
        tails.append({int.from_bytes(tail, "little") for tail in both})
    assert found == [(0.5, 0.0), (0.5, -1e-4), (0.5, -2e-4), (0.5, 0.0), (0.5, 0.0), (0.5, 3e-4)]
    assert tails == [{0}, {0, 2}, {2, 3}, {3, 4}, {4, 5}, {5, 6}]  # the generations that they belong to


def test_a_slot_without_its_own_tail_does_not_count() -> None:
    """Killed between tail and slot: the older slot counts, with its own slope."""
    buffer = bytearray(RECORD_SIZE)
    slots = RecordSlots(memoryview(buffer), bytes(16))
    for tilt in (-1e-4, -2e-4, -3e-4):
        keep(slots, tilt)
    at = SLOTS_AT[1]
    before = bytes(buffer[at : at + SLOT_SIZE])
    keep(slots, -4e-4)
    keep(slots, -5e-4)
    buffer[at : at + SLOT_SIZE] = before  # generation 3 with the tail of generation 5
    record = RecordSlots(memoryview(buffer), bytes(16)).read()
    assert record is not None
    assert (record.generation, record.state.spec.tilt) == (4, -4e-4)
    buffer[SLOTS_AT[0] + SLOT_SIZE + 9] ^= 1  # and a tail that is damaged takes its slot with it
    damaged = RecordSlots(memoryview(buffer), bytes(16))
    assert damaged.read() is None
    assert damaged.is_damaged


def test_a_kill_between_a_level_tail_and_its_slot_does_not_remove_the_slope_of_the_older_slot() -> None:
    buffer = bytearray(RECORD_SIZE)
    slots = RecordSlots(memoryview(buffer), bytes(16))
    for tilt in (-1e-4, -2e-4, -3e-4):
        keep(slots, tilt)
    at, other = SLOTS_AT
    before = bytes(buffer[at : at + SLOT_SIZE])
    keep(slots, 0.0)
    buffer[at : at + SLOT_SIZE] = before  # generation 2 with the tail of generation 4
    assert getattr(read(buffer), "generation", None) == 3
    buffer[other : other + SLOT_SIZE] = bytes(SLOT_SIZE)  # and that page never reached the disk
    assert read(buffer) is None
