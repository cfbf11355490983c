"""An axis: its position, its correction, and how well both are known. Lengths in its units."""

from typing import Annotated, Any, Final

from msgspec import UNSET, Struct, UnsetType, field

from gateway.status.counters import Counter
from gateway.status.times import NOT_WORKED_OUT, NOTHING_MEASURED, Figures, GatewayTimes

SHOWN_S: Final = 2.0
"""Maximum age of a reading that is shown as the position: the axis may have moved since, also by hand."""


class Shares(Struct, frozen=True, kw_only=True):
    """Shares of the table that are applied."""

    forward: float = 1.0
    backward: float = 1.0


class Reading(Struct, frozen=True, kw_only=True):
    """A position that was read."""

    nominal: float | None = None
    corrected: float | None = None
    age_s: float = 0.0


class ProblemStatus(Struct, kw_only=True):
    """A problem of a table file."""

    file: str = ""
    line: int | None = None
    column: int | None = None
    key: str = ""
    found: str = ""
    remedy: str = ""


class TableStatus(Struct, kw_only=True):
    """The table that an axis has, and the state of its file."""

    file: str | None = None
    format: str | None = None
    sha256: str | None = None
    compiled: str | None = None
    """Digest of the compiled table."""
    points: int = 0
    status: str = "none"
    error: str | None = None
    loaded_at: str | None = None
    problems: list[ProblemStatus] | UnsetType = UNSET
    """Known to the supervisor only."""
    is_overdue: bool | UnsetType = UNSET
    """Whether its file has been changing or open for writing for very long; known to the supervisor only."""


class GroupStatus(Struct, kw_only=True):
    """The state of an axis' group."""

    state: str = ""
    has_gone: bool = False
    is_put_off: bool = False
    is_skewed: bool = False
    skew: float | None = None


class ThermalStatus(Struct, kw_only=True):
    """The correction for the temperature."""

    state: str = ""
    celsius: float | None = None
    age_s: float | None = None
    difference: float = 0.0
    correction: float | None = None
    is_silent: bool = False


class CrossStatus(Struct, kw_only=True):
    """The correction for the positions of other axes."""

    state: str = ""
    axes: list[str] = []
    correction: float | None = None


class TermsStatus(Struct, kw_only=True):
    """The corrections besides the table."""

    correction: float | None = None
    is_too_large: bool = False
    thermal: ThermalStatus | UnsetType = UNSET
    cross: CrossStatus | UnsetType = UNSET


class WriterConflictStatus(Struct, kw_only=True):
    """Two controllers that both move an axis."""

    writers: list[str] = []
    since_s: float = 0.0
    refused: int = 0
    changes: Annotated[
        int,
        Counter(
            "changes",
            "times that two controllers took an axis from each other in one go",
            "let only one of them move the axis",
        ),
    ] = 0


class AxisTimes(Struct, kw_only=True):
    """The gateway's time for the frames of an axis, and its budget."""

    gateway_us: GatewayTimes = NOTHING_MEASURED
    request_us: Figures = NOT_WORKED_OUT
    reply_us: Figures = NOT_WORKED_OUT
    drive_us: Figures = NOT_WORKED_OUT
    queue_us: Figures = NOT_WORKED_OUT
    budget_us: float = 0.0
    budget_overruns: int = 0
    is_over_budget: bool = False


class AxisVerdict(Struct, frozen=True, kw_only=True):
    """The overall state of an axis."""

    state: str = ""
    kind: str = ""
    title: str = ""
    since: str = ""


class AxisAlarm(Struct, frozen=True, kw_only=True):
    """The worst alarm of an axis."""

    kind: str = ""
    severity: str = ""
    title: str = ""
    cuts_off: bool = False


class Position(Struct, frozen=True, kw_only=True):
    """The best known position of an axis, on both scales, with its age."""

    of: str | None = None
    """``reading``: it is there; ``last-reading`` or ``target``, whichever is newer; None: unknown."""
    nominal: float | None = None
    corrected: float | None = None
    age_s: float | None = None
    is_at_least: bool = False


class AxisStatus(Struct, kw_only=True):
    """An axis."""

    compensation: str = ""
    is_enabled: bool | UnsetType = UNSET
    """Whether the compensation is switched on, whatever its state; UNSET from older releases."""
    reads_uncorrected: bool = False
    """It is corrected, and reads 1:1 until its first target: the record of the last run is not used (yet)."""
    record_problem: str | None = None
    """Why no record is kept for the next start, although there should be one."""
    units: str = ""
    direction: str = ""
    gain: Shares = Shares()
    travel: tuple[float, float] | None = None
    correction: float | None = None
    nominal_setpoint: float | None = None
    corrected_setpoint: float | None = None
    nominal_actual: float | None = None
    corrected_actual: float | None = None
    last_actual: Reading | None = None
    """The newest reading, however old; None: there was none, or it is no longer valid."""
    actual_age_s: float | None = None
    writer: str | None = None
    table: TableStatus = field(default_factory=TableStatus)
    group: GroupStatus | None = None
    terms: TermsStatus | None = None
    rivals: WriterConflictStatus | None = None
    latency: AxisTimes = field(default_factory=AxisTimes)
    configured: dict[str, Any] = {}
    """Gain, mode and limits of the configuration."""


class WholeAxis(AxisStatus, kw_only=True):
    """An axis with what only the supervisor knows of it."""

    verdict: AxisVerdict = AxisVerdict()
    trouble: AxisAlarm | None = None
    last_seen: Reading | None = None
    position: Position | UnsetType = UNSET
    """UNSET from older releases."""
