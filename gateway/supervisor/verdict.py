"""The verdict on the gateway and on each axis: one word for controller, line, drive, relay, supervisor.

Page, title, terminal, ``/healthz``, MQTT and metrics show this word; none of them has its own rule. It
follows from the active alarms (``supervisor.active_alarms``): the worst one decides. For an axis the worst
alarm that names it decides. An alarm of a whole line or of the relay names all of their axes.
"""

from collections.abc import Sequence
from enum import Enum
from typing import Final

from msgspec import UNSET

from gateway.catalogue.entry import Severity
from gateway.status.axis import AxisStatus, AxisVerdict, Position, Reading
from gateway.status.line import LineStatus
from gateway.status.model import Model, Verdict
from gateway.supervisor.active_alarms import Alarm, is_fresh, of_axis
from gateway.supervisor.recent_history import LastTarget, RecentHistory


class Health(Enum):
    """The verdict in one word."""

    HEALTHY = "healthy"
    """Controllers poll, drives answer, axes are corrected as configured."""
    WAITING = "waiting"
    """Nothing is wrong yet: no controller has sent a request since the start, or the relay has not reported
    yet."""
    WARNING = "warning"
    """Positions pass; an operator should check."""
    ERROR = "error"
    """Positions do not pass, or pass without the required correction."""


AWAITED: Final = "Waiting for the controller"
"""Title of an axis that waits."""
_OF_SEVERITY: Final = {Severity.ERROR: Health.ERROR, Severity.WARNING: Health.WARNING}


def of_gateway(model: Model, found: Sequence[Alarm], recent: RecentHistory) -> Verdict:
    """Return the verdict on the whole gateway."""
    state = _OF_SEVERITY[found[0].entry.severity] if found else Health.HEALTHY
    if not found and (not is_fresh(model) or any(map(_is_waiting, model.lines.values()))):
        state = Health.WAITING
    worst = [each for each in found if _OF_SEVERITY[each.entry.severity] is state]
    since = recent.since((), state.value)
    return Verdict(
        state=state.value,
        since=min((recent.since_of(each) for each in worst), default=since),
        errors=sum(each.entry.severity is Severity.ERROR for each in found),
        warnings=sum(each.entry.severity is Severity.WARNING for each in found),
    )


def of_axes(model: Model, found: Sequence[Alarm], recent: RecentHistory) -> dict[str, AxisVerdict]:
    """Return the verdict on each axis.

    ``kind`` is that of its worst alarm, and ``title`` that alarm's two or three words. ``title`` is empty
    where the state of the compensation is enough. Without an alarm, ``kind`` is the state of the
    compensation.
    """
    waiting = {axis for line in model.lines.values() if _is_waiting(line) for axis in line.unit_ids.axes}
    verdicts = {}
    for name, axis in model.axes.items():
        worst = of_axis(found, name)
        if worst is not None:
            state, kind, title = _OF_SEVERITY[worst.entry.severity], worst.entry.kind, worst.entry.title
        elif name in waiting:
            state, kind, title = Health.WAITING, "controller-awaited", AWAITED
        else:
            state, kind, title = Health.HEALTHY, axis.compensation, ""
        since = recent.since((name,), state.value)
        if worst is not None:  # it may have begun before this process
            since = recent.since_of(worst)
        verdicts[name] = AxisVerdict(state=state.value, kind=kind, title=title, since=since)
    return verdicts


def _is_waiting(line: LineStatus) -> bool:
    """Whether controllers should send requests, and none has since the relay's start."""
    bound = [
        each
        for each in line.controllers
        if each.asked_s is not UNSET
        and (each.silent_after_s or (each.silent_after_s is None and each.role == "motion"))
    ]
    moving = [each for each in line.controllers if each.role == "motion"]
    return bool(bound) and all(each.asked_s is None for each in (*bound, *moving))


def position_of(
    axis: AxisStatus, seen: Reading | None, target: LastTarget | None, *, is_now: bool
) -> Position:
    """Return the best known position of an axis.

    Args:
        axis: its part of the model.
        seen: the last reading; None: there was none.
        target: the age of its last target; None: there was none.
        is_now: whether the reading shows where the axis is now.
    """
    is_newer = target is None or target.is_at_least or (seen is not None and seen.age_s <= target.age_s)
    if seen is not None and (is_now or is_newer):
        of = "reading" if is_now else "last-reading"
        return Position(of=of, nominal=seen.nominal, corrected=seen.corrected, age_s=seen.age_s)
    if target is not None:
        nominal = axis.nominal_setpoint
        return Position(
            of="target",
            nominal=nominal,
            corrected=nominal if axis.compensation == "shadow" else axis.corrected_setpoint,
            age_s=target.age_s,
            is_at_least=target.is_at_least,
        )
    return Position()
