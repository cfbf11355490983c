"""The whole status model: the relay's report and the supervisor's own data.

It is made anew for each snapshot and never changed afterwards.
"""

import time
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Final

from msgspec import UNSET
from msgspec.structs import asdict, replace

import gateway
from gateway.status.axis import SHOWN_S, AxisStatus, WholeAxis
from gateway.status.line import ControllerStatus, LineStatus
from gateway.status.model import GatewayStatus, Model, RelayModel, SupervisorStatus
from gateway.supervisor.active_alarms import is_fresh, of_axis, troubles
from gateway.supervisor.recent_history import RecentHistory
from gateway.supervisor.table_files import TableFileEntry
from gateway.supervisor.verdict import of_axes, of_gateway, position_of

Limits = Mapping[tuple[str, str], float]
"""``silent_after_s`` of the controllers that have one, by line and controller."""
NO_LIMITS: Final[Limits] = {}


def whole_model(
    name: str,
    snapshot: RelayModel | None,
    *,
    is_relay_up: bool,
    snapshot_age_s: float | None,
    tables: Mapping[str, TableFileEntry],
    supervisor: SupervisorStatus | None,
    recent: RecentHistory | None = None,
    silent_after_s: Limits = NO_LIMITS,
) -> Model:
    """Return the model.

    Args:
        name: of the gateway.
        snapshot: the relay's model; None if the relay has not been reached yet.
        is_relay_up: whether the relay is connected.
        snapshot_age_s: age of the snapshot.
        tables: the state of the table files, by axis.
        supervisor: the supervisor's own status; None: there is none.
        recent: the recent history; None: there is none.
        silent_after_s: limits of the controllers that have one of their own.
    """
    now_s = time.monotonic()
    recent = recent or RecentHistory()
    recent.take(snapshot, now_s)
    reported = snapshot or RelayModel(gateway=GatewayStatus(name=name, version=gateway.__version__))
    age_s = snapshot_age_s or 0.0
    uptime_s = reported.gateway.uptime_s or 0.0
    model = Model(
        gateway=replace(
            reported.gateway,
            relay="up" if is_relay_up else "down",
            snapshot_age_s=None if snapshot_age_s is None else round(snapshot_age_s, 3),
        ),
        lines={
            line: _with_silences(status, age_s, uptime_s, line, silent_after_s)
            for line, status in reported.lines.items()
        },
        axes={
            axis: _with_file(_aged(status, age_s), tables.get(axis)) for axis, status in reported.axes.items()
        },
        supervisor=supervisor,
    )
    found = troubles(model)
    recent.acknowledged.follow(found, now_s)
    model.troubles = recent.stamp(found, datetime.now(UTC))
    model.verdict = of_gateway(model, found, recent)
    verdicts = of_axes(model, found, recent)
    for axis, status in model.axes.items():
        worst = of_axis(found, axis)
        status.verdict = verdicts[axis]
        status.trouble = None if worst is None else worst.of_axis()
        status.last_seen = recent.last(axis, now_s)
        is_now = is_fresh(model) and status.nominal_actual is not None
        status.position = position_of(status, status.last_seen, recent.target(axis, now_s), is_now=is_now)
    return model


def _with_silences(
    line: LineStatus, age_s: float, uptime_s: float, name: str, limits_s: Limits
) -> LineStatus:
    """Return a line whose controllers have their silence in seconds, and the limit for it; ages go on.

    A controller that never sent a request has been silent since the relay's start. An older relay does not
    report this.
    """

    def with_silence(each: ControllerStatus) -> ControllerStatus:
        if each.asked_s is UNSET:
            return each
        return replace(
            each,
            asked_s=_later(each.asked_s, age_s),
            silent_s=round((uptime_s if each.asked_s is None else each.asked_s) + age_s, 3),
            silent_after_s=limits_s.get((name, each.name)),
        )

    drives = {
        unit_id: replace(drive, answered_s=_later(drive.answered_s, age_s))
        for unit_id, drive in line.unit_ids.drives.items()
    }
    return replace(
        line,
        controllers=[with_silence(each) for each in line.controllers],
        unit_ids=replace(line.unit_ids, drives=drives),
    )


def _later(was_s: float | None, age_s: float) -> float | None:
    """Return an age of the relay's report as it is now."""
    return None if was_s is None else round(was_s + age_s, 3)


def _aged(axis: AxisStatus, age_s: float) -> AxisStatus:
    """Return an axis whose ages go on with the clock; a reading that is too old is no position any more."""
    last, terms, actual_age_s = axis.last_actual, axis.terms, _later(axis.actual_age_s, age_s)
    if last is not None:
        last = replace(last, age_s=round(last.age_s + age_s, 3))
    if terms is not None and terms.thermal:
        thermal = replace(terms.thermal, age_s=_later(terms.thermal.age_s, age_s))
        terms = replace(terms, thermal=thermal)
    aged = replace(axis, actual_age_s=actual_age_s, last_actual=last, terms=terms)
    if actual_age_s is not None and actual_age_s > SHOWN_S:
        return replace(aged, nominal_actual=None, corrected_actual=None, actual_age_s=None)
    return aged


def _with_file(status: AxisStatus, entry: TableFileEntry | None) -> WholeAxis:
    table = replace(status.table) if entry is None else entry.over(status.table)
    return WholeAxis(**{**asdict(status), "table": table})
