"""What a UART makes of a line that is set otherwise: bits in time, sampled at its rate."""

from itertools import chain
from typing import NamedTuple


class Character(NamedTuple):
    """What the receiver hands over."""

    value: int
    is_wrong: bool
    """An error of parity or frame."""


def _parity_bits(value: int, parity: str) -> list[int]:
    ones = value.bit_count() % 2
    return {"N": [], "E": [ones], "O": [1 - ones]}[parity]


def received(data: bytes, sent: tuple[int, str], heard: tuple[int, str]) -> list[Character]:
    """Send bytes back to back at one setting (baud rate, parity), and receive them at another."""
    bits = bytes(
        chain.from_iterable(
            [0, *(value >> n & 1 for n in range(8)), *_parity_bits(value, sent[1]), 1] for value in data
        )
    )
    bit = heard[0] / sent[0]

    def level(time: float) -> int:
        """Of the line at a time, counted in bits of the receiver."""
        at = int(time / bit)
        return bits[at] if at < len(bits) else 1

    found = []
    time = 0.0
    while (edge := bits.find(0, int(time / bit))) >= 0:
        time = max(time, edge * bit)
        if level(time + 0.5):  # too short for a start bit
            time += 0.5
            continue
        value = sum(level(time + 1.5 + n) << n for n in range(8))
        expected = _parity_bits(value, heard[1])
        got = [level(time + 9.5)] if expected else []
        stop = time + 9.5 + len(expected)
        found.append(Character(value, got != expected or not level(stop)))
        time = stop
    return found


def marked(characters: list[Character]) -> bytes:
    """Return them as a terminal with PARMRK hands them over."""
    return b"".join(
        bytes((0xFF, 0x00, one.value)) if one.is_wrong else bytes((one.value,)) * (1 + (one.value == 0xFF))
        for one in characters
    )
