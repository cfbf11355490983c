"""Terminal output of ``pitch-gateway status``: the contents of the status model, and nothing else."""

import shlex
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Final

from msgspec import UNSET
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from gateway.status.axis import Position, Shares, TermsStatus, WholeAxis
from gateway.status.line import LINE_COUNTERS, ControllerStatus, LineStatus, TlsStatus
from gateway.status.model import AlarmOutputStatus, AlarmStatus, GatewayStatus, Model, Verdict
from gateway.status.times import GatewayTimes
from gateway.times import span
from gateway.transport.certificates import SOON

UNKNOWN: Final = "–"
ALWAYS: Final = frozenset({"exchanges", "timeouts"})
"""Counters that are always shown; the others only if they are not 0."""
BY_CERTIFICATE: Final = "by role"
"""In place of a role: certificates have roles of their own, and 80 columns are few."""
OF_VERDICT: Final = {"healthy": "green", "waiting": "cyan", "warning": "yellow", "error": "red"}
OLD: Final = {
    "last-reading": "its position was last read",
    "target": "its position was not read since its target was written",
}
"""Text for a position that is not a present reading."""
COLOURS: Final = {
    "up": "green",
    "active": "green",
    "blending": "green",
    "down": "red",
    "blocked": "red",
    "off": "yellow",
    "outside": "yellow",
    "shadow": "yellow",
    "unreferenced": "yellow",
}
"""Of the states of lines, controllers and axes; others have no colour."""


def status_parts(status: Model, config: Path) -> Iterator[RenderableType]:
    """Yield the parts of a status from top to bottom: state, alarms, gateway, lines, axes.

    ``config`` is the configuration that the commands of remedies name.
    """
    if status.verdict.state:  # absent from the status of an older supervisor
        yield _verdict(status.verdict)
    for alarm in status.troubles:
        yield from _alarm(alarm, config)
    if status.verdict.state or status.troubles:
        yield ""
    yield from _gateway(status.gateway)
    if status.supervisor is not None and status.supervisor.alarm_output.contact is not None:
        yield _contact(status.supervisor.alarm_output)
    for name, line in status.lines.items():
        yield from _line(name, line)
    for make in (_positions, _tables, _times) if status.axes else ():
        yield ""
        yield make(status.axes)
        yield from _ages(status.axes) if make is _positions else ()
    if with_terms := {name: axis.terms for name, axis in status.axes.items() if axis.terms is not None}:
        yield ""
        yield _terms(with_terms)


def _verdict(verdict: Verdict) -> RenderableType:
    colour = OF_VERDICT[verdict.state]
    counts = (("error", verdict.errors), ("warning", verdict.warnings))
    counted = ", ".join(f"{count} {word}{'s' * (count != 1)}" for word, count in counts if count)
    since = f" since {time_of(verdict.since)}"
    return _words(f"[bold {colour}]{verdict.state.upper()}[/]{since}{f': {counted}' if counted else ''}")


def _alarm(alarm: AlarmStatus, config: Path) -> Iterator[RenderableType]:
    colour = "red" if alarm.severity == "error" else "yellow"
    what = f"{escape(alarm.where)}: {escape(alarm.what)}"
    yield _words(f"[bold {colour}]{escape(alarm.severity)}[/] {what}")
    since = f"since {time_of(alarm.since)} " if alarm.since else ""
    yield _words(f"  {since}→ {escape(_typed(alarm, config))}")
    if seen := alarm.acknowledged:
        yield _words(f"  acknowledged by {escape(seen.by)}, {time_of(seen.at)}")


def _typed(alarm: AlarmStatus, config: Path) -> str:
    """Return the remedy of an alarm with commands that can be pasted."""
    remedy = alarm.remedy.replace("CONFIG", shlex.quote(str(config)))
    return remedy.replace(" AXIS", f" {alarm.axes[0]}") if len(alarm.axes) == 1 else remedy


def _gateway(gateway: GatewayStatus) -> Iterator[RenderableType]:
    compiled = ", compiled" if gateway.compiled else ""
    runs = "" if gateway.uptime_s is None else f", runs for {span(gateway.uptime_s)}"
    if gateway.relay != "up":
        age_s = gateway.snapshot_age_s
        seen = "" if age_s is None else f"; the data below is {span(age_s)} old"
        runs = f", [red]its relay is not running[/]{seen}"
    yield _words(f"[bold]gateway {escape(gateway.name)}[/] {escape(gateway.version)}{compiled}{runs}")
    scheduling = gateway.scheduling
    if scheduling is UNSET:  # no relay has reported yet
        return
    priority = f"real-time priority {scheduling.fifo}" if scheduling.fifo else "ordinary priority"
    cpus = ", ".join(map(str, scheduling.cpus))
    memory = "locked" if scheduling.memory_locked else "not locked"
    yield _words(f"  scheduling: {priority}, CPUs {cpus}, memory {memory}")


def _contact(output: AlarmOutputStatus) -> RenderableType:
    state = {True: "[green]closed[/]", False: "[red]open[/]", None: "[yellow]not known[/]"}[output.is_closed]
    return _words(f"  alarm contact: {state}, {escape(output.contact or UNKNOWN)}")


def _line(name: str, line: LineStatus) -> Iterator[RenderableType]:
    drives = line.drives
    failure = f" ({escape(drives.failure)})" if drives.failure else ""
    drives_text = f"drives {escape(drives.address)}{failure}"
    yield ""
    yield _words(f"[bold]line {escape(name)}[/]: {_coloured(line.state)}, {drives_text}")
    counts = [
        f"{declared.words} {getattr(line, key)}"
        for key, declared in LINE_COUNTERS.items()
        if declared.is_shown and (getattr(line, key) or key in ALWAYS)
    ]
    yield _words(f"  {', '.join(counts)}")
    table = new_table("  controller", "role", "connected")
    for heading in ("gateway µs p50", "p99", "max", "computed ms exchange", "round", "time-out"):
        table.add_column(heading, justify="right")
    for controller in line.controllers:
        computed = line.computed.get(controller.name)
        table.add_row(
            f"  {escape(controller.name)}",
            BY_CERTIFICATE if controller.tls is not UNSET else escape(controller.role),
            _connected(controller),
            *_gateway_took(controller.gateway_us),
            _number(None if computed is None else computed.exchange_ms, 2),
            _number(None if computed is None else computed.round_ms, 2),
            UNKNOWN if computed is None else f"{computed.timeout_ms:g}",
        )
    yield table
    for controller in line.controllers:
        yield from _unknown_ids_and_sessions(controller)


def _unknown_ids_and_sessions(controller: ControllerStatus) -> Iterator[RenderableType]:
    """Report a listener's sessions by certificate, certificates that end soon, and refused clients."""
    tls = controller.tls or TlsStatus()
    name = escape(controller.name)
    for session in tls.sessions:
        who = f"{escape(session.subject)}, {escape(session.certified)} ({escape(session.role)})"
        yield _words(f"  {name}: TLS with {escape(session.peer)}, {who}")
    for file in tls.certificates:
        if file.days_left is not None and file.days_left < SOON.days:
            ends = f"is valid until {escape(str(file.ends))}, days left: {file.days_left}"
            yield _words(f"  {name}: [yellow]TLS: {escape(file.file)} {ends}[/]")
    counts = {
        "connections refused": controller.refused_connections,
        "handshakes failed": tls.failed_handshakes,
    }
    shown = [f"{words} {count}" for words, count in counts.items() if count]
    if shown:
        yield _words(f"  {name}: {', '.join(shown)}")


def _words(markup: str) -> Text:
    return Text.from_markup(markup)


def _connected(controller: ControllerStatus) -> str:
    """Return the number of connections, or whether the port is open."""
    if controller.connections is not UNSET:
        return str(len(controller.connections))
    failure = f" ({escape(controller.failure)})" if controller.failure else ""
    return f"{_coloured(controller.state or '')}{failure}"


def _positions(axes: Mapping[str, WholeAxis]) -> Table:
    """Return the positions of the axes: nominal, as for the controller, and on the drive.

    Values that are not present readings are dim; :func:`_ages` reports their age.
    """
    table = new_table("axis", "compensation", "direction")
    for heading in ("target", "on the\ndrive", "actual", "on the\ndrive"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("units", no_wrap=True)
    for name, axis in axes.items():
        position = axis.position or Position(of="reading")
        is_read = position.of == "reading"
        target = [_number(each, 4) for each in (axis.nominal_setpoint, axis.corrected_setpoint)]
        actual = [_number(each, 4) for each in (axis.nominal_actual, axis.corrected_actual)]
        if position.of == "last-reading":
            actual = [_number(each, 4) for each in (position.nominal, position.corrected)]
        table.add_row(
            escape(name),
            _state_of(axis),
            escape(axis.direction),
            *(each if is_read else f"[dim]{each}[/]" for each in (*target, *actual)),
            escape(axis.units),
        )
    return table


def _ages(axes: Mapping[str, WholeAxis]) -> Iterator[RenderableType]:
    """Report the age of positions that are not present readings."""
    for name, axis in axes.items():
        position = axis.position or Position()
        age_s = position.age_s
        if position.of in OLD and age_s is not None:
            at_least = "more than " if position.is_at_least and age_s >= 1.0 else ""
            yield _words(f"  [dim]{escape(name)}: {OLD[position.of]} {at_least}{span(age_s)} ago[/]")


def _state_of(axis: WholeAxis) -> str:
    """Return the state of an axis, in the colour of its verdict."""
    verdict = axis.verdict
    if not verdict.state:
        return _coloured(axis.compensation)
    return f"[{OF_VERDICT[verdict.state]}]{escape(verdict.title or axis.compensation)}[/]"


def _tables(axes: Mapping[str, WholeAxis]) -> Table:
    table = new_table("axis", "table")
    table.add_column("points", justify="right")
    table.add_column("status", overflow="fold")
    table.add_column("moved by", overflow="fold")
    for name, axis in axes.items():
        its = axis.table
        error = f": [red]{escape(its.error)}[/]" if its.error else ""
        table.add_row(
            escape(name),
            escape(its.file or UNKNOWN),
            str(its.points),
            f"{escape(its.status)}{_gain(axis.gain)}{error}",
            escape(axis.writer or UNKNOWN),
        )
    return table


def _gain(gain: Shares) -> str:
    """Return the gain if not all of the table is applied."""
    if gain == Shares():
        return ""
    if gain.forward == gain.backward:
        return f", gain {gain.forward:g}"
    return f", gain {gain.forward:g} forward, {gain.backward:g} backward"


def _terms(axes: Mapping[str, TermsStatus]) -> Table:
    """Return the corrections beside the tables, for axes with thermal or cross."""
    table = new_table("axis")
    for heading in ("added", "temperature", "counts", "sensor", "other axes"):
        table.add_column(heading, justify="right")
    for name, terms in axes.items():
        thermal, cross = terms.thermal, terms.cross
        table.add_row(
            escape(name),
            _number(terms.correction, 4),
            UNKNOWN if thermal is UNSET else f"{_number(thermal.celsius, 1)} °C",
            UNKNOWN if thermal is UNSET else f"{thermal.difference:+.2f} K",
            UNKNOWN if thermal is UNSET else escape(thermal.state),
            UNKNOWN if cross is UNSET else f"{escape(', '.join(cross.axes))}: {escape(cross.state)}",
        )
    return table


def _times(axes: Mapping[str, WholeAxis]) -> Table:
    """Return the gateway's time for each axis, both directions together, and its limit."""
    table = new_table("axis, gateway µs")
    for heading in ("p50", "p99", "max", "of the last minute", "budget", "overruns"):
        table.add_column(heading, justify="right")
    for name, axis in axes.items():
        latency = axis.latency
        overruns = str(latency.budget_overruns)
        table.add_row(
            escape(name),
            *_gateway_took(latency.gateway_us),
            _micros(latency.gateway_us.max_minute),
            _number(latency.budget_us, 0),
            f"[red]{overruns}[/]" if latency.is_over_budget else overruns,
        )
    return table


def new_table(*headings: str) -> Table:
    """Return a table whose first column holds names: these are never wrapped, however narrow it gets."""
    table = Table(box=None, padding=(0, 1), collapse_padding=True, pad_edge=False, header_style="bold")
    for number, heading in enumerate(headings):
        table.add_column(heading, overflow="fold", no_wrap=number == 0)
    return table


def _coloured(state: str) -> str:
    colour = COLOURS.get(state)
    return f"[{colour}]{state}[/]" if colour else escape(state)


def _gateway_took(us: GatewayTimes) -> tuple[str, str, str]:
    return _micros(us.p50), _micros(us.p99), _micros(us.max)


def _micros(us: float | None) -> str:
    return _number(us, 1 if us is not None and us < 1000.0 else 0)


def _number(value: float | None, digits: int) -> str:
    return UNKNOWN if value is None else f"{value:.{digits}f}"


def time_of(iso: str) -> str:
    """Return a time on this machine's clock, with the date if it is another day."""
    then = datetime.fromisoformat(iso).astimezone()
    is_today = then.date() == datetime.now().astimezone().date()
    return f"{then:%H:%M:%S}" if is_today else f"{then:%Y-%m-%d %H:%M:%S}"
