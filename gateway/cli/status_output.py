"""What ``pitch-gateway status`` shows on a terminal: what the status model holds, and nothing else."""

from collections.abc import Iterator, Mapping
from datetime import datetime
from typing import Any, Final

from rich.console import Console, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from gateway.catalogue.counters import COUNTERS
from gateway.times import span
from gateway.transport.certificates import SOON

NOT_KNOWN: Final = "–"
SHOWN: Final = (
    "exchanges",
    "timeouts",
    "exceptions",
    "refused",
    "late_replies",
    "late_targets",
    "backed_off",
    "too_late",
    "damaged",
    "crc_errors",
    "malformed",
    "oversized",
    "wrong_units",
    "unknown_modes",
    "unmapped_reads",
    "internal_faults",
)
"""Counters of a line that are shown. The first two are shown always, the others where they count."""
ALWAYS: Final = frozenset({"exchanges", "timeouts"})
BY_CERTIFICATE: Final = "by role"
"""In the place of a role: each certificate brings its own, and 80 columns are few."""
OF_VERDICT: Final = {"healthy": "green", "waiting": "cyan", "warning": "yellow", "error": "red"}
OLD: Final = {
    "last-reading": "its position was last read",
    "target": "its position was not read since it got its target",
}
"""What an axis shows that is no reading of now."""
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
"""Of the states of lines, controllers and axes; every other is shown as it is."""


def show_status(console: Console, status: Mapping[str, Any]) -> None:
    """Print a status model."""
    for part in status_parts(status):
        console.print(part)


def status_parts(status: Mapping[str, Any]) -> Iterator[RenderableType]:
    """Yield what shows a status model, from top to bottom: how it is, what is wrong, gateway, lines, axes."""
    if "verdict" in status:  # not in that of a supervisor of an older release
        yield _verdict(status["verdict"])
    for trouble in status.get("troubles", ()):
        yield from _trouble(trouble)
    if "verdict" in status or status.get("troubles"):
        yield ""
    yield from _gateway(status["gateway"])
    for name, line in status["lines"].items():
        yield from _line(name, line)
    for make in (_positions, _tables, _times) if status["axes"] else ():
        yield ""
        yield make(status["axes"])
        yield from _ages(status["axes"]) if make is _positions else ()
    if with_terms := {name: axis for name, axis in status["axes"].items() if axis.get("terms")}:
        yield ""
        yield _terms(with_terms)


def _verdict(verdict: Mapping[str, Any]) -> RenderableType:
    colour = OF_VERDICT[verdict["state"]]
    counts = (("error", verdict["errors"]), ("warning", verdict["warnings"]))
    counted = ", ".join(f"{count} {word}{'s' * (count != 1)}" for word, count in counts if count)
    since = f" since {_time_of(verdict['since'])}"
    return _words(f"[bold {colour}]{verdict['state'].upper()}[/]{since}{f': {counted}' if counted else ''}")


def _trouble(trouble: Mapping[str, Any]) -> Iterator[RenderableType]:
    colour = "red" if trouble["severity"] == "error" else "yellow"
    what = f"{escape(trouble['where'])}: {escape(trouble['what'])}"
    yield _words(f"[bold {colour}]{escape(trouble['severity'])}[/] {what}")
    since = f"since {_time_of(trouble['since'])} " if "since" in trouble else ""
    yield _words(f"  {since}→ {escape(trouble['remedy'])}")
    if seen := trouble.get("acknowledged"):
        yield _words(f"  acknowledged by {escape(seen['by'])}, {_time_of(seen['at'])}")


def _gateway(gateway: Mapping[str, Any]) -> Iterator[RenderableType]:
    compiled = ", compiled" if gateway.get("compiled") else ""
    runs = "" if gateway["uptime_s"] is None else f", runs for {span(gateway['uptime_s'])}"
    if gateway["relay"] != "up":
        age_s = gateway["snapshot_age_s"]
        seen = "" if age_s is None else f"; what follows is {span(age_s)} old"
        runs = f", [red]its relay is not running[/]{seen}"
    yield _words(f"[bold]gateway {escape(gateway['name'])}[/] {escape(gateway['version'])}{compiled}{runs}")
    if "scheduling" not in gateway:  # nobody has heard from a relay yet
        return
    scheduling = gateway["scheduling"]
    priority = f"real-time priority {scheduling['fifo']}" if scheduling["fifo"] else "ordinary priority"
    cpus = ", ".join(map(str, scheduling["cpus"]))
    memory = "locked" if scheduling["memory_locked"] else "not locked"
    yield _words(f"  scheduling: {priority}, CPUs {cpus}, memory {memory}")


def _line(name: str, line: Mapping[str, Any]) -> Iterator[RenderableType]:
    drives = line["drives"]
    failure = f" ({escape(drives['failure'])})" if drives["failure"] else ""
    place = f"drives {escape(drives['address'])}{failure}"
    yield ""
    yield _words(f"[bold]line {escape(name)}[/]: {_coloured(line['state'])}, {place}")
    counts = [f"{COUNTERS[key].words} {line[key]}" for key in SHOWN if line.get(key) or key in ALWAYS]
    yield _words(f"  {', '.join(counts)}")
    table = _table("  controller", "role", "connected")
    for heading in ("gateway µs p50", "p99", "max", "computed ms exchange", "round", "time-out"):
        table.add_column(heading, justify="right")
    for controller in line["controllers"]:
        computed = line["computed"].get(controller["name"], {})
        took_us = controller["gateway_us"]
        table.add_row(
            f"  {escape(controller['name'])}",
            BY_CERTIFICATE if "tls" in controller else escape(controller["role"]),
            _connected(controller),
            *(_micros(took_us[key]) for key in ("p50", "p99", "max")),
            *(_number(computed.get(key), 2) for key in ("exchange_ms", "round_ms")),
            f"{computed['timeout_ms']:g}" if "timeout_ms" in computed else NOT_KNOWN,
        )
    yield table
    for controller in line["controllers"]:
        yield from _strangers_and_sessions(controller)


def _strangers_and_sessions(controller: Mapping[str, Any]) -> Iterator[RenderableType]:
    """Say whom a controller's listener let in by certificate, which end soon, how many it turned away."""
    tls = controller.get("tls", {})
    name = escape(controller["name"])
    for session in tls.get("sessions", ()):
        who = f"{escape(session['subject'])}, {escape(session['certified'])} ({escape(session['role'])})"
        yield _words(f"  {name}: TLS with {escape(session['peer'])}, {who}")
    for file in tls.get("certificates", ()):
        if file["days_left"] is not None and file["days_left"] < SOON.days:
            ends = f"is good until {escape(file['ends'])}, days left: {file['days_left']}"
            yield _words(f"  {name}: [yellow]TLS: {escape(file['file'])} {ends}[/]")
    counts = {
        "connections refused": controller.get("refused_connections"),
        "handshakes failed": tls.get("failed_handshakes"),
    }
    shown = [f"{words} {count}" for words, count in counts.items() if count]
    if shown:
        yield _words(f"  {name}: {', '.join(shown)}")


def _words(markup: str) -> Text:
    return Text.from_markup(markup)


def _connected(controller: Mapping[str, Any]) -> str:
    """Say how many connections there are, or whether the port is open."""
    if "connections" in controller:
        return str(len(controller["connections"]))
    failure = f" ({escape(controller['failure'])})" if controller["failure"] else ""
    return f"{_coloured(controller['state'])}{failure}"


def _positions(axes: Mapping[str, Any]) -> Table:
    """Return where the axes are: nominally, as the controller says it, and on the drive.

    What is no reading of now is dim; :func:`_ages` says how old it is.
    """
    table = _table("axis", "compensation", "direction")
    for heading in ("target", "on the\ndrive", "actual", "on the\ndrive"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("units", no_wrap=True)
    for name, axis in axes.items():
        position = axis.get("position") or {"of": None}
        is_read = position["of"] == "reading" or "position" not in axis
        target = [_number(axis[key], 4) for key in ("nominal_setpoint", "corrected_setpoint")]
        actual = [_number(axis[key], 4) for key in ("nominal_actual", "corrected_actual")]
        if position["of"] == "last-reading":
            actual = [_number(position[key], 4) for key in ("nominal", "corrected")]
        table.add_row(
            escape(name),
            _state_of(axis),
            escape(axis["direction"]),
            *(each if is_read else f"[dim]{each}[/]" for each in (*target, *actual)),
            escape(axis["units"]),
        )
    return table


def _ages(axes: Mapping[str, Any]) -> Iterator[RenderableType]:
    """Say how old the positions are that are no readings of now."""
    for name, axis in axes.items():
        position = axis.get("position") or {"of": None}
        if position["of"] in OLD:
            at_least = "more than " if position["is_at_least"] and position["age_s"] >= 1.0 else ""
            yield _words(
                f"  [dim]{escape(name)}: {OLD[position['of']]} {at_least}{span(position['age_s'])} ago[/]"
            )


def _state_of(axis: Mapping[str, Any]) -> str:
    """Return how an axis is, in the colour of its verdict."""
    verdict = axis.get("verdict")
    if verdict is None:
        return _coloured(axis["compensation"])
    return f"[{OF_VERDICT[verdict['state']]}]{escape(verdict['title'] or axis['compensation'])}[/]"


def _tables(axes: Mapping[str, Any]) -> Table:
    table = _table("axis", "table")
    table.add_column("points", justify="right")
    table.add_column("status", overflow="fold")
    table.add_column("moved by", overflow="fold")
    for name, axis in axes.items():
        its = axis["table"]
        error = f": [red]{escape(its['error'])}[/]" if its["error"] else ""
        table.add_row(
            escape(name),
            escape(its["file"] or NOT_KNOWN),
            str(its["points"]),
            f"{escape(its['status'])}{error}",
            escape(axis.get("writer") or NOT_KNOWN),
        )
    return table


def _terms(axes: Mapping[str, Any]) -> Table:
    """Return what is added to the tables of axes that have thermal or cross."""
    table = _table("axis")
    for heading in ("added", "temperature", "counts", "sensor", "other axes"):
        table.add_column(heading, justify="right")
    for name, axis in axes.items():
        terms = axis["terms"]
        thermal, cross = terms.get("thermal"), terms.get("cross")
        table.add_row(
            escape(name),
            _number(terms["correction"], 4),
            NOT_KNOWN if thermal is None else f"{_number(thermal['celsius'], 1)} °C",
            NOT_KNOWN if thermal is None else f"{thermal['difference']:+.2f} K",
            NOT_KNOWN if thermal is None else escape(thermal["state"]),
            NOT_KNOWN if cross is None else f"{escape(', '.join(cross['axes']))}: {escape(cross['state'])}",
        )
    return table


def _times(axes: Mapping[str, Any]) -> Table:
    """Return what the gateway took for each axis, both ways together, beside what it may take."""
    table = _table("axis, gateway µs")
    for heading in ("p50", "p99", "max", "of the last minute", "budget", "overruns"):
        table.add_column(heading, justify="right")
    for name, axis in axes.items():
        latency = axis["latency"]
        took_us = latency["gateway_us"]
        overruns = str(latency["budget_overruns"])
        table.add_row(
            escape(name),
            *(_micros(took_us[key]) for key in ("p50", "p99", "max", "max_minute")),
            _number(latency["budget_us"], 0),
            f"[red]{overruns}[/]" if latency["is_over_budget"] else overruns,
        )
    return table


def _table(*headings: str) -> Table:
    """Return a table whose first column holds names: these are never broken, however narrow it gets."""
    table = Table(box=None, padding=(0, 1), collapse_padding=True, pad_edge=False, header_style="bold")
    for number, heading in enumerate(headings):
        table.add_column(heading, overflow="fold", no_wrap=number == 0)
    return table


def _coloured(state: str) -> str:
    colour = COLOURS.get(state)
    return f"[{colour}]{state}[/]" if colour else escape(state)


def _micros(us: float | None) -> str:
    return _number(us, 1 if us is not None and us < 1000.0 else 0)


def _number(value: float | None, digits: int) -> str:
    return NOT_KNOWN if value is None else f"{value:.{digits}f}"


def _time_of(iso: str) -> str:
    """Return an instant on this machine's clock, with the day where it is another one."""
    then = datetime.fromisoformat(iso).astimezone()
    is_today = then.date() == datetime.now().astimezone().date()
    return f"{then:%H:%M:%S}" if is_today else f"{then:%Y-%m-%d %H:%M:%S}"
