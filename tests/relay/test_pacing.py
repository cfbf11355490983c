"""The silence before a frame."""

import asyncio
import os

from gateway.clock import boot_ns
from gateway.relay.pacing import PacedReplies, WireWriter
from gateway.transport.channel import Channel

MS = 1_000_000
LONG_MS = 60_000


class Wire(Channel):
    """A channel that notes when what was written."""

    def __init__(self, wire_ns_per_byte: int = 0) -> None:
        self.wire_ns_per_byte = wire_ns_per_byte
        self.written: list[tuple[bytes, int]] = []

    @property
    def frames(self) -> list[bytes]:
        return [data for data, _ in self.written]

    def write(self, data: bytes) -> None:
        self.written.append((data, boot_ns()))

    def has_gone(self, *, asks: bool) -> bool:
        return False

    def close(self) -> None:
        pass


def opened(wire: Wire, gap_ns: int, wire_gap_ns: int = 0, *, at_ns: int = 0) -> WireWriter:
    paced = WireWriter(gap_ns, wire_gap_ns)
    paced.opened(wire, at_ns)
    return paced


async def drained(replies: PacedReplies) -> None:
    async with asyncio.timeout(30):
        await replies.drained()


# --- the wire -----------------------------------------------------------------------------------------------


def test_the_traffic_before_the_port_was_opened_is_unknown() -> None:
    paced = opened(Wire(), 5 * MS, at_ns=100 * MS)
    assert not paced.may_begin(105 * MS - 1)
    assert paced.may_begin(105 * MS)


def test_bytes_that_are_heard_begin_the_silence_again() -> None:
    paced = opened(Wire(), 5 * MS)
    paced.heard(103 * MS)
    assert paced.stamps.next_ns == 108 * MS
    paced.heard(101 * MS)  # read later, came earlier
    assert paced.stamps.next_ns == 108 * MS


def test_the_time_that_written_bytes_take_on_the_wire_counts() -> None:
    wire = Wire(wire_ns_per_byte=1 * MS)
    paced = opened(wire, 2 * MS)
    before_ns = boot_ns()
    paced.write(b"four")
    [(_, after_ns)] = wire.written
    assert before_ns + 6 * MS <= paced.stamps.next_ns <= after_ns + 6 * MS  # 4 ms of bytes, 2 ms of silence


def test_a_piece_follows_the_bytes_of_the_pieces_before_it() -> None:
    wire = Wire(wire_ns_per_byte=10 * MS)
    paced = opened(wire, 2 * MS)
    before_ns = boot_ns()
    for _ in range(4):
        paced.write(b"one")
    assert before_ns + 122 * MS <= paced.stamps.next_ns <= wire.written[0][1] + 122 * MS


def test_the_silence_between_characters_is_kept_only_where_there_is_a_wire() -> None:
    assert opened(Wire(), 0, 50 * MS, at_ns=MS).may_begin(MS)
    assert not opened(Wire(wire_ns_per_byte=1), 0, 2 * MS, at_ns=MS).may_begin(3 * MS - 1)
    assert opened(Wire(wire_ns_per_byte=1), 0, 2 * MS, at_ns=MS).may_begin(3 * MS)


def test_without_a_gap_there_is_never_a_wait() -> None:
    paced = opened(Wire(), 0, at_ns=MS)
    paced.write(b"one")
    paced.heard(boot_ns())
    assert paced.stamps.next_ns == 0


def test_nothing_begins_on_a_closed_port() -> None:
    wire = Wire()
    paced = opened(wire, 0)
    paced.closed()
    assert not paced.may_begin(MS)
    paced.write(b"one")
    assert wire.written == []


# --- replies ------------------------------------------------------------------------------------------------


async def test_a_reply_waits_for_the_silence_behind_what_was_heard() -> None:
    wire = Wire()
    paced = opened(wire, 5 * MS)
    replies = PacedReplies(paced)
    heard_ns = boot_ns()
    paced.heard(heard_ns)
    replies.send(b"one", heard_ns + LONG_MS * MS)
    assert wire.written == []
    await drained(replies)
    assert wire.frames == [b"one"]
    assert wire.written[0][1] >= heard_ns + 5 * MS
    replies.close()


async def test_bytes_heard_while_it_waits_put_it_off() -> None:
    wire = Wire()
    start_ns = boot_ns()
    paced = opened(wire, 5 * MS, at_ns=start_ns)
    replies = PacedReplies(paced)
    replies.send(b"one", start_ns + LONG_MS * MS)
    paced.heard(start_ns + 3 * MS)
    await drained(replies)
    assert wire.written[0][1] >= start_ns + 8 * MS
    replies.close()


async def test_w6_a_reply_is_not_sent_once_its_controller_has_given_up() -> None:
    wire = Wire()
    start_ns = boot_ns()
    replies = PacedReplies(opened(wire, 5 * MS, at_ns=start_ns))
    replies.send(b"too late", start_ns + 4 * MS)
    await drained(replies)
    assert wire.frames == []
    replies.send(b"next", boot_ns() + LONG_MS * MS)
    assert wire.frames == [b"next"]
    replies.close()


async def test_w6_a_reply_is_dropped_when_the_next_one_comes_or_it_is_discarded() -> None:
    wire = Wire()
    start_ns = boot_ns()
    by_ns = start_ns + LONG_MS * MS
    replies = PacedReplies(opened(wire, 5 * MS, at_ns=start_ns))
    replies.send(b"one", by_ns)
    replies.send(b"two", by_ns)
    await drained(replies)
    assert wire.frames == [b"two"]
    paced = opened(wire, 5 * MS, at_ns=boot_ns())
    replies.close()
    replies = PacedReplies(paced)
    replies.send(b"three", by_ns)
    replies.discard()
    await drained(replies)
    assert wire.frames == [b"two"]
    replies.close()


async def test_w6_what_the_controller_has_sent_is_read_before_a_reply_is_written_late() -> None:
    """The process stands still while a reply waits; the controller's next request is read first."""
    wire = Wire()
    start_ns = boot_ns()
    replies = PacedReplies(opened(wire, MS, at_ns=start_ns))
    replies.send(b"one", start_ns + LONG_MS * MS)
    loop = asyncio.get_running_loop()
    reading, writing = os.pipe()

    def request_came() -> None:
        os.read(reading, 1)
        replies.discard()

    loop.add_reader(reading, request_came)
    os.write(writing, b"x")
    while boot_ns() < start_ns + 3 * MS:  # it stands still: silence and request are both over
        pass
    await drained(replies)
    loop.remove_reader(reading)
    os.close(reading)
    os.close(writing)
    assert wire.frames == []
    replies.close()


async def test_each_reply_is_named_as_it_is_written() -> None:
    named: list[bytes] = []
    start_ns = boot_ns()
    replies = PacedReplies(opened(Wire(), 2 * MS, at_ns=start_ns), named.append)
    replies.send(b"one", start_ns + LONG_MS * MS)
    assert named == []
    await drained(replies)
    assert named == [b"one"]
    replies.close()
