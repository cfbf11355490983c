"""``/metrics``: the status model as Prometheus metrics; seconds, and totals since the relay's start."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from typing import Final

from msgspec import UNSET
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import choose_encoder
from prometheus_client.metrics_core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.registry import Collector

from gateway.exchange.status_words import COMPENSATION_STATES, DIRECTION_STATES, TERM_STATES
from gateway.status.axis import ThermalStatus, WholeAxis
from gateway.status.line import LINE_COUNTERS, CertificateStatus, LineStatus
from gateway.status.model import COUNTERS, AlarmStatus, Model
from gateway.status.times import GatewayTimes
from gateway.supervisor.active_alarms import is_fresh
from gateway.supervisor.broadcast import Broadcast
from gateway.supervisor.table_files import FileState
from gateway.supervisor.verdict import Health

US_PER_S: Final = 1e6
TABLE_STATES: Final = (*(state.value for state in FileState), "none")
COMPONENTS: Final = ("configuration", "tables_folder", "state_folder", "http", "mqtt", "alarm_output")


class StatusCollector(Collector):
    """Makes metrics from the newest model at each scrape; keeps nothing."""

    def __init__(self, broadcast: Broadcast) -> None:
        self._broadcast = broadcast

    def collect(self) -> Iterator[Metric]:
        """Yield all metrics; none if there is no model."""
        model = self._broadcast.model
        if model is not None:
            bounds_us = model.gateway.latency_bounds_us or ()
            is_up = model.gateway.relay == "up"
            yield from _of_gateway(model)
            unknown = frozenset() if is_fresh(model) else _PRESENT
            for metric in (
                *_of_lines(model.lines, bounds_us, is_relay_up=is_up),
                *_of_axes(model.axes, bounds_us),
            ):
                if metric.name not in unknown and (metric.name != _LINE_UP or not (unknown and is_up)):
                    yield metric
            yield from _of_certificates(model)


class Metrics:
    """The metrics page."""

    def __init__(self, broadcast: Broadcast) -> None:
        self._registry = CollectorRegistry()
        self._registry.register(StatusCollector(broadcast))

    def page(self, accept: str) -> tuple[bytes, str]:
        """Return the page and its content type, in the format that ``accept`` requests.

        A version that is no number counts as no request.
        """
        try:
            encode, media_type = choose_encoder(accept)
        except (TypeError, ValueError):
            encode, media_type = choose_encoder("")
        return encode(self._registry), media_type


def _name(rest: str) -> str:
    return f"pitch_gateway_{rest}"


def _gauge(rest: str, says: str, labels: Iterable[str] = ()) -> GaugeMetricFamily:
    return GaugeMetricFamily(_name(rest), says, labels=tuple(labels))


def _counter(rest: str, says: str, labels: Iterable[str] = ()) -> CounterMetricFamily:
    return CounterMetricFamily(_name(rest), says, labels=tuple(labels))


_LINE_UP: Final = _name("line_up")
"""Without a relay no drive is reached. Of a relay that is silent nobody knows."""
_PRESENT: Final = frozenset(
    map(
        _name,
        (
            "controller_connections",
            "controller_silent_seconds",
            "drive_answers",
            "drive_silent_seconds",
            "drive_timeouts_in_a_row",
            "line_latency_minute_max_seconds",
            "axis_latency_minute_max_seconds",
            "axis_over_budget",
            "axis_position",
            "axis_correction",
            "axis_gain_ratio",
            "axis_compensation",
            "axis_direction",
            "axis_term_correction",
            "axis_term_state",
            "axis_terms_too_large",
            "axis_temperature_celsius",
            "axis_temperature_age_seconds",
            "axis_temperature_difference_kelvin",
            "axis_temperature_silent",
        ),
    )
)
"""What only the relay knows, and only of the present: left out while it is down or silent."""


def _of_gateway(model: Model) -> Iterator[Metric]:
    gateway = model.gateway
    info = InfoMetricFamily("pitch_gateway", "The gateway: its name and release.")
    compiled = str(bool(gateway.compiled)).lower()
    info.add_metric((), {"name": gateway.name, "version": gateway.version, "compiled": compiled})
    yield info
    up = _gauge("relay_up", "Whether the relay, which moves the frames, is running: 1 or 0.")
    up.add_metric((), gateway.relay == "up")
    yield up
    for seconds, rest, says in (
        (
            gateway.snapshot_age_s,
            "snapshot_age_seconds",
            "Age of the last report of the relay.",
        ),
        (
            gateway.uptime_s,
            "relay_uptime_seconds",
            "How long the relay had been running at its last report.",
        ),
    ):
        gauge = _gauge(rest, says)
        if seconds is not None:
            gauge.add_metric((), seconds)
        yield gauge
    yield _verdict("verdict", "How the gateway is: 1 at its word.", {(): model.verdict.state})
    good = _gauge("component_ok", "Whether a part of the supervisor has no problem: 1 or 0.", ["component"])
    for component in COMPONENTS if model.supervisor is not None else ():
        good.add_metric((component,), not getattr(model.supervisor, component).problem)
    yield good
    yield from _of_troubles(model.troubles)


def _verdict(
    rest: str, says: str, verdicts: Mapping[tuple[str, ...], str], labels: Iterable[str] = ()
) -> Metric:
    family = _gauge(rest, says, [*labels, "state"])
    for of, verdict in verdicts.items():
        for state in Health:
            family.add_metric((*of, state.value), state.value == verdict)
    return family


def _of_troubles(troubles: Sequence[AlarmStatus]) -> Iterator[Metric]:
    count = _gauge("troubles", "Things that are wrong right now, by severity.", ["severity"])
    for severity in ("error", "warning"):
        count.add_metric((severity,), sum(alarm.severity == severity for alarm in troubles))
    yield count
    each = _gauge("trouble", "1 for each thing that is wrong right now.", ["kind", "severity", "where"])
    since = _gauge(
        "trouble_since_timestamp_seconds",
        "Since when it is wrong, in Unix time.",
        ["kind", "severity", "where"],
    )
    began: dict[tuple[str, str, str], float] = {}
    for alarm in troubles:
        labels = (alarm.kind, alarm.severity, alarm.where)
        instant_s = datetime.fromisoformat(alarm.since).timestamp()
        began[labels] = min(began.get(labels, instant_s), instant_s)
    for labels, instant_s in sorted(began.items()):
        each.add_metric(labels, 1)
        since.add_metric(labels, instant_s)
    yield from (each, since)


def _of_certificates(model: Model) -> Iterator[Metric]:
    """Yield when certificates expire; of several in one file, the first to expire."""
    by_listener: dict[str, Sequence[CertificateStatus]] = {}
    if model.supervisor is not None:
        by_listener["http"] = model.supervisor.http.certificates
    for name, line in model.lines.items():
        for controller in line.controllers:
            if controller.tls:
                by_listener[f"line {name}, controller {controller.name}"] = controller.tls.certificates
    says = "When what is in a file of tls is good no more, in Unix time."
    ends = _gauge("certificate_end_timestamp_seconds", says, ["where", "key", "file", "subject"])
    for where, certificates in by_listener.items():
        for each in certificates:
            if each.ends is not None:
                labels = (where, each.key, each.file, each.subject)
                ends.add_metric(labels, datetime.fromisoformat(each.ends).timestamp())
    yield ends


def _of_lines(
    lines: Mapping[str, LineStatus], bounds_us: Iterable[float], *, is_relay_up: bool
) -> Iterator[Metric]:
    up = _gauge("line_up", "Whether the drives of a line are reached: 1 or 0.", ["line"])
    wire = _counter("line_wire_seconds", "Time that bytes took on the wire of the drives.", ["line"])
    added = _counter("line_added_frames_seconds", "Time that frames of the gateway's own took.", ["line"])
    connected = _gauge("controller_connections", "Connections of a controller.", ["line", "controller"])
    silent = _gauge(
        "controller_silent_seconds",
        "For how long a controller has asked for nothing.",
        ["line", "controller"],
    )
    for name, line in lines.items():
        up.add_metric((name,), is_relay_up and line.state == "up")
        wire.add_metric((name,), line.wire_s)
        added.add_metric((name,), line.added_frames_s)
        for controller in line.controllers:
            connections = controller.connections
            count = int(controller.state == "up") if connections is UNSET else len(connections)
            connected.add_metric((name, controller.name), count)
            if controller.silent_s is not UNSET:  # a relay of an older release does not report it
                silent.add_metric((name, controller.name), controller.silent_s)
    yield from (up, wire, added, connected, silent)
    yield from _of_drives(lines)
    yield from _of_ports(lines)
    yield from _of_forwarding(lines)
    for key, declared in LINE_COUNTERS.items():
        if declared.is_metric:
            counter = _counter(f"line_{key}", declared.sentence, ["line"])
            for name, line in lines.items():
                if (count := getattr(line, key)) is not UNSET:  # a TCP line has no check sums
                    counter.add_metric((name,), count)
            yield counter
    yield from _latency("line", {name: line.gateway_us for name, line in lines.items()}, bounds_us)


def _of_forwarding(lines: Mapping[str, LineStatus]) -> Iterator[Metric]:
    """Yield the results of cut-through forwarding, for lines that use it."""
    whole = _counter("line_frames_cut_through", COUNTERS["cut_through"].sentence, ["line", "frames"])
    stored = _counter("line_frames_stored", COUNTERS["stored"].sentence, ["line", "frames", "why"])
    spoilt = _counter("line_frames_spoilt", COUNTERS["spoilt"].sentence, ["line", "frames", "why"])
    torn = _counter("line_frames_torn", COUNTERS["torn"].sentence, ["line"])
    for name, line in lines.items():
        status = line.cut_through
        if status is UNSET:
            continue
        for frames, became in (("requests", status.requests), ("replies", status.replies)):
            whole.add_metric((name, frames), became.cut_through)
            for counter, counts in ((stored, became.stored), (spoilt, became.spoilt)):
                for why, count in counts.items():
                    counter.add_metric((name, frames, why), count)
        torn.add_metric((name,), status.torn)
    if torn.samples:
        yield from (whole, stored, spoilt, torn)


def _of_drives(lines: Mapping[str, LineStatus]) -> Iterator[Metric]:
    """Yield how the drives of unit ids answer, with their axes; nothing from a relay of an older release."""
    labels = ("line", "unit_id", "axes")
    answers = _gauge("drive_answers", "Whether a unit id answered its last request: 1 or 0.", labels)
    silent = _gauge("drive_silent_seconds", "For how long a unit id has not answered; 0: it does.", labels)
    missed = _gauge("drive_timeouts_in_a_row", "Requests that a unit id left unanswered in a row.", labels)
    damaged = _counter("drive_damaged", "Requests that were answered by bytes that are no frame.", labels)
    for name, line in lines.items():
        for unit_id, drive in line.unit_ids.drives.items():
            axes = ",".join(axis for axis, of in line.unit_ids.axes.items() if str(of) == unit_id)
            of = (name, unit_id, axes)
            silent_s = drive.silent_s
            if drive.answered_s is not None or silent_s is not None:  # else no request was sent yet
                answers.add_metric(of, silent_s is None)
                silent.add_metric(of, silent_s or 0.0)
                missed.add_metric(of, drive.timeouts_in_a_row)
            damaged.add_metric(of, drive.damaged)
    yield from (answers, silent, missed, damaged)


def _of_ports(lines: Mapping[str, LineStatus]) -> Iterator[Metric]:
    """Yield what the serial ports of controllers received: whole and damaged frames."""
    labels = ("line", "controller")
    whole = _counter("controller_frames", "Whole frames from the serial port of a controller.", labels)
    damaged = _counter("controller_damaged_frames", "Damaged frames from there.", labels)
    for name, line in lines.items():
        for controller in line.controllers:
            if controller.whole is not UNSET and controller.damaged is not UNSET:
                whole.add_metric((name, controller.name), controller.whole)
                damaged.add_metric((name, controller.name), controller.damaged)
    yield from (whole, damaged)


def _latency(kind: str, took_us: Mapping[str, GatewayTimes], bounds_us: Iterable[float]) -> Iterator[Metric]:
    """Yield the gateway's own time as a histogram with the relay's buckets; the relay keeps no sum."""
    bounds = [*(f"{bound / US_PER_S:g}" for bound in bounds_us), "+Inf"]
    times = HistogramMetricFamily(
        _name(f"{kind}_latency_seconds"),
        f"The gateway's own time for an exchange of the {kind}, both ways together.",
        labels=[kind],
    )
    for name, of_one in took_us.items():
        below = of_one.below or ()
        if len(below) == len(bounds):
            times.add_metric((name,), list(zip(bounds, below, strict=True)), None)
    yield times
    for key, rest, since in (("max", "max", "since its start"), ("max_minute", "minute_max", "in a minute")):
        highest = _gauge(
            f"{kind}_latency_{rest}_seconds", f"The longest that the gateway took {since}.", [kind]
        )
        for name, of_one in took_us.items():
            highest.add_metric((name,), getattr(of_one, key) / US_PER_S)
        yield highest


def _of_axes(axes: Mapping[str, WholeAxis], bounds_us: Iterable[float]) -> Iterator[Metric]:
    verdicts: dict[tuple[str, ...], str] = {(name,): axis.verdict.state for name, axis in axes.items()}
    yield _verdict("axis_verdict", "How an axis is: 1 at its word.", verdicts, ["axis"])
    yield from _positions(axes)
    for rest, says, states, found in (
        (
            "compensation",
            "Compensation: 1 at the state it is in.",
            COMPENSATION_STATES,
            _compensation,
        ),
        ("direction", "Direction of the readback map: 1 at the one it is.", DIRECTION_STATES, _direction),
        ("table_state", "State of the table file: 1 at the one it is in.", TABLE_STATES, _table_state),
    ):
        label = "direction" if rest == "direction" else "state"
        family = _gauge(f"axis_{rest}", says, ["axis", label])
        for name, axis in axes.items():
            for state in dict.fromkeys((*states, found(axis))):
                family.add_metric((name, state), state == found(axis))
        yield family
    yield from _of_tables(axes)
    yield from _of_terms(axes)
    took_us = {name: axis.latency.gateway_us for name, axis in axes.items()}
    yield from _latency("axis", took_us, bounds_us)
    budget = _gauge("axis_latency_budget_seconds", "What the gateway may take for an exchange.", ["axis"])
    over = _gauge("axis_over_budget", "Whether the budget is exceeded right now: 1 or 0.", ["axis"])
    overruns = _counter("axis_budget_overruns", "Exchanges that took longer than the budget.", ["axis"])
    for name, axis in axes.items():
        latency = axis.latency
        budget.add_metric((name,), latency.budget_us / US_PER_S)
        over.add_metric((name,), latency.is_over_budget)
        overruns.add_metric((name,), latency.budget_overruns)
    yield from (budget, over, overruns)


def _compensation(axis: WholeAxis) -> str:
    return axis.compensation


def _direction(axis: WholeAxis) -> str:
    return axis.direction


def _table_state(axis: WholeAxis) -> str:
    return axis.table.status


def _positions(axes: Mapping[str, WholeAxis]) -> Iterator[Metric]:
    """Yield positions in the axis's own unit, which is in the label: mm, inch or degree."""
    says = "Position in the unit of the axis: frame nominal (the controller's) or corrected (the drive's)."
    position = _gauge("axis_position", says, ["axis", "units", "frame", "of"])
    correction = _gauge("axis_correction", "What is added, in the unit of the axis.", ["axis", "units"])
    gain = _gauge("axis_gain_ratio", "Share of the table that is applied.", ["axis", "direction"])
    for name, axis in axes.items():
        for frame in ("nominal", "corrected"):
            for of in ("setpoint", "actual"):
                found: float | None = getattr(axis, f"{frame}_{of}")
                if found is not None:
                    position.add_metric((name, axis.units, frame, of), found)
        if axis.correction is not None:
            correction.add_metric((name, axis.units), axis.correction)
        gain.add_metric((name, "forward"), axis.gain.forward)
        gain.add_metric((name, "backward"), axis.gain.backward)
    yield from (position, correction, gain)


def _of_tables(axes: Mapping[str, WholeAxis]) -> Iterator[Metric]:
    points = _gauge("axis_table_points", "Points of the table that the axis has; 0: none.", ["axis"])
    loaded = _gauge("axis_table_loaded_timestamp_seconds", "When the table came, in Unix time.", ["axis"])
    info = InfoMetricFamily(_name("axis_table"), "The table that the axis has.", labels=["axis"])
    for name, axis in axes.items():
        table = axis.table
        points.add_metric((name,), table.points)
        if table.loaded_at:
            loaded.add_metric((name,), datetime.fromisoformat(table.loaded_at).timestamp())
        if table.file:
            kind, digest = table.format or "", table.sha256 or ""
            info.add_metric((name,), {"file": table.file, "format": kind, "sha256": digest})
    yield from (points, loaded, info)


def _of_terms(axes: Mapping[str, WholeAxis]) -> Iterator[Metric]:
    """Yield what ``thermal`` and ``cross`` add, and how reliable it is; nothing without these terms."""
    says = "What a term added to the last target, in the unit of the axis: thermal or cross."
    added = _gauge("axis_term_correction", says, ["axis", "units", "term"])
    state = _gauge("axis_term_state", "State of a term: 1 at the one it is in.", ["axis", "term", "state"])
    large = _gauge("axis_terms_too_large", "Whether the terms are too large to follow: 1 or 0.", ["axis"])
    warm: dict[str, ThermalStatus] = {}
    for name, axis in axes.items():
        terms = axis.terms
        if terms is None:
            continue
        if terms.thermal:
            warm[name] = terms.thermal
        large.add_metric((name,), terms.is_too_large)
        for term, its in (("thermal", terms.thermal), ("cross", terms.cross)):
            if not its:
                continue
            if its.correction is not None:
                added.add_metric((name, axis.units, term), its.correction)
            for each in dict.fromkeys((*TERM_STATES, its.state)):
                state.add_metric((name, term, each), each == its.state)
    if large.samples:
        yield from (added, state, large)
        yield from _of_temperatures(warm)


def _of_temperatures(warm: Mapping[str, ThermalStatus]) -> Iterator[Metric]:
    for key, rest, says in (
        ("celsius", "celsius", "Temperature of the screw as its sensor said it last."),
        ("age_s", "age_seconds", "How long ago the sensor of the screw was heard."),
        ("difference", "difference_kelvin", "Difference from the reference temperature that counts."),
        ("is_silent", "silent", "Whether the sensor of the screw is silent for too long: 1 or 0."),
    ):
        gauge = _gauge(f"axis_temperature_{rest}", says, ["axis"])
        for name, thermal in warm.items():
            if (value := getattr(thermal, key)) is not None:
                gauge.add_metric((name,), value)
        yield gauge
