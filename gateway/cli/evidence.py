"""``pitch-gateway evidence CONFIG --out DIR``."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.arguments import AsJson, Config
from gateway.cli.output import Format, notes, print_lines, show
from gateway.plain import JsonObject

if TYPE_CHECKING:
    from gateway.commissioning.evidence.folder import Evidence


def evidence(
    config: Config,
    *,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="New or empty folder.", show_default=False)
    ],
    as_json: AsJson = False,
) -> None:
    """Write a folder for an auditor: packages, requirements met, limits, journal, configuration, tables.

    It has a list of what is installed (SBOM) with judged holes (VEX), IEC 62443-4-2 against CONFIG, what the
    gateway is not, a form on substantial modification, the journal of interventions, the configuration
    without secrets, the tables with reports, and the digest of each file. Begin with INDEX.md.
    docs/evidence.md says what each file answers, and what not.

    The gateway need not run. Run it as the gateway's user or as root: nobody else may read the journal.

    Exit code 1 if nothing was written; also if the journal is not whole or a table cannot be read: INDEX.md
    then says so.

    Examples:
      pitch-gateway evidence gateway.toml --out evidence

      pitch-gateway evidence gateway.toml --out evidence --json | jq '.files[].name'
    """
    from gateway.commissioning.evidence.folder import EvidenceError, check_folder, gather, write
    from gateway.config.load import load
    from gateway.config.problems import ConfigErrors

    def say(step: str) -> None:
        if sys.stderr.isatty():
            typer.echo(f"{step} ...", err=True)

    try:
        check_folder(out)
        loaded = load(config, checks_times=False, forgives_tables=True, is_elsewhere=True)
        made = gather(loaded, say)
        write(made, out)
    except ConfigErrors as errors:
        print_lines(map(str, errors.problems), err=True)
        raise typer.Exit(1) from None
    except EvidenceError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(1) from None
    show(_Written(out, made), Format.INDENTED if as_json else Format.TEXT)
    print_lines(made.problems, err=True)
    if made.problems:
        raise typer.Exit(1)


@dataclass(frozen=True, slots=True)
class _Written:
    """A folder and what is in it."""

    folder: Path
    made: "Evidence"

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        return {"folder": str(self.folder), **self.made.as_data()}

    def lines(self) -> Iterator[str]:
        """Yield it in words."""
        yield from notes(self.made.notes)
        yield f"{self.folder}: {len(self.made.files)} files; begin with INDEX.md"
