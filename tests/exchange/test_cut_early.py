"""Positions whose first byte is sent before their last one has come: on real axes, at every border.

The highest word comes first. If the first three bytes of a position decide the first one, that byte is sent
with the third. A frame sent whole is equal to the stored one; any other is no intact frame.
"""

from dataclasses import replace
from random import Random
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange import dispatch
from gateway.exchange.commands import Disable
from gateway.exchange.cut_through.delay import (
    Delays,
    acknowledgement_shape,
    read_shape,
    reply_shape,
    write_shape,
)
from gateway.exchange.cut_through.frame import ForwardEvent, ForwardState
from gateway.exchange.cut_through.replies import reply_shape_of
from gateway.exchange.cut_through.requests import REMEMBERED_BEGINNINGS, Heads
from gateway.exchange.fast_path import ReadPath, WritePath
from gateway.exchange.plan import AxisPlan, writes_alone
from gateway.exchange.transaction import FastPath
from gateway.modbus.crc import INVERTED, append_crc, residue_after
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from tests.exchange.cut_bench import assert_spoilt, learn
from tests.exchange.cut_line_bench import CHAR_NS, Site, frame_of
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, read, stream_plan, write
from tests.exchange.staged_bench import STOP_PDU, staged_plan
from tests.exchange.test_cut_line import ends_aborted
from tests.exchange.test_cut_replies import Way as ReplyWay
from tests.exchange.test_cut_requests import Way

TARGET = replace(COMMAND, order=WordOrder.HIGH_FIRST)
PLACE = replace(ACTUAL, order=WordOrder.HIGH_FIRST)
STEEP = make_table([-50, 0, 50], [-0.03, 0.02, -0.03], [-0.05, 0.0, -0.05], Units.MM)
"""Up to 30 counts less and 20 more, at 1000 counts for a mm."""
EARLY = write_shape(2, 0, 2, is_early=True)
BORDERS = (0, 1 << 8, 1 << 16, 1 << 24, -(1 << 24), -(1 << 8))


def plan_at(border: int, **changes: Any) -> AxisPlan:
    """Return an axis whose table has its middle at ``counts``."""
    return stream_plan(table=STEEP, command=(TARGET,), actual=(PLACE,), zero_counts=float(border), **changes)


def units_of(bench: Bench) -> dispatch.UnitMaps:
    return dispatch.UnitMaps(bench.line.axes, is_serial=True)


def at_border(border: int, step: int = 40) -> Way:
    """A stream that has come from 8 mm in front of a border or farther, and is 1 mm before it."""
    way = Way(plan_at(border))
    learn(way.heads.delays, EARLY, write_shape(2, 0, 2))
    for counts in range(border - 1_000 - step * (7_000 // step + 4), border - 999, step):
        way.store(write(TARGET, counts))
        way.bench.now_ns += 10 * MS
    return way


@pytest.mark.parametrize("step", [7, 40, 255, 256, 1000])
@pytest.mark.parametrize("border", BORDERS)
def test_a_stream_over_a_border_is_sent_as_if_it_had_been_stored(border: int, step: int) -> None:
    way = at_border(border, step)
    whole = early = 0
    for counts in range(border - 1000 + step, border + 1100, step):
        opening = way.heads.opening(b"\x01" + write(TARGET, 0)[:3])
        assert opening is not None
        forwarded = way.forwarded(frame_of(write(TARGET, counts)))
        sent = way.store(write(TARGET, counts))
        way.bench.now_ns += 10 * MS
        assert forwarded.state is ForwardState.WHOLE, counts
        assert forwarded.left == frame_of(sent)
        whole += 1
        early += opening.shape == EARLY
    # Nearer to 0 and 2^24 than twice the step and 1024 counts they are late; at 2^16 none is.
    if border == 1 << 16:
        assert early == whole
    elif border % (1 << 24) == 0 and step >= 40:
        assert early == 0


@pytest.mark.parametrize("seed", range(12))
def test_targets_anywhere_are_sent_as_if_they_had_been_stored_or_spoilt(seed: int) -> None:
    """Targets near to and far from the one before, at borders, in a stream that reverses, with any
    expectation."""
    rng = Random(seed)
    border = rng.choice(BORDERS)
    way = at_border(border)
    counts, outcomes = border - 1000, []
    for _ in range(60):
        jump = rng.choice((1, 40, 256, 5_000, -1, -300))
        counts = border + rng.randint(-300, 300) if rng.random() < 0.3 else counts + jump
        reach = rng.choice((0, 0, 1100))
        for beginning, expected in way.heads._expected.items():
            if expected is not None:
                way.heads._expected[beginning] = expected._replace(reach=reach)
        forwarded = way.forwarded(frame_of(write(TARGET, counts)))
        way.bench.wait(0)
        sent = way.store(write(TARGET, counts))
        way.bench.now_ns += 10 * MS
        outcomes.append(forwarded.state)
        if forwarded.state is ForwardState.WHOLE:
            assert forwarded.left == frame_of(sent)
        elif forwarded.left:
            assert_spoilt(forwarded)
    assert ForwardState.WHOLE in outcomes


def test_a_target_that_jumps_over_a_border_is_spoilt() -> None:
    way = at_border(0)
    way.store(write(TARGET, -990))
    way.bench.now_ns += 10 * MS
    for beginning, expected in way.heads._expected.items():
        assert expected is not None
        way.heads._expected[beginning] = expected._replace(reach=0)
    last = way.bench.seen[-1]
    forwarded = way.forwarded(frame_of(write(TARGET, 1_000)))  # 000003E8, and FFFFFC22 was the last one
    assert (forwarded.state, way.events[-1]) == (ForwardState.ABORTED, ForwardEvent.STALLED)
    assert forwarded.left[:8] == b"\x01" + last[:7]


@pytest.mark.parametrize("after_bytes", [10, 11, 12])
def test_switching_off_after_the_first_byte_of_a_position_spoils_the_frame(after_bytes: int) -> None:
    way = at_border(1 << 16)
    forwarded = way.forwarded(
        frame_of(write(TARGET, (1 << 16) - 960)),
        lambda: void(way.bench.line.command(Disable(axes=("x",)), way.bench.now_ns)),
        after_bytes,
    )
    assert_spoilt(forwarded)
    assert way.events[-1] is (ForwardEvent.REFUSED if after_bytes == 10 else ForwardEvent.CHANGED)


def void(_anything: object) -> None:
    pass


# --- what is decided ----------------------------------------------------------------------------------------


@given(
    border=st.sampled_from(BORDERS),
    near=st.integers(-40_000, 40_000),
    scale=st.sampled_from((1.0, 2.0, -1.0, 0.5)),
    counts_per_unit=st.sampled_from((1000.0, -1000.0)),
)
def test_a_decided_first_byte_is_right_for_each_last_byte(
    border: int, near: int, scale: float, counts_per_unit: float
) -> None:
    field = replace(TARGET, scale=scale)
    plan = stream_plan(table=STEEP, command=(field,), zero_counts=border * scale)
    plan = replace(plan, settings=replace(plan.settings, counts_per_unit=counts_per_unit))
    bench = Bench(plan)
    start = border + near - 12_000
    for raw in range(start, start + 12_001, 400):
        bench.ask(write(TARGET, raw))
        bench.now_ns += 10 * MS
    path = units_of(bench).path_of(1, write(TARGET, 0))
    assert isinstance(path, WritePath)
    assume(path.is_ready(bench.port, bench.now_ns))
    begun = TARGET.pack(border + near)[:3]
    judged = [path.judged(bench.port, begun + bytes((last,)), bench.now_ns) for last in range(256)]
    firsts = {target.corrected_words[0] for target in judged if target is not None}
    for byte in range(256):
        if path.begins_with(byte, bench.port, begun, bench.now_ns):
            assert firsts <= {byte}
    if len(firsts) == 2:
        assert not any(path.begins_with(byte, bench.port, begun, bench.now_ns) for byte in range(256))


def decides(*, added: int, counts: int = 300) -> tuple[WritePath, Bench]:
    """Return the write path of an axis at ``counts`` whose table adds the same everywhere."""
    table = make_table([-100, 100], [added / 1000] * 2, [added / 1000] * 2, Units.MM)
    bench = Bench(stream_plan(table=table, command=(TARGET,)))
    for each in range(counts - 8_000, counts + 1, 100):
        bench.ask(write(TARGET, each))
        bench.now_ns += 10 * MS
    path = units_of(bench).path_of(1, write(TARGET, 0))
    assert isinstance(path, WritePath)
    return path, bench


@pytest.mark.parametrize(
    ("added", "begun", "byte", "is_decided"),
    [
        (-30, "00 00 00", 0x00, False),  # from FFFFFFE2 to 000000E1
        (-30, "00 00 00", 0xFF, False),
        (-30, "00 00 01", 0x00, True),  # from 000000E2 on
        (-30, "00 00 01", 0xFF, False),
        (30, "FF FF FF", 0xFF, False),  # to 0000001D
        (30, "FF FF FF", 0x00, False),
        (30, "FF FF FE", 0xFF, True),
        (30, "7F FF FF", 0x7F, False),  # its last 30 do not fit
        (-30, "80 00 00", 0x80, False),
    ],
)
def test_a_first_byte_is_decided_if_the_lowest_and_the_highest_last_byte_agree(
    added: int, begun: str, byte: int, *, is_decided: bool
) -> None:
    path, bench = decides(added=added)
    assert path.begins_with(byte, bench.port, bytes.fromhex(begun), bench.now_ns) is is_decided


def test_a_first_byte_is_not_decided_if_the_same_target_was_sent_with_another_one() -> None:
    """The same target gets the same words, whatever the table adds now."""
    path, bench = decides(added=30)
    begun = TARGET.pack(300)[:3]
    assert path.begins_with(0, bench.port, begun, bench.now_ns)
    image = bench.line.axes[0].fields[0]
    image.settle(TARGET.pack(300), TARGET.pack(-20), image.epoch)
    assert not path.begins_with(0, bench.port, begun, bench.now_ns)
    assert path.begins_with(0, bench.port, TARGET.pack(600)[:3], bench.now_ns)


def test_the_first_byte_of_a_target_on_the_slow_path_is_never_decided() -> None:
    path, bench = decides(added=30)
    begun = TARGET.pack(300)[:3]
    assert path.begins_with(0, bench.port, begun, bench.now_ns)
    assert not path.begins_with(0, None, begun, bench.now_ns)  # of another controller
    bench.line.command(Disable(axes=("x",)), bench.now_ns)
    assert not path.begins_with(0, bench.port, begun, bench.now_ns)


@given(border=st.sampled_from(BORDERS), near=st.integers(-2_000, 2_000), place=st.integers(-2_000, 2_000))
def test_a_decided_first_byte_of_a_reading_is_right_for_each_last_byte(
    border: int, near: int, place: int
) -> None:
    bench = Bench(plan_at(border))
    for counts in range(border + near - 8_000, border + near + 1, 400):
        bench.ask(write(TARGET, counts))
        bench.now_ns += 10 * MS
    bench.send(read(PLACE))
    transaction = bench.line._transactions.current
    assert transaction is not None
    path = transaction.path
    assert isinstance(path, ReadPath)
    begun = PLACE.pack(border + place)[:3]
    read_as = [path.nominal_words(transaction, 0, begun + bytes((last,))) for last in range(256)]
    firsts = {words[0] for words in read_as if words is not None}
    for byte in firsts:
        assert path.begins_with(byte, transaction, 0, begun) == (firsts == {byte})


# --- what may begin with three bytes ------------------------------------------------------------------------


def heads() -> tuple[Heads, Bench]:
    """Return the beginnings known for a port, with measured delays of writes."""
    found = Heads(Delays(CHAR_NS, CHAR_NS, CHAR_NS))
    learn(found.delays, EARLY, write_shape(2, 0, 2), char_ns=CHAR_NS)
    return found, Bench(plan_at(0))


def note(known: Heads, bench: Bench, counts: int, times: int = 2) -> bytes:
    """Record a target as acknowledged ``times`` times; return its frame without check sum."""
    pdu = write(TARGET, counts)
    for _ in range(times):
        known.add(units_of(bench).path_of(1, pdu), b"\x01" + pdu, b"\x01" + pdu)
    return b"\x01" + pdu


def test_three_bytes_identify_a_write_if_all_with_them_went_to_one_address() -> None:
    known, bench = heads()
    frame = note(known, bench, 50_000)
    opening = known.opening(frame[:3])
    assert opening is not None
    assert (opening.shape, opening.delay_ns, opening.filler) == (EARLY, 3 * CHAR_NS, frame)
    assert known.opening(frame[:2]) is None
    # A write to another address of the same 256 came, whatever it was: four bytes from now on.
    known.saw(bytes.fromhex("01 10 06 10 00 01 02 00 07"))
    assert known.opening(frame[:3]) is None
    opening = known.opening(frame[:4])
    assert opening is not None
    assert (opening.shape, opening.delay_ns) == (write_shape(2, 0, 2), 4 * CHAR_NS)
    note(known, bench, 50_040)
    assert known.opening(frame[:3]) is None  # for good


@pytest.mark.parametrize(
    "other", ["01 10 07 06 00 01 02 00 07", "02 10 06 10 00 01 02 00 07", "01 03 06 06 00 02"]
)
def test_a_frame_with_another_beginning_changes_nothing(other: str) -> None:
    known, bench = heads()
    frame = note(known, bench, 50_000)
    known.saw(bytes.fromhex(other))
    assert known.opening(frame[:3]) is not None


@pytest.mark.parametrize("counts", [0, 1000, -1, (1 << 24) - 500, -(1 << 24)])
def test_four_bytes_identify_a_write_near_a_border(counts: int) -> None:
    known, bench = heads()
    frame = note(known, bench, counts)
    assert known.opening(frame[:3]) is None
    opening = known.opening(frame[:4])
    assert opening is not None
    assert opening.shape == write_shape(2, 0, 2)


def test_one_write_is_not_enough_to_know_the_next_by_three_bytes() -> None:
    known, bench = heads()
    frame = note(known, bench, 50_000, times=1)
    opening = known.opening(frame[:4])
    assert (known.opening(frame[:3]), opening is not None and opening.shape) == (None, write_shape(2, 0, 2))


def other_pages(count: int) -> list[bytes]:
    """Writes to so many pages of other unit ids."""
    return [bytes((2 + number // 256, 16, number % 256, 0)) for number in range(count)]


def test_the_pages_of_writes_are_forgotten_when_their_maximum_is_reached() -> None:
    known, bench = heads()
    frame = note(known, bench, 50_000)
    *most, last = other_pages(REMEMBERED_BEGINNINGS)
    known.saw(bytes.fromhex("09 03 0200 0001"))  # a read has no page
    for each in (*most, frame):  # the last one is known
        known.saw(each)
    is_known = [known.opening(frame[:3]) is not None]
    known.saw(last)
    is_known.append(known.opening(frame[:3]) is not None)
    assert is_known == [True, False]


def test_another_address_on_the_page_is_forgotten_with_the_beginnings() -> None:
    known, bench = heads()
    frame = note(known, bench, 50_000)
    known.saw(frame[:3] + bytes((frame[3] ^ 0x80,)))
    is_known = [known.opening(frame[:3]) is not None]
    for unit_id in range(2, 2 + REMEMBERED_BEGINNINGS // 2):
        for function in (3, 4):
            beginning = bytes((unit_id, function, 2, 0, 0, 1))
            known.add(FastPath(5), beginning, beginning)
    note(known, bench, 50_000)
    is_known.append(known.opening(frame[:3]) is not None)
    assert is_known == [False, True]


@pytest.mark.parametrize(
    ("other", "is_alone"),
    [
        ({"command": (PositionField(0x0610, RegisterType.INT32),)}, False),
        ({"command": (PositionField(0x0700, RegisterType.INT32, block=0x06FE),)}, False),
        ({"limits": (PositionField(0x0620, RegisterType.INT32),)}, False),
        ({"actual": (PositionField(0x0620, RegisterType.INT32),), "settable": frozenset({0})}, False),
        ({"actual": (PositionField(0x0620, RegisterType.INT32),)}, True),  # nobody writes it
        ({"command": (PositionField(0x0506, RegisterType.INT32),)}, True),
    ],
)
def test_four_bytes_identify_a_target_with_another_one_beside_it(
    other: dict[str, Any], *, is_alone: bool
) -> None:
    plan = plan_at(0)
    apart = {"command": (PositionField(0x0900, RegisterType.INT32),), "actual": ()}
    beside = replace(plan, name="y", **(apart | other))
    assert writes_alone([plan, beside], TARGET) is is_alone
    path = units_of(Bench(plan, beside)).path_of(1, write(TARGET, 0))
    assert path is None or (isinstance(path, WritePath) and path.is_early is is_alone)
    low_first = units_of(Bench(stream_plan())).path_of(1, write(COMMAND, 0))
    assert isinstance(low_first, WritePath)
    assert not low_first.is_early


# --- on a line --------------------------------------------------------------------------------------------


def settled(*more: AxisPlan) -> Site:
    """Return a line whose controller has written setpoints and read the position; the next frames may be cut
    through."""
    line = Site(plan_at(0), *more)
    for counts in range(2_000, 10_001, 160):
        line.bench.ask(write(TARGET, counts))
        line.bench.memory.put(PLACE, line.bench.memory.get(TARGET))
        line.pass_to(line.bench.now_ns + 10 * MS)
        line.bench.ask(read(PLACE))
        line.pass_to(line.bench.now_ns + 10 * MS)
    line.forget()
    line.link.decoder.cancel()
    line.measure(EARLY, write_shape(2, 0, 2), read_shape())
    shape = reply_shape(2, [(0, 2)], [0])
    assert shape.late is not None
    line.measure(acknowledgement_shape(), shape, shape.late, of_replies=True)
    return line


NEXT = write(TARGET, 10_040)
"""10 040 is 0000 2738; STEEP adds 10 there: 20 - 10.04 / 50 × 50 counts."""
SENT = frame_of(NEXT[:6] + TARGET.pack(10_050))
HEAD = [(3.325, "01 10 06"), (4.0, "06"), (5.0, "00"), (6.0, "02"), (7.0, "04")]


def test_a_setpoint_and_a_reading_are_sent_three_characters_after_they_came() -> None:
    line = settled()
    began_ns = line.come(frame_of(NEXT))
    assert line.to_drives(began_ns) == [*HEAD, (10.0, "00"), (11.0, "00 27 42"), (13.0, SENT[-2:].hex(" "))]
    line.pass_to(began_ns + 20 * MS)
    line.reply(frame_of(NEXT[:5]))
    line.pass_to(line.bench.now_ns + 10 * MS)
    line.come(frame_of(read(PLACE)))
    line.to_cnc(began_ns)
    drive = bytes.fromhex("03 04") + PLACE.pack(10_050)
    began_ns = line.reply(frame_of(drive))
    told = frame_of(bytes.fromhex("03 04") + PLACE.pack(10_040))
    assert line.to_cnc(began_ns) == [
        (3.325, "01 03 04"),
        (6.0, "00"),
        (7.0, "00 27 38"),
        (9.0, told[-2:].hex(" ")),
    ]
    assert (line.requests(), line.forwarding.underruns) == ({ForwardEvent.COMMITTED: 2}, 0)
    assert line.replies()[ForwardEvent.COMMITTED] == 2


def test_m3_a_stop_of_another_controller_between_the_first_byte_and_the_last_one() -> None:
    line = settled(staged_plan(name="y", unit_id=2))
    last = line.bench.memory.read(TARGET.address, 2)
    began_ns = line.come(frame_of(NEXT)[:10])
    line.pass_to(began_ns + 10_400_000)
    line.hear(line.panel, frame_of(STOP_PDU, 2))
    left = line.to_drives(began_ns)
    assert [when for when, _ in left] == [3.325, 4.0, 5.0, 6.0, 7.0, 10.0, 10.4]
    ends_aborted(left)
    assert bytes.fromhex(" ".join(data for _, data in left))[7:11] == last  # what the drive holds
    line.come(frame_of(NEXT)[10:], since_ns=began_ns + 10 * MS)
    line.pass_to(began_ns + 60 * MS)
    # Thirteen bytes from 3.325 on, and three silences of 3.5: the stop, and nothing before it.
    assert line.to_drives(began_ns)[0] == (26.825, frame_of(STOP_PDU, 2).hex(" "))


def test_the_first_write_to_another_address_is_spoilt_and_then_four_bytes_identify_writes() -> None:
    """A register beside the target that no map names, and that was never written before."""
    line = settled()
    speed = bytes.fromhex("10 06 20 00 02 04 00 00 00 07")
    began_ns = line.come(frame_of(speed))
    ends_aborted(line.to_drives(began_ns))
    line.pass_to(began_ns + 60 * MS)
    assert [data for _, data in line.to_drives(began_ns)] == [frame_of(speed).hex(" ")]
    line.answer(frame_of(speed[:5]))
    line.pass_to(line.bench.now_ns + 20 * MS)
    began_ns = line.come(frame_of(NEXT))
    left = line.to_drives(began_ns)
    assert left == [(4.325, "01 10 06 06"), *HEAD[2:], (11.0, "00 00 27 42"), (13.0, SENT[-2:].hex(" "))]
    line.answer(frame_of(NEXT[:5]))
    line.pass_to(line.bench.now_ns + 20 * MS)
    began_ns = line.come(frame_of(speed))  # of what begins with its four bytes nothing is expected
    assert line.to_drives(began_ns) == [(13.0, frame_of(speed).hex(" "))]
    assert line.requests() == {ForwardEvent.UNFIT: 1, ForwardEvent.COMMITTED: 1}


@pytest.mark.parametrize("border", [0, 1 << 24, 1 << 16])
def test_readings_over_a_border_are_answered_as_if_they_had_been_stored(border: int) -> None:
    way = ReplyWay(plan_at(border))
    for counts in range(border - 8_000, border - 99, 40):
        way.bench.ask(write(TARGET, counts))
        way.bench.now_ns += 10 * MS
    states = []
    for place in range(border - 3_000, border + 3_000, 37):
        way.bench.memory.put(PLACE, place)
        forwarded, passed = way.ask(read(PLACE))
        states.append(forwarded.state)
        if forwarded.state is ForwardState.WHOLE:
            assert forwarded.left == append_crc(b"\x01" + passed)
    assert set(states[2:]) == {ForwardState.WHOLE}  # the first one is stored, and none is spoilt


def test_a_reading_that_jumps_over_a_border_is_spoilt() -> None:
    way = ReplyWay(plan_at(0))
    for counts in range(-8_000, -2_999, 40):
        way.bench.ask(write(TARGET, counts))
        way.bench.now_ns += 10 * MS
    for place in (-3_100, -3_080, -3_060):
        way.bench.memory.put(PLACE, place)
        way.ask(read(PLACE))
    way.bench.memory.put(PLACE, 3_000)
    forwarded, passed = way.ask(read(PLACE))
    assert forwarded.state is ForwardState.ABORTED
    assert residue_after(forwarded.left) == INVERTED
    assert passed[2:3] == b"\x00"


def test_the_first_byte_of_a_limit_is_never_decided() -> None:
    """0 passes unchanged, and 1 does not: both ends of 256 counts do not decide the values between them."""
    bench = Bench(plan_at(0, limits=(PositionField(0x0620, RegisterType.INT32),)))
    for counts in range(-8_000, 1, 400):
        bench.ask(write(TARGET, counts))
        bench.now_ns += 10 * MS
    bench.send(bytes.fromhex("03 06 20 00 02"))
    transaction = bench.line._transactions.current
    assert transaction is not None
    shape = reply_shape_of(transaction)
    assert shape == reply_shape(2, [(0, 2)])
