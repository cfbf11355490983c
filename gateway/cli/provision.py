"""``pitch-gateway provision SITE --out DIR``."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.arguments import AsJson
from gateway.cli.output import Format, StderrLine, print_lines, show
from gateway.plain import JsonObject

if TYPE_CHECKING:
    from gateway.commissioning.provisioning.folder import Provisioned


def provision(
    site: Annotated[
        Path,
        typer.Argument(
            metavar="SITE", help="The machines of a site, a TOML file.", show_default=False, readable=False
        ),
    ],
    *,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder of the site.", show_default=False)
    ],
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would change; write nothing.")] = False,
    as_json: AsJson = False,
) -> None:
    """Make a folder for each machine of a site: configuration, certificate, token, broker user, target.

    SITE has what all machines have in common, and how each one differs. DIR gets machines/NAME for each
    machine, the users and the access list of the broker, a Prometheus target for each, and an inventory for
    Ansible. docs/fleet.md describes SITE and DIR.

    Each configuration is checked as by `check`; with an error nothing is written. Run it again after each
    change of SITE. Keys, tokens and passwords stay. A certificate is renewed 30 days before its end. A file
    that was changed by hand stays as it is. Nothing is ever deleted.

    Exit code 1 if SITE has errors, a file cannot be written, or a file was changed by hand.

    Examples:
      pitch-gateway provision site.toml --out plant --dry-run

      pitch-gateway provision site.toml --out plant

      pitch-gateway provision site.toml --out plant --json | jq .counts
    """
    from gateway.clock import now_utc
    from gateway.commissioning.provisioning.folder import BY_HAND, ProvisionError
    from gateway.commissioning.provisioning.folder import provision as provision_all
    from gateway.commissioning.provisioning.site import Site
    from gateway.config.problems import ConfigErrors

    def say(step: str) -> None:
        if sys.stderr.isatty():
            typer.echo(f"{step} ...", err=True)

    try:
        with TemporaryDirectory(prefix="pitch-gateway-") as work:
            made = provision_all(Site(site), out, now_utc(), Path(work), say, is_dry=dry_run)
    except ConfigErrors as errors:
        print_lines(map(str, errors.problems), err=True)
        raise typer.Exit(1) from None
    except ProvisionError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(1) from None
    show(_Shown(site, made), Format.INDENTED if as_json else Format.TEXT)
    if made.count(BY_HAND):
        raise typer.Exit(1)


@dataclass(frozen=True, slots=True)
class _Shown:
    """What came of a run, and of which file."""

    site: Path
    made: "Provisioned"

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        return self.made.as_data()

    def lines(self) -> Iterator[str]:
        """Yield it in words."""
        from gateway.commissioning.provisioning.folder import BY_HAND, SAME, STATES

        made = self.made
        yield from (StderrLine(f"warning: {warning}") for warning in made.warnings)
        for name, (state, why) in made.files.items():
            if state == BY_HAND:
                remedy = f"take the change into {self.site.name}, or delete the file, and run this again"
                yield StderrLine(f"{made.folder / name}: {state}: {why}; {remedy}")
            elif state != SAME:
                yield f"{name}: {state}{f' ({why})' if why else ''}"
        for name in made.left_over:
            yield StderrLine(f"note: {name}: not of {self.site.name} any more; remove it yourself")
        counts = ", ".join(f"{made.count(state)} {state}" for state in STATES if made.count(state))
        is_dry = "; nothing was written (--dry-run)" if made.is_dry else ""
        yield f"{made.folder}: {len(made.machines)} machines; files: {counts}{is_dry}"
