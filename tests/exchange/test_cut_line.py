"""A line that cuts through: bytes in and out with their instants, by hand (see ``cut_line_bench``).

The gateway begins to send a write of one position 3.325 ms after its first character (at 4.325). Three of
these are for the eleventh byte, which is sent as the eighth. The rest is the margin: a quarter of a character
and 75 µs. Its 13 characters are off the wire at 17.325. After a spoilt frame 10.5 of silence follow: 27.825.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from gateway.catalogue import exchange_events
from gateway.exchange.axis.record_layout import Remembered
from gateway.exchange.commands import Disable
from gateway.exchange.cut_through.delay import (
    LEARNED_AFTER,
    REMEMBERED,
    Delays,
    acknowledgement_shape,
    margin_ns,
    read_shape,
    reply_shape,
    write_shape,
)
from gateway.exchange.cut_through.frame import ForwardEvent
from gateway.exchange.cut_through.requests import STORED_FOR, WEIGHED_AT_LEAST, Heads
from gateway.exchange.latency import bucket_of
from gateway.exchange.plan import NO_OTHER_UNITS, AxisPlan, ControllerPlan, OtherUnits
from gateway.exchange.transaction import PHASE_AFTER, Phase, Step
from gateway.modbus.crc import INVERTED, is_intact, residue_after
from gateway.modbus.registers import BitField
from gateway.modbus.rtu import RtuRequestDecoder
from gateway.recording import traffic
from gateway.recording.tap import RecordingTap
from gateway.recording.trace_buffer import ANSWERED, REPLY, REQUEST, SENT, TICK
from tests.exchange.cut_bench import learn
from tests.exchange.cut_line_bench import CHAR_NS, PLAN, WIRE, Left, PieceLink, PiecePort, Site, frame_of
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Port, read, stream_plan, write
from tests.exchange.record_bench import Records
from tests.exchange.staged_bench import STOP_PDU, staged_plan
from tests.exchange.test_cut_replies import BLOCK, STATUS
from tests.exchange.test_fast_path import CURVE

WRITE_SHAPE = write_shape(2, 0, 2)
NEXT = write(COMMAND, 10_040)
"""10 040 is 0000 2738, and leaves as 0000 2744: twelve counts more."""
HEAD = [(4.325, "01 10 06 06"), (5.0, "00"), (6.0, "02"), (7.0, "04")]
WHOLE = [*HEAD, (11.0, "27 44 00 00"), (13.0, "12 84")]
ACKNOWLEDGED = frame_of(NEXT[:5])
OTHER = bytes.fromhex("03 08 00 00 01")
"""A read of the panel."""


def site(*plans: AxisPlan, **options: Any) -> Site:
    """Return a line with a settled stream, whose next setpoint may be cut through."""
    found = Site(*plans, **options)
    found.settle()
    found.measure(WRITE_SHAPE, read_shape())
    return found


def ends_aborted(left: Left, length: int = 13) -> None:
    """Assert that the sent bytes have the length of their head, and are no intact frame."""
    frame = bytes.fromhex(" ".join(data for _, data in left))
    assert (len(frame), residue_after(frame)) == (length, INVERTED)


def test_a_setpoint_is_sent_four_characters_after_it_came_and_its_reply_two() -> None:
    line = site()
    line.measure(acknowledgement_shape(), of_replies=True)
    began_ns = line.come(frame_of(NEXT))
    assert line.to_drives(began_ns) == WHOLE
    assert is_intact(bytes.fromhex(" ".join(data for _, data in WHOLE)))
    current = line.line._transactions.current
    assert current is not None
    assert (current.phase, current.arrived_ns) == (Phase.SENT, began_ns + 13 * MS)
    line.pass_to(began_ns + 20 * MS)
    began_ns = line.reply(ACKNOWLEDGED)
    assert line.to_cnc(began_ns) == [
        (2.325, "01 10"),
        (3.0, "06"),
        (4.0, "06"),
        (5.0, "00"),
        (6.0, "02"),
        (8.0, ACKNOWLEDGED[-2:].hex(" ")),
    ]
    assert line.line.is_idle
    assert line.cnc.replies == [(0, 1, NEXT[:5])]  # once
    assert (line.requests(), line.replies()) == ({ForwardEvent.COMMITTED: 1}, {ForwardEvent.COMMITTED: 1})
    assert line.line.axes[0].fields[0].nominal_words == NEXT[6:]
    assert line.forwarding.underruns == 0
    # The request was off the wire at 17.325, and the reply began at 20.
    assert line.line.meter.measured["cnc", 1].drive[bucket_of(2_675_000)] == 1


class Heard(RecordingTap):
    """Records the frames that it gets: their kinds in order, the numbers of their ports, and their PDUs."""

    def __init__(self) -> None:
        super().__init__("line")
        self.frames: list[tuple[int, int, str]] = []
        self.entries: list[traffic.Entry] = []

    def frame(self, kind: int, t_ns: int, ids: int, pdu: bytes) -> None:
        if kind != TICK:
            self.frames.append((kind, ids >> 24, pdu.hex()))

    def entry(self, entry: traffic.Entry) -> None:
        self.entries.append(entry)


def test_a_tap_gets_forwarded_frames_in_the_order_of_stored_ones() -> None:
    heard = Heard()
    line = site(tap=heard)
    line.measure(acknowledgement_shape(), of_replies=True)
    stored, heard.frames = heard.frames[-4:], []
    assert [kind for kind, _, _ in stored] == [REQUEST, SENT, REPLY, ANSWERED]
    line.come(frame_of(NEXT))
    line.pass_to(line.bench.now_ns + 20 * MS)
    line.reply(ACKNOWLEDGED)
    assert (line.requests(), line.replies()) == ({ForwardEvent.COMMITTED: 1}, {ForwardEvent.COMMITTED: 1})
    sent = write(COMMAND, 10_052)
    assert heard.frames == [
        (REQUEST, 1, NEXT.hex()),
        (SENT, 0, sent.hex()),
        (REPLY, 0, sent[:5].hex()),
        (ANSWERED, 1, NEXT[:5].hex()),
    ]
    line.line.controller_gone(line.cnc, line.bench.now_ns)
    line.hear(line.panel, frame_of(OTHER))
    assert heard.entries[-1] == traffic.Gone("line", line.bench.now_ns, 1)
    assert heard.frames[4:] == [(REQUEST, 2, OTHER.hex()), (SENT, 0, OTHER.hex())]


def test_is_leaving_is_true_while_a_frame_is_being_forwarded() -> None:
    line = site()
    line.measure(acknowledgement_shape(), of_replies=True)
    seen = []
    for frame, comes in ((frame_of(NEXT), partial(line.hear, line.cnc)), (ACKNOWLEDGED, line.answer)):
        for number in range(len(frame)):
            line.pass_to(line.bench.now_ns + CHAR_NS)
            comes(frame[number : number + 1])
            seen.append(line.forwarding.is_leaving)
        line.pass_to(line.bench.now_ns + 5 * MS)
    # Its first bytes leave at 4.325, the acknowledgement's at 2.325: with the fifth and the third to come.
    assert seen == [*[False] * 4, *[True] * 8, False, *[False] * 2, *[True] * 5, False]


def test_a_read_is_sent_from_its_function_code_on_and_a_position_in_its_reply_when_it_is_whole() -> None:
    line = Site(stream_plan(table=CURVE, bits={"done": BitField(STATUS, 0)}))
    line.settle()
    line.bench.ask(BLOCK)
    line.forget()
    line.measure(read_shape())
    line.measure(reply_shape(3, [(0, 2)]), of_replies=True)
    line.pass_to(line.bench.now_ns + 10 * MS)
    began_ns = line.come(frame_of(BLOCK))
    assert line.to_drives(began_ns) == [
        (2.325, "01 03"),
        (3.0, "05"),
        (4.0, "20"),
        (5.0, "00"),
        (6.0, "03"),
        (8.0, frame_of(BLOCK)[-2:].hex(" ")),
    ]
    drive = line.bench.memory.answer(BLOCK)
    told = ACTUAL.pack(10_000)
    began_ns = line.reply(frame_of(drive))
    passed = frame_of(drive[:2] + told + drive[6:])
    # The position is whole with the seventh byte, and leaves as the fourth: after three and a margin.
    assert line.to_cnc(began_ns) == [
        (4.325, "01 03 06"),
        (7.0, told.hex(" ")),
        (8.0, drive[6:7].hex(" ")),
        (9.0, drive[7:8].hex(" ")),
        (11.0, passed[-2:].hex(" ")),
    ]


def test_w3_a_bad_check_sum_is_sent_bad_in_both_bytes_and_nothing_follows_in_the_silence() -> None:
    line = site()
    frame = frame_of(NEXT)
    began_ns = line.come(frame[:-1] + bytes((frame[-1] ^ 0x10,)))
    # ED 7B are the bits of 12 84, all of them inverted.
    assert line.to_drives(began_ns) == [*HEAD, (11.0, "27 44 00 00"), (13.0, "ed 7b")]
    assert (line.line.is_idle, line.line.deadline_ns) == (True, began_ns + 27_825_000)
    line.hear(line.panel, frame_of(OTHER))
    line.pass_to(began_ns + 40 * MS)
    assert line.to_drives(began_ns) == [(27.825, frame_of(OTHER).hex(" "))]
    assert line.requests() == {ForwardEvent.BAD: 1}
    # Nothing was lost: that never was a request (M3).
    assert (line.line.counters.refused, line.bench.kinds()) == (0, ["line-up", "stream-began"])


def test_a_frame_that_stalls_is_spoilt_and_sent_after_the_silence_if_the_rest_comes() -> None:
    line = site()
    frame = frame_of(NEXT)
    began_ns = line.come(frame[:6])
    line.pass_to(began_ns + 9 * MS)
    # A character and a pause of 1.5 behind the sixth byte: 6 + 2.5.
    left = line.to_drives(began_ns)
    assert [when for when, _ in left] == [4.325, 5.0, 6.0, 8.5]
    ends_aborted(left)
    line.come(frame[6:])
    line.pass_to(began_ns + 40 * MS)
    sent = bytes.fromhex(" ".join(data for _, data in WHOLE)).hex(" ")
    assert line.to_drives(began_ns) == [(27.825, sent)]
    assert line.requests() == {ForwardEvent.STALLED: 1}


def test_a_process_that_stood_still_in_the_middle_of_a_frame_spoils_it_whatever_it_handles_first() -> None:
    """After 60 ms the decoder's timer, the port and the forwarder's timer are due, and are called in this
    order."""
    line = site(PLAN, staged_plan(name="y", unit_id=2))
    frame = frame_of(NEXT)
    began_ns = line.come(frame[:5])
    assert line.to_drives(began_ns) == HEAD[:2]
    now_ns = line.bench.now_ns = began_ns + 65 * MS
    assert line.cnc.decoder.on_silence(now_ns) == []
    line.hear(line.cnc, frame[5:])
    line.forwarder.tick(now_ns)
    filled = line.to_drives(began_ns)
    assert [when for when, _ in filled] == [65.0]
    ends_aborted([*HEAD[:2], *filled])
    assert line.requests() == {ForwardEvent.STALLED: 1}
    # Eight characters are on the wire until 73; then three silences of 3.5.
    line.hear(line.panel, frame_of(STOP_PDU, 2))
    line.pass_to(began_ns + 200 * MS)
    assert line.to_drives(began_ns) == [(83.5, frame_of(STOP_PDU, 2).hex(" "))]
    line.answer(frame_of(STOP_PDU, 2))
    again_ns = line.come(frame)
    assert line.to_drives(again_ns) == WHOLE
    assert line.requests() == {ForwardEvent.STALLED: 1, ForwardEvent.COMMITTED: 1}


def test_a_target_that_may_not_be_forwarded_takes_the_slow_path_after_the_silence() -> None:
    line = site()
    turned = write(COMMAND, 9_000)  # the way turns: the slow path decides
    began_ns = line.come(frame_of(turned))
    left = line.to_drives(began_ns)
    assert left[:-1] == HEAD
    assert left[-1][0] == 11.0
    ends_aborted(left)
    line.pass_to(began_ns + 40 * MS)
    ((when, sent),) = line.to_drives(began_ns)
    assert when == 27.825
    assert is_intact(bytes.fromhex(sent))
    assert line.requests() == {ForwardEvent.REFUSED: 1}
    current = line.line._transactions.current
    assert current is not None
    assert (current.pdu, current.path) == (turned, None)


@pytest.mark.parametrize(("bytes_come", "aborted_at"), [(6, 6.4), (8, 8.4), (12, 12.4)])
def test_m3_a_stop_of_another_controller_spoils_the_frame_and_is_sent(
    bytes_come: int, aborted_at: float
) -> None:
    line = site(PLAN, staged_plan(name="y", unit_id=2))
    began_ns = line.come(frame_of(NEXT)[:bytes_come])
    line.pass_to(began_ns + int(aborted_at * MS))
    line.hear(line.panel, frame_of(STOP_PDU, 2))
    left = line.to_drives(began_ns)
    assert left[-1][0] == aborted_at
    ends_aborted(left)
    assert line.requests() == {ForwardEvent.OVERTAKEN: 1}
    # The rest of it comes while the stop waits: it goes after the stop.
    line.come(frame_of(NEXT)[bytes_come:], since_ns=began_ns + bytes_come * MS)
    line.pass_to(began_ns + 30 * MS)
    assert line.to_drives(began_ns) == [(27.825, frame_of(STOP_PDU, 2).hex(" "))]
    line.answer(frame_of(STOP_PDU, 2))
    sent = bytes.fromhex(" ".join(data for _, data in WHOLE)).hex(" ")
    assert line.to_drives(began_ns) == [(30.0, sent)]


def test_a_request_of_another_controller_waits_for_the_reply_to_a_forwarded_one() -> None:
    line = site()
    began_ns = line.come(frame_of(NEXT)[:8])
    line.hear(line.panel, frame_of(OTHER))
    line.come(frame_of(NEXT)[8:])
    assert line.to_drives(began_ns) == WHOLE
    line.pass_to(began_ns + 20 * MS)
    line.answer(ACKNOWLEDGED)
    line.pass_to(began_ns + 40 * MS)
    assert line.to_drives(began_ns)[0][1] == frame_of(OTHER).hex(" ")


def test_a_request_without_a_silence_before_it_is_sent_after_the_reply_to_a_forwarded_one() -> None:
    line = site()
    began_ns = line.come(frame_of(NEXT))
    line.come(frame_of(read(ACTUAL)))
    assert line.to_drives(began_ns) == WHOLE
    line.pass_to(began_ns + 40 * MS)
    line.answer(ACKNOWLEDGED)
    assert line.to_drives(began_ns) == [(40.0, frame_of(read(ACTUAL)).hex(" "))]
    assert line.cnc.replies == []  # it has given up on the first one


def test_a_controller_holds_its_axis_with_forwarded_setpoints() -> None:
    """W9: for 100 ms after each of them, also 288 ms after the last stored one."""
    line = site(stream_plan(table=CURVE, writer_hold_s=0.1))
    for number in range(12):
        request = write(COMMAND, 10_040 + 40 * number)
        began_ns = line.come(frame_of(request))
        line.pass_to(began_ns + 17 * MS)
        line.answer(frame_of(request[:5]))
        line.pass_to(began_ns + 24 * MS)
    assert line.requests() == {ForwardEvent.COMMITTED: 12}
    other = Port(ControllerPlan("plc"))
    line.line.request(other, 1, 1, write(COMMAND, 0), line.bench.now_ns)
    assert other.take() == bytes.fromhex("90 06")


@pytest.mark.parametrize("is_in_time", [True, False])
def test_w6_a_reply_is_forwarded_if_it_begins_to_be_sent_before_its_controller_gives_up(
    *, is_in_time: bool
) -> None:
    """The reply begins at 20, 7 ms after the request had come, and to be sent 2.325 later."""
    line = site()
    line.measure(acknowledgement_shape(), of_replies=True)
    began_ns = line.come(frame_of(NEXT))
    line.pass_to(began_ns + 20 * MS)
    line.cnc.patience_ns = 9_325_000 - (not is_in_time)
    began_ns = line.reply(ACKNOWLEDGED)
    left = " ".join(data for _, data in line.to_cnc(began_ns))
    assert left == (ACKNOWLEDGED.hex(" ") if is_in_time else "")
    assert line.replies() == {ForwardEvent.COMMITTED if is_in_time else ForwardEvent.KEPT: 1}
    assert (line.bench.kinds()[-1] == "late-reply") is not is_in_time


def hear_whole(line: Site, count: int) -> None:
    """Let a setpoint come in one piece, and be answered, so many times."""
    for number in range(count):
        request = write(COMMAND, 10_080 + 40 * number)
        line.hear(line.cnc, frame_of(request))
        line.pass_to(line.bench.now_ns + 20 * MS)
        line.answer(frame_of(request[:5]))
        line.pass_to(line.bench.now_ns + 20 * MS)


def test_the_status_says_how_much_sooner_forwarded_requests_began_and_how_many_were_stored() -> None:
    """The first one began to be sent at 4.325 and had come at 13; three came in one piece."""
    line = site()
    began_ns = line.come(frame_of(NEXT))
    line.pass_to(began_ns + 20 * MS)
    line.answer(ACKNOWLEDGED)
    line.pass_to(began_ns + 40 * MS)
    hear_whole(line, 3)
    status = line.forwarding.requests.status()
    assert (status.cut_through, status.gain_us) == (1, 8_675)
    assert (status.stored, status.spoilt) == ({"kept": 3}, {})


def test_frames_that_gain_nothing_are_reported_once_for_each_direction() -> None:
    line = site()
    hear_whole(line, LEARNED_AFTER + 2)
    told = [each.detail for each in line.bench.events if each.kind is exchange_events.CUT_THROUGH_OFF]
    assert [detail.partition(" could")[0] for detail in told] == [
        "requests of cnc: one of 13 bytes",
        "replies of cnc: one of 8 bytes",
    ]


def test_a_port_lost_during_forwarding_spoils_its_request() -> None:
    line = site()
    began_ns = line.come(frame_of(NEXT)[:8])
    line.line.controller_gone(line.cnc, line.bench.now_ns)
    left = line.to_drives(began_ns)
    assert [when for when, _ in left] == [4.325, 5.0, 6.0, 7.0, 8.0]
    ends_aborted(left)
    assert (line.line.is_idle, line.requests()) == (True, {ForwardEvent.GONE: 1})


def test_a_drive_link_lost_during_forwarding_gets_no_more_of_the_request() -> None:
    line = site()
    began_ns = line.come(frame_of(NEXT)[:8])
    line.line.link_down(line.bench.now_ns)
    line.come(frame_of(NEXT)[8:])
    assert line.to_drives(began_ns) == HEAD
    assert (line.line.is_idle, line.requests()) == (True, {ForwardEvent.LOST: 1})
    assert line.cnc.replies == []  # a serial controller: silence


def test_bytes_from_the_drives_spoil_a_request_that_is_being_forwarded() -> None:
    line = site()
    began_ns = line.come(frame_of(NEXT)[:8])
    line.answer(b"\x01")
    ends_aborted(line.to_drives(began_ns))
    assert (line.requests(), line.line.counters.late) == ({ForwardEvent.MET: 1}, 1)


def test_w5_a_controller_that_begins_another_request_spoils_the_one_before() -> None:
    line = site()
    frame = frame_of(NEXT)
    began_ns = line.come(frame[:12])
    line.pass_to(began_ns + 13 * MS)
    line.hear(line.cnc, frame[12:] + frame_of(read(ACTUAL))[:1])
    left = line.to_drives(began_ns)
    ends_aborted(left)
    assert line.requests() == {ForwardEvent.ANEW: 1}


def test_a_gateway_that_stops_lets_a_forwarded_request_end() -> None:
    line = site()
    began_ns = line.come(frame_of(NEXT)[:8])
    line.line.stop(line.bench.now_ns)
    assert not line.line.is_idle
    line.come(frame_of(NEXT)[8:])
    assert line.to_drives(began_ns) == WHOLE


def test_the_record_names_a_forwarded_target_before_its_check_sum_is_sent() -> None:
    records = Records()
    line = site(before_up=records.attach)
    line.link.on_piece = lambda: told.append(records.read())
    told: list[Remembered | None] = []
    line.come(frame_of(NEXT))
    # With each of its pieces: what was sent before, and with the check sum what leaves.
    before, after = told[0], told[-1]
    assert told == [before] * 5 + [after]
    assert before is not None
    assert after is not None
    assert (before.unacknowledged is None, after.unacknowledged is not None) == (True, True)


def stands_still(line: Site, wire: PieceLink | PiecePort, before: int, late_ms: float) -> None:
    """Let the process stand still between reading and writing, when ``before`` pieces were sent."""

    def stand_still() -> None:
        if len(wire.left) == before:
            line.bench.now_ns += int(late_ms * MS)

    wire.on_piece = stand_still


@pytest.mark.parametrize(("late_ms", "torn"), [(0.1, 0), (1.0, 1)])
def test_a_request_is_torn_if_its_next_bytes_are_written_after_the_transmitter_is_empty(
    late_ms: float, torn: int
) -> None:
    line = site()
    stands_still(line, line.link, 4, late_ms)
    began_ns = line.come(frame_of(NEXT))
    # What left before the position was off the wire at 11.325.
    assert line.to_drives(began_ns) == [*HEAD, (11.0 + late_ms, "27 44 00 00"), (13.0, "12 84")]
    assert (line.requests(), line.forwarding.underruns) == ({ForwardEvent.COMMITTED: 1}, torn)


def test_a_request_is_not_torn_whose_first_bytes_were_written_late_and_the_next_ones_in_time() -> None:
    """The process stands still between reading its clock and its first write: sending begins with that
    write."""
    line = site()
    began_ns = line.come(frame_of(NEXT)[:4])
    line.bench.now_ns = began_ns + 11 * MS
    line.forwarder.tick(began_ns + 4_325_000)
    line.hear(line.cnc, frame_of(NEXT)[4:10])
    left = line.to_drives(began_ns)
    assert [when for when, _ in left] == [11.0, 11.0]  # late by its clock: filled up
    ends_aborted(left)
    # By the clock of before its first write it was empty from 8.325 on; it was not before 15.
    assert (line.requests(), line.forwarding.underruns) == ({ForwardEvent.STALLED: 1}, 0)


@pytest.mark.parametrize(
    ("late_ms", "begins"),
    [
        # Three characters after its first one, what they were late, and the margin.
        (0.1, (4.425, "01 10 06 06")),
        (1.0, (5.325, "01 10 06 06 00")),
    ],
)
def test_requests_are_sent_later_by_the_gateways_own_delay(late_ms: float, begins: tuple[float, str]) -> None:
    line = site()
    left = []
    for number in range(3):
        line.forget()
        stands_still(line, line.link, 4, late_ms)
        began_ns = line.come(frame_of(write(COMMAND, 10_040 + 20 * number)))
        left.append(line.to_drives(began_ns)[0])
        line.link.on_piece = lambda: None
        line.reply(ACKNOWLEDGED)
        line.pass_to(line.bench.now_ns + 10 * MS)
    assert left == [HEAD[0], begins, begins]
    assert line.requests() == {ForwardEvent.COMMITTED: 3}


def test_a_gateway_that_is_always_too_slow_tears_one_request_and_stores_all_others() -> None:
    line = site()

    def takes_8_ms() -> None:
        cut = line.forwarder._frame
        if cut is None or cut.is_over:  # stored, or the check sum leaves
            line.bench.now_ns += 8 * MS

    line.link.on_piece = takes_8_ms
    for number in range(2 * REMEMBERED):
        line.come(frame_of(write(COMMAND, 10_040 + 20 * number)))
        line.pass_to(line.bench.now_ns + 10 * MS)
        line.reply(ACKNOWLEDGED)
        line.pass_to(line.bench.now_ns + 10 * MS)
    # 3 + 8 characters, the margin and the one to be gained are more than the 12 in which it is whole.
    assert line.requests() == {ForwardEvent.COMMITTED: 1}
    assert (line.forwarding.requests.ended[ForwardEvent.KEPT], line.forwarding.underruns) == (
        2 * REMEMBERED - 1,
        1,
    )


@pytest.mark.parametrize("is_good", [True, False])
def test_a_frame_sent_in_one_write_is_not_torn_and_its_silence_begins_after_it(is_good: bool) -> None:
    line = site()
    frame = frame_of(NEXT)
    began_ns = line.come(frame[:4])  # nobody looks at 4.325
    line.bench.now_ns = began_ns + 5 * MS
    stands_still(line, line.link, 0, 5.0)  # what is read at 5 is written at 10
    line.hear(line.cnc, frame[4:] if is_good else frame[4:-1] + bytes((frame[-1] ^ 0x10,)))
    assert [(when, len(bytes.fromhex(data))) for when, data in line.to_drives(began_ns)] == [(10.0, 13)]
    assert line.forwarding.underruns == 0
    if not is_good:  # 13 characters and three silences of 3.5
        assert line.line.deadline_ns == began_ns + 33_500_000


def test_the_guard_timer_ends_in_time_also_after_a_slow_write() -> None:
    line = site()
    stands_still(line, line.link, 0, 0.8)  # the first four bytes are with the driver at 4.325 or at 5.125
    began_ns = line.come(frame_of(NEXT)[:10])
    line.pass_to(began_ns + 20 * MS)
    *_, (when, data) = line.to_drives(began_ns)
    # Seven bytes, from 4.325 on, are off the wire at 11.325: filled up a quarter before.
    assert (when, len(bytes.fromhex(data))) == (11.075, 6)
    assert (line.requests(), line.forwarding.underruns) == ({ForwardEvent.STALLED: 1}, 0)


@pytest.mark.parametrize(("late_ms", "torn"), [(0.1, 0), (1.0, 1)])
def test_a_reply_is_torn_if_its_next_bytes_are_written_after_the_transmitter_is_empty(
    late_ms: float, torn: int
) -> None:
    line = site()
    line.measure(acknowledgement_shape(), of_replies=True)
    line.pass_to(line.come(frame_of(NEXT)) + 20 * MS)
    stands_still(line, line.cnc, 5, late_ms)
    began_ns = line.reply(ACKNOWLEDGED)
    # Its first six bytes were off the wire at 8.2.
    assert line.to_cnc(began_ns)[-1] == (8.0 + late_ms, ACKNOWLEDGED[-2:].hex(" "))
    assert (line.replies(), line.forwarding.underruns) == ({ForwardEvent.COMMITTED: 1}, torn)


@pytest.mark.parametrize("what", ["down", "busy", "resting", "silent", "stopping", "link", "gate"])
def test_a_request_that_could_not_be_sent_immediately_is_stored(what: str) -> None:
    line = site()
    if what == "down":
        line.line.link_down(line.bench.now_ns)
        line.forget()
    elif what == "busy":
        line.hear(line.panel, frame_of(OTHER))
        line.forget()
    elif what == "resting":
        line.line.rest.drain(line.bench.now_ns)
    elif what == "silent":
        line.line.silent_units.miss(1, line.bench.now_ns, line.bench.now_ns)
    elif what == "stopping":
        line.line.stop(line.bench.now_ns)
    elif what == "link":
        line.link.is_busy = True
    elif what == "gate":
        line.cnc.gate = line.panel.gate
    began_ns = line.come(frame_of(NEXT)[:12])
    assert line.to_drives(began_ns) == []


def test_a_request_is_stored_if_another_one_takes_the_line_during_its_delay() -> None:
    line = site()
    began_ns = line.come(frame_of(NEXT)[:4])
    line.pass_to(began_ns + 4_100_000)
    line.hear(line.panel, frame_of(OTHER))  # a quarter of a character too soon
    line.come(frame_of(NEXT)[4:], since_ns=began_ns + 4 * MS)
    assert line.to_drives(began_ns) == [(4.1, frame_of(OTHER).hex(" "))]
    assert line.requests() == {}


def test_two_setpoints_in_a_row_are_cut_through() -> None:
    line = site()
    for counts in (10_040, 10_080, 10_120):
        line.come(frame_of(write(COMMAND, counts)))
        line.pass_to(line.bench.now_ns + 5 * MS)
        line.answer(ACKNOWLEDGED)
        line.pass_to(line.bench.now_ns + 5 * MS)
    assert line.requests() == {ForwardEvent.COMMITTED: 3}
    assert [reply for _, _, reply in line.cnc.replies] == [NEXT[:5]] * 3
    assert line.line.axes[0].fields[0].nominal_words == write(COMMAND, 10_120)[6:]


# --- replies --------------------------------------------------------------------------------------------


def asked(pdu: bytes = NEXT) -> Site:
    """Return a line with a request on the wire, whose reply may be cut through."""
    line = site()
    line.measure(acknowledgement_shape(), reply_shape(2, [(0, 2)]), of_replies=True)
    line.come(frame_of(pdu))
    line.forget()
    line.pass_to(line.bench.now_ns + 5 * MS)
    return line


def test_a_reply_with_a_bad_check_sum_is_passed_on_as_one_that_is_bad_in_both_bytes() -> None:
    line = asked()
    began_ns = line.reply(ACKNOWLEDGED[:-1] + bytes((ACKNOWLEDGED[-1] ^ 1,)))
    ends_aborted(line.to_cnc(began_ns), 8)
    assert (line.replies(), line.line.is_idle) == ({ForwardEvent.BAD: 1}, False)
    line.pass_to(began_ns + 1100 * MS)
    assert line.line.counters.timeouts == 1
    assert line.cnc.replies == []


def test_a_reply_that_stalls_is_spoilt_and_counts_nevertheless() -> None:
    line = asked()
    began_ns = line.reply(ACKNOWLEDGED[:5])
    line.pass_to(began_ns + 12 * MS)
    left = line.to_cnc(began_ns)
    assert [when for when, _ in left] == [2.325, 3.0, 4.0, 5.0, 7.075]  # a quarter before it would be empty
    ends_aborted(left, 8)
    line.reply(ACKNOWLEDGED[5:])
    assert (line.line.is_idle, line.cnc.replies) == (True, [])
    assert line.line.axes[0].fields[0].nominal_words == NEXT[6:]
    # Such replies are stored for a while: its controller had to ask again.
    line.pass_to(line.bench.now_ns + 20 * MS)
    line.come(frame_of(NEXT))
    line.forget()
    line.reply(ACKNOWLEDGED)
    assert line.cnc.replies == [(0, 1, NEXT[:5])]
    assert line.replies() == {ForwardEvent.STALLED: 1, ForwardEvent.KEPT: 1}


def test_w4_a_wrong_acknowledgement_is_spoilt_and_does_not_count() -> None:
    line = asked()
    began_ns = line.reply(frame_of(bytes.fromhex("10 FF FF 00 02")))
    left = line.to_cnc(began_ns)
    ends_aborted(left, 8)
    assert (line.replies(), line.line.is_idle, line.cnc.replies) == ({ForwardEvent.CHANGED: 1}, True, [])
    assert line.line.axes[0].fields[0].nominal_words != NEXT[6:]


def test_an_exception_is_passed_on_whole() -> None:
    line = asked()
    began_ns = line.reply(frame_of(b"\x90\x06"))
    assert line.to_cnc(began_ns) == [(5.0, frame_of(b"\x90\x06").hex(" "))]


def test_a_drive_link_lost_during_forwarding_spoils_the_reply() -> None:
    line = asked()
    began_ns = line.reply(ACKNOWLEDGED[:5])
    line.line.link_down(line.bench.now_ns)
    ends_aborted(line.to_cnc(began_ns), 8)
    assert line.replies() == {ForwardEvent.GONE: 1}


def test_a_controller_lost_during_forwarding_gets_no_more_of_its_reply() -> None:
    line = asked()
    began_ns = line.reply(ACKNOWLEDGED[:5])
    line.line.controller_gone(line.cnc, line.bench.now_ns)
    line.reply(ACKNOWLEDGED[5:])
    assert line.to_cnc(began_ns) == [(2.325, "01 10"), (3.0, "06"), (4.0, "06"), (5.0, "00")]
    assert (line.replies(), line.line.is_idle) == ({ForwardEvent.LOST: 1}, True)


def test_a_reply_is_stored_while_the_controllers_port_is_busy() -> None:
    line = asked()
    line.cnc.is_busy = True
    began_ns = line.reply(ACKNOWLEDGED)
    assert line.to_cnc(began_ns) == [(8.0, ACKNOWLEDGED.hex(" "))]


# --- whether it pays ------------------------------------------------------------------------------------


def test_writes_whose_forwarding_lost_time_are_stored_for_a_while() -> None:
    heads = Heads(Delays(CHAR_NS, CHAR_NS, margin_ns(CHAR_NS)))
    line = site()
    pdu = b"\x01" + NEXT
    heads.add(line.forwarding.units.path_of(1, NEXT), pdu, pdu)
    learn(heads.delays, WRITE_SHAPE, char_ns=CHAR_NS)
    assert heads.opening(pdu[:4]) is not None
    for _ in range(WEIGHED_AT_LEAST - 1):
        heads.pay(pdu, 9 * MS)
    heads.pay(pdu, -8 * 9 * MS)
    assert heads.opening(pdu[:4]) is None
    for _ in range(STORED_FOR - 1):
        heads.came(pdu)
        assert heads.opening(pdu[:4]) is None
    heads.came(pdu)
    assert heads.opening(pdu[:4]) is not None


def stall(line: Site) -> None:
    """Feed only six bytes of a write: its spoilt frame costs 10.5 ms of silence and 11 characters more than
    storing."""
    line.come(frame_of(NEXT)[:6])
    line.pass_to(line.bench.now_ns + 60 * MS)
    line.forget()


def test_a_write_that_stalls_again_and_again_is_stored() -> None:
    line = site()
    for _ in range(WEIGHED_AT_LEAST):
        stall(line)
    assert line.requests() == {ForwardEvent.STALLED: WEIGHED_AT_LEAST}
    began_ns = line.come(frame_of(NEXT))
    assert line.to_drives(began_ns) == [(13.0, " ".join(data for _, data in WHOLE))]
    assert line.requests() == {ForwardEvent.STALLED: WEIGHED_AT_LEAST}


def test_a_write_that_stalls_now_and_then_is_forwarded() -> None:
    """Each of the 24 that come whole is 8.675 ms earlier than stored: 208.2 ms; eight stalls cost 172."""
    line = site()
    for _ in range(WEIGHED_AT_LEAST):
        for _ in range(3):
            line.come(frame_of(NEXT))
            line.pass_to(line.bench.now_ns + 20 * MS)
            line.answer(ACKNOWLEDGED)
            line.pass_to(line.bench.now_ns + 20 * MS)
        stall(line)
    began_ns = line.come(frame_of(NEXT))
    assert line.to_drives(began_ns) == WHOLE


def test_a_line_without_the_key_has_no_forwarding() -> None:
    assert Bench(PLAN).line.forwarding is None


# --- each end in each state -----------------------------------------------------------------------------

STATES = {"begun": 4, "head": 6, "whole-head": 7, "data": 11, "checked": 12}
"""Characters that have come: nothing has left, then some of its head, all of it, its position."""


def _stop(line: Site) -> None:
    line.hear(line.panel, frame_of(STOP_PDU, 2))


def _noise(line: Site) -> None:
    line.answer(b"\x55")


def _port(line: Site) -> None:
    line.line.controller_gone(line.cnc, line.bench.now_ns)


def _wire(line: Site) -> None:
    line.line.link_down(line.bench.now_ns)
    line.line.link_up(line.bench.now_ns)


def _silence(line: Site) -> None:
    line.pass_to(line.bench.now_ns + 3 * CHAR_NS)


def _table(line: Site) -> None:
    line.line.command(Disable(axes=("x",)), line.bench.now_ns)


ENDS: dict[Callable[[Site], None], ForwardEvent] = {
    _stop: ForwardEvent.OVERTAKEN,
    _noise: ForwardEvent.MET,
    _port: ForwardEvent.GONE,
    _wire: ForwardEvent.LOST,
    _silence: ForwardEvent.STALLED,
    _table: ForwardEvent.CHANGED,
}


@pytest.mark.parametrize("end", ENDS, ids=lambda end: end.__name__.strip("_"))
@pytest.mark.parametrize("state", STATES)
def test_each_end_in_each_state_leaves_a_line_that_works(state: str, end: Callable[[Site], None]) -> None:
    line = site(PLAN, staged_plan(name="y", unit_id=2))
    frame = frame_of(NEXT)
    began_ns = line.come(frame[: STATES[state]])
    has_begun = line.line._transactions.current is not None
    assert has_begun == (state != "begun")
    if has_begun:
        assert line.line._transactions.current is not None
        assert line.line._transactions.current.phase is Phase.LEAVING
    end(line)
    line.come(frame[STATES[state] :])
    left = line.to_drives(began_ns)
    if has_begun:
        is_judged = STATES[state] >= 11
        why = ForwardEvent.REFUSED if end is _table and not is_judged else ENDS[end]
        assert line.requests() == {why: 1}
        if end is _wire:
            assert all(when < STATES[state] + 1 for when, _ in left)
        else:
            aborted = [data for when, data in left if when < 27.7]
            ends_aborted([(0.0, data) for data in aborted])
    # Whatever is owed is answered, then the line is as any other, and the next setpoint goes through.
    for _ in range(4):
        line.pass_to(line.bench.now_ns + 1500 * MS)
        if line.line._transactions.current is not None:
            line.serve()
    assert line.line.is_idle
    assert line.line.rest.until_ns is None
    line.forget()
    line.hear(line.cnc, frame_of(write(COMMAND, 10_080)))
    for _ in range(4):
        if line.line._transactions.current is not None:
            line.serve()
    assert line.cnc.replies[-1] == (0, 1, NEXT[:5])
    assert line.line.axes[0].fields[0].nominal_words == write(COMMAND, 10_080)[6:]


@pytest.mark.parametrize("is_named", [False, True])
def test_w12_requests_to_a_named_device_are_stored(*, is_named: bool) -> None:
    other = OtherUnits(frozenset({5}), frozenset({5})) if is_named else NO_OTHER_UNITS
    line = Site(other_units=other)
    line.settle()
    asked, answer = bytes.fromhex("03 07 00 00 01"), bytes.fromhex("03 02 00 05")
    line.bench.send(asked, line.cnc, unit_id=5)
    line.line.reply(5, answer, line.bench.now_ns)
    line.forget()
    line.measure(read_shape())
    line.pass_to(line.bench.now_ns + 10 * MS)
    frame = frame_of(asked, 5)
    began_ns = line.come(frame)
    left = line.to_drives(began_ns)
    assert bytes.fromhex(" ".join(data for _, data in left)) == frame
    assert left[0][0] == (8.0 if is_named else 2.325)
    assert line.requests() == ({} if is_named else {ForwardEvent.COMMITTED: 1})


def test_w12_an_odd_frame_that_begins_like_a_read_is_stored() -> None:
    line = Site(other_units=OtherUnits(frozenset({5}), frozenset({5})))
    line.cnc.ends_by_silence = True
    line.cnc.decoder = RtuRequestDecoder(WIRE.silence_ns, odd_units=frozenset({5}))
    line.settle()
    for _ in range(2):
        line.bench.send(bytes.fromhex("03 07 00 00 01"), line.cnc, unit_id=5)
        line.line.reply(5, bytes.fromhex("03 02 00 05"), line.bench.now_ns)
    line.forget()
    line.measure(read_shape())
    line.pass_to(line.bench.now_ns + 100 * MS)
    odd = bytes.fromhex("05 03 01 01 00 00 00 09 07 23 36")
    began_ns = line.come(odd)
    line.pass_to(began_ns + 50 * MS)
    # Eleven characters, 3.5 of silence behind the last one, and 30 in which an adapter may hold more back.
    assert line.to_drives(began_ns) == [(44.5, odd.hex(" "))]


# --- impossible events ------------------------------------------------------------------------------------


@pytest.mark.usefixtures("in_production")
def test_an_impossible_event_is_reported_and_counted_and_the_line_continues() -> None:
    line = site()
    line.measure(acknowledgement_shape(), of_replies=True)
    frame = frame_of(NEXT)
    began_ns = line.come(frame[:8])
    line.forwarder.end(ForwardEvent.KEPT, line.bench.now_ns)
    line.come(frame[8:])
    # Spoilt at 8, it has its full length, and goes stored behind the silence.
    line.pass_to(began_ns + 40 * MS)
    left = line.to_drives(began_ns)
    ends_aborted([each for each in left if each[0] < 27.7])
    assert left[-1][1] == " ".join(data for _, data in WHOLE)
    # Bytes of its reply have left when that happens to it: its controller hears no frame.
    line.answer(ACKNOWLEDGED[:1])
    line.pass_to(line.bench.now_ns + MS)
    line.answer(ACKNOWLEDGED[1:2])
    line.pass_to(line.bench.now_ns + MS)
    line.answer(ACKNOWLEDGED[2:3])
    assert line.cnc.left
    line.forwarding.end_reply(ForwardEvent.KEPT, line.bench.now_ns)
    ends_aborted(line.to_cnc(began_ns), length=8)
    line.answer(ACKNOWLEDGED[3:])
    assert line.line.is_idle
    assert line.line.axes[0].fields[0].nominal_words == NEXT[6:]
    told = [each.detail for each in line.bench.events if each.kind is exchange_events.INTERNAL_FAULT]
    assert (
        told == ["cut-through: kept cannot be in leaving"] * 2
    )  # of an acknowledgement two bytes are the head
    assert line.line.counters.internal_faults == 2


@pytest.mark.usefixtures("in_production")
def test_a_request_that_may_not_begin_changes_nothing_of_another_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(PHASE_AFTER[Phase.WAITING], Step.BEGINS)
    line, frame = site(), frame_of(NEXT)
    other = PiecePort(line, ControllerPlan("mes"))
    line.come(frame[:9])
    line.line.request(other, 9, 1, read(ACTUAL), line.bench.now_ns)
    line.come(frame[9:])
    line.pass_to(line.bench.now_ns + 60 * MS)
    assert [pdu for _, pdu in line.link.sent] == [read(ACTUAL)]
    current = line.line._transactions.current
    assert current is not None
    assert (current.port, current.pdu, current.phase) == (other, read(ACTUAL), Phase.SENT)
    told = [each.detail for each in line.bench.events if each.kind is exchange_events.INTERNAL_FAULT]
    assert told == ["transaction: begins cannot be in waiting"]
