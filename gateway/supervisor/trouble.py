"""What is wrong right now, worked out of the status model, worst first: what, where, and what to do.

The page's banner, the terminal, ``/healthz`` and alerts all go by this list.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

STALE_S: Final = 2.0
"""Snapshots come five times a second: after this the relay is there but says nothing."""


@dataclass(frozen=True, slots=True)
class Trouble:
    """One thing that is wrong."""

    kind: str
    severity: str
    """``error``: positions do not pass, or not corrected; ``warning``: they do, and somebody should look."""
    where: str
    """``gateway``, ``line NAME``, ``axis NAME``, ``mqtt``, ``http``, ``configuration`` or ``tables``."""
    what: str
    remedy: str
    """Begins with a verb: the page begins its sentence with it, and no key or command stands a capital."""

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


def _of_relay(gateway: Mapping[str, Any]) -> Iterator[Trouble]:
    if gateway["relay"] != "up":
        yield Trouble(
            "relay-down",
            "error",
            "gateway",
            "the relay is not running: no command reaches a drive",
            "look at its log, then start the gateway",
        )
    elif gateway["snapshot_age_s"] is not None and gateway["snapshot_age_s"] > STALE_S:
        yield Trouble(
            "relay-silent",
            "error",
            "gateway",
            f"the relay has said nothing for {gateway['snapshot_age_s']:.0f} s",
            "look at the load of the machine and at the relay's log",
        )


def _of_line(name: str, line: Mapping[str, Any]) -> Iterator[Trouble]:
    if line["state"] == "up":
        return
    failure = line["drives"]["failure"]
    yield Trouble(
        "line-down",
        "error",
        f"line {name}",
        f"the drives at {line['drives']['address']} cannot be reached{f': {failure}' if failure else ''}",
        "check the power of the drives, the cable and the adapter",
    )


_OF_COMPENSATION: Final = {
    "blocked": (
        "error",
        "a target was lost on the way to the drive: starts are refused until a whole one arrives",
        "let the controller send the target again",
    ),
    "unreferenced": ("warning", "not referenced: positions pass uncorrected", "home the axis"),
    "off": (
        "warning",
        "the compensation is off: positions pass uncorrected",
        "switch it on with pitch-gateway enable",
    ),
    "shadow": (
        "warning",
        "shadow mode: corrections are shown and not applied",
        'to apply them set compensation = "on" in the configuration',
    ),
    "outside": ("warning", "the last target lies outside the table", "measure the whole travel"),
}


def _of_axis(name: str, axis: Mapping[str, Any]) -> Iterator[Trouble]:
    where, table = f"axis {name}", axis["table"]
    if table["status"] == "rejected":
        stays = f"the last good table of {table['points']} points stays" if table["points"] else "no table"
        yield Trouble(
            "table-rejected",
            "error",
            where,
            f"{table['error']} ({stays})",
            "mend the file: it is read again as soon as it is saved",
        )
    elif table["status"] == "removed":
        yield Trouble(
            "table-removed",
            "warning",
            where,
            table["error"] or f"{table['file']} is not there: positions pass uncorrected",
            "put the file back, or take it out of the configuration",
        )
    if axis["compensation"] in _OF_COMPENSATION and table["status"] != "removed":
        severity, what, remedy = _OF_COMPENSATION[axis["compensation"]]
        yield Trouble(axis["compensation"], severity, where, what, remedy)
    if axis["latency"]["is_over_budget"]:
        yield Trouble(
            "over-budget",
            "warning",
            where,
            f"the gateway takes longer than budget_us = {axis['latency']['budget_us']:g}",
            "look at the load of the machine; pitch-gateway budget shows what the line can hold",
        )


def _of_supervisor(supervisor: Mapping[str, Any]) -> Iterator[Trouble]:
    for where, remedy in (
        ("configuration", "run pitch-gateway check: it says what to do"),
        ("tables_folder", "what was in force stays; it is tried again every few seconds"),
        ("http", "mend [http] or what it names, then pitch-gateway reload"),
        ("mqtt", "check the broker and [mqtt]; the gateway tries again by itself"),
    ):
        problem = supervisor[where]["problem"]
        if problem:
            yield Trouble(where, "warning", where.replace("_", " "), problem, remedy)
