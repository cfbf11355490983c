"""Frames that are sent while they still arrive: bytes in and bytes out with their times, worked out by hand.

A character takes 1 000 ns on either side. The first character of the write of one position ends at 1 000; the
gateway sends it 4 000 later. Three characters are the computed delay (4 characters after its first bit), one
is the margin.
"""

from collections.abc import Callable
from typing import Any

import pytest

from gateway.exchange.axis.impossible import ImpossibleEventError
from gateway.exchange.cut_through.delay import reply_shape, write_shape
from gateway.exchange.cut_through.frame import (
    FORWARD_AFTER,
    ForwardedFrame,
    ForwardEvent,
    ForwardState,
    closed,
    is_fit_head,
)
from gateway.modbus.crc import INVERTED, append_crc, ends_a_frame, is_intact, residue_after
from gateway.modbus.rtu_arrival import Progress, ReplyArrival, RequestArrival
from tests.exchange.cut_bench import (
    ACKNOWLEDGEMENT,
    HEAD,
    LAST,
    PACE,
    READ,
    READ_REPLY,
    RENDERED,
    SENT,
    WRITE,
    Adds,
    acknowledgement,
    assert_spoilt,
    characters,
    play,
    read,
    read_reply,
    write,
)

OUT = [(5000, "01 10 6f 00 00"), (6000, "02"), (7000, "04")]
"""The head of the write, as it leaves."""
DATA = [(11000, "55 55 00 0b")]
CRC = [(13000, "5a 46")]
ABORTED_CRC = "a5 b9"
"""Both bytes of 5A 46 with all bits inverted."""


def test_a_write_is_sent_four_characters_after_it_came() -> None:
    forwarded, judge, events = write()
    assert play(forwarded, characters(WRITE)) == OUT + DATA + CRC
    assert forwarded.left == SENT
    assert events == [ForwardEvent.OPENED, ForwardEvent.FITTED, ForwardEvent.JUDGED, ForwardEvent.COMMITTED]
    assert judge.committed == [(WRITE[:-2], SENT[:-2])]
    # Its last character is off the wire at 5 000 + 13 000; it came in until 13 000.
    assert forwarded.empty_ns == 18000


def test_a_read_is_sent_as_it_comes_and_its_check_sum_once_it_is_known_to_be_good() -> None:
    forwarded, judge, _ = read()
    assert play(forwarded, characters(READ)) == [
        (3000, "01 03 02"),
        (4000, "00"),
        (5000, "00"),
        (6000, "03"),
        (8000, READ[-2:].hex(" ")),
    ]
    assert judge.committed == [(READ[:-2], READ[:-2])]


def test_the_positions_of_a_reply_are_converted_back_when_they_are_whole() -> None:
    forwarded, _, events = read_reply(counts=-3)
    assert (
        play(forwarded, characters(READ_REPLY))
        == [
            (5000, "01 03 06"),
            (7000, "00 00 0f fd"),  # 0x1000 − 3
            (8000, "00"),
            (9000, "07"),
            (11000, append_crc(bytes.fromhex("01 03 06 00 00 0F FD 00 07"))[-2:].hex(" ")),
        ]
    )
    assert events == [ForwardEvent.OPENED, ForwardEvent.FITTED, ForwardEvent.JUDGED, ForwardEvent.COMMITTED]


def test_an_acknowledgement_is_sent_two_characters_after_it_came() -> None:
    forwarded, _, _ = acknowledgement()
    left = play(forwarded, characters(ACKNOWLEDGEMENT))
    assert [when for when, _ in left] == [3000, 4000, 5000, 6000, 8000]
    assert forwarded.left == ACKNOWLEDGEMENT


def test_a_frame_that_comes_whole_before_its_delay_is_over_is_stored() -> None:
    forwarded, judge, events = write(stall_ns=4000)
    assert play(forwarded, [(1000, WRITE[:9]), (4000, WRITE[9:])], 20000) == []
    assert (forwarded.state, events, judge.committed) == (ForwardState.STORED, [ForwardEvent.KEPT], [])
    assert forwarded.arrival.progress is Progress.GOOD


def test_a_frame_that_pauses_before_forwarding_begins_is_stored() -> None:
    # Two bytes do not say yet what it is. When more come its delay is over: it counts from the first of them.
    forwarded, _, events = write()
    pieces = [(1000, WRITE[:2]), (90000, WRITE[2:9]), (91000, WRITE[9:11]), (92000, WRITE[11:])]
    assert play(forwarded, pieces, 99000) == []
    assert (forwarded.state, events) == (ForwardState.STORED, [ForwardEvent.STALLED])
    assert forwarded.arrival.progress is Progress.GOOD


def test_the_bytes_of_lumps_are_sent_when_the_delay_is_over() -> None:
    forwarded, _, _ = write(stall_ns=4000)
    assert play(forwarded, [(1000, WRITE[:4]), (4500, WRITE[4:9]), (8000, WRITE[9:])]) == [
        (5000, HEAD.hex(" ")),
        (8000, (RENDERED + SENT[-2:]).hex(" ")),
    ]
    assert forwarded.state is ForwardState.WHOLE


def test_data_is_sent_when_the_position_is_whole_and_words_after_it_as_they_come() -> None:
    shape = write_shape(4, 1, 2)
    head = bytes.fromhex("01 10 6F 00 00 04 08")
    frame = append_crc(head + bytes.fromhex("11 11 00 00 00 20 22 22"))
    forwarded, _, _ = write(shape=shape, expected=frame[:-2], delay_ns=6000)
    assert play(forwarded, characters(frame)) == [
        (7000, head.hex(" ")),
        (13000, "11 11 00 00 00 23"),
        (14000, "22"),
        (15000, "22"),
        (17000, append_crc(head + bytes.fromhex("11 11 00 00 00 23 22 22"))[-2:].hex(" ")),
    ]


# --- the first byte of a position, before the last one has come ------------------------------------------


def early(counts: int = 3, last: str = "55 55 00 05") -> tuple[ForwardedFrame, Adds, list[ForwardEvent]]:
    """Return a write whose position may be sent from its third byte on."""
    return write(
        shape=write_shape(2, 0, 2, is_early=True),
        expected=HEAD + bytes.fromhex(last),
        delay_ns=3000,
        counts=counts,
    )


EARLY = [(4000, "01 10 6f 00"), (5000, "00"), (6000, "02"), (7000, "04")]
"""The head of the write, as it leaves: three bytes of it have come at 3 000, the first one at 1 000."""


def test_a_write_whose_first_byte_is_decided_by_the_third_is_sent_three_characters_after_it_came() -> None:
    forwarded, judge, events = early()
    assert play(forwarded, characters(WRITE)) == [*EARLY, (10000, "55"), (11000, "55 00 0b"), *CRC]
    assert forwarded.left == SENT
    assert events == [ForwardEvent.OPENED, ForwardEvent.FITTED, ForwardEvent.JUDGED, ForwardEvent.COMMITTED]
    assert judge.committed == [(WRITE[:-2], SENT[:-2])]


@pytest.mark.parametrize(
    ("data", "counts", "last"),
    [
        ("00 FF FF 08", 3, "00 FF FF 00"),  # 00FFFF00 … 00FFFFFF and 3: 01000002 begins with another byte
        ("00 00 00 08", -3, "00 00 00 05"),  # 00000000 less 3 is FFFFFFFD
        ("FF FF FF 08", 3, "FF FD FF 00"),
        ("7F FF FF 08", 3, "7F FD FF 00"),
        ("56 55 00 08", 3, "55 55 00 05"),  # decided, but not what a filled-up frame would go on with
        ("55 00 00 08", -9, "55 55 00 05"),
    ],
)
def test_a_first_byte_that_is_not_decided_or_differs_waits_for_the_last(
    data: str, counts: int, last: str
) -> None:
    frame = append_crc(HEAD + bytes.fromhex(data))
    forwarded, _, events = early(counts, last)
    # What has left is off the wire at 11 000, and half a character before nothing follows it: filled up.
    filled = bytes.fromhex(last) + filled_crc(HEAD + bytes.fromhex(last))
    assert play(forwarded, characters(frame)) == [*EARLY, (10500, filled.hex(" "))]
    assert (forwarded.state, events[-1]) == (ForwardState.ABORTED, ForwardEvent.STALLED)
    assert forwarded.arrival.progress is Progress.GOOD
    # Where the last byte comes with the one before it nothing has to be known of either.
    forwarded, _, events = early(counts, last)
    came = characters(frame)
    play(forwarded, [*came[:9], (10400, frame[9:11]), (11400, frame[11:12]), (12400, frame[12:])])
    raw = (int.from_bytes(frame[7:11], "big") + counts) % 2**32
    assert (forwarded.state, forwarded.left) == (
        ForwardState.WHOLE,
        append_crc(HEAD + raw.to_bytes(4, "big")),
    )


@pytest.mark.parametrize(("counts", "data"), [(0xFF, "55 FF FF 01"), (-0x100, "55 00 00 FF")])
def test_a_position_is_spoilt_if_its_first_byte_was_sent_differently(counts: int, data: str) -> None:
    """The correction changes between the third and the last byte, so that it carries into the first."""
    frame = append_crc(HEAD + bytes.fromhex(data))
    forwarded, judge, events = early(0)
    came = characters(frame)
    assert play(forwarded, came[:10])[-1] == (10000, "55")
    judge.counts = counts
    left = play(forwarded, came[10:])
    assert left == [(11000, (LAST[8:] + filled_crc(LAST)).hex(" "))]
    assert (forwarded.state, events[-1], judge.committed) == (ForwardState.ABORTED, ForwardEvent.CHANGED, [])
    assert forwarded.left[:-2] == LAST  # what the drive holds


@pytest.mark.parametrize(
    "why", [ForwardEvent.OVERTAKEN, ForwardEvent.GONE, ForwardEvent.ANEW, ForwardEvent.MET]
)
def test_a_frame_ended_after_the_first_byte_of_its_position_is_filled_with_the_words_in_the_drive(
    why: ForwardEvent,
) -> None:
    forwarded, _, _ = early()
    play(forwarded, characters(WRITE[:10]))
    assert len(forwarded.left) == 8
    assert forwarded.go_on(why, 10400) == LAST[8:] + filled_crc(LAST)
    assert (forwarded.left[:-2], forwarded.state) == (LAST, ForwardState.ABORTED)


def test_a_silence_after_the_first_byte_of_a_position_fills_the_frame_up() -> None:
    forwarded, _, events = early()
    # Eight bytes from 4 000 on are off the wire at 12 000; a character's pause ends at 11 500, the same.
    assert play(forwarded, characters(WRITE[:10]), 40000)[-1] == (
        11500,
        (LAST[8:] + filled_crc(LAST)).hex(" "),
    )
    assert (forwarded.state, events[-1]) == (ForwardState.ABORTED, ForwardEvent.STALLED)


def test_sending_of_each_position_of_a_reply_begins_before_it_is_whole() -> None:
    shape = reply_shape(5, [(0, 2), (3, 2)], [0, 3])
    asked, head = bytes.fromhex("03 02 00 00 05"), bytes.fromhex("01 03 0A")
    frame = append_crc(head + bytes.fromhex("00 00 10 00 00 07 00 FE FF FF"))
    expected = head + bytes.fromhex("00 00 20 00 00 06 00 FE 00 00")
    judge = Adds(shape=shape, expected=expected, head_bytes=3, delay_ns=3000, counts=-3)
    forwarded = ForwardedFrame(ReplyArrival(1, asked), judge, PACE)
    assert (
        play(forwarded, characters(frame))
        == [
            (4000, "01 03 0a"),
            (6000, "00"),
            (7000, "00 0f fd"),  # 0x1000 − 3
            (8000, "00"),
            (9000, "07"),
            (12000, "00"),
            (13000, "fe ff fc"),
            (15000, append_crc(head + bytes.fromhex("00 00 0F FD 00 07 00 FE FF FC"))[-2:].hex(" ")),
        ]
    )


def test_a_first_byte_with_which_a_frame_would_end_waits_for_the_next_one() -> None:
    for address in range(0x10000):
        head = b"\x01\x10" + address.to_bytes(2, "big") + b"\x00\x02\x04"
        if is_fit_head(head) and ends_a_frame(residue_after(head + b"\x55")):
            break
    frame = append_crc(head + WRITE[7:11])
    shape = write_shape(2, 0, 2, is_early=True)
    forwarded, _, _ = write(shape=shape, expected=head + LAST[7:], delay_ns=4000)
    left = play(forwarded, characters(frame))
    assert left[-2:] == [(11000, "55 55 00 0b"), (13000, forwarded.left[-2:].hex(" "))]
    assert forwarded.state is ForwardState.WHOLE


# --- every way in which a frame ends otherwise ----------------------------------------------------------


def test_w3_a_bad_check_sum_at_the_end_is_passed_on_as_one_that_is_bad_in_both_bytes() -> None:
    forwarded, judge, events = write()
    damaged = WRITE[:-1] + bytes((WRITE[-1] ^ 0x10,))
    assert play(forwarded, characters(damaged)) == [*OUT, *DATA, (13000, ABORTED_CRC)]
    assert (forwarded.state, events[-1], judge.committed) == (ForwardState.ABORTED, ForwardEvent.BAD, [])


def test_a_silence_in_the_middle_fills_the_frame_up_with_the_words_in_the_drive() -> None:
    forwarded, _, events = write()
    # Nine characters, then nothing: 1.5 characters after the ninth.
    assert play(forwarded, characters(WRITE[:9]), 40000) == [
        *OUT,
        (10500, (LAST[7:] + filled_crc(LAST)).hex(" ")),
    ]
    assert (forwarded.state, events[-1]) == (ForwardState.ABORTED, ForwardEvent.STALLED)
    assert forwarded.left[:-2] == LAST


def test_a_frame_that_broke_off_before_its_delay_is_over_is_not_forwarded() -> None:
    # Three bytes came at 1 000: 1.5 characters later, at 2 500, no more of it comes. Its delay ends at 3 000.
    forwarded, _, events = read()
    assert play(forwarded, [(1000, READ[:3])], 40000) == []
    assert (forwarded.state, events) == (ForwardState.STORED, [ForwardEvent.STALLED])


def filled_crc(body: bytes) -> bytes:
    residue = residue_after(body) ^ 0xFFFF
    return bytes((residue & 0xFF, residue >> 8))


def test_the_frame_is_filled_up_before_the_transmitter_runs_empty() -> None:
    # The delay of a port that lied: seven characters of the head have left by 5 000 and last until 12 000.
    forwarded, _, events = write(stall_ns=60000)
    assert play(forwarded, [(1000, WRITE[:7])], 40000) == [
        (5000, HEAD.hex(" ")),
        (11500, (LAST[7:] + filled_crc(LAST)).hex(" ")),
    ]
    assert events[-1] is ForwardEvent.STALLED


def test_bytes_that_come_too_late_do_not_mend_a_frame_that_was_due_to_be_filled() -> None:
    forwarded, _, _ = write()
    play(forwarded, characters(WRITE[:9]))
    # Nobody called at 10 500: the rest comes first.
    assert forwarded.feed(WRITE[9:], 10600) == LAST[7:] + filled_crc(LAST)
    assert forwarded.state is ForwardState.ABORTED
    assert forwarded.arrival.progress is Progress.GOOD  # and may go the usual way


def test_a_refused_write_is_spoilt_before_any_of_its_data_is_sent() -> None:
    position = b"\x7f\xff\xff\xff"
    forwarded, _, events = write(refused=frozenset({position}))
    assert play(forwarded, characters(append_crc(HEAD + position))) == [
        *OUT,
        (11000, (LAST[7:] + filled_crc(LAST)).hex(" ")),
    ]
    assert events == [ForwardEvent.OPENED, ForwardEvent.FITTED, ForwardEvent.REFUSED]


def test_a_head_that_continues_unexpectedly_is_filled_up_as_expected() -> None:
    forwarded, _, events = write()
    other = append_crc(bytes.fromhex("01 10 6F 00 00 03 06 55 55 00 08 00 00"))
    # The length is known with the seventh byte; the sixth has left as it came.
    body = bytes.fromhex("01 10 6F 00 00 03") + LAST[6:]
    assert play(forwarded, characters(other)) == [
        (5000, "01 10 6f 00 00"),
        (6000, "03"),
        (7000, (LAST[6:] + filled_crc(body)).hex(" ")),
    ]
    assert events == [ForwardEvent.OPENED, ForwardEvent.UNFIT]
    assert forwarded.arrival.progress is Progress.GOOD


@pytest.mark.parametrize(
    ("frame", "delay_ns", "changes"),
    [
        (append_crc(bytes.fromhex("01 10 6F 00 00 02 06 55 55 00 08 00 00")), 6_500, {"head_bytes": 6}),
        (WRITE, 10_500, {"refused": frozenset({WRITE[7:11]})}),
    ],
    ids=["another length", "a refused position"],
)
def test_a_frame_known_to_be_wrong_before_its_first_byte_is_sent_is_stored(
    frame: bytes, delay_ns: int, changes: dict[str, Any]
) -> None:
    """Its head is complete with its seventh byte, its position with the eleventh: both before the delay."""
    forwarded, _, events = write(delay_ns=delay_ns, **changes)
    assert play(forwarded, characters(frame), 40_000) == []
    assert (forwarded.state, events) == (ForwardState.STORED, [ForwardEvent.KEPT])


def test_a_stop_spoils_a_forwarded_frame_immediately() -> None:
    forwarded, _, events = write()
    play(forwarded, characters(WRITE[:6]))
    assert forwarded.go_on(ForwardEvent.OVERTAKEN, 6400) == LAST[6:] + filled_crc(LAST)
    assert (forwarded.state, events[-1]) == (ForwardState.ABORTED, ForwardEvent.OVERTAKEN)
    assert forwarded.feed(WRITE[6:], 13000) == b""
    assert forwarded.arrival.progress is Progress.GOOD


def test_a_request_with_another_one_behind_it_in_the_same_read_is_given_up() -> None:
    forwarded, judge, events = write()
    play(forwarded, characters(WRITE[:12]))
    assert forwarded.feed(WRITE[12:] + READ, 13000).hex(" ") == ABORTED_CRC
    assert (events[-1], judge.committed) == (ForwardEvent.ANEW, [])


def test_a_frame_whose_target_has_changed_since_its_judgement_gets_no_check_sum() -> None:
    forwarded, _, events = write(agrees=False)
    assert play(forwarded, characters(WRITE)) == [*OUT, *DATA, (13000, ABORTED_CRC)]
    assert events[-1] is ForwardEvent.CHANGED


def test_a_lost_wire_ends_forwarding_and_nothing_more_is_sent() -> None:
    forwarded, _, _ = write()
    play(forwarded, characters(WRITE[:6]))
    assert forwarded.go_on(ForwardEvent.LOST, 6400) == b""
    assert forwarded.state is ForwardState.BROKEN
    assert play(forwarded, [(7000, WRITE[6:])], 90000) == []


@pytest.mark.parametrize(
    ("reply", "left"),
    [
        ("01 83 02 C0 F1", ""),  # an exception: nothing has left by then
        ("01 03 08 00 00", ""),  # another number of bytes than were asked for
    ],
)
def test_w4_replies_that_do_not_match_the_request_are_stored(reply: str, left: str) -> None:
    forwarded, _, _ = read_reply(delay_ns=0)
    assert play(forwarded, characters(bytes.fromhex(reply))) == []
    assert (forwarded.state, forwarded.left.hex(" ")) == (ForwardState.STORED, left)


# --- seams ------------------------------------------------------------------------------------------------


def test_the_last_byte_of_a_piece_that_is_a_frame_by_itself_waits_for_the_one_behind_it() -> None:
    # A position whose low word is the check sum of what stands before it: with its last byte the frame so far
    # is intact, so that this byte waits for the check sum behind it.
    words = bytes.fromhex("12 34")
    position = words + residue_after(HEAD + words).to_bytes(2, "little")
    assert is_intact(HEAD + position)
    forwarded, _, _ = write(counts=0)
    frame = append_crc(HEAD + position)
    left = play(forwarded, characters(frame))
    assert left == [*OUT, (11000, position[:3].hex(" ")), (13000, (position[3:] + frame[-2:]).hex(" "))]
    aborted, _, _ = write(counts=0)
    damaged = frame[:-1] + bytes((frame[-1] ^ 1,))
    play(aborted, characters(damaged))
    # In the place of the byte that waited stands that of the last one: 05.
    assert aborted.left[:-2] == HEAD + position[:3] + b"\x05"
    assert residue_after(aborted.left) == INVERTED


def test_a_head_is_unfit_if_a_part_of_it_ends_a_frame() -> None:
    assert is_fit_head(HEAD)
    # 01EC: of unit id 1 the first four bytes are a frame. 56F9: they are a seam.
    for address in ("01 EC", "56 F9", "32 FB", "CA 98", "51 20", "FF 6B", "14 D4"):
        assert not is_fit_head(bytes.fromhex(f"01 10 {address} 00 02 04"))


def test_the_filling_never_ends_a_frame() -> None:
    # With the check sum of the head as filler it would be intact in its middle: the second byte is changed.
    filler = residue_after(HEAD).to_bytes(2, "little") + b"\x00\x00"
    filling = closed(HEAD, filler)
    assert filling[:1] == filler[:1]
    assert filling[1] == filler[1] ^ 1
    assert residue_after(HEAD + filling) == INVERTED


# --- the table ----------------------------------------------------------------------------------------------

OUTSIDE = "stalled overtaken anew met gone"
"""What its owner, or time, ends a frame with."""
TABLE: dict[ForwardState, dict[str | None, str]] = {
    ForwardState.BEGUN: {"head": "opened", "stored": OUTSIDE + " kept lost"},
    ForwardState.HEAD: {"leaving": "fitted", "spoilt": OUTSIDE + " unfit", "broken": "lost"},
    ForwardState.LEAVING: {
        "leaving": "judged",
        "whole": "committed",
        "spoilt": OUTSIDE + " refused changed bad",
        "broken": "lost",
    },
    ForwardState.STORED: {None: OUTSIDE + " lost"},
    ForwardState.WHOLE: {None: OUTSIDE + " lost"},
    ForwardState.ABORTED: {None: OUTSIDE + " lost"},
    ForwardState.BROKEN: {None: OUTSIDE + " lost"},
}
"""State → where to → by what. None: nothing happens. What is not there cannot be."""


def test_the_table_of_states_is_the_one_worked_out_by_hand() -> None:
    meant = {
        state: {
            ForwardEvent(event): None if after is None else ForwardState(after)
            for after, events in rows.items()
            for event in events.split()
        }
        for state, rows in TABLE.items()
    }
    assert {state: dict(rows) for state, rows in FORWARD_AFTER.items()} == meant


def in_state(state: ForwardState, on_fault: Callable[[str], None] = lambda _sentence: None) -> ForwardedFrame:
    """Return a write in the named state."""
    forwarded = ForwardedFrame(RequestArrival(), Adds(), PACE, on_fault=on_fault)
    if state is ForwardState.STORED:
        forwarded.go_on(ForwardEvent.GONE, 0)
        return forwarded
    bytes_of = {ForwardState.BEGUN: 4, ForwardState.HEAD: 6, ForwardState.LEAVING: 8, ForwardState.WHOLE: 13}
    play(forwarded, characters(WRITE[: bytes_of.get(state, 6)]))
    if state is ForwardState.ABORTED:
        forwarded.go_on(ForwardEvent.GONE, 6000)
    elif state is ForwardState.BROKEN:
        forwarded.go_on(ForwardEvent.LOST, 6000)
    assert forwarded.state is state
    return forwarded


ENDS = [ForwardEvent(each) for each in OUTSIDE.split()]


@pytest.mark.parametrize("why", [*ENDS, ForwardEvent.LOST])
@pytest.mark.parametrize("state", list(ForwardState))
def test_each_end_is_right_in_each_state(state: ForwardState, why: ForwardEvent) -> None:
    forwarded = in_state(state)
    before = forwarded.left
    filling = forwarded.go_on(why, 8100)
    if state not in (ForwardState.HEAD, ForwardState.LEAVING):
        assert (filling, forwarded.left) == (b"", before)
        assert forwarded.state is (ForwardState.STORED if state is ForwardState.BEGUN else state)
    elif why is ForwardEvent.LOST:
        assert (filling, forwarded.left, forwarded.state) == (b"", before, ForwardState.BROKEN)
    else:
        assert forwarded.left == before + filling
        assert_spoilt(forwarded)
    assert forwarded.is_over
    assert forwarded.deadline_ns is None
    # Whatever comes from now on, nothing more leaves.
    assert play(forwarded, [(9000, WRITE), (20000, WRITE)], 90000) == []


IMPOSSIBLE = [
    (state, event) for state in ForwardState for event in ForwardEvent if event not in FORWARD_AFTER[state]
]


@pytest.mark.parametrize(("state", "event"), IMPOSSIBLE)
def test_an_impossible_event_raises_an_error_in_a_test(state: ForwardState, event: ForwardEvent) -> None:
    forwarded = in_state(state)
    with pytest.raises(ImpossibleEventError, match=f"cut-through: {event.value} cannot be in {state.value}"):
        forwarded.go_on(event, 8100)


@pytest.mark.parametrize(("state", "event"), IMPOSSIBLE)
@pytest.mark.usefixtures("in_production")
def test_an_impossible_event_is_reported_in_production_and_spoils_the_frame(
    state: ForwardState, event: ForwardEvent
) -> None:
    told: list[str] = []
    forwarded = in_state(state, told.append)
    before = forwarded.left
    filling = forwarded.go_on(event, 8100)
    assert told == [f"cut-through: {event.value} cannot be in {state.value}"]
    assert (forwarded.left, forwarded.is_over) == (before + filling, True)
    if state in (ForwardState.HEAD, ForwardState.LEAVING):
        assert_spoilt(forwarded)
    else:
        assert (filling, forwarded.state) == (
            b"",
            ForwardState.STORED if state is ForwardState.BEGUN else state,
        )


@pytest.mark.parametrize(
    ("came", "written_ns", "needed_ns"),
    [
        # Its first byte came at 1 000. Byte 7 is the first of the position, byte 11 that of the check sum:
        # 11 000 − 7 characters, and 13 000 − 11, since 1 000.
        ({5: 5000, 7: 7000, 11: 11_000, 13: 13_000}, [5000, 7000, 11_000, 13_000], 3000),
        ({5: 5000, 7: 7000, 11: 11_000, 13: 13_000}, [5000, 7000, 12_000, 13_000], 4000),
        # Twice empty, for 2 000 and for 1 000: 19 000 − 11 characters, since 1 000.
        ({5: 5000, 7: 7000, 11: 11_000, 13: 13_000}, [5000, 7000, 14_000, 19_000], 7000),
        # The process stood still before the first bytes were written; all others were in time.
        ({5: 5000, 9: 9000, 11: 11_000, 13: 13_000}, [9000, 9000, 11_000, 13_000], 3000),
        # Nobody looked at 5 000, and all left in one when the rest had come.
        ({4: 4000, 13: 5200}, [5200], 0),
        ({4: 4000, 13: 5200}, [9200], 0),
    ],
)
def test_how_late_a_frame_should_have_begun(
    came: dict[int, int], written_ns: list[int], needed_ns: int
) -> None:
    forwarded, _, _ = write(stall_ns=99_000)
    forwarded.feed(WRITE[:1], 1000)
    so_far, times = 1, iter(written_ns)
    for count, now_ns in came.items():
        left = forwarded.feed(WRITE[so_far:count], now_ns)
        so_far = count
        if left:
            until_ns = next(times)
            forwarded.written(len(left), until_ns, until_ns)
    assert (forwarded.state, forwarded.left, next(times, None)) == (ForwardState.WHOLE, SENT, None)
    assert forwarded.written_need_ns == needed_ns
