"""All checks before any motion: the gateway, the axis, the range."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from gateway.commissioning.measure.axis_link import AxisLink
from gateway.commissioning.measure.errors import AxisError
from gateway.compensation.backlash import with_backlash
from gateway.compensation.correction_spec import spec_of_table
from gateway.compensation.units import Units
from gateway.exchange.plan import ALARM_BIT, AxisPlan, Reference, Role
from gateway.ipc.messages import Pong, Reply
from gateway.metrology.cycle import Stop
from gateway.state.plan import ControllerLink, LinePlan
from gateway.state.tables import compiled, digest_of
from gateway.status.axis import AxisStatus
from gateway.status.model import RelayModel

OFF: Final = "off"
IN_FORCE: Final = frozenset({"active", "blending", "outside"})
NOT_IN_FORCE: Final = frozenset({"off", "no-table", "shadow"})


@dataclass(frozen=True, slots=True)
class Compensation:
    """The gateway's compensation of the axis during the measurement."""

    state: str
    """As in the status."""
    sha256: str = ""
    """Of the table's file, if the table is in force."""

    @property
    def is_active(self) -> bool:
        """Whether a table is in force."""
        return self.state in IN_FORCE

    @property
    def fact(self) -> str:
        """Its text in the file of readings."""
        return f"active {self.sha256}" if self.is_active else OFF


def axis_of(lines: Sequence[LinePlan], name: str) -> tuple[LinePlan, AxisPlan]:
    """Return an axis and its line. Raises AxisError: unknown name, a rotary axis, or one of a group."""
    for line in lines:
        for axis in line.axes:
            if axis.name == name:
                if axis.settings.units is Units.DEGREE or axis.settings.modulo:
                    raise AxisError(
                        f"axis {name} is rotary, and measure works only with lengths; move it with its "
                        "controller and make the table from the readings (pitch-gateway table build)"
                    )
                others = [other for group in line.groups if name in group for other in group if other != name]
                if others:
                    raise AxisError(
                        f"axis {name} belongs to a group with {', '.join(others)}: moved alone it would "
                        "twist the machine; move them with their controller and make the tables from "
                        "the readings (pitch-gateway table build)"
                    )
                return line, axis
    names = ", ".join(axis.name for line in lines for axis in line.axes)
    raise AxisError(f"there is no axis {name}; there are {names}")


def controller_of(line: LinePlan, name: str | None) -> ControllerLink:
    """Return the listener to connect to: the named one, or the only one that may move axes.

    Raises:
        AxisError: none, several, or an unsuitable one.
    """
    movers = [link for link in line.controllers if link.plan.role is Role.MOTION]
    names = ", ".join(link.plan.name for link in line.controllers)
    if name is not None:
        found = [link for link in line.controllers if link.plan.name == name]
        if not found:
            raise AxisError(f"line {line.name} has no controller {name}; it has {names}")
    elif len(movers) == 1:
        found = movers
    else:
        raise AxisError(
            f"line {line.name} has {len(movers)} controllers that may move axes ({names}): name one "
            "with --controller"
        )
    link = found[0]
    if link.plan.role is not Role.MOTION:
        raise AxisError(
            f'controller {link.plan.name} has role = "{link.plan.role.value}": it may not move axes; name '
            "another with --controller"
        )
    if link.plan.rights.is_read_only:
        raise AxisError(f"controller {link.plan.name} is read_only: name another with --controller")
    if link.tls is not None:
        raise AxisError(
            f"controller {link.plan.name} is a TLS listener, and measure has no certificate: add a listener "
            'on 127.0.0.1 with role = "motion" and name it with --controller'
        )
    return link


def check_same_plan(reply: Reply, shape: str) -> None:
    """Check that the gateway runs from the present configuration file; ``reply`` is that to a ping.

    If counts or registers differ from the gateway's, the axis would move to wrong positions.

    Raises:
        AxisError: the gateway was started with another configuration.
    """
    if not isinstance(reply, Pong) or reply.shape != shape:
        raise AxisError(
            "the configuration has changed since the gateway started: restart the gateway, then measure"
        )


def compensation_of(status: RelayModel, axis: AxisPlan) -> Compensation:
    """Return the compensation in force. Raises AxisError: unknown, or neither on nor off."""
    found = _axis_status(status, axis)
    state = found.compensation
    if state in NOT_IN_FORCE:
        return Compensation(state)
    if state not in IN_FORCE:
        remedy = {
            "unreferenced": f"home it (or pitch-gateway reference CONFIG {axis.name}), or switch the "
            f"correction off (pitch-gateway disable CONFIG {axis.name}) and measure without it",
            "blocked": "the gateway refuses its targets; pitch-gateway status CONFIG and its log say why",
        }.get(state, "pitch-gateway status CONFIG says why")
        raise AxisError(f"axis {axis.name} is {state}: {remedy}")
    gain = found.gain
    if {gain.forward, gain.backward} != {1.0}:
        raise AxisError(
            f"axis {axis.name} has gain {gain.forward:g} forward and {gain.backward:g} backward, but a "
            "table needs the whole correction or none: set both to 1, or run pitch-gateway disable CONFIG "
            f"{axis.name}"
        )
    if not axis.table_name:
        raise AxisError(
            f"axis {axis.name} has a backlash and no table: run pitch-gateway disable CONFIG {axis.name}, "
            "then measure; the new table will include the lost motion"
        )
    if found.table.sha256 != axis.table_digest:
        raise AxisError(
            f"axis {axis.name}: {axis.table_name} has changed since the gateway read it: run "
            "pitch-gateway reload CONFIG, then measure"
        )
    if found.table.compiled != _compiled_digest(axis):
        raise AxisError(
            f"axis {axis.name}: table_options of {axis.table_name} in CONFIG differ from those of the "
            "gateway: run pitch-gateway reload CONFIG, then measure"
        )
    return Compensation(state, str(found.table.sha256))


def _compiled_digest(axis: AxisPlan) -> str:
    """Return the digest of an axis's corrections, as a gateway puts them into force."""
    table = axis.table
    if table is None:
        return ""
    if axis.settings.backlash is not None:
        table = with_backlash(table, axis.settings.backlash)
    return digest_of(compiled(table))


def check_writer(status: RelayModel, axis: AxisPlan) -> None:
    """Check that no controller moves the axis. Raises AxisError."""
    writer = _axis_status(status, axis).writer
    if writer is not None:
        raise AxisError(
            f"axis {axis.name} is moved by {writer}: stop that program, wait until the axis has had no "
            f"command for {axis.writer_hold_s:g} s, and try again"
        )


def check_line(status: RelayModel, line: LinePlan) -> None:
    """Check that the gateway reaches the drives. Raises AxisError."""
    found = status.lines.get(line.name)
    state = None if found is None else found.state
    if state != "up":
        raise AxisError(f"line {line.name} is {state}: the gateway does not reach the drives")


def check_range(link: AxisLink, stops: Sequence[Stop], *, is_corrected: bool) -> None:
    """Check that every stop is inside travel, as commanded and as corrected.

    Raises:
        AxisError: travel is not configured, or a stop is outside; the error names a range that fits.
    """
    plan = link.plan
    settings, units = plan.settings, plan.settings.units.value
    if settings.travel is None:
        raise AxisError(f"axis.{plan.name}.travel: missing: measure moves only within a known travel")
    low, high = settings.travel
    for stop in stops:
        if not low <= stop.nominal <= high:
            what = "target" if stop.measure else "turn-around point (--overrun)"
            overrun = min(
                abs(turnaround.nominal - target.nominal)
                for turnaround in stops
                for target in stops
                if target.measure and not turnaround.measure
            )
            raise AxisError(
                f"the {what} {stop.nominal:.9g} is outside travel = [{low:.9g}, {high:.9g}] {units}: give "
                f"--from {low + overrun:.9g} or more and --to {high - overrun:.9g} or less, or a smaller "
                "--overrun"
            )
        link.packed(stop.nominal)
    if not is_corrected or plan.table is None:
        return
    spec = spec_of_table(plan.table, settings)
    lowest, highest = settings.corrected_bounds
    for stop in stops:
        for share in (1.0, 0.0):
            corrected = stop.nominal + spec.map_at(share).correction(stop.nominal)
            if not lowest <= corrected <= highest:
                raise AxisError(
                    f"{stop.nominal:.9g} is {corrected:.9g} {units} with its correction: outside travel "
                    "and travel_margin; change --from, --to or --overrun"
                )


def check_overrun(plan: AxisPlan, overrun: float) -> None:
    """Check that the overrun outside the targets exceeds the lost motion. Raises AxisError."""
    if not overrun > plan.settings.hysteresis:
        raise AxisError(
            f"--overrun {overrun:g}: it must be greater than the lost motion of the axis, and than its "
            f"hysteresis of {plan.settings.hysteresis:g} {plan.settings.units.value}"
        )
    facts = None if plan.table is None else plan.table.facts
    lost = 0.0 if facts is None else facts.difference.largest
    if lost >= overrun:
        raise AxisError(
            f"--overrun {overrun:g}: it must be greater than {lost:.6g} {plan.settings.units.value}, "
            "the lost motion in the table"
        )


async def check_may_move(link: AxisLink) -> float:
    """Check that the axis is ready to move, and return its position.

    Raises:
        AxisError: alarm, moving, not homed, outside travel, no reply.
    """
    plan = link.plan
    snapshot = await link.snapshot()
    if snapshot.is_alarm:
        raise AxisError(f"axis {plan.name} reports an alarm (bits.{ALARM_BIT}): clear it at the drive")
    if snapshot.is_moving:
        raise AxisError(
            f"axis {plan.name} is moving: wait until it is at standstill, and stop other programs that "
            "move it"
        )
    if plan.referenced is Reference.DRIVE_BIT and await link.is_homed() is False:
        raise AxisError(f"axis {plan.name} is not homed: home it first")
    assert plan.settings.travel is not None
    low, high = plan.settings.travel
    slack = plan.settings.travel_margin
    if not low - slack <= snapshot.position <= high + slack:
        raise AxisError(
            f"axis {plan.name} is at {snapshot.position:.9g}, outside travel = [{low:.9g}, {high:.9g}]: "
            "move it inside, or correct zero_counts"
        )
    return snapshot.position


def _axis_status(status: RelayModel, axis: AxisPlan) -> AxisStatus:
    found = status.axes.get(axis.name)
    if found is None:
        raise AxisError(f"the running gateway has no axis {axis.name}: it uses another CONFIG; restart it")
    return found
