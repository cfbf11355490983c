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
from gateway.catalogue.on_page import ON_PAGE
from gateway.catalogue.refusals import REFUSALS
from gateway.catalogue.remarks import REMARKS
from gateway.catalogue.starts import STARTS
from gateway.catalogue.states import STATES
from gateway.status.line import LINE_COUNTERS
from gateway.status.model import COUNTERS

FEWEST_LETTERS: Final = 8
"""Minimum length of a part of a sentence; a shorter one would occur in many."""
FEWEST_OF_TITLE: Final = 4
"""Minimum length of a part of a title."""
MOST_TITLES: Final = 5
"""So many titles are proposed."""
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
    """Return all entries with this name or title on the page; an exception by its code, a sentence whole.

    Behind them are the troubles that they refer to.

    >>> [(found.kind, found.severity) for found in look_up("table-rejected")]
    [('event', 'error'), ('trouble', 'error')]
    >>> [(found.kind, found.name) for found in look_up("No controller")]
    [('trouble', 'controller-port-closed'), ('trouble', 'controller-absent')]
    >>> {found.name for found in look_up("0x0B")}
    {'exception 0x0B'}
    >>> look_up("nothing of that kind")
    []
    """
    text = asked.strip()
    wanted = _names_of(text)
    found = [entry for entry in _named() if entry.name.lower() in wanted]
    if (name := counter(text)) is not None:
        found.append(_counter(name))
    if (code := code_in(text)) is not None:
        found += [_exception(entry) for entry in EXCEPTIONS if entry.code == code]
        found += [_refusal(entry) for entry in REFUSALS if entry.code == code]
    found = found or [entry for entry in _sentences() if _is_in(entry.name, text)]
    return found + [trouble for trouble in _referred(found) if trouble not in found]


def look_up_part(asked: str) -> list[Explanation]:
    """Return the entries whose sentence has this part, or else those of the only title that has it.

    >>> [found.kind for found in look_up_part("beam")], look_up_part("silent")
    (['event', 'trouble'], [])
    """
    text = asked.strip().lower()
    if len(text) >= FEWEST_LETTERS and (
        found := [each for each in _sentences() if text in each.name.lower()]
    ):
        return found
    titles = _titles_with(text)
    return look_up(titles[0]) if len(titles) == 1 else []


def _names_of(text: str) -> set[str]:
    """Return the names that a text may mean: its own, and those of the entries with this title."""
    title = text.lower()
    names = {
        title,
        title.replace(" ", "-"),
        *(each.kind for each in ALARMS.values() if each.title.lower() == title),
    }
    return names | {ON_PAGE[title]} if title in ON_PAGE else names


def _titles_with(part: str) -> list[str]:
    """Return the titles on the page that have a part, each once; none for a part that is too short."""
    titles = (*ON_PAGE, *(each.title.lower() for each in ALARMS.values()))
    names_in_words = (entry.name.lower().replace("-", " ") for entry in _named())
    found = [each for each in dict.fromkeys((*titles, *names_in_words)) if part in each]
    return found if len(part) >= FEWEST_OF_TITLE else []


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
    """Return the likely intended words: names, the nearest first, then titles of which the text is a part."""
    text = asked.strip().lower()
    return [*get_close_matches(text, names(), n=3, cutoff=0.6), *_titles_with(text)[:MOST_TITLES]]


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


def _is_in(says: str, text: str) -> bool:
    """Whether a text contains the sentence of an entry."""
    return re.search(".+".join(map(re.escape, says.split("…"))), text) is not None
