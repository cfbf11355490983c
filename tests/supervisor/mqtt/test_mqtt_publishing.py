"""What is published, and what follows a reload."""

import asyncio
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.catalogue.entry import Severity
from gateway.catalogue.process_events import SUPERVISING
from gateway.ipc.log import LogEntry
from gateway.status.model import MqttStatus
from gateway.supervisor.broadcast import EVENTS_KEPT
from tests.supervisor.mqtt.mqtt_bench import (
    OWN,
    ROOT,
    axis,
    connected,
    data_of,
    model,
    publishing,
    settings,
)
from tests.support.mosquitto import BrokerLeftError, broker_in, payload_of, watching
from tests.support.processes import started
from tests.support.status_models import model_of, plain

VERSIONS = pytest.mark.parametrize("version", ["3.1.1", "5"])


@VERSIONS
async def test_who_comes_late_finds_availability_info_and_tables_and_hears_the_rest(
    tmp_path: Path, version: str
) -> None:
    async with connected(tmp_path, model(), version=version) as (broker, site):
        async with watching(broker.port) as early:
            await early.until(f"{ROOT}/axis/x")  # everything has been sent once
        async with watching(broker.port) as late:
            await late.until(f"{ROOT}/line/xyz")
            await late.until(f"{ROOT}/axis/x")
            found = {m.topic: payload_of(m) for m in late.heard if m.retain}
            moving = {m.topic: data_of(payload_of(m)) for m in late.heard if not m.retain}
        status = site.status
    assert set(found) == {f"{ROOT}/{one}" for one in ("availability", "info", "journal", "axis/x/table")}
    assert data_of(found[f"{ROOT}/journal"]) == OWN["journal"]
    assert found[f"{ROOT}/availability"] == b"online"
    info = data_of(found[f"{ROOT}/info"])
    assert {**info.pop("verdict"), "since": ""} == {
        "state": "healthy",
        "since": "",
        "errors": 0,
        "warnings": 0,
    }
    assert info == {
        "name": "mill-1",
        "version": "9.9.9",
        "relay": "up",
        "lines": ["xyz"],
        "axes": {"x": {"units": "mm"}},
        "interval_s": 0.05,
        "commands": False,
        "troubles": [],
    }
    assert data_of(found[f"{ROOT}/axis/x/table"]) == axis()["table"]
    assert moving[f"{ROOT}/axis/x"]["correction"] == 0.012
    assert moving[f"{ROOT}/axis/x"]["nominal_actual"] is None
    assert moving[f"{ROOT}/axis/x"]["verdict"]["state"] == "healthy"
    assert "table" not in moving[f"{ROOT}/axis/x"]
    assert moving[f"{ROOT}/line/xyz"]["exchanges"] == 7
    assert (status["problem"], status["connects"]) == (None, 1)


async def test_a_table_is_published_when_it_changes_and_only_then(tmp_path: Path) -> None:
    async with (
        connected(tmp_path, model()) as (broker, site),
        watching(broker.port, f"{ROOT}/axis/#") as watcher,
    ):
        await watcher.until(f"{ROOT}/axis/x/table")
        site.broadcast.publish(model_of(model({"x": axis(0.5)})))
        await watcher.until(f"{ROOT}/axis/x", lambda payload: data_of(payload)["correction"] == 0.5)
        assert [m.topic for m in watcher.heard].count(f"{ROOT}/axis/x/table") == 1
        site.broadcast.publish(
            model_of(model({"x": axis(0.5, status="rejected", error="x.tab:3: no number")}))
        )
        changed = data_of(payload_of(await watcher.until(f"{ROOT}/axis/x/table")))
    assert (changed["status"], changed["error"]) == ("rejected", "x.tab:3: no number")


@VERSIONS
async def test_events_come_with_their_number_and_their_own_fields(tmp_path: Path, version: str) -> None:
    async with (
        connected(tmp_path, version=version) as (broker, site),
        watching(broker.port, f"{ROOT}/event") as watcher,
    ):
        site.broadcast.publish_event(
            LogEntry(Severity.WARNING, "drive-silent", {"line": "xyz"}, 1_000_000_000.25)
        )
        message = await watcher.until(
            f"{ROOT}/event", lambda payload: data_of(payload)["event"] == "drive-silent"
        )
    assert message.qos == 1
    assert not message.retain
    told = data_of(payload_of(message))
    assert told == {
        "number": told["number"],
        "time": "2001-09-09T01:46:40.250+00:00",
        "event": "drive-silent",
        "severity": "warning",
        "line": "xyz",
    }


async def test_positions_of_a_relay_that_is_gone_are_not_published_but_that_it_is_gone(
    tmp_path: Path,
) -> None:
    async with connected(tmp_path) as (broker, site), watching(broker.port) as watcher:
        site.broadcast.publish(model_of(model(up=False)))
        await watcher.until(f"{ROOT}/info", lambda payload: data_of(payload)["relay"] == "down")
        site.broadcast.publish(model_of(model(age_s=2.5)))
        info = await watcher.until(f"{ROOT}/info", lambda payload: data_of(payload)["relay"] == "up")
        assert data_of(payload_of(info))["troubles"][0]["kind"] == "relay-silent"
        assert not watcher.topics() & {f"{ROOT}/axis/x", f"{ROOT}/line/xyz"}
        site.broadcast.publish(model_of(model()))
        await watcher.until(f"{ROOT}/axis/x")


CHILD = """
import asyncio, sys
from pathlib import Path
from tests.supervisor.mqtt.mqtt_bench import publishing, settings, model

async def main():
    folder = Path(sys.argv[2])
    async with publishing(settings(int(sys.argv[1]), folder), folder) as site:
        site.broadcast.publish(model())
        await site.until_said("mqtt-connected")
        print("connected", flush=True)
        await asyncio.Event().wait()

asyncio.run(main())
"""


async def test_the_last_will_speaks_for_a_gateway_that_was_killed(tmp_path: Path) -> None:
    with broker_in(tmp_path) as broker:
        command = [sys.executable, "-c", CHILD, str(broker.port), str(tmp_path)]
        with started(command, stdout=subprocess.PIPE, cwd=Path(__file__).parents[3]) as child:
            async with watching(broker.port, f"{ROOT}/availability") as watcher:
                await watcher.until(f"{ROOT}/availability", lambda payload: payload == b"online")
                child.send_signal(signal.SIGKILL)
                await watcher.until(f"{ROOT}/availability", lambda payload: payload == b"offline")
        async with watching(broker.port, f"{ROOT}/availability") as late:
            message = await late.until(f"{ROOT}/availability")
        assert (payload_of(message), message.retain) == (b"offline", True)


async def test_a_gateway_that_is_stopped_says_so_itself(tmp_path: Path) -> None:
    with broker_in(tmp_path) as broker:
        async with watching(broker.port, f"{ROOT}/availability") as watcher:
            async with publishing(settings(broker.port, tmp_path), tmp_path) as site:
                await site.until_said("mqtt-connected")
                await watcher.until(f"{ROOT}/availability", lambda payload: payload == b"online")
            await watcher.until(f"{ROOT}/availability", lambda payload: payload == b"offline")
        broker.until_logged("Client pitch-gateway-mill-1 disconnected.")


async def test_a_broker_that_comes_back_gets_what_is_so_now_and_the_newest_events(tmp_path: Path) -> None:
    async with connected(tmp_path, model({"x": axis(0.1), "y": axis(0.1)})) as (broker, site):
        async with watching(broker.port) as watcher:
            await watcher.until(f"{ROOT}/axis/x")
            broker.stop()
            with pytest.raises(BrokerLeftError):
                await watcher.until("never")
        await site.until_said("mqtt-lost")
        assert site.status["state"] == "connecting"
        assert site.status["problem"]
        for number in range(EVENTS_KEPT + 40):
            site.broadcast.publish_event(LogEntry(Severity.INFO, "tick", {"n": number}, 0.0))
            site.broadcast.publish(model_of(model({"x": axis(1.0 + number)})))
            await asyncio.sleep(0)
        broker.start()
        async with watching(broker.port) as watcher:
            last = EVENTS_KEPT + 39
            await watcher.until(f"{ROOT}/event", lambda payload: data_of(payload).get("n") == last)
            await watcher.until(f"{ROOT}/axis/x")
            heard = [(m.topic, payload_of(m)) for m in watcher.heard]
        status = site.status
    corrections = [data_of(payload)["correction"] for topic, payload in heard if topic == f"{ROOT}/axis/x"]
    assert set(corrections) == {1.0 + last}, "only the newest"
    ticks = [data_of(p)["n"] for t, p in heard if t == f"{ROOT}/event" and data_of(p)["event"] == "tick"]
    assert ticks == list(range(last + 1 - len(ticks), last + 1))
    # Beside the ticks, what was said of the connection waits: lost (twice, the second time refused).
    assert EVENTS_KEPT - 4 <= len(ticks) <= EVENTS_KEPT
    assert status["dropped_events"] >= 40
    assert (status["state"], status["problem"], status["connects"]) == ("connected", None, 2)
    assert f"{ROOT}/axis/y" not in {topic for topic, _ in heard}, "that axis is gone"


async def test_what_is_not_there_any_more_is_taken_from_the_broker_also_after_a_restart(
    tmp_path: Path,
) -> None:
    with broker_in(tmp_path) as broker:
        given = settings(broker.port, tmp_path, discovery="homeassistant")
        async with publishing(given, tmp_path) as site:
            site.broadcast.publish(model_of(model({"x": axis(), "y": axis()})))
            await site.until_said("mqtt-connected")
            async with watching(broker.port) as watcher:
                await watcher.until(f"{ROOT}/axis/y")
        async with publishing(given, tmp_path) as site:
            site.broadcast.publish(model_of(model(age_s=None)))  # nothing is known yet: nothing is gone
            await site.until_said("mqtt-connected")
            async with watching(broker.port) as watcher:
                await watcher.until(f"{ROOT}/info", lambda payload: data_of(payload)["axes"] == {})
                site.say(SUPERVISING)  # goes after whatever else came of that model
                await watcher.until(f"{ROOT}/event", lambda payload: b'"supervising"' in payload)
                assert not [m for m in watcher.heard if not payload_of(m)]
                site.broadcast.publish(model_of(model()))
                await watcher.until(f"{ROOT}/axis/x")
        async with publishing(settings(broker.port, tmp_path), tmp_path) as site:
            site.broadcast.publish(model_of(model()))
            await site.until_said("mqtt-connected")
            async with watching(broker.port) as watcher:
                await watcher.until(f"{ROOT}/axis/x")
        async with watching(broker.port) as late:
            await late.client.publish("end")
            await late.until("end")
    assert late.topics() == {
        *(f"{ROOT}/{one}" for one in ("availability", "info", "journal", "axis/x/table")),
        "end",
    }


async def test_words_that_only_say_how_long_something_lasts_are_not_published_each_time(
    tmp_path: Path,
) -> None:
    silent = model(age_s=3.0)

    def lasting(seconds: int) -> dict[str, object]:
        return {**silent, "troubles": [{**silent["troubles"][0], "what": f"silent for {seconds} s"}]}

    with broker_in(tmp_path) as broker:
        async with (
            publishing(settings(broker.port, tmp_path), tmp_path) as site,
            watching(broker.port, f"{ROOT}/#") as watcher,
        ):
            site.broadcast.publish(model_of(lasting(3)))
            await watcher.until(f"{ROOT}/info")
            for seconds in (4, 5):
                site.broadcast.publish(model_of(lasting(seconds)))
                site.say(SUPERVISING)  # what it says is looked at again with each event
                await watcher.until(f"{ROOT}/event")
            site.broadcast.publish(model_of(model()))
            await watcher.until(f"{ROOT}/info", lambda payload: not data_of(payload)["troubles"])
            infos = [data_of(payload_of(m)) for m in watcher.heard if m.topic == f"{ROOT}/info"]
    told = [info["troubles"][0] for info in infos if info["troubles"]]
    assert [trouble["what"] for trouble in told] == ["silent for 3 s"]
    assert (told[0]["kind"], told[0]["axes"], told[0]["audience"]) == ("relay-silent", ["x"], "operator")


# A configuration that changes while the supervisor runs: other settings, none, some again.


async def test_other_settings_hold_at_once_and_the_same_ones_change_nothing(tmp_path: Path) -> None:
    with broker_in(tmp_path) as broker:
        async with (
            publishing(settings(broker.port, tmp_path), tmp_path) as site,
            watching(broker.port) as watcher,
        ):
            site.broadcast.publish(model_of(model()))
            await watcher.until(f"{ROOT}/axis/x")
            site.service.follow(settings(broker.port, tmp_path))
            await watcher.until(f"{ROOT}/axis/x")
            assert site.status["connects"] == 1
            site.service.follow(settings(broker.port, tmp_path, base_topic="plant"))
            await watcher.until(f"{ROOT}/availability", lambda payload: payload == b"offline")
            # What was retained under the old name is taken away.
            await watcher.until(f"{ROOT}/info", lambda payload: not payload)
            await watcher.until("plant/mill-1/axis/x")
            assert len(site.said("mqtt-connected")) == 2


async def test_it_can_be_left_out_and_come_back(tmp_path: Path) -> None:
    with broker_in(tmp_path) as broker:
        async with watching(broker.port) as watcher, publishing(None, tmp_path) as site:
            site.broadcast.publish(model_of(model()))
            assert site.status == plain(MqttStatus())
            for _ in range(2):
                site.service.follow(settings(broker.port, tmp_path))
                await watcher.until(f"{ROOT}/axis/x")
                assert site.status["state"] == "connected"
                site.service.follow(None)
                await watcher.until(f"{ROOT}/availability", lambda payload: payload == b"offline")
                async with asyncio.timeout(30):
                    while site.service.publisher is not None:  # noqa: ASYNC110 - nothing is told of this
                        await asyncio.sleep(0)
                assert site.status == plain(MqttStatus())


async def test_a_reload_that_changes_the_topics_is_answered_all_the_same(tmp_path: Path) -> None:
    with broker_in(tmp_path) as broker:
        given = settings(broker.port, tmp_path, commands=True)
        async with watching(broker.port) as watcher, publishing(given, tmp_path) as site:
            await site.until_said("mqtt-connected")
            site.after_reload = settings(broker.port, tmp_path, base_topic="plant", commands=True)
            await watcher.client.publish(f"{ROOT}/command/reload", '{"id": 3}', qos=1)
            await watcher.until("plant/mill-1/availability")
            await site.until_said("mqtt-connected", times=2)
            site.say(SUPERVISING)
            await watcher.until(
                "plant/mill-1/event", lambda payload: data_of(payload)["event"] == "supervising"
            )
    heard = [data_of(payload_of(m)) for m in watcher.heard if m.topic.endswith("/event")]
    # One whose acknowledgement was cut off is sent again, with the same number.
    events = list({event["number"]: event for event in heard}.values())
    answers = [event for event in events if event["event"] == "mqtt-command"]
    assert [(answer["id"], answer["result"]) for answer in answers] == [(3, "done")]
    assert [event["event"] for event in events] == [
        "mqtt-connected",
        "mqtt-command",
        "mqtt-connected",
        "supervising",
    ]
