"""What a recording holds: everything that crosses the border of a line's exchange, in order; JSON lines.

A header comes first, an end last; a file without an end was cut off. In between stand inputs, each with its
monotonic time in nanoseconds, and behind each input the outputs that it caused. Bytes are hexadecimal.
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
"""Format of a capture: it begins anywhere, and is replayed from the first beginning of each line on."""
WITHOUT_PEERS: Final = 1
"""Format of recordings that do not tell hosts apart: they were made before an axis had one writer."""


Hex = Annotated[str, msgspec.Meta(pattern="^([0-9a-fA-F]{2})*$")]


class WrongEntryError(Exception):
    """A line that is no entry of a recording; the text says what is wrong with it."""


class _Entry(msgspec.Struct, frozen=True, tag_field="kind"):
    """What all entries have."""


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
    """Further files that the configuration names, by the name that it gives them."""


class _Input(_Entry, frozen=True):
    """Something that happened to a line at ``t`` ns."""

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
    """In the certificate of the controller; empty without TLS."""
    given_up: str = ""
    """Why its controller waits for it no more; empty while it does."""


class Gone(_Input, frozen=True, tag="gone", omit_defaults=True):
    """A controller's connection or port was lost."""

    port: int
    is_broken: bool = False
    """Its controller had not closed it."""


class Reply(_Input, frozen=True, tag="reply"):
    """A reply of a drive."""

    unit: int
    pdu: Hex


class Stray(_Input, frozen=True, tag="stray"):
    """Bytes from the drives that answer nothing."""

    is_frame: bool
    unit: int = -1
    """Of the whole frame that they are; recordings of older releases do not say it."""


class RestFirst(_Input, frozen=True, tag="rest-first"):
    """The gateway before left something unanswered: the line falls silent when it comes up."""


class Up(_Input, frozen=True, tag="up"):
    """The drives can be reached."""


class Down(_Input, frozen=True, tag="down", omit_defaults=True):
    """The drives cannot be reached."""

    reason: str = ""
    is_orderly: bool = False
    """The other end closed the connection, and nothing broke."""


class Unframed(_Input, frozen=True, tag="unframed"):
    """Bytes came of the drives, of which no frame was made yet."""


class Tick(_Input, frozen=True, tag="tick"):
    """A deadline passed."""


class Stop(_Input, frozen=True, tag="stop"):
    """The gateway stops."""


class Commanded(_Input, frozen=True, tag="command", omit_defaults=True):
    """A command that reached the line, with the tables that it handed over in their compiled form."""

    command: Command
    tables: tuple[bytes, ...] = ()


# --- commands as releases up to 1.0.0 recorded them


class _OldControl(_Input, frozen=True, tag="control"):
    """A person's command: ``enable``, ``disable``, ``end-dry-run``, ``reference`` or ``clear-table``."""

    command: str
    axis: str


class _OldTable(msgspec.Struct, frozen=True):
    """A table as it was handed over; ``data`` is its compiled form."""

    axis: str
    file: str
    format: str
    sha256: str
    data: bytes


class _OldTables(_Input, frozen=True, tag="tables"):
    """Tables that were handed over together."""

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
    """Return an entry as it is recorded now: one command for one axis. Raises WrongEntryError."""
    match entry:
        case Commanded(command=SetTable(tables=tables)):
            if len(tables) != len(entry.tables):
                found = f"{len(tables)} tables and holds {len(entry.tables)}"
                raise WrongEntryError(f"no entry of a recording: set-table names {found}")
            return entry
        case Commanded(command=command):
            if (count := len(axes_of(command))) != 1:
                what = f"{kind_of(command)} names {count} axes; each has an entry of its own"
                raise WrongEntryError(f"no entry of a recording: {what}")
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
            raise WrongEntryError(f"the command {name!r} is not known; replay it with a newer release")
    return Commanded(entry.line, entry.t, command)


_OLD_NAMES: Final = {
    "enable": Enable,
    "disable": Disable,
    "end-dry-run": EndDryRun,
    "clear-table": ClearTable,
}


class AxisAt(msgspec.Struct, frozen=True):
    """What has to be known of an axis to go on with it, as after a restart."""

    axis: str
    record: bytes = b""
    """Its record as ``exchange.axis.record_layout`` has it, compressed (zlib); empty: none is kept."""
    actual: float | None = None
    """Counts that its drive said last."""
    is_referenced: bool = False
    reference_seen_ns: int = 0
    """When the bit that tells so was seen last; 0: never."""


class Beginning(_Input, frozen=True, tag="beginning"):
    """The line was idle, and this is what holds: a replay may begin here. The rest is as after a restart."""

    axes: tuple[AxisAt, ...]
    is_up: bool
    boot: bytes = b""
    """Which boot of the machine its times are of, as the records have it."""
    controls: tuple["Commanded | _Old", ...] = ()
    """What somebody outside has changed since the start, as far as it is still in force."""
    up_ns: int = 0
    """When the link to the drives came up last."""
    closes_soon: bool = False
    """Its server may close it behind an answer, or did so the last time (``exchange.link_state``)."""
    has_closed_soon: bool = False


class Port(_Entry, frozen=True, tag="port", omit_defaults=True):
    """Who a connection is."""

    line: str
    port: int
    controller: str
    peer: str = ""
    role: str = ""


class Sent(_Entry, frozen=True, tag="sent"):
    """What went to the drives."""

    line: str
    unit: int
    pdu: Hex


class Abandoned(_Entry, frozen=True, tag="abandoned"):
    """The reply is not expected any more."""

    line: str


class Answered(_Entry, frozen=True, tag="answered"):
    """What went to a controller."""

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
Output = Sent | Abandoned | Answered
Entry = Header | Input | Output | Port | End


def kind_of(struct: Entry | Command) -> str:
    """Return by what name an entry or a command is recorded.

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
        raise WrongEntryError(f"no entry of a recording: {error}") from None
    return as_command(entry) if isinstance(entry, _Old | Commanded) else entry
