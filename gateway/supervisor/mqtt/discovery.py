"""Home Assistant discovery: describes the gateway and its axes as devices over MQTT.

One device for the gateway and one for each axis, each described by a retained message under the topic
``PREFIX/device/ID/OBJECT/config``. An empty message removes the device. The keys are those of
https://www.home-assistant.io/integrations/mqtt/#mqtt-discovery; the four that the format itself needs have
their short forms (``dev``, ``o``, ``cmps``, ``p``), as on that page.

The terms ``thermal`` and ``cross`` of an axis have a message of their own, for the same device. An entity
that a later message leaves out would stay; an entity whose message is removed goes. For the same reason
buttons and switches, which exist only while commands are allowed, have messages of their own.
"""

import json
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, metadata
from math import ceil
from typing import Any, Final

from gateway.exchange.status_words import COMPENSATION_STATES, DIRECTION_STATES, TERM_STATES
from gateway.plain import JsonObject
from gateway.status.axis import TermsStatus
from gateway.status.model import Model
from gateway.supervisor.mqtt.interfaces import Payload
from gateway.supervisor.mqtt.settings import Settings
from gateway.supervisor.verdict import Health

MAKER: Final = "pitch-gateway"
QUIET_INTERVALS: Final = 5
SHORTEST_EXPIRY_S: Final = 15
TABLE: Final = ("active", "waiting", "rejected", "removed", "none")
VERDICTS: Final = tuple(state.value for state in Health)
UNITS: Final = {"mm": "mm", "inch": "in", "degree": "°"}
"""Units in Home Assistant's spelling; the first two belong to its class ``distance``."""


def _project_url() -> str:
    """Return the project's address from pyproject.toml; empty if the package is not installed."""
    try:
        named = metadata(MAKER).get_all("Project-URL") or []
    except PackageNotFoundError:
        return ""
    return next((url.partition(", ")[2] for url in named), "")


SUPPORT_URL: Final = _project_url()
_IS_ON: Final = "value_json.is_enabled | default(value_json.compensation != 'off')"
"""A relay of an older release does not report the switch itself."""
_RELAY_UP: Final = "value_json.relay == 'up'"


def discovery_messages(settings: Settings, model: Model) -> dict[str, Payload]:
    """Return the description of each device, by topic; none if discovery is off."""
    if not settings.discovery:
        return {}
    found = {_topic(settings, "gateway"): _gateway(settings, model, _gateway_components(settings))}
    if settings.allows_commands:
        found[_topic(settings, "commands")] = _gateway(settings, model, _gateway_commands(settings))
    for name, axis in model.axes.items():
        components = _axis_components(settings, name, axis.units)
        found[_topic(settings, f"axis_{name}")] = _axis(settings, model, name, components)
        if (terms := axis.terms) is not None:
            components = _term_components(settings, name, axis.units, terms)
            found[_topic(settings, f"terms_{name}")] = _axis(settings, model, name, components)
        if settings.allows_commands:
            components = _axis_commands(settings, name)
            found[_topic(settings, f"commands_{name}")] = _axis(settings, model, name, components)
    return found


def _topic(settings: Settings, device: str) -> str:
    return f"{settings.discovery}/device/{settings.topics.id}/{device}/config"


def _gateway(settings: Settings, model: Model, components: Payload) -> Payload:
    topics = settings.topics
    return {
        **_about(model),
        "dev": {
            "identifiers": [topics.id],
            "name": topics.name,
            "manufacturer": MAKER,
            "model": "gateway",
            "sw_version": model.gateway.version,
        },
        "availability": [{"topic": topics.availability}],
        "cmps": components,
    }


def _gateway_components(settings: Settings) -> JsonObject:
    topics = settings.topics
    worst = "value_json.troubles[0]"
    return {
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
        "verdict": {
            **_choice(topics.id, "verdict", "Verdict", topics.info, options=VERDICTS, more={}),
            "value_template": "{{ value_json.verdict.state }}",
        },
        "trouble": {
            **_entity(topics.id, "sensor", "trouble", "Worst problem"),
            "state_topic": topics.info,
            # A state has at most 255 characters.
            "value_template": f"{{{{ ({worst}.where ~ ': ' ~ {worst}.what)[:250] "
            "if value_json.troubles else 'none' }}",
            "icon": "mdi:alert-circle-outline",
        },
        "journal": {
            **_sensor(topics.id, "journal", "Journal, newest entry", topics.journal, {}),
            "value_template": "{{ value_json.seq }}",
            "json_attributes_topic": topics.journal,
            "entity_category": "diagnostic",
        },
    }


def _gateway_commands(settings: Settings) -> JsonObject:
    topics = settings.topics
    return {
        "reload": {
            **_entity(topics.id, "button", "reload", "Reload configuration and tables"),
            "command_topic": topics.command("reload"),
            "payload_press": "{}",
            "entity_category": "config",
            "icon": "mdi:reload",
        }
    }


def _axis_commands(settings: Settings, name: str) -> JsonObject:
    """Return the switch of an axis. It shows the state of the axis, not the last command."""

    def order(*, is_on: bool) -> str:
        return json.dumps({"axes": [name], "on": is_on})

    return {
        "switch": {
            **_entity(_device(settings, name), "switch", "switch", "Compensation switch"),
            "state_topic": settings.topics.axis(name),
            "value_template": f"{{{{ 'ON' if {_IS_ON} else 'OFF' }}}}",
            "state_on": "ON",
            "state_off": "OFF",
            "command_topic": settings.topics.command("switch"),
            "payload_on": order(is_on=True),
            "payload_off": order(is_on=False),
        }
    }


def _device(settings: Settings, name: str) -> str:
    return f"{settings.topics.id}_axis_{name}"


def _axis(settings: Settings, model: Model, name: str, components: Payload) -> Payload:
    topics = settings.topics
    return {
        **_about(model),
        "dev": {
            "identifiers": [_device(settings, name)],
            "name": f"{topics.name} axis {name}",
            "manufacturer": MAKER,
            "model": "axis",
            "via_device": topics.id,
        },
        # Without the relay there are no positions; the info topic shows this immediately.
        "availability": [
            {"topic": topics.availability},
            {
                "topic": topics.info,
                "value_template": f"{{{{ 'online' if {_RELAY_UP} else 'offline' }}}}",
            },
        ],
        "availability_mode": "all",
        "cmps": components,
    }


def _expires(settings: Settings) -> JsonObject:
    return {"expire_after": max(SHORTEST_EXPIRY_S, ceil(settings.interval_s * QUIET_INTERVALS))}


def _length(settings: Settings, units: str) -> JsonObject:
    return {
        "unit_of_measurement": UNITS[units],
        "state_class": "measurement",
        "suggested_display_precision": 4,
        **({} if units == "degree" else {"device_class": "distance"}),
        **_expires(settings),
    }


def _axis_components(settings: Settings, name: str, units: str) -> JsonObject:
    """Return the entities of an axis; positions are in ``units``, times in µs."""
    topics, device = settings.topics, _device(settings, name)
    state, table = topics.axis(name), topics.table(name)
    expires, length = _expires(settings), _length(settings, units)
    mine = f"'{name}' in (value_json.troubles | sum(attribute='axes', start=[]))"
    positions = {
        "correction": "Correction",
        "nominal_setpoint": "Nominal setpoint",
        "corrected_setpoint": "Corrected setpoint",
        "nominal_actual": "Nominal position",
        "corrected_actual": "Corrected position",
    }
    return {
        **{key: _sensor(device, key, words, state, length) for key, words in positions.items()},
        "verdict": {
            **_choice(device, "verdict", "Verdict", state, options=VERDICTS, more=expires),
            "value_template": "{{ value_json.verdict.state }}",
        },
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


def _term_components(settings: Settings, name: str, units: str, terms: TermsStatus) -> JsonObject:
    """Return the entities of the terms that are added to a table; lengths are in ``units``."""
    device, topic, expires = _device(settings, name), settings.topics.axis(name), _expires(settings)
    found: dict[str, Any] = {}
    if terms.thermal:
        warm: dict[str, Any] = {
            "device_class": "temperature",
            "unit_of_measurement": "°C",
            "state_class": "measurement",
            "suggested_display_precision": 1,
            **expires,
        }
        found["temperature"] = _at(
            "thermal.celsius", _sensor(device, "temperature", "Temperature", topic, warm)
        )
    for term, its, words, source in (
        ("thermal", terms.thermal, "Added for temperature", "Temperature sensor"),
        ("cross", terms.cross, "Added for other axes", "Other axes"),
    ):
        if its:
            added, state = f"{term}_added", f"{term}_state"
            length = _sensor(device, added, words, topic, _length(settings, units))
            choice = _choice(device, state, source, topic, options=TERM_STATES, more=expires)
            found[added] = _at(f"{term}.correction", length)
            found[state] = {**_at(f"{term}.state", choice), "entity_category": "diagnostic"}
    return found


def _at(value_path: str, entity: Mapping[str, Any]) -> JsonObject:
    """Return an entity whose value is at a path inside the terms."""
    return {**entity, "value_template": f"{{{{ value_json.terms.{value_path} }}}}"}


def _about(model: Model) -> JsonObject:
    support = {"support_url": SUPPORT_URL} if SUPPORT_URL else {}
    return {"o": {"name": MAKER, "sw_version": model.gateway.version, **support}, "qos": 1}


def _entity(device: str, platform: str, key: str, name: str) -> JsonObject:
    return {"p": platform, "unique_id": f"{device}_{key}", "name": name}


def _sensor(device: str, key: str, name: str, topic: str, more: Payload) -> JsonObject:
    """Return a sensor of one value. A template shows null as None, which means "unknown" there."""
    return {
        **_entity(device, "sensor", key, name),
        "state_topic": topic,
        "value_template": f"{{{{ value_json.{key} }}}}",
        **more,
    }


def _choice(
    device: str, key: str, name: str, topic: str, *, options: tuple[str, ...], more: Payload
) -> JsonObject:
    return {
        **_sensor(device, key, name, topic, more),
        "device_class": "enum",
        "options": list(options),
    }


def _binary(device: str, key: str, name: str, topic: str, *, condition: str, more: Payload) -> JsonObject:
    return {
        **_entity(device, "binary_sensor", key, name),
        "state_topic": topic,
        "value_template": f"{{{{ 'ON' if {condition} else 'OFF' }}}}",
        **more,
    }
