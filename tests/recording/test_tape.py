"""The tape: what is on it, what was written over, and that it never takes more than it was given."""

import mmap
import os
from itertools import pairwise

import pytest

from gateway.recording.trace_buffer import (
    HEAD,
    PAGE,
    REPLY,
    REQUEST,
    SEGMENTS,
    SENT,
    TEXT,
    NoTraceBufferError,
    Raw,
    RingReader,
    TraceBuffer,
    ids_of,
)

SMALLEST = SEGMENTS * PAGE
ROOM = PAGE - 16
"""Bytes for entries in a segment of a page: its number and its filling take 16."""
PDU = bytes.fromhex("03 0064 0002")
IDS = ids_of(3, 7, 250)


def test_what_was_put_is_there_in_order() -> None:
    trace_buffer = TraceBuffer("x", SMALLEST, 1_000, 1_700_000_000_000_000_000)
    reader = RingReader(trace_buffer.descriptor)
    put = [Raw(REQUEST, 2_000, IDS, PDU), Raw(SENT, 2_000, 250, PDU), Raw(REPLY, 3_000, 250, b"")]
    for raw in put:
        trace_buffer.put(*raw)
    assert reader.new() == ([], False)
    trace_buffer.show()
    assert reader.new() == (put, False)
    assert reader.new() == ([], False)
    trace_buffer.put(*put[0])
    trace_buffer.show()
    assert reader.new() == ([put[0]], False)
    # 2 000 - 1 000 ns after the moment that is on both clocks.
    assert reader.wall_ns(2_000) == 1_700_000_000_000_001_000
    reader.close()
    trace_buffer.close()


def test_the_bytes_of_an_entry() -> None:
    """Size 26, kind 1, ids 0x030007FA, time 2 000 = 0x07D0, little end first; then the PDU."""
    trace_buffer = TraceBuffer("x", SMALLEST, 0, 0)
    trace_buffer.put(REQUEST, 2_000, IDS, PDU)
    trace_buffer.show()
    assert HEAD == 21
    written = os.pread(trace_buffer.descriptor, HEAD + 5, PAGE + 16)
    assert written == bytes.fromhex("1A000000 01 FA07000300000000 D007000000000000 0300640002")
    trace_buffer.close()


def test_the_oldest_is_written_over_and_the_rest_stays_whole() -> None:
    trace_buffer = TraceBuffer("x", SMALLEST, 0, 0)
    size = os.fstat(trace_buffer.descriptor).st_size
    in_a_segment = ROOM // (HEAD + 5)
    for number in range(20 * in_a_segment):
        trace_buffer.put(REQUEST, number, IDS, PDU)
    trace_buffer.show()
    reader = RingReader(trace_buffer.descriptor)
    found, is_lost = reader.new()
    # The newest eight segments, the last of them full.
    assert [raw.t for raw in found] == list(range(12 * in_a_segment, 20 * in_a_segment))
    assert not is_lost
    assert os.fstat(trace_buffer.descriptor).st_size == size == PAGE + SMALLEST
    reader.close()
    trace_buffer.close()


def test_who_looks_too_seldom_is_told_that_something_is_lost() -> None:
    trace_buffer = TraceBuffer("x", SMALLEST, 0, 0)
    reader = RingReader(trace_buffer.descriptor)
    in_a_segment = ROOM // (HEAD + 5)
    for number in range(in_a_segment):
        trace_buffer.put(REQUEST, number, IDS, PDU)
    trace_buffer.show()
    assert len(reader.new()[0]) == in_a_segment
    for number in range(SEGMENTS * in_a_segment):
        trace_buffer.put(REQUEST, number, IDS, PDU)
    trace_buffer.show()
    found, is_lost = reader.new()
    assert is_lost
    assert len(found) == SEGMENTS * in_a_segment
    reader.close()
    trace_buffer.close()


def test_who_looks_often_misses_nothing_over_many_turns() -> None:
    trace_buffer = TraceBuffer("x", SMALLEST, 0, 0)
    reader = RingReader(trace_buffer.descriptor)
    found: list[int] = []
    for number in range(5_000):
        trace_buffer.put(REQUEST, number, IDS, PDU * (number % 9))
        if number % 37 == 0:
            trace_buffer.show()
            raws, is_lost = reader.new()
            assert not is_lost
            found += [raw.t for raw in raws]
    trace_buffer.show()
    found += [raw.t for raw in reader.new()[0]]
    assert found[0] == 0
    assert len(found) == 5_000
    assert all(later == earlier + 1 for earlier, later in pairwise(found))
    reader.close()
    trace_buffer.close()


def test_an_entry_that_fits_into_no_segment_is_left_out() -> None:
    trace_buffer = TraceBuffer("x", SMALLEST, 0, 0)
    trace_buffer.put(TEXT, 1, 0, bytes(ROOM - HEAD + 1))
    trace_buffer.put(TEXT, 2, 0, bytes(ROOM - HEAD))
    trace_buffer.show()
    reader = RingReader(trace_buffer.descriptor)
    assert [(raw.t, len(raw.data)) for raw in reader.new()[0]] == [(2, ROOM - HEAD)]
    reader.close()
    trace_buffer.close()


def test_memory_that_is_no_tape_is_told() -> None:
    for size, said in (
        (100, "memory of 100 bytes is not a trace buffer"),
        (PAGE + SMALLEST, "of this release"),
    ):
        other = os.memfd_create("other")
        os.ftruncate(other, size)
        with pytest.raises(NoTraceBufferError, match=said):
            RingReader(other)
        os.close(other)


def test_the_tape_of_a_relay_of_1_0_0_is_looked_into_too() -> None:
    trace_buffer = TraceBuffer("x", SMALLEST, 0, 0)
    control = b'{"kind":"control","line":"x","t":7,"command":"enable","axis":"y"}\n'  # as 1.0.0 wrote it
    trace_buffer.put(TEXT, 7, 0, control)
    trace_buffer.show()
    assert (
        os.pread(trace_buffer.descriptor, 8, 0) == b"pgtape2\n"
    )  # whose commands 1.0.0 would not understand
    before = os.memfd_create("before")
    os.write(before, b"pgtape1\n" + os.pread(trace_buffer.descriptor, SMALLEST + PAGE, 8))
    reader = RingReader(before)
    assert reader.new() == ([Raw(TEXT, 7, 0, control)], False)
    reader.close()
    os.close(before)
    trace_buffer.close()


def test_it_can_be_neither_cut_nor_written_by_who_looks() -> None:
    trace_buffer = TraceBuffer("x", SMALLEST, 0, 0)
    with pytest.raises(OSError, match=r"Invalid argument|Operation not permitted"):
        os.ftruncate(trace_buffer.descriptor, 0)
    with pytest.raises(PermissionError):
        mmap.mmap(trace_buffer.descriptor, PAGE, prot=mmap.PROT_WRITE)
    trace_buffer.close()
