"""What users rely on by name, read from the program: ``python -m tests.promises.promises`` adds what is new.

``promises.txt`` is what was promised before. It only grows. What goes or changes breaks somebody's
configuration, script, dashboard or alarm: it needs an alias, and a line in the CHANGELOG.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from typer.main import get_command

from gateway.catalogue.alarms import ALARMS
from gateway.catalogue.entry import entries_of
from gateway.catalogue.events import GROUPS
from gateway.catalogue.exceptions import EXCEPTIONS
from gateway.catalogue.lookup import code_of, severities
from gateway.catalogue.refusals import REFUSALS
from gateway.catalogue.remarks import REMARKS
from gateway.catalogue.starts import EXIT_CODES
from gateway.catalogue.states import STATES
from gateway.cli.app import app
from gateway.config.reference import TABLES, rows
from gateway.drives.library import names
from gateway.relay.status_unit import BLOCKS
from gateway.status.model import COUNTERS
from gateway.tabfile import DIALECTS
from tests.promises.listing import Listed, write

FILE: Final = Path(__file__).with_name("promises.txt")


def promises() -> Listed:
    """Return every promise."""
    return {*_keys(), *_codes(), *_registers(), *_commands(get_command(app), "pitch-gateway"), *_names()}


def _keys() -> Iterator[tuple[str, str]]:
    for section, table in TABLES.items():
        for row in rows(table):
            # What follows "none: " explains; it promises nothing.
            default = "none" if row.default.startswith("none: ") else row.default
            yield f"key {section}", f"{row.key} | {row.kind} | {default}".rstrip()


def _codes() -> Iterator[tuple[str, str]]:
    for group in GROUPS:
        yield from (("event", f"{entry.name} {severities(entry)}") for entry in entries_of(group))
    yield from (("trouble", f"{entry.kind} {entry.severity.value}") for entry in ALARMS.values())
    yield from (("refusal", code_of(entry)) for entry in REFUSALS)
    yield from (("remark", f"{entry.code} {entry.severity}") for entry in REMARKS)
    yield from (("exception", f"0x{entry.code:02X} {entry.title}") for entry in EXCEPTIONS)
    yield from (("exit code", str(code)) for code in EXIT_CODES)
    yield from (("counter", name) for name in COUNTERS)
    for kind, entries in STATES.items():
        yield from ((f"state {kind}", entry.name) for entry in entries)


def _registers() -> Iterator[tuple[str, str]]:
    for block in BLOCKS:
        for each in block.registers:
            place = f"{block.first}+{each.offset}"
            yield f"status registers of {block.size}", f"{place} {each.name}, {each.words} word"


def _commands(command: Any, path: str) -> Iterator[tuple[str, str]]:
    yield "command", path
    for parameter in command.params:
        if parameter.param_type_name == "option":
            yield f"option {path}", " ".join(sorted((*parameter.opts, *parameter.secondary_opts)))
        else:
            yield f"argument {path}", parameter.name
    for name, child in getattr(command, "commands", {}).items():
        yield from _commands(child, f"{path} {name}")


def _names() -> Iterator[tuple[str, str]]:
    yield from (("drive", name) for name in names())
    yield from (("table format", dialect.name) for dialect in DIALECTS)


if __name__ == "__main__":
    write(FILE, promises())
    sys.stdout.write(f"{FILE}\n")
