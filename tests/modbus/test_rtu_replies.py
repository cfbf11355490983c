"""Replies from the drives: exceptions of their own kind, noise, echoes, other units, late bytes, odd ones."""

import random

import pytest

from gateway.modbus.crc import append_crc, is_intact
from gateway.modbus.rtu import RtuReplyDecoder, encode_rtu
from tests.modbus.frames import frame_of

MS = 1_000_000
READ = bytes.fromhex("03 02 00 00 02")
REPLY = bytes.fromhex("01 03 04 00 B1 1F 40 A3 D4")
WRITE = bytes.fromhex("06 31 00 00 0F")
ECHO = bytes.fromhex("01 06 31 00 00 0F C7 32")


def expecting(request: bytes, unit_id: int = 1, *, echo: bool = False) -> RtuReplyDecoder:
    decoder = RtuReplyDecoder(silence_ns=2 * MS, give_up_ns=30 * MS, echo=echo)
    decoder.expect(unit_id, request)
    return decoder


@pytest.mark.parametrize(
    ("refused_reads", "functions"),
    [({}, {0x83, 0x81}), ({1: 0}, {0x83}), ({1: 0x81}, {0x83, 0x81}), ({2: 0x81}, {0x83, 0x81})],
)
def test_an_exception_has_the_function_byte_of_its_request_or_the_one_that_the_map_says(
    refused_reads: dict[int, int], functions: set[int]
) -> None:
    # Kinco answers a refused read of holding registers with 0x81
    passed = set()
    for function in range(0x80, 0x100):
        decoder = RtuReplyDecoder(2 * MS, 30 * MS, refused_reads=refused_reads)
        decoder.expect(1, READ)
        if decoder.feed(append_crc(bytes((1, function, 0x02))), 0):
            passed.add(function)
    assert passed == functions


def test_a_late_exception_to_a_read_answers_no_write() -> None:
    write = bytes.fromhex("06 05DC 04D2")
    for late in ("01 83 06", "01 81 06"):
        decoder = expecting(write)
        echo = append_crc(bytes((1,)) + write)
        assert decoder.feed(append_crc(bytes.fromhex(late)) + echo, 0) == [(1, write)]


OWN_2 = append_crc(b"\x02" + REPLY[1:-2])
READ_ECHO = append_crc(b"\x01" + READ)
DIAGNOSTICS = append_crc(bytes.fromhex("01 08 00 00 A5 37 11 22"))


@pytest.mark.parametrize(
    ("unit_id", "request_pdu", "echo", "came", "reply", "counted"),
    [
        *[
            (1, READ, False, wire, wire, (0, 0))
            for code in (0x08, 0x21, 0x27, 0x29, 0xFF)  # a vendor's exception codes are passed on
            for wire in [append_crc(bytes((1, 0x83, code)))]
        ],
        (1, DIAGNOSTICS[1:-2], False, DIAGNOSTICS, DIAGNOSTICS, (0, 0)),  # in its own length
        (2, READ, False, REPLY + OWN_2, OWN_2, (1, 0)),  # a foreign one glued before it
        (1, READ, True, b"\x00" + READ_ECHO + b"\xff" + REPLY, REPLY, (0, 1)),  # an echo behind noise
        (1, READ, True, READ_ECHO[:-1] + b"\x55" + REPLY, REPLY, (0, 0)),  # a damaged echo
    ],
)
def test_the_reply_is_found_in_what_comes(
    *, unit_id: int, request_pdu: bytes, echo: bool, came: bytes, reply: bytes, counted: tuple[int, int]
) -> None:
    decoder = expecting(request_pdu, unit_id, echo=echo)
    assert decoder.feed(came, 0) == [frame_of(reply)]
    assert (decoder.counters.foreign, decoder.counters.echoes) == counted


@pytest.mark.parametrize("data", ["01 03 02 00 B1", "01 03 00 00 B1 1F 40"], ids=["another size", "size 0"])
def test_a_read_reply_of_another_size_waits_for_one_that_fits_and_passes_when_none_comes(data: str) -> None:
    wire = append_crc(bytes.fromhex(data))
    decoder = expecting(READ)
    assert decoder.feed(wire, 0) == []
    assert decoder.deadline_ns == 2 * MS
    assert decoder.on_silence(decoder.deadline_ns) == []
    assert decoder.deadline_ns is not None
    assert decoder.on_silence(decoder.deadline_ns) == [frame_of(wire)]


def test_the_reply_to_another_request_does_not_answer_this_one() -> None:
    late = append_crc(bytes.fromhex("01 03 02 00 B1"))
    fitting = append_crc(bytes.fromhex("01 03 04 00 B1 1F 40"))
    for chunks in ([late, fitting], [late + fitting], [late[:3], late[3:] + fitting[:4], fitting[4:]]):
        decoder = expecting(READ)
        assert [frame for chunk in chunks for frame in decoder.feed(chunk, 0)] == [frame_of(fitting)]


def test_a_whole_frame_that_nobody_asked_for_is_told_from_noise() -> None:
    decoder = RtuReplyDecoder()
    twice = append_crc(bytes.fromhex("01 03 02 00 B1"))
    decoder.feed(b"\xff\x01", 0)
    assert decoder.counters.stray_frames == 0
    decoder = RtuReplyDecoder()
    decoder.feed(twice[:3], 0)
    decoder.feed(twice[3:], 0)
    assert (decoder.counters.stray_frames, decoder.counters.stray_bytes) == (1, 7)


def test_a_valid_check_sum_on_a_shorter_prefix_does_not_end_a_reply() -> None:
    # About one random reply in 230 has such a prefix: taking the first good check sum cuts it.
    generator = random.Random(7)
    trapped = 0
    for _ in range(2000):
        words = generator.randrange(30, 60)
        wire = append_crc(bytes((1, 3, 2 * words)) + generator.randbytes(2 * words))
        if not any(is_intact(wire[:size]) for size in range(5, len(wire))):
            continue
        trapped += 1
        for size in range(1, len(wire)):
            decoder = expecting(bytes((3, 0, 0, 0, words)))
            early = decoder.feed(wire[:size], 0) + decoder.on_silence(2 * MS)
            assert early == []
            assert decoder.feed(wire[size:], 10 * MS) == [frame_of(wire)]
    assert trapped >= 3


def test_a_reply_of_another_unit_is_dropped_and_counted() -> None:
    decoder = expecting(READ, unit_id=2)
    wire = append_crc(b"\x02" + REPLY[1:-2])
    assert decoder.feed(REPLY, 0) == []
    assert decoder.counters.foreign == 1
    assert decoder.is_expecting
    assert decoder.feed(wire, 1) == [frame_of(wire)]
    assert decoder.counters.dropped_bytes == 0


def test_a_reply_to_another_function_is_no_reply() -> None:
    decoder = expecting(READ)
    assert decoder.feed(ECHO, 0) == []
    assert decoder.counters.foreign == 1
    assert decoder.feed(REPLY, 1) == [frame_of(REPLY)]


def test_a_corrupt_reply_does_not_come_out() -> None:
    decoder = expecting(READ)
    assert decoder.feed(REPLY[:5] + b"\x00" + REPLY[6:], 0) == []
    assert decoder.on_silence(2 * MS) == []
    assert decoder.on_silence(30 * MS) == []
    assert (decoder.counters.crc_errors, decoder.counters.dropped_bytes) == (1, 9)
    assert decoder.is_expecting


def test_usb_pauses_inside_a_reply_do_not_break_it() -> None:
    decoder = expecting(READ)
    decoder.feed(REPLY[:3], 0)
    assert decoder.on_silence(2 * MS) == []
    assert decoder.feed(REPLY[3:], 16 * MS) == [frame_of(REPLY)]
    assert decoder.deadline_ns is None


def test_noise_that_looks_like_the_beginning_is_passed_at_silence() -> None:
    # "01 03 F0" announces 245 bytes
    decoder = expecting(READ)
    assert decoder.feed(b"\x01\x03\xf0" + REPLY, 0) == []
    assert decoder.on_silence(2 * MS) == [frame_of(REPLY)]
    assert decoder.counters.dropped_bytes == 3


def test_an_unknown_function_ends_by_silence_that_every_byte_puts_off() -> None:
    request = bytes.fromhex("2B 0D 00 00 00 60 41 00 00 00 02")
    wire = append_crc(b"\x01\x2b\x0d" + bytes(range(120)))
    decoder = expecting(request)
    for at in range(len(wire)):
        assert decoder.feed(wire[at : at + 1], at * MS) == []
        assert decoder.deadline_ns == (at + 2) * MS
        assert decoder.on_silence((at + 1) * MS) == []
    assert decoder.on_silence((len(wire) + 2) * MS) == [frame_of(wire)]


def test_an_unknown_function_behind_noise_is_found() -> None:
    decoder = expecting(b"\x41\x01")
    wire = append_crc(bytes.fromhex("01 41 AA BB CC"))
    decoder.feed(b"\x00\xff" + wire, 0)
    assert decoder.on_silence(2 * MS) == [frame_of(wire)]


@pytest.mark.parametrize("pieces", [1, 2, 3, 5, 99])
def test_an_echo_of_the_own_request_is_taken_out(pieces: int) -> None:
    # The echo of a write of one register is the same bytes as its reply.
    decoder = expecting(WRITE, echo=True)
    stream = ECHO + ECHO
    step = -(-len(stream) // pieces)
    frames = [f for at in range(0, len(stream), step) for f in decoder.feed(stream[at : at + step], at)]
    assert frames == [frame_of(ECHO)]
    assert (decoder.counters.echoes, decoder.stray_bytes) == (1, 0)


@pytest.mark.parametrize("pieces", [1, 2, 3, 8])
def test_the_echo_of_a_broadcast_is_nothing_stray(pieces: int) -> None:
    decoder = RtuReplyDecoder(silence_ns=2 * MS, echo=True)
    request = bytes.fromhex("06 6002 0040")
    decoder.expect_echo(0, request)
    echo = append_crc(bytes((0,)) + request)
    for start in range(0, len(echo), pieces):
        assert decoder.feed(echo[start : start + pieces], 0) == []
    assert (decoder.counters.echoes, decoder.stray_bytes) == (1, 0)
    decoder.feed(b"\x01\x02", 0)
    assert decoder.stray_bytes == 2


def test_what_is_no_echo_of_a_broadcast_is_stray() -> None:
    decoder = RtuReplyDecoder(silence_ns=2 * MS, echo=True)
    decoder.expect_echo(0, bytes.fromhex("06 6002 0040"))
    decoder.feed(bytes.fromhex("00 06 60 03"), 0)
    assert (decoder.counters.echoes, decoder.stray_bytes) == (0, 4)


def test_an_echo_alone_is_no_reply() -> None:
    decoder = expecting(WRITE, echo=True)
    assert decoder.feed(ECHO, 0) == []
    assert decoder.deadline_ns is None
    assert decoder.is_expecting


def test_bytes_that_answer_nothing_are_stray() -> None:
    decoder = RtuReplyDecoder()
    assert decoder.feed(REPLY, 0) == []
    assert decoder.stray_bytes == len(REPLY)
    assert decoder.deadline_ns is None


def test_a_late_reply_is_stray_after_cancelling() -> None:
    decoder = expecting(READ)
    decoder.feed(REPLY[:4], 0)
    decoder.cancel()
    assert not decoder.is_expecting
    assert decoder.deadline_ns is None
    assert decoder.feed(REPLY[4:], 1) == []
    assert (decoder.counters.dropped_bytes, decoder.stray_bytes) == (4, 5)


def test_zeros_after_cancelling_are_stray_too() -> None:
    # They may be the middle of a late reply: the line is not silent.
    decoder = expecting(READ)
    decoder.cancel()
    decoder.feed(b"\x00\x00", 0)
    assert decoder.stray_bytes == 2


def test_what_was_left_over_does_not_begin_the_next_reply() -> None:
    decoder = expecting(READ)
    decoder.feed(REPLY[:4], 0)
    decoder.expect(1, WRITE)
    assert decoder.feed(ECHO, 1) == [frame_of(ECHO)]


def test_endless_noise_is_bounded() -> None:
    decoder = expecting(READ)
    for at in range(50):
        decoder.feed(b"\x01\x03\xf0" * 100, at)
    assert decoder.counters.dropped_bytes >= 50 * 300 - 512
    decoder.reset()
    assert not decoder.is_expecting


# --- requests that come back, and nobody said so


def returned_by(decoder: RtuReplyDecoder, request: bytes, *came: bytes) -> int:
    """Ask something of unit id 1, let bytes come, and wait out the silence behind them."""
    decoder.expect(1, request)
    now_ns = 0
    for data in came:
        now_ns += MS
        decoder.feed(data, now_ns)
    decoder.on_silence(now_ns + 40 * MS)
    decoder.cancel()
    return decoder.returned


def adu(pdu: str) -> bytes:
    return encode_rtu(1, bytes.fromhex(pdu))


READ_2 = bytes.fromhex("03 0010 0002")
REPLY_2 = adu("03 04 1122 3344")


@pytest.mark.parametrize(
    "came",
    [
        (adu("03 0010 0002"), REPLY_2),
        (adu("03 0010 0002") + REPLY_2,),
        (adu("03 0010 0002")[:3], adu("03 0010 0002")[3:] + REPLY_2[:2], REPLY_2[2:]),
        (adu("03 0010 0002"), adu("83 02")),
        (adu("03 0010 0002"),),  # and no drive
    ],
)
def test_a_read_that_comes_back_is_noted_each_time(came: tuple[bytes, ...]) -> None:
    decoder = RtuReplyDecoder(2 * MS, 30 * MS)
    assert [returned_by(decoder, READ_2, *came) for _ in range(3)] == [1, 2, 3]


@pytest.mark.parametrize(
    ("request_pdu", "came"),
    [
        # Acknowledgements that repeat their request, alone and twice: an adapter's echo looks no different.
        ("06 0010 1234", (adu("06 0010 1234"),)),
        ("06 0010 1234", (adu("06 0010 1234"), adu("06 0010 1234"))),
        ("05 0010 FF00", (adu("05 0010 FF00"), adu("05 0010 FF00"))),
        ("08 0000 A537", (adu("08 0000 A537"), adu("08 0000 A537"))),
        ("16 0004 00F2 0025", (adu("16 0004 00F2 0025"), adu("16 0004 00F2 0025"))),
        # A drive that mirrors a write of several.
        ("10 0010 0001 02 1234", (adu("10 0010 0001 02 1234"),)),
        # 20 coils from 0x0311 on are three bytes, and these may be 11 00 14: that is the reply.
        ("01 0311 0014", (adu("01 03 11 0014"),)),
        # The same of registers cannot be, and is left alone all the same.
        ("03 0311 0002", (adu("03 0311 0002"), REPLY_2)),
        # A reply alone; another one's request; its own behind the reply.
        ("03 0010 0002", (REPLY_2,)),
        ("03 0010 0002", (adu("03 0010 0001"), REPLY_2)),
        ("03 0010 0002", (encode_rtu(2, READ_2), REPLY_2)),
        ("03 0010 0002", (REPLY_2, adu("03 0010 0002"))),
    ],
)
def test_what_may_be_a_reply_is_never_taken_for_an_echo(request_pdu: str, came: tuple[bytes, ...]) -> None:
    decoder = RtuReplyDecoder(2 * MS, 30 * MS)
    assert [returned_by(decoder, bytes.fromhex(request_pdu), *came) for _ in range(3)] == [0, 0, 0]


@pytest.mark.parametrize("came", [(REPLY_2,), (REPLY_2[:4], REPLY_2[4:])])
def test_a_reply_without_its_request_before_it_ends_the_row(came: tuple[bytes, ...]) -> None:
    decoder = RtuReplyDecoder(2 * MS, 30 * MS)
    echo = adu("03 0010 0002")
    for _ in range(2):
        returned_by(decoder, READ_2, echo, REPLY_2)
    write = bytes.fromhex("06 0010 1234")
    assert returned_by(decoder, write, encode_rtu(1, write)) == 2  # tells nothing
    assert returned_by(decoder, READ_2, *came) == 0


def test_a_read_that_comes_back_from_a_silent_drive_is_no_reply() -> None:
    decoder = RtuReplyDecoder(2 * MS, 30 * MS)
    decoder.expect(1, READ_2)
    assert decoder.feed(adu("03 0010 0002"), MS) == []
    assert decoder.on_silence(40 * MS) == []  # before: (1, 03 0010 0002)
    assert (decoder.counters.echoes, decoder.counters.damaged, decoder.returned) == (1, 0, 1)


def test_an_echo_that_was_announced_is_no_finding() -> None:
    decoder = RtuReplyDecoder(2 * MS, 30 * MS, echo=True)
    assert [returned_by(decoder, READ_2, adu("03 0010 0002"), REPLY_2) for _ in range(3)] == [0, 0, 0]


# === odd replies: of another length than their function code says ========================================
START = bytes.fromhex("05 03 01 01 30 B8")
SPEED = bytes.fromhex("05 05 02 13 88 44 5A")
AXIS = append_crc(bytes.fromhex("05 03 04 00 B1 1F 40"))
"""What a read of two registers is answered, of the device itself."""


def make(request: bytes, unit_id: int = 5, odd_units: frozenset[int] = frozenset({5})) -> RtuReplyDecoder:
    decoder = RtuReplyDecoder(2 * MS, 30 * MS, odd_units=odd_units)
    decoder.expect(unit_id, request)
    return decoder


def replies(decoder: RtuReplyDecoder, *pieces: bytes, pause_ns: int = 0) -> list[tuple[int, bytes]]:
    taken, now_ns = [], 0
    for piece in pieces:
        taken += decoder.feed(piece, now_ns)
        taken += decoder.on_silence(now_ns + min(pause_ns, 2 * MS))
        now_ns += pause_ns
    return taken + decoder.on_silence(now_ns + 2 * MS) + decoder.on_silence(now_ns + 30 * MS)


@pytest.mark.parametrize(
    "wire",
    [
        START,  # as long as a reply of function 3 is
        SPEED,  # shorter than the reply of function 5
        append_crc(bytes.fromhex("05 05 02 13 88 00 07 09")),  # longer
        append_crc(bytes.fromhex("05 85")),  # an exception without a code
        append_crc(bytes.fromhex("05 85 01 02")),  # one with two bytes
    ],
    ids=lambda wire: wire.hex(),
)
def test_an_odd_reply_comes_out_whole_however_it_comes(wire: bytes) -> None:
    request = bytes((wire[1] & 0x7F,)) + bytes.fromhex("02 13 88")
    whole = [(5, wire[1:-2])]
    assert replies(make(request), wire) == whole
    assert replies(make(request), *(wire[at : at + 1] for at in range(len(wire)))) == whole
    for cut in range(1, len(wire)):
        assert replies(make(request), wire[:cut], wire[cut:], pause_ns=16 * MS) == whole


def test_one_that_is_short_waits_for_what_an_adapter_may_hold_back_unless_it_repeats_the_request() -> None:
    for request, ends_ms in (("05 02 13 88", 2), ("05 02 13 89", 30)):
        decoder = make(bytes.fromhex(request))
        assert decoder.feed(SPEED, 0) == []
        assert decoder.on_silence(ends_ms * MS - 1) == []
        assert decoder.on_silence(2 * MS) == [(5, SPEED[1:-2])] * (ends_ms == 2)
        assert decoder.on_silence(30 * MS) == [(5, SPEED[1:-2])] * (ends_ms == 30)


@pytest.mark.parametrize(
    "body",
    [
        "06 05 02 13 88 00 07 09",  # of another unit
        "05 06 02 13 88 00 07 09",  # of another function
        "05 86 01 02",  # an exception to another function
        "05 81 01 02",  # what some drives refuse reads with has the length of an exception
    ],
)
def test_only_the_unit_that_was_asked_answers_and_with_the_function_byte_that_fits(body: str) -> None:
    for request in ("05 02 13 88", "03 02 13 88"):
        decoder = make(bytes.fromhex(request))
        assert replies(decoder, append_crc(bytes.fromhex(body))) == []
        assert decoder.is_expecting


def test_when_nothing_is_expected_any_more_it_answers_nothing() -> None:
    decoder = make(bytes.fromhex("05 02 13 88"))
    decoder.cancel()
    assert replies(decoder, SPEED) == []
    assert (decoder.counters.stray_frames, decoder.late_unit_id) == (1, 5)


@pytest.mark.parametrize("count", [0x63, 2])
@pytest.mark.parametrize("cut", range(2, 14))
def test_nothing_is_looked_for_inside_it(cut: int, count: int) -> None:
    """Whether the length that it says has not come, or has a bad check sum."""
    inside = append_crc(b"\x05\x03\x02\x00\x01")  # what a read of one register would be answered
    wire = append_crc(bytes((5, 3, count)) + inside + b"\x07")
    assert replies(make(b"\x03\x01\x01"), wire) == [(5, wire[1:-2])]
    assert replies(make(b"\x03\x01\x01"), wire[:cut], wire[cut:], pause_ns=16 * MS) == [(5, wire[1:-2])]


def test_noise_in_front_of_an_ordinary_reply_costs_it_nothing() -> None:
    for noise in (b"\x00", b"\xff\x03", b"\x05\x00", START):
        decoder = make(bytes.fromhex("03 02 00 00 02"))
        assert replies(decoder, noise + AXIS) == [(5, AXIS[1:-2])]


def test_of_a_drive_with_an_axis_the_reply_inside_is_what_counts() -> None:
    decoder = make(bytes.fromhex("03 02 00 00 02"), odd_units=frozenset({6}))
    assert replies(decoder, b"\x05\x03\x07\x05\x03" + AXIS) == [(5, AXIS[1:-2])]


def test_w6_an_odd_frame_of_another_device_is_late_and_no_damage() -> None:
    decoder = make(bytes.fromhex("03 02 00 00 02"), unit_id=1)
    assert decoder.feed(SPEED, 0) == []
    assert decoder.on_silence(2 * MS) == []
    assert (decoder.counters.foreign, decoder.late_unit_id, decoder.counters.damaged) == (1, 5, 0)
    reply = append_crc(bytes.fromhex("01 03 04 00 B1 1F 40"))
    assert decoder.feed(reply, 5 * MS) == [(1, reply[1:-2])]


def test_behind_an_odd_frame_of_another_device_the_reply_counts_all_the_same() -> None:
    decoder = make(bytes.fromhex("03 02 00 00 02"), unit_id=1)
    reply = append_crc(bytes.fromhex("01 03 04 00 B1 1F 40"))
    assert decoder.feed(SPEED + reply, 0) == [(1, reply[1:-2])]
