"""Modbus/TCP out of a byte stream; requests and replies are framed alike, so this is both directions.

An instruction is a byte and a text. Even: the text as it is; odd: the text in a frame, with the byte as its
transaction id.
"""

from collections.abc import Iterator
from typing import Final

from gateway.modbus.mbap import LONGEST_LENGTH, MbapDecoder, encode_mbap
from tests.fuzz.frames import golden_frames, stood_in
from tests.fuzz.script import Script, said

LONGEST_FRAME: Final = 6 + LONGEST_LENGTH


def streams(data: bytes) -> None:
    """Each frame that comes out stood in the stream, however that was cut; every other byte is counted."""
    script = Script(data)
    pieces: list[bytes] = []
    while not script.is_over:
        does, text = script.byte(), script.text()
        is_framed = does & 1 and 2 <= len(text) <= LONGEST_LENGTH
        pieces.append(encode_mbap(does, text[0], text[1:]) if is_framed else text)
    stream = b"".join(pieces)
    decoder = MbapDecoder()
    frames = [frame for piece in pieces for frame in decoder.feed(piece)]
    wires = [encode_mbap(*frame) for frame in frames]
    assert stood_in(stream, wires), "a frame that never came"
    waiting = len(stream) - sum(map(len, wires)) - decoder.counters.dropped_bytes
    assert 0 <= waiting < LONGEST_FRAME, f"{waiting} bytes are not accounted for"
    assert decoder.is_between_frames == (waiting == 0), f"{waiting} bytes wait, and nobody knows of them"
    glued = MbapDecoder()
    whole = glued.feed(stream)
    assert whole == frames, "other frames when it comes at once"
    assert glued.counters == decoder.counters
    assert glued.broken_by[:6] == decoder.broken_by[:6]  # more of it may be there at once
    if decoder.broken_by:
        assert decoder.feed(encode_mbap(7, 1, b"\x03")) == [], "a frame behind a length that cannot be"


def seeds() -> Iterator[bytes]:
    """Yield the frames of the manuals over TCP, and some cut, pipelined, foreign or of a wrong length."""
    for request, reply in golden_frames():
        for wire in filter(None, (request, reply)):
            yield b"\x07" + said(wire[:-2])
    adu = bytes.fromhex("00 07 00 00 00 06 01 03 32 00 00 02")
    yield b"\x00" + said(adu[:9]) + b"\x00" + said(adu[9:] + adu)
    yield b"\x00" + said(bytes.fromhex("00 07 00 01 00 06 01 03 32 00 00 02") + adu)
    yield b"\x00" + said(bytes.fromhex("00 07 00 00 FF FF 01 03")) + b"\x00" + said(adu)
