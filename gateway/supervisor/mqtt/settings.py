"""A publisher's settings from the configuration: the broker, and one gateway's topics, ``BASE/NAME/…``."""

import re
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.config.files import read_password, tls_context
from gateway.config.mqtt_model import MqttSection, MqttVersion, TlsSection

CLIENT_ID: Final = "pitch-gateway-{}"
COMMANDS: Final = ("reload", "enable", "disable", "switch", "gain")

_NOT_IN_AN_ID: Final = re.compile(r"[^A-Za-z0-9_-]")


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of the gateway ``name``."""

    base: str
    name: str

    @property
    def root(self) -> str:
        """Prefix of all topics, without a slash at its end."""
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
        """Events, when they happen."""
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
    def journal(self) -> str:
        """The newest entry of the journal of interventions; retained."""
        return f"{self.root}/journal"

    @property
    def commands(self) -> str:
        """Filter of all command topics."""
        return f"{self.root}/command/+"

    def command(self, command: str) -> str:
        """One of ``COMMANDS``."""
        return f"{self.root}/command/{command}"

    def command_in(self, topic: str) -> str:
        """Return the command of a topic that :attr:`commands` matches."""
        return topic.rpartition("/")[2]

    @property
    def id(self) -> str:
        """An identifier of the gateway in letters, digits, ``-`` and ``_``."""
        return f"{_NOT_IN_AN_ID.sub('_', self.base)}_{self.name}"


@dataclass(frozen=True, slots=True)
class Settings:
    """Where, with which credentials and what to publish. The password is read for each connection."""

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
    """Base of the relative paths of :attr:`tls` and :attr:`password_file`."""
    discovery: str
    """Prefix of Home Assistant's discovery, ``""`` for none."""
    allows_commands: bool
    sensors: tuple[str, ...] = ()
    """Topics with temperatures from other clients."""

    @property
    def broker(self) -> str:
        """The broker's address, for display."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"

    def password(self) -> str | None:
        """Return the password in its file; blocks. Raises NamedFileError."""
        return None if self.password_file is None else read_password(self.password_file, self.folder)

    def tls_context(self) -> ssl.SSLContext | None:
        """Return the TLS context, None without TLS; blocks. Raises NamedFileError."""
        return None if self.tls is None else tls_context(self.tls, self.folder)


def settings_of(section: MqttSection, name: str, folder: Path, sensors: tuple[str, ...] = ()) -> Settings:
    """Return the settings of the gateway ``name``; relative file paths start at ``folder``."""
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
