"""``pitch-gateway journal``: the journal of interventions."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, NoReturn

import typer

from gateway.cli import output
from gateway.cli.arguments import AsJson, Config
from gateway.plain import JsonObject
from gateway.report.words import clean

if TYPE_CHECKING:
    from gateway.state.interventions import Entry, Verification

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)

PATIENCE_S: Final = 60.0
"""For the supervisor, which writes every file anew that has something to erase."""
SHOWN: Final = 12
"""Characters of a digest in a text."""
DIGEST: Final = 64
EXPORTED: Final = ".jsonl"
Source = Annotated[
    Path,
    typer.Argument(
        metavar="CONFIG",
        help="Configuration, or an exported journal (.jsonl).",
        show_default=False,
        readable=False,
    ),
]


@app.callback()
def interventions() -> None:
    """Show, verify and export the journal of interventions: who changed tables, gains or settings, and when.

    The supervisor writes it into the state folder of CONFIG. Each entry has the digest of the one before.
    docs/journal.md says what that proves, and what not.

    Examples:
      pitch-gateway journal show gateway.toml --last 20

      pitch-gateway journal verify gateway.toml

      pitch-gateway journal export gateway.toml journal.jsonl
    """


@app.command()
def show(
    source: Source,
    *,
    last: Annotated[int | None, typer.Option("--last", min=1, help="Only so many, the newest.")] = None,
    as_json: AsJson = False,
) -> None:
    """Show the interventions, oldest first: number, time, what, before and after, how it came, and who.

    Digests are shortened; --json has everything. Exit code 1 if there is no journal.

    Examples:
      pitch-gateway journal show gateway.toml

      pitch-gateway journal show gateway.toml --json | jq '.[] | select(.what == "table")'
    """
    _, entries = _read(source)
    chosen = entries[-last:] if last else entries
    output.show(_Shown(chosen), output.Format.INDENTED if as_json else output.Format.TEXT)


@app.command()
def verify(
    source: Source,
    *,
    since: Annotated[
        str | None,
        typer.Option("--since", metavar="DIGEST", help="Check from this entry on; it must be there."),
    ] = None,
    head: Annotated[
        str | None, typer.Option("--head", metavar="DIGEST", help="The newest entry must be this one.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check that nothing in the journal was changed, cut, doubled or reordered; name each bad line.

    Who may write the state folder can write a whole new journal. Only a digest that was kept elsewhere
    shows that: give it to --since, or to --head if nothing has happened since.

    Exit code 0 if the journal is whole; 1 if not, or if there is none.

    Examples:
      pitch-gateway journal verify gateway.toml

      pitch-gateway journal verify gateway.toml --json
    """
    verification, _ = _read(source, since)
    last = verification.last
    problems = list(verification.problems)
    if head is not None and (last is None or last["digest"] != head):
        problems.append(f"the newest entry is not {head}")
    output.show(_Verified(verification, problems), output.Format.INDENTED if as_json else output.Format.TEXT)
    output.print_lines((f"{source}: {problem}" for problem in problems), err=True)
    if problems:
        raise typer.Exit(1)


@app.command()
def export(
    config: Config,
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="File for the journal (.jsonl).", show_default=False)
    ],
    *,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """Write the whole journal into one file, and print the digest of its newest entry.

    Keep that digest where the plant cannot change it: `verify --since DIGEST` checks against it
    later. The file can be verified anywhere.

    Exit code 1 if there is no journal, it is not whole, or FILE exists. A journal that is not whole is
    exported too.

    Examples:
      pitch-gateway journal export gateway.toml journal.jsonl

      pitch-gateway journal export gateway.toml journal.jsonl --force
    """
    from gateway.files import FileRefusedError, write_file

    content: list[bytes] = []
    verification, _ = _read(config, copy=content)
    try:
        write_file(file, b"".join(content), force=force, is_secret=True)
    except FileExistsError:
        _end(f"{file}: exists already; --force replaces it")
    except FileRefusedError as error:
        _end(f"{file}: {error}")
    except OSError as error:
        _end(f"{file}: cannot be written ({error.strerror or error}); name a file in your own folder")
    output.print_words(_Verified(verification, verification.problems).lines())
    output.print_lines((f"{config}: {problem}" for problem in verification.problems), err=True)
    if verification.problems:
        raise typer.Exit(1)


@app.command()
def erase(
    config: Config,
    *,
    person: Annotated[
        str,
        typer.Option("--person", metavar="NAME", help="Entries with this name, user or address."),
    ] = "",
    before: Annotated[
        str, typer.Option("--before", metavar="DATE", help="Entries before this day, as in 2026-11-30.")
    ] = "",
) -> None:
    """Take out who it was, from entries of a person or before a day. What was done stays.

    The journal stays whole, and says in an entry which entries that were. The running supervisor does it.

    Exit code 1 if no supervisor runs, or the disk is full.

    Examples:
      pitch-gateway journal erase gateway.toml --person anna

      pitch-gateway journal erase gateway.toml --before 2021-12-01
    """
    from urllib.parse import urlencode

    from gateway.cli.configuration import state_folder_or_exit
    from gateway.ipc.supervisor_client import NoSupervisorError, ask_supervisor

    if bool(person) == bool(before):
        raise typer.BadParameter("give one of --person and --before")
    try:
        day = datetime.fromisoformat(before).date().isoformat() if before else ""
    except ValueError:
        raise typer.BadParameter(
            f"{before} is no day; write it as in 2026-11-30", param_hint="--before"
        ) from None
    try:
        query = urlencode({"person": person, "before": day})
        done = ask_supervisor(state_folder_or_exit(config), f"/journal/erase?{query}", "POST", PATIENCE_S)
    except NoSupervisorError as error:
        _end(f"{config}: {error}; the supervisor has to run: it alone writes the journal")
    typer.echo(f"who was taken out of {done['entries']} entries")


@dataclass(frozen=True, slots=True)
class _Shown:
    """Entries."""

    entries: Sequence["Entry"]

    def as_data(self) -> list[JsonObject]:
        """Return them as plain data."""
        return list(self.entries)

    def lines(self) -> Iterator[str]:
        """Yield a line for each."""
        for entry in self.entries:
            subject = " ".join(filter(None, (entry["what"], entry["axis"], entry["file"])))
            change = f"{_short(entry['before'])} → {_short(entry['after'])}"
            who = entry["who"] or {}
            shown = " ".join(f"{key}={value}" for key, value in who.items() if key != "salt")
            if entry["who"] is None and entry["who_digest"] is not None:
                shown = "(taken out)"
            line = f"{entry['seq']}  {entry['time']}  {subject}: {change}  {entry['via']}  {shown}"
            yield clean(line.rstrip())  # a program's name could control the terminal


@dataclass(frozen=True, slots=True)
class _Verified:
    """What a check found."""

    verification: "Verification"
    problems: Sequence[str]

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        found = self.verification
        return {
            "whole": not self.problems,
            "entries": found.entries,
            "first": found.first and {key: found.first[key] for key in ("seq", "time", "digest")},
            "last": found.last and {key: found.last[key] for key in ("seq", "time", "digest")},
            "notes": list(found.notes),
            "problems": list(self.problems),
        }

    def lines(self) -> Iterator[str]:
        """Yield it in words, without the problems."""
        first, last = self.verification.first, self.verification.last
        if first is not None and last is not None:
            count = self.verification.entries
            yield f"{count} entries, from {first['time']} to {last['time']}"
            yield f"newest entry: {last['seq']}, digest {last['digest']}"
        yield from output.notes(self.verification.notes)
        if not self.problems:
            yield "whole: nothing was changed, cut, doubled or reordered"


def _short(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, str):
        return value[:SHOWN] if len(value) == DIGEST else value
    return json.dumps(value, ensure_ascii=False)


def _folder_or_exit(config: Path) -> Path:
    from gateway.cli.configuration import state_folder_or_exit
    from gateway.state.interventions import FOLDER_NAME

    folder = state_folder_or_exit(config) / FOLDER_NAME
    if not folder.is_dir():
        _end(f"{folder}: there is no journal; the supervisor begins one when it first runs")
    return folder


def _read(
    source: Path, since: str | None = None, copy: list[bytes] | None = None
) -> "tuple[Verification, list[Entry]]":
    """Return a journal and what is wrong with it; exit with code 1 if it cannot be read.

    ``copy`` gets the same bytes.
    """
    from gateway.state.interventions import Verification, files_in, head_in, locked

    try:
        if source.suffix == EXPORTED:
            verification = Verification(since=since)
            entries = list(verification.read((source,)))
            verification.finish(is_folder=False)
            return verification, entries
        folder = _folder_or_exit(source)
        with locked(folder):
            verification = Verification(head_in(folder), since)
            entries = list(verification.read(files_in(folder)))
            if copy is not None:
                copy += (path.read_bytes() for path in files_in(folder))
        verification.finish()
    except OSError as error:
        why = f"{error.filename or source}: {error.strerror or error}"
        _end(f"{why}; run this as the gateway's user or as root")
    return verification, entries


def _end(why: str) -> NoReturn:
    typer.echo(why, err=True)
    raise typer.Exit(1)
