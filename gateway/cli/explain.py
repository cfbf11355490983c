"""``pitch-gateway explain NAME``."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gateway.cli.arguments import AsJson
from gateway.cli.output import Format, show
from gateway.plain import JsonObject

if TYPE_CHECKING:
    from gateway.catalogue.lookup import Explanation


def _complete(incomplete: str) -> list[str]:
    from gateway.catalogue.lookup import names
    from gateway.config.reference import all_keys

    return [name for name in (*names(), *all_keys()) if name.startswith(incomplete)]


def _of_other_languages(asked: str) -> "list[Explanation]":
    """Return the entries whose text on the page is this one in another language than English."""
    import json
    from pathlib import Path

    from gateway.catalogue.lookup import look_up
    from gateway.supervisor import page

    text = asked.strip().lower()
    found: list[Explanation] = []
    for name in page.FILES:
        if name.endswith(".json"):
            texts: Mapping[str, str] = json.loads((Path(page.__file__).parent / name).read_text("utf-8"))
            same = (english for english, other in texts.items() if other.lower() == text)
            found += [each for english in same for each in look_up(english)]
    return list(dict.fromkeys(found))


def _keys(asked: str) -> "list[Explanation]":
    """Return the keys of the configuration with this name."""
    from gateway.catalogue.lookup import Explanation, plain
    from gateway.config.reference import find_keys

    found = []
    for table, row in find_keys(asked):
        default = f"; default: {row.default}" if row.default else ""
        description = plain(f"{row.description} ({row.kind}{default})")
        found.append(Explanation("key", f"{table}.{row.key}", "", description, "", ""))
    return found


@dataclass(frozen=True, slots=True)
class _Everything:
    """Everything with a name, by its kind, except the keys."""

    parts: "Mapping[str, Sequence[Explanation]]"

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        return {kind: [entry.as_data() for entry in entries] for kind, entries in self.parts.items()}

    def lines(self) -> Iterator[str]:
        """Yield names and meanings."""
        for kind, entries in self.parts.items():
            yield f"{kind}:"
            yield from (f"  {entry.name:<24}  {entry.meaning}" for entry in entries)


@dataclass(frozen=True, slots=True)
class _Found:
    """The explanations of a name."""

    entries: "Sequence[Explanation]"

    def as_data(self) -> list[Any]:
        """Return it as plain data."""
        return [entry.as_data() for entry in self.entries]

    def lines(self) -> Iterator[str]:
        """Yield it in words."""
        for number, entry in enumerate(self.entries):
            if number:
                yield ""
            severity = f", {entry.severity}" if entry.severity else ""
            yield f"{entry.name} ({entry.kind}{severity})"
            for word, text in (("means", entry.meaning), ("cause", entry.cause), ("remedy", entry.remedy)):
                if text:
                    yield f"  {word + ':':<8}{text}"


def explain(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME",
            help=(
                "Event, title on the page, state, counter, exception, remark, log message, or key; "
                "none: list all but the keys."
            ),
            show_default=False,
            autocompletion=_complete,
        ),
    ] = None,
    *,
    as_json: AsJson = False,
) -> None:
    """Explain an event, an error, a state or a counter: meaning, usual cause, remedy.

    It knows the events of log, MQTT and page; the titles of the page ("Table rejected"), in each of its
    languages; the states of an axis; the counters of status, page and metrics; Modbus exceptions of drives
    and of the gateway, in any notation (0x0B, 0Bh, 11, "83 0B", ILLEGAL_DATA_ADDRESS) or by their log
    message; reasons why a relay does not start; remarks about tables (L8, R2); and the keys of the
    configuration. docs/messages.md, docs/tab-format.md and docs/configuration.md have the same texts.

    If a remedy names a key, change it in the configuration, then run `pitch-gateway reload CONFIG`. It
    applies the change, or says that the gateway needs a restart.

    Exit code 1 if the name is unknown.

    Examples:
        pitch-gateway explain drive-silent

        pitch-gateway explain "Table rejected"

        pitch-gateway explain 0x04

        pitch-gateway explain crc_errors

        pitch-gateway explain L8

        pitch-gateway explain "it has not been compiled yet"

        pitch-gateway explain axis.travel_margin

        pitch-gateway explain --json | jq '.event[].name'
    """
    from gateway.catalogue.lookup import everything, look_up, look_up_part, near

    form = Format.INDENTED if as_json else Format.TEXT
    if name is None:
        show(_Everything(everything()), form)
        return
    found = [*look_up(name), *_keys(name)] or look_up_part(name) or _of_other_languages(name)
    if not found:
        meant = ", ".join(f'"{each}"' if " " in each else each for each in near(name))
        hint = f"did you mean {meant}?" if meant else "list all names with: pitch-gateway explain"
        typer.echo(f'"{name}" is unknown; {hint}', err=True)
        raise typer.Exit(1)
    show(_Found(found), form)
