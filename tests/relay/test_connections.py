"""Connections to the drives over real sockets: servers that close, stay mute, or answer nonsense (W5, W7)."""

import asyncio
from collections.abc import AsyncIterator, Callable
from dataclasses import replace
from enum import Enum
from pathlib import Path
from typing import Final

import pytest

from gateway.exchange.plan import LineTiming
from gateway.modbus.mbap import encode_mbap
from gateway.recording.writer import Recorder
from gateway.state.plan import GatewayPlan, LinePlan
from gateway.transport.endpoints import TcpEndpoint
from tests.support.recordings import HEADER, replayed
from tests.support.relay import Bench, RawEnd, axis_plan, eventually, line_status

COMMAND: Final = 100
ABSENT, NO_ANSWER = bytes.fromhex("90 0A"), bytes.fromhex("90 0B")
IDLE_S: Final = 0.06
TIMING: Final = LineTiming(response_timeout_ms=100.0, retry_ms=100.0)
PATIENT: Final = LineTiming(response_timeout_ms=5000.0, retry_ms=100.0)
"""No answer is late, however busy the machine is."""


class Habit(Enum):
    """How a server treats its connections."""

    STAYS = "stays"
    CLOSES_AFTER_ANSWER = "closes-after-answer"
    CLOSES_WHEN_IDLE = "closes-when-idle"
    """After ``idle_s`` in which nothing is asked."""
    CLOSES_ON_WRITE = "closes-on-write"
    """When it has read a write, which it carries out, and does not answer."""
    MUTE_AT_FIRST = "mute-at-first"
    """On its first connection it takes everything and says nothing."""
    MUTE_IF_HURRIED = "mute-if-hurried"
    """It stays mute on a connection on which it is asked within 300 ms."""
    MALFORMED = "malformed"
    """Its length field is always 1."""


class Server:
    """A Modbus/TCP drive of plain memory."""

    def __init__(self, habit: Habit) -> None:
        self.habit = habit
        self.idle_s = IDLE_S
        self.words: dict[int, int] = {}
        self.writes: list[tuple[int, bytes]] = []
        """Each write, with the number of the connection on which it came."""
        self.heard: list[tuple[int, bytes]] = []
        self.connections = 0
        self.open: set[asyncio.StreamWriter] = set()
        self._server: asyncio.Server | None = None
        self.port = 0

    async def start(self) -> TcpEndpoint:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self.port)
        self.port = self._server.sockets[0].getsockname()[1]
        return TcpEndpoint("127.0.0.1", self.port)

    async def stop(self) -> None:
        """Listen no more, and break off what is open."""
        assert self._server is not None
        self._server.close()
        for writer in tuple(self.open):
            writer.transport.abort()
        await asyncio.sleep(0.02)  # until the other ends have read it

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        number, began_s = self.connections, asyncio.get_running_loop().time()
        self.open.add(writer)
        is_mute = False
        try:
            while True:
                wait_s = self.idle_s if self.habit is Habit.CLOSES_WHEN_IDLE else None
                async with asyncio.timeout(wait_s):
                    head = await reader.readexactly(7)
                pdu = await reader.readexactly(int.from_bytes(head[4:6], "big") - 1)
                self.heard.append((number, pdu))
                if self.habit is Habit.MUTE_IF_HURRIED:
                    is_mute |= asyncio.get_running_loop().time() - began_s < 0.3
                if is_mute or (self.habit is Habit.MUTE_AT_FIRST and number == 1):
                    continue
                answer = self._do(number, pdu)
                if self.habit is Habit.CLOSES_ON_WRITE and pdu[0] == 16:
                    return
                frame = encode_mbap(int.from_bytes(head[:2], "big"), head[6], answer)
                if self.habit is Habit.MALFORMED:
                    frame = frame[:4] + b"\x00\x01" + frame[6:]
                writer.write(frame)
                if self.habit is Habit.CLOSES_AFTER_ANSWER:
                    return
        except (TimeoutError, asyncio.IncompleteReadError, ConnectionError):
            return
        finally:
            self.open.discard(writer)
            writer.close()

    def _do(self, number: int, pdu: bytes) -> bytes:
        address = int.from_bytes(pdu[1:3], "big")
        if pdu[0] == 16:
            self.writes.append((number, pdu))
            for i in range(len(pdu[6:]) // 2):
                self.words[address + i] = int.from_bytes(pdu[6 + 2 * i : 8 + 2 * i], "big")
            return pdu[:5]
        quantity = int.from_bytes(pdu[3:5], "big")
        data = b"".join(self.words.get(address + i, 0).to_bytes(2, "big") for i in range(quantity))
        return bytes((pdu[0], len(data))) + data


Serve = Callable[[Habit], Server]


@pytest.fixture
async def serve() -> AsyncIterator[Serve]:
    servers: list[Server] = []

    def make(habit: Habit) -> Server:
        servers.append(Server(habit))
        return servers[-1]

    yield make
    for server in servers:
        await server.stop()


def target(counts: int) -> bytes:
    return bytes.fromhex(f"10 {COMMAND:04X} 0002 04 {counts:08X}")


async def ask(end: RawEnd, number: int, pdu: bytes, unit_id: int = 1) -> bytes:
    """Send a request; return the PDU that answers it."""
    end.data = b""
    end.write(encode_mbap(number, unit_id, pdu))
    await end.until(lambda each: len(each.data) >= 9)
    assert int.from_bytes(end.data[:2], "big") == number
    return end.data[7:]


async def between(
    bench: Bench, server: Server, timing: LineTiming = TIMING, timeout_ms: float = 1000.0
) -> RawEnd:
    """A raw controller, a relay with one axis, and the server."""
    where = await server.start()
    link, _ = bench.controller_link("tcp", timeout_ms=timeout_ms)
    relay = await bench.relay(where, (link,), (axis_plan(),), timing)
    return await bench.connect(relay.address("line", "cnc"))


@pytest.mark.parametrize("added_frames", [True, False])
@pytest.mark.parametrize("is_hurried", [True, False])
@pytest.mark.parametrize("habit", [Habit.CLOSES_AFTER_ANSWER, Habit.CLOSES_WHEN_IDLE])
async def test_w5_ten_targets_pass_though_the_server_closes(
    bench: Bench, serve: Serve, habit: Habit, is_hurried: bool, added_frames: bool
) -> None:
    server = serve(habit)
    # Far from each other: when it closes, when it closes what is opened then, and when it is asked between.
    server.idle_s, pause_s = 0.4, 0.6
    where = await server.start()
    link, _ = bench.controller_link("tcp", timeout_ms=10_000.0)
    axis = replace(axis_plan(), added_frames=added_frames)
    relay = await bench.relay(where, (link,), (axis,), PATIENT)
    cnc = await bench.connect(relay.address("line", "cnc"))
    for number in range(1, 11):
        if not is_hurried and number % 3 == 0:
            await asyncio.sleep(pause_s)
        # +0.001 mm of correction for each mm: 50 000 + 1 000 n counts get 50 + n more.
        assert await ask(cnc, number, target(50_000 + 1_000 * number)) == target(0)[:5]
    assert [pdu for _, pdu in server.writes] == [target(50_050 + 1_001 * n) for n in range(1, 11)]
    told = [note for note in bench.notes if note.event == "line-down"]
    assert len(told) <= 2


async def test_w5_what_a_closing_socket_was_given_is_never_sent_again(bench: Bench, serve: Serve) -> None:
    server = serve(Habit.CLOSES_ON_WRITE)
    cnc = await between(bench, server)
    assert await ask(cnc, 1, target(50_000)) == NO_ANSWER
    assert await ask(cnc, 2, bytes.fromhex("03 00C8 0001")) == bytes.fromhex("03 02 0000")
    assert [pdu for _, pdu in server.writes] == [target(50_050)]


async def test_w7_without_a_server_requests_are_absent_after_half_a_time_out(
    bench: Bench, serve: Serve
) -> None:
    server = serve(Habit.STAYS)
    cnc = await between(bench, server, timeout_ms=400.0)
    assert await ask(cnc, 1, bytes.fromhex("03 00C8 0001")) == bytes.fromhex("03 02 0000")
    await server.stop()
    began_s = asyncio.get_running_loop().time()
    assert await ask(cnc, 2, target(50_000)) == ABSENT
    assert 0.19 < asyncio.get_running_loop().time() - began_s < 0.4
    assert server.writes == []


async def test_w5_a_restarted_server_gets_what_waited_within_half_a_time_out(
    bench: Bench, serve: Serve
) -> None:
    server = serve(Habit.STAYS)
    cnc = await between(bench, server, timeout_ms=2000.0)
    assert await ask(cnc, 1, bytes.fromhex("03 00C8 0001")) == bytes.fromhex("03 02 0000")
    await server.stop()
    cnc.data = b""
    cnc.write(encode_mbap(2, 1, target(50_000)))
    await asyncio.sleep(0.3)
    await server.start()
    await cnc.until(lambda each: len(each.data) >= 12)
    assert cnc.data == encode_mbap(2, 1, target(0)[:5])
    assert [pdu for _, pdu in server.writes] == [target(50_050)]


async def test_a_length_that_cannot_be_is_named_with_its_bytes_once(bench: Bench, serve: Serve) -> None:
    server = serve(Habit.MALFORMED)
    cnc = await between(bench, server)
    for number in range(1, 8):
        assert (await ask(cnc, number, bytes.fromhex("03 00C8 0001")))[0] == 0x83
    told = [str(note.fields["detail"]) for note in bench.notes if note.event == "line-down"]
    assert len(told) == 1
    assert told[0].startswith("closed after a malformed header: 00 0")
    assert told[0].endswith("00 00 00 01 01 03")
    assert server.connections < 20


async def test_w11_a_server_that_forgot_its_connection_is_served_anew(bench: Bench, serve: Serve) -> None:
    server = serve(Habit.MUTE_AT_FIRST)
    cnc = await between(bench, server, timeout_ms=100.0)
    read = bytes.fromhex("03 00C8 0001")
    answers = [await ask(cnc, number, read) for number in range(1, 4)]
    assert answers == [bytes.fromhex("83 0B")] * 3
    number, answer = 4, b""
    while answer != bytes.fromhex("03 02 0000"):
        answer = await ask(cnc, number, read)
        number += 1
        await asyncio.sleep(0.02)
        assert number < 100
    assert server.connections == 2
    assert [note.event for note in bench.notes].count("connection-renewed") == 1
    assert [note.event for note in bench.notes].count("line-down") == 0


async def test_w5_after_an_unanswered_write_named_reads_go_first(bench: Bench, serve: Serve) -> None:
    server = serve(Habit.STAYS)
    timing = LineTiming(response_timeout_ms=100.0, retry_ms=0.0)
    cnc = await between(bench, server, timing, timeout_ms=100.0)
    assert await ask(cnc, 1, target(10_000)) == target(0)[:5]
    assert await ask(cnc, 2, bytes.fromhex("03 006E 0002")) == bytes.fromhex("03 04 0000 0000")
    server.habit = Habit.MUTE_AT_FIRST
    number = 3
    while server.connections < 2:
        assert (await ask(cnc, number, target(20_000)))[0] == 0x90
        number += 1
    heard = [pdu for on, pdu in server.heard if on == 2]
    while await ask(cnc, number, target(30_000)) != target(0)[:5]:
        number += 1
        await asyncio.sleep(0.02)
        assert number < 200
    heard = [pdu for on, pdu in server.heard if on == 2]
    assert heard[0] == bytes.fromhex("03 006E 0002")
    assert [pdu for on, pdu in server.writes if on == 2] == [target(30_030)]


@pytest.mark.parametrize("delay_ms", [0.0, 350.0])
async def test_a_server_is_asked_after_connect_delay_ms(bench: Bench, serve: Serve, delay_ms: float) -> None:
    server = serve(Habit.MUTE_IF_HURRIED)
    timing = LineTiming(response_timeout_ms=400.0, retry_ms=0.0, connect_delay_ms=delay_ms)
    cnc = await between(bench, server, timing, timeout_ms=1000.0)
    number = 1
    while await ask(cnc, number, target(50_000)) != target(0)[:5]:
        number += 1
        assert number < 20
    assert server.connections == (1 if delay_ms else 2)
    assert number == 1 or not delay_ms
    assert [pdu for _, pdu in server.writes] == [target(50_050)]


async def test_w5_a_server_killed_in_a_renewal_gets_no_write_twice(bench: Bench, serve: Serve) -> None:
    server = serve(Habit.STAYS)
    timing = LineTiming(response_timeout_ms=100.0, retry_ms=0.0)
    cnc = await between(bench, server, timing, timeout_ms=100.0)
    assert await ask(cnc, 1, target(10_000)) == target(0)[:5]
    server.habit = Habit.MUTE_AT_FIRST
    number, renewed = 2, False
    while not renewed:
        assert (await ask(cnc, number, target(20_000)))[0] == 0x90
        number += 1
        renewed = any(note.event == "connection-renewed" for note in bench.notes)
    await server.stop()
    assert await ask(cnc, number, target(30_000)) == ABSENT
    await server.start()
    while await ask(cnc, number, target(40_000)) != target(0)[:5]:
        number += 1
        await asyncio.sleep(0.02)
        assert number < 200
    assert [pdu for _, pdu in server.writes] == [target(10_010), target(40_040)]


async def test_a_connection_on_demand_is_closed_a_second_after_its_answer(bench: Bench, serve: Serve) -> None:
    server = serve(Habit.STAYS)
    where = await server.start()
    link, _ = bench.controller_link("tcp", timeout_ms=1000.0)
    timing = LineTiming(response_timeout_ms=100.0, connects_on_demand=True)
    relay = await bench.relay(where, (link,), (axis_plan(),), timing)
    cnc = await bench.connect(relay.address("line", "cnc"))
    await asyncio.sleep(0.1)
    assert (server.connections, line_status(relay)["state"]) == (0, "up")
    for number in (1, 2):
        assert await ask(cnc, number, bytes.fromhex("03 00C8 0001")) == bytes.fromhex("03 02 0000")
        assert len(server.open) == 1
        await eventually(lambda: not server.open)
    assert server.connections == 2
    assert line_status(relay)["state"] == "up"
    assert not [note.event for note in bench.notes if note.event in ("line-down", "line-up")][1:]


@pytest.mark.parametrize("habit", [Habit.MUTE_AT_FIRST, Habit.CLOSES_AFTER_ANSWER, Habit.CLOSES_WHEN_IDLE])
async def test_a_run_over_connections_is_replayed_byte_for_byte(
    bench: Bench, serve: Serve, habit: Habit, tmp_path: Path
) -> None:
    server, path = serve(habit), tmp_path / "record.jsonl"
    link, _ = bench.controller_link("tcp", timeout_ms=150.0)
    timing = LineTiming(response_timeout_ms=50.0, retry_ms=100.0)
    line = LinePlan("line", await server.start(), (link,), (axis_plan(),), timing)
    plan = GatewayPlan("bench", (line,))
    relay = await bench.start(plan, recorder=Recorder(path, HEADER))
    cnc = await bench.connect(relay.address("line", "cnc"))
    for number in range(1, 31):
        pdu = target(1_000 * number) if number % 2 else bytes.fromhex("03 00C8 0001")
        await ask(cnc, number, pdu)
        await asyncio.sleep(0.07 if number % 5 == 0 else 0.0)
    await relay.stop()
    assert server.connections > 1
    result = replayed(plan, path)
    assert (result.first, result.different) == ([], 0)
    assert result.outputs > 30
