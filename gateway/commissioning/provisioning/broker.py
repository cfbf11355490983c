"""Users and access list of a mosquitto broker: a line and a block for each gateway, among those of others."""

import hashlib
import re
import secrets
from base64 import b64decode, b64encode
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Final

from gateway.config.sections import Sections
from gateway.supervisor.mqtt.settings import Topics

ITERATIONS: Final = 101
"""Those of mosquitto_passwd: a password of 256 random bits needs no more."""
SALT_BYTES: Final = 12
_HASH: Final = re.compile(r"\$7\$(\d{1,7})\$([A-Za-z0-9+/=]+)\$([A-Za-z0-9+/=]+)")
"""PBKDF2 with SHA-512: mosquitto 2.0, mosquitto_passwd(1)."""
_BEFORE_USER: Final = re.compile(r"^(?=user[ \t])", re.MULTILINE)
ACCESS_HEAD: Final = """\
# Access list of mosquitto: each gateway keeps to its own topics. Add blocks for other users: they stay.
"""


USER_RULE: Final = (
    "allowed: visible characters without a colon, no # and no space at the beginning, no space at the end"
)


def is_user(name: str) -> bool:
    r"""Whether the files of mosquitto can have a user of this name.

    >>> [is_user(name) for name in ("mill-1", "Säge 1", "a:b", "#1", " a", "a\nuser b")]
    [True, True, False, False, False, False]
    """
    return name.isprintable() and name == name.strip() and ":" not in name and not name.startswith("#")


def password_line(user: str, password: str, before: str = "") -> str:
    """Return the line of a password file; ``before`` is the one that is there, and is kept if it is right."""
    old = _HASH.fullmatch(before.removeprefix(f"{user}:"))
    with suppress(ValueError):  # a salt or a number that was damaged
        if old is not None and _line(user, password, b64decode(old[2]), int(old[1])) == before:
            return before
    return _line(user, password, secrets.token_bytes(SALT_BYTES), ITERATIONS)


def _line(user: str, password: str, salt: bytes, iterations: int) -> str:
    digest = hashlib.pbkdf2_hmac("sha512", password.encode(), salt, iterations)
    return f"{user}:$7${iterations}${b64encode(salt).decode()}${b64encode(digest).decode()}"


def access_block(name: str, sections: Sections) -> str:
    """Return the block of a gateway in the access list, from its configuration, which has ``[mqtt]``."""
    mqtt = sections.mqtt
    assert mqtt is not None, "only a gateway that publishes has a block"
    topics = Topics(mqtt.base_topic, name)
    lines = [
        f"user {mqtt.username}",
        *(
            f"topic write {topic}"
            for topic in (
                topics.availability,
                topics.info,
                topics.journal,
                topics.event,
                topics.line("+"),
                topics.axis("#"),
            )
        ),
    ]
    if mqtt.discovery:
        lines.append(f"topic write {mqtt.discovery}/device/{topics.id}/+/config")
    if mqtt.commands:
        lines.append(f"topic read {topics.commands}")
    sources = [axis.thermal.source.mqtt for axis in sections.axes.values() if axis.thermal is not None]
    lines += dict.fromkeys(f"topic read {topic}" for topic in sources if topic is not None)
    return "\n".join((*lines, ""))


Choose = Callable[[str, str | None, str], str]
"""Returns which text a user gets: of the user, the text that is there, and the new one."""


def with_passwords(file: str, passwords: Mapping[str, str], choose: Choose) -> str:
    """Return a password file with a line for each user; other lines stay."""
    lines = file.splitlines()
    places = {line.partition(":")[0]: place for place, line in reversed(list(enumerate(lines)))}
    for user, password in passwords.items():
        if (place := places.get(user)) is None:
            lines.append(choose(user, None, password_line(user, password)))
        else:
            before = lines[place]
            lines[place] = choose(user, before, password_line(user, password, before))
    return "".join(f"{line}\n" for line in lines)


def with_blocks(file: str, blocks: Mapping[str, str], choose: Choose) -> str:
    """Return an access list with a block for each user; everything else stays."""
    missing, texts = dict(blocks), []
    for user, text in _parts(file or ACCESS_HEAD):
        block = missing.pop(user, None)
        texts.append(text if block is None else choose(user, text, block))
    for user, block in missing.items():
        texts += ["\n" if texts[-1].strip() else "", choose(user, None, block)]
    return "".join(texts)


def _parts(file: str) -> Iterator[tuple[str, str]]:
    """Yield the block of each user, and as one of "" what is between them: comments and empty lines."""
    first, *users = _BEFORE_USER.split(file)
    yield "", first
    for part in users:
        lines = part.splitlines(keepends=True)
        end = max(n for n, line in enumerate(lines, start=1) if line.strip() and not line.startswith("#"))
        yield lines[0].removeprefix("user").strip(), "".join(lines[:end])
        yield "", "".join(lines[end:])
