"""What is published: parts of the status model, each under its topic, as JSON."""

from gateway.supervisor.mqtt.interfaces import Payload
from gateway.supervisor.mqtt.settings import Settings
from gateway.supervisor.mqtt.topics import Topics
from gateway.supervisor.trouble import is_fresh


def is_known(model: Payload) -> bool:
    """Whether the relay has ever said what it has: without that nothing is known of its axes."""
    return model["gateway"]["snapshot_age_s"] is not None


def retained_messages(settings: Settings, model: Payload) -> dict[str, Payload]:
    """Return what whoever comes late has to know, by topic; it changes seldom."""
    topics, gateway = settings.topics, model["gateway"]
    info = {
        "name": topics.name,
        "version": gateway["version"],
        "relay": gateway["relay"],
        "lines": list(model["lines"]),
        "axes": {name: {"units": axis["units"]} for name, axis in model["axes"].items()},
        "interval_s": settings.interval_s,
        "commands": settings.allows_commands,
        "verdict": model["verdict"],
        "troubles": model["troubles"],
    }
    tables = {topics.table(name): axis["table"] for name, axis in model["axes"].items()}
    return {topics.info: info, **tables}


def without_words(payload: Payload) -> Payload:
    """Return a payload without what changes of a trouble from moment to moment: how long, and how often."""
    if "troubles" not in payload:
        return payload
    lasting = [{key: it for key, it in each.items() if key != "what"} for each in payload["troubles"]]
    return {**payload, "troubles": lasting}


def moving_topics(topics: Topics, model: Payload) -> dict[str, tuple[str, str]]:
    """Return the topics of what is published in every interval, each with its place in the model."""
    lines = {topics.line(name): ("lines", name) for name in model["lines"]}
    return lines | {topics.axis(name): ("axes", name) for name in model["axes"]}


def moving_message(model: Payload, place: tuple[str, str]) -> Payload | None:
    """Return a line or an axis, None where there is nothing to say about it now."""
    section, name = place
    found = model[section].get(name) if is_fresh(model) else None
    return None if found is None else {key: each for key, each in found.items() if key != "table"}
