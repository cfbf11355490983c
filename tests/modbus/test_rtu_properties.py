"""What holds for every stream on a serial line."""

from itertools import pairwise

from hypothesis import assume, example, given
from hypothesis import strategies as st

from gateway.modbus.crc import append_crc, crc16
from gateway.modbus.rtu import RtuReplyDecoder, RtuRequestDecoder, encode_rtu

MS = 1_000_000
Frame = tuple[int, bytes]

units = st.integers(0, 247)
words = st.integers(0, 0xFFFF).map(lambda word: word.to_bytes(2, "big"))


def counted(function: int, head: int, most: int) -> st.SearchStrategy[bytes]:
    """A PDU: function code, ``head`` bytes, a byte count and as many bytes."""
    body = st.binary(max_size=most).map(lambda data: bytes((len(data),)) + data)
    return st.builds(lambda h, b: bytes((function,)) + h + b, st.binary(min_size=head, max_size=head), body)


def fixed(functions: list[int], size: int) -> st.SearchStrategy[bytes]:
    body = st.binary(min_size=size, max_size=size)
    return st.builds(lambda f, b: bytes((f,)) + b, st.sampled_from(functions), body)


request_pdus = st.one_of(
    fixed([1, 2, 3, 4, 5, 6, 8], 4),
    fixed([7, 11, 12, 17], 0),
    fixed([22], 6),
    fixed([24], 2),
    counted(15, 4, 246),
    counted(16, 4, 246),
    counted(23, 8, 242),
    counted(20, 0, 245),
    counted(21, 0, 245),
    st.builds(lambda b: b"\x2b\x0e" + b, st.binary(min_size=2, max_size=2)),
)
read_replies = st.builds(
    lambda f, w: bytes((f, 2 * len(w))) + b"".join(w),
    st.sampled_from([3, 4, 23]),
    st.lists(words, min_size=1, max_size=125),
)
requests = st.tuples(units, request_pdus)


def pieces_of(stream: bytes, data: st.DataObject) -> list[bytes]:
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    return [stream[a:b] for a, b in pairwise([0, *cuts, len(stream)])]


@given(frames=st.lists(requests, max_size=6), data=st.data())
def test_w2_any_split_of_requests_gives_the_same_frames(frames: list[Frame], data: st.DataObject) -> None:
    stream = b"".join(encode_rtu(*frame) for frame in frames)
    decoder = RtuRequestDecoder()
    assert [f for piece in pieces_of(stream, data) for f in decoder.feed(piece, 0)] == frames
    assert decoder.deadline_ns is None


@given(frame=requests, data=st.data())
def test_pauses_of_a_usb_adapter_inside_a_request_change_nothing(frame: Frame, data: st.DataObject) -> None:
    decoder = RtuRequestDecoder(silence_ns=2 * MS, give_up_ns=30 * MS)
    now_ns = 0
    frames = []
    for piece in filter(None, pieces_of(encode_rtu(*frame), data)):
        now_ns += 16 * MS
        frames += decoder.feed(piece, now_ns)
        frames += decoder.on_silence(now_ns + 2 * MS)
    assert frames == [frame]


@given(garbage=st.binary(max_size=300), frame=requests, data=st.data())
def test_a_request_behind_garbage_comes_out_at_silence(
    garbage: bytes, frame: Frame, data: st.DataObject
) -> None:
    decoder = RtuRequestDecoder(silence_ns=2 * MS, give_up_ns=30 * MS)
    stream = garbage + encode_rtu(*frame)
    frames = [f for piece in pieces_of(stream, data) for f in decoder.feed(piece, 0)]
    frames += decoder.on_silence(2 * MS)
    assert frames[-1:] == [frame]


@given(frames=st.lists(requests, min_size=2, max_size=4), cut=st.integers(1, 12))
def test_one_truncated_request_costs_no_other(frames: list[Frame], cut: int) -> None:
    wires = [encode_rtu(*frame) for frame in frames]
    truncated = wires[0][: -min(cut, len(wires[0]) - 1)]
    assume(not (truncated + b"".join(wires[1:])).startswith(wires[0]))  # what was cut off came all the same
    decoder = RtuRequestDecoder(silence_ns=2 * MS)
    taken = decoder.feed(truncated + b"".join(wires[1:]), 0) + decoder.on_silence(2 * MS)
    assert taken == frames[1:]


@given(unit_id=units, pdu=read_replies, data=st.data())
def test_w2_any_split_of_a_reply_gives_the_same_frame(unit_id: int, pdu: bytes, data: st.DataObject) -> None:
    decoder = RtuReplyDecoder()
    decoder.expect(unit_id, bytes((pdu[0], 0, 0, 0, pdu[1] // 2)) + bytes(5))
    pieces = pieces_of(encode_rtu(unit_id, pdu), data)
    assert [f for piece in pieces for f in decoder.feed(piece, 0)] == [(unit_id, pdu)]


@given(pieces=st.lists(st.tuples(st.binary(max_size=300), st.integers(0, 40 * MS)), max_size=8))
@example(pieces=[(bytes(300), 0)])
@example(pieces=[(b"\x00", 0), (b"\x00\x09", MS), (b"\x00" * 5, 40 * MS)])
def test_arbitrary_bytes_raise_nothing_and_are_all_accounted_for(pieces: list[tuple[bytes, int]]) -> None:
    decoder = RtuRequestDecoder(silence_ns=2 * MS, give_up_ns=30 * MS)
    now_ns = 0
    frames: list[Frame] = []
    for piece, pause_ns in pieces:
        frames += decoder.feed(piece, now_ns)
        now_ns += pause_ns
        frames += decoder.on_silence(now_ns)
    frames += decoder.on_silence(now_ns + 40 * MS)
    assert decoder.deadline_ns is None
    taken = sum(3 + len(pdu) for _, pdu in frames)
    counters = decoder.counters
    assert taken + counters.dropped_bytes + counters.glitch_bytes == sum(len(piece) for piece, _ in pieces)


@given(
    pieces=st.lists(st.tuples(st.binary(max_size=300), st.integers(0, 40 * MS)), max_size=8),
    request=request_pdus,
    unit_id=units,
    echo=st.booleans(),
)
def test_arbitrary_bytes_from_the_drives_raise_nothing(
    pieces: list[tuple[bytes, int]], request: bytes, unit_id: int, echo: bool
) -> None:
    decoder = RtuReplyDecoder(silence_ns=2 * MS, give_up_ns=30 * MS, echo=echo)
    now_ns = 0
    for piece, pause_ns in pieces:
        decoder.expect(unit_id, request)
        taken = decoder.feed(piece, now_ns)
        now_ns += pause_ns
        taken += decoder.on_silence(now_ns)
        assert len(taken) <= 1
        assert decoder.is_expecting == (not taken)


@given(data=st.binary(max_size=250), zeros=st.integers(0, 5))
def test_the_check_sum_over_a_frame_is_0_however_many_zeros_follow(data: bytes, zeros: int) -> None:
    assert crc16(append_crc(data) + bytes(zeros)) == 0
