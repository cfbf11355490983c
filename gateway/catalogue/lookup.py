"""Finds the meaning of a word or a sentence of the gateway in all parts of the catalogue."""

import re
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import Final

from msgspec import Struct
from msgspec.structs import asdict

from gateway.catalogue.alarms import ALARMS
from gateway.catalogue.entry import NOTHING_TO_DO, EventEntry, ExceptionEntry, RefusalEntry
from gateway.catalogue.events import EVENTS
from gateway.catalogue.exceptions import EXCEPTIONS, TITLES, code_in
from gateway.catalogue.refusals import REFUSALS
from gateway.catalogue.remarks import REMARKS
from gateway.catalogue.starts import STARTS
from gateway.catalogue.states import STATES
from gateway.status.line import LINE_COUNTERS
from gateway.status.model import COUNTERS

FEWEST_LETTERS: Final = 8
"""Minimum length of a part of a sentence; a shorter one would occur in many."""
OF_METRIC: Final[Mapping[str, str]] = {
    "controller_frames": "whole",
    "controller_damaged_frames": "damaged",
    "drive_damaged": "damaged",
    "drive_timeouts_in_a_row": "timeouts_in_a_row",
    "axis_budget_overruns": "budget_overruns",
    **{f"line_frames_{name}": name for name in ("cut_through", "stored", "spoilt", "torn")},
    **{f"line_{name}": name for name in LINE_COUNTERS},
}
"""The key of a counter by its name in the metrics, without ``pitch_gateway_`` and ``_total``."""
ON_PAGE: Final[Mapping[str, str]] = {"exchanges/s": "exchanges", "over": "budget_overruns"}
"""Counters for which the page has another text than their words or key: the key, by that text."""


class Explanation(Struct, frozen=True):
    """One entry of any kind; fields that its kind does not have are empty."""

    kind: str
    """``event``, ``trouble``, ``state``, ``remark``, ``counter``, ``exception``, ``start``; the command adds
    ``key``."""
    name: str
    severity: str
    meaning: str
    cause: str
    remedy: str

    def as_data(self) -> dict[str, str]:
        """Return it as plain data."""
        return asdict(self)


def look_up(asked: str) -> list[Explanation]:
    """Return all entries with this name; an exception by its code, a sentence by its beginning.

    Behind them are the troubles that they refer to.

    >>> [(found.kind, found.severity) for found in look_up("table-rejected")]
    [('event', 'error'), ('trouble', 'error')]
    >>> {found.name for found in look_up("0x0B")}
    {'exception 0x0B'}
    >>> look_up("nothing of that kind")
    []
    """
    text = asked.strip()
    found = [entry for entry in _named() if entry.name.lower() == text.lower()]
    if (name := counter(text)) is not None:
        found.append(_counter(name))
    if (code := code_in(text)) is not None:
        found += [_exception(entry) for entry in EXCEPTIONS if entry.code == code]
        found += [_refusal(entry) for entry in REFUSALS if entry.code == code]
    found = found or [entry for entry in _sentences() if _fits(text, entry.name)]
    return found + [trouble for trouble in _referred(found) if trouble not in found]


def _referred(entries: list[Explanation]) -> list[Explanation]:
    """Return the troubles that entries refer to, each once."""
    texts = " ".join(f"{entry.cause} {entry.remedy}" for entry in entries)
    kinds = dict.fromkeys(re.findall(r"the trouble `([^`]+)`", texts))
    return [entry for entry in _named() if entry.kind == "trouble" and entry.name in kinds]


def counter(asked: str) -> str | None:
    """Return the key of a counter, from its key, its words or its metric; None: there is no such counter.

    >>> [counter(asked) for asked in ("Time-outs", "pitch_gateway_line_timeouts_total", "timeouts")]
    ['timeouts', 'timeouts', 'timeouts']
    """
    text = asked.strip().lower()
    metric = text.removeprefix("pitch_gateway_").removesuffix("_total")
    name = OF_METRIC.get(metric) or ON_PAGE.get(text) or text
    if name in COUNTERS:
        return name
    return next((key for key, each in COUNTERS.items() if each.words.lower() == text), None)


def names() -> list[str]:
    """Return every name in the catalogue, each once."""
    return list(dict.fromkeys((*(entry.name for entry in _named()), *COUNTERS)))


def near(asked: str) -> list[str]:
    """Return the likely intended words, the nearest first."""
    return get_close_matches(asked.strip().lower(), names(), n=3, cutoff=0.6)


def everything() -> dict[str, list[Explanation]]:
    """Return the whole catalogue, by kind."""
    parts: dict[str, list[Explanation]] = {}
    for entry in (
        *_named(),
        *map(_counter, COUNTERS),
        *map(_exception, EXCEPTIONS),
        *map(_refusal, REFUSALS),
        *(entry for entry in _sentences() if entry.kind == "start"),
    ):
        kept = parts.setdefault(entry.kind, [])
        if entry not in kept:
            kept.append(entry)
    return parts


def plain(text: str) -> str:
    """Return a text of the catalogue for a terminal: a link becomes its words.

    >>> plain("see [what a restart knows](operations.md#what-a-restart-knows)")
    'see what a restart knows'
    """
    return re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", text)


def severities(entry: EventEntry) -> str:
    """Return the severity of an event, in words.

    >>> severities(EVENTS["mqtt-command"])
    'info or warning'
    """
    return " or ".join(each.value for each in (entry.severity, entry.also) if each is not None)


def code_of(entry: RefusalEntry) -> str:
    """Return an exception code as in the documents.

    >>> code_of(REFUSALS[0])
    '0x01'
    """
    return f"0x{entry.code:02X}"


def _named() -> Iterator[Explanation]:
    for event in EVENTS.values():
        yield _made("event", event.name, severities(event), event.description, event.cause, event.remedy)
    for alarm in ALARMS.values():
        severity = alarm.severity.value
        yield _made("trouble", alarm.kind, severity, alarm.description, alarm.cause, alarm.remedy)
    for key, states in STATES.items():
        for state in states:
            yield _made("state", state.name, "", f"{key}: {state.description}", "", state.remedy)
    for remark in REMARKS:
        yield _made("remark", remark.code, remark.severity, remark.description, "", remark.remedy)


def _counter(name: str) -> Explanation:
    entry = COUNTERS[name]
    return _made(
        "counter", name, "", f"{entry.words}: {entry.description}", "", entry.remedy or NOTHING_TO_DO
    )


def _exception(entry: ExceptionEntry) -> Explanation:
    description = f"{entry.title}: {entry.description}"
    return _made("exception", f"exception 0x{entry.code:02X}", "", description, entry.cause, entry.remedy)


def _refusal(entry: RefusalEntry) -> Explanation:
    description = f"{TITLES[entry.code]}, by the gateway itself" + (f": {entry.says}" if entry.says else "")
    return _made("exception", f"exception {code_of(entry)}", "", description, entry.cause, entry.remedy)


def _sentences() -> Iterator[Explanation]:
    for entry in STARTS:
        yield _made("start", entry.says, "", entry.description, entry.cause, entry.remedy)
    for refusal in REFUSALS:
        if refusal.says:
            what = f"exception {code_of(refusal)}: {TITLES[refusal.code]}"
            yield _made("exception", refusal.says, "", what, refusal.cause, refusal.remedy)


def _made(kind: str, name: str, *texts: str) -> Explanation:
    severity, description, cause, remedy = (plain(_with_page(text)) for text in texts)
    return Explanation(kind, name, severity, description, cause, remedy)


def _with_page(text: str) -> str:
    """Add the page of a heading to a link in a text."""
    return re.sub(r"(\]\(([a-z-]+\.md)#[^)]+\))", r"\1 in docs/\2", text)


def _fits(text: str, says: str) -> bool:
    """Whether a sentence contains the text of an entry, or a part of it is a part of that text."""
    parts: Mapping[str, str] = {part: re.escape(part) for part in says.split("…")}
    if re.search(".+".join(parts.values()), text):
        return True
    return len(text) >= FEWEST_LETTERS and text.lower() in says.lower()
