"""The tables of a configuration: read, checked, compiled, kept as the last good ones, handed to the relay."""

import os
import re
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from gateway.config.compile import compile_into_state, keys_of, sources_of
from gateway.config.document import parse_document
from gateway.config.last_good import Settled, Source, settle
from gateway.config.load import Loaded, load, load_document, reread_tables
from gateway.config.problems import ConfigErrors
from gateway.exchange.control import limits_of
from gateway.exchange.plan import AxisPlan
from gateway.ipc.client import NobodyListensError, NoGatewayError, ask
from gateway.ipc.compiled_plan import CompiledPlan, last_plan, shape_of
from gateway.ipc.compiled_table import digest_of
from gateway.ipc.messages import (
    ClearTable,
    Done,
    GetStatus,
    Ping,
    Pong,
    Reply,
    Request,
    SetGain,
    SetLimits,
    SetTable,
    Status,
    TableFor,
)
from gateway.ipc.place import SocketError, socket_path
from gateway.ipc.plan import LinePlan
from gateway.ipc.sealed_memory import seal
from gateway.ipc.state_folder import StateError, state_folder
from gateway.supervisor.home import Home
from gateway.supervisor.outcome import Outcome
from gateway.supervisor.sights import look

_LIVE: Final = re.compile(
    r"axis\.[^.]+\.(table|table_options\..*|gain(\..*)?|max_correction|max_slope|travel_margin|budget_us)"
    r"|gateway\.tables|(http|mqtt)(\..*)?"
)
"""Keys whose values a gateway that runs can be given."""


class _NeedsRestartError(StateError):
    """The relay runs what cannot be changed while it runs."""


class Keeper:
    """Keeps the tables, gains and limits of a relay as its configuration has them.

    Everything here blocks for as long as it takes; one thread calls at a time.
    """

    def __init__(self, config: Path) -> None:
        self._config = config
        self.loaded: Loaded | None = None
        """The configuration that was taken last; None as long as none could be."""
        self._home = Home()

    @property
    def names(self) -> dict[str, str]:
        """Name of the table file of each axis that has one, as the configuration has it."""
        return {} if self.loaded is None else _names(self.loaded)

    def reload(self) -> Outcome:
        """Read the configuration and its tables anew, and take over what has changed.

        A table file that is being written counts for nothing yet.
        """
        before = self.loaded
        try:
            outcome = self._take(load(self._config, forgives_tables=True), ())
        except ConfigErrors as errors:
            outcome = Outcome(problems=tuple(map(str, errors.problems)))
        if self.loaded is before:
            outcome = replace(outcome, is_refused=True)
        if self.loaded is None:
            self.loaded = self._as_compiled()
        return outcome

    def refresh(self, waiting: Collection[str] = ()) -> Outcome:
        """Read the tables of the configuration that was taken; as :meth:`reload`.

        Axes in ``waiting`` have a table file that counts for nothing yet.
        """
        if self.loaded is None:
            return self.reload()
        try:
            return self._take(self.loaded, waiting)
        except ConfigErrors as errors:
            return Outcome(problems=tuple(map(str, errors.problems)))

    def _as_compiled(self) -> Loaded | None:
        """Return the configuration that was compiled last, where the one in the file cannot be taken now."""
        try:
            before = last_plan(state_folder(self._config))
            if before is None:
                return None
            document = parse_document(self._config, before.configuration, _digest_of(self._config, before))
            return load_document(document, checks_times=False, forgives_tables=True)
        except (StateError, ConfigErrors):
            return None

    def _take(self, configured: Loaded, waiting: Collection[str]) -> Outcome:
        names = _names(configured)
        seen = look(configured.tables_folder, names.values())
        loaded = reread_tables(configured)
        seen_after = look(configured.tables_folder, names.values())
        read = {
            name: sight
            for name, sight in seen.items()
            if sight == seen_after[name] and not sight.is_being_written
        }
        unread = {axis for axis, name in names.items() if name not in read}
        strange = self._home.what_is_strange(loaded.tables_folder, loaded.readings.values())
        if strange:
            unread = set(names)
        outcome = self._bring(loaded, unread.union(waiting))
        if strange:
            outcome = replace(outcome, problems=(*outcome.problems, strange))
        if self.loaded is not loaded:
            return outcome  # nothing was brought anywhere: the files are still to be read
        return replace(
            outcome, sights={name: read[name] for axis, name in names.items() if axis not in outcome.waiting}
        )

    def _bring(self, loaded: Loaded, waiting: Collection[str]) -> Outcome:
        before = last_plan(loaded.state_folder)
        try:
            path = socket_path(loaded.state_folder)
            is_running = _check_same(path, loaded, before)
            settled = settle(
                loaded, before.plan if before else None, is_start=not is_running, waiting=waiting
            )
            outcome = _found(loaded, settled, waiting, is_running=is_running)
            if settled.refused:
                return outcome
            if before is not None:
                outcome = replace(outcome, changed=tuple(_changed_keys(loaded, before)))
            tables = compile_into_state(loaded, settled.plan)
            self.loaded = loaded
            if not is_running:
                return outcome
            return _hand_over(path, settled, before, tables, outcome)
        except SocketError as error:
            return Outcome(problems=(f"{self._config}: gateway.state: {error}",))
        except (StateError, NoGatewayError, OSError) as error:
            is_passing = not isinstance(error, _NeedsRestartError)
            return Outcome(problems=(f"{self._config}: {error}",), is_passing=is_passing)


def _digest_of(config: Path, before: CompiledPlan) -> str:
    return before.sources.get(str(config.resolve()), "")


def _names(loaded: Loaded) -> dict[str, str]:
    return {axis: reading.name for axis, reading in loaded.readings.items()}


def _check_same(path: Path, loaded: Loaded, before: CompiledPlan | None) -> bool:
    """Whether a relay runs; it has to run the same plan, but for what it can be given.

    Raises:
        _NeedsRestartError: it runs another one; with the keys that need a restart.
        NoGatewayError: it cannot be understood.
    """
    try:
        pong = ask(path, Ping())
    except NobodyListensError:
        return False
    if not isinstance(pong, Pong) or pong.shape != shape_of(loaded.plan):
        need = [] if before is None else _need_restart(loaded, before)
        what = ", ".join(need) or "more than a gateway that runs can be given"
        raise _NeedsRestartError(
            f"changed since the gateway was started: {what}; restart the gateway to take it over"
        )
    return True


def _need_restart(loaded: Loaded, before: CompiledPlan) -> list[str]:
    """Return what has changed that a gateway that runs cannot be given: keys, and profiles of drives."""
    profiles = [
        name for name, digest in sources_of(loaded).items() if before.sources.get(name, digest) != digest
    ]
    config = str(loaded.path.resolve())
    keys = [key for key in _changed_keys(loaded, before) if not _LIVE.fullmatch(key)]
    return [*keys, *(name for name in profiles if name != config)]


def _changed_keys(loaded: Loaded, before: CompiledPlan) -> list[str]:
    now, then = keys_of(loaded.document.tables), keys_of(tomllib.loads(before.configuration))
    return [key for key in dict.fromkeys((*now, *then)) if now.get(key) != then.get(key)]


def _found(loaded: Loaded, settled: Settled, waiting: Collection[str], *, is_running: bool) -> Outcome:
    """Return what was found in the files; nothing has been done yet."""
    rejected = {
        name: tuple(reading.problems)
        for name, reading in loaded.readings.items()
        if reading.problems and not reading.is_absent and name not in waiting
    }
    missing = [
        str(problem)
        for name in settled.refused
        for problem in loaded.readings[name].problems
        if name not in rejected
    ]
    absent = frozenset(name for name, source in settled.sources.items() if source is Source.ABSENT)
    return Outcome(
        problems=tuple(missing),
        rejected=rejected,
        absent=absent,
        waiting=frozenset(waiting) & settled.sources.keys(),
        is_running=is_running,
    )


def _hand_over(
    path: Path,
    settled: Settled,
    before: CompiledPlan | None,
    tables: Mapping[str, bytes],
    outcome: Outcome,
) -> Outcome:
    """Give the relay what it has not got; what it refuses is a problem."""
    old = {} if before is None else {axis.name: axis for line in before.plan.lines for axis in line.axes}
    reply = ask(path, GetStatus())
    in_force: Mapping[str, Any] = reply.status["axes"] if isinstance(reply, Status) else {}
    done: list[Done] = []
    for line in settled.plan.lines:
        for axis in line.axes:
            done += (_done(ask(path, request)) for request in _values(old.get(axis.name), axis))
    for together in _together(settled.plan.lines):
        changed = [
            axis
            for axis in together
            if axis.name in tables
            and in_force[axis.name]["table"]["compiled"] != digest_of(tables[axis.name])
        ]
        if changed:
            done.append(_send(path, changed, tables))
    gone = tuple(name for name, axis in in_force.items() if name not in tables and axis["table"]["points"])
    if gone:
        done.append(_done(ask(path, ClearTable(axes=gone))))
    comes = {name: how for one in done for name, how in one.comes.items()}
    problems = tuple(f"{path}: {problem}" for one in done for problem in one.problems)
    return replace(outcome, comes=comes, gone=gone, problems=outcome.problems + problems)


def _values(old: AxisPlan | None, new: AxisPlan) -> Iterator[Request]:
    """Yield what gives an axis the values that the configuration has changed; no table."""
    if old is None:
        return
    if limits_of(old) != limits_of(new):
        limits = limits_of(new)
        yield SetLimits(
            axis=new.name,
            max_correction=limits.max_correction,
            max_slope=limits.max_slope,
            travel_margin=limits.travel_margin,
            budget_us=limits.budget_us,
        )
    gain = new.settings.gain
    if old.settings.gain != gain:
        yield SetGain(axes=(new.name,), forward=gain.forward, backward=gain.backward)


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
