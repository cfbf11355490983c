"""The summary of a valid configuration: structs for ``--json``, and lines for a person."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict

from msgspec import UNSET, Struct, UnsetType

from gateway.compensation.correction_spec import spec_of_table
from gateway.compensation.limits import MotionReport, motion_report
from gateway.compensation.settings import Gain, ThermalSettings
from gateway.compensation.table import CorrectionTable, make_table
from gateway.config.drive_files import NamedProfile
from gateway.drives.profile import Tier
from gateway.exchange.plan import AxisPlan
from gateway.state.plan import ControllerLink, GatewayPlan, LinePlan
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint


class LineSummary(Struct, frozen=True):
    """A line."""

    drives: str
    controllers: dict[str, str]
    groups: list[list[str]]


class DriveSummary(Struct, frozen=True):
    """The profile of a drive."""

    name: str
    title: str
    tier: str
    traps: int


class TableSummary(Struct, frozen=True):
    """A table, and what it can add to the motion."""

    file: str
    format: str
    sha256: str
    points: int
    range: tuple[float, float]
    max_correction: float
    max_reversal: float
    max_slope: float
    gain: Gain
    """The share that is applied: the three largest values above are with it."""
    can_cause: MotionReport


class BacklashSummary(Struct, frozen=True):
    """A backlash."""

    width: float
    kind: str


class ThermalSummary(Struct, frozen=True):
    """How an axis follows its temperature, and how far."""

    alpha: float
    reference: float
    fixed_at: float
    timeout_s: float
    hold_s: float
    rate_per_min: float
    largest_dt: float
    largest_per_kelvin: float


class CrossSummary(Struct, frozen=True):
    """The correction of an axis that depends on another axis."""

    axis: str
    file: str
    max_correction: float


class AxisSummary(Struct, frozen=True):
    """An axis; lengths in its units. Parts that it does not have are UNSET."""

    line: str
    unit_id: int
    units: str
    counts_per_unit: float
    compensation: str
    referenced: str
    setpoints: str
    max_speed: float
    drive: DriveSummary | None
    table: TableSummary | None
    backlash: BacklashSummary | None
    thermal: ThermalSummary | UnsetType
    cross: list[CrossSummary] | UnsetType


class Summary(Struct, frozen=True):
    """Lines, axes, drives and tables."""

    gateway: str
    lines: dict[str, LineSummary]
    axes: dict[str, AxisSummary]


def summary(plan: GatewayPlan, drives: Mapping[str, NamedProfile]) -> Summary:
    """Return the summary of a plan."""
    return Summary(
        plan.name,
        {line.name: _line_summary(line) for line in plan.lines},
        {
            axis.name: _axis_summary(line, axis, drives.get(axis.name))
            for line in plan.lines
            for axis in line.axes
        },
    )


def _line_summary(line: LinePlan) -> LineSummary:
    return LineSummary(
        drives=_endpoint_text(line.drives),
        controllers={
            link.plan.name: f"{_endpoint_text(link.endpoint)}, {_roles(link)}" for link in line.controllers
        },
        groups=[list(group) for group in line.groups],
    )


def _roles(link: ControllerLink) -> str:
    if link.tls is None:
        return link.plan.role.value
    roles = (f"{name} ({given.role.value})" for name, given in link.tls.roles.items())
    return f"TLS, by certificate: {', '.join(roles)}"


def _endpoint_text(endpoint: TcpEndpoint | SerialEndpoint) -> str:
    if isinstance(endpoint, TcpEndpoint):
        return f"{'RTU over TCP' if endpoint.rtu else 'TCP'} {endpoint}"
    character = f"{endpoint.data_bits}{endpoint.parity}{endpoint.stop_bits}"
    return f"RTU {endpoint} {endpoint.baudrate} {character}"


def _axis_summary(line: LinePlan, axis: AxisPlan, drive: NamedProfile | None) -> AxisSummary:
    settings, backlash = axis.settings, axis.settings.backlash
    return AxisSummary(
        line=line.name,
        unit_id=axis.unit_id,
        units=settings.units.value,
        counts_per_unit=settings.counts_per_unit,
        compensation=axis.compensation.value,
        referenced=axis.referenced.value,
        setpoints=settings.setpoints.value,
        max_speed=settings.max_speed,
        drive=None if drive is None else _drive_summary(drive),
        table=_table_summary(axis, axis.table) if axis.table is not None and axis.table_name else None,
        backlash=None if backlash is None else BacklashSummary(backlash.width, backlash.kind.value),
        thermal=UNSET if axis.thermal is None else _thermal_summary(axis.thermal, settings.travel),
        cross=[
            CrossSummary(each.axis, each.table_name, max(map(abs, each.corrections))) for each in axis.cross
        ]
        or UNSET,
    )


def _drive_summary(drive: NamedProfile) -> DriveSummary:
    tier = drive.profile.tier if drive.is_shipped else Tier.OWN
    return DriveSummary(drive.name, drive.profile.title, tier.value, len(drive.profile.traps))


def _table_summary(axis: AxisPlan, table: CorrectionTable) -> TableSummary:
    gain = axis.settings.gain
    applied = make_table(
        table.positions,
        [gain.forward * each for each in table.forward],
        [gain.backward * each for each in table.backward],
        table.units,
    )
    return TableSummary(
        file=axis.table_name,
        format=axis.table_format,
        sha256=axis.table_digest,
        points=len(table.positions),
        range=(table.first, table.last),
        max_correction=applied.max_correction(),
        max_reversal=applied.max_reversal(),
        max_slope=applied.max_slope(),
        gain=gain,
        can_cause=motion_report(spec_of_table(table, axis.settings), axis.settings),
    )


def _thermal_summary(thermal: ThermalSettings, travel: tuple[float, float] | None) -> ThermalSummary:
    furthest = max(abs(end - thermal.fixed_at) for end in travel or (0.0, 0.0))
    return ThermalSummary(**asdict(thermal), largest_per_kelvin=thermal.alpha * furthest)


def summary_lines(plan: GatewayPlan, drives: Mapping[str, NamedProfile]) -> list[str]:
    """Return the summary as lines of text."""
    data = summary(plan, drives)
    lines = [f"gateway {data.gateway}"]
    for name, line in data.lines.items():
        lines.append(f"line {name}: drives {line.drives}")
        lines += [f"  controller {who}: {where}" for who, where in line.controllers.items()]
        lines += [f"  group of {', '.join(group)}: corrected together" for group in line.groups]
    for name, axis in data.axes.items():
        lines += _axis_lines(name, axis)
    return lines


def _axis_lines(name: str, axis: AxisSummary) -> list[str]:
    scale = f"{axis.counts_per_unit:g} counts/{axis.units}"
    first = f"axis {name}: line {axis.line}, unit {axis.unit_id}, {scale}, {axis.setpoints}, "
    first += f"referenced {axis.referenced}, compensation {axis.compensation}"
    lines = [first]
    if axis.drive is not None:
        lines.append(_drive_line(axis.drive))
    if axis.table is None:
        lost = axis.backlash
        if lost is None:
            return [*lines, "  no table: positions pass 1:1"]
        return [*lines, f"  no table: backlash of {lost.width:g} {axis.units}, {lost.kind}"]
    lines += _table_lines(axis.table, axis.units, axis.max_speed)
    return [*lines, *_terms_lines(axis)]


def _terms_lines(axis: AxisSummary) -> Iterator[str]:
    unit, thermal = axis.units, axis.thermal
    if thermal:
        yield (
            f"  warm: up to {thermal.largest_per_kelvin:.4g} {unit} for each kelvin from "
            f"{thermal.reference:g} °C, held at {thermal.fixed_at:g} {unit}"
        )
    for cross in axis.cross or ():
        yield f"  where {cross.axis} is ({cross.file}): up to {cross.max_correction:.4g} {unit}"


def _drive_line(drive: DriveSummary) -> str:
    line = f"  drive {drive.title} ({drive.name}): "
    line += "a profile of your own" if drive.tier == Tier.OWN.value else f"tier {drive.tier}"
    if drive.traps:
        line += f", {drive.traps} traps to check before the machine is run"
        line += "" if drive.tier == Tier.OWN.value else f" (pitch-gateway drives show {drive.name})"
    return line


def _table_lines(table: TableSummary, unit: str, max_speed: float) -> Iterator[str]:
    low, high = table.range
    cause = table.can_cause
    yield f"  table {table.file} ({table.format}): {table.points} points, {low:g} to {high:g} {unit}"
    if table.gain.is_zero:
        yield "  gain 0: nothing of it is applied"
        return
    if not table.gain.is_even:
        yield f"  with a gain of {table.gain.forward:g} forward and {table.gain.backward:g} backward:"
    elif table.gain.forward != 1.0:
        yield f"  with a gain of {table.gain.forward:g}:"
    yield (
        f"  corrections up to {table.max_correction:.4g} {unit}, slope up to {table.max_slope:.3g}, "
        f"between the directions up to {table.max_reversal:.4g} {unit}"
    )
    step = f"  can cause a step of {cause.largest_step:.4g} {unit} at a reversal"
    if not max_speed:
        yield f"{step}; give max_speed to see how much speed it adds"
        return
    yield (
        f"{step}, {cause.added_speed:.4g} {unit}/s of speed and {cause.added_acceleration:.4g} "
        f"{unit}/s² of acceleration at {max_speed:g} {unit}/s"
    )
