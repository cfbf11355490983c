"""Which profile, and which registers: what public programs send is recognised."""

import pytest

from gateway.commissioning.listen.overhearing import Overheard
from gateway.commissioning.listen.recognition import likely, matches
from gateway.commissioning.listen.traffic import Content, PositionGuess, TrafficStatistics, guesses
from gateway.drives import library
from gateway.drives.public import public_traffic
from gateway.modbus.registers import WordOrder

SPOKEN_OF = [name for name in library.names() if public_traffic(name)]
TOO_LITTLE = {"festo-cmmt-111"}
"""What is public of it does not tell enough."""


@pytest.mark.parametrize("drive", SPOKEN_OF)
def test_what_is_sent_to_a_drive_in_public_sounds_like_it(drive: str) -> None:
    """The frames are of programs and manuals, not of the profile (decision 24)."""
    unit_id = (library.shipped(drive).unit_id_range or (1, 1))[0]
    statistics = TrafficStatistics()
    for sequence in public_traffic(drive):
        pdus = (bytes.fromhex(frame) for frame in sequence.frames)
        statistics.add(Overheard(unit_id, pdu, is_reply=False) for pdu in pdus)
    found = [match.drive for match in likely(matches(unit_id, statistics.units[unit_id]))]
    assert (drive in found) == (drive not in TOO_LITTLE)
    assert len(found) <= 2


def told(address: int, *words: int) -> Content:
    return Content(True, address, words)


def read(address: int, *words: int) -> Content:
    return Content(False, address, words)


def test_a_position_goes_where_it_is_told_to() -> None:
    contents = [
        told(0x10, 0x0000, 0x2710),
        read(0x20, 0xFFFF, 0x0000, 0x1388),  # on its way: 5000 from 0x21 on
        read(0x20, 0xFFFF, 0x0000, 0x2710),  # there
        told(0x10, 0xFFFF, 0xFF9C),  # -100
        read(0x20, 0x0001, 0xFFFF, 0xFF9D),  # -99: near enough
        read(0x30, 0x0000, 0x2710),  # what it was, not where it is to go
    ]
    assert guesses(contents) == [PositionGuess(0x10, 0x21, WordOrder.HIGH_FIRST, met=2, targets=2)]


def test_halves_that_are_written_alone_are_a_position_too() -> None:
    contents = [
        told(0x11, 0x2710),
        told(0x10, 0x0001),
        read(0x20, 0x2710, 0x0001),
        told(0x11, 0x0064),
        read(0x20, 0x0064, 0x0001),
    ]
    # 0x11 has the low word: 0x12710, then 0x10064. What is read has its low word first: not the same order.
    assert guesses(contents) == []
    swapped = [Content(c.is_write, c.address, c.words[::-1]) for c in contents]
    assert guesses(swapped)[0] == PositionGuess(0x10, 0x20, WordOrder.HIGH_FIRST, met=2, targets=2)


def test_one_target_is_no_proof() -> None:
    assert guesses([told(0x10, 0, 500), read(0x20, 0, 500)]) == []
