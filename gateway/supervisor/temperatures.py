"""Temperatures of screws: received over MQTT or polled over Modbus, and sent to the relay."""

import asyncio
from collections.abc import Callable, Mapping
from functools import partial
from math import isfinite
from typing import Any, Final

import msgspec

from gateway.catalogue.entry import EventEntry
from gateway.catalogue.sensor_events import TEMPERATURE_NOT_READ, TEMPERATURE_WRONG
from gateway.config.sections import Sections
from gateway.config.terms_model import TemperatureSource
from gateway.exchange.commands import SetTemperature
from gateway.ipc.client import NoGatewayError
from gateway.ipc.messages import Done, Reply, Request
from gateway.supervisor.event_log import LogEvent
from gateway.supervisor.in_thread import in_thread

LONGEST_PAYLOAD: Final = 4096
LONGEST_SHOWN: Final = 80
LARGEST: Final = 1e6
"""No sensor reports more, whatever its unit; a longer number may not fit a double."""
KEYS: Final = ("temperature", "celsius", "value")
SEND_EVERY_S: Final = 1.0
"""The relay gets a temperature no more often, however often a sensor sends."""
NOT_A_NUMBER: Final = "allowed: a number in °C, or JSON with a number under temperature, celsius or value"


class WrongTemperatureError(Exception):
    """The payload is not a number; the message contains the payload."""


def read_payload(payload: bytes) -> float:
    """Return the number in a message.

    Raises:
        WrongTemperatureError: the message has no number, or more than one candidate.

    >>> read_payload(b"21.5"), read_payload(b'{"temperature": 21.5, "battery": 90}')
    (21.5, 21.5)
    """
    shown = payload[:LONGEST_SHOWN].decode(errors="replace")
    try:
        found: Any = None if len(payload) > LONGEST_PAYLOAD else msgspec.json.decode(payload.strip())
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        raise WrongTemperatureError(f"{shown!r}; {NOT_A_NUMBER}") from None
    if isinstance(found, Mapping):
        named = [found[key] for key in KEYS if key in found]
        found = named[0] if len(named) == 1 else None
    if isinstance(found, bool) or not isinstance(found, int | float) or abs(found) > LARGEST:
        raise WrongTemperatureError(f"{shown!r}; {NOT_A_NUMBER}")
    return float(found)


class Temperatures:
    """Follows the sources of a configuration.

    ``ask`` sends to the relay; it blocks and raises NoGatewayError.
    """

    def __init__(self, ask: Callable[[Request], Reply], log: LogEvent) -> None:
        self._ask = ask
        self._log = log
        self._sources: dict[str, TemperatureSource] = {}
        self._readers: dict[str, asyncio.Task[None]] = {}
        self._new: dict[str, float] = {}
        self._is_new = asyncio.Event()
        self._reported: dict[str, str] = {}

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics to subscribe to."""
        return tuple(dict.fromkeys(each.mqtt for each in self._sources.values() if each.mqtt is not None))

    def follow(self, sections: Sections) -> None:
        """Use the sources of a configuration; unchanged sources change nothing."""
        sources = {name: axis.thermal.source for name, axis in sections.axes.items() if axis.thermal}
        for name in [each for each, source in self._sources.items() if sources.get(each) != source]:
            self._new.pop(name, None)
            self._reported.pop(name, None)
            if name in self._readers:
                self._readers.pop(name).cancel()
        self._sources = sources
        for name, source in sources.items():
            if source.modbus is not None and name not in self._readers:
                # This loads serial ports and a Modbus master, which few supervisors need.
                from gateway.supervisor.temperature_registers import read_on

                reading = read_on(source, partial(self._take, name), partial(self._not_read, name))
                self._readers[name] = asyncio.create_task(reading)

    def on_message(self, topic: str, payload: bytes, *, is_retained: bool) -> None:
        """Take a message. A retained one is ignored: its age is unknown."""
        if is_retained:
            return
        for name, source in self._sources.items():
            if source.mqtt == topic:
                try:
                    self._take(name, read_payload(payload))
                except WrongTemperatureError as error:
                    self._complain(name, f"{topic}: found {error}")

    async def run(self) -> None:
        """Send new values to the relay until cancelled."""
        try:
            while True:
                await self._is_new.wait()
                self._is_new.clear()
                new, self._new = self._new, {}
                for name, celsius in new.items():
                    await self._send(name, celsius)
                await asyncio.sleep(SEND_EVERY_S)
        finally:
            for reader in self._readers.values():
                reader.cancel()
            await asyncio.gather(*self._readers.values(), return_exceptions=True)

    def _take(self, name: str, celsius: float) -> None:
        self._new[name] = celsius
        self._is_new.set()

    async def _send(self, name: str, celsius: float) -> None:
        if not isfinite(celsius):  # a float register can hold any value, and JSON has no NaN or infinity
            self._complain(name, f"found {celsius}")
            return
        try:
            reply = await in_thread(partial(self._ask, SetTemperature(axis=name, celsius=celsius)))
        except NoGatewayError:
            return  # the loss is reported elsewhere, and a newer value follows
        if isinstance(reply, Done) and not reply.problems:
            self._reported.pop(name, None)
        else:
            self._complain(name, "; ".join(reply.problems) if isinstance(reply, Done) else str(reply))

    def _not_read(self, name: str, detail: str) -> None:
        self._complain(name, detail, TEMPERATURE_NOT_READ)

    def _complain(self, name: str, detail: str, kind: EventEntry = TEMPERATURE_WRONG) -> None:
        """Report each kind of fault once, whatever the value."""
        if self._reported.get(name) != kind.name:
            self._reported[name] = kind.name
            self._log(kind, axis=name, detail=detail)
