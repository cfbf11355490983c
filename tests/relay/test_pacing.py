"""The silence before a frame."""

import asyncio

from gateway.clock import boot_ns
from gateway.relay.pacing import PacedSender
from gateway.transport.channel import Channel

MS = 1_000_000


class Wire(Channel):
    """A channel that notes when what was written."""

    def __init__(self, wire_ns_per_byte: int = 0) -> None:
        self.wire_ns_per_byte = wire_ns_per_byte
        self.written: list[tuple[bytes, int]] = []

    def write(self, data: bytes) -> None:
        self.written.append((data, boot_ns()))

    def has_gone(self, *, asks: bool) -> bool:
        return False

    def close(self) -> None:
        pass


async def drained(sender: PacedSender) -> None:
    async with asyncio.timeout(30):
        await sender.drained()


async def test_a_quiet_line_sends_at_once() -> None:
    wire, sender = Wire(), PacedSender(5 * MS)
    sender.opened(wire, boot_ns() - 6 * MS)
    sender.send(b"one")
    assert [data for data, _ in wire.written] == [b"one"]
    sender.close()


async def test_a_frame_waits_for_the_gap_after_what_was_heard() -> None:
    wire, sender = Wire(), PacedSender(5 * MS)
    sender.opened(wire, 0)
    heard_ns = boot_ns()
    sender.heard(heard_ns)
    sender.send(b"one")
    assert wire.written == []
    await drained(sender)
    assert wire.written[0][1] >= heard_ns + 5 * MS
    sender.close()


async def test_bytes_heard_while_waiting_put_the_frame_off() -> None:
    wire, sender = Wire(), PacedSender(5 * MS)
    start_ns = boot_ns()
    sender.opened(wire, start_ns)
    sender.send(b"one")
    sender.heard(start_ns + 3 * MS)
    await drained(sender)
    assert wire.written[0][1] >= start_ns + 8 * MS
    sender.close()


async def test_the_time_that_written_bytes_take_on_the_wire_counts() -> None:
    wire, sender = Wire(wire_ns_per_byte=1 * MS), PacedSender(2 * MS)
    sender.opened(wire, 0)
    sender.send(b"four")  # 4 ms on the wire, then 2 ms of silence
    sender.send(b"two")
    await drained(sender)
    (first, first_ns), (second, second_ns) = wire.written
    assert (first, second) == (b"four", b"two")
    assert second_ns - first_ns >= 6 * MS - MS // 10  # the first stamp is taken a little after the decision
    sender.close()


async def test_frames_keep_their_order() -> None:
    wire, sender = Wire(), PacedSender(MS)
    sender.opened(wire, boot_ns())
    for number in range(4):
        sender.send(bytes([number]))
    await drained(sender)
    assert [data for data, _ in wire.written] == [bytes([number]) for number in range(4)]
    sender.close()


async def test_what_is_discarded_is_never_sent() -> None:
    wire, sender = Wire(), PacedSender(MS)
    sender.opened(wire, boot_ns())
    sender.send(b"never")
    sender.discard()
    await drained(sender)
    sender.send(b"later")
    await drained(sender)
    assert [data for data, _ in wire.written] == [b"later"]
    sender.close()


async def test_a_closed_channel_takes_what_waited_with_it() -> None:
    wire, sender = Wire(), PacedSender(MS)
    sender.opened(wire, boot_ns())
    sender.send(b"never")
    sender.closed()
    sender.send(b"nobody there")
    await drained(sender)
    assert wire.written == []
    sender.close()


async def test_the_silence_between_characters_is_kept_only_where_there_is_a_wire() -> None:
    pty, sender = Wire(), PacedSender(0, 50 * MS)
    sender.opened(pty, boot_ns())
    sender.send(b"one")
    assert [data for data, _ in pty.written] == [b"one"]
    sender.close()
    port, sender = Wire(wire_ns_per_byte=1), PacedSender(0, 2 * MS)
    opened_ns = boot_ns()
    sender.opened(port, opened_ns)
    sender.send(b"one")
    assert port.written == []
    await drained(sender)
    assert port.written[0][1] >= opened_ns + 2 * MS
    sender.close()
