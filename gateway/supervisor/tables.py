"""The tables of a configuration: read, checked, compiled, kept as the last good ones, handed to the relay."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gateway.config.compile import compile_into_state
from gateway.config.load import Loaded, load
from gateway.config.problems import ConfigErrors
from gateway.exchange.plan import AxisPlan
from gateway.ipc.client import NobodyListensError, NoGatewayError, ask
from gateway.ipc.compiled_plan import shape_of
from gateway.ipc.compiled_table import digest_of
from gateway.ipc.messages import (
    ClearTable,
    Done,
    GetStatus,
    Ping,
    Pong,
    Reply,
    SetTable,
    Status,
    TableFor,
)
from gateway.ipc.place import SocketError, socket_path
from gateway.ipc.plan import LinePlan
from gateway.ipc.sealed_memory import seal
from gateway.ipc.state_folder import StateError


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of bringing the tables up to date."""

    comes: Mapping[str, str]
    """How the new table of an axis comes into force, or the old one goes; the others are not there."""
    problems: tuple[str, ...] = ()
    is_running: bool = True
    """Whether a relay was there; without one the tables wait in the state folder for its start."""
    gone: tuple[str, ...] = ()
    """Axes whose table the configuration names no more."""


def bring_up_to_date(config: Path) -> Outcome:
    """Read the configuration with its tables anew, and give the relay those that are not in force.

    All or nothing: with one bad table, or anything else wrong, everything stays as it was. Blocks for as long
    as that takes.
    """
    try:
        loaded = load(config)
        path = socket_path(loaded.state_folder)
        is_running = _check_same(path, loaded)
        tables = compile_into_state(loaded)
        if not is_running:
            return Outcome({}, is_running=False)
        return _hand_over(path, loaded, tables)
    except ConfigErrors as errors:
        return Outcome({}, tuple(map(str, errors.problems)))
    except SocketError as error:
        return Outcome({}, (f"{config}: gateway.state: {error}",))
    except (StateError, NoGatewayError, OSError) as error:
        return Outcome({}, (f"{config}: {error}",))


def _check_same(path: Path, loaded: Loaded) -> bool:
    """Whether a relay runs; it has to run the same plan, but for its tables.

    Raises:
        StateError: it runs another one.
        NoGatewayError: it cannot be understood.
    """
    try:
        pong = ask(path, Ping())
    except NobodyListensError:
        return False
    if not isinstance(pong, Pong) or pong.shape != shape_of(loaded.plan):
        raise StateError(
            "it has changed in more than its tables since the gateway was started, and only tables are taken "
            "while it runs; restart the gateway"
        )
    return True


def _hand_over(path: Path, loaded: Loaded, tables: Mapping[str, bytes]) -> Outcome:
    reply = ask(path, GetStatus())
    axes: Mapping[str, Any] = reply.status["axes"] if isinstance(reply, Status) else {}
    comes: dict[str, str] = {}
    problems: list[str] = []
    gone = [name for name, axis in axes.items() if name not in tables and axis["table"]["points"]]
    for together in _together(loaded.plan.lines):
        changed = [
            axis
            for axis in together
            if axis.name in tables and axes[axis.name]["table"]["compiled"] != digest_of(tables[axis.name])
        ]
        if changed:
            done = _send(path, changed, tables)
            comes.update(done.comes)
            problems += done.problems
    if gone:
        done = _done(ask(path, ClearTable(axes=tuple(gone))))
        comes.update(done.comes)
        problems += done.problems
    return Outcome(comes, tuple(f"{loaded.path}: {problem}" for problem in problems), gone=tuple(gone))


def _together(lines: Sequence[LinePlan]) -> Iterator[list[AxisPlan]]:
    """Yield the axes that change together or not at all: each group, and every axis that is in none."""
    for line in lines:
        by_name = {axis.name: axis for axis in line.axes}
        for group in line.groups:
            yield [by_name.pop(name) for name in group if name in by_name]
        for axis in by_name.values():
            yield [axis]


def _send(path: Path, axes: Sequence[AxisPlan], tables: Mapping[str, bytes]) -> Done:
    descriptors: list[int] = []
    try:
        descriptors.extend(seal(tables[axis.name], f"table of {axis.name}") for axis in axes)
        request = SetTable(
            tables=tuple(
                TableFor(axis.name, axis.table_name, axis.table_format, axis.table_digest) for axis in axes
            )
        )
        reply = ask(path, request, descriptors=descriptors)
    finally:
        for descriptor in descriptors:
            os.close(descriptor)
    return _done(reply)


def _done(reply: Reply) -> Done:
    return reply if isinstance(reply, Done) else Done(problems=(f"answered by {type(reply).__name__}",))
