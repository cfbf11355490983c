"""What every transport does alike: in memory, over TCP, over (pseudo) serial ports."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.transport.conftest import Ends

EVERY_BYTE = bytes(range(256))


async def test_every_byte_value_arrives_in_both_directions(ends: "Ends") -> None:
    ends.near.write(EVERY_BYTE)
    ends.far.write(EVERY_BYTE[::-1])
    await ends.far.until(lambda end: len(end.data) >= 256)
    await ends.near.until(lambda end: len(end.data) >= 256)
    assert ends.far.data == EVERY_BYTE
    assert ends.near.data == EVERY_BYTE[::-1]


async def test_writes_arrive_in_their_order(ends: "Ends") -> None:
    for number in range(50):
        ends.near.write(bytes([number]) * 3)
    await ends.far.until(lambda end: len(end.data) >= 150)
    assert ends.far.data == b"".join(bytes([number]) * 3 for number in range(50))


async def test_more_than_any_buffer_holds_arrives_whole(ends: "Ends") -> None:
    block = EVERY_BYTE * 2000  # 512 000 bytes; a pty takes 4 KiB at a time
    ends.near.write(block)
    ends.near.write(b"end")
    await ends.far.until(lambda end: len(end.data) >= len(block) + 3)
    assert ends.far.data == block + b"end"


async def test_time_stamps_never_run_backwards(ends: "Ends") -> None:
    for _ in range(5):
        ends.near.write(b"x")
        count = len(ends.far.data)
        await ends.far.until(lambda end, count=count: len(end.data) > count)  # type: ignore[misc]
    assert ends.far.times_ns == sorted(ends.far.times_ns)


async def test_a_loss_is_told_once_and_writing_afterwards_is_harmless(ends: "Ends") -> None:
    channel = ends.near.channel
    assert channel is not None
    await ends.hang_up()
    await ends.near.until(lambda end: bool(end.reasons))
    channel.write(b"nobody")
    channel.close()
    assert len(ends.near.reasons) == 1
    assert ends.near.reasons[0]


async def test_closing_twice_is_told_once(ends: "Ends") -> None:
    channel = ends.near.channel
    assert channel is not None
    channel.close()
    channel.close()
    await ends.near.until(lambda end: bool(end.reasons))
    assert len(ends.near.reasons) == 1


async def test_what_was_written_before_closing_still_arrives(ends: "Ends") -> None:
    channel = ends.near.channel
    assert channel is not None
    channel.write(b"last words")
    channel.close()
    await ends.far.until(lambda end: end.data == b"last words")
