"""What cut-through gains: each frame of a round, worked out by hand, and whether the exchange would do it."""

from dataclasses import replace

import pytest

from gateway.budget.line import delay_of, line_budget
from gateway.budget.sequence import Blocks, RoundStep, What, least_target_registers, round_of
from gateway.budget.verdict import Grade, judge
from gateway.drives.library import names
from gateway.drives.motion import Form
from gateway.exchange.axis.axis import Axis
from gateway.exchange.cut_through.delay import FrameShape, reply_shape, write_shape
from gateway.exchange.cut_through.requests import shape_of
from gateway.exchange.dispatch import UnitMaps
from gateway.exchange.fast_path import ReadPath
from gateway.exchange.plan import AxisPlan, CompensationMode
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from gateway.state.plan import LinePlan
from gateway.transport.endpoints import SerialEndpoint
from tests.budget.budget_bench import TABLE, TCP, axis, controller, known_axis, line, serial

CHAR_9600 = 1_145_833  # 11 bits
LEAST_MARGIN = 200_000
MARGIN_9600 = 286_458 + 75_000  # a quarter of a character, and what bytes may come later


def both(baudrate: int, axes: tuple[AxisPlan, ...] = (), out_baudrate: int = 0) -> LinePlan:
    return line(serial(out_baudrate or baudrate), controller(serial(baudrate)), axes=axes)


@pytest.mark.parametrize(
    ("baudrate", "character_ns", "margin_ns"),
    [
        (9600, 1_145_833, 361_458),
        (19200, 572_917, 143_229 + 75_000),
        (38400, 286_458, LEAST_MARGIN),
        (115200, 95_486, LEAST_MARGIN),
    ],
)
def test_delays_of_a_write_and_a_read_where_both_sides_are_equal(
    baudrate: int, character_ns: int, margin_ns: int
) -> None:
    write, read = line_budget(both(baudrate)).controllers[0].exchanges
    assert write.forwarding is not None
    assert read.forwarding is not None
    # Of 13 and 8, of 8 and 9 characters: these are waited for, and the margin.
    delays = [delay.delay_ns for each in (write.forwarding, read.forwarding) for delay in each.delays]
    assert delays == [count * character_ns + margin_ns for count in (3, 2, 2, 3)]
    saves = [delay.saves_ns for each in (write.forwarding, read.forwarding) for delay in each.delays]
    assert saves == [count * character_ns - margin_ns for count in (10, 6, 6, 6)]
    assert (write.forwarding.saves_ns, read.forwarding.saves_ns) == (sum(saves[:2]), sum(saves[2:]))


def test_an_exchange_and_a_round_at_9600() -> None:
    only = line_budget(both(9600)).controllers[0]
    write, read = only.exchanges
    assert write.forwarding is not None
    assert read.forwarding is not None
    # 49.125 and 39.958 ms stored (test_budget_of_a_line), less 16 and 12 characters and two margins each.
    assert (
        write.forwarding.legs.total_ns == write.legs.total_ns - 16 * CHAR_9600 + 2 * MARGIN_9600 == 31_514_588
    )
    assert read.forwarding.legs.total_ns == read.legs.total_ns - 12 * CHAR_9600 + 2 * MARGIN_9600
    assert only.round.forwarded_ns == only.round.total_ns - 28 * CHAR_9600 + 4 * MARGIN_9600
    # Without the gateway's own millisecond what is added is 0.27 of one direct round trip.
    assert round((write.forwarding.legs.total_ns - 1_000_000) / write.direct.total_ns - 1, 3) == 0.268


@pytest.mark.parametrize(
    ("other", "characters"),
    [
        (replace(axis("y", 1), command=(PositionField(0x1FE, RegisterType.INT32),)), 4),  # 01xx, as that of x
        (replace(axis("y", 1), command=(PositionField(0x300, RegisterType.INT32),)), 3),
        (axis("y", 2), 3),
    ],
)
def test_a_target_leaves_a_character_later_where_another_one_may_begin_with_the_same_three_bytes(
    other: AxisPlan, characters: int
) -> None:
    write = line_budget(both(9600, (axis(), other))).controllers[0].exchanges[0]
    assert write.forwarding is not None
    assert write.forwarding.delays[0].delay_ns == characters * CHAR_9600 + MARGIN_9600


def test_a_position_whose_lowest_word_comes_first_leaves_a_character_later() -> None:
    fields = (PositionField(0x100, RegisterType.INT32, WordOrder.LOW_FIRST),)
    low_first = replace(axis(), command=fields, actual=(replace(fields[0], address=0x200),))
    write, read = line_budget(both(9600, (low_first,))).controllers[0].exchanges
    assert write.forwarding is not None
    assert read.forwarding is not None
    delays = [delay.delay_ns for each in (write.forwarding, read.forwarding) for delay in each.delays]
    assert delays == [count * CHAR_9600 + MARGIN_9600 for count in (4, 2, 2, 4)]
    # What is held against time-outs is stored, for that may happen to each of them.
    assert write.legs.request_overlap_ns == 0


def test_a_slower_side_in_front_needs_more_delay_and_may_gain_nothing() -> None:
    # 9 600 in, 115 200 out: 13 × 12 − 11 = 145 of the fast characters, of 156; 11 × 95.486 µs − 200 µs are
    # less than a slow character. The other way nothing is in the way of what is slow: the head.
    assert delay_of(write_shape(2, 0, 2), 12 * 95_486, 95_486).delay_ns == 145 * 95_486 + LEAST_MARGIN
    assert delay_of(write_shape(2, 0, 2), 12 * 95_486, 95_486).saves_ns == 0
    assert delay_of(write_shape(2, 0, 2), 95_486, 12 * 95_486) == (4 * 95_486 + MARGIN_9600, 0)
    fast_in = delay_of(write_shape(16, 0, 2), 95_486, 2 * 95_486)
    assert fast_in == (4 * 95_486 + LEAST_MARGIN, 37 * 95_486 - LEAST_MARGIN)


def test_the_reply_keeps_the_silence_behind_the_request_of_its_controller() -> None:
    # A status of one word: 8 + 7 characters, of which 6 + 4 are saved.
    plan = both(9600, (replace(known_axis("oriental-az"), budget_us=1.0),))
    forwarding = next(
        e.forwarding for e in line_budget(plan).controllers[0].exchanges if e.step.what is What.STATUS
    )
    assert forwarding is not None
    # From the last byte of the request: 2 characters to the drive, 3 back, which is more than 3.5.
    assert forwarding.legs.silence_ns == 0
    # At 9 600 in front of drives at 115 200 the drives' side takes less than 3.5 characters.
    plan = both(9600, (replace(axis(), budget_us=1.0),), 115_200)
    forwarding = line_budget(plan).controllers[0].exchanges[0].forwarding
    assert forwarding is not None
    passed_ns = 1_000 + forwarding.legs.request_out_ns + forwarding.legs.reply_in_ns - forwarding.saves_ns
    assert forwarding.legs.silence_ns == 4_010_417 - passed_ns


def test_a_request_that_would_have_to_wait_for_the_silence_of_the_drives_is_stored() -> None:
    plan = both(9600)
    plan = replace(plan, timing=replace(plan.timing, gap_ms=60.0))
    write, read = line_budget(plan).controllers[0].exchanges
    assert write.forwarding is not None
    assert read.forwarding is not None
    assert [each.forwarding.legs.request_overlap_ns for each in (write, read) if each.forwarding] == [0, 0]
    assert write.forwarding.legs.reply_overlap_ns == -(6 * CHAR_9600 - MARGIN_9600)
    # The position that was read before ended so much sooner on the controller's wire, and the request came so
    # much sooner: what is left of the 60 ms is as much more.
    assert write.forwarding.legs.gap_ns - write.legs.gap_ns == 6 * CHAR_9600 - MARGIN_9600


@pytest.mark.parametrize(
    "changed",
    [
        replace(axis(), writes_with=Form.FC06),
        replace(axis(), compensation=CompensationMode.SHADOW),
        replace(axis(), command=(PositionField(0x100, RegisterType.FLOAT32),)),
        known_axis("oriental-az"),  # its map has modes and triggers
    ],
)
def test_targets_that_are_always_stored(changed: AxisPlan) -> None:
    steps = {step.what: step for step in round_of((changed,))}
    assert steps[What.TARGET].shapes is None
    assert steps[What.POSITION].shapes is not None


def test_nothing_of_a_drive_that_checks_no_check_sums_or_behind_tcp() -> None:
    careless = replace(axis(), checks_crc=False)
    assert {step.shapes for step in round_of((careless,))} == {None}
    for plan in (line(TCP, controller(serial(9600))), line(serial(9600), controller(TCP))):
        assert {each.forwarding for each in line_budget(plan).controllers[0].exchanges} == {None}


def test_what_is_said_of_a_line_that_is_to_be_cut_through() -> None:
    def said(plan: LinePlan) -> list[tuple[Grade, str]]:
        found = judge(replace(plan, cut_through=True))
        return [(each.grade, each.found) for each in found if each.key[-1] == "cut_through"]

    assert said(both(9600)) == []
    careless = (replace(axis(), checks_crc=False),)
    told = "cut_through = true, and the drive of axis x executes or answers frames with a wrong CRC"
    assert said(both(9600, careless)) == [(Grade.IMPOSSIBLE, f"{told} (checks_crc = false)")]
    # A million baud: 9 characters of 11 µs are less than the margin.
    fast = SerialEndpoint("/dev/a", 1_000_000, "E")
    assert said(line(fast, controller(fast))) == [
        (Grade.CLOSE, "cut_through = true, but no frame of a round would gain as much as a character")
    ]


def request_of(plan: AxisPlan, step: RoundStep) -> bytes | None:
    """Return a request as its controller would send it, without check sum; None: not by registers."""
    field = plan.command[0]
    if step.what is What.TARGET:
        registers = least_target_registers(plan)
        first = field.end - registers
        head = bytes((plan.unit_id, 16)) + first.to_bytes(2) + registers.to_bytes(2)
        return head + bytes((2 * registers,)) + bytes(2 * registers)
    if step.what is not What.POSITION or plan.reads_with not in (Form.FC03, Form.FC04):
        return None
    field = next(f for f in (*plan.actual, *plan.commanded, *plan.command) if f.is_readable)
    first = field.address if field.block is None else field.block
    function = 3 if plan.reads_with is Form.FC03 else 4
    return bytes((plan.unit_id, function)) + first.to_bytes(2) + (field.end - first).to_bytes(2)


@pytest.mark.parametrize("name", names())
def test_every_shipped_drive_is_cut_through_where_the_exchange_would_do_it(name: str) -> None:
    plan = known_axis(name)
    units = UnitMaps([Axis(plan)], is_serial=True)
    for step in round_of((plan,)):
        request = request_of(plan, step)
        if request is None or (step.what is What.TARGET and plan.writes_with is not Form.FC16):
            continue
        path = units.path_of(plan.unit_id, request[1:])
        shape: FrameShape | None = shape_of(path, request)
        assert (step.shapes is not None) == (shape is not None), step.what
        if step.shapes is not None and shape is not None:
            assert step.shapes.request == shape
            if isinstance(path, ReadPath):
                byte_ranges = [((start - 2) // 2, (end - start) // 2) for start, end in path.byte_ranges]
                early = [first for which, (first, _) in enumerate(byte_ranges) if path.is_early(which)]
                assert step.shapes.reply == reply_shape(path.quantity, byte_ranges, early)


def test_a_larger_block_is_longer_and_its_position_first() -> None:
    (target, *_) = round_of((replace(axis(), table=TABLE),), Blocks(0, 16))
    assert target.shapes is not None
    assert target.shapes.request == write_shape(16, 0, 2, is_early=True)
