"""The status of a running gateway, from the better informed of its two processes; once, or continuously."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gateway.cli.output import Format, print_json, print_words
from gateway.ipc.client import NoRelayError, ask_relay

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from gateway.status.model import Model
    from gateway.supervisor.model import Limits

EVERY_S: Final = 0.5
CTRL_C_ENDS: Final = "Ctrl-C ends this view; the gateway goes on"


def read_status(config: Path, state: Path) -> "Model":
    """Return the status: the supervisor's, which includes the files, else that of the relay.

    Raises:
        NoRelayError: neither answers.
    """
    import msgspec

    from gateway.ipc.messages import GetStatus, Status
    from gateway.ipc.supervisor_client import NoSupervisorError, ask_supervisor
    from gateway.status.model import Model
    from gateway.supervisor.model import whole_model

    whole: Model | None = None
    try:
        whole = msgspec.convert(ask_supervisor(state, "/status"), Model)
    except (NoSupervisorError, msgspec.ValidationError):
        pass
    else:
        if whole.gateway.relay == "up":
            return whole
    try:
        reply = ask_relay(config, state, GetStatus())
    except NoRelayError:
        if whole is None:
            raise
        return whole
    assert isinstance(reply, Status), "a request for the status is answered by it"
    return whole_model(
        reply.status.gateway.name,
        reply.status,
        is_relay_up=True,
        snapshot_age_s=0.0,
        tables={},
        supervisor=None if whole is None else whole.supervisor,
        silent_after_s=_silent_after_s(config),
    )


def _silent_after_s(config: Path) -> "Limits":
    """Return what the file says of it, in spite of other problems in it: the relay does not know it."""
    from gateway.config.findings import Findings
    from gateway.config.included import read_configuration
    from gateway.config.problems import ConfigErrors
    from gateway.config.sections import read_sections

    try:
        return read_sections(Findings(read_configuration(config))).silent_after_s
    except ConfigErrors:
        return {}


def looks(config: Path, state: Path) -> Iterator["Model | str"]:
    """Yield the status repeatedly, or why there is none; the first one is required.

    Raises:
        NoRelayError: there is none at the beginning.
    """
    yield read_status(config, state)
    while True:
        time.sleep(EVERY_S)
        try:
            yield read_status(config, state)
        except NoRelayError as error:
            yield str(error)


def words_of(config: Path, status: "Model | str") -> "Iterator[RenderableType]":
    """Yield a status for a person; commands in it name this configuration."""
    from rich.text import Text

    from gateway.cli.status_output import status_parts

    if isinstance(status, str):
        yield Text(status, "red")
    else:
        yield from status_parts(status, config)


def watch(config: Path, seen: Iterator["Model | str"], *, as_json: bool) -> None:
    """Show each status until Ctrl-C: on a terminal in place, else one after the other at each change."""
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=False)
    try:
        if console.is_terminal and not as_json:
            _watch_in_place(config, console, seen)
        else:
            _watch_line_by_line(config, seen, as_json=as_json)
    except KeyboardInterrupt:
        return


def _watch_in_place(config: Path, console: "Console", seen: Iterator["Model | str"]) -> None:
    from rich.console import Group
    from rich.live import Live
    from rich.text import Text

    with Live(console=console, auto_refresh=False, vertical_overflow="crop") as live:
        for status in seen:
            live.update(Group(*words_of(config, status), "", Text(CTRL_C_ENDS, "dim")), refresh=True)


def _watch_line_by_line(config: Path, seen: Iterator["Model | str"], *, as_json: bool) -> None:
    before: object = None
    for status in seen:
        now = status if isinstance(status, str) else _lasting(status)
        if now == before:
            continue
        before = now
        if as_json:
            line = {"problem": status} if isinstance(status, str) else status.as_data()
            print_json(line, Format.LINE)
        else:
            print_words((f"-- {time.strftime('%H:%M:%S')}", *words_of(config, status), ""))


def _lasting(status: "Model") -> "Model":
    """Return a status without the values that change all the time."""
    from msgspec import UNSET
    from msgspec.structs import replace

    gateway = replace(status.gateway, uptime_s=None, snapshot_age_s=None, garbage=UNSET, loop=UNSET)
    return replace(status, gateway=gateway)
