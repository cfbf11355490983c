"""A master over every kind of line, with drives that answer late, twice, wrongly or not at all."""

import asyncio
from collections.abc import AsyncIterator
from itertools import pairwise

import pytest

from gateway.clock import boot_ns
from gateway.transport.endpoints import TcpEndpoint
from gateway.transport.errors import AbsentError, RefusedError
from gateway.transport.master import (
    GarbledError,
    LostError,
    ModbusMaster,
    OtherIdError,
    SilentError,
    _MbapFraming,
)
from tests.transport.scripted_drive import ANSWER, ASK, KINDS, Drive, Rig, framed


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    rig = Rig()
    async with rig.stack:
        yield rig


@pytest.mark.parametrize("kind", KINDS)
async def test_requests_are_answered_one_after_the_other(rig: Rig, kind: str) -> None:
    drive = Drive(lambda data: framed(kind, data, ANSWER))
    async with ModbusMaster(await rig.drive(kind, drive), 5000.0) as master:
        replies = await asyncio.gather(*(master.exchange(1, ASK) for _ in range(5)))
    assert replies == [ANSWER] * 5
    assert len(drive.heard_ns) == 5


@pytest.mark.parametrize("kind", KINDS)
async def test_a_refusal_is_a_reply(rig: Rig, kind: str) -> None:
    drive = Drive(lambda data: framed(kind, data, b"\x83\x02"))
    async with ModbusMaster(await rig.drive(kind, drive), 5000.0) as master:
        assert await master.exchange(1, ASK) == b"\x83\x02"


@pytest.mark.parametrize("kind", KINDS)
async def test_a_silent_drive_is_given_up_on_and_asked_again_later(rig: Rig, kind: str) -> None:
    moods = iter((None, ANSWER))

    def script(data: bytes) -> bytes | None:
        mood = next(moods)
        return None if mood is None else framed(kind, data, mood)

    async with ModbusMaster(await rig.drive(kind, Drive(script)), 300.0) as master:
        with pytest.raises(SilentError, match="no reply within 300 ms"):
            await master.exchange(1, ASK)
        assert await master.exchange(1, ASK) == ANSWER


@pytest.mark.parametrize("kind", KINDS)
async def test_garbage_is_told_from_silence(rig: Rig, kind: str) -> None:
    drive = Drive(lambda data: b"\x01\x02\x03\x04\x05")
    async with ModbusMaster(await rig.drive(kind, drive), 400.0) as master:  # on a busy machine too
        with pytest.raises(GarbledError, match=r"no whole reply within 400 ms; .* 01 02 03 04 05$"):
            await master.exchange(1, ASK)


@pytest.mark.parametrize("kind", KINDS)
async def test_a_late_reply_never_answers_the_next_request(rig: Rig, kind: str) -> None:
    late: list[bytes] = []

    def script(data: bytes) -> bytes | None:
        if late:
            return framed(kind, data, ANSWER)
        late.append(framed(kind, data, bytes.fromhex("03 02 FFFF")))
        return None

    drive = Drive(script)
    async with ModbusMaster(await rig.drive(kind, drive), 40.0, drain_ms=80.0) as master:
        with pytest.raises(SilentError):
            await master.exchange(1, ASK)
        assert drive.channel is not None
        drive.channel.write(late[0])
        assert await master.exchange(1, ASK) == ANSWER


async def test_nothing_is_sent_before_the_silence_that_a_drive_wants(rig: Rig) -> None:
    drive = Drive(lambda data: framed("tcp", data, ANSWER))
    endpoint = await rig.drive("tcp", drive)
    closed_ns = boot_ns()
    async with ModbusMaster(endpoint, 5000.0, gap_ms=20.0) as master:
        for _ in range(3):
            await master.exchange(1, ASK)
    # Each of these comes before what the silence is counted from: the opening, and the answer to a request.
    gaps_ms = [(later - earlier) / 1e6 for earlier, later in pairwise([closed_ns, *drive.heard_ns])]
    assert min(gaps_ms) >= 20.0


async def test_a_connection_that_is_lost_is_said_at_once(rig: Rig) -> None:
    drive = Drive(lambda data: None)

    def hang_up(data: bytes) -> None:
        assert drive.channel is not None
        drive.channel.close()

    drive.script = hang_up
    async with ModbusMaster(await rig.drive("tcp", drive), 60_000.0) as master:
        with pytest.raises(LostError):
            await master.exchange(1, ASK)
        with pytest.raises(LostError, match="is closed"):
            await master.exchange(1, ASK)


async def test_nobody_there_is_said_with_the_address(unused_tcp_port: int) -> None:
    with pytest.raises(AbsentError, match=f"127.0.0.1:{unused_tcp_port} cannot be reached"):
        async with ModbusMaster(TcpEndpoint("127.0.0.1", unused_tcp_port)):
            pass


async def test_a_host_name_that_nobody_knows_is_said_with_what_to_do() -> None:
    """The top level domain ``invalid`` is never given to anybody (RFC 6761, 6.4)."""
    with pytest.raises(AbsentError) as caught:
        async with ModbusMaster(TcpEndpoint("drives.invalid", 502)):
            pass
    said = str(caught.value)
    assert said.startswith("drives.invalid:502 cannot be reached: the host name drives.invalid is unknown (")
    assert "/etc/hosts" in said
    assert said.endswith("or write the IP address instead")


async def test_a_port_that_another_program_has_is_not_used(rig: Rig) -> None:
    endpoint = await rig.drive("rtu", Drive(lambda data: None))
    async with ModbusMaster(endpoint):
        with pytest.raises(RefusedError, match="in use by another program"):
            async with ModbusMaster(endpoint):
                pass


async def test_another_transaction_id_is_told_from_silence(rig: Rig) -> None:
    drive = Drive(lambda data: b"\0\0" + framed("tcp", data, ANSWER)[2:])
    async with ModbusMaster(await rig.drive("tcp", drive), 60.0) as master:
        for asked in (1, 2):
            why = rf"^answers, with transaction id 0 \(asked with {asked}\)$"
            with pytest.raises(OtherIdError, match=why):
                await master.exchange(1, ASK)


async def test_a_late_reply_and_one_that_comes_twice_are_no_other_transaction_id(rig: Rig) -> None:
    late: list[bytes] = []

    def script(data: bytes) -> bytes | None:
        answer = framed("tcp", data, ANSWER)
        late.append(answer)
        earlier = {2: 0, 4: 2}  # the second gets what the first got, the fourth what the third is owed
        number = len(late)
        return None if number == 3 else late[earlier.get(number, number - 1)]

    async with ModbusMaster(await rig.drive("tcp", Drive(script)), 60.0) as master:
        assert await master.exchange(1, ASK) == ANSWER
        with pytest.raises(GarbledError):
            await master.exchange(1, ASK)  # the reply before, once more
        with pytest.raises(SilentError):
            await master.exchange(1, ASK)
        with pytest.raises(GarbledError):
            await master.exchange(1, ASK)  # that of the request that was given up


async def test_transaction_ids_go_round_without_0(rig: Rig) -> None:
    heard: list[bytes] = []

    def script(data: bytes) -> bytes:
        heard.append(data[:2])
        return framed("tcp", data, ANSWER)

    async with ModbusMaster(await rig.drive("tcp", Drive(script)), 5000.0) as master:
        assert isinstance(master._framing, _MbapFraming)
        master._framing._transaction_id = 0xFFFE
        for _ in range(2):
            assert await master.exchange(1, ASK) == ANSWER
    assert heard == [b"\xff\xff", b"\x00\x01"]


async def test_reads_that_come_back_are_counted_until_one_does_not(rig: Rig) -> None:
    reply = [True, True, False]

    def script(data: bytes) -> bytes:
        return (data if reply.pop(0) else b"") + framed("rtu", data, ANSWER)

    returned = []
    async with ModbusMaster(await rig.drive("rtu", Drive(script)), 5000.0) as master:
        for _ in range(3):
            assert await master.exchange(1, ASK) == ANSWER
            returned.append(master.returned)
    assert returned == [1, 2, 0]
