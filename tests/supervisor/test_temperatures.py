"""What sensors say: numbers and what is none, over MQTT and over a real Modbus TCP connection."""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.catalogue.entry import EventEntry, Severity
from gateway.config.axis_model import AxisSection
from gateway.config.sections import Sections
from gateway.exchange.commands import SetTemperature
from gateway.ipc.messages import Done, Reply, Request
from gateway.supervisor.broadcast import Broadcast
from gateway.supervisor.mqtt.interfaces import Orders
from gateway.supervisor.mqtt.service import MqttService
from gateway.supervisor.outcome import ReloadOutcome
from gateway.supervisor.temperatures import Temperatures, WrongTemperatureError, read_payload
from tests.supervisor.mqtt.mqtt_bench import settings
from tests.support.mosquitto import PATIENCE_S, broker_in, watching


@pytest.mark.parametrize(
    ("payload", "celsius"),
    [
        (b"21.5", 21.5),
        (b" -3\n", -3.0),
        (b"2.15e1", 21.5),
        (b'{"temperature": 21.5, "humidity": 40}', 21.5),
        (b'{"celsius": 21}', 21.0),
        (b'{"value": 21.5}', 21.5),
    ],
)
def test_numbers_of_sensors(payload: bytes, celsius: float) -> None:
    assert read_payload(payload) == celsius


WRONG = [
    b"",
    b"nan",
    b"NaN",
    b"inf",
    b"Infinity",
    b"-inf",
    b"1e999",
    b"21,5",
    b"21.5 C",
    b'"21.5"',
    b"true",
    b"null",
    b"[21.5]",
    b"{}",
    b'{"temperature": "21.5"}',
    b'{"temperature": true}',
    b'{"temperature": null}',
    b'{"temperature": 21, "value": 22}',
    b"9" * 400,
    b"\xff\xfe",
    b"[" * 4000,
    b"21.5" + b" " * 5000 + b"x",
]


@pytest.mark.parametrize("payload", WRONG, ids=[repr(each[:12]) for each in WRONG])
def test_what_is_no_number_is_said_and_shown_in_short(payload: bytes) -> None:
    with pytest.raises(WrongTemperatureError, match="allowed: a number in °C") as caught:
        read_payload(payload)
    assert len(str(caught.value)) < 500


@given(st.binary(max_size=200))
def test_nothing_that_comes_does_more_than_be_refused(payload: bytes) -> None:
    with contextlib.suppress(WrongTemperatureError):
        assert abs(read_payload(payload)) <= 1e6


def sections_with(*sources: dict[str, Any]) -> Sections:
    """Axes a, b, … each with a source."""
    axes = {}
    for name, source in zip("abc", sources, strict=False):
        raw = {
            "line": "l",
            "unit_id": 1,
            "units": "mm",
            "counts_per_unit": 1000.0,
            "referenced": "absolute",
            "thermal": {"alpha": 11.5e-6, "source": source},
        }
        axes[name] = AxisSection.model_validate(raw)
    return Sections(axes=axes)


class Relay:
    """Notes what it is told, and what is complained of."""

    def __init__(self) -> None:
        self.told: list[tuple[str, float]] = []
        self.said: list[tuple[str, str]] = []
        self.reply: Reply = Done(changed=("a",))
        self.changed = asyncio.Event()
        self._loop = asyncio.get_running_loop()

    def ask(self, request: Request) -> Reply:
        assert isinstance(request, SetTemperature)
        self.told.append((request.axis, request.celsius))
        self._loop.call_soon_threadsafe(self.changed.set)
        return self.reply

    def say(self, event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
        self.said.append((event.name, str(fields["detail"])))
        self.changed.set()

    async def until(self, number: int) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while len(self.told) + len(self.said) < number:
                self.changed.clear()
                await self.changed.wait()


@contextlib.asynccontextmanager
async def following(sections: Sections) -> AsyncIterator[tuple[Temperatures, Relay]]:
    relay = Relay()
    temperatures = Temperatures(relay.ask, relay.say)
    temperatures.follow(sections)
    running = asyncio.create_task(temperatures.run())
    try:
        yield temperatures, relay
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


async def test_a_topic_may_be_for_several_axes_and_a_retained_message_for_none() -> None:
    async with following(sections_with({"mqtt": "hall"}, {"mqtt": "hall"}, {"mqtt": "else"})) as (
        found,
        relay,
    ):
        assert found.topics == ("hall", "else")
        found.on_message("hall", b"19", is_retained=True)
        found.on_message("hall", b"21.5", is_retained=False)
        await relay.until(2)
        assert relay.told == [("a", 21.5), ("b", 21.5)]
        assert relay.said == []


async def test_a_fault_is_said_once_until_a_good_value_came() -> None:
    async with following(sections_with({"mqtt": "hall"})) as (found, relay):
        for payload in (b"nan", b"warm", b"inf"):
            found.on_message("hall", payload, is_retained=False)
        assert [name for name, _ in relay.said] == ["temperature-wrong"]
        assert relay.said[0][1].startswith("hall: found 'nan'; allowed: a number")
        found.on_message("hall", b"21.5", is_retained=False)
        await relay.until(2)
        async with asyncio.timeout(PATIENCE_S):
            while found._reported:  # noqa: ASYNC110 - nothing is told of this
                await asyncio.sleep(0)
        found.on_message("hall", b"nan", is_retained=False)
        assert len(relay.said) == 2


async def test_what_the_relay_refuses_is_said() -> None:
    async with following(sections_with({"mqtt": "hall"})) as (found, relay):
        relay.reply = Done(problems=("axis a: 3000 °C is no temperature",))
        found.on_message("hall", b"3000", is_retained=False)
        await relay.until(2)
        assert relay.said == [("temperature-wrong", "axis a: 3000 °C is no temperature")]


class Sensor:
    """A Modbus TCP device with one value; answers, refuses or hangs up."""

    def __init__(self) -> None:
        self.data = b""
        self.requests: list[bytes] = []
        self.exception = 0
        self.answer = b""
        """What is said instead, whatever was asked."""
        self.hangs_up = False

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                head = await reader.readexactly(7)
                pdu = await reader.readexactly(int.from_bytes(head[4:6], "big") - 1)
                self.requests.append(head[6:] + pdu)
                if self.hangs_up:
                    break
                reply = bytes((pdu[0], len(self.data))) + self.data
                if self.exception:
                    reply = bytes((pdu[0] | 0x80, self.exception))
                reply = self.answer or reply
                length = (1 + len(reply)).to_bytes(2, "big")
                writer.write(head[:4] + length + head[6:7] + reply)
        writer.close()


@contextlib.asynccontextmanager
async def sensor() -> AsyncIterator[tuple[Sensor, str]]:
    found = Sensor()
    server = await asyncio.start_server(found.serve, "127.0.0.1", 0)
    try:
        yield found, f"127.0.0.1:{server.sockets[0].getsockname()[1]}"
    finally:
        server.close()


@pytest.mark.parametrize(
    ("keys", "data", "celsius"),
    [
        ({"scale": 0.1}, "ffec", -2.0),
        ({"type": "float32"}, "41ac0000", 21.5),
        ({"type": "float32", "words": "low-first"}, "000041ac", 21.5),
        ({"type": "uint16", "function": 4, "scale": 0.01}, "0866", 21.5),
    ],
)
async def test_a_register_is_read_as_it_is_described(keys: dict[str, Any], data: str, celsius: float) -> None:
    async with sensor() as (device, address):
        device.data = bytes.fromhex(data)
        source = {"modbus": address, "unit_id": 9, "address": 100, "every_s": 0.5, **keys}
        async with following(sections_with(source)) as (_, relay):
            await relay.until(1)
        [(axis, found)] = relay.told
        assert axis == "a"
        assert found == pytest.approx(celsius)
        quantity = len(device.data) // 2
        assert device.requests[0] == bytes((9, keys.get("function", 3), 0, 100, 0, quantity))


async def test_a_device_that_refuses_hangs_up_or_lies_is_said_and_read_again() -> None:
    async with sensor() as (device, address):
        device.exception = 2
        source = {"modbus": address, "address": 100, "every_s": 0.5, "scale": 0.1}
        async with following(sections_with(source)) as (found, relay):
            await relay.until(1)
            assert relay.said == [("temperature-not-read", f"{address}: exception 0x02")]
            device.exception, device.hangs_up = 0, True
            async with asyncio.timeout(PATIENCE_S):
                while len(device.requests) < 3:  # noqa: ASYNC110 - asked again over another connection
                    await asyncio.sleep(0.05)
            device.hangs_up, device.data = False, bytes.fromhex("00d7")
            await relay.until(2)
            assert relay.told[0][1] == pytest.approx(21.5)
            assert len(relay.said) == 1
            found.follow(sections_with())  # nobody asks for it any more
            asked = len(device.requests)
            async with asyncio.timeout(PATIENCE_S):
                while found._readers:  # noqa: ASYNC110 - nor of this
                    await asyncio.sleep(0)
            assert len(device.requests) == asked


@pytest.mark.parametrize("answer", ["83", "83 02 00", "03", "03 00", "03 02 00", "04 02 00 d7", "2b 0e 01"])
async def test_an_odd_reply_is_shown_and_the_register_read_again(answer: str) -> None:
    async with sensor() as (device, address):
        device.answer = bytes.fromhex(answer)
        source = {"modbus": address, "address": 100, "every_s": 0.5, "scale": 0.1}
        async with following(sections_with(source)) as (_, relay):
            await relay.until(1)
            assert relay.said == [("temperature-not-read", f"{address}: found {answer}")]
            device.answer, device.data = b"", bytes.fromhex("00d7")
            await relay.until(2)
            assert relay.told[0][1] == pytest.approx(21.5)


async def test_a_float_that_is_no_number_is_not_told_to_the_relay() -> None:
    async with sensor() as (device, address):
        device.data = bytes.fromhex("7fc00000")
        source = {"modbus": address, "address": 100, "every_s": 0.5, "type": "float32"}
        async with following(sections_with(source)) as (_, relay):
            await relay.until(1)
            assert relay.said == [("temperature-wrong", "found nan")]
            assert relay.told == []


async def test_a_real_broker_brings_it(tmp_path: Path) -> None:
    async def reload() -> ReloadOutcome:
        return ReloadOutcome()

    with broker_in(tmp_path) as broker:
        async with (
            following(sections_with({"mqtt": "hall/x"})) as (found, relay),
            watching(broker.port) as seen,
        ):
            await seen.client.publish("hall/x", b"1", retain=True, qos=1)
            connected = asyncio.Event()

            def say(event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
                connected.set()

            service = MqttService(
                Broadcast(), say, Orders(reload, relay.ask), tmp_path, on_message=found.on_message
            )
            service.follow(replace(settings(broker.port, tmp_path), sensors=found.topics))
            running = asyncio.create_task(service.run())
            try:
                async with asyncio.timeout(PATIENCE_S):
                    await connected.wait()
                await seen.client.publish("hall/x", b"22.5", qos=1)
                await relay.until(1)
            finally:
                running.cancel()
                await asyncio.gather(running, return_exceptions=True)
        assert relay.told == [("a", 22.5)]
