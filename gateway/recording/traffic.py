"""The content of a recording: everything that crosses the border of a line's exchange, in order; JSON lines.

It has a header at the beginning and an end entry; without an end entry it was truncated. Between them are the
inputs, each with its monotonic time in nanoseconds, and after each input its outputs. Bytes are hexadecimal.
"""

from typing import Annotated, Final

import msgspec

from gateway.exchange.commands import (
    ClearTable,
    Command,
    Disable,
    Enable,
    EndDryRun,
    SetGain,
    SetLimits,
    SetReference,
    SetTable,
    SetTemperature,
    TableFor,
    axes_of,
)

FORMAT: Final = 2
CAPTURED: Final = 3
"""Format of a capture: it begins anywhere, and its replay starts at the first beginning of each line."""
WITHOUT_PEERS: Final = 1
"""Format of recordings without hosts: they were made before an axis had one writer."""


Hex = Annotated[str, msgspec.Meta(pattern="^([0-9a-fA-F]{2})*$")]


class WrongEntryError(Exception):
    """A line that is no entry of a recording; the text says what is wrong with it."""


class _Entry(msgspec.Struct, frozen=True, tag_field="kind"):
    """The base of all entries."""


class Header(_Entry, frozen=True, tag="header"):
    """What is needed to run the same exchange again."""

    format: int
    gateway_version: str
    started: str
    """Date and time of day, ISO 8601."""
    config_name: str
    config: str
    tables: dict[str, str] = {}
    """Table files of the tables folder by name, each byte a character (ISO 8859-1)."""
    files: dict[str, str] = {}
    """Further files that the configuration names, by these names."""


class _Input(_Entry, frozen=True):
    """An event of a line at ``t`` ns."""

    line: str
    t: int


class Request(_Input, frozen=True, tag="request", omit_defaults=True):
    """A whole request of a controller. ``port`` numbers connections, ``controller`` is its name."""

    port: int
    controller: str
    transaction: int
    unit: int
    pdu: Hex
    peer: str = ""
    """Host of the controller; empty on a serial port."""
    role: str = ""
    """Role in the certificate of the controller; empty without TLS."""
    given_up: str = ""
    """Why its controller has given up on it; empty if it has not."""


class Gone(_Input, frozen=True, tag="gone", omit_defaults=True):
    """A controller's connection or port was lost."""

    port: int
    is_broken: bool = False
    """Whether it broke: its controller had not closed it."""


class Reply(_Input, frozen=True, tag="reply"):
    """A reply of a drive."""

    unit: int
    pdu: Hex


class Stray(_Input, frozen=True, tag="stray"):
    """Bytes from the drives that belong to no request."""

    is_frame: bool
    unit: int = -1
    """Unit id, if they are a whole frame; recordings of older releases do not have it."""


class RestFirst(_Input, frozen=True, tag="rest-first"):
    """The drives may still answer a request of the previous run: the line begins with a silence."""


class Up(_Input, frozen=True, tag="up"):
    """The drives can be reached."""


class Down(_Input, frozen=True, tag="down", omit_defaults=True):
    """The drives cannot be reached."""

    reason: str = ""
    is_orderly: bool = False
    """Whether the other end closed the connection, and nothing broke."""


class Unframed(_Input, frozen=True, tag="unframed"):
    """Bytes came from the drives that are no whole frame yet."""


class Tick(_Input, frozen=True, tag="tick"):
    """A deadline passed."""


class Stop(_Input, frozen=True, tag="stop"):
    """The gateway stops."""


class Commanded(_Input, frozen=True, tag="command", omit_defaults=True):
    """A command that reached the line, with its tables in their compiled form."""

    command: Command
    tables: tuple[bytes, ...] = ()


# --- commands as releases up to 1.0.0 recorded them


class _OldControl(_Input, frozen=True, tag="control"):
    """A user's command: ``enable``, ``disable``, ``end-dry-run``, ``reference`` or ``clear-table``."""

    command: str
    axis: str


class _OldTable(msgspec.Struct, frozen=True):
    """A table of a command; ``data`` is its compiled form."""

    axis: str
    file: str
    format: str
    sha256: str
    data: bytes


class _OldTables(_Input, frozen=True, tag="tables"):
    """Tables of one command."""

    tables: tuple[_OldTable, ...]


class _OldGain(_Input, frozen=True, tag="gain"):
    """Another gain for an axis and its group, or for the axis alone."""

    axis: str
    forward: float
    backward: float
    is_alone: bool = False


class _OldLimits(_Input, frozen=True, tag="limits"):
    """Other limits for an axis, in its units."""

    axis: str
    max_correction: float
    max_slope: float
    travel_margin: float
    budget_us: float


class _OldTemperature(_Input, frozen=True, tag="temperature"):
    """The temperature of the screw of an axis, in °C."""

    axis: str
    celsius: float


_Old = _OldControl | _OldTables | _OldGain | _OldLimits | _OldTemperature


def as_command(entry: "Commanded | _Old") -> Commanded:
    """Return an entry in the present format: one command for one axis. Raises WrongEntryError."""
    match entry:
        case Commanded(command=SetTable(tables=tables)):
            if len(tables) != len(entry.tables):
                found = f"{len(tables)} tables and holds {len(entry.tables)}"
                raise WrongEntryError(f"not an entry of a recording: set-table names {found}")
            return entry
        case Commanded(command=command):
            if (count := len(axes_of(command))) != 1:
                what = f"{kind_of(command)} names {count} axes; each must have its own entry"
                raise WrongEntryError(f"not an entry of a recording: {what}")
            return entry
        case _OldTables(tables=tables):
            named = tuple(TableFor(each.axis, each.file, each.format, each.sha256) for each in tables)
            data = tuple(each.data for each in tables)
            return Commanded(entry.line, entry.t, SetTable(tables=named), data)
        case _OldGain(axis=axis, forward=forward, backward=backward):
            command = SetGain(axes=(axis,), forward=forward, backward=backward, is_configured=entry.is_alone)
        case _OldLimits(axis=axis):
            command = SetLimits(
                axis=axis,
                max_correction=entry.max_correction,
                max_slope=entry.max_slope,
                travel_margin=entry.travel_margin,
                budget_us=entry.budget_us,
            )
        case _OldTemperature(axis=axis, celsius=celsius):
            command = SetTemperature(axis=axis, celsius=celsius)
        case _OldControl(command="reference", axis=axis):
            command = SetReference(axis=axis)
        case _OldControl(command=name, axis=axis) if name in _OLD_NAMES:
            command = _OLD_NAMES[name](axes=(axis,))
        case _OldControl(command=name):
            raise WrongEntryError(f"the command {name!r} is unknown; replay it with a newer release")
    return Commanded(entry.line, entry.t, command)


_OLD_NAMES: Final = {
    "enable": Enable,
    "disable": Disable,
    "end-dry-run": EndDryRun,
    "clear-table": ClearTable,
}


class AxisAt(msgspec.Struct, frozen=True):
    """The state of an axis that a replay needs to continue, as after a restart."""

    axis: str
    record: bytes = b""
    """Its record as in ``exchange.axis.record_layout``, compressed (zlib); empty: it has none."""
    actual: float | None = None
    """Counts that its drive last reported."""
    is_referenced: bool = False
    reference_seen_ns: int = 0
    """When the reference bit was last read; 0: never."""


class Beginning(_Input, frozen=True, tag="beginning"):
    """The line was idle, and this is its state: a replay may begin here. The rest is as after a restart."""

    axes: tuple[AxisAt, ...]
    is_up: bool
    boot: bytes = b""
    """The boot id of its times, as in the records."""
    controls: tuple["Commanded | _Old", ...] = ()
    """Commands since the start that are still in force."""
    up_ns: int = 0
    """When the link to the drives last came up."""
    closes_soon: bool = False
    """The drives' server may close it after a reply, or did so the last time (``exchange.link_state``)."""
    has_closed_soon: bool = False


class Port(_Entry, frozen=True, tag="port", omit_defaults=True):
    """The controller of a connection."""

    line: str
    port: int
    controller: str
    peer: str = ""
    role: str = ""


class Sent(_Entry, frozen=True, tag="sent"):
    """A frame sent to the drives."""

    line: str
    unit: int
    pdu: Hex


class Abandoned(_Entry, frozen=True, tag="abandoned"):
    """The gateway does not expect the reply any more."""

    line: str


class Paced(_Entry, frozen=True, tag="paced"):
    """What waits is not sent before ``until`` ns: the wire needs a silence. Not in older recordings."""

    line: str
    until: int


class Answered(_Entry, frozen=True, tag="answered"):
    """A frame sent to a controller."""

    line: str
    port: int
    transaction: int
    unit: int
    pdu: Hex


class End(_Entry, frozen=True, tag="end"):
    """The recording ended in order."""

    entries: int


Input = (
    Request | Gone | Reply | Stray | RestFirst | Up | Down | Unframed | Tick | Stop | Beginning | Commanded
)
Output = Sent | Abandoned | Answered | Paced
Entry = Header | Input | Output | Port | End


def kind_of(struct: Entry | Command) -> str:
    """Return the name under which an entry or a command is recorded.

    >>> kind_of(RestFirst("xyz", 7)), kind_of(Enable())
    ('rest-first', 'enable')
    """
    return str(struct.__struct_config__.tag)


_encoder: Final = msgspec.json.Encoder()
_decoder: Final = msgspec.json.Decoder(Entry | _Old)


def encode(entry: Entry) -> bytes:
    r"""Return an entry as one line.

    >>> encode(Sent("xyz", 1, "0300640002"))
    b'{"kind":"sent","line":"xyz","unit":1,"pdu":"0300640002"}\n'
    """
    return _encoder.encode(entry) + b"\n"


def decode(line: bytes) -> Entry:
    """Read one line. Raises WrongEntryError."""
    try:
        entry: Entry | _Old = _decoder.decode(line)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise WrongEntryError(f"not an entry of a recording: {error}") from None
    return as_command(entry) if isinstance(entry, _Old | Commanded) else entry
