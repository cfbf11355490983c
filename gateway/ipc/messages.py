"""The messages of the gateway's socket: one request, one reply, each one line of JSON.

After a subscription the gateway sends without further requests. Tables travel with their message as
descriptors of sealed memory (SCM_RIGHTS of unix(7)), one for each table and in their order.

Every message has the version of these definitions. A program with another version gets a refusal that both
sides can read: the format of :class:`Refused` never changes.
"""

from typing import Annotated, Any, Final

import msgspec

from gateway.exchange.commands import VERSION, Command, Message
from gateway.status.model import RelayModel

MAX_REQUEST_BYTES: Final = 4096
"""Longer than the names of a hundred axes."""
MAX_REPLY_BYTES: Final = 4_000_000


SHORTEST_INTERVAL_S: Final = 0.05
LONGEST_INTERVAL_S: Final = 60.0
DEFAULT_INTERVAL_S: Final = 0.2
SELDOM_S: Final = 1.0
"""Interval of snapshots without a waiting reader."""


class WrongMessageError(Exception):
    """Bytes that are no message of this version; the text has what was found and the remedy."""


class Ping(Message, frozen=True, tag="ping", tag_field="kind"):
    """Ask whether a gateway is there, and which."""


class GetStatus(Message, frozen=True, tag="status", tag_field="kind"):
    """Ask for the whole status."""


class Subscribe(Message, frozen=True, tag="subscribe", tag_field="kind"):
    """Subscribe: a snapshot every ``interval_s``, and each event when it happens.

    An event brings the next snapshot forward. Another request changes the interval.
    """

    interval_s: Annotated[float, msgspec.Meta(ge=SHORTEST_INTERVAL_S, le=LONGEST_INTERVAL_S)] = (
        DEFAULT_INTERVAL_S
    )


class GetTapes(Message, frozen=True, tag="tapes", tag_field="kind"):
    """Ask for the trace buffers of all lines, for reading (``recording.trace_buffer``)."""


Request = Command | Ping | GetStatus | Subscribe | GetTapes


class Pong(Message, frozen=True, tag="pong", tag_field="kind"):
    """The gateway that answers."""

    name: str
    gateway_version: str
    pid: int
    shape: str = ""
    """Digest of its plan without the tables: it accepts only tables made for the same digest."""


class Status(Message, frozen=True, tag="status", tag_field="kind"):
    """The status model."""

    status: RelayModel


class Tapes(Message, frozen=True, tag="tapes", tag_field="kind"):
    """The lines whose trace buffers come with it, as descriptors, one for each and in their order."""

    lines: tuple[str, ...] = ()


class Done(Message, frozen=True, tag="done", tag_field="kind"):
    """The result of a command. Each of the ``problems`` names an axis, the reason and the remedy."""

    changed: tuple[str, ...] = ()
    """Names of the axes that changed: a group changes as one."""
    problems: tuple[str, ...] = ()
    comes: dict[str, str] = msgspec.field(default_factory=dict)
    """How the new correction of an axis comes into force: ``next-target``, ``blended``, or ``not-in-force``
    while it waits for a reference or to be enabled."""


class Refused(Message, frozen=True, tag="refused", tag_field="kind"):
    """The request was not understood; the gateway closes the connection after it."""

    reason: str


class Subscribed(Message, frozen=True, tag="subscribed", tag_field="kind"):
    """From now on the connection gets snapshots and events."""

    interval_s: float


class Snapshot(Message, frozen=True, tag="snapshot", tag_field="kind"):
    """The current status model."""

    status: RelayModel
    dropped: int = 0
    """Snapshots and events that were dropped since the last message, because this subscriber was too slow."""


class Happened(Message, frozen=True, tag="happened", tag_field="kind"):
    """An event, as in the log."""

    event: str
    severity: str
    fields: dict[str, Any]
    wall_s: float
    """Time of day, in seconds since 1970."""
    dropped: int = 0
    """As in :class:`Snapshot`."""


Reply = Pong | Status | Tapes | Done | Refused | Subscribed | Snapshot | Happened


class _AnyVersion(msgspec.Struct):
    """The part of a message that every version has."""

    version: int = 0
    kind: str = ""


_encoder: Final = msgspec.json.Encoder(enc_hook=str)
_request_decoder: Final = msgspec.json.Decoder(Request)
_reply_decoder: Final = msgspec.json.Decoder(Reply)
_version_decoder: Final = msgspec.json.Decoder(_AnyVersion)


def encode(message: Request | Reply) -> bytes:
    r"""Return a message as one line.

    >>> encode(Subscribe(interval_s=1.0))
    b'{"kind":"subscribe","interval_s":1.0,"version":2}\n'
    """
    return _encoder.encode(message) + b"\n"


def decode_request(line: bytes) -> Request:
    """Read a request. Raises WrongMessageError if it is none of this version."""
    _check_version(line)
    try:
        request: Request = _request_decoder.decode(line)
    except msgspec.MsgspecError as error:
        raise WrongMessageError(f"not a request of version {VERSION}: {error}") from None
    return request


def decode_reply(line: bytes) -> Reply:
    """Read a reply. Raises WrongMessageError if it is none of this version."""
    _check_version(line)
    try:
        reply: Reply = _reply_decoder.decode(line)
    except msgspec.MsgspecError as error:
        raise WrongMessageError(f"not a reply of version {VERSION}: {error}") from None
    return reply


def _check_version(line: bytes) -> None:
    try:
        found = _version_decoder.decode(line)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise WrongMessageError(f"not a message: {error}; send one line of JSON for each message") from None
    # A refusal is accepted in any version: it says which version the other side uses.
    if found.version != VERSION and found.kind != "refused":
        raise WrongMessageError(
            f"a message of version {found.version}, but this side speaks version {VERSION}: "
            "command and gateway must be of the same release; restart the gateway after an upgrade"
        )
