"""What is said on the gateway's socket: one request, one reply, each one line of JSON.

Every message carries the version of this catalogue. A program that speaks another version gets a refusal that
both sides can read: its shape, :class:`Refused`, never changes.
"""

from typing import Any, Final

import msgspec

VERSION: Final = 1
MAX_REQUEST_BYTES: Final = 4096
"""Longer than the names of a hundred axes."""
MAX_REPLY_BYTES: Final = 4_000_000


class WrongMessageError(Exception):
    """Bytes that are no message of this version; the text says what was found and what to do."""


class _Message(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What all messages have."""

    version: int = VERSION


class Ping(_Message, frozen=True, tag="ping", tag_field="kind"):
    """Ask whether a gateway is there, and which."""


class GetStatus(_Message, frozen=True, tag="status", tag_field="kind"):
    """Ask for the whole status."""


class Enable(_Message, frozen=True, tag="enable", tag_field="kind"):
    """Switch the compensation of axes on; no names: of all axes."""

    axes: tuple[str, ...] = ()


class Disable(_Message, frozen=True, tag="disable", tag_field="kind"):
    """Switch the compensation of axes off; no names: of all axes."""

    axes: tuple[str, ...] = ()


class SetReference(_Message, frozen=True, tag="reference", tag_field="kind"):
    """Tell the gateway that an axis stands where its drive says."""

    axis: str


Request = Ping | GetStatus | Enable | Disable | SetReference


class Pong(_Message, frozen=True, tag="pong", tag_field="kind"):
    """The gateway that answers."""

    name: str
    gateway_version: str
    pid: int


class Status(_Message, frozen=True, tag="status", tag_field="kind"):
    """The status model."""

    status: dict[str, Any]


class Done(_Message, frozen=True, tag="done", tag_field="kind"):
    """What a command did. Where there are ``problems``, each names an axis, the reason and what to do."""

    changed: tuple[str, ...] = ()
    """Names of the axes that changed: a group changes as one."""
    problems: tuple[str, ...] = ()


class Refused(_Message, frozen=True, tag="refused", tag_field="kind"):
    """The request was not understood; the gateway closes the connection after it."""

    reason: str


Reply = Pong | Status | Done | Refused


class _AnyVersion(msgspec.Struct):
    """As much of a message as every version has."""

    version: int = 0
    kind: str = ""


_encoder: Final = msgspec.json.Encoder()
_request_decoder: Final = msgspec.json.Decoder(Request)
_reply_decoder: Final = msgspec.json.Decoder(Reply)
_version_decoder: Final = msgspec.json.Decoder(_AnyVersion)


def encode(message: Request | Reply) -> bytes:
    r"""Return a message as one line.

    >>> encode(Enable(axes=("x",)))
    b'{"kind":"enable","axes":["x"],"version":1}\n'
    """
    return _encoder.encode(message) + b"\n"


def decode_request(line: bytes) -> Request:
    """Read a request. Raises WrongMessageError when it is none of this version."""
    _check_version(line)
    try:
        request: Request = _request_decoder.decode(line)
    except msgspec.MsgspecError as error:
        raise WrongMessageError(f"no request of version {VERSION}: {error}") from None
    return request


def decode_reply(line: bytes) -> Reply:
    """Read a reply. Raises WrongMessageError when it is none of this version."""
    _check_version(line)
    try:
        reply: Reply = _reply_decoder.decode(line)
    except msgspec.MsgspecError as error:
        raise WrongMessageError(f"no reply of version {VERSION}: {error}") from None
    return reply


def _check_version(line: bytes) -> None:
    try:
        found = _version_decoder.decode(line)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise WrongMessageError(f"not a message: {error}; send one line of JSON for each message") from None
    # A refusal is understood whatever its version: it says which one the other side speaks.
    if found.version != VERSION and found.kind != "refused":
        raise WrongMessageError(
            f"a message of version {found.version}, but this side speaks version {VERSION}: "
            "command and gateway must be of the same release; restart the gateway after an upgrade"
        )
