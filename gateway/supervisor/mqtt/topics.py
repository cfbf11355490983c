"""What is published where: settings, topics and payloads."""

import re
import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from gateway.config.files import read_password, tls_context
from gateway.config.mqtt_model import MqttSection, MqttVersion, TlsSection
from gateway.supervisor.trouble import is_fresh

# --- Where everything is published: the topics of one gateway, under ``BASE/NAME/``

COMMANDS: Final = ("reload", "enable", "disable", "switch", "gain")

_NOT_IN_AN_ID: Final = re.compile(r"[^A-Za-z0-9_-]")


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of the gateway ``name``."""

    base: str
    name: str

    @property
    def root(self) -> str:
        """What all of them begin with; no slash at its end."""
        return f"{self.base}/{self.name}"

    @property
    def availability(self) -> str:
        """``online`` or ``offline``; retained."""
        return f"{self.root}/availability"

    @property
    def info(self) -> str:
        """What the gateway has and what is wrong; retained."""
        return f"{self.root}/info"

    @property
    def event(self) -> str:
        """What happens, as it happens."""
        return f"{self.root}/event"

    def line(self, line: str) -> str:
        """One line, every interval."""
        return f"{self.root}/line/{line}"

    def axis(self, axis: str) -> str:
        """One axis, every interval."""
        return f"{self.root}/axis/{axis}"

    def table(self, axis: str) -> str:
        """The table of an axis; retained."""
        return f"{self.root}/axis/{axis}/table"

    @property
    def commands(self) -> str:
        """Filter of everything that may be commanded."""
        return f"{self.root}/command/+"

    def command(self, command: str) -> str:
        """One of ``COMMANDS``."""
        return f"{self.root}/command/{command}"

    def command_in(self, topic: str) -> str:
        """Return which command a topic that :attr:`commands` matches is."""
        return topic.rpartition("/")[2]

    @property
    def id(self) -> str:
        """An identifier of the gateway in letters, digits, ``-`` and ``_``."""
        return f"{_NOT_IN_AN_ID.sub('_', self.base)}_{self.name}"


# --- What the publisher is told by the configuration

CLIENT_ID: Final = "pitch-gateway-{}"


@dataclass(frozen=True, slots=True)
class Settings:
    """Where to publish, as whom, and what. The password is not in here: it is read for each connection."""

    topics: Topics
    host: str
    port: int
    version: MqttVersion
    client_id: str
    keepalive_s: int
    interval_s: float
    username: str | None
    password_file: str | None
    tls: TlsSection | None
    folder: Path
    """That the files of :attr:`tls` and :attr:`password_file` are relative to."""
    discovery: str
    """Prefix of Home Assistant's discovery, ``""`` for none."""
    allows_commands: bool
    sensors: tuple[str, ...] = ()
    """Topics that others publish temperatures to."""

    @property
    def broker(self) -> str:
        """The broker's address, for people."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"

    def password(self) -> str | None:
        """Return the password as its file has it now; blocks. Raises NamedFileError."""
        return None if self.password_file is None else read_password(self.password_file, self.folder)

    def tls_context(self) -> ssl.SSLContext | None:
        """Return what TLS needs, None without; blocks. Raises NamedFileError."""
        return None if self.tls is None else tls_context(self.tls, self.folder)


def settings_of(section: MqttSection, name: str, folder: Path, sensors: tuple[str, ...] = ()) -> Settings:
    """Return the settings of the gateway ``name``; the files of the section are relative to ``folder``."""
    return Settings(
        topics=Topics(section.base_topic, name),
        host=section.host,
        port=section.port,
        version=section.version,
        client_id=section.client_id or CLIENT_ID.format(name),
        keepalive_s=section.keepalive_s,
        interval_s=section.interval_s,
        username=section.username,
        password_file=section.password_file,
        tls=section.tls,
        folder=folder,
        discovery=section.discovery,
        allows_commands=section.commands,
        sensors=sensors,
    )


# --- What is published: parts of the status model, each under its topic, as JSON

ONLINE: Final = b"online"
OFFLINE: Final = b"offline"

Payload = Mapping[str, Any]

_encoder: Final = msgspec.json.Encoder(enc_hook=str)


def encode(payload: object) -> bytes:
    """Return a payload as JSON; numbers that JSON does not know are null."""
    return _encoder.encode(payload)


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
