"""A configuration that changes while the supervisor runs: other settings, none, some again."""

import asyncio
from pathlib import Path

from gateway.catalogue.process_events import SUPERVISING
from gateway.status.model import MqttStatus
from tests.supervisor.mqtt.mqtt_bench import ROOT, data_of, model, publishing, settings
from tests.support.mosquitto import broker_in, payload_of, watching
from tests.support.status_models import model_of, plain


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
