"""The status of a gateway that runs, from whichever of its two processes can tell more; once, or for ever."""

import json
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gateway.ipc.client import NoRelayError, ask_relay

if TYPE_CHECKING:
    from rich.console import Console

EVERY_S: Final = 0.5
CHANGES_ANYWAY: Final = frozenset({"uptime_s", "snapshot_age_s", "garbage", "loop"})
"""Keys of ``gateway`` that are new in every look."""
CTRL_C_ENDS: Final = "Ctrl-C ends it; the gateway goes on"


def look(config: Path, state: Path) -> Mapping[str, Any]:
    """Return the status: the supervisor's where it answers, which knows the files, else what the relay says.

    Raises:
        NoRelayError: neither of them does.
    """
    from gateway.ipc.messages import GetStatus, Status
    from gateway.ipc.supervisor_client import NoSupervisorError, ask_supervisor
    from gateway.supervisor.model import whole_model

    whole: Mapping[str, Any] | None = None
    try:
        whole = ask_supervisor(state, "/status")
    except NoSupervisorError:
        pass
    else:
        if whole is not None and whole["gateway"]["relay"] == "up":
            return whole
    try:
        reply = ask_relay(config, state, GetStatus())
    except NoRelayError:
        if whole is None:
            raise
        return whole
    assert isinstance(reply, Status), "a request for the status is answered by it"
    return whole_model(
        reply.status["gateway"]["name"],
        reply.status,
        is_relay_up=True,
        snapshot_age_s=0.0,
        tables={},
        supervisor=None if whole is None else whole["supervisor"],
    )


def looks(config: Path, state: Path) -> Iterator[Mapping[str, Any] | str]:
    """Yield the status again and again, or why there is none; the first one has to be there.

    Raises:
        NoRelayError: there is nobody to begin with.
    """
    yield look(config, state)
    while True:
        time.sleep(EVERY_S)
        try:
            yield look(config, state)
        except NoRelayError as error:
            yield str(error)


def watch(seen: Iterator[Mapping[str, Any] | str], *, as_json: bool) -> None:
    """Show each look until Ctrl-C: on a terminal in place, else one after the other as something changes."""
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=False)
    try:
        if console.is_terminal and not as_json:
            _watch_in_place(console, seen)
        else:
            _watch_line_by_line(console, seen, as_json=as_json)
    except KeyboardInterrupt:
        return


def _watch_in_place(console: "Console", seen: Iterator[Mapping[str, Any] | str]) -> None:
    from rich.console import Group
    from rich.live import Live
    from rich.text import Text

    from gateway.cli.status_output import status_parts

    with Live(console=console, auto_refresh=False, vertical_overflow="crop") as live:
        for status in seen:
            parts = [Text(status, "red")] if isinstance(status, str) else status_parts(status)
            live.update(Group(*parts, "", Text(CTRL_C_ENDS, "dim")), refresh=True)


def _watch_line_by_line(
    console: "Console", seen: Iterator[Mapping[str, Any] | str], *, as_json: bool
) -> None:
    from gateway.cli.status_output import show_status

    before: object = None
    for status in seen:
        now = status if isinstance(status, str) else _lasting(status)
        if now == before:
            continue
        before = now
        if as_json:
            line = {"problem": status} if isinstance(status, str) else status
            sys.stdout.write(f"{json.dumps(line, ensure_ascii=False)}\n")
        else:
            console.print(f"-- {time.strftime('%H:%M:%S')}")
            if isinstance(status, str):
                console.print(status, markup=False)
            else:
                show_status(console, status)
            console.print()
        sys.stdout.flush()


def _lasting(status: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a status without what changes while nothing happens."""
    gateway = {key: value for key, value in status["gateway"].items() if key not in CHANGES_ANYWAY}
    return {**status, "gateway": gateway}
