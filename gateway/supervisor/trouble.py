"""What is wrong right now, worked out of the status model, worst first: what, where, since when, what to do.

The page's banner, the terminal, ``/healthz``, MQTT, metrics and alerts all show this list, and
``supervisor.verdict`` makes one word of it. What only follows from something worse is left out as long as
that lasts (``catalogue.troubles.HIDES``).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from msgspec import UNSET

from gateway.catalogue import troubles as kinds
from gateway.catalogue.entry import Severity, TroubleEntry
from gateway.catalogue.said import Said, said
from gateway.catalogue.troubles import CONTROLLER_SILENT_S, FEWEST_ASKED, SILENT_S
from gateway.status.axis import AxisStatus, AxisTrouble, RivalsStatus, TermsStatus
from gateway.status.line import ControllerStatus, LineStatus, UnitIds
from gateway.status.model import AcknowledgedBy, Model, SupervisorStatus, TroubleStatus
from gateway.times import span

STALE_S: Final = 2.0
"""Snapshots come five times a second: after this the relay is there but says nothing."""
INSTEAD_SHARE: Final = 0.5
"""To so many of the unanswered requests something came that is no reply: the drive is there, and speaks
another way."""
FEWEST_DAMAGED: Final = 3
"""Less in a minute, or ever, is chance."""
DAMAGED_SHARE: Final = 0.01
"""Of the frames of a minute; on a good wire there is none in days."""
FEWEST_TRIES: Final = 3
"""Times that another one wanted an axis within a minute: once is a mistake, more are two programs."""
_ORDER: Final = {kind: number for number, kind in enumerate(kinds.TROUBLES)}

Place = tuple[str, ...]
"""From outside to inside: nothing for the gateway; a line; on it a unit id, or a controller; an axis."""


@dataclass(frozen=True, slots=True)
class Trouble:
    """One thing that is wrong."""

    entry: TroubleEntry
    place: Place
    where: str
    """In words: ``gateway``, ``line NAME``, ``line NAME, controller NAME``, ``axis NAME``, ``mqtt``, …"""
    what: str
    axes: tuple[str, ...] = ()
    """Axes whose state it says."""
    age_s: float | None = None
    """For how long, where what it is told from says so; else from when it is seen first."""

    @property
    def key(self) -> tuple[str, str]:
        """What makes it the same trouble as a moment ago."""
        return self.entry.kind, self.where

    @property
    def place_key(self) -> tuple[str, Place]:
        """The same without words: what stays when the words change."""
        return self.entry.kind, self.place

    def hides(self, entry: TroubleEntry, place: Place) -> bool:
        """Whether a trouble of a kind at a place only follows from this one."""
        is_within = place[: len(self.place)] == self.place
        return is_within and entry in kinds.HIDES.get(self.entry, ())

    def of_axis(self) -> AxisTrouble:
        """Return what an axis shows of it."""
        return AxisTrouble(
            kind=self.entry.kind,
            severity=self.entry.severity.value,
            title=self.entry.title,
            cuts_off=self.entry.cuts_off,
        )

    def status(self, since: str, acknowledged: AcknowledgedBy | None) -> TroubleStatus:
        """Return what the status says of it; ``since`` as ISO 8601."""
        return TroubleStatus(
            kind=self.entry.kind,
            severity=self.entry.severity.value,
            where=self.where,
            what=str(self.what),
            says=said(self.what),
            remedy=self.entry.remedy,
            since=since,
            axes=list(self.axes),
            acknowledged=acknowledged,
        )


def troubles(model: Model) -> list[Trouble]:
    """Return everything that is wrong, errors first, without what only follows from it."""
    places = {axis: (line, unit_id, axis) for line, unit_id, axis in _axes(model)}
    found = [
        *_of_relay(model),
        *(trouble for name, line in model.lines.items() for trouble in _of_line(name, line)),
        *(
            trouble
            for name, axis in model.axes.items()
            for trouble in _of_axis(name, axis, places.get(name, ("?", "?", name)))
        ),
        *_of_supervisor(model.supervisor, tuple(model.axes)),
    ]
    causes = [
        trouble for trouble in found if not any(other.hides(trouble.entry, trouble.place) for other in found)
    ]
    return sorted(
        causes, key=lambda each: (each.entry.severity is not Severity.ERROR, _ORDER[each.entry.kind])
    )


def is_hidden(kind: str, place: Place, found: Sequence[Trouble]) -> bool:
    """Whether nobody would be told of a kind of trouble at a place, because of what is found."""
    entry = kinds.TROUBLES.get(kind)
    return entry is not None and any(other.hides(entry, place) for other in found)


def is_fresh(model: Model) -> bool:
    """Whether what the relay told is of now: nobody may take an old position for the place of a machine."""
    gateway = model.gateway
    age_s = gateway.snapshot_age_s
    return gateway.relay == "up" and age_s is not None and age_s <= STALE_S


def of_axis(found: Sequence[Trouble], axis: str) -> Trouble | None:
    """Return the worst that says something of an axis; None: nothing is wrong with it."""
    return next((trouble for trouble in found if axis in trouble.axes), None)


def _axes_named(axes: Sequence[str]) -> str:
    return f"{'axis' if len(axes) == 1 else 'axes'} {', '.join(axes)}"


def _axes(model: Model) -> Iterator[tuple[str, str, str]]:
    """Yield each axis with its line and its unit id; none of a relay of an older release."""
    for name, line in model.lines.items():
        for axis, unit_id in line.unit_ids.axes.items():
            yield name, str(unit_id), axis


def _of_relay(model: Model) -> Iterator[Trouble]:
    gateway, axes = model.gateway, tuple(model.axes)
    age_s = gateway.snapshot_age_s
    if gateway.relay != "up":
        yield Trouble(kinds.RELAY_DOWN, (), "gateway", kinds.RELAY_DOWN.meaning, axes)
    elif age_s is not None and age_s > STALE_S:
        what = Said("the relay has reported nothing for {span}: the machine may not obey", span=span(age_s))
        yield Trouble(kinds.RELAY_SILENT, (), "gateway", what, axes, age_s)


def _of_line(name: str, line: LineStatus) -> Iterator[Trouble]:
    place, where = (name,), f"line {name}"
    axes = tuple(line.unit_ids.axes)
    if line.state != "up":
        failure = line.drives.failure
        what = Said(
            "the drives at {address} cannot be reached{failure}",
            address=line.drives.address,
            failure=f": {failure}" if failure else "",
        )
        yield Trouble(kinds.LINE_DOWN, place, where, what, axes)
    if echo := line.drives.echo:
        yield Trouble(kinds.ADAPTER_ECHOES, place, where, f"{line.drives.address}: {echo}", axes)
    malformed = line.minute.malformed
    if malformed:
        what = Said(
            "{count} replies of the drives at {address} had a header of impossible length in the last "
            "minute; each closed its connection",
            count=malformed,
            address=line.drives.address,
        )
        yield Trouble(kinds.DRIVE_MALFORMED, place, where, what, axes)
    yield from _of_drives(name, line.unit_ids)
    yield from _of_damage(name, line)
    for controller in line.controllers:
        yield from _of_controller(name, controller, line.unit_ids)
    yield from _of_silence(name, line, axes)
    yield from _of_unit_ids(name, line)


def _of_drives(line: str, unit_ids: UnitIds) -> Iterator[Trouble]:
    """Say which unit ids do not answer, and which of them cannot be understood."""
    for unit_id, drive in unit_ids.drives.items():
        silent_s, asked = drive.silent_s, drive.timeouts_in_a_row
        if silent_s is None or silent_s < SILENT_S:
            continue
        axes = tuple(name for name, of in unit_ids.axes.items() if str(of) == unit_id)
        place = (line, unit_id)
        tried = "" if drive.tried_again_s is None else Said(": only an occasional trial is sent")
        newest = min(asked, NEWEST)
        other_ids = drive.other_ids_in_a_row
        if other_ids and other_ids >= INSTEAD_SHARE * newest:
            where = _axes_named(axes) if axes else f"line {line}, unit id {unit_id}"
            what = Said(
                "{whose} {answers}: no valid reply for {span}{tried}",
                whose=Said("its drive (unit id {unit_id})", unit_id=unit_id)
                if axes
                else Said("unit id {unit_id}, which has no axis,", unit_id=unit_id),
                answers=drive.answers_with,
                span=span(silent_s),
                tried=tried,
            )
            yield Trouble(kinds.OTHER_ID, place, where, what, axes, silent_s)
            continue
        if not axes:
            what = Said(
                "no device has answered as unit id {unit_id}, which has no axis, for {span}{tried}",
                unit_id=unit_id,
                span=span(silent_s),
                tried=tried,
            )
            if asked >= FEWEST_ASKED:
                yield Trouble(kinds.UNIT_SILENT, place, f"line {line}, unit id {unit_id}", what, (), silent_s)
            continue
        where, values = _axes_named(axes), {"unit_id": unit_id, "span": span(silent_s), "tried": tried}
        if drive.answered_s is None:
            what = Said("its drive (unit id {unit_id}) has never answered in {span}{tried}", **values)
        else:
            what = Said("its drive (unit id {unit_id}) has not answered for {span}{tried}", **values)
        yield Trouble(kinds.DRIVE_SILENT, place, where, what, axes, silent_s)
        damaged = drive.damaged_in_a_row
        if damaged and damaged >= INSTEAD_SHARE * newest:
            what = Said(
                "its drive (unit id {unit_id}) has sent no valid frame for {span}: {damaged} of {newest} "
                "replies were damaged",
                unit_id=unit_id,
                span=span(silent_s),
                damaged=damaged,
                newest=newest,
            )
            yield Trouble(kinds.DRIVE_GARBLED, place, where, what, axes, silent_s)


NEWEST: Final = 32
"""So many of the unanswered requests in a row the relay knows the damage of."""


def _of_damage(line: str, status: LineStatus) -> Iterator[Trouble]:
    """Say of which unit ids many answers are damaged."""
    frames = status.minute.exchanges + status.minute.damaged
    for unit_id, drive in status.unit_ids.drives.items():
        damaged = drive.damaged_minute
        if damaged >= FEWEST_DAMAGED and damaged >= DAMAGED_SHARE * frames:
            axes = tuple(name for name, of in status.unit_ids.axes.items() if str(of) == unit_id)
            whose = f" ({', '.join(f'axis {axis}' for axis in axes)})" if axes else ""
            what = Said(
                "{damaged} replies of unit id {unit_id}{whose} were damaged in the last minute, of {frames} "
                "on the line",
                damaged=damaged,
                unit_id=unit_id,
                whose=whose,
                frames=frames,
            )
            where = f"line {line}, unit id {unit_id}"
            yield Trouble(kinds.DRIVE_DAMAGED, (line, unit_id), where, what, axes)


def _of_controller(line: str, controller: ControllerStatus, unit_ids: UnitIds) -> Iterator[Trouble]:
    name = controller.name
    place, where = (line, f"controller {name}"), f"line {line}, controller {name}"
    axes = tuple(unit_ids.axes) if controller.role == "motion" else ()
    if controller.state == "down" and controller.role == "motion":
        failure = f": {controller.failure}" if controller.failure else ""
        what = Said("{address} is not open{failure}", address=controller.address, failure=failure)
        yield Trouble(kinds.PORT_CLOSED, place, where, what, axes)
    if echo := controller.echo:
        yield Trouble(kinds.ADAPTER_ECHOES, place, where, f"{controller.address}: {echo}", axes)
    whole, damaged, minute = controller.whole, controller.damaged, controller.minute
    if whole is not UNSET and damaged is not UNSET and minute is not UNSET:
        frames = minute.whole + minute.damaged
        if not whole and damaged >= FEWEST_DAMAGED:
            what = Said(
                "all {damaged} frames from {address} were damaged",
                damaged=damaged,
                address=controller.address,
            )
            yield Trouble(kinds.CONTROLLER_GARBLED, place, where, what, axes)
        if minute.damaged >= FEWEST_DAMAGED and minute.damaged >= DAMAGED_SHARE * frames:
            what = Said(
                "{damaged} of {frames} frames from {address} were damaged in the last minute",
                damaged=minute.damaged,
                frames=frames,
                address=controller.address,
            )
            yield Trouble(kinds.CONTROLLER_DAMAGED, place, where, what, axes)
    asked = unit_ids.asked_by.get(name, [])
    strangers = [of for of in asked if of in unit_ids.strangers]
    if strangers and strangers == asked and unit_ids.axes and controller.role == "motion":
        what = Said(
            "it addresses only unit id {ids}, which has no axis; the axes are {there}",
            ids=", ".join(map(str, strangers)),
            there=", ".join(f"axis {axis} (unit id {of})" for axis, of in unit_ids.axes.items()),
        )
        yield Trouble(kinds.UNHEARD_CONTROLLER, place, where, what, axes)


def _of_silence(name: str, line: LineStatus, axes: tuple[str, ...]) -> Iterator[Trouble]:
    """Say which controllers ought to be there and ask for nothing.

    A controller with a ``silent_after_s`` of its own is held to that. The other motion controllers of a line
    count together: the line has one as long as any motion controller asks.
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
    controllers: Sequence[ControllerStatus], place: Place, where: str, axes: tuple[str, ...]
) -> Trouble:
    silent_s = _silent_s(controllers)
    is_there = any(
        each.state == "up" if each.connections is UNSET else each.connections for each in controllers
    )
    has_asked = any(each.asked_s is not None for each in controllers)
    if has_asked:
        since = Said("for {span}", span=span(silent_s))
    else:
        since = Said("since the gateway was started {span} ago", span=span(silent_s))
    names = ", ".join(each.name for each in controllers)
    if len(controllers) > 1 and is_there:
        what = Said("none of {names} has sent a request {since}", names=names, since=since)
    elif len(controllers) > 1:
        what = Said(
            "no controller: none of {names} is connected or has sent a request {since}",
            names=names,
            since=since,
        )
    elif not is_there:
        what = Said("no controller: it is not connected and has sent no request {since}", since=since)
    elif controllers[0].connections is not UNSET:
        what = Said("it is connected but has sent no request {since}", since=since)
    else:
        what = Said("its port is open but it has sent no request {since}", since=since)
    entry = kinds.CONTROLLER_SILENT if is_there else kinds.CONTROLLER_ABSENT
    return Trouble(entry, place, where, what, axes, silent_s)


def _of_unit_ids(name: str, line: LineStatus) -> Iterator[Trouble]:
    """Say whom controllers talk to that is no axis, and which axis they do not talk to."""
    place, where = (name,), f"line {name}"
    unit_ids = line.unit_ids
    strangers = ", ".join(map(str, unit_ids.strangers))
    unheard = {name: of for name, of in unit_ids.axes.items() if of not in unit_ids.heard}
    if strangers and unheard:
        axes = ", ".join(f"axis {name} (unit_id {of})" for name, of in unheard.items())
        what = Said(
            "controllers address unit id {strangers}, which has no axis; {axes} gets no requests",
            strangers=strangers,
            axes=axes,
        )
        yield Trouble(kinds.WRONG_UNIT_ID, place, where, what, tuple(unheard))
    if unit_ids.requests:
        heard = ", ".join(f"{of} ({count} requests)" for of, count in unit_ids.requests.items())
        what = Said("controllers address unit id {heard}, which has no axis", heard=heard)
        yield Trouble(kinds.UNKNOWN_UNIT, place, where, what)
    if line.wrong_units:
        what = Said("{count} replies had another unit id than requested", count=line.wrong_units)
        yield Trouble(kinds.ANSWERS_AS, place, where, what)


_OF_COMPENSATION: Final = {entry.kind: entry for entry in kinds.OF_COMPENSATION}


def _of_axis(name: str, axis: AxisStatus, place: Place) -> Iterator[Trouble]:
    where, table, its = f"axis {name}", axis.table, (name,)
    what: str
    if table.status == "rejected":
        error, points = table.error, table.points
        if points:
            what = Said("{error} (the last good table of {points} points stays)", error=error, points=points)
        else:
            what = Said("{error} (no table)", error=error)
        yield Trouble(kinds.TABLE_REJECTED, place, where, what, its)
    elif table.status == "removed":
        gone = Said("{file} is missing: positions pass uncorrected", file=table.file)
        yield Trouble(kinds.TABLE_REMOVED, place, where, table.error or gone, its)
    entry = _OF_COMPENSATION.get(axis.compensation)
    if entry is not None:
        yield Trouble(entry, place, where, entry.meaning, its)
    yield from _of_rivals(name, axis.rivals, place)
    yield from _of_group(name, axis, place)
    if axis.latency.is_over_budget:
        budget = f"{axis.latency.budget_us:g}"
        what = Said("the gateway takes longer than budget_us = {budget}", budget=budget)
        yield Trouble(kinds.OVER_BUDGET, place, where, what, its)
    for entry, what in () if axis.terms is None else _of_terms(axis.terms):
        yield Trouble(entry, place, where, what, its)


def _of_group(name: str, axis: AxisStatus, place: Place) -> Iterator[Trouble]:
    group = axis.group
    if group is None:
        return
    if group.is_skewed:
        skew = group.skew
        what = Said(
            "not all axes of its group have moved: the beam is skewed {by}",
            by=Said("by an unknown amount")
            if skew is None
            else Said("by {skew}", skew=f"{skew:+.6g} {axis.units}"),
        )
        yield Trouble(kinds.GROUP_SKEWED, place, f"axis {name}", what, (name,))
    if group.is_put_off:
        yield Trouble(kinds.GROUP_HELD, place, f"axis {name}", kinds.GROUP_HELD.meaning, (name,))


def _of_rivals(name: str, rivals: RivalsStatus | None, place: Place) -> Iterator[Trouble]:
    if rivals is None or rivals.refused + rivals.changes < FEWEST_TRIES:
        return
    one, other = rivals.writers
    refused = Said("{count} requests were refused", count=rivals.refused)
    changed = Said("control changed {count} times", count=rivals.changes)
    if rivals.refused and rivals.changes:
        counted = Said("{one}, {other}", one=refused, other=changed)
    else:
        counted = refused if rivals.refused else changed
    what = Said(
        "{one} and {other} both try to move it: {counted} in {span}",
        one=one,
        other=other,
        counted=counted,
        span=span(rivals.since_s),
    )
    yield Trouble(kinds.TWO_WRITERS, place, f"axis {name}", what, (name,), rivals.since_s)


_OF_SENSOR: Final = {
    "waiting": Said("no temperature since the start: no thermal correction"),
    "held": Said("the temperature sensor gives no value: the last one is held"),
    "fading": Said("the temperature sensor gives no value: the thermal correction returns to 0"),
    "faded": Said("the temperature sensor gives no value: no thermal correction"),
}
_OF_OTHERS: Final = {
    "fading": Said("its correction returns to 0"),
    "faded": Said("its correction is 0"),
}
"""Held it is no trouble yet: any stop of an axis that is not read does that, until its next target."""


def _of_terms(terms: TermsStatus) -> Iterable[tuple[TroubleEntry, str]]:
    thermal, cross = terms.thermal, terms.cross
    if thermal and thermal.is_silent:
        yield kinds.SENSOR_SILENT, _OF_SENSOR.get(thermal.state, kinds.SENSOR_SILENT.meaning)
    if cross and cross.state in _OF_OTHERS:
        what = Said(
            "the position of {axes} is unknown; {then}",
            axes=_named(cross.axes),
            then=_OF_OTHERS[cross.state],
        )
        yield kinds.OTHER_AXIS_UNKNOWN, what
    if terms.is_too_large:
        what = Said(
            "table, temperature and other axes together exceed max_correction; the last two no longer follow"
        )
        yield kinds.TERM_TOO_LARGE, what


def _named(axes: Sequence[str]) -> Said:
    """Return whose place is not known; of several only the sum is.

    >>> _named(["y"]), _named(["y", "z"])
    ('axis y', 'one of the axes y, z')
    """
    if len(axes) == 1:
        return Said("axis {axis}", axis=axes[0])
    return Said("one of the axes {axes}", axes=", ".join(axes))


_OF_AXES: Final = (kinds.CONFIGURATION, kinds.TABLES_FOLDER, kinds.STATE_FOLDER)
"""What of the supervisor's an axis hangs on: which table it has, and what of it survives a start."""


def _of_supervisor(supervisor: SupervisorStatus | None, axes: tuple[str, ...]) -> Iterator[Trouble]:
    if supervisor is None:
        yield Trouble(
            kinds.SUPERVISOR_DOWN, ("supervisor",), "supervisor", kinds.SUPERVISOR_DOWN.meaning, axes
        )
        return
    for entry in kinds.OF_SUPERVISOR:
        problem = getattr(supervisor, entry.kind).problem
        if problem:
            its = axes if entry in _OF_AXES else ()
            yield Trouble(entry, (entry.kind,), entry.kind.replace("_", " "), problem, its)
