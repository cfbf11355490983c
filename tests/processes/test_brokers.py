"""A whole gateway with a real broker that goes, comes back, refuses: the relay notices none of it."""

import asyncio
import json
import os
import signal
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.soak import repeated
from tests.support.gateway import Master, Site, gateway_of
from tests.support.mosquitto import PATIENCE_S, broker_in, mosquitto_passwd, payload_of, watching
from tests.support.ports import free_port
from tests.support.processes import children, wait_until_dead

ROOT = "pitch-gateway/trial"
AWAY_S = float(repeated(60))
WITH_PASSWORD = "listener {port} 127.0.0.1\nallow_anonymous false\npassword_file "


class Watched:
    """A site with a page and a broker, and what the page says of the broker."""

    def __init__(self, site: Site, broker_port: int, more: str = "") -> None:
        self.url = f"{site.serve_page()}/status"
        text = f"[mqtt]\nport = {broker_port}\ninterval_s = 0.1\n{more}"
        site.config.write_text(text + site.config.read_text())

    def mqtt(self) -> dict[str, Any]:
        with urllib.request.urlopen(self.url, timeout=PATIENCE_S) as answer:
            model = json.load(answer)
        found: dict[str, Any] = model["supervisor"]["mqtt"]
        return found


def moves(master: Master, first: int, count: int) -> Iterator[bool]:
    """Command positions; yield whether each arrived as its table has it."""
    for counts in range(first, first + count):
        yield master.move(counts) == counts + round(counts / 1000)


async def heard(port: int, topic: str) -> bytes:
    async with watching(port, topic) as watcher:
        return payload_of(await watcher.until(topic))


def test_who_comes_late_finds_what_is_retained_and_hears_the_last_will(site: Site, tmp_path: Path) -> None:
    with broker_in(tmp_path) as broker:
        Watched(site, broker.port)
        with gateway_of(site) as (gateway, master):
            gateway.until("mqtt-connected")
            assert asyncio.run(heard(broker.port, f"{ROOT}/availability")) == b"online"
            table = json.loads(asyncio.run(heard(broker.port, f"{ROOT}/axis/x/table")))
            assert (table["file"], table["status"], table["points"]) == ("x.tab", "active", 3)
            supervisor = children(gateway.process)["gateway.supervisor"]
            os.kill(supervisor, signal.SIGKILL)
            wait_until_dead(supervisor)

            async def last_will() -> None:
                async with watching(broker.port, f"{ROOT}/availability") as watcher:
                    await watcher.until(f"{ROOT}/availability", lambda payload: payload == b"offline")
                    await watcher.until(f"{ROOT}/availability", lambda payload: payload == b"online")

            assert all(moves(master, 20_000, 100))
            asyncio.run(last_will())  # and the next supervisor takes it back
            gateway.until("supervisor-started")


def test_a_broker_that_is_away_for_a_while_is_found_again(site: Site, tmp_path: Path) -> None:
    with broker_in(tmp_path) as broker:
        watched = Watched(site, broker.port)
        with gateway_of(site) as (gateway, master):
            gateway.until("mqtt-connected")
            broker.stop()
            assert gateway.until("mqtt-lost")["level"] == "warning"
            assert watched.mqtt()["state"] == "connecting"
            assert watched.mqtt()["problem"]
            last_counts = asyncio.run(_away(master))
            broker.start()
            gateway.until("mqtt-connected")
            status = watched.mqtt()
            assert (status["state"], status["problem"], status["connects"]) == ("connected", None, 2)
            message = json.loads(asyncio.run(heard(broker.port, f"{ROOT}/axis/x")))
            assert message["nominal_setpoint"] == last_counts / 1000
    details = [note["detail"] for note in gateway.notes if note["event"] == "mqtt-lost"]
    assert len(details) == len(set(details)) <= 2  # that it was lost, and why it cannot be had


async def _away(master: Master) -> int:
    """Move for :data:`AWAY_S`, every position arrives as its table has it; returns the last, in counts."""
    loop = asyncio.get_running_loop()
    began_s, counts = loop.time(), 20_000
    while loop.time() - began_s < AWAY_S:
        counts += 1
        assert all(moves(master, counts, 1))
        await asyncio.sleep(0.01)
    return counts


def test_a_wrong_password_is_told_and_costs_no_move(site: Site, tmp_path: Path) -> None:
    passwords = tmp_path / "passwords"
    passwords.touch(mode=0o600)
    os.spawnl(os.P_WAIT, mosquitto_passwd(), "mosquitto_passwd", "-b", str(passwords), "trial", "right")
    with broker_in(tmp_path, f"{WITH_PASSWORD}{passwords}\n") as broker:
        secret = tmp_path / "secret"
        secret.write_text("sesame\n")
        secret.chmod(0o600)
        watched = Watched(site, broker.port, f'username = "trial"\npassword_file = "{secret}"\n')
        with gateway_of(site) as (gateway, master):
            lost = gateway.until("mqtt-lost")
            assert "sesame" not in json.dumps(gateway.notes)
            assert "password" in lost["detail"]
            assert "password" in watched.mqtt()["problem"]
            assert "sesame" not in json.dumps(watched.mqtt())
            assert all(moves(master, 20_000, 100))
            secret.write_text("right\n")  # read anew for each attempt
            gateway.until("mqtt-connected")
            assert watched.mqtt()["problem"] is None


def test_a_broker_that_never_was_costs_nothing(site: Site) -> None:
    port = free_port()
    watched = Watched(site, port)
    with gateway_of(site) as (gateway, master):
        gateway.until("mqtt-lost")
        assert "nothing listens" in watched.mqtt()["problem"]
        assert all(moves(master, 20_000, 100))
