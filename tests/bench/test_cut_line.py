"""Lines in simulated time: their figures are those of arithmetic, and no drive takes what nobody sent."""

from random import Random

import pytest

from bench.cut_damage import Damage
from bench.cut_line import READ, WRITE_HEAD, Way, damaged, direct_ns, has_whole, run, shares
from gateway.exchange.cut_through.frame import ForwardEvent
from gateway.modbus.crc import append_crc
from gateway.simulator.ears import Hearing
from gateway.simulator.wire import Adapter

WRITE = append_crc(WRITE_HEAD + bytes(4))


def test_a_line_that_stores_adds_the_wire_once_more() -> None:
    way = Way(9600, cuts=False)
    found, line = run(way, 60)
    assert shares(way, found) == pytest.approx((1.0, 1.0), abs=0.001)
    assert (found.unanswered, found.foreign) == (0, 0)
    assert line.events == {"line-up": 1}


@pytest.mark.parametrize(
    ("way", "margin_us", "expected"),
    [
        # Two delays of 3 + 2 characters and two margins (of 0.361 and of 0.2 ms), of 21 and of 19 characters.
        (Way(9600), 361.458, ((5 * 1.145833 + 0.722917) / 24.0625, (5 * 1.145833 + 0.722917) / 21.7708)),
        (Way(115_200), 200, ((5 * 0.0954861 + 0.4) / 2.005208, (5 * 0.0954861 + 0.4) / 1.814236)),
    ],
)
def test_a_line_that_cuts_through_adds_its_delays(
    way: Way, margin_us: float, expected: tuple[float, float]
) -> None:
    found, line = run(way, 600)
    assert shares(way, found) == pytest.approx(expected, abs=0.003)
    assert (found.unanswered, found.torn, found.foreign, found.broken) == (0, 0, 0, 0)
    assert line.line.forwarding is not None
    # Of 300 writes and 300 reads the first 32 of each shape are learned from.
    said = line.line.forwarding.status()
    assert said.requests.cut_through == 600 - 2 * 32
    assert said.requests.stored == {"kept": 2 * 32}
    assert (said.requests.spoilt, said.replies.spoilt, said.torn) == ({}, {}, 0)
    # Ten characters of a write and six of a read less a margin each: in the mean eight.
    char_us = 11e6 / way.baudrate
    assert said.requests.gain_us == pytest.approx(8 * char_us - margin_us, abs=3)
    assert line.events == {"line-up": 1}


def test_a_port_that_hands_whole_frames_over_stores() -> None:
    way = Way(9600, adapter=Adapter(latency_timer_ms=16.0))
    found, line = run(way, 200)
    assert (found.unanswered, found.torn) == (0, 0)
    assert line.line.forwarding is not None
    assert line.line.forwarding.requests.ended[ForwardEvent.COMMITTED] == 0
    assert line.line.forwarding.status().requests.gain_us is None
    assert line.events == {"line-up": 1, "cut-through-off": 2}  # of requests and of replies, once each
    stored = shares(way, run(Way(9600, cuts=False, adapter=way.adapter), 200)[0])
    assert shares(way, found) == pytest.approx(stored, abs=0.005)


@pytest.mark.parametrize("hearing", [Hearing.STANDARD, Hearing.ANY_LENGTH, Hearing.MERGING])
def test_no_drive_takes_what_nobody_sent_whole(hearing: Hearing) -> None:
    found, line = run(Way(38_400, hearing=hearing, seed=5), 800, 0.25)
    assert found.damaged > 60
    assert (found.foreign, found.forged) == (0, 0)
    assert line.line.forwarding is not None
    assert line.line.forwarding.requests.ended[ForwardEvent.BAD] > 0


def test_damaged_frames_against_the_cutter_alone() -> None:
    damage = Damage(38_400, 3)
    while damage.damaged < 2_000:
        damage.frame()
    assert (damage.foreign, damage.forged) == (0, 0)
    assert damage.turns["spoilt"] > 1_000
    assert min(damage.taken.values()) > 10


def test_damage_has_every_kind_and_is_told_from_what_is_whole() -> None:
    rng = Random(1)
    assert has_whole(b"\x55" + WRITE)
    assert has_whole(READ)
    assert not has_whole(WRITE[:-1])
    lengths = {sum(len(piece) for _, piece in damaged(rng, WRITE, 5)) for _ in range(200)}
    assert {12, 13, 14} < lengths
    assert any(len(damaged(rng, WRITE, 5)) == 2 for _ in range(200))


def test_a_direct_exchange_has_its_characters_and_the_silence_of_its_drive() -> None:
    # 21 + 1 characters of 1.1458 ms and 4.0104 ms; a drive that merges wants 10 ms.
    assert direct_ns(Way(9600), 21) == 25_208_333 + 4_010_417
    assert direct_ns(Way(9600, hearing=Hearing.MERGING), 21) == 25_208_333 + 10_000_000
