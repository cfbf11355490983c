"""``pitch-gateway reload CONFIG``."""

import json

import typer

from gateway.cli.arguments import Config
from gateway.cli.commanding import AsJson

WORDS = {
    "next-target": "comes into force with the next different target",
    "blended": "is blended in over the next stretch of setpoints",
    "not-in-force": "waits until the axis is referenced and its compensation on",
}
GONE = {
    "next-target": "goes with the next different target",
    "blended": "fades out over the next stretch of setpoints",
    "not-in-force": "was not in force",
}


def reload(config: Config, *, as_json: AsJson = False) -> None:
    """Read the tables of CONFIG anew, and give the gateway that runs it those that changed.

    All or nothing: with one bad table everything stays as it was. Nothing moves by itself. Only tables are
    taken while a gateway runs; after any other change of CONFIG it has to be restarted. Without a gateway the
    tables are kept for its start.

    Exit code 1 when anything is wrong; each problem is one line on stderr.

    Examples:
        pitch-gateway reload gateway.toml

        pitch-gateway reload gateway.toml --json
    """
    from gateway.supervisor.tables import Keeper

    outcome = Keeper(config).reload()
    problems = outcome.all_problems
    if as_json:
        result = {
            "changed": list(outcome.comes),
            "comes": dict(outcome.comes),
            "problems": list(problems),
            "running": outcome.is_running,
        }
        typer.echo(json.dumps(result))
    else:
        for axis, comes in outcome.comes.items():
            if axis in outcome.gone:
                typer.echo(f"{axis}: it has no table any more; the old correction {GONE[comes]}")
            else:
                typer.echo(f"{axis}: its new table {WORDS[comes]}")
        if not outcome.is_running:
            typer.echo("no gateway runs: the tables are compiled for its start")
        elif not outcome.comes and not problems:
            typer.echo("nothing to change: all tables are in force already")
    for problem in problems:
        typer.echo(problem, err=True)
    if problems:
        raise typer.Exit(1)
