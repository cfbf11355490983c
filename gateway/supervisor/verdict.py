"""How the gateway and each axis are: one word over controller, line, drive, relay and supervisor.

Page, title, terminal, ``/healthz``, MQTT and metrics show this word, and none of them judges by itself. It
follows from the list of troubles (``supervisor.trouble``): the worst one decides. The worst trouble that
names an axis decides how that axis is; what concerns a whole line or the relay names all of their axes.
"""

from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any, Final

from gateway.catalogue.entry import Severity
from gateway.supervisor.chronicle import Chronicle
from gateway.supervisor.trouble import Trouble, is_fresh, of_axis


class State(Enum):
    """The word."""

    HEALTHY = "healthy"
    """Controllers ask, drives answer, axes are corrected."""
    WAITING = "waiting"
    """Nothing is wrong yet: no controller has asked since the start, or the relay was not heard yet."""
    WARNING = "warning"
    """Positions pass; somebody should look."""
    ERROR = "error"
    """Positions do not pass, or not corrected as they should be."""


AWAITED: Final = "Waiting for the controller"
"""Title of an axis that waits."""
_OF_SEVERITY: Final = {Severity.ERROR: State.ERROR, Severity.WARNING: State.WARNING}


def of_gateway(model: Mapping[str, Any], found: Sequence[Trouble], chronicle: Chronicle) -> dict[str, Any]:
    """Return the verdict on the whole gateway as plain data: ``state``, ``since``, how many troubles."""
    state = _OF_SEVERITY[found[0].entry.severity] if found else State.HEALTHY
    if not found and (not is_fresh(model) or any(map(_is_waiting, model["lines"].values()))):
        state = State.WAITING
    worst = [each for each in found if _OF_SEVERITY[each.entry.severity] is state]
    since = chronicle.since((), state.value)
    return {
        "state": state.value,
        "since": min((chronicle.since_of(each) for each in worst), default=since),
        "errors": sum(each.entry.severity is Severity.ERROR for each in found),
        "warnings": sum(each.entry.severity is Severity.WARNING for each in found),
    }


def of_axes(
    model: Mapping[str, Any], found: Sequence[Trouble], chronicle: Chronicle
) -> dict[str, dict[str, Any]]:
    """Return the verdict on each axis as plain data: ``state``, ``kind``, ``title``, ``since``.

    ``kind`` is that of its worst trouble, and ``title`` that trouble's two or three words, empty where the
    state of the compensation says it; without a trouble ``kind`` is the state of the compensation.
    """
    waiting = {
        axis
        for line in model["lines"].values()
        if _is_waiting(line)
        for axis in line.get("unit_ids", {"axes": ()})["axes"]
    }
    verdicts = {}
    for name, axis in model["axes"].items():
        worst = of_axis(found, name)
        if worst is not None:
            state, kind, title = _OF_SEVERITY[worst.entry.severity], worst.entry.kind, worst.entry.title
        elif name in waiting:
            state, kind, title = State.WAITING, "controller-awaited", AWAITED
        else:
            state, kind, title = State.HEALTHY, axis["compensation"], ""
        since = chronicle.since((name,), state.value)
        if worst is not None:  # it may have begun before anybody looked
            since = chronicle.since_of(worst)
        verdicts[name] = {"state": state.value, "kind": kind, "title": title, "since": since}
    return verdicts


def _is_waiting(line: Mapping[str, Any]) -> bool:
    """Whether controllers ought to ask, and none has since the relay was started."""
    bound = [
        each
        for each in line.get("controllers", ())
        if "asked_s" in each
        and (each["silent_after_s"] or (each["silent_after_s"] is None and each["role"] == "motion"))
    ]
    moving = [each for each in line.get("controllers", ()) if each.get("role") == "motion"]
    return bool(bound) and all(each.get("asked_s", 0.0) is None for each in (*bound, *moving))


def position_of(
    axis: Mapping[str, Any],
    seen: Mapping[str, Any] | None,
    target: Mapping[str, Any] | None,
    *,
    is_now: bool,
) -> dict[str, Any]:
    """Return what is known best of where an axis is, on both scales in its unit, with its age in s.

    Args:
        axis: its part of the model.
        seen: the last reading; None: there was none.
        target: ``age_s`` of its last target, and whether it ``is_at_least`` so old; None: there was none.
        is_now: whether the reading says where the axis is now.

    Returns:
        ``of`` is ``reading`` (the axis is there), ``last-reading`` or ``target``, whichever is newer, or None
        where nothing is known.
    """
    is_newer = (
        target is None or target["is_at_least"] or (seen is not None and seen["age_s"] <= target["age_s"])
    )
    if seen is not None and (is_now or is_newer):
        return {"of": "reading" if is_now else "last-reading", **seen, "is_at_least": False}
    if target is not None:
        nominal = axis["nominal_setpoint"]
        corrected = nominal if axis["compensation"] == "shadow" else axis["corrected_setpoint"]
        return {"of": "target", "nominal": nominal, "corrected": corrected, **target}
    return {"of": None, "nominal": None, "corrected": None, "age_s": None, "is_at_least": False}
