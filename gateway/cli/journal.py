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
    _, entries, _ = _read(source)
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
    verification, _, _ = _read(source, since)
    last = verification.last
    if head is not None and (last is None or last["digest"] != head):
        verification.problems.append(f"the newest entry is not {head}")
    form = output.Format.INDENTED if as_json else output.Format.TEXT
    output.show(verification, form, (*verification.lines(), *output.notes(verification.notes)))
    _end_with(source, verification)


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

    verification, _, content = _read(config)
    try:
        write_file(file, content, force=force, is_secret=True)
    except FileExistsError:
        _end(f"{file}: exists already; --force replaces it")
    except FileRefusedError as error:
        _end(f"{file}: {error}")
    except OSError as error:
        _end(f"{file}: cannot be written ({error.strerror or error}); name a file in your own folder")
    output.print_words((*verification.lines(), *output.notes(verification.notes)))
    _end_with(config, verification)


@app.command()
def erase(
    config: Config,
    *,
    person: Annotated[
        str,
        typer.Option(
            "--person", metavar="NAME", help="Entries with exactly this name, login, user, address or broker."
        ),
    ] = "",
    before: Annotated[
        str, typer.Option("--before", metavar="DATE", help="Entries before this day, as in 2026-11-30.")
    ] = "",
) -> None:
    """Take out who it was, from entries of a person or before a day. What was done stays.

    The journal stays whole, and says in an entry which entries that were. The running supervisor does it.

    Exit code 1 if no supervisor runs, the disk is full, or no entry has that person.

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
    if person and not done["entries"]:
        _end(f"{config}: no entry has exactly {person}; `journal show --json` shows what is in `who`")
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


def _read(source: Path, since: str | None = None) -> "tuple[Verification, list[Entry], bytes]":
    """Return a journal, what is wrong with it, and its bytes; exit with code 1 if it cannot be read.

    An exported one has no bytes: they are in its file.
    """
    from gateway.state.interventions import Verification, read_journal

    try:
        if source.suffix == EXPORTED:
            verification = Verification(since=since)
            entries = list(verification.read((source,)))
            verification.finish(is_folder=False)
            return verification, entries, b""
        return read_journal(_folder_or_exit(source), since)
    except OSError as error:
        why = f"{error.filename or source}: {error.strerror or error}"
        _end(f"{why}; run this as the gateway's user or as root")


def _end_with(source: Path, verification: "Verification") -> None:
    """Say what is wrong, and end with exit code 1 if anything is."""
    output.print_lines((f"{source}: {problem}" for problem in verification.problems), err=True)
    if verification.problems:
        raise typer.Exit(1)


def _end(why: str) -> NoReturn:
    typer.echo(why, err=True)
    raise typer.Exit(1)
