import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.simulator.ears import TimedByte
from gateway.simulator.errors import SimulatorError
from gateway.simulator.wire import Adapter, PacedWire, WireFaults

MS = 1_000_000


def drained(wire: PacedWire) -> tuple[bytes, int]:
    """Everything that travels, and when the last of it arrived."""
    data, last_ns = b"", 0
    while wire.deadline_ns is not None:
        last_ns = wire.deadline_ns
        data += wire.receive(last_ns)
    return data, last_ns


@pytest.mark.parametrize(
    ("baudrate", "count", "expected_ms"),
    [
        (9600, 8, 9.167),  # an FC03 request: 8 x 11 / 9600
        (9600, 13, 14.896),  # FC16 with two registers
        (115200, 13, 1.241),
        (19200, 41, 23.490),  # FC16 with 16 registers
    ],
)
def test_a_frame_takes_its_characters_at_11_bits(baudrate: int, count: int, expected_ms: float) -> None:
    wire = PacedWire(baudrate)
    wire.send(bytes(count), 0)
    _, last_ns = drained(wire)
    assert last_ns / MS == pytest.approx(expected_ms, abs=0.001)


def test_bytes_arrive_one_by_one_and_never_early() -> None:
    wire = PacedWire(baudrate=1000, bits_per_character=10)  # 10 ms a byte
    wire.send(b"abc", 5 * MS)
    assert wire.deadline_ns == 15 * MS
    assert wire.receive(15 * MS - 1) == b""
    assert wire.receive(15 * MS) == b"a"
    assert wire.receive(34 * MS) == b"b"
    assert wire.receive(35 * MS) == b"c"
    assert wire.deadline_ns is None


def test_what_is_sent_while_the_wire_is_busy_waits_its_turn() -> None:
    wire = PacedWire(baudrate=1000, bits_per_character=10)
    wire.send(b"ab", 0)
    wire.send(b"c", 3 * MS)
    assert wire.receive(29 * MS) == b"ab"
    assert wire.receive(30 * MS) == b"c"


def test_an_idle_wire_starts_afresh() -> None:
    wire = PacedWire(baudrate=1000, bits_per_character=10)
    wire.send(b"a", 0)
    assert wire.receive(10 * MS) == b"a"
    wire.send(b"b", 100 * MS)
    assert wire.deadline_ns == 110 * MS


def test_a_usb_adapter_hands_over_in_lumps_of_its_latency_timer() -> None:
    wire = PacedWire(1000, 10, adapter=Adapter(latency_timer_ms=16.0))
    wire.send(b"abcd", 0)  # at 10, 20, 30, 40 ms
    assert wire.receive(25 * MS) == b""
    assert wire.receive(26 * MS) == b"ab"  # 16 ms after the first byte came in at 10 ms
    assert wire.receive(46 * MS) == b"cd"  # at 30 ms the next lump began


def test_a_full_packet_leaves_the_adapter_at_once() -> None:
    wire = PacedWire(1000, 10, adapter=Adapter(latency_timer_ms=1000.0, burst_bytes=3))
    wire.send(b"abcd", 0)
    assert wire.receive(30 * MS) == b"abc"
    assert wire.receive(1040 * MS) == b"d"


def test_a_uart_hands_over_at_a_level_of_its_fifo_or_when_it_was_quiet_for_four_characters() -> None:
    wire = PacedWire(1000, 10, adapter=Adapter(quiet_characters=4.0, burst_bytes=8))
    wire.send(b"0123456789", 0)  # at 10, 20 to 100 ms
    assert wire.receive(79 * MS) == b""
    assert wire.receive(80 * MS) == b"01234567"
    assert wire.receive(140 * MS - 1) == b""
    assert wire.receive(140 * MS) == b"89"  # 40 ms after the last one came in at 100 ms


def test_an_adapter_with_both_timers_goes_by_the_sooner_one() -> None:
    wire = PacedWire(1000, 10, adapter=Adapter(latency_timer_ms=25.0, quiet_characters=2.0))
    wire.send(b"abc", 0)  # at 10, 20, 30 ms
    assert wire.receive(35 * MS) == b"abc"  # 25 ms after the first
    wire.send(b"d", 100 * MS)
    assert wire.receive(130 * MS) == b"d"  # 20 ms after it


def test_jitter_makes_bytes_late_up_to_its_limit_and_keeps_their_order() -> None:
    wire = PacedWire(1000, 10, adapter=Adapter(jitter_ms=15.0))  # longer than a character
    wire.send(bytes(range(100)), 0)
    late, got = [], b""
    while (due_ns := wire.deadline_ns) is not None:
        for byte in wire.receive(due_ns):
            late.append(due_ns - 10 * MS * (byte + 1))
            got += bytes((byte,))
    assert got == bytes(range(100))
    assert 0 <= min(late) < 2 * MS
    assert 13 * MS < max(late) <= 15 * MS


def test_noise_takes_its_place_on_the_wire() -> None:
    wire = PacedWire(1000, 10, WireFaults(noise=1.0))
    wire.send(b"ab", 0)
    data, last_ns = drained(wire)
    assert (len(data), data[0:1], data[2:3], wire.bytes_of_noise) == (4, b"a", b"b", 2)
    assert last_ns == 40 * MS


def test_a_drive_hears_each_byte_when_its_last_bit_came() -> None:
    wire = PacedWire(1000, 10, adapter=Adapter(latency_timer_ms=16.0))
    wire.send(b"ab", 0)
    wire.send(b"c", 50 * MS)
    assert wire.arrivals(45 * MS) == [TimedByte(10 * MS, 0x61), TimedByte(20 * MS, 0x62)]
    assert wire.arrivals(60 * MS) == [TimedByte(60 * MS, 0x63)]


def test_faults_are_seeded_and_counted() -> None:
    def run(seed: int) -> tuple[bytes, int, int]:
        wire = PacedWire(9600, faults=WireFaults(garble=0.1, drop=0.1, seed=seed))
        wire.send(bytes(1000), 0)
        data, _ = drained(wire)
        return data, wire.bytes_garbled, wire.bytes_dropped

    data, garbled, dropped = run(1)
    assert run(1) == (data, garbled, dropped)
    assert run(2)[0] != data
    assert len(data) == 1000 - dropped
    assert sum(byte != 0 for byte in data) == garbled
    assert 50 < garbled < 150


@given(
    st.lists(st.tuples(st.binary(max_size=20), st.integers(0, 50 * MS)), max_size=8),
    st.sampled_from(
        [
            Adapter(),
            Adapter(latency_timer_ms=16.0),
            Adapter(jitter_ms=3.0),
            Adapter(quiet_characters=4.0, burst_bytes=8, jitter_ms=2.0),
            Adapter(latency_timer_ms=1.0, quiet_characters=4.0, burst_bytes=14),
        ]
    ),
)
def test_nothing_is_lost_or_reordered(bursts: list[tuple[bytes, int]], adapter: Adapter) -> None:
    wire = PacedWire(9600, adapter=adapter)
    now_ns, got = 0, b""
    for data, pause_ns in bursts:
        now_ns += pause_ns
        got += wire.receive(now_ns)
        wire.send(data, now_ns)
    rest, _ = drained(wire)
    assert got + rest == b"".join(data for data, _ in bursts)


def test_a_wire_needs_a_baud_rate() -> None:
    with pytest.raises(SimulatorError, match="baud rate 0"):
        PacedWire(0)
