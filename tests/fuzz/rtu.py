"""RTU out of a byte stream, from both sides.

An instruction is a byte, what it does with the text behind it in its two lowest bits, and the text. The rest
of the byte is how many ms pass afterwards.
"""

from collections.abc import Iterator
from typing import Final

from gateway.modbus.crc import append_crc
from gateway.modbus.pdu import EXCEPTION_BIT
from gateway.modbus.rtu import RtuReplyDecoder, RtuRequestDecoder, encode_rtu
from tests.fuzz.frames import golden_frames, stood_in
from tests.fuzz.script import Script, said

MS: Final = 1_000_000
SILENCE_NS: Final = 2 * MS
GIVE_UP_NS: Final = 30 * MS
RAW, FRAMED, EXPECT, OTHER = range(4)


def requests(data: bytes) -> None:
    """Each request that comes out stood in the stream in its turn, and every other byte is counted.

    Nothing is raised, and silence ends everything that waits.
    """
    script = Script(data)
    decoder = RtuRequestDecoder(SILENCE_NS, GIVE_UP_NS)
    stream, now_ns, frames = b"", 0, []
    while not script.is_over:
        does = script.byte()
        piece = append_crc(script.text()) if does & 3 == FRAMED else script.text()
        stream += piece
        frames += decoder.feed(piece, now_ns)
        now_ns += (does >> 2) * MS
        frames += decoder.on_silence(now_ns)
    frames += decoder.on_silence(now_ns + GIVE_UP_NS)
    assert decoder.deadline_ns is None, "something waits for ever"
    wires = [encode_rtu(*frame) for frame in frames]
    assert stood_in(stream, wires), "a frame that never came"
    counters = decoder.counters
    counted = sum(map(len, wires)) + counters.dropped_bytes + counters.glitch_bytes
    assert counted == len(stream), f"{len(stream)} bytes came, {counted} are accounted for"


def replies(data: bytes) -> None:
    """A request gets at most one reply, of its unit and its function, that came whole after it was sent.

    Nothing is raised, nothing comes out where nothing is expected, and silence ends everything that waits.
    """
    script = Script(data)
    decoder = RtuReplyDecoder(SILENCE_NS, GIVE_UP_NS, echo=bool(script.byte() & 1))
    now_ns, unit, request, since = 0, 0, b"", b""

    def judge(frames: list[tuple[int, bytes]]) -> None:
        nonlocal request
        assert len(frames) <= bool(request), "a reply that nobody asked for"
        for frame_unit, pdu in frames:
            assert frame_unit == unit, f"the reply of unit {frame_unit} to a request of unit {unit}"
            assert pdu[0] == request[0] or pdu[0] >= EXCEPTION_BIT, "a reply to another function"
            assert encode_rtu(frame_unit, pdu) in since, "a reply that never came"
            request = b""
        assert decoder.is_expecting == bool(request)

    while not script.is_over:
        does = script.byte()
        match does & 3:
            case 2:
                unit, request, since = script.byte(), script.text()[:253] or b"\x03", b""
                decoder.expect(unit, request)
            case 3:
                if does & 4:
                    decoder.cancel()
                    request = b""
                elif not request:
                    decoder.expect_echo(0, script.text()[:253] or b"\x06")
            case _:
                piece = append_crc(script.text()) if does & 3 == FRAMED else script.text()
                since += piece
                judge(decoder.feed(piece, now_ns))
        now_ns += (does >> 2) * MS
        judge(decoder.on_silence(now_ns))
    judge(decoder.on_silence(now_ns + GIVE_UP_NS))
    assert decoder.deadline_ns is None, "something waits for ever"


def request_seeds() -> Iterator[bytes]:
    """Yield each frame of the manuals whole, cut, behind noise, and two glued together."""
    for wire, _ in golden_frames():
        if wire:
            yield bytes((RAW,)) + said(wire)
            yield bytes((FRAMED,)) + said(wire[:-2])
            yield bytes((RAW,)) + said(wire[:3]) + bytes((RAW | 20 << 2,)) + said(wire[3:])
            yield bytes((RAW,)) + said(b"\xff\x7e\x03" + wire + wire)
    yield bytes((FRAMED,)) + said(bytes.fromhex("01 2B 0E 01 00"))
    yield bytes((FRAMED | 40 << 2,)) + said(bytes.fromhex("01 64 02 03"))


def reply_seeds() -> Iterator[bytes]:
    """Yield each exchange of the manuals, with and without an echo."""
    for request, reply in golden_frames():
        if reply:
            asked = bytes((EXPECT, reply[0])) + said(request[1:-2] or bytes((reply[1] & 0x7F, 0, 0, 0, 1)))
            yield b"\x00" + asked + bytes((RAW,)) + said(reply)
            yield (
                b"\x00" + asked + bytes((RAW,)) + said(reply[:4]) + bytes((RAW | 16 << 2,)) + said(reply[4:])
            )
            yield b"\x01" + asked + bytes((RAW,)) + said(request + reply)
    yield (
        b"\x00"
        + bytes((EXPECT, 1))
        + said(bytes.fromhex("2B 0E 01 00"))
        + bytes((FRAMED,))
        + said(bytes.fromhex("01 2B 0E 01 01 00 00 02 00 03 61 62 63 01 01 64"))
    )
    yield (
        b"\x01"
        + bytes((OTHER,))
        + said(b"\x06\x00\x01\x00\x02")
        + bytes((FRAMED,))
        + said(b"\x00\x06\x00\x01\x00\x02")
    )
