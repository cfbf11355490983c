"""What is said on the gateway's socket: one request, one reply, each one line of JSON.

Whoever subscribes is told without asking, from then on. Tables travel beside their message, as descriptors
of sealed memory (SCM_RIGHTS of unix(7)), one for each table and in their order.

Every message carries the version of this catalogue. A program that speaks another version gets a refusal that
both sides can read: its shape, :class:`Refused`, never changes.
"""

from typing import Annotated, Any, Final

import msgspec

VERSION: Final = 2
MAX_REQUEST_BYTES: Final = 4096
"""Longer than the names of a hundred axes."""
MAX_REPLY_BYTES: Final = 4_000_000


MAX_TABLES: Final = 16
"""In one message: the axes of a group are changed together, and nobody has more on one beam."""
SHORTEST_INTERVAL_S: Final = 0.05
LONGEST_INTERVAL_S: Final = 60.0
DEFAULT_INTERVAL_S: Final = 0.2
SELDOM_S: Final = 1.0
"""Between two snapshots that nobody waits for."""


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


class EndDryRun(_Message, frozen=True, tag="end-dry-run", tag_field="kind"):
    """Apply what axes in shadow only showed; their configuration says ``on`` now."""

    axes: tuple[str, ...]


class SetReference(_Message, frozen=True, tag="reference", tag_field="kind"):
    """Tell the gateway that an axis stands where its drive says."""

    axis: str


class Subscribe(_Message, frozen=True, tag="subscribe", tag_field="kind"):
    """Ask to be told: a snapshot every ``interval_s``, and what happens as it happens.

    What happens brings the next snapshot forward. To ask again changes the interval.
    """

    interval_s: Annotated[float, msgspec.Meta(ge=SHORTEST_INTERVAL_S, le=LONGEST_INTERVAL_S)] = (
        DEFAULT_INTERVAL_S
    )


class GetTapes(_Message, frozen=True, tag="tapes", tag_field="kind"):
    """Ask for the tapes of all lines, to look into (``ipc.tape``)."""


class TableFor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table and its axis; its points are in the descriptor that stands at the same place."""

    axis: str
    file: str
    format: str
    sha256: str
    """Of the file that it was read from."""


class SetTable(_Message, frozen=True, tag="set-table", tag_field="kind"):
    """Hand over tables, all of them or none; on record by their digests."""

    tables: Annotated[tuple[TableFor, ...], msgspec.Meta(min_length=1, max_length=MAX_TABLES)]


class ClearTable(_Message, frozen=True, tag="clear-table", tag_field="kind"):
    """Take the tables of axes away, and so their correction; axes of a group lose theirs together."""

    axes: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]


Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class SetGain(_Message, frozen=True, tag="set-gain", tag_field="kind"):
    """Apply another share of the tables, until the gateway is started again; no names: of all axes.

    A command is for the whole group of an axis. What the configuration says (``is_configured``) is for each
    axis alone.
    """

    forward: Share
    backward: Share
    axes: tuple[str, ...] = ()
    is_configured: bool = False


Limit = Annotated[float, msgspec.Meta(ge=0.0)]


class SetLimits(_Message, frozen=True, tag="set-limits", tag_field="kind"):
    """Give an axis other limits, in its units; those of its configuration, as long as the gateway runs."""

    axis: str
    max_correction: Limit
    max_slope: Limit
    travel_margin: Limit
    budget_us: Limit


class SetTemperature(_Message, frozen=True, tag="set-temperature", tag_field="kind"):
    """Tell the temperature of the screw of an axis, in °C, as it is now."""

    axis: str
    celsius: float


Request = (
    Ping
    | GetStatus
    | Enable
    | Disable
    | EndDryRun
    | SetReference
    | Subscribe
    | SetTable
    | ClearTable
    | SetGain
    | SetLimits
    | SetTemperature
    | GetTapes
)


class Pong(_Message, frozen=True, tag="pong", tag_field="kind"):
    """The gateway that answers."""

    name: str
    gateway_version: str
    pid: int
    shape: str = ""
    """Digest of the plan that it runs, without its tables: only tables made for the same are for it."""


class Status(_Message, frozen=True, tag="status", tag_field="kind"):
    """The status model."""

    status: dict[str, Any]


class Tapes(_Message, frozen=True, tag="tapes", tag_field="kind"):
    """The lines whose tapes come with it, as descriptors, one for each and in their order."""

    lines: tuple[str, ...] = ()


class Done(_Message, frozen=True, tag="done", tag_field="kind"):
    """What a command did. Where there are ``problems``, each names an axis, the reason and what to do."""

    changed: tuple[str, ...] = ()
    """Names of the axes that changed: a group changes as one."""
    problems: tuple[str, ...] = ()
    comes: dict[str, str] = {}
    """How the new correction of an axis comes into force: ``next-target``, ``blended``, or ``not-in-force``
    where it waits for a reference or to be enabled."""


class Refused(_Message, frozen=True, tag="refused", tag_field="kind"):
    """The request was not understood; the gateway closes the connection after it."""

    reason: str


class Subscribed(_Message, frozen=True, tag="subscribed", tag_field="kind"):
    """From now on the connection is told."""

    interval_s: float


class Snapshot(_Message, frozen=True, tag="snapshot", tag_field="kind"):
    """The status model as it is now."""

    status: dict[str, Any]
    dropped: int = 0
    """Snapshots and events that were not sent since the last message, because this listener was too slow."""


class Happened(_Message, frozen=True, tag="happened", tag_field="kind"):
    """An event, as it stands in the log."""

    event: str
    severity: str
    fields: dict[str, Any]
    wall_s: float
    """Time of day, in seconds since 1970."""
    dropped: int = 0
    """As in :class:`Snapshot`."""


Reply = Pong | Status | Tapes | Done | Refused | Subscribed | Snapshot | Happened


class _AnyVersion(msgspec.Struct):
    """As much of a message as every version has."""

    version: int = 0
    kind: str = ""


_encoder: Final = msgspec.json.Encoder(enc_hook=str)
_request_decoder: Final = msgspec.json.Decoder(Request)
_reply_decoder: Final = msgspec.json.Decoder(Reply)
_version_decoder: Final = msgspec.json.Decoder(_AnyVersion)


def encode(message: Request | Reply) -> bytes:
    r"""Return a message as one line.

    >>> encode(Enable(axes=("x",)))
    b'{"kind":"enable","axes":["x"],"version":2}\n'
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
