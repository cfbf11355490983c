"""The active alarms, from the status model, worst first: what, where, since when, what to do.

The page's banner, the terminal, ``/healthz``, MQTT, metrics and alerts all show this list.
``supervisor.verdict`` summarises it in one word. An alarm that only follows from a worse one is left out as
long as the worse one lasts (``catalogue.alarms.HIDES``).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from msgspec import UNSET

from gateway.catalogue import alarms as kinds
from gateway.catalogue.alarms import CONTROLLER_SILENT_S, FEWEST_ASKED, SILENT_S
from gateway.catalogue.entry import AlarmEntry, Severity
from gateway.catalogue.text import Text, text_data
from gateway.status.axis import AxisAlarm, AxisStatus, Shares, TermsStatus, WriterConflictStatus
from gateway.status.line import ControllerStatus, LineStatus, UnitIds
from gateway.status.model import AcknowledgedBy, AlarmStatus, Model, SupervisorStatus
from gateway.times import span

STALE_S: Final = 2.0
"""Snapshots come five times a second. After this time the relay is connected but reports nothing."""
INSTEAD_SHARE: Final = 0.5
"""Share of the unanswered requests to which other bytes came than a reply. From this share on, the drive is
there but uses another protocol or other settings."""
FEWEST_DAMAGED: Final = 3
"""Fewer damaged frames than this, in a minute or ever, are chance."""
DAMAGED_SHARE: Final = 0.01
"""Share of the frames of a minute. A good line damages none in days."""
FEWEST_TRIES: Final = 3
"""Attempts of another controller to write to an axis within a minute. One is a mistake, more are two
programs."""
_ORDER: Final = {kind: number for number, kind in enumerate(kinds.ALARMS)}

SourcePath = tuple[str, ...]
"""From outside to inside. Empty: the gateway. Else a line; then a unit id or a controller on it; then an
axis."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """One thing that is wrong."""

    entry: AlarmEntry
    source_path: SourcePath
    where: str
    """In words: ``gateway``, ``line NAME``, ``line NAME, controller NAME``, ``axis NAME``, ``mqtt``, …"""
    what: str
    axes: tuple[str, ...] = ()
    """Axes whose state the alarm describes."""
    age_s: float | None = None
    """Age of the alarm, if its source reports one. None: it counts from when the alarm is first seen."""

    @property
    def key(self) -> tuple[str, str]:
        """Identity of the alarm: equal keys are the same alarm."""
        return self.entry.kind, self.where

    @property
    def source_key(self) -> tuple[str, SourcePath]:
        """The same identity without words. It stays when the words change."""
        return self.entry.kind, self.source_path

    def hides(self, entry: AlarmEntry, source_path: SourcePath) -> bool:
        """Whether an alarm of a kind at a path only follows from this one."""
        is_within = source_path[: len(self.source_path)] == self.source_path
        return is_within and entry in kinds.HIDES.get(self.entry, ())

    def of_axis(self) -> AxisAlarm:
        """Return the alarm as an axis shows it."""
        return AxisAlarm(
            kind=self.entry.kind,
            severity=self.entry.severity.value,
            title=self.entry.title,
            cuts_off=self.entry.cuts_off,
        )

    def status(self, since: str, acknowledged: AcknowledgedBy | None) -> AlarmStatus:
        """Return the alarm as the status shows it; ``since`` as ISO 8601."""
        return AlarmStatus(
            kind=self.entry.kind,
            severity=self.entry.severity.value,
            where=self.where,
            what=str(self.what),
            says=text_data(self.what),
            remedy=self.entry.remedy,
            since=since,
            axes=list(self.axes),
            acknowledged=acknowledged,
        )


def troubles(model: Model) -> list[Alarm]:
    """Return everything that is wrong, errors first, without what only follows from another alarm."""
    axis_paths = {axis: (line, unit_id, axis) for line, unit_id, axis in _axes(model)}
    found = [
        *_of_relay(model),
        *(alarm for name, line in model.lines.items() for alarm in _of_line(name, line)),
        *(
            alarm
            for name, axis in model.axes.items()
            for alarm in _of_axis(name, axis, axis_paths.get(name, ("?", "?", name)))
        ),
        *_of_supervisor(model.supervisor, tuple(model.axes)),
    ]
    causes = [
        alarm for alarm in found if not any(other.hides(alarm.entry, alarm.source_path) for other in found)
    ]
    return sorted(
        causes, key=lambda each: (each.entry.severity is not Severity.ERROR, _ORDER[each.entry.kind])
    )


def is_hidden(kind: str, source_path: SourcePath, found: Sequence[Alarm]) -> bool:
    """Whether the alarms that were found hide a kind of alarm at a path."""
    entry = kinds.ALARMS.get(kind)
    return entry is not None and any(other.hides(entry, source_path) for other in found)


def is_fresh(model: Model) -> bool:
    """Whether the relay's snapshot is current: an old position must not be shown as the present one."""
    gateway = model.gateway
    age_s = gateway.snapshot_age_s
    return gateway.relay == "up" and age_s is not None and age_s <= STALE_S


def of_axis(found: Sequence[Alarm], axis: str) -> Alarm | None:
    """Return the worst alarm that names an axis; None: the axis has no alarm."""
    return next((alarm for alarm in found if axis in alarm.axes), None)


def _axes_named(axes: Sequence[str]) -> str:
    return f"{'axis' if len(axes) == 1 else 'axes'} {', '.join(axes)}"


def _axes(model: Model) -> Iterator[tuple[str, str, str]]:
    """Yield each axis with its line and its unit id; none from a relay of an older release."""
    for name, line in model.lines.items():
        for axis, unit_id in line.unit_ids.axes.items():
            yield name, str(unit_id), axis


def _of_relay(model: Model) -> Iterator[Alarm]:
    gateway, axes = model.gateway, tuple(model.axes)
    age_s = gateway.snapshot_age_s
    if gateway.relay != "up":
        yield Alarm(kinds.RELAY_DOWN, (), "gateway", kinds.RELAY_DOWN.description, axes)
    elif age_s is not None and age_s > STALE_S:
        what = Text("the relay has reported nothing for {span}: the machine may not obey", span=span(age_s))
        yield Alarm(kinds.RELAY_SILENT, (), "gateway", what, axes, age_s)


def _of_line(name: str, line: LineStatus) -> Iterator[Alarm]:
    source_path, where = (name,), f"line {name}"
    axes = tuple(line.unit_ids.axes)
    if line.state != "up":
        failure = line.drives.failure
        what = Text(
            "the drives at {address} cannot be reached{failure}",
            address=line.drives.address,
            failure=f": {failure}" if failure else "",
        )
        yield Alarm(kinds.LINE_DOWN, source_path, where, what, axes)
    if echo := line.drives.echo:
        yield Alarm(kinds.ADAPTER_ECHOES, source_path, where, f"{line.drives.address}: {echo}", axes)
    malformed = line.minute.malformed
    if malformed:
        what = Text(
            "{count} replies of the drives at {address} had a header of impossible length in the last "
            "minute; each closed its connection",
            count=malformed,
            address=line.drives.address,
        )
        yield Alarm(kinds.DRIVE_MALFORMED, source_path, where, what, axes)
    yield from _of_drives(name, line.unit_ids)
    yield from _of_damage(name, line)
    for controller in line.controllers:
        yield from _of_controller(name, controller, line.unit_ids)
    yield from _of_silence(name, line, axes)
    yield from _of_unit_ids(name, line)


def _of_drives(line: str, unit_ids: UnitIds) -> Iterator[Alarm]:
    """Yield an alarm for unit ids that do not answer, and for those whose replies cannot be decoded."""
    for unit_id, drive in unit_ids.drives.items():
        silent_s, asked = drive.silent_s, drive.timeouts_in_a_row
        if silent_s is None or silent_s < SILENT_S:
            continue
        axes = tuple(name for name, of in unit_ids.axes.items() if str(of) == unit_id)
        source_path = (line, unit_id)
        tried = "" if drive.tried_again_s is None else Text(": only an occasional trial is sent")
        newest = min(asked, NEWEST)
        other_ids = drive.other_ids_in_a_row
        if other_ids and other_ids >= INSTEAD_SHARE * newest:
            where = _axes_named(axes) if axes else f"line {line}, unit id {unit_id}"
            what = Text(
                "{whose} {answers}: no valid reply for {span}{tried}",
                whose=Text("its drive (unit id {unit_id})", unit_id=unit_id)
                if axes
                else Text("unit id {unit_id}, which has no axis,", unit_id=unit_id),
                answers=drive.answers_with,
                span=span(silent_s),
                tried=tried,
            )
            yield Alarm(kinds.OTHER_ID, source_path, where, what, axes, silent_s)
            continue
        if not axes:
            what = Text(
                "no device has answered as unit id {unit_id}, which has no axis, for {span}{tried}",
                unit_id=unit_id,
                span=span(silent_s),
                tried=tried,
            )
            if asked >= FEWEST_ASKED:
                yield Alarm(
                    kinds.UNIT_SILENT, source_path, f"line {line}, unit id {unit_id}", what, (), silent_s
                )
            continue
        where, values = _axes_named(axes), {"unit_id": unit_id, "span": span(silent_s), "tried": tried}
        if drive.answered_s is None:
            what = Text("its drive (unit id {unit_id}) has never answered in {span}{tried}", **values)
        else:
            what = Text("its drive (unit id {unit_id}) has not answered for {span}{tried}", **values)
        yield Alarm(kinds.DRIVE_SILENT, source_path, where, what, axes, silent_s)
        damaged = drive.damaged_in_a_row
        if damaged and damaged >= INSTEAD_SHARE * newest:
            what = Text(
                "its drive (unit id {unit_id}) has sent no valid frame for {span}: {damaged} of {newest} "
                "replies were damaged",
                unit_id=unit_id,
                span=span(silent_s),
                damaged=damaged,
                newest=newest,
            )
            yield Alarm(kinds.DRIVE_GARBLED, source_path, where, what, axes, silent_s)


NEWEST: Final = 32
"""The relay knows what was damaged for this many of the unanswered requests in a row."""


def _of_damage(line: str, status: LineStatus) -> Iterator[Alarm]:
    """Yield an alarm for each unit id with many damaged replies."""
    frames = status.minute.exchanges + status.minute.damaged
    for unit_id, drive in status.unit_ids.drives.items():
        damaged = drive.damaged_minute
        if damaged >= FEWEST_DAMAGED and damaged >= DAMAGED_SHARE * frames:
            axes = tuple(name for name, of in status.unit_ids.axes.items() if str(of) == unit_id)
            whose = f" ({', '.join(f'axis {axis}' for axis in axes)})" if axes else ""
            what = Text(
                "{damaged} replies of unit id {unit_id}{whose} were damaged in the last minute, of {frames} "
                "on the line",
                damaged=damaged,
                unit_id=unit_id,
                whose=whose,
                frames=frames,
            )
            where = f"line {line}, unit id {unit_id}"
            yield Alarm(kinds.DRIVE_DAMAGED, (line, unit_id), where, what, axes)


def _of_controller(line: str, controller: ControllerStatus, unit_ids: UnitIds) -> Iterator[Alarm]:
    name = controller.name
    source_path, where = (line, f"controller {name}"), f"line {line}, controller {name}"
    axes = tuple(unit_ids.axes) if controller.role == "motion" else ()
    if controller.state == "down" and controller.role == "motion":
        failure = f": {controller.failure}" if controller.failure else ""
        what = Text("{address} is not open{failure}", address=controller.address, failure=failure)
        yield Alarm(kinds.PORT_CLOSED, source_path, where, what, axes)
    if echo := controller.echo:
        yield Alarm(kinds.ADAPTER_ECHOES, source_path, where, f"{controller.address}: {echo}", axes)
    whole, damaged, minute = controller.whole, controller.damaged, controller.minute
    if whole is not UNSET and damaged is not UNSET and minute is not UNSET:
        frames = minute.whole + minute.damaged
        if not whole and damaged >= FEWEST_DAMAGED:
            what = Text(
                "all {damaged} frames from {address} were damaged",
                damaged=damaged,
                address=controller.address,
            )
            yield Alarm(kinds.CONTROLLER_GARBLED, source_path, where, what, axes)
        if minute.damaged >= FEWEST_DAMAGED and minute.damaged >= DAMAGED_SHARE * frames:
            what = Text(
                "{damaged} of {frames} frames from {address} were damaged in the last minute",
                damaged=minute.damaged,
                frames=frames,
                address=controller.address,
            )
            yield Alarm(kinds.CONTROLLER_DAMAGED, source_path, where, what, axes)
    asked = unit_ids.asked_by.get(name, [])
    strangers = [of for of in asked if of in unit_ids.strangers]
    if strangers and strangers == asked and unit_ids.axes and controller.role == "motion":
        what = Text(
            "it addresses only unit id {ids}, which has no axis; the axes are {there}",
            ids=", ".join(map(str, strangers)),
            there=", ".join(f"axis {axis} (unit id {of})" for axis, of in unit_ids.axes.items()),
        )
        yield Alarm(kinds.UNHEARD_CONTROLLER, source_path, where, what, axes)


def _of_silence(name: str, line: LineStatus, axes: tuple[str, ...]) -> Iterator[Alarm]:
    """Yield an alarm for controllers that should poll and send no requests.

    A controller with its own ``silent_after_s`` is judged by that. The other motion controllers of a
    line count together: one of them that sends requests is enough.
    """
    controllers = line.controllers
    for controller in controllers:
        limit_s, silent_s = controller.silent_after_s, controller.silent_s
        if limit_s and silent_s is not UNSET and silent_s >= limit_s:
            where = f"line {name}, controller {controller.name}"
            yield _silent((controller,), (name, f"controller {controller.name}"), where, axes)
    moving = [each for each in controllers if each.role == "motion" and each.silent_s is not UNSET]
    bound = tuple(each for each in moving if each.silent_after_s is None)
    if bound and _silent_s(moving) >= CONTROLLER_SILENT_S:
        if len(bound) == 1:
            where = f"line {name}, controller {bound[0].name}"
            yield _silent(bound, (name, f"controller {bound[0].name}"), where, axes)
        else:
            yield _silent(bound, (name,), f"line {name}", axes)


def _silent_s(controllers: Sequence[ControllerStatus]) -> float:
    return min(each.silent_s for each in controllers if each.silent_s is not UNSET)


def _silent(
    controllers: Sequence[ControllerStatus], source_path: SourcePath, where: str, axes: tuple[str, ...]
) -> Alarm:
    silent_s = _silent_s(controllers)
    is_there = any(
        each.state == "up" if each.connections is UNSET else each.connections for each in controllers
    )
    has_asked = any(each.asked_s is not None for each in controllers)
    if has_asked:
        since = Text("for {span}", span=span(silent_s))
    else:
        since = Text("since the gateway was started {span} ago", span=span(silent_s))
    names = ", ".join(each.name for each in controllers)
    if len(controllers) > 1 and is_there:
        what = Text("none of {names} has sent a request {since}", names=names, since=since)
    elif len(controllers) > 1:
        what = Text(
            "no controller: none of {names} is connected or has sent a request {since}",
            names=names,
            since=since,
        )
    elif not is_there:
        what = Text("no controller: it is not connected and has sent no request {since}", since=since)
    elif controllers[0].connections is not UNSET:
        what = Text("it is connected but has sent no request {since}", since=since)
    else:
        what = Text("its port is open but it has sent no request {since}", since=since)
    entry = kinds.CONTROLLER_SILENT if is_there else kinds.CONTROLLER_ABSENT
    return Alarm(entry, source_path, where, what, axes, silent_s)


def _of_unit_ids(name: str, line: LineStatus) -> Iterator[Alarm]:
    """Yield an alarm for addressed unit ids that no axis has, and for axes that no controller addresses."""
    source_path, where = (name,), f"line {name}"
    unit_ids = line.unit_ids
    strangers = ", ".join(map(str, unit_ids.strangers))
    unheard = {name: of for name, of in unit_ids.axes.items() if of not in unit_ids.heard}
    if strangers and unheard:
        axes = ", ".join(f"axis {name} (unit_id {of})" for name, of in unheard.items())
        what = Text(
            "controllers address unit id {strangers}, which has no axis; {axes} gets no requests",
            strangers=strangers,
            axes=axes,
        )
        yield Alarm(kinds.WRONG_UNIT_ID, source_path, where, what, tuple(unheard))
    if unit_ids.requests:
        heard = ", ".join(f"{of} ({count} requests)" for of, count in unit_ids.requests.items())
        what = Text("controllers address unit id {heard}, which has no axis", heard=heard)
        yield Alarm(kinds.UNKNOWN_UNIT, source_path, where, what)
    if line.wrong_units:
        what = Text("{count} replies had another unit id than requested", count=line.wrong_units)
        yield Alarm(kinds.ANSWERS_AS, source_path, where, what)


_GAIN_IS_0: Final = Text("the gain is 0: positions pass uncorrected")
_OF_COMPENSATION: Final = {entry.kind: entry for entry in kinds.OF_COMPENSATION}


def _of_axis(name: str, axis: AxisStatus, source_path: SourcePath) -> Iterator[Alarm]:
    where, table, its = f"axis {name}", axis.table, (name,)
    what: str
    if table.status == "rejected":
        error, points = table.error, table.points
        if points:
            what = Text("{error} (the last good table of {points} points stays)", error=error, points=points)
        else:
            what = Text("{error} (no table)", error=error)
        yield Alarm(kinds.TABLE_REJECTED, source_path, where, what, its)
    elif table.status == "removed":
        gone = Text("{file} is missing: positions pass uncorrected", file=table.file)
        yield Alarm(kinds.TABLE_REMOVED, source_path, where, table.error or gone, its)
    if table.is_overdue is True:
        waiting = Text(
            "{file} is not taken: for more than 30 s it has changed, or a program has had it open for "
            "writing",
            file=table.file,
        )
        yield Alarm(kinds.TABLE_WAITING, source_path, where, waiting, its)
    if (entry := _of_compensation(axis)) is not None:
        is_zero = entry is kinds.OFF and not (axis.gain.forward or axis.gain.backward)
        yield Alarm(entry, source_path, where, _GAIN_IS_0 if is_zero else entry.description, its)
    yield from _of_gain(name, axis, source_path)
    if axis.reads_uncorrected:
        yield Alarm(kinds.RECORD_NOT_USED, source_path, where, kinds.RECORD_NOT_USED.description, its)
    if axis.record_problem:
        what = Text("{problem}: a restart begins without its record", problem=axis.record_problem)
        yield Alarm(kinds.RECORD_NOT_KEPT, source_path, where, what, its)
    yield from _of_writer_conflict(name, axis.rivals, source_path)
    yield from _of_group(name, axis, source_path)
    if axis.latency.is_over_budget:
        budget = f"{axis.latency.budget_us:g}"
        what = Text("the gateway takes longer than budget_us = {budget}", budget=budget)
        yield Alarm(kinds.OVER_BUDGET, source_path, where, what, its)
    for entry, what in () if axis.terms is None else _of_terms(axis.terms):
        yield Alarm(entry, source_path, where, what, its)


def _of_compensation(axis: AxisStatus) -> AlarmEntry | None:
    """Return the alarm that explains the state of the compensation; None: it is as it should be.

    An axis without a table whose configuration says "off" is not to be corrected. One that was switched off
    otherwise cannot be switched on: what it needs is a table.
    """
    has_table = axis.table.points or axis.table.file
    if axis.compensation == kinds.OFF.kind and not has_table:
        return None if axis.configured.get("compensation") == "off" else kinds.NO_TABLE
    return _OF_COMPENSATION.get(axis.compensation)


def _of_gain(name: str, axis: AxisStatus, source_path: SourcePath) -> Iterator[Alarm]:
    """Yield an alarm for a gain that a command has set, if there is a table to which it applies."""
    if not axis.table.points or "gain" not in axis.configured:
        return
    configured = Shares(**axis.configured["gain"])
    if axis.gain != configured:
        what = Text(
            "the gain is {gain}; the configuration says {configured}",
            gain=_gain(axis.gain),
            configured=_gain(configured),
        )
        yield Alarm(kinds.GAIN_DIFFERS, source_path, f"axis {name}", what, (name,))


def _gain(gain: Shares) -> str:
    forward, backward = f"{gain.forward:g}", f"{gain.backward:g}"
    if forward == backward:
        return forward
    return Text("{forward} forward and {backward} backward", forward=forward, backward=backward)


def _of_group(name: str, axis: AxisStatus, source_path: SourcePath) -> Iterator[Alarm]:
    group = axis.group
    if group is None:
        return
    if group.is_skewed:
        skew = group.skew
        what = Text(
            "not all axes of its group have moved: the beam is skewed {by}",
            by=Text("by an unknown amount")
            if skew is None
            else Text("by {skew}", skew=f"{skew:+.6g} {axis.units}"),
        )
        yield Alarm(kinds.GROUP_SKEWED, source_path, f"axis {name}", what, (name,))
    if group.is_put_off:
        yield Alarm(kinds.GROUP_HELD, source_path, f"axis {name}", kinds.GROUP_HELD.description, (name,))


def _of_writer_conflict(
    name: str, conflict: WriterConflictStatus | None, source_path: SourcePath
) -> Iterator[Alarm]:
    if conflict is None or conflict.refused + conflict.changes < FEWEST_TRIES:
        return
    one, other = conflict.writers
    refused = Text("{count} requests were refused", count=conflict.refused)
    changed = Text("control changed {count} times", count=conflict.changes)
    if conflict.refused and conflict.changes:
        counted = Text("{one}, {other}", one=refused, other=changed)
    else:
        counted = refused if conflict.refused else changed
    what = Text(
        "{one} and {other} both try to move it: {counted} in {span}",
        one=one,
        other=other,
        counted=counted,
        span=span(conflict.since_s),
    )
    yield Alarm(kinds.TWO_WRITERS, source_path, f"axis {name}", what, (name,), conflict.since_s)


_OF_SENSOR: Final = {
    "waiting": Text("no temperature since the start: no thermal correction"),
    "held": Text("the temperature sensor gives no value: the last one is held"),
    "fading": Text("the temperature sensor gives no value: the thermal correction returns to 0"),
    "faded": Text("the temperature sensor gives no value: no thermal correction"),
}
_OF_OTHERS: Final = {
    "fading": Text("its correction returns to 0"),
    "faded": Text("its correction is 0"),
}
""""held" is not an alarm yet: any stop of an axis that is not polled causes it, until the next target."""


def _of_terms(terms: TermsStatus) -> Iterable[tuple[AlarmEntry, str]]:
    thermal, cross = terms.thermal, terms.cross
    if thermal and thermal.is_silent:
        yield kinds.SENSOR_SILENT, _OF_SENSOR.get(thermal.state, kinds.SENSOR_SILENT.description)
    if cross and cross.state in _OF_OTHERS:
        what = Text(
            "the position of {axes} is unknown; {then}",
            axes=_named(cross.axes),
            then=_OF_OTHERS[cross.state],
        )
        yield kinds.OTHER_AXIS_UNKNOWN, what
    if terms.is_too_large:
        what = Text(
            "table, temperature and other axes together exceed max_correction; the last two no longer follow"
        )
        yield kinds.TERM_TOO_LARGE, what


def _named(axes: Sequence[str]) -> Text:
    """Return the axes whose position is not known. With several of them, only the sum is unknown.

    >>> _named(["y"]), _named(["y", "z"])
    ('axis y', 'one of the axes y, z')
    """
    if len(axes) == 1:
        return Text("axis {axis}", axis=axes[0])
    return Text("one of the axes {axes}", axes=", ".join(axes))


_OF_AXES: Final = (kinds.CONFIGURATION, kinds.TABLES_FOLDER, kinds.STATE_FOLDER)
"""Alarms of the supervisor that concern an axis: which table it has, and which data survive a start."""


def _of_supervisor(supervisor: SupervisorStatus | None, axes: tuple[str, ...]) -> Iterator[Alarm]:
    if supervisor is None:
        yield Alarm(
            kinds.SUPERVISOR_DOWN, ("supervisor",), "supervisor", kinds.SUPERVISOR_DOWN.description, axes
        )
        return
    for entry in kinds.OF_SUPERVISOR:
        problem = getattr(supervisor, entry.kind).problem
        if problem:
            its = axes if entry in _OF_AXES else ()
            yield Alarm(entry, (entry.kind,), entry.kind.replace("_", " "), problem, its)
