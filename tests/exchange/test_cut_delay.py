"""When the first byte of a forwarded frame is sent: in characters, and by measured delays."""

from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.exchange.cut_through.delay import (
    LEARNED_AFTER,
    REMEMBERED,
    FrameShape,
    MeasuredDelay,
    Piece,
    acknowledgement_shape,
    delay_ns,
    margin_ns,
    needed_ns,
    read_shape,
    reply_shape,
    stored_ns,
    write_shape,
)
from gateway.modbus.crc import ends_a_frame, residue_after

WRITE = write_shape(2, 0, 2)
EARLY_WRITE = write_shape(2, 0, 2, is_early=True)
ACKNOWLEDGEMENT = acknowledgement_shape()
READ = read_shape()
POSITION = reply_shape(2, [(0, 2)])
POSITION_AND_STATUS = reply_shape(3, [(0, 2)])
EARLY_POSITION = reply_shape(2, [(0, 2)], [0])
EARLY_POSITION_AND_STATUS = reply_shape(3, [(0, 2)], [0])
STATUS = reply_shape(1)

CHAR_9600 = 11 * 1_000_000_000 // 9600
CHAR_38400 = 11 * 1_000_000_000 // 38400
MS = 1_000_000


def test_shapes_are_as_long_as_their_frames() -> None:
    assert (WRITE.length, ACKNOWLEDGEMENT.length, READ.length) == (13, 8, 8)
    assert (POSITION.length, POSITION_AND_STATUS.length, STATUS.length) == (9, 11, 7)


def test_which_byte_waits_for_which_in_a_block_with_a_position_in_its_middle() -> None:
    # 01 10 addr addr count count bytes | w0 w0 | pp pp pp pp | w3 w3 | crc crc: no data before the position.
    shape = write_shape(4, 1, 2)
    assert [shape.needs(index) for index in range(17)] == [4, 4, 4, 4, 5, 6, 7, *[13] * 6, 14, 15, 17, 17]


def test_which_byte_waits_for_which_in_a_reply_with_two_positions() -> None:
    # 01 03 bytes | ss ss | pp pp pp pp | pp pp pp pp | crc crc
    shape = reply_shape(5, [(1, 2), (3, 2)])
    assert [shape.needs(index) for index in range(15)] == [3, 3, 3, 4, 5, *[9] * 4, *[13] * 4, 15, 15]


def test_which_byte_waits_for_which_if_a_position_is_sent_before_it_is_whole() -> None:
    # 01 10 addr | addr count count bytes | p | p p p | w2 w2 | crc crc: the first byte of the position with
    # the third, what is behind it when it is whole.
    shape = write_shape(3, 0, 2, is_early=True)
    needs = [3, 3, 3, 4, 5, 6, 7, 10, 11, 11, 11, 12, 13, 15, 15]
    assert [shape.needs(index) for index in range(15)] == needs
    # 01 03 bytes | ss ss | p | p p p | q q q q | crc crc: of the second one the lowest word comes first.
    reply = reply_shape(5, [(1, 2), (3, 2)], [1])
    assert [reply.needs(index) for index in range(15)] == [3, 3, 3, 4, 5, 8, 9, 9, 9, *[13] * 4, 15, 15]
    assert (shape.late, reply.late) == (write_shape(3, 0, 2), reply_shape(5, [(1, 2), (3, 2)]))
    assert (write_shape(3, 0, 2).late, reply_shape(5, [(1, 2)]).late) == (None, None)


@pytest.mark.parametrize(
    ("shape", "characters"),
    [
        (WRITE, 4),  # byte 7 leaves when 11 have come
        (EARLY_WRITE, 3),  # byte 7 when 10 have, byte 8 when 11, byte 0 when 3
        (EARLY_POSITION, 3),  # byte 3 when 6 have, byte 4 when 7, byte 0 when 3
        (EARLY_POSITION_AND_STATUS, 3),
        (write_shape(4, 1, 2), 6),  # byte 7 when 13 have
        (ACKNOWLEDGEMENT, 2),  # the check sum: byte 6 when 8 have
        (READ, 2),
        (POSITION, 4),  # byte 3 when 7 have
        (reply_shape(3, [(1, 2)]), 4),  # byte 5 when 9 have
        (reply_shape(2, [(0, 1)]), 3),  # nothing before the byte count
        (STATUS, 3),
    ],
)
def test_delays_in_characters_if_both_baud_rates_are_equal(shape: FrameShape, characters: int) -> None:
    assert delay_ns(shape, CHAR_9600, CHAR_9600) == characters * CHAR_9600


def test_the_share_of_a_round_trip_that_is_added() -> None:
    # 6 of 21 characters for a write, 6 of 17 for a read of a position, 6 of 19 with its status beside it;
    # and 5 where the first byte of the position leaves with the third.
    for request, reply, whole, characters in (
        (WRITE, ACKNOWLEDGEMENT, 21, 6),
        (READ, POSITION, 17, 6),
        (READ, POSITION_AND_STATUS, 19, 6),
        (EARLY_WRITE, ACKNOWLEDGEMENT, 21, 5),
        (READ, EARLY_POSITION, 17, 5),
        (READ, EARLY_POSITION_AND_STATUS, 19, 5),
    ):
        added_ns = delay_ns(request, CHAR_9600, CHAR_9600) + delay_ns(reply, CHAR_9600, CHAR_9600)
        direct_ns = (request.length + reply.length) * CHAR_9600
        assert added_ns * whole == characters * direct_ns
        assert stored_ns(request, CHAR_9600) + stored_ns(reply, CHAR_9600) == direct_ns
    assert round(6 / 21, 2) == 0.29


@pytest.mark.parametrize(
    ("in_characters", "out_characters", "delay"),
    [
        # in units of the faster wire's character; the write needs [4, 4, 4, 4, 5, 6, 7, 11 …, 13, 13]
        (1, 2, 4),  # a slow wire behind a fast one: the head is all that is waited for
        (2, 1, 15),  # the other way: 11 × 2 − 7 = 15, and 13 × 2 − 11 = 15, of 26 that storing takes
        (12, 1, 145),  # 9 600 behind 115 200: 13 × 12 − 11, of 156
    ],
)
def test_delays_if_baud_rates_differ(in_characters: int, out_characters: int, delay: int) -> None:
    assert delay_ns(WRITE, in_characters, out_characters) == delay
    assert delay < stored_ns(WRITE, in_characters)


def block_shape(before: int, behind: int) -> FrameShape:
    """A write of one position between other registers."""
    return write_shape(before + 2 + behind, before, 2, is_early=not before)


def mixed_shape(has_position: list[bool], are_early: list[bool]) -> FrameShape:
    """A reply in which each item is a position or another register."""
    sizes = [1 + has for has in has_position]
    firsts = accumulate(sizes[:-1], initial=0)
    positions = [(first, 2) for first, size in zip(firsts, sizes, strict=True) if size == 2]
    early = [first for (first, _), is_early in zip(positions, are_early, strict=False) if is_early]
    return reply_shape(sum(sizes), positions, early)


shapes = st.one_of(
    st.just(READ),
    st.builds(block_shape, st.integers(0, 9), st.integers(0, 9)),
    st.builds(
        mixed_shape, st.lists(st.booleans(), min_size=1, max_size=9), st.lists(st.booleans(), max_size=9)
    ),
)


@given(shape=shapes, in_ns=st.integers(1, 100), out_ns=st.integers(1, 100))
def test_cut_through_never_begins_later_than_storing_does(shape: FrameShape, in_ns: int, out_ns: int) -> None:
    assert delay_ns(shape, in_ns, out_ns) <= stored_ns(shape, in_ns)


@given(shape=shapes)
def test_a_byte_may_be_sent_once_the_bytes_that_it_needs_have_come(shape: FrameShape) -> None:
    needs = [shape.needs(index) for index in range(shape.length)]
    assert needs == sorted(needs)
    assert needs[-2:] == [shape.length] * 2
    for come in range(shape.length + 1):
        assert shape.leaves(come) == sum(need <= come for need in needs[:-2])


def pieces_of(lumps: list[tuple[int, int]]) -> list[Piece]:
    """Return pieces from the bytes of each, and the time since the piece before."""
    times = accumulate(wait for wait, _ in lumps)
    counts = accumulate(count for _, count in lumps)
    return [Piece(came, count) for came, count in zip(times, counts, strict=True)]


@given(data=st.data(), shape=shapes, out_ns=st.integers(1, 50))
def test_the_transmitter_runs_empty_only_if_a_frame_begins_sooner_than_its_delay(
    data: st.DataObject, shape: FrameShape, out_ns: int
) -> None:
    cuts = sorted({*data.draw(st.lists(st.integers(1, shape.length - 1), max_size=6)), shape.length})
    counts = [b - a for a, b in zip([0, *cuts], cuts, strict=False)]
    lumps = [(data.draw(st.integers(0, 200)), count) for count in counts]
    pieces = pieces_of(lumps)
    delay = needed_ns(shape, pieces, out_ns)

    def slack(begins_ns: int) -> int:
        """Return the least time between the arrival of a byte and its turn on the wire."""
        return min(
            begins_ns
            + index * out_ns
            - next(each.came_ns for each in pieces if each.so_far >= shape.needs(index))
            for index in range(shape.length)
        )

    begun_ns = pieces[0].came_ns
    assert slack(begun_ns + delay) >= 0
    assert delay == 0 or slack(begun_ns + delay - 1) < 0


def test_the_delay_behind_an_adapter_that_delivers_each_millisecond_at_38400() -> None:
    # A lump leaves 1 ms after its first byte came, and holds 4 characters of 286 µs. The position
    # is whole with the third lump, 8 characters after the first one, and its turn on the wire is 7 characters
    # after the frame began: 1. The check sum comes to the same: 12 − 11.
    pieces = [Piece(first * CHAR_38400 + MS, count) for first, count in ((1, 4), (5, 8), (9, 12), (13, 13))]
    assert needed_ns(WRITE, pieces, CHAR_38400) == CHAR_38400


def steady(count: int, char_ns: int = 1000, late_ns: int = 0) -> list[Piece]:
    return [Piece(index * char_ns + (late_ns if index == 10 else 0), index + 1) for index in range(count)]


def learned(pieces: list[Piece] | None = None) -> MeasuredDelay:
    """Return the measured delay of writes after enough of them, by default byte by byte."""
    delay = MeasuredDelay(WRITE, 1000, 1000, margin_ns=1000)
    for _ in range(LEARNED_AFTER):
        delay.add(pieces or steady(13))
    return delay


def test_nothing_is_known_of_a_port_before_enough_frames_have_come() -> None:
    delay = MeasuredDelay(WRITE, 1000, 1000, margin_ns=1000)
    for _ in range(LEARNED_AFTER - 1):
        delay.add(steady(13))
        assert delay.delay_ns is None
    delay.add(steady(13))
    # Byte by byte the first piece is the first character: 4 − 1 = 3 after it, and one character of margin.
    assert delay.delay_ns == 4000


def test_half_of_the_lateness_of_a_byte_is_remembered_for_a_while() -> None:
    delay = learned()
    delay.add(steady(13, late_ns=900))
    assert delay.delay_ns == 3000 + 900 + 450 + 1000
    for _ in range(REMEMBERED - 1):
        delay.add(steady(13))
    assert delay.delay_ns == 5350
    delay.add(steady(13))
    assert delay.delay_ns == 4000


@pytest.mark.parametrize(
    "late", [{"own_ns": 900}, {"written_need_ns": 3900}, {"own_ns": -50_000, "written_need_ns": 3900}]
)
def test_the_gateways_own_delay_is_remembered_for_a_while(late: dict[str, int]) -> None:
    delay = learned()
    delay.add(steady(13), **late)
    assert delay.delay_ns == 3000 + 900 + 1000
    for _ in range(REMEMBERED - 1):
        delay.add(steady(13), written_need_ns=3000)
    assert delay.delay_ns == 4900
    delay.add(steady(13), written_need_ns=3000)
    assert delay.delay_ns == 4000


def test_a_gateway_that_is_always_too_slow_stores_every_frame() -> None:
    delay = MeasuredDelay(WRITE, 1000, 1000, margin_ns=1000)
    for _ in range(3 * REMEMBERED):
        delay.add(steady(13), own_ns=8000)
        assert delay.delay_ns is None  # 3 + 8 + 1 and the character that is to be gained, of 12


def test_frames_of_a_port_that_delivers_them_whole_are_stored() -> None:
    delay = MeasuredDelay(WRITE, 1000, 1000, margin_ns=1000)
    for _ in range(2 * LEARNED_AFTER):
        delay.add([Piece(0, 13)])
    assert delay.delay_ns is None


def test_a_delay_without_gain_says_when_its_frame_could_begin_and_when_it_is_whole() -> None:
    delay = MeasuredDelay(WRITE, 1000, 1000, margin_ns=1000)
    for _ in range(LEARNED_AFTER - 1):
        delay.add([Piece(0, 13)])
        assert delay.no_gain is None
    delay.add([Piece(0, 13)])
    assert delay.no_gain == (1000, 0)  # with its first piece it is whole, and the margin is waited for
    delay = learned()
    assert delay.no_gain is None


def test_lumps_do_not_prevent_cut_through_while_the_next_wire_is_busy() -> None:
    delay = learned([Piece(0, 9), Piece(5000, 13)])
    # Seven bytes of the head leave at once, for 7 characters; after 5 the rest is there.
    assert delay.delay_ns == 1000


def test_frames_of_a_port_are_stored_while_its_delays_leave_no_gain() -> None:
    delay = learned()
    late = [Piece(each.came_ns + (5000 if each.so_far > 10 else 0), each.so_far) for each in steady(13)]
    delay.add(late)
    assert delay.delay_ns is None  # 3 + 5 + 2.5 + 1 characters, and the others were whole after 12
    for _ in range(REMEMBERED):
        delay.add(steady(13))
    assert delay.delay_ns == 4000


FRAMES = st.integers(0, 2**32 - 1).map(lambda raw: bytes.fromhex("01 10 06 06 00 02 04") + raw.to_bytes(4))


@given(frame=FRAMES, reach=st.integers(0, 2**25))
def test_a_first_byte_is_expected_to_stay_if_no_border_is_within_reach(frame: bytes, reach: int) -> None:
    raw = int.from_bytes(frame[7:])
    # 0 and 2^32 are borders as all other multiples of 2^24; the next one below belongs to the byte itself.
    is_far = raw % 2**24 >= reach and raw % 2**24 + reach < 2**24
    if not ends_a_frame(residue_after(frame[:8])):
        assert EARLY_WRITE.stays(frame, reach) == is_far
    assert WRITE.stays(frame, reach)


def test_a_first_byte_that_ends_a_frame_is_never_expected_to_stay() -> None:
    """One of 65 536 pairs of address and first byte leaves a residue at which no piece ends."""
    found = 0
    for address in range(0x10000):
        frame = b"\x01\x10" + address.to_bytes(2) + bytes.fromhex("00 02 04 00 00 80 00")
        if ends_a_frame(residue_after(frame[:8])):
            found += 1
            assert not EARLY_WRITE.stays(frame, 0)
    assert found == 2  # intact, and a seam


def test_how_far_the_next_position_may_be() -> None:
    def frame(counts: int) -> bytes:
        return bytes.fromhex("01 10 06 06 00 02 04") + (counts % 2**32).to_bytes(4)

    reach = EARLY_WRITE.reach(b"", frame(500), 0)
    assert reach == 2**32  # anywhere
    # From -20 to 30 are 50 counts: twice that, and four times the 256 of a last byte.
    assert EARLY_WRITE.reach(frame(-20), frame(30), reach) == 1124
    assert EARLY_WRITE.reach(frame(30), frame(30), 1124) == 1124 - 70  # a sixteenth of it is forgotten
    assert EARLY_WRITE.reach(frame(30), frame(2030), 1124) == 5024


@pytest.mark.parametrize(
    ("baudrate", "asked", "answered", "share"),
    [
        # Five characters and two margins: 0.3154 of a character at 9 600 Bd, 0.3809 at 19 200,
        # 0.6982 at 38 400.
        (9600, EARLY_WRITE, ACKNOWLEDGEMENT, 0.268),  # 5.6309 of 21
        (9600, READ, EARLY_POSITION_AND_STATUS, 0.296),  # of 19
        (9600, READ, EARLY_POSITION, 0.331),  # of 17
        (19200, EARLY_WRITE, ACKNOWLEDGEMENT, 0.274),  # 5.7618
        (19200, READ, EARLY_POSITION_AND_STATUS, 0.303),
        (38400, EARLY_WRITE, ACKNOWLEDGEMENT, 0.305),  # 6.3964
        (38400, READ, EARLY_POSITION_AND_STATUS, 0.337),
        # Six, where the position has to be whole first.
        (9600, WRITE, ACKNOWLEDGEMENT, 0.316),
        (9600, READ, POSITION_AND_STATUS, 0.349),
        (9600, READ, POSITION, 0.390),
    ],
)
def test_the_share_of_a_round_trip_that_cut_through_adds(
    baudrate: int, asked: FrameShape, answered: FrameShape, share: float
) -> None:
    char_ns = 11 * 1_000_000_000 // baudrate
    added_ns = sum(measured_ns(shape, char_ns, 0) for shape in (asked, answered))
    assert round(added_ns / ((asked.length + answered.length) * char_ns), 3) == share


@pytest.mark.parametrize(
    ("baudrate", "lump_ns", "asked", "answered", "at_most"),
    [
        (9600, 0, WRITE, ACKNOWLEDGEMENT, 0.40),
        (9600, 0, READ, POSITION, 0.40),
        (19200, 0, WRITE, ACKNOWLEDGEMENT, 0.40),
        (19200, 0, READ, POSITION_AND_STATUS, 0.40),
        (38400, MS, EARLY_WRITE, ACKNOWLEDGEMENT, 0.60),
        (38400, MS, READ, EARLY_POSITION_AND_STATUS, 0.60),
        (38400, MS, WRITE, ACKNOWLEDGEMENT, 0.60),
        (38400, MS, READ, POSITION_AND_STATUS, 0.60),
    ],
)
def test_the_added_share_stays_below_its_limit_with_the_margin_of_a_measured_port(
    baudrate: int, lump_ns: int, asked: FrameShape, answered: FrameShape, at_most: float
) -> None:
    char_ns = 11 * 1_000_000_000 // baudrate
    added_ns = sum(measured_ns(shape, char_ns, lump_ns) for shape in (asked, answered))
    assert added_ns / ((asked.length + answered.length) * char_ns) <= at_most


def measured_ns(shape: FrameShape, char_ns: int, lump_ns: int) -> int:
    """Return the delay that the gateway adds: how much later a frame ends after it than before it."""
    pieces: list[Piece] = []
    begun_ns = 0
    for number in range(1, shape.length + 1):
        came_ns = number * char_ns
        if not pieces or came_ns > pieces[-1].came_ns:
            begun_ns = came_ns
            pieces.append(Piece(begun_ns + lump_ns, number))
        pieces[-1] = Piece(pieces[-1].came_ns, number)
    delay = MeasuredDelay(shape, char_ns, char_ns, margin_ns(char_ns))
    for _ in range(LEARNED_AFTER):
        delay.add(pieces)
    assert delay.delay_ns is not None
    return pieces[0].came_ns + delay.delay_ns
