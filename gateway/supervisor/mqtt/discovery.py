"""What tells Home Assistant that there is a gateway with axes: device based discovery over MQTT.

One device for the gateway and one for each axis, each described by one retained message under the topic
``PREFIX/device/ID/OBJECT/config``; an empty one takes a device away again. The keys are those of
https://www.home-assistant.io/integrations/mqtt/#mqtt-discovery; the four that the format itself needs are in
their short forms (``dev``, ``o``, ``cmps``, ``p``), as that page shows them.
"""

from math import ceil
from typing import Any, Final

from gateway.exchange.status import COMPENSATION_STATES, DIRECTION_STATES
from gateway.supervisor.mqtt.messages import Payload
from gateway.supervisor.mqtt.settings import Settings

MAKER: Final = "pitch-gateway"
QUIET_INTERVALS: Final = 5
SHORTEST_EXPIRY_S: Final = 15
TABLE: Final = ("active", "waiting", "rejected", "removed", "none")
UNITS: Final = {"mm": "mm", "inch": "in", "degree": "°"}
"""As Home Assistant writes them; the first two are units of its class ``distance``."""

_RELAY_UP: Final = "value_json.relay == 'up'"


def discovery_messages(settings: Settings, model: Payload) -> dict[str, Payload]:
    """Return the description of each device, by topic; none where discovery is off."""
    if not settings.discovery:
        return {}
    return {
        _topic(settings, "gateway"): _gateway(settings, model),
        **{
            _topic(settings, f"axis_{name}"): _axis(settings, model, name, axis["units"])
            for name, axis in model["axes"].items()
        },
    }


def _topic(settings: Settings, device: str) -> str:
    return f"{settings.discovery}/device/{settings.topics.id}/{device}/config"


def _gateway(settings: Settings, model: Payload) -> Payload:
    topics = settings.topics
    worst = "value_json.troubles[0]"
    return {
        **_about(model),
        "dev": {
            "identifiers": [topics.id],
            "name": topics.name,
            "manufacturer": MAKER,
            "model": "gateway",
            "sw_version": model["gateway"]["version"],
        },
        "availability": [{"topic": topics.availability}],
        "cmps": {
            "relay": _binary(
                topics.id,
                "relay",
                "Relay",
                topics.info,
                condition=_RELAY_UP,
                more={"device_class": "running", "entity_category": "diagnostic"},
            ),
            "problem": _binary(
                topics.id,
                "problem",
                "Problem",
                topics.info,
                condition="value_json.troubles",
                more={
                    "device_class": "problem",
                    "json_attributes_topic": topics.info,
                    "json_attributes_template": "{{ {'troubles': value_json.troubles} | tojson }}",
                },
            ),
            "trouble": {
                **_entity(topics.id, "sensor", "trouble", "Worst problem"),
                "state_topic": topics.info,
                # A state has at most 255 characters.
                "value_template": f"{{{{ ({worst}.where ~ ': ' ~ {worst}.what)[:250] "
                "if value_json.troubles else 'none' }}",
                "icon": "mdi:alert-circle-outline",
            },
        },
    }


def _axis(settings: Settings, model: Payload, name: str, units: str) -> Payload:
    topics = settings.topics
    device = f"{topics.id}_axis_{name}"
    return {
        **_about(model),
        "dev": {
            "identifiers": [device],
            "name": f"{topics.name} axis {name}",
            "manufacturer": MAKER,
            "model": "axis",
            "via_device": topics.id,
        },
        # Without the relay there are no positions; the info says so at once.
        "availability": [
            {"topic": topics.availability},
            {
                "topic": topics.info,
                "value_template": f"{{{{ 'online' if {_RELAY_UP} else 'offline' }}}}",
            },
        ],
        "availability_mode": "all",
        "cmps": _axis_components(settings, device, name, units),
    }


def _axis_components(settings: Settings, device: str, name: str, units: str) -> dict[str, Any]:
    """Return what Home Assistant shows of an axis; positions are in ``units``, times in µs."""
    topics = settings.topics
    state, table = topics.axis(name), topics.table(name)
    expires = {"expire_after": max(SHORTEST_EXPIRY_S, ceil(settings.interval_s * QUIET_INTERVALS))}
    length: dict[str, Any] = {
        "unit_of_measurement": UNITS[units],
        "state_class": "measurement",
        "suggested_display_precision": 4,
        **({} if units == "degree" else {"device_class": "distance"}),
        **expires,
    }
    mine = f"value_json.troubles | selectattr('where', 'equalto', 'axis {name}') | list"
    positions = {
        "correction": "Correction",
        "nominal_setpoint": "Nominal setpoint",
        "corrected_setpoint": "Corrected setpoint",
        "nominal_actual": "Nominal position",
        "corrected_actual": "Corrected position",
    }
    return {
        **{key: _sensor(device, key, words, state, length) for key, words in positions.items()},
        "compensation": _choice(
            device, "compensation", "Compensation", state, options=COMPENSATION_STATES, more=expires
        ),
        "direction": _choice(device, "direction", "Direction", state, options=DIRECTION_STATES, more=expires),
        "table": {
            **_choice(device, "table", "Table", table, options=TABLE, more={}),
            "value_template": "{{ value_json.status }}",
            "json_attributes_topic": table,
            "entity_category": "diagnostic",
        },
        "latency_p99": {
            **_sensor(device, "latency_p99", "Latency p99", state, expires),
            "value_template": "{{ value_json.latency.gateway_us.p99 }}",
            "unit_of_measurement": "µs",
            "state_class": "measurement",
            "entity_category": "diagnostic",
            "icon": "mdi:timer-outline",
        },
        "problem": _binary(
            device, "problem", "Problem", topics.info, condition=mine, more={"device_class": "problem"}
        ),
    }


def _about(model: Payload) -> dict[str, Any]:
    return {"o": {"name": MAKER, "sw_version": model["gateway"]["version"]}, "qos": 1}


def _entity(device: str, platform: str, key: str, name: str) -> dict[str, Any]:
    return {"p": platform, "unique_id": f"{device}_{key}", "name": name}


def _sensor(device: str, key: str, name: str, topic: str, more: Payload) -> dict[str, Any]:
    """A sensor of one value; null, which a template shows as None, is "unknown" there."""
    return {
        **_entity(device, "sensor", key, name),
        "state_topic": topic,
        "value_template": f"{{{{ value_json.{key} }}}}",
        **more,
    }


def _choice(
    device: str, key: str, name: str, topic: str, *, options: tuple[str, ...], more: Payload
) -> dict[str, Any]:
    return {
        **_sensor(device, key, name, topic, more),
        "device_class": "enum",
        "options": list(options),
    }


def _binary(device: str, key: str, name: str, topic: str, *, condition: str, more: Payload) -> dict[str, Any]:
    return {
        **_entity(device, "binary_sensor", key, name),
        "state_topic": topic,
        "value_template": f"{{{{ 'ON' if {condition} else 'OFF' }}}}",
        **more,
    }
