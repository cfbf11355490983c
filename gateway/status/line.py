"""A line: its counters, its unit ids, its drives and its controllers."""

from collections.abc import Mapping
from typing import Annotated, Final

from msgspec import UNSET, Struct, UnsetType, field

from gateway.status.counters import Counter, counters_of
from gateway.status.times import NOT_WORKED_OUT, NOTHING_MEASURED, Figures, GatewayTimes

_LONGER: Final = (
    "raise `response_timeout_ms`; with the gateway stopped, `pitch-gateway probe CONFIG --timing` measures "
    "what the drive needs"
)
_CABLE: Final = "check cable, screen, termination and baud rate"


class UnitStatus(Struct, kw_only=True):
    """How the drive of one unit id answers; ages in s."""

    answered_s: float | None = None
    silent_s: float | None = None
    """None: it answers, or had no request."""
    timeouts_in_a_row: Annotated[
        int,
        Counter(
            "time-outs in a row",
            "requests that a unit id has left unanswered since its last answer",
            "check power, cable and unit id of the drive",
        ),
    ] = 0
    tried_again_s: float | None = None
    damaged: int = 0
    damaged_in_a_row: Annotated[
        int,
        Counter(
            "damaged in a row",
            "of the last 32 requests that a unit id left unanswered in a row, those that got damaged bytes "
            "instead of a valid frame",
            "compare baud rate and parity, then exchange A and B",
        ),
    ] = 0
    damaged_minute: Annotated[
        int,
        Counter(
            "damaged in the last minute",
            "requests to a unit id within the last minute that got damaged bytes instead of a valid frame",
            "check cable, screen and termination",
        ),
    ] = 0
    other_ids_in_a_row: Annotated[
        int,
        Counter(
            "other transaction ids in a row",
            "of the last 32 requests that a unit id left unanswered in a row, those whose reply had "
            "another transaction id",
            "update its firmware, or use a converter that returns the transaction id",
        ),
    ] = 0
    answers_with: str | None = None


class UnitIds(Struct, kw_only=True):
    """The unit ids that controllers address, and those that answer."""

    axes: dict[str, int] = {}
    heard: list[int] = []
    strangers: list[int] = []
    """The unknown ones of ``heard``."""
    requests: dict[str, int] = {}
    """Requests to each of these."""
    asked_by: dict[str, list[int]] = {}
    """By controller."""
    drives: dict[str, UnitStatus] = {}
    """By unit id."""


class Forwarded(Struct, kw_only=True):
    """Results for the requests, or for the replies, of a line with ``cut_through``."""

    cut_through: Annotated[
        int,
        Counter(
            "cut through",
            "with `cut_through`: requests and replies forwarded while they arrived",
        ),
    ] = 0
    gain_us: int | None = None
    stored: Annotated[
        dict[str, int],
        Counter(
            "stored",
            "with `cut_through`: those stored whole before they were sent, and why. `kept`: never cut "
            "through, or complete too soon; otherwise the event before the first byte",
            "compare with `pitch-gateway budget CONFIG`. `cut-through-off` in the log names the adapter",
        ),
    ] = {}
    spoilt: Annotated[
        dict[str, int],
        Counter(
            "spoilt",
            "with `cut_through`: those aborted while they were sent, and why",
            "if many are `stalled` or `unfit`, turn `cut_through` off for the line; if `bad`, check cables",
        ),
    ] = {}


class CutThroughStatus(Struct, kw_only=True):
    """Results of cut-through for the frames of a line."""

    requests: Forwarded
    replies: Forwarded
    torn: Annotated[
        int,
        Counter(
            "torn",
            "with `cut_through`: frames inside which the transmitter ran empty",
            "`fifo` and `cpus` of `[relay]` give the gateway priority. Otherwise turn `cut_through` off "
            "for the line",
        ),
    ] = 0


class LineMinute(Struct, frozen=True, kw_only=True):
    """Frames of the last minute."""

    exchanges: int = 0
    damaged: int = 0
    malformed: int = 0


class Computed(Struct, kw_only=True):
    """Calculated times of a controller."""

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
    """Settings in the driver of a serial port that delay bytes; None if its driver has no such setting."""

    ftdi_latency_timer_ms: int | None = None
    """How long an FTDI adapter keeps bytes that do not fill a USB packet."""
    async_low_latency: bool | None = None
    """The low-latency flag of the port (``setserial low_latency``)."""
    rx_trig_bytes: int | None = None
    """Bytes that a 16550 collects before it interrupts; fewer wait for four characters of silence."""
    rs485: Rs485 | None = None


class DrivesStatus(Struct, frozen=True, kw_only=True):
    """The link to the drives."""

    echo: str = ""
    address: str = ""
    failure: str | None = ""
    opens: Annotated[
        int,
        Counter(
            "opens",
            "times that the port or connection was opened; more than one means a loss",
            "check cable and adapter",
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
    """When a file of ``tls`` expires."""

    key: str = ""
    file: str = ""
    subject: str = ""
    ends: str | None = None
    days_left: int | None = None
    sha256: list[str] = []
    """Of each certificate in the file, in its order, or of its list of revoked ones: the digest of the DER
    form, as ``openssl x509 -fingerprint -sha256`` shows it."""


class Session(Struct, kw_only=True):
    """A controller that connected with a certificate."""

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
            "failed TLS handshakes with the listener of a controller",
            "see `handshake-failed` and `certificate-refused` in the log",
        ),
    ] = 0
    running_handshakes: int = 0
    certificates: list[CertificateStatus] = []
    sessions: list[Session] = []


class ControllerStatus(Struct, kw_only=True):
    """A controller: its traffic, and the gateway's time for it.

    A TCP controller has ``connections``; a serial one has ``state``, ``whole`` and ``minute``.
    """

    name: str = ""
    role: str = ""
    address: list[str] | str = ""
    state: str | UnsetType = UNSET
    failure: str | UnsetType | None = UNSET
    opens: int | UnsetType = UNSET
    connections: list[str] | UnsetType = UNSET
    asked_s: float | UnsetType | None = UNSET
    """None: no request since the start. UNSET from older releases."""
    notes: list[str] | UnsetType = UNSET
    latency: LatencySettings | UnsetType | None = UNSET
    echo: str | UnsetType = UNSET
    refused_connections: Annotated[
        int | UnsetType,
        Counter(
            "connections refused",
            "connections to the listener of a controller that were closed immediately",
            "see `connection-refused` in the log",
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
    """For how long it has sent no request; the supervisor calculates it."""
    silent_after_s: float | UnsetType | None = UNSET
    """Time after which it counts as silent; None: as for all controllers."""


class LineStatus(Struct, kw_only=True):
    """A line. Counters of RTU only, or of Modbus/TCP only, are missing on other lines."""

    state: str = ""
    exchanges: Annotated[
        int,
        Counter(
            "exchanges",
            "answered requests to the drives",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    timeouts: Annotated[
        int,
        Counter(
            "time-outs",
            "requests that a drive did not answer in time",
            "check the drive, its wiring and `response_timeout_ms`",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    exceptions: Annotated[
        int,
        Counter(
            "exceptions",
            "exceptions that drives answered with; they pass unchanged",
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
            "frames or bytes from the drives while none was expected",
            f"{_LONGER}. Check that no other master uses the line",
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    refused: Annotated[
        int,
        Counter(
            "refused",
            "requests that the gateway refused; for a controller, its own",
            "see `refused-value`, `request-refused` and `second-writer` in the log",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    late_replies: Annotated[
        int | UnsetType,
        Counter(
            "late replies",
            "Modbus/TCP replies that came after their request had been given up",
            _LONGER,
            is_shown=True,
            is_metric=True,
        ),
    ] = UNSET
    late_targets: Annotated[
        int,
        Counter(
            "late targets",
            "targets and triggers that waited longer than `deadline_ms` of their axis",
            "compare with `pitch-gateway budget CONFIG`. Let monitors poll less often",
            is_shown=True,
            is_metric=True,
        ),
    ] = 0
    backed_off: Annotated[
        int,
        Counter(
            "answered for silent drives",
            "requests answered immediately with 0x0B, because their drive had left three in a row unanswered",
            "check power, cable and unit id of the drive; see `drive-backed-off`",
            is_shown=True,
            is_metric=True,
        ),
    ] = 0
    too_late: Annotated[
        int,
        Counter(
            "too late to send",
            "requests answered immediately with 0x0B and not sent: after the silence of their drive, "
            "less than half of the controller's `timeout_ms` would have been left. At most two in one "
            "silence; then a read is sent late",
            "check the drive, as for `timeouts`. If it is only slow, shorten `drain_ms` or lengthen "
            "`timeout_ms` of the controller",
            is_shown=True,
            is_metric=True,
        ),
    ] = 0
    withdrawn: Annotated[
        int,
        Counter(
            "withdrawn",
            "requests not sent: their controller had given up, or a stop followed",
            "compare with `pitch-gateway budget CONFIG`. Give the controller a longer time-out or a slower "
            "cycle",
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    broadcasts: Annotated[
        int, Counter("broadcasts", "requests to all drives, which no drive answers", is_metric=True)
    ] = 0
    added_reads: Annotated[
        int,
        Counter("added reads", "reads that the gateway added: positions, modes and bits", is_metric=True),
    ] = 0
    restaged: Annotated[
        int,
        Counter(
            "restaged",
            "staged targets rewritten for their trigger",
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    damaged: Annotated[
        int | UnsetType,
        Counter(
            "damaged",
            "runs of bytes, however short, that form no frame. For a unit id: requests that met them; "
            "for a controller: those from its port",
            "check cable, screen and termination. If no frame is valid, check baud rate, parity, and A and B",
            is_shown=True,
            is_metric=True,
        ),
    ] = UNSET
    crc_errors: Annotated[
        int | UnsetType,
        Counter(
            "CRC errors",
            "of the damaged, those of four bytes or more: frames with a wrong CRC",
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
            "RTU bytes from the drives while none were expected",
            f"{_LONGER}. Check that no other master uses the line",
        ),
    ] = UNSET
    stray_frames: Annotated[
        int | UnsetType,
        Counter(
            "stray frames",
            "whole frames among the stray bytes: a drive answers late or twice",
            f"{_LONGER}. Check that no unit id is used twice",
        ),
    ] = UNSET
    foreign_frames: Annotated[
        int | UnsetType,
        Counter(
            "foreign frames",
            "whole RTU frames from another unit id or with another function code than requested",
            "check that no unit id is used twice, and that no other master uses the line",
        ),
    ] = UNSET
    echoes: Annotated[
        int | UnsetType,
        Counter("echoes", "own requests echoed by an RS-485 adapter; they are removed"),
    ] = UNSET
    malformed: Annotated[
        int | UnsetType,
        Counter(
            "malformed",
            "TCP bytes that are no Modbus/TCP frame; for a controller, from it",
            "check what runs at that address: RTU over TCP needs `rtu_over_tcp`",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = UNSET
    oversized: Annotated[
        int,
        Counter(
            "too long replies",
            "Modbus/TCP replies longer than a frame may be; discarded",
            "check which device answers at that address: no drive sends such replies",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    wrong_units: Annotated[
        int | UnsetType,
        Counter(
            "wrong unit ids",
            "Modbus/TCP replies with another unit id than requested",
            "if it is the only drive of the line, set `answers_as`. Otherwise check the unit ids",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = UNSET
    unknown_modes: Annotated[
        int,
        Counter(
            "unknown modes",
            "frames with a meaning that the register map does not list; they pass unchanged",
            "look the value up in the drive's manual, and list it under its meaning or under `ignore`",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    unmapped_reads: Annotated[
        int,
        Counter(
            "unmapped reads",
            "reads of unmapped positions; they pass unchanged",
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
            "faults of the gateway's program; see `internal-fault`",
            "send log and configuration to the makers of the gateway",
            is_shown=True,
            is_logged=True,
            is_metric=True,
        ),
    ] = 0
    budget_overruns: Annotated[
        int,
        Counter(
            "budget overruns",
            "exchanges that took longer than `budget_us` in the gateway",
            "check the load of the computer. `fifo` and `cpus` of `[relay]` give the gateway priority",
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
