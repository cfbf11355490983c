"""Writes what the documents have from the code: ``python -m tools.docs``, or ``make docs``.

``--check`` writes nothing, and ends with exit code 1 where a document is not what the code says.
"""

import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby, takewhile
from pathlib import Path
from types import MappingProxyType
from typing import Final

from gateway.catalogue.alarms import ALARMS
from gateway.catalogue.entry import NOTHING_TO_DO, Severity, entries_of
from gateway.catalogue.events import GROUPS
from gateway.catalogue.exceptions import EXCEPTIONS, TITLES
from gateway.catalogue.lookup import code_of, severities
from gateway.catalogue.refusals import REFUSALS
from gateway.catalogue.remarks import REMARKS
from gateway.catalogue.starts import EXIT_CODES, STARTS
from gateway.catalogue.states import STATES
from gateway.config.reference import TABLES, rows
from gateway.drives.described import markdown_lines
from gateway.relay.status_unit import BLOCKS
from gateway.status.model import COUNTERS
from tools import state_machine, time_lines
from tools.diagram import LayoutError
from tools.markers import filled, table

DOCUMENTS: Final = Path(__file__).parents[1] / "docs"
_SHORT: Final = 6
"""A remedy of this many words is repeated, a longer one is named by the first row that has it."""
_OF_ALARM: Final = re.compile(r"(?:see|do what) the trouble (`\S+`)(?: says)?")


def part(name: str) -> str:
    """Return a generated part by its name.

    Raises:
        KeyError: nothing is called so.
    """
    if name.startswith("keys "):
        return keys(name.removeprefix("keys "))
    return PARTS[name]()


def keys(name: str) -> str:
    """Return the keys of a section of the configuration."""
    before = takewhile(lambda other: other != name, TABLES)
    told = {(row.key, row.description): other for other in before for row in rows(TABLES[other])}
    lines = [
        (
            f"`{row.key}`",
            row.kind,
            row.default,
            f"as in `{told[row.key, row.description]}`"
            if len(row.description.split()) > _SHORT and (row.key, row.description) in told
            else row.description,
        )
        for row in rows(TABLES[name])
    ]
    return table(("key", "type", "default", "meaning"), lines)


def _remedy(text: str) -> str:
    return "" if text == NOTHING_TO_DO else text


def _severity(text: str) -> str:
    """Return a severity; most are a warning, which is left out."""
    return "" if text == Severity.WARNING.value else text


def _cause_and_remedy(cause: str, remedy: str) -> tuple[str, str]:
    """Return both, of which the remedy alone names a trouble that has both."""
    texts = _OF_ALARM.sub(r"as trouble \1", cause), _OF_ALARM.sub(r"as trouble \1", _remedy(remedy))
    return ("", texts[1]) if texts[0] == texts[1] else texts


def _named_once(
    lines: Iterable[tuple[str, ...]], known: Mapping[str, str] = MappingProxyType({})
) -> list[tuple[str, ...]]:
    """Return rows whose last cell is written once: a later row with it names the first one.

    ``known`` has texts that the page has elsewhere, each with what names it.
    """

    def each() -> Iterator[tuple[str, ...]]:
        places = dict(known)
        for line in lines:
            own = f"as for {line[0]}"
            place = places.setdefault(line[-1], own)
            yield line if place == own or len(line[-1].split()) <= _SHORT else (*line[:-1], place)

    return list(each())


def _of_events() -> Mapping[str, str]:
    """Return the remedies of all events, each with the words that name the first one that has it."""
    entries = [entry for group in GROUPS for entry in entries_of(group)]
    return {entry.remedy: f"as event `{entry.name}`" for entry in reversed(entries)}


def events() -> str:
    """Return every event, by group."""
    texts = []
    for group in GROUPS:
        title = (group.__doc__ or "").split(":")[0].rstrip(".")
        lines = [
            (
                f"`{entry.name}`",
                _severity(severities(entry)),
                entry.description,
                *_cause_and_remedy(entry.cause, entry.remedy),
            )
            for entry in entries_of(group)
        ]
        head = ("event", "severity", "means", "usual cause", "remedy")
        texts.append(f"### {title}\n\n{table(head, _named_once(lines))}")
    return "\n".join(texts)


def troubles() -> str:
    """Return every kind of trouble."""
    lines = [
        (
            f"`{entry.kind}`",
            _severity(entry.severity.value),
            _shown_as(entry.title, entry.kind) + entry.description,
            entry.cause,
            entry.remedy,
        )
        for entry in ALARMS.values()
    ]
    return table(("trouble", "severity", "means", "usual cause", "remedy"), _named_once(lines))


def _shown_as(title: str, kind: str) -> str:
    """Return what an axis on the page shows, where its words are others than the name."""
    return "" if title.lower() in ("", kind.replace("-", " ")) else f"*{title}*: "


def states() -> str:
    """Return every state of the status model."""
    return "\n".join(
        f"`{key}`:\n\n"
        + table(
            ("state", "means", "what to do"),
            _named_once(
                (f"`{state.name}`", state.description, _OF_ALARM.sub(r"as trouble \1", _remedy(state.remedy)))
                for state in found
            ),
        )
        for key, found in STATES.items()
    )


def counters() -> str:
    """Return everything that is counted."""
    lines = [
        (
            f"`{name}`",
            "" if each.words.lower() == name.replace("_", " ") else each.words,
            each.description,
            each.remedy,
        )
        for name, each in COUNTERS.items()
    ]
    head = ("counter", "shown as", "counts", "what to do where it grows")
    return table(head, _named_once(lines, _of_events()))


def exceptions() -> str:
    """Return the exceptions of Modbus as drives answer them."""
    lines = [
        (f"0x{each.code:02X} {each.title}", each.description, each.cause, each.remedy) for each in EXCEPTIONS
    ]
    return table(("exception", "means", "usual cause", "remedy"), lines)


def refusals() -> str:
    """Return every exception that the gateway itself answers, by code."""
    texts = []
    for code, entries in groupby(REFUSALS, key=code_of):
        found = list(entries)
        lines = [(f"“{each.says}”" if each.says else "", each.cause, each.remedy) for each in found]
        title = f"{code} {TITLES[found[0].code]}"
        texts.append(f"### {title}\n\n{table(('detail in the log', 'cause', 'remedy'), lines)}")
    return "\n".join(texts)


def remarks() -> str:
    """Return every remark about a table."""
    lines = [(each.code, each.description, _severity(each.severity), each.remedy) for each in REMARKS]
    return table(("code", "what", "severity", "remedy"), _named_once(lines))


def starts() -> str:
    """Return why a process does not start."""
    lines = [(f"“{entry.says}”", entry.cause, entry.remedy) for entry in STARTS]
    return table(("what is said", "cause", "remedy"), lines)


def exit_codes() -> str:
    """Return the exit codes."""
    return table(("exit code", "means"), [(str(code), text) for code, text in EXIT_CODES.items()])


def status_registers() -> str:
    """Return the registers of the gateway's own unit id, block by block."""
    texts = []
    for block in BLOCKS:
        lines = [
            (f"+{each.offset}", each.name, "1" if each.words == 1 else "2, 32 bits", each.description)
            for each in block.registers
        ]
        title = f"From {block.first} on, {block.size} registers for {block.what}"
        texts.append(f"### {title}\n\n{table(('register', 'name', 'registers', 'holds'), lines)}")
    return "\n".join(texts)


def drives() -> str:
    """Return the shipped profiles."""
    return "".join(f"{line}\n" for line in markdown_lines())


def decisions() -> str:
    """Return every decision, with its title."""
    titles = {
        path.name: path.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")
        for path in sorted((DOCUMENTS / "decisions").glob("0*.md"))
    }
    return "".join(f"- [{title}]({name})\n" for name, title in titles.items())


PARTS: Final = {
    "events": events,
    "troubles": troubles,
    "states": states,
    "counters": counters,
    "exceptions": exceptions,
    "refusals": refusals,
    "remarks": remarks,
    "starts": starts,
    "exit codes": exit_codes,
    "status registers": status_registers,
    "drives": drives,
    "decisions": decisions,
    "motion": state_machine.motion,
    "references": state_machine.references,
    "transactions": state_machine.transactions,
    "stops": state_machine.stops,
    "blocks": state_machine.blocks,
    "reaches": state_machine.reaches,
    "cuts": state_machine.cuts,
}


def documents() -> Mapping[Path, str]:
    """Return every document, and every picture that is drawn from the code, as it has to be.

    Raises:
        LayoutError: a picture cannot be drawn.
    """
    pages = {path: filled(path.read_text(encoding="utf-8"), part) for path in sorted(DOCUMENTS.rglob("*.md"))}
    pictures = {**state_machine.pictures(), "cut-through.svg": time_lines.picture()}
    drawn = {DOCUMENTS / "pictures" / name: text for name, text in pictures.items()}
    return pages | drawn


def main() -> int:
    """Do what the command line says; returns the exit code."""
    is_check = sys.argv[1:] == ["--check"]
    try:
        wanted = documents()
    except LayoutError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    stale = [path for path, text in wanted.items() if not path.exists() or path.read_text("utf-8") != text]
    for path in stale:
        if is_check:
            sys.stderr.write(f"{path}: not what the code says; run: make docs\n")
        else:
            path.write_text(wanted[path], encoding="utf-8")
            sys.stdout.write(f"{path.relative_to(DOCUMENTS.parent)}\n")
    return int(is_check and bool(stale))


if __name__ == "__main__":
    sys.exit(main())
