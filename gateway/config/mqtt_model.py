"""``[mqtt]``."""

import re
from enum import Enum
from typing import Annotated, Final

from pydantic import BeforeValidator, Field

from gateway.config.values import FileName, read_host
from gateway.drives.strict import ByName, Secret, StrictModel, documented

LONGEST_TOPIC: Final = 200
"""Characters of ``base_topic``: with names appended, a topic stays far below MQTT's 65535 bytes."""

TOPIC_RULE: Final = (
    'allowed: levels between slashes, as in "plant/hall-2"; no + # or control characters, no empty level, '
    f"no $ in front, at most {LONGEST_TOPIC} characters"
)
_TOPIC: Final = re.compile(r"(?!\$)[^/+#\x00-\x1f\x7f-\x9f]+(/[^/+#\x00-\x1f\x7f-\x9f]+)*")
_CLIENT_ID: Final = re.compile(r"[^\x00-\x1f\x7f-\x9f]{1,128}")


def read_topic(raw: object) -> str:
    """Read the prefix of topics.

    Raises:
        ValueError: it is not valid in a topic name (MQTT 5.0, 4.7); the text says what is allowed.
    """
    if not isinstance(raw, str) or len(raw) > LONGEST_TOPIC or not _TOPIC.fullmatch(raw):
        raise ValueError(TOPIC_RULE)
    try:
        raw.encode()
    except UnicodeEncodeError:
        raise ValueError(TOPIC_RULE) from None
    return raw


def read_prefix(raw: object) -> str:
    """Read the prefix of discovery, ``""`` for none. Raises ValueError like :func:`read_topic`."""
    return "" if raw == "" else read_topic(raw)


def read_client_id(raw: object) -> str:
    """Read a client id, ``""`` for the default. Raises ValueError with what is allowed."""
    if raw == "":
        return ""
    if not isinstance(raw, str) or not _CLIENT_ID.fullmatch(raw):
        raise ValueError("allowed: 1 to 128 characters, no control characters")
    return raw


class MqttVersion(Enum):
    """MQTT version."""

    V311 = "3.1.1"
    V5 = "5"


class TlsSection(StrictModel):
    """Certificates of the broker and of the gateway."""

    ca: FileName | None = Field(
        default=None,
        description="file with the certificates of the authorities that may have signed the broker's, "
        "relative to the configuration file; left out: those of the system",
    )
    cert: FileName | None = Field(default=None, description="file with the gateway's own certificate")
    key: Secret[FileName | None] = Field(default=None, description="file with the key of that certificate")


class MqttSection(StrictModel):
    """The broker for the status."""

    host: Annotated[str, BeforeValidator(read_host)] = Field(
        default="127.0.0.1",
        description="the broker, without its port",
        json_schema_extra=documented(text="name or address of the broker, without its `port`", kind="text"),
    )
    port: Annotated[int, Field(ge=1, le=65535)] = Field(
        default=1883,
        description="the broker's port",
        json_schema_extra=documented(more="Brokers have TLS at 8883 as a rule"),
    )
    base_topic: Annotated[str, BeforeValidator(read_topic)] = Field(
        default="pitch-gateway",
        description="what every topic begins with",
        json_schema_extra=documented(
            text=(
                "start of every topic, followed by the gateway's name. Levels between slashes; refused: "
                "`+`, `#`, control characters, an empty level, a leading `$`"
            ),
            kind="topic",
        ),
    )
    interval_s: Annotated[float, Field(ge=0.05, le=3600.0)] = Field(
        default=0.5, description="seconds between two messages of an axis"
    )
    version: ByName[MqttVersion] = Field(
        default=MqttVersion.V311,
        description="of MQTT, as it is spoken with the broker",
        json_schema_extra=documented(
            text=(
                "every broker supports 3.1.1. Version 5 gives exact reasons for refusals, and lets "
                "senders of commands choose the answer topic"
            )
        ),
    )
    client_id: Annotated[str, BeforeValidator(read_client_id)] = Field(
        default="",
        description='what the gateway calls itself at the broker, "" for pitch-gateway-NAME',
        json_schema_extra=documented(
            text=("name of the gateway as a client; a broker accepts each name once"),
            default='`"pitch-gateway-NAME"`',
        ),
    )
    keepalive_s: Annotated[int, Field(ge=5, le=3600)] = Field(
        default=15,
        description="silence after which the broker and the gateway ask whether the other is there",
        json_schema_extra=documented(
            text=("after one and a half times this without a message the broker considers the gateway dead")
        ),
    )
    username: Annotated[str, Field(min_length=1, pattern=r"^[^\x00]*$")] | None = Field(
        default=None,
        description="who the gateway is for the broker",
        json_schema_extra=documented(
            default="none",
            text=("user name at the broker. Warned of: without `tls`, to another machine"),
        ),
    )
    password_file: Secret[FileName | None] = Field(
        default=None,
        description="file that holds the password and nothing else, relative to the configuration file, or "
        "credential:NAME",
        json_schema_extra=documented(
            text=(
                "file with only the password on one line, relative to this file; or `credential:NAME`. "
                "Read again for each connection. Needs `username`"
            ),
            default="none",
        ),
    )
    tls: TlsSection | None = Field(
        default=None,
        description="encrypt, and check who the broker is",
        json_schema_extra=documented(
            text=(
                '`{}` trusts the system\'s authorities; `{ ca = "ca.pem" }` those in a file. With '
                "`cert` and `key`, both PEM, the key unencrypted, the gateway has a client certificate. "
                "Paths relative to this file, or `credential:NAME`"
            ),
            default="none: no TLS",
        ),
    )
    discovery: Annotated[str, BeforeValidator(read_prefix)] = Field(
        default="",
        description='topic prefix of Home Assistant\'s discovery, "homeassistant" there; "" for none',
        json_schema_extra=documented(
            text=('prefix of Home Assistant\'s discovery, usually `"homeassistant"`'),
            kind='topic or `""`',
            default='`""`: off',
        ),
    )
    commands: bool = Field(
        default=False,
        description="whether the broker's clients may reload, enable, disable and set gains; nothing "
        "that they can say moves an axis",
        json_schema_extra=documented(
            text=(
                "clients that may write to `BASE/NAME/command/…` may reload, enable, disable and set "
                "gains. No command moves an axis"
            )
        ),
    )
