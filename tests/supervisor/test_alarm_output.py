"""The contact that means trouble: a coil that is closed while all is well, on a device that counts."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from gateway.catalogue.entry import EventEntry
from gateway.config.gateway_model import AlarmOutputSection
from gateway.status.model import Model
from gateway.supervisor.alarm_output import AlarmOutput
from tests.support.status_models import model_of

PATIENCE_S = 30.0
CLOSE, OPEN = bytes.fromhex("05000aff00"), bytes.fromhex("05000a0000")
"""Coil 10."""


@dataclass
class Device:
    """A Modbus TCP device with coils, as Modbus Application Protocol V1.1b3, 6.5, describes it."""

    written: list[tuple[int, bytes]] = field(default_factory=list)
    """Unit id and PDU of each request."""
    answer: Callable[[bytes], bytes] = bytes
    """The reply to a request: its echo."""
    address: str = ""
    _writers: list[asyncio.StreamWriter] = field(default_factory=list)

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                head = await reader.readexactly(7)
                pdu = await reader.readexactly(int.from_bytes(head[4:6], "big") - 1)
                self.written.append((head[6], pdu))
                reply = self.answer(pdu)
                if reply:
                    writer.write(head[:4] + (len(reply) + 1).to_bytes(2, "big") + head[6:] + reply)

    def cut(self) -> None:
        for writer in self._writers:
            writer.close()
        self._writers.clear()

    @property
    def coil(self) -> bytes | None:
        return self.written[-1][1] if self.written else None


@contextlib.asynccontextmanager
async def device() -> AsyncIterator[Device]:
    found = Device()
    server = await asyncio.start_server(found.serve, "127.0.0.1", 0)
    found.address = f"127.0.0.1:{server.sockets[0].getsockname()[1]}"
    yield found
    server.close()
    found.cut()


def section(device: Device, **keys: Any) -> AlarmOutputSection:
    return AlarmOutputSection.model_validate(
        {"device": {"tcp": device.address}, "unit_id": 3, "coil": 10, "every_s": 0.1, **keys}
    )


def status(verdict: str = "healthy", relay: str = "up", age_s: float | None = 0.1) -> Model:
    return model_of(
        {"gateway": {"relay": relay, "snapshot_age_s": age_s}, "verdict": {"state": verdict, "since": ""}}
    )


class Supervisor:
    """What the output has of a supervisor: a status that changes, and a log."""

    def __init__(self) -> None:
        self.model: Model | None = status()
        self.said: list[tuple[str, dict[str, object]]] = []
        self.output = AlarmOutput(lambda: self.model, self._log)

    def _log(self, event: EventEntry, *_: object, **fields: object) -> None:
        self.said.append((event.name, fields))

    def show(self, model: Model | None) -> None:
        self.model = model
        self.output.changed()


@contextlib.asynccontextmanager
async def running() -> AsyncIterator[Supervisor]:
    found = Supervisor()
    work = asyncio.create_task(found.output.run())
    try:
        yield found
    finally:
        work.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await work


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - the device tells nobody
            await asyncio.sleep(0.001)


async def test_it_is_closed_while_all_is_well_and_opened_at_the_end() -> None:
    async with device() as found:
        async with running() as supervisor:
            supervisor.output.follow(section(found))
            await until(lambda: len(found.written) >= 3)  # again and again: it feeds a watchdog
            assert set(found.written) == {(3, CLOSE)}
            shown = supervisor.output.status
            assert shown.contact == f"{found.address}, unit id 3, coil 10"
            assert (shown.is_closed, shown.problem) == (True, None)
        assert found.written[-1] == (3, OPEN)
    assert supervisor.said == []


@pytest.mark.parametrize(
    ("opens_on", "model", "coil"),
    [
        ("error", status("waiting"), CLOSE),
        ("error", status("warning"), CLOSE),
        ("error", status("error"), OPEN),
        ("warning", status("waiting"), CLOSE),
        ("warning", status("warning"), OPEN),
        ("warning", status("error"), OPEN),
        ("error", status(relay="down"), OPEN),
        ("error", status(age_s=2.5), OPEN),  # the relay is there and has reported nothing for 2 s
        ("error", status(age_s=None), OPEN),
        ("error", None, OPEN),  # nothing is known yet
    ],
)
async def test_what_closes_and_opens_it(opens_on: str, model: Model | None, coil: bytes) -> None:
    async with device() as found, running() as supervisor:
        supervisor.model = model
        supervisor.output.follow(section(found, opens_on=opens_on))
        await until(lambda: bool(found.written))
        assert found.written[0] == (3, coil)


async def test_a_change_is_written_before_its_turn() -> None:
    async with device() as found, running() as supervisor:
        supervisor.output.follow(section(found, every_s=60.0))
        await until(lambda: supervisor.output.status.is_closed is True)
        supervisor.show(status("error"))
        await until(lambda: supervisor.output.status.is_closed is False)
        supervisor.show(status("warning"))
        await until(lambda: supervisor.output.status.is_closed is True)
        assert [pdu for _, pdu in found.written] == [CLOSE, OPEN, CLOSE]


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (lambda pdu: b"\x85\x02", "exception 0x02"),
        (lambda pdu: OPEN, "found 05 00 0a 00 00"),
        (lambda pdu: b"\x05", "found 05"),
    ],
)
async def test_a_device_that_does_not_do_it_is_said_once_and_tried_again(
    answer: Callable[[bytes], bytes], why: str
) -> None:
    async with device() as found, running() as supervisor:
        found.answer = answer
        supervisor.output.follow(section(found))
        await until(lambda: len(found.written) >= 3)
        assert supervisor.output.status.problem == f"{found.address}: {why}"
        assert supervisor.output.status.is_closed is None
        found.answer = bytes
        await until(lambda: supervisor.output.status.is_closed is True)
        assert supervisor.said == [
            ("alarm-output-failed", {"detail": f"{found.address}: {why}"}),
            ("alarm-output-works", {}),
        ]
        assert supervisor.output.status.problem is None


async def test_a_lost_connection_is_made_again() -> None:
    async with device() as found, running() as supervisor:
        supervisor.output.follow(section(found))
        await until(lambda: supervisor.output.status.is_closed is True)
        found.cut()
        await until(lambda: supervisor.output.status.problem is not None)
        await until(lambda: supervisor.output.status.is_closed is True)
        assert [event for event, _ in supervisor.said] == ["alarm-output-failed", "alarm-output-works"]


async def test_another_contact_is_closed_after_the_first_was_opened() -> None:
    async with device() as found, running() as supervisor:
        supervisor.output.follow(section(found, every_s=60.0))
        await until(lambda: found.coil == CLOSE)
        supervisor.output.follow(section(found, every_s=60.0, coil=11))
        await until(lambda: supervisor.output.status.is_closed is True)
        assert [pdu for _, pdu in found.written] == [CLOSE, OPEN, bytes.fromhex("05000bff00")]


async def test_without_its_section_it_is_opened_and_left_alone() -> None:
    async with device() as found, running() as supervisor:
        supervisor.output.follow(section(found))
        await until(lambda: found.coil == CLOSE)
        supervisor.output.follow(None)
        await until(lambda: found.coil == OPEN)
        assert supervisor.output.status.contact is None
        supervisor.show(status("error"))
        assert found.coil == OPEN


async def test_a_failing_one_that_is_taken_out_says_no_more() -> None:
    async with device() as found:
        async with running() as supervisor:
            found.answer = lambda _: b"\x85\x02"
            supervisor.output.follow(section(found))
            await until(lambda: bool(supervisor.said))
            supervisor.output.follow(None)
        assert found.coil == OPEN
    assert [event for event, _ in supervisor.said] == ["alarm-output-failed"]


async def test_the_same_contact_with_other_times_is_not_opened_in_between() -> None:
    async with device() as found, running() as supervisor:
        supervisor.output.follow(section(found, every_s=60.0))
        await until(lambda: found.coil == CLOSE)
        supervisor.output.follow(section(found, every_s=50.0, opens_on="warning"))
        await until(lambda: supervisor.output.status.is_closed is True)
        assert {pdu for _, pdu in found.written} == {CLOSE}
        supervisor.show(status("warning"))
        await until(lambda: supervisor.output.status.is_closed is False)
