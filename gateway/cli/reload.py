"""``pitch-gateway reload CONFIG``."""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import typer

from gateway.cli.arguments import AsJson, Config
from gateway.cli.output import Format, print_lines, show
from gateway.plain import JsonObject

PATIENCE_S: Final = 60.0
"""For the supervisor: tables of a million points take seconds each."""
WORDS = {
    "next-target": "is applied at the next different target",
    "blended": "is blended in along the stream of setpoints",
    "not-in-force": "is applied when the axis is referenced, not in shadow mode, and its compensation is on",
}
GONE = {
    "next-target": "is removed at the next different target",
    "blended": "is blended out along the stream of setpoints",
    "not-in-force": "was not in force",
}


def reload(config: Config, *, as_json: AsJson = False) -> None:
    """Read CONFIG and its tables now, and apply the changes to the gateway that runs it.

    A running gateway also finds changed table files itself, after they have stopped changing. Each axis is
    checked separately, a group together: an axis with a bad table keeps its old one, and so does one whose
    file is still being written, until it is complete. No axis moves because of it. From CONFIG it applies
    tables, gains, limits such as max_correction, the page, MQTT, and the end of a dry run (compensation from
    "shadow" to "on", while the axis is at standstill at its target). If anything else changed, nothing is
    applied, and the command names what needs a restart. If no gateway runs, all is stored for its next start.

    Exit code 1 if there is a problem; each one is a line on stderr.

    Examples:
        pitch-gateway reload gateway.toml

        pitch-gateway reload gateway.toml --json
    """
    import msgspec

    from gateway.ipc.log import take_standard_error

    take_standard_error()  # the supervisor's unit reloads with this command
    found = msgspec.convert(_outcome(config), _Reloaded)
    show(found, Format.JSON if as_json else Format.TEXT)
    print_lines(found.all_problems, err=True)
    if found.all_problems:
        raise typer.Exit(1)


@dataclass(frozen=True, slots=True)
class _Reloaded:
    """The result as reported by the supervisor; see ``gateway.supervisor.outcome.Outcome``."""

    comes: Mapping[str, str]
    gone: Sequence[str]
    changed: Sequence[str]
    all_problems: Sequence[str]
    is_running: bool

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        return {
            "changed": list(self.comes),
            "comes": self.comes,
            "gone": self.gone,
            "keys": self.changed,
            "problems": self.all_problems,
            "running": self.is_running,
        }

    def lines(self) -> Iterator[str]:
        """Yield it in words, without the problems."""
        for axis, comes in self.comes.items():
            if axis in self.gone:
                yield f"{axis}: it has no table now; the old correction {GONE[comes]}"
            else:
                yield f"{axis}: its new correction {WORDS[comes]}"
        if self.changed:
            yield f"applied now: {', '.join(self.changed)}"
        if not self.is_running:
            yield "no gateway runs: all is compiled for its next start"
        elif not self.comes and not self.changed and not self.all_problems:
            yield "nothing has changed"


def _outcome(config: Path) -> JsonObject:
    """Let the supervisor reload, or do it here if none answers."""
    from gateway.state.folder import StateError, state_folder

    with contextlib.suppress(StateError):  # problems are reported by the complete load
        state = state_folder(config)
        from gateway.ipc.supervisor_client import NoSupervisorError, ask_supervisor

        with contextlib.suppress(NoSupervisorError):
            outcome: dict[str, Any] = ask_supervisor(state, "/reload", "POST", PATIENCE_S)
            return outcome
    from gateway.supervisor.file_stamps import ignore_broken_leases
    from gateway.supervisor.tables import Reloader

    ignore_broken_leases()
    return Reloader(config).reload().as_data()
