"""``pitch-gateway reload CONFIG``."""

import contextlib
from pathlib import Path
from typing import Any, Final

import typer

from gateway.cli.arguments import AsJson, Config
from gateway.cli.output import Format, print_json

PATIENCE_S: Final = 60.0
"""For the supervisor: tables of a million points take seconds each."""
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
    """Read CONFIG and its tables anew, at once, and give the gateway that runs it what changed.

    A gateway that runs watches its table files by itself; this does not wait until they stand still. Each
    axis is for itself (a group as one): a bad table leaves what its axis had. Nothing moves by itself. Of
    CONFIG it takes tables, gains, limits such as max_correction, the end of a dry run (compensation from
    "shadow" to "on", while the axis stands at its target), the page and MQTT; with anything else changed
    nothing is taken, and what needs a restart is named. Without a gateway everything is kept for its start.

    Exit code 1 when anything is wrong; each problem is one line on stderr.

    Examples:
        pitch-gateway reload gateway.toml

        pitch-gateway reload gateway.toml --json
    """
    from gateway.ipc.notes import take_standard_error

    take_standard_error()  # the unit of the supervisor reloads so
    outcome = _outcome(config)
    problems: list[str] = outcome["all_problems"]
    if as_json:
        result = {
            "changed": list(outcome["comes"]),
            "comes": outcome["comes"],
            "gone": outcome["gone"],
            "keys": outcome["changed"],
            "problems": problems,
            "running": outcome["is_running"],
        }
        print_json(result, Format.JSON)
    else:
        _say(outcome)
    for problem in problems:
        typer.echo(problem, err=True)
    if problems:
        raise typer.Exit(1)


def _outcome(config: Path) -> dict[str, Any]:
    """Have the supervisor reload, or do it here where none answers."""
    from gateway.state.folder import StateError, state_folder

    with contextlib.suppress(StateError):  # what is wrong with it is said by whoever reads the whole of it
        state = state_folder(config)
        from gateway.ipc.supervisor_client import NoSupervisorError, ask_supervisor

        with contextlib.suppress(NoSupervisorError):
            outcome: dict[str, Any] = ask_supervisor(state, "/reload", "POST", PATIENCE_S)
            return outcome
    from gateway.supervisor.sights import ignore_broken_leases
    from gateway.supervisor.tables import Keeper

    ignore_broken_leases()
    return Keeper(config).reload().as_data()


def _say(outcome: dict[str, Any]) -> None:
    for axis, comes in outcome["comes"].items():
        if axis in outcome["gone"]:
            typer.echo(f"{axis}: it has no table any more; the old correction {GONE[comes]}")
        else:
            typer.echo(f"{axis}: its new correction {WORDS[comes]}")
    if outcome["changed"]:
        typer.echo(f"in force now: {', '.join(outcome['changed'])}")
    if not outcome["is_running"]:
        typer.echo("no gateway runs: everything is compiled for its start")
    elif not outcome["comes"] and not outcome["changed"] and not outcome["all_problems"]:
        typer.echo("nothing has changed")
