"""What the publisher is told by the configuration."""

import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.config.files import read_password, tls_context
from gateway.config.mqtt_model import MqttSection, MqttVersion, TlsSection
from gateway.supervisor.mqtt.topics import Topics

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
