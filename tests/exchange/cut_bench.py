"""A judge for frames that are cut through, and helpers that let their bytes come in time."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from gateway.exchange.cut_through.delay import (
    LEARNED_AFTER,
    Delays,
    FrameShape,
    Piece,
    acknowledgement_shape,
    read_shape,
    reply_shape,
    write_shape,
)
from gateway.exchange.cut_through.frame import (
    ForwardedFrame,
    ForwardEvent,
    ForwardingPace,
    ForwardState,
    Judge,
    Opening,
    is_fit_head,
)
from gateway.modbus.crc import INVERTED, append_crc, residue_after
from gateway.modbus.rtu_arrival import ReplyArrival, RequestArrival

CHAR_NS = 1000
"""What a character takes, on either side."""
DELAY_NS = 4000
"""After the first character: a write leaves when five have come."""
STALL_NS = 1500
GUARD_NS = 500
"""Half a character; the delay has a margin of a whole one."""
PACE = ForwardingPace(CHAR_NS, STALL_NS, GUARD_NS)
HEAD = bytes.fromhex("01 10 6F 00 00 02 04")
WRITE = append_crc(HEAD + bytes.fromhex("55 55 00 08"))
RENDERED = bytes.fromhex("55 55 00 0B")
"""What leaves in the place of its position: 3 counts more."""
LAST = HEAD + bytes.fromhex("55 55 00 05")
"""The last one that was acknowledged, as it left."""
SENT = append_crc(HEAD + RENDERED)


@dataclass
class Adds(Judge):
    """Adds some counts to each position; knows one write, one read, or whatever its shape is."""

    shape: FrameShape = field(default_factory=lambda: write_shape(2, 0, 2))
    expected: bytes = LAST
    head_bytes: int = 7
    delay_ns: int = DELAY_NS
    counts: int = 3
    refused: frozenset[bytes] = frozenset()
    agrees: bool = True
    committed: list[tuple[bytes, bytes]] = field(default_factory=list)

    def opening(self, begun: bytes, now_ns: int) -> Opening | None:
        known = self.shape.needs(0)
        head = self.expected[: self.head_bytes]
        if len(begun) < known or not is_fit_head(head):
            return None
        compared = min(len(begun), self.head_bytes)
        if begun[:compared] != head[:compared]:
            return None
        return Opening(self.shape, self.delay_ns, self.expected)

    def fits(self, opening: Opening, begun: bytes) -> bool:
        return begun[: self.head_bytes] == self.expected[: self.head_bytes]

    def rendered(self, begun: bytes, first: int, end: int, now_ns: int) -> bytes | None:
        assert len(begun) == end
        words = begun[first:end]
        if words[-4:] in self.refused:
            return None
        raw = (int.from_bytes(words[-4:], "big") + self.counts) % 2**32
        return words[:-4] + raw.to_bytes(4, "big")

    def begins_with(self, byte: int, begun: bytes, first: int, now_ns: int) -> bool:
        ends = [int.from_bytes(begun[first:] + last, "big") + self.counts for last in (b"\x00", b"\xff")]
        return all(end % 2**32 >> 24 == byte for end in ends)

    def commits(self, frame: bytes, sent: bytes, now_ns: int) -> bool:
        self.committed.append((frame, sent))
        return self.agrees


READ = append_crc(bytes.fromhex("01 03 02 00 00 03"))
READ_REPLY = append_crc(bytes.fromhex("01 03 06 00 00 10 00 00 07"))
ACKNOWLEDGEMENT = append_crc(HEAD[:6])


def write(stall_ns: int = STALL_NS, **changes: object) -> tuple[ForwardedFrame, Adds, list[ForwardEvent]]:
    """Return the forwarder of a write that has not begun to come, its judge, and its events."""
    judge = Adds(**changes)  # type: ignore[arg-type]
    events: list[ForwardEvent] = []
    return (
        ForwardedFrame(RequestArrival(), judge, ForwardingPace(CHAR_NS, stall_ns, GUARD_NS), events.append),
        judge,
        events,
    )


def read(**changes: object) -> tuple[ForwardedFrame, Adds, list[ForwardEvent]]:
    """Return the same for a read: forwarding may begin with its second byte."""
    judge = Adds(shape=read_shape(), expected=READ[:-2], head_bytes=6, delay_ns=2000, **changes)  # type: ignore[arg-type]
    events: list[ForwardEvent] = []
    return ForwardedFrame(RequestArrival(), judge, PACE, events.append), judge, events


def read_reply(**changes: object) -> tuple[ForwardedFrame, Adds, list[ForwardEvent]]:
    """Return the same for the reply to the read: a position and a status after it."""
    expected = {"shape": reply_shape(3, [(0, 2)]), "expected": READ_REPLY[:-2], "head_bytes": 3}
    judge = Adds(**{**expected, **changes})  # type: ignore[arg-type]
    events: list[ForwardEvent] = []
    return (ForwardedFrame(ReplyArrival(1, READ[1:-2]), judge, PACE, events.append), judge, events)


def acknowledgement(**changes: object) -> tuple[ForwardedFrame, Adds, list[ForwardEvent]]:
    """Return the same for the acknowledgement of a write."""
    expected = {"shape": acknowledgement_shape(), "expected": HEAD[:6], "head_bytes": 2, "delay_ns": 2000}
    judge = Adds(**{**expected, **changes})  # type: ignore[arg-type]
    events: list[ForwardEvent] = []
    return (ForwardedFrame(ReplyArrival(1, WRITE[1:-2]), judge, PACE, events.append), judge, events)


def learn(delays: Delays, *shapes: FrameShape, char_ns: int = CHAR_NS) -> None:
    """Measure the delay of each shape with enough frames, character by character."""
    for shape in shapes:
        pieces = [Piece(index * char_ns, index + 1) for index in range(shape.length)]
        for _ in range(LEARNED_AFTER):
            delays.measure(shape, pieces)


def assert_spoilt(forwarded: ForwardedFrame, length: int = 13) -> None:
    """Assert that the sent bytes have the length of their head, and are no intact frame."""
    found = forwarded.state, len(forwarded.left), residue_after(forwarded.left)
    assert found == (ForwardState.ABORTED, length, INVERTED)


def characters(data: bytes, from_ns: int = 0, char_ns: int = CHAR_NS) -> list[tuple[int, bytes]]:
    """Return bytes one by one, each when its character has ended."""
    return [(from_ns + (at + 1) * char_ns, data[at : at + 1]) for at in range(len(data))]


def play(
    forwarded: ForwardedFrame, came: Iterable[tuple[int, bytes]], until_ns: int | None = None
) -> list[tuple[int, str]]:
    """Feed bytes at their times, then let time pass; return the sent bytes with their times, in hex."""
    left: list[tuple[int, bytes]] = []

    def pass_until(now_ns: int) -> None:
        while (deadline_ns := forwarded.deadline_ns) is not None and deadline_ns < now_ns:
            left.append((deadline_ns, forwarded.tick(deadline_ns)))

    for now_ns, data in came:
        pass_until(now_ns)
        left.append((now_ns, forwarded.feed(data, now_ns)))
    if until_ns is not None:
        pass_until(until_ns)
    return [(now_ns, data.hex(" ")) for now_ns, data in left if data]
