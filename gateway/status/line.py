"""A line: its counters, its unit ids, its drives and its controllers."""

from collections.abc import Mapping
from typing import Annotated, Final

from msgspec import UNSET, Struct, UnsetType, field

from gateway.status.counters import Counter, counters_of
from gateway.status.times import NOT_WORKED_OUT, NOTHING_MEASURED, Figures, GatewayTimes

_LONGER: Final = (
    "raise `response_timeout_ms` until the drive answers in time; with the gateway stopped "
    "`pitch-gateway probe CONFIG --timing` then measures how much it needs"
)
_CABLE: Final = "check cable, screen, termination and baud rate"


class UnitStatus(Struct, kw_only=True):
    """How the drive of one unit id answers; ages in s."""

    answered_s: float | None = None
    silent_s: float | None = None
    """None: it answers, or nobody has asked it."""
    timeouts_in_a_row: Annotated[
        int,
        Counter(
            "time-outs in a row",
            "requests that a unit id has left unanswered since its last answer",
            "look at the drive: power, cable, unit id",
        ),
    ] = 0
    tried_again_s: float | None = None
    damaged: int = 0
    damaged_in_a_row: Annotated[
        int,
        Counter(
            "damaged in a row",
            "of the newest 32 requests that a unit id left unanswered in a row those that met with bytes "
            "that are no frame: it speaks, and is not understood",
            "compare baud rate and parity, then exchange A and B",
        ),
    ] = 0
    damaged_minute: Annotated[
        int,
        Counter(
            "damaged in the last minute",
            "requests to a unit id within the last minute that met with bytes that are no frame",
            "check cable, screen and termination",
        ),
    ] = 0
    other_ids_in_a_row: Annotated[
        int,
        Counter(
            "other transaction ids in a row",
            "of the newest 32 requests that a unit id left unanswered in a row those that met with a reply "
            "of another transaction id: it answers, and no reply of it counts",
            "bring its firmware up to date, or put a converter in its place that returns the transaction id",
        ),
    ] = 0
    answers_with: str | None = None


class UnitIds(Struct, kw_only=True):
    """Whom controllers talk to, and who answers."""

    axes: dict[str, int] = {}
    heard: list[int] = []
    strangers: list[int] = []
    """Of those that were heard the ones that nobody knows."""
    requests: dict[str, int] = {}
    """To each of these."""
    asked_by: dict[str, list[int]] = {}
    """By controller."""
    drives: dict[str, UnitStatus] = {}
    """By unit id."""


class Forwarded(Struct, kw_only=True):
    """What became of the requests, or of the replies, of a line with ``cut_through``."""

    cut_through: Annotated[
        int,
        Counter(
            "cut through",
            "of a line with `cut_through` the requests and replies that left while they arrived",
        ),
    ] = 0
    gain_us: int | None = None
    stored: Annotated[
        dict[str, int],
        Counter(
            "stored",
            "of a line with `cut_through` those that were stored whole before they left, and why: `kept` for "
            "what is never cut through, or was whole too soon, else what happened before the first byte left",
            "compare with `pitch-gateway budget CONFIG`; `cut-through-off` in the log names the adapter",
        ),
    ] = {}
    spoilt: Annotated[
        dict[str, int],
        Counter(
            "spoilt",
            "of a line with `cut_through` those that began to leave and were made no frame, and why",
            "where many are `stalled` or `unfit`, turn `cut_through` off for the line; where `bad`, check "
            "cables",
        ),
    ] = {}


class CutThroughStatus(Struct, kw_only=True):
    """What a line with ``cut_through`` made of its frames."""

    requests: Forwarded
    replies: Forwarded
    torn: Annotated[
        int,
        Counter(
            "torn",
            "of a line with `cut_through` the frames inside of which its transmitter was empty",
            "`fifo` and `cpus` of `[relay]` put the gateway first; else turn `cut_through` off for the line",
        ),
    ] = 0


class LineMinute(Struct, frozen=True, kw_only=True):
    """Frames of the last minute."""

    exchanges: int = 0
    damaged: int = 0
    malformed: int = 0


class Computed(Struct, kw_only=True):
    """What arithmetic says of a controller."""

    exchange_ms: float = 0.0
    round_ms: float = 0.0
    timeout_ms: float = 0.0


class Rs485(Struct, frozen=True):
    """How the kernel's driver switches the direction of an RS-485 line; delays in ms."""

    enabled: bool
    rts_on_send: bool
    rts_after_send: bool
    rx_during_tx: bool
    delay_before_send_ms: int
    delay_after_send_ms: int


class LatencySettings(Struct, frozen=True):
    """What makes bytes wait in the driver of a serial port; None where its driver has no such thing."""

    ftdi_latency_timer_ms: int | None = None
    """So long an FTDI adapter keeps bytes that do not fill a USB packet."""
    async_low_latency: bool | None = None
    """The low-latency flag of the port (``setserial low_latency``)."""
    rx_trig_bytes: int | None = None
    """So many bytes a 16550 collects before it interrupts; fewer wait for four characters of silence."""
    rs485: Rs485 | None = None


class DrivesStatus(Struct, frozen=True, kw_only=True):
    """The way to the drives."""

    echo: str = ""
    address: str = ""
    failure: str | None = ""
    opens: Annotated[
        int,
        Counter(
            "opens",
            "times that the port or the connection was opened: more than one means that it was lost",
            "look at cable and adapter where it grows",
        ),
    ] = 0
    notes: list[str] = []
    latency: LatencySettings | None = None


class PortMinute(Struct, frozen=True, kw_only=True):
    """What came from a serial controller within the last minute."""

    whole: int = 0
    damaged: int = 0
    crc_errors: int = 0
    dropped_bytes: int = 0
    echoes: int = 0


class CertificateStatus(Struct, kw_only=True):
    """When a file of ``tls`` is good no more."""

    key: str = ""
    file: str = ""
    subject: str = ""
    ends: str | None = None
    days_left: int | None = None


class Session(Struct, kw_only=True):
    """A controller that came by certificate."""

    peer: str = ""
    certified: str = ""
    role: str = ""
    subject: str = ""
    serial: str = ""
    valid_until: str = ""


class TlsStatus(Struct, kw_only=True):
    """The listener of a controller that needs a certificate."""

    handshakes: int = 0
    failed_handshakes: Annotated[
        int,
        Counter(
            "handshakes failed",
            "TLS handshakes with the listener of a controller that failed",
            "look at the log: `handshake-failed` and `certificate-refused` say why, and of whom",
        ),
    ] = 0
    running_handshakes: int = 0
    certificates: list[CertificateStatus] = []
    sessions: list[Session] = []


class ControllerStatus(Struct, kw_only=True):
    """A controller: what comes from it, and how long the gateway takes for it.

    ``connections`` has one over TCP; ``state``, ``whole`` and ``minute`` has one on a serial port.
    """

    name: str = ""
    role: str = ""
    address: list[str] | str = ""
    state: str | UnsetType = UNSET
    failure: str | UnsetType | None = UNSET
    opens: int | UnsetType = UNSET
    connections: list[str] | UnsetType = UNSET
    asked_s: float | UnsetType | None = UNSET
    """None: it has never asked since the start. Older releases do not tell."""
    notes: list[str] | UnsetType = UNSET
    latency: LatencySettings | UnsetType | None = UNSET
    echo: str | UnsetType = UNSET
    refused_connections: Annotated[
        int | UnsetType,
        Counter(
            "connections refused",
            "connections to the listener of a controller that were closed at once",
            "look at the log: `connection-refused` says who, and which key",
        ),
    ] = UNSET
    whole: Annotated[
        int | UnsetType,
        Counter("whole frames", "whole frames that came from the serial port of a controller"),
    ] = UNSET
    damaged: int | UnsetType = UNSET
    crc_errors: int | UnsetType = UNSET
    malformed: int | UnsetType = UNSET
    dropped_bytes: int | UnsetType = UNSET
    echoes: int | UnsetType = UNSET
    tls: TlsStatus | UnsetType = UNSET
    minute: PortMinute | UnsetType = UNSET
    refused: int = 0
    gateway_us: GatewayTimes = NOTHING_MEASURED
    request_us: Figures = NOT_WORKED_OUT
    reply_us: Figures = NOT_WORKED_OUT
    drive_us: Figures = NOT_WORKED_OUT
    queue_us: Figures = NOT_WORKED_OUT
    silent_s: float | UnsetType = UNSET
    """For how long it has asked nothing; the supervisor works it out."""
    silent_after_s: float | UnsetType | None = UNSET
    """From then on that counts; None: as with all controllers."""


class LineStatus(Struct, kw_only=True):
    """A line. What only RTU or only Modbus/TCP counts the other lines do not have."""

    state: str = ""
    exchanges: Annotated[
        int,
        Counter(
            "exchanges",
            "exchanges with the drives: requests that were answered",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    timeouts: Annotated[
        int,
        Counter(
            "time-outs",
            "exchanges that a drive did not answer in time",
            "look at the drive and its wires, and whether `response_timeout_ms` is long enough",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    exceptions: Annotated[
        int,
        Counter(
            "exceptions",
            "exceptions that drives answered with; they pass as they are",
            "look the code up in the drive's manual, or with `pitch-gateway explain 0x02`",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    late: Annotated[
        int,
        Counter(
            "late",
            "frames or bytes from the drives when nothing was expected",
            f"{_LONGER}; see that no other master talks on the line",
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    refused: Annotated[
        int,
        Counter(
            "refused",
            "requests that the gateway refused; of a controller those that it sent",
            "look at the log: `refused-value`, `request-refused` and `second-writer` say why",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    late_replies: Annotated[
        int | UnsetType,
        Counter(
            "late replies",
            "replies over Modbus/TCP that came after their request had been given up",
            _LONGER,
            is_shown=True,
            is_metric=True,
        ),
    ] = UNSET
    late_targets: Annotated[
        int,
        Counter(
            "late targets",
            "targets and triggers that had waited longer than the `deadline_ms` of their axis",
            "compare with `pitch-gateway budget CONFIG`; let monitors ask less often",
            is_shown=True,
            is_metric=True,
        ),
    ] = 0
    backed_off: Annotated[
        int,
        Counter(
            "answered for silent drives",
            "requests that were answered with 0x0B at once because their drive had left three in a row "
            "unanswered",
            "look at the drive: power, cable, unit id; see `drive-backed-off`",
            is_shown=True,
            is_metric=True,
        ),
    ] = 0
    too_late: Annotated[
        int,
        Counter(
            "too late to send",
            "requests that were answered with 0x0B at once, and not sent, because their drive was silent: "
            "behind the silence after its time-out they could have left only with less than half of their "
            "controller's `timeout_ms` left; at most two in one silence, then a read is sent late",
            "look at the drive, as for `timeouts`. Where it is well but slow, a shorter `drain_ms` or a "
            "longer `timeout_ms` of the controller lets them be sent; with the gateway stopped "
            "`pitch-gateway probe CONFIG --timing` measures",
            is_shown=True,
            is_metric=True,
        ),
    ] = 0
    withdrawn: Annotated[
        int,
        Counter(
            "withdrawn",
            "requests that were not sent: their controller had given up on them, or a stop came after them",
            "compare with `pitch-gateway budget CONFIG`; give the controller a longer time-out",
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    broadcasts: Annotated[
        int, Counter("broadcasts", "requests to all drives, which none answers", is_metric=True)
    ] = 0
    added_reads: Annotated[
        int,
        Counter("added reads", "reads of the gateway's own: of positions, modes and bits", is_metric=True),
    ] = 0
    restaged: Annotated[
        int,
        Counter(
            "restaged",
            "staged targets that were written anew for their trigger",
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    damaged: Annotated[
        int | UnsetType,
        Counter(
            "damaged",
            "runs of bytes, however short, of which no frame could be made; of a unit id the requests that "
            "met with them, of a controller's port what came from there",
            "check cable, screen and termination; where nothing is whole, baud rate, parity, and A and B",
            is_shown=True,
            is_metric=True,
        ),
    ] = UNSET
    crc_errors: Annotated[
        int | UnsetType,
        Counter(
            "CRC errors",
            "of the damaged those of four bytes and more: frames with a wrong check sum",
            _CABLE,
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = UNSET
    dropped_bytes: Annotated[
        int | UnsetType,
        Counter("dropped bytes", "bytes that belong to no frame", _CABLE, is_logged=True),
    ] = UNSET
    stray_bytes: Annotated[
        int | UnsetType,
        Counter(
            "stray bytes",
            "bytes from the drives over RTU while nothing was expected",
            f"{_LONGER}; see that no other master talks on the line",
        ),
    ] = UNSET
    stray_frames: Annotated[
        int | UnsetType,
        Counter(
            "stray frames",
            "whole frames among the stray bytes: a drive that answers late, or twice",
            f"{_LONGER}; see that no unit id is there twice",
        ),
    ] = UNSET
    foreign_frames: Annotated[
        int | UnsetType,
        Counter(
            "foreign frames",
            "whole frames over RTU that answer another unit id or another function than was asked",
            "see that no unit id is there twice, and that no other master talks on the line",
        ),
    ] = UNSET
    echoes: Annotated[
        int | UnsetType,
        Counter("echoes", "own requests that an RS-485 adapter heard back; they are taken out"),
    ] = UNSET
    malformed: Annotated[
        int | UnsetType,
        Counter(
            "malformed",
            "bytes over TCP that are no Modbus/TCP frame; of a controller what it sent",
            "see what runs at that address: RTU over TCP wants `rtu_over_tcp`",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = UNSET
    oversized: Annotated[
        int,
        Counter(
            "too long replies",
            "replies over Modbus/TCP that are longer than a frame may be; their requests were answered as if "
            "none had come",
            "see what device answers at that address: no drive sends replies as long",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    wrong_units: Annotated[
        int | UnsetType,
        Counter(
            "wrong unit ids",
            "replies over Modbus/TCP with another unit id than was asked",
            "where the one drive of the line answers so, set `answers_as`; else look at the unit ids",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = UNSET
    unknown_modes: Annotated[
        int,
        Counter(
            "unknown modes",
            "frames whose meaning the register map does not know: they passed untouched",
            "look the value up in the drive's manual and list it under its meaning, or under `ignore`",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    unmapped_reads: Annotated[
        int,
        Counter(
            "unmapped reads",
            "reads of positions that are not mapped: they pass as they are",
            "map the register under `actual`, `commanded` or `aliases`",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    internal_faults: Annotated[
        int,
        Counter(
            "internal faults",
            "faults of the gateway's own program; see the event `internal-fault`",
            "send the log and the configuration to the makers of the gateway",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    budget_overruns: Annotated[
        int,
        Counter(
            "budget overruns",
            "exchanges that took the gateway longer than `budget_us`",
            "look at the load of the computer; `fifo` and `cpus` of `[relay]` put the gateway first",
            is_metric=True,
        ),
    ] = 0
    unit_ids: UnitIds = field(default_factory=UnitIds)
    cut_through: CutThroughStatus | UnsetType = UNSET
    minute: LineMinute = LineMinute()
    gateway_us: GatewayTimes = NOTHING_MEASURED
    request_us: Figures = NOT_WORKED_OUT
    reply_us: Figures = NOT_WORKED_OUT
    drive_us: Figures = NOT_WORKED_OUT
    queue_us: Figures = NOT_WORKED_OUT
    wire_s: float = 0.0
    added_frames_s: float = 0.0
    computed: dict[str, Computed] = {}
    """By controller."""
    drives: DrivesStatus = DrivesStatus()
    controllers: list[ControllerStatus] = []


LINE_COUNTERS: Final[Mapping[str, Counter]] = counters_of(LineStatus)
