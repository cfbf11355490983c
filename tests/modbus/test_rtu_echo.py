"""The echo of replies on a serial port: taken out where there is one, and nothing else ever is."""

from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.rtu import encode_rtu
from gateway.modbus.rtu_echo import LATEST_NS, Echo, ReplyEcho

TRIGGER = encode_rtu(1, bytes.fromhex("06 6002 0010"))
"""A request, and its acknowledgement."""
ACKNOWLEDGED = encode_rtu(1, bytes.fromhex("10 6201 0002"))
TARGET = encode_rtu(1, bytes.fromhex("10 6201 0002 04 000186A0"))
"""It begins as its acknowledgement does: six bytes are the same."""
WIRE_NS = 1_000_000


def heard(echo: ReplyEcho, data: bytes, now_ns: int, cuts: list[int]) -> bytes:
    """Give bytes in pieces; return what is left of them."""
    left, start = b"", 0
    for end in (*sorted(cuts), len(data)):
        piece, start = data[start:end], end
        left += (echo.take(piece, now_ns) if echo.is_expected else piece) if piece else b""
    return left


def after(reply: bytes, *, is_configured: bool = False) -> ReplyEcho:
    echo = ReplyEcho(is_configured=is_configured)
    echo.sent(reply, 0, WIRE_NS)
    return echo


@given(st.lists(st.integers(0, 2 * len(TRIGGER)), max_size=6), st.booleans())
def test_an_echo_is_taken_out_however_it_comes(cuts: list[int], is_configured: bool) -> None:
    echo = after(TRIGGER, is_configured=is_configured)
    assert heard(echo, TRIGGER + TRIGGER, 1, cuts) == TRIGGER  # the controller repeats its request
    assert (echo.echo, echo.echoes, echo.is_undeclared) == (Echo.PRESENT, 1, not is_configured)


@given(st.lists(st.integers(0, len(TARGET)), max_size=6))
def test_a_request_that_begins_like_the_reply_is_whole(cuts: list[int]) -> None:
    echo = after(ACKNOWLEDGED)
    assert heard(echo, TARGET, 1, cuts) == TARGET
    assert (echo.echo, echo.echoes) == (Echo.ABSENT, 0)


def test_without_an_echo_a_controller_may_repeat_what_it_likes() -> None:
    echo = after(ACKNOWLEDGED)
    assert echo.take(TRIGGER, 1) == TRIGGER
    for now_ns in range(2, 6):
        echo.sent(TRIGGER, now_ns, WIRE_NS)
        assert not echo.is_expected  # nothing more is looked at


def test_what_no_controller_can_have_sent_is_an_echo_after_all() -> None:
    sevens = encode_rtu(1, bytes.fromhex("03 04 0007 0007"))
    echo = after(ACKNOWLEDGED)
    assert echo.take(TARGET, 1) == TARGET
    assert not echo.came_back(TRIGGER, now_ns=9, soonest_ns=9)  # the controller repeats its request
    assert echo.echo is Echo.ABSENT
    assert echo.came_back(TRIGGER, now_ns=8, soonest_ns=9)
    assert echo.is_undeclared
    echo = after(ACKNOWLEDGED)
    assert echo.take(TARGET, 1) == TARGET
    assert echo.came_back(sevens, now_ns=9, soonest_ns=0)
    assert (echo.echo, echo.echoes) == (Echo.PRESENT, 1)


def test_what_comes_later_than_any_adapter_is_a_request() -> None:
    echo = after(TRIGGER)
    assert echo.take(TRIGGER, WIRE_NS + LATEST_NS + 1) == TRIGGER
    assert echo.echo is Echo.ABSENT
    echo = after(TRIGGER)
    assert echo.take(TRIGGER, WIRE_NS + LATEST_NS) == b""
    assert echo.echo is Echo.PRESENT


def test_half_an_echo_that_nothing_follows_is_left_out_where_there_is_one() -> None:
    echo = after(TRIGGER, is_configured=True)
    assert echo.take(TRIGGER[:3], 1) == b""
    assert echo.take(TARGET, WIRE_NS + LATEST_NS + 1) == TARGET
    echo = after(TRIGGER)  # whose it was nobody knows
    assert echo.take(TRIGGER[:3], 1) == b""
    assert echo.take(TARGET, WIRE_NS + LATEST_NS + 1) == TRIGGER[:3] + TARGET


def test_an_echo_that_was_damaged_is_expected_again() -> None:
    echo = after(TRIGGER)
    assert echo.take(TRIGGER, 1) == b""
    echo.sent(TRIGGER, 2, WIRE_NS)
    damaged = TRIGGER[:4] + b"\xff" + TRIGGER[5:]
    assert echo.take(damaged, 3) == damaged
    echo.sent(TRIGGER, 4, WIRE_NS)
    assert echo.take(TRIGGER, 5) == b""
    assert echo.echo is Echo.PRESENT


def test_an_adapter_that_returns_nothing_any_more_has_no_echo() -> None:
    echo = after(TRIGGER)
    assert echo.take(TRIGGER, 1) == b""
    echo.sent(ACKNOWLEDGED, 2, WIRE_NS)
    assert echo.take(TARGET, 3) == TARGET
    assert (echo.echo, echo.is_expected) == (Echo.UNKNOWN, False)  # it may have met something on the wire
    echo.sent(ACKNOWLEDGED, 4, WIRE_NS)
    assert echo.take(TARGET, 5) == TARGET
    assert (echo.echo, echo.is_expected) == (Echo.ABSENT, False)


@given(st.booleans())
def test_a_process_that_stood_still_reads_an_echo_late_and_takes_it_out(is_configured: bool) -> None:
    late_ns = WIRE_NS + LATEST_NS + 1
    first = after(TRIGGER, is_configured=is_configured)
    assert first.take(TRIGGER, late_ns, has_slept=True) == b""
    assert first.echo is Echo.PRESENT
    first.sent(TRIGGER, late_ns, WIRE_NS)
    assert first.take(TRIGGER, 2 * late_ns + 1) == b""  # where there is one it is one, however late
    assert (first.echo, first.echoes) == (Echo.PRESENT, 2)


def test_another_adapter_may_be_there_when_the_port_is_opened_again() -> None:
    echo = after(ACKNOWLEDGED)
    assert echo.take(TRIGGER, 1) == TRIGGER
    echo.begin_anew()
    echo.sent(TRIGGER, 2, WIRE_NS)
    assert echo.take(TRIGGER, 3) == b""


def test_a_reply_in_pieces_comes_back_in_pieces() -> None:
    echo = after(TRIGGER)
    assert echo.take(TRIGGER, 1) == b""
    echo.sent(TARGET[:5], 2, WIRE_NS)
    assert echo.take(TARGET[:3], 3) == b""
    echo.sent(TARGET[5:], 4, WIRE_NS)
    assert echo.take(TARGET[3:] + ACKNOWLEDGED, 5) == ACKNOWLEDGED
