"""Rules for every forwarded frame: with lumps, damage, ends in the middle, and frames that follow."""

from dataclasses import dataclass

from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.exchange.cut_through.delay import write_shape
from gateway.exchange.cut_through.frame import ForwardedFrame, ForwardEvent, ForwardState, closed, is_fit_head
from gateway.modbus.crc import INVERTED, append_crc, ends_a_frame, inverted_crc, is_intact, residue_after
from gateway.modbus.rtu_arrival import Progress, RequestArrival
from tests.exchange.cut_bench import CHAR_NS, PACE, Adds
from tests.soak import repeated

ENDS = (ForwardEvent.OVERTAKEN, ForwardEvent.GONE, ForwardEvent.ANEW, ForwardEvent.LOST)
words = st.integers(0, 2**32 - 1)
good_frames = st.binary(min_size=2, max_size=60).map(append_crc)


@dataclass(frozen=True)
class Course:
    """A write, the times of its bytes, and the events meanwhile."""

    head: bytes
    data: bytes
    before: bytes
    """Data of the last one that was acknowledged, as it left."""
    word: int
    """At which register its position begins."""
    gaps: tuple[int, ...]
    """Time before each of its bytes; with 0 it comes together with the one before."""
    flipped: int
    """A bit of it, counted from its first; beyond its end: none."""
    cut_to: int
    """After so many bytes nothing more comes."""
    ends: ForwardEvent | None
    ends_after: int
    """Somebody ends it after so many bytes."""
    delay_ns: int
    agrees: bool
    refused: bool
    is_early: bool
    """The first byte of its position may leave with the third."""

    @property
    def frame(self) -> bytes:
        """It, as its controller sent it."""
        return append_crc(self.head + self.data)

    @property
    def came(self) -> bytes:
        """It, as it came."""
        came = bytearray(self.frame)
        if self.flipped < 8 * len(came):
            came[self.flipped // 8] ^= 1 << self.flipped % 8
        return bytes(came[: self.cut_to])


@st.composite
def courses(draw: st.DrawFn) -> Course:
    count = draw(st.integers(2, 6))
    word = draw(st.integers(0, count - 2))
    address = draw(st.integers(0, 0xFFFF)).to_bytes(2, "big")
    head = bytes((draw(st.integers(1, 247)), 16)) + address + bytes((0, count, 2 * count))
    length = 9 + 2 * count
    is_smooth = draw(st.booleans())
    gap = st.sampled_from((0, 0, 300, CHAR_NS, CHAR_NS, 1400, 5000))
    smooth, uneven = st.just([CHAR_NS] * length), st.lists(gap, min_size=length, max_size=length)
    # Of a write whose characters come evenly this is what the arithmetic says, and one of margin.
    is_early = not word and draw(st.booleans())
    enough = st.just((4 + 2 * word - is_early) * CHAR_NS)
    data = draw(st.binary(min_size=2 * count, max_size=2 * count))
    before = draw(st.binary(min_size=2 * count, max_size=2 * count))
    if draw(st.booleans()):  # from a position nearby, and perhaps at a border
        border = draw(st.sampled_from((0, 1 << 8, 1 << 16, 1 << 24, 1 << 31, -1 << 24)))
        near = (border + draw(st.integers(-300, 300))) % 2**32
        data = near.to_bytes(4, "big") + data[4:]
        before = data[:1] + before[1:]
    return Course(
        head=head,
        data=data,
        before=before,
        word=word,
        gaps=tuple(draw(smooth if is_smooth else uneven)),
        flipped=draw(st.one_of(st.just(1 << 20), st.just(1 << 20), st.integers(0, 8 * length))),
        cut_to=draw(st.one_of(st.just(length), st.just(length), st.integers(1, length))),
        ends=draw(st.sampled_from((None, None, None, *ENDS))),
        ends_after=draw(st.integers(0, length)),
        delay_ns=draw(st.one_of(enough, enough, st.integers(0, 16).map(lambda half: half * CHAR_NS // 2))),
        agrees=draw(st.integers(0, 9)) > 0,
        refused=draw(st.integers(0, 9)) == 0,
        is_early=is_early,
    )


@dataclass
class Left:
    """The result of a course."""

    forwarded: ForwardedFrame
    judge: Adds
    pieces: list[tuple[int, bytes]]
    rendered: bytes
    """What it would have left as, where nothing had happened."""


def run(course: Course) -> Left:
    """Run a course, with timers that are on time."""
    position = 7 + 2 * course.word
    judge = Adds(
        shape=write_shape(len(course.data) // 2, course.word, 2, is_early=course.is_early),
        expected=course.head + course.before,
        delay_ns=course.delay_ns,
        refused=frozenset({course.frame[position : position + 4]} if course.refused else ()),
        agrees=course.agrees,
    )
    forwarded = ForwardedFrame(RequestArrival(), judge, PACE)
    pieces: list[tuple[int, bytes]] = []

    def tick_until(now_ns: int) -> None:
        while (deadline_ns := forwarded.deadline_ns) is not None and deadline_ns < now_ns:
            pieces.append((deadline_ns, forwarded.tick(deadline_ns)))

    now_ns, at = 1_000, 0
    came = course.came
    while at < len(came):
        together = 1
        while at + together < len(came) and course.gaps[at + together] == 0:
            together += 1
        now_ns += course.gaps[at]
        tick_until(now_ns)
        pieces.append((now_ns, forwarded.feed(came[at : at + together], now_ns)))
        at += together
        if course.ends is not None and at >= course.ends_after:
            pieces.append((now_ns, forwarded.go_on(course.ends, now_ns)))
    tick_until(now_ns + 100 * CHAR_NS)
    raw = int.from_bytes(course.frame[position : position + 4], "big") + judge.counts
    body = course.frame[:position] + (raw % 2**32).to_bytes(4, "big") + course.frame[position + 4 : -2]
    return Left(forwarded, judge, [each for each in pieces if each[1]], append_crc(body))


@given(course=courses())
def test_w3_a_good_check_sum_is_sent_only_if_all_came_good_and_was_sent_as_agreed(course: Course) -> None:
    left = run(course)
    forwarded = left.forwarded
    assert b"".join(data for _, data in left.pieces) == forwarded.left
    if forwarded.state is ForwardState.WHOLE:
        assert forwarded.left == left.rendered
        assert forwarded.arrival.progress is Progress.GOOD
        assert course.came == course.frame
        assert left.judge.committed == [(course.frame[:-2], forwarded.left[:-2])]
    else:
        assert not is_intact(forwarded.left) or forwarded.state is ForwardState.STORED
        assert left.judge.committed == [] or not course.agrees


def a_spoilt_frame_is_as_long_as_it_said_and_no_frame_alone_or_with_others(
    course: Course, left: Left, following: list[bytes]
) -> None:
    if left.forwarded.state is not ForwardState.ABORTED:
        return
    aborted = left.forwarded.left
    assert len(aborted) == len(course.frame)
    assert residue_after(aborted) == INVERTED
    assert not is_intact(following[0] + aborted)
    joined = aborted
    for frame in following:
        joined += frame
        assert not is_intact(joined)
    # Its last piece may come alone, where the one before it came too late: two bytes are no frame.
    filling = left.pieces[-1][1]
    assert len(filling) == 2 or not ends_a_frame(residue_after(filling))


def no_piece_ends_where_a_frame_could(course: Course, left: Left) -> None:
    so_far = b""
    for _, data in left.pieces:
        so_far += data
        if so_far == left.rendered:
            break
        assert not ends_a_frame(residue_after(so_far))
        # What would be torn off there is no frame by itself.
        assert not is_intact(left.rendered[len(so_far) :])


def no_data_leaves_before_its_position_is_judged(course: Course, left: Left) -> None:
    position_ends = 7 + 2 * course.word + 4
    at = 0
    for number, (when_ns, data) in enumerate(left.pieces):
        is_filling = left.forwarded.state is ForwardState.ABORTED and number == len(left.pieces) - 1
        if not is_filling:
            came = max(each.so_far for each in left.forwarded.pieces if each.came_ns <= when_ns)
            for index in range(at, at + len(data)):
                needed = position_ends - (course.is_early and index == 7)
                assert came >= (index + 1 if index < 7 else max(index + 1, needed))
                if course.came[:came] == course.frame[:came]:
                    assert data[index - at] == left.rendered[index]
        at += len(data)
    if course.refused:
        assert left.forwarded.state is not ForwardState.WHOLE


def the_transmitter_is_never_empty_inside_a_frame(course: Course, left: Left) -> None:
    free_ns = None
    for when_ns, data in left.pieces:
        assert free_ns is None or when_ns <= free_ns
        free_ns = (when_ns if free_ns is None else free_ns) + CHAR_NS * len(data)
    # And where it began it ended: whole, filled up, or with its wire.
    assert not left.forwarded.is_on_the_way
    assert left.forwarded.left == b"" or left.forwarded.state in (
        ForwardState.WHOLE,
        ForwardState.ABORTED,
        ForwardState.BROKEN,
    )


def a_stored_frame_leaves_nothing_and_is_followed_to_its_end(course: Course, left: Left) -> None:
    forwarded = left.forwarded
    if forwarded.state in (ForwardState.BEGUN, ForwardState.STORED):
        assert forwarded.left == b""
    if course.came == course.frame:
        assert forwarded.arrival.progress is Progress.GOOD


@settings(max_examples=repeated(3000))
@given(course=courses(), following=st.lists(good_frames, min_size=1, max_size=2))
def test_every_course_keeps_the_rules_of_forwarding(course: Course, following: list[bytes]) -> None:
    left = run(course)
    no_piece_ends_where_a_frame_could(course, left)
    no_data_leaves_before_its_position_is_judged(course, left)
    the_transmitter_is_never_empty_inside_a_frame(course, left)
    a_stored_frame_leaves_nothing_and_is_followed_to_its_end(course, left)
    a_spoilt_frame_is_as_long_as_it_said_and_no_frame_alone_or_with_others(course, left, following)


@given(
    left=st.binary(min_size=1, max_size=30).filter(lambda each: not ends_a_frame(residue_after(each))),
    filler=st.binary(max_size=30),
    data=st.data(),
)
def test_no_prefix_of_a_filling_ends_a_frame(left: bytes, filler: bytes, data: st.DataObject) -> None:
    if filler and data.draw(st.booleans()):  # one that would
        filler = residue_after(left).to_bytes(2, "little") + filler
    filling = closed(left, filler)
    assert len(filling) == len(filler) + 2
    for length in range(1, len(filling) + 1):
        assert not ends_a_frame(residue_after(left + filling[:length]))
        if 4 <= length < len(filling):
            assert not ends_a_frame(residue_after(filling[:length]))
    assert not filler or not ends_a_frame(residue_after(filling))
    assert sum(a != b for a, b in zip(filling, filler, strict=False)) <= 8


def test_a_filling_that_ends_a_frame_with_the_inverted_crc_keeps_its_length_with_another_crc() -> None:
    """No change of a byte before the CRC helps: it changes both residues in the same way."""
    left, filler = b"\x00", bytes.fromhex("BF 40") + bytes(11)
    filling = closed(left, filler)
    inside = filling[:-2]
    assert ends_a_frame(residue_after(inside + inverted_crc(residue_after(left + inside))))
    assert len(inside) == len(filler)
    assert not ends_a_frame(residue_after(filling))
    assert not ends_a_frame(residue_after(left + filling))


def test_a_head_is_fit_only_if_no_part_of_it_ends_a_frame() -> None:
    for address in range(0, 0x10000, 97):
        head = b"\x01\x10" + address.to_bytes(2, "big") + b"\x00\x02\x04"
        assert is_fit_head(head) == (not any(ends_a_frame(residue_after(head[:to])) for to in range(1, 8)))
