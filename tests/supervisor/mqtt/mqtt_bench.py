"""A publisher with a status model that a test makes up, and what it tells of itself."""

import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from gateway.catalogue.entry import EventEntry, Severity
from gateway.config.mqtt_model import MqttSection
from gateway.ipc.log import log_entry
from gateway.ipc.messages import Done, Reply, Request
from gateway.supervisor.broadcast import Broadcast
from gateway.supervisor.model import whole_model
from gateway.supervisor.mqtt.interfaces import Orders
from gateway.supervisor.mqtt.publisher import Publisher
from gateway.supervisor.mqtt.service import MqttService
from gateway.supervisor.mqtt.settings import Settings, settings_of
from gateway.supervisor.outcome import ReloadOutcome
from tests.support.mosquitto import PATIENCE_S, Broker, broker_in
from tests.support.status_models import model_of, plain, relay_model_of, supervisor_of

ROOT = "pitch-gateway/mill-1"
OWN = {
    "configuration": {"file": "gateway.toml"},
    "tables_folder": {"folder": "tables"},
    "state_folder": {"folder": "state"},
    "http": {"problem": None},
    "mqtt": {"problem": None},
    "journal": {"seq": 7, "digest": "ef" * 32},
}
LATENCY = {"p50": 41.0, "p99": 77.5, "p999": 120.0, "max": 130.0, "max_minute": 101.0, "below": [0, 3, 9]}


def axis(correction: float | None = 0.012, **table: Any) -> dict[str, Any]:
    """An axis as the relay's snapshot has it."""
    return {
        "compensation": "active",
        "units": "mm",
        "direction": "forward",
        "gain": {"forward": 1.0, "backward": 1.0},
        "travel": (-300.0, 0.0),
        "correction": correction,
        "nominal_setpoint": -12.5,
        "corrected_setpoint": -12.488,
        "nominal_actual": None,
        "corrected_actual": None,
        "table": {
            "file": "x.tab",
            "format": "centroid-3",
            "sha256": "ab" * 32,
            "compiled": "cd" * 32,
            "points": 9,
            "status": "active",
            "error": None,
            "loaded_at": "2026-01-01T00:00:00+00:00",
            **table,
        },
        "latency": {"gateway_us": LATENCY, "budget_us": 1000.0, "is_over_budget": False},
    }


def terms() -> dict[str, Any]:
    """Return what a warm axis says that is out of square with y, as the relay's snapshot has it."""
    thermal = {"state": "held", "celsius": 30.5, "age_s": 71.0, "difference": 9.5, "correction": -0.0575}
    return {
        "correction": -0.0175,
        "is_too_large": False,
        "thermal": {**thermal, "is_silent": True},
        "cross": {"state": "following", "axes": ["y"], "correction": 0.04},
    }


def model(
    axes: dict[str, Any] | None = None, *, up: bool = True, age_s: float | None = 0.1
) -> dict[str, Any]:
    """The whole model; by default of one axis, x."""
    drives = {"address": "127.0.0.1:502", "failure": None}
    snapshot = {
        "gateway": {"name": "mill-1", "version": "9.9.9", "uptime_s": 12.5},
        "lines": {"xyz": {"state": "up", "exchanges": 7, "drives": drives}},
        "axes": {"x": axis()} if axes is None else axes,
    }
    return plain(
        whole_model(
            "mill-1",
            None if age_s is None else relay_model_of(snapshot),
            is_relay_up=up,
            snapshot_age_s=age_s,
            tables={},
            supervisor=supervisor_of(OWN),
        )
    )


def settings(port: int, folder: Path, **keys: Any) -> Settings:
    """Settings as a configuration in ``folder`` would have them."""
    raw = {"port": port, "interval_s": 0.05, **keys}
    return settings_of(MqttSection.model_validate(raw), "mill-1", folder)


class Site:
    """A publisher that runs, its feeds, and what was asked of the relay."""

    def __init__(self, given: Settings | None, state: Path) -> None:
        self.broadcast = Broadcast()
        self.asked: list[Request] = []
        self.reply: Reply = Done(changed=("x",), comes={"x": "next-target"})
        self.outcome = ReloadOutcome(comes={"x": "blended"}, changed=("axis.x.gain",))
        self.reloads = 0
        self.service = MqttService(self.broadcast, self.say, Orders(self._reload, self._ask), state)
        self.service.follow(given)
        self.after_reload: Settings | None = given
        self._told = asyncio.Event()
        self._may_reload = asyncio.Event()
        self._may_reload.set()

    def hold_reloads(self) -> asyncio.Event:
        """Let reloads take until the event is set."""
        self._may_reload.clear()
        return self._may_reload

    async def until_waiting(self, number: int) -> None:
        """Wait until so many commands wait for their turn."""
        async with asyncio.timeout(PATIENCE_S):
            while len(self.publisher._commander._waiting) < number:  # noqa: ASYNC110 - nothing is told of these
                await asyncio.sleep(0)

    def say(self, event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
        self.broadcast.publish_event(log_entry(event, fields, time.time(), severity))
        self._told.set()

    async def _reload(self) -> ReloadOutcome:
        self.reloads += 1
        await self._may_reload.wait()
        self.service.follow(self.after_reload)
        for _ in range(10):  # as the supervisor's, it returns a little later
            await asyncio.sleep(0)
        return self.outcome

    def _ask(self, request: Request) -> Reply:
        self.asked.append(request)
        return self.reply

    def said(self, event: str) -> list[dict[str, Any]]:
        return [told.as_data() for told in self.broadcast.recent if told.entry.event == event]

    async def until_said(self, event: str, times: int = 1) -> dict[str, Any]:
        async with asyncio.timeout(PATIENCE_S):
            while len(self.said(event)) < times:
                self._told.clear()
                await self._told.wait()
        return self.said(event)[times - 1]

    @property
    def status(self) -> dict[str, Any]:
        return plain(self.service.status())

    @property
    def publisher(self) -> Publisher:
        assert self.service.publisher is not None
        return self.service.publisher


@contextlib.asynccontextmanager
async def publishing(given: Settings | None, state: Path) -> AsyncIterator[Site]:
    site = Site(given, state)
    task = asyncio.create_task(site.service.run())
    try:
        yield site
        assert not task.done(), "the service ended by itself"
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


@contextlib.asynccontextmanager
async def connected(
    folder: Path, newest: dict[str, Any] | None = None, **keys: Any
) -> AsyncIterator[tuple[Broker, Site]]:
    """A broker, and a publisher that has reached it and has this model to tell of."""
    with broker_in(folder) as broker:
        async with publishing(settings(broker.port, folder, **keys), folder) as site:
            if newest is not None:
                site.broadcast.publish(model_of(newest))
            await site.until_said("mqtt-connected")
            yield broker, site


def data_of(payload: bytes) -> Any:
    return json.loads(payload)
