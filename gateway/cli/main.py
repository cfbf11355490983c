"""``pitch-gateway``: the commands, each in a file of its own."""

import sys
from typing import Annotated

import typer

from gateway import __version__
from gateway.cli import (
    budget,
    certificate,
    check,
    demo,
    disable,
    drives,
    enable,
    explain,
    init,
    measure,
    probe,
    record,
    reference,
    relay,
    reload,
    replay,
    run,
    service,
    signtest,
    simulate,
    status,
    supervise,
    table,
    token,
)
from gateway.cli.standard_streams import Output, OutputLostError
from gateway.compiled import is_compiled

app = typer.Typer(
    name="pitch-gateway",
    help="Leadscrew error compensation in the Modbus cable between a motion controller and its drives.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("demo")(demo.demo)
app.command("run")(run.run)
app.command("relay")(relay.relay)
app.command("supervise")(supervise.supervise)
app.command("check")(check.check)
app.command("budget")(budget.budget)
app.command("probe")(probe.probe)
app.command("measure")(measure.measure)
app.command("signtest")(signtest.signtest)
app.command("status")(status.status)
app.command("explain")(explain.explain)
app.command("enable")(enable.enable)
app.command("disable")(disable.disable)
app.command("reference")(reference.reference)
app.command("reload")(reload.reload)
app.command("record")(record.record)
app.command("replay")(replay.replay)
app.command("init")(init.init)
app.command("token")(token.token)
app.command("service")(service.service)
app.command("simulate")(simulate.simulate)
app.add_typer(table.app, name="table")
app.add_typer(drives.app, name="drives")
app.add_typer(certificate.app, name="certificate")


def _show_version(value: bool) -> None:
    if value:
        sys.stdout.write(f"pitch-gateway {__version__}{' (compiled)' if is_compiled() else ''}\n")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    """Leadscrew error compensation in the Modbus cable between a motion controller and its drives."""


def main() -> None:
    """Run the command line; exit codes: 0 good, 1 the input is bad, 2 wrong usage.

    Output that cannot be written is one line on stderr and exit code 1; a closed pipe (``| head``) needs no
    words, for whoever closed it knows.
    """
    output = Output()
    try:
        try:
            app()
        finally:
            output.finish()
    except OutputLostError as error:
        if not error.is_closed_pipe:
            typer.echo(f"standard output cannot be written to: {error}", err=True)
        sys.exit(1)
