"""What is wrong right now, worked out of the status model, worst first: what, where, and what to do.

The page's banner, the terminal, ``/healthz`` and alerts all go by this list.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from gateway.catalogue import troubles as kinds
from gateway.catalogue.entry import TroubleEntry

STALE_S: Final = 2.0
"""Snapshots come five times a second: after this the relay is there but says nothing."""


@dataclass(frozen=True, slots=True)
class Trouble:
    """One thing that is wrong."""

    kind: str
    severity: str
    where: str
    """``gateway``, ``line NAME``, ``axis NAME``, ``mqtt``, ``http``, ``configuration`` or ``tables``."""
    what: str
    remedy: str

    def as_data(self) -> dict[str, str]:
        """Return it as plain data."""
        return asdict(self)


def troubles(model: Mapping[str, Any]) -> list[Trouble]:
    """Return everything that is wrong, errors first."""
    found = [
        *_of_relay(model["gateway"]),
        *(trouble for name, line in model["lines"].items() for trouble in _of_line(name, line)),
        *(trouble for name, axis in model["axes"].items() for trouble in _of_axis(name, axis)),
        *_of_supervisor(model["supervisor"]),
    ]
    return sorted(found, key=lambda trouble: trouble.severity != "error")


def _found(entry: TroubleEntry, where: str, what: str) -> Trouble:
    return Trouble(entry.kind, entry.severity.value, where, what, entry.remedy)


def _of_relay(gateway: Mapping[str, Any]) -> Iterator[Trouble]:
    if gateway["relay"] != "up":
        yield _found(kinds.RELAY_DOWN, "gateway", kinds.RELAY_DOWN.meaning)
    elif gateway["snapshot_age_s"] is not None and gateway["snapshot_age_s"] > STALE_S:
        what = f"the relay has said nothing for {gateway['snapshot_age_s']:.0f} s"
        yield _found(kinds.RELAY_SILENT, "gateway", what)


def _of_line(name: str, line: Mapping[str, Any]) -> Iterator[Trouble]:
    if line["state"] == "up":
        yield from _of_unit_ids(f"line {name}", line)
        return
    failure = line["drives"]["failure"]
    what = f"the drives at {line['drives']['address']} cannot be reached{f': {failure}' if failure else ''}"
    yield _found(kinds.LINE_DOWN, f"line {name}", what)


_NOT_TOLD: Final[Mapping[str, Any]] = {"axes": {}, "heard": [], "strangers": [], "requests": {}}
"""By a relay of an older release, which runs on until somebody restarts it."""


def _of_unit_ids(where: str, line: Mapping[str, Any]) -> Iterator[Trouble]:
    """Say whom controllers talk to that is no axis, and which axis they do not talk to."""
    unit_ids = line.get("unit_ids", _NOT_TOLD)
    strangers = ", ".join(map(str, unit_ids["strangers"]))
    unheard = {name: of for name, of in unit_ids["axes"].items() if of not in unit_ids["heard"]}
    if strangers and unheard:
        axes = ", ".join(f"axis {name} (unit_id {of})" for name, of in unheard.items())
        what = f"controllers talk to unit id {strangers}, which has no axis; {axes} hears nothing"
        yield _found(kinds.WRONG_UNIT_ID, where, what)
    elif unit_ids["requests"]:
        heard = ", ".join(f"{of} ({count} requests)" for of, count in unit_ids["requests"].items())
        yield _found(kinds.UNKNOWN_UNIT, where, f"controllers talk to unit id {heard}, which has no axis")
    if line.get("wrong_units"):
        what = f"{line['wrong_units']} replies had another unit id than was asked"
        yield _found(kinds.ANSWERS_AS, where, what)


_OF_COMPENSATION: Final = {entry.kind: entry for entry in kinds.OF_COMPENSATION}


def _of_axis(name: str, axis: Mapping[str, Any]) -> Iterator[Trouble]:
    where, table = f"axis {name}", axis["table"]
    if table["status"] == "rejected":
        stays = f"the last good table of {table['points']} points stays" if table["points"] else "no table"
        yield _found(kinds.TABLE_REJECTED, where, f"{table['error']} ({stays})")
    elif table["status"] == "removed":
        what = table["error"] or f"{table['file']} is not there: positions pass uncorrected"
        yield _found(kinds.TABLE_REMOVED, where, what)
    entry = _OF_COMPENSATION.get(axis["compensation"])
    if entry is not None and table["status"] != "removed":
        yield _found(entry, where, entry.meaning)
    if axis["latency"]["is_over_budget"]:
        what = f"the gateway takes longer than budget_us = {axis['latency']['budget_us']:g}"
        yield _found(kinds.OVER_BUDGET, where, what)
    yield from _of_terms(where, axis.get("terms") or {})


_OF_SENSOR: Final = {
    "waiting": "no temperature has been heard since the start: nothing is added for it",
    "held": "the temperature sensor says nothing: its last value is held",
    "fading": "the temperature sensor says nothing: what is added for it goes back to 0",
    "faded": "the temperature sensor says nothing: nothing is added for it any more",
}
_OF_OTHERS: Final = {"fading": "what is added for that goes back to 0", "faded": "nothing is added for that"}
"""Held it is no trouble yet: any stop of an axis that is not read does that, until its next target."""


def _of_terms(where: str, terms: Mapping[str, Any]) -> Iterator[Trouble]:
    thermal, cross = terms.get("thermal", {}), terms.get("cross", {})
    if thermal.get("is_silent"):
        what = _OF_SENSOR.get(thermal["state"], kinds.SENSOR_SILENT.meaning)
        yield _found(kinds.SENSOR_SILENT, where, what)
    if cross.get("state") in _OF_OTHERS:
        what = f"it is not known where {_named(cross['axes'])}; {_OF_OTHERS[cross['state']]}"
        yield _found(kinds.OTHER_AXIS_UNKNOWN, where, what)
    if terms.get("is_too_large"):
        what = (
            "with the table, temperature and other axes come to more than max_correction; they do not follow"
        )
        yield _found(kinds.TERM_TOO_LARGE, where, what)


def _named(axes: Sequence[str]) -> str:
    """Return whose place is not known; of several only the sum is.

    >>> _named(["y"]), _named(["y", "z"])
    ('axis y is', 'one of the axes y, z is')
    """
    return f"axis {axes[0]} is" if len(axes) == 1 else f"one of the axes {', '.join(axes)} is"


def _of_supervisor(supervisor: Mapping[str, Any]) -> Iterator[Trouble]:
    for entry in kinds.OF_SUPERVISOR:
        problem = supervisor[entry.kind]["problem"]
        if problem:
            yield _found(entry, entry.kind.replace("_", " "), problem)
