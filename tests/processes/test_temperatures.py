"""A whole gateway that hears temperatures: from a real broker, from nobody, from its socket."""

import asyncio
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from gateway.exchange.commands import SetTemperature
from gateway.ipc.client import ask
from gateway.ipc.messages import Done, GetStatus, Status
from tests.support.gateway import Site, gateway_of
from tests.support.mosquitto import broker_in, watching
from tests.support.processes import children
from tests.support.status_models import plain

WARM = "thermal = {{ alpha = 1e-4, source = {source}, timeout_s = 60, rate_per_min = 60.0 }}\nregisters"
"""Ten kelvins are 1 µm/mm: as much as the table adds."""


def warm_site(site: Site, source: str, more: str = "") -> None:
    text = site.config.read_text().replace("registers", WARM.format(source=source), 1)
    site.config.write_text(more + text)


def terms(site: Site) -> dict[str, Any]:
    reply = ask(site.socket, GetStatus())
    assert isinstance(reply, Status)
    found: dict[str, Any] = plain(reply.status.axes["x"].terms)
    return found


async def publish(port: int, topic: str, payload: bytes) -> None:
    async with watching(port) as watcher:
        await watcher.client.publish(topic, payload, qos=1)


def test_a_temperature_over_mqtt_counts_and_the_relay_alone_goes_on_with_it(
    site: Site, tmp_path: Path
) -> None:
    with broker_in(tmp_path) as broker:
        warm_site(site, '{ mqtt = "hall/x" }', f"[mqtt]\nport = {broker.port}\n")
        with gateway_of(site) as (gateway, master):
            gateway.until("mqtt-connected")
            assert master.move(50_000) == 50_050
            asyncio.run(publish(broker.port, "hall/x", b'{"temperature": 30.0}'))
            told = gateway.until("term-follows")
            assert (told["axis"], told["term"]) == ("x", "thermal")
            assert master.move(50_000) == 50_050  # nothing moves by itself
            assert master.move(80_000) == 80_000
            assert master.move(20_000) == 20_000
            found = terms(site)
            assert found["correction"] == pytest.approx(-0.02)
            assert found["thermal"] == {
                "state": "following",
                "celsius": 30.0,
                "age_s": found["thermal"]["age_s"],
                "difference": 10.0,
                "correction": pytest.approx(-0.02),
                "is_silent": False,
            }
            supervisor = children(gateway.process)["gateway.supervisor"]
            os.kill(supervisor, signal.SIGSTOP)
            try:
                assert master.move(90_000) == 90_000
            finally:
                os.kill(supervisor, signal.SIGCONT)
            asyncio.run(publish(broker.port, "hall/x", b"3000"))
            assert "is no temperature within 40 K" in gateway.until("temperature-wrong")["detail"]
            assert master.move(91_000) == 91_000


def test_a_temperature_that_is_none_is_refused_at_the_socket(site: Site) -> None:
    warm_site(site, '{ modbus = "127.0.0.1:1", address = 100 }')
    with gateway_of(site) as (gateway, master):
        assert gateway.until("temperature-not-read")["detail"].startswith("127.0.0.1:1 cannot be reached: ")
        for axis, celsius, problem in (
            (
                "x",
                3000.0,
                "axis x: 3000 °C is no temperature within 40 K of the reference 20 °C; the last good ",
            ),
            ("y", 20.0, "axis y: there is none of that name; there are x"),
        ):
            reply = ask(site.socket, SetTemperature(axis=axis, celsius=celsius))
            assert isinstance(reply, Done)
            assert reply.changed == ()
            [found] = reply.problems
            assert found.startswith(problem)
        assert master.move(50_000) == 50_050
        assert ask(site.socket, SetTemperature(axis="x", celsius=30.0)) == Done(changed=("x",))
        assert master.move(50_000) == 50_050
        assert master.move(60_000) == 60_000
