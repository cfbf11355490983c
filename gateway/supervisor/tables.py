"""The tables of a configuration: read, checked, compiled, kept as last good, given to the relay."""

import contextlib
import json
import os
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gateway.clock import wall_s
from gateway.config.compile import compile_into_state, keys_of, named_sources
from gateway.config.findings import parse_document
from gateway.config.included import MERGED, read_configuration
from gateway.config.last_good import Settled, TableSource, settle
from gateway.config.load import Loaded, load, load_document, reread_tables
from gateway.config.problems import ConfigErrors, Problem
from gateway.config.sections import is_live
from gateway.config.tables_folder import what_is_strange
from gateway.exchange.commands import ClearTable, Command, EndDryRun, SetGain, SetTable, TableFor
from gateway.exchange.limits import limits_of, values_of
from gateway.exchange.plan import AxisPlan, CompensationMode
from gateway.ipc.address import SocketError, socket_path
from gateway.ipc.client import NobodyListensError, NoGatewayError, ask
from gateway.ipc.messages import Done, GetStatus, Ping, Pong, Reply, Status
from gateway.ipc.sealed_memory import seal
from gateway.state.folder import StateError, state_folder
from gateway.state.last_good import last_plan
from gateway.state.plan import CompiledPlan, LinePlan, TablesFolder, shape_of, write_tables
from gateway.state.tables import digest_of
from gateway.status.axis import AxisStatus
from gateway.supervisor.debounce import FileStamp
from gateway.supervisor.file_stamps import scan
from gateway.supervisor.outcome import ReloadOutcome
from gateway.times import NS_PER_S

Still = Mapping[str, FileStamp | None]
"""The stamp of each stable table file, by name; None: the file is changing."""


class NeedsRestartError(StateError):
    """A running gateway cannot take this change; the message has the changed keys."""


class Reloader:
    """Keeps the tables, gains and limits of a relay equal to its configuration.

    All methods block while they work; one thread calls at a time.
    """

    def __init__(self, config: Path, has_relay: Callable[[], bool] = bool) -> None:
        self._config = config
        self._has_relay = has_relay
        """Whether a relay is known to run, also if nothing listens at its socket."""
        self._owed: Loaded | None = None
        """The requested configuration that could not be applied for a temporary reason."""
        self.loaded: Loaded | None = None
        """The configuration in force; None before the first."""

    @property
    def names(self) -> dict[str, str]:
        """Name of the table file of each axis that has one, from the configuration."""
        return {} if self.loaded is None else _names(self.loaded)

    def reload(self, still: Still | None = None) -> ReloadOutcome:
        """Read the configuration and its tables again, and apply what has changed.

        A table file that is being written does not count yet. Where the system does not tell who writes, the
        file counts if a user asked for the reload: then it is complete. ``still`` is given when no user
        asked. Then a file does not count if its stamp differs from ``still``, if it is missing and that was
        not known, or if it has just changed.
        """
        self._owed = None
        try:
            configured = load(self._config, forgives_tables=True)
        except ConfigErrors as errors:
            return self._refused(_of_configuration(errors))
        return self._take_configured(configured, still)

    def retry(self, still: Still) -> ReloadOutcome:
        """Apply the configuration that :meth:`reload` could not apply, as it was read then."""
        configured = self._owed
        return self.reload(still) if configured is None else self._take_configured(configured, still)

    def is_file_unchanged(self) -> bool:
        """Whether the configuration in force is the one in its file."""
        try:
            return (
                self.loaded is not None and read_configuration(self._config).text == self.loaded.document.text
            )
        except ConfigErrors:
            return False

    def refresh(self, still: Still) -> ReloadOutcome:
        """Read the tables of the configuration in force; otherwise like :meth:`reload`.

        A configuration that another program has compiled since then takes precedence: the next start runs it.
        If the relay still runs the previous one, it gets that one's tables, and the compiled plan stays. A
        changed configuration file counts only when a user requests a reload.
        """
        if self.loaded is None:
            return self.reload(still)
        taken, before = self.loaded, last_plan(self.loaded.state_folder)
        is_same = before is None or before.configuration == taken.document.text
        another = None if is_same else self._as_compiled(before)
        try:
            if another is not None:
                outcome = self._take(another, still, before)
                if self.loaded is not taken:
                    self._owed = None
                    return outcome
            return self._take(taken, still, before, keeps_plan=another is not None)
        except ConfigErrors as errors:
            return _of_configuration(errors)

    def _take_configured(self, configured: Loaded, still: Still | None) -> ReloadOutcome:
        before = self.loaded
        try:
            outcome = self._take(configured, still, last_plan(configured.state_folder))
        except ConfigErrors as errors:
            outcome = replace(_of_configuration(errors), is_owed=True)
        self._owed = configured if outcome.is_owed else None
        return self._refused(outcome) if self.loaded is before else outcome

    def _refused(self, outcome: ReloadOutcome) -> ReloadOutcome:
        if self.loaded is None:
            with contextlib.suppress(StateError):
                self.loaded = self._as_compiled(last_plan(state_folder(self._config)))
        return ReloadOutcome(
            problems=replace(outcome, saving=()).all_problems,
            is_running=outcome.is_running,
            is_owed=outcome.is_owed,
            has_read=False,
            is_refused=True,
        )

    def _as_compiled(self, plan: CompiledPlan | None) -> Loaded | None:
        """Return the configuration that was compiled last, if the one in the file does not count."""
        if plan is None:
            return None
        try:
            has_lines = not plan.configuration.startswith(MERGED)
            document = parse_document(self._config, plan.configuration, plan.sources, has_lines=has_lines)
            return load_document(document, checks_times=False, forgives_tables=True)
        except ConfigErrors:
            return None

    def _take(
        self,
        configured: Loaded,
        still: Still | None,
        before: CompiledPlan | None,
        *,
        keeps_plan: bool = False,
    ) -> ReloadOutcome:
        """Read the tables and bring everything up to date; ``before`` is the last compiled plan."""
        names = _names(configured)
        signed = configured.sections.allowed_signers is not None
        seen = scan(configured.tables_folder, names.values(), signed=signed)
        loaded = reread_tables(configured)
        seen_after = scan(configured.tables_folder, names.values(), signed=signed)
        read = {
            name: stamp
            for name, stamp in seen.items()
            if stamp == seen_after[name] and not stamp.is_being_written and _may_count(name, stamp, still)
        }
        unread = {axis for axis, name in names.items() if name not in read}
        folder_before = None if before is None else before.tables_folder
        strange = what_is_strange(loaded, folder_before)
        # During reading, another folder appeared at the path: a share was mounted or unmounted.
        has_moved = TablesFolder.at(loaded.tables_folder) != loaded.read_from
        if strange or has_moved:
            unread = set(names)
        folder = (
            (folder_before or loaded.read_from)
            if strange or has_moved
            else (loaded.read_from or folder_before)
        )
        outcome = self._bring(loaded, unread, before, folder, keeps_plan=keeps_plan)
        if strange:
            outcome = replace(outcome, problems=(*outcome.problems, strange))
        elif not has_moved and not outcome.is_owed:
            outcome = replace(outcome, saving=tuple(_saving(loaded, seen, outcome.waiting)))
        taken = {name for axis, name in names.items() if axis not in outcome.waiting}
        return replace(outcome, stamps={name: stamp for name, stamp in read.items() if name in taken})

    def _bring(
        self,
        loaded: Loaded,
        waiting: Collection[str],
        before: CompiledPlan | None,
        folder: TablesFolder | None,
        *,
        keeps_plan: bool,
    ) -> ReloadOutcome:
        outcome = ReloadOutcome(has_read=False)
        try:
            path = socket_path(loaded.state_folder)
            is_running = self._is_running(path, loaded, before)
            settled = settle(loaded, before, waiting=waiting)
            outcome = _found(loaded, settled, waiting, is_running=is_running)
            held = _held(settled, loaded, before, outcome)
            outcome = replace(outcome, held=held)
            if settled.refused:
                return outcome
            if keeps_plan:
                tables = write_tables(loaded.state_folder, settled.plan)
            else:
                if before is not None:
                    outcome = replace(outcome, changed=tuple(_changed_keys(loaded, before)))
                tables = compile_into_state(loaded, settled.plan, folder, before)
            self.loaded = loaded
            if not is_running:
                return outcome
            return _hand_over(path, settled, tables, outcome)
        except SocketError as error:
            problem = f"gateway.state: {error}"
        except (StateError, NoGatewayError, OSError) as error:
            problem = str(error)
            outcome = replace(outcome, is_owed=not isinstance(error, NeedsRestartError))
        # Nothing has changed, but what was found in the files is still valid.
        return replace(outcome, problems=(*outcome.problems, f"{self._config}: {problem}"), changed=())

    def _is_running(self, path: Path, loaded: Loaded, before: CompiledPlan | None) -> bool:
        try:
            _check_same(path, loaded, before)
        except NobodyListensError:
            if self._has_relay():
                raise NoGatewayError(
                    f"{path} is missing, although the relay runs: it makes the socket again within seconds, "
                    "and this is tried again. If this lasts, see the trouble state_folder"
                ) from None
            return False
        return True


def _of_configuration(errors: ConfigErrors) -> ReloadOutcome:
    return ReloadOutcome(problems=tuple(map(str, errors.problems)), has_read=False)


def _may_count(name: str, stamp: FileStamp, still: Still | None) -> bool:
    """Whether a file with this stamp counts; one that was not watched so far counts if it exists."""
    if still is not None and name in still:
        return still[name] == stamp
    if still is None:  # a user asked, and says with that what is there and complete
        return True
    if not stamp.is_there:
        return False
    may_come_yet = stamp.is_being_written is None or stamp.is_signature_due
    return not may_come_yet or wall_s() - stamp.changed_ns / NS_PER_S >= stamp.still_s


def _saving(loaded: Loaded, seen: Mapping[str, FileStamp], waiting: Collection[str]) -> Iterator[str]:
    """Yield why the files of these axes do not count yet."""
    for axis in sorted(waiting):
        reading = loaded.readings[axis]
        stamp = seen[reading.name]
        if stamp.is_being_written:
            why = "a program has it open for writing; close it there"
        else:
            why = "it is just being saved; wait a moment"
        yield f"{reading.path}: axis.{axis}.table: not taken yet: {why}, and it is taken when it is complete"


def _names(loaded: Loaded) -> dict[str, str]:
    return {axis: reading.name for axis, reading in loaded.readings.items()}


def _check_same(path: Path, loaded: Loaded, before: CompiledPlan | None) -> None:
    """Check that the relay runs the same plan, except for values that it can take.

    Raises:
        NeedsRestartError: it runs another plan.
        NobodyListensError: none runs.
        NoGatewayError: it cannot be understood.
    """
    pong = ask(path, Ping())
    if not isinstance(pong, Pong) or pong.shape != shape_of(loaded.plan):
        need = [] if before is None else _need_restart(loaded, before)
        what = ", ".join(need) or "keys that only a restart applies"
        raise NeedsRestartError(f"restart the gateway: these keys changed since its start: {what}")
    if into_shadow := _into_shadow(path, loaded):
        raise NeedsRestartError(
            f"{', '.join(into_shadow)}: restart the gateway, because only a restart sets an axis to "
            "shadow; or leave it on and run pitch-gateway disable"
        )


def _into_shadow(path: Path, loaded: Loaded) -> list[str]:
    """Return the keys of axes that the configuration puts into shadow and the running gateway does not."""
    in_force = _axes(ask(path, GetStatus()))
    return [
        f"axis.{axis.name}.compensation"
        for line in loaded.plan.lines
        for axis in line.axes
        if axis.compensation is CompensationMode.SHADOW
        and in_force[axis.name].configured["compensation"] != CompensationMode.SHADOW.value
    ]


def _axes(reply: Reply) -> Mapping[str, AxisStatus]:
    return reply.status.axes if isinstance(reply, Status) else {}


def _need_restart(loaded: Loaded, before: CompiledPlan) -> list[str]:
    """Return the changes that a running gateway cannot take: keys, and drive profiles."""
    profiles = [
        name for name, digest in named_sources(loaded).items() if before.sources.get(name, digest) != digest
    ]
    keys = [key for key in _changed_keys(loaded, before) if not _can_be_given(key, loaded, before)]
    return [*keys, *profiles]


def _can_be_given(key: str, loaded: Loaded, before: CompiledPlan) -> bool:
    """Whether a running gateway can take the new value; of modes only the end of a dry run."""
    now, then = keys_of(loaded.document.tables), keys_of(tomllib.loads(before.configuration))
    off = json.dumps(CompensationMode.OFF.value)
    is_off = key.endswith(".compensation") and off in (now.get(key), then.get(key))
    return is_live(key) and not is_off


def _changed_keys(loaded: Loaded, before: CompiledPlan) -> list[str]:
    if loaded.document.text == before.configuration:
        return []
    now, then = keys_of(loaded.document.tables), keys_of(tomllib.loads(before.configuration))
    return [key for key in dict.fromkeys((*now, *then)) if now.get(key) != then.get(key)]


def _found(loaded: Loaded, settled: Settled, waiting: Collection[str], *, is_running: bool) -> ReloadOutcome:
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
        if name not in rejected and (name not in waiting or name in settled.slips)
    ]
    missing += [
        f"{loaded.readings[name].path}: the file is being saved; the gateway applies it when it no longer "
        "changes"
        for name in settled.refused
        if name in waiting and name not in settled.slips
    ]
    absent = frozenset(name for name, source in settled.sources.items() if source is TableSource.ABSENT)
    return ReloadOutcome(
        problems=tuple(missing),
        rejected=rejected,
        digests={name: table.source.sha256 for name, table in loaded.tables.items()},
        absent=absent,
        waiting=frozenset(waiting) & settled.sources.keys(),
        is_owed=not settled.slips and any(name in waiting for name in settled.refused),
        is_running=is_running,
    )


def _held(
    settled: Settled, loaded: Loaded, before: CompiledPlan | None, outcome: ReloadOutcome
) -> dict[str, tuple[Problem, ...]]:
    """Return why valid files are not in force: an axis of the same group has no valid file."""
    old = {} if before is None else {axis.name: axis for line in before.plan.lines for axis in line.axes}
    held: dict[str, tuple[Problem, ...]] = {}
    for line in loaded.plan.lines:
        for group in line.groups:
            for axis in (one for one in line.axes if one.name in group):
                source, name = settled.sources.get(axis.name), axis.name
                is_same = name in old and old[name].table_digest == axis.table_digest
                if (
                    axis.table is None
                    or source is TableSource.FILE
                    or (source is TableSource.KEPT and is_same)
                ):
                    continue
                others = [one for one in group if one in outcome.rejected or loaded.readings[one].is_absent]
                if others and name not in outcome.waiting:
                    files = ", ".join(loaded.readings[one].name for one in others)
                    it = "it" if len(others) == 1 else "them"
                    what = f"not used, because of its group {files} is missing or faulty"
                    together = "axes of a group are corrected together or not at all"
                    remedy = f"correct {files} or put {it} back: {together}"
                    problem = Problem(str(loaded.readings[name].path), f"axis.{name}.table", what, remedy)
                    held[name] = (problem,)
    return held


def _hand_over(
    path: Path,
    settled: Settled,
    tables: Mapping[str, bytes],
    outcome: ReloadOutcome,
) -> ReloadOutcome:
    """Send the relay what it does not have; each refusal is a problem in the outcome."""
    in_force = _axes(ask(path, GetStatus()))
    done: list[tuple[Command, Done]] = []
    for line in settled.plan.lines:
        for axis in line.axes:
            configured = in_force[axis.name].configured
            done += ((request, _done(ask(path, request))) for request in _values(configured, axis))
    for together in _together(settled.plan.lines):
        changed = [
            axis
            for axis in together
            if axis.name in tables and not _is_in_force(in_force[axis.name], axis, tables[axis.name])
        ]
        if changed:
            done.append(_send(path, changed, tables))
    gone = tuple(name for name, axis in in_force.items() if name not in tables and axis.table.points)
    if gone:
        clear = ClearTable(axes=gone)
        done.append((clear, _done(ask(path, clear))))
    live = [axis for line in settled.plan.lines for axis in line.axes if _goes_live(in_force, axis)]
    if live:
        end = EndDryRun(axes=tuple(axis.name for axis in live))
        ended = _done(ask(path, end))
        done.append((end, ended))
        if ended.problems:
            stay = {f"axis.{axis.name}.compensation" for axis in live}
            outcome = replace(outcome, changed=tuple(key for key in outcome.changed if key not in stay))
    comes = {
        name: how
        for command, one in done
        for name, how in one.comes.items()
        if not isinstance(command, SetTable) or in_force[name].table.compiled != digest_of(tables[name])
    }
    given = tuple((command, one.changed) for command, one in done if one.changed)
    problems = tuple(f"{path}: {problem}" for _, one in done for problem in one.problems)
    return replace(outcome, comes=comes, gone=gone, given=given, problems=outcome.problems + problems)


def _is_in_force(has: AxisStatus, axis: AxisPlan, compiled: bytes) -> bool:
    """Whether an axis has this table, from this file: equal corrections may be written in different ways."""
    table = has.table
    names = (table.file or "", table.format or "", table.sha256 or "")
    is_named_so = names == (axis.table_name, axis.table_format, axis.table_digest)
    return is_named_so and table.compiled == digest_of(compiled)


def _goes_live(in_force: Mapping[str, AxisStatus], axis: AxisPlan) -> bool:
    """Whether an axis changes from shadow to applying its correction."""
    is_shown_only = in_force[axis.name].configured["compensation"] == CompensationMode.SHADOW.value
    return is_shown_only and axis.compensation is CompensationMode.ON


def _values(has: Mapping[str, Any], new: AxisPlan) -> Iterator[Command]:
    """Yield the requests that give an axis the configured values that it does not have; no table.

    The relay reports what it has. The plan in the state folder may be newer than that.
    """
    limits = limits_of(new)
    if any(has[key] != value for key, value in values_of(limits).items()):
        yield limits
    gain = new.settings.gain
    if has["gain"] != {"forward": gain.forward, "backward": gain.backward}:
        yield SetGain(axes=(new.name,), forward=gain.forward, backward=gain.backward, is_configured=True)


def _together(lines: Sequence[LinePlan]) -> Iterator[list[AxisPlan]]:
    """Yield the axes that change together or not at all: each group, and each axis without a group."""
    for line in lines:
        by_name = {axis.name: axis for axis in line.axes}
        for group in line.groups:
            yield [by_name.pop(name) for name in group if name in by_name]
        for axis in by_name.values():
            yield [axis]


def _send(path: Path, axes: Sequence[AxisPlan], tables: Mapping[str, bytes]) -> tuple[Command, Done]:
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
    return request, _done(reply)


def _done(reply: Reply) -> Done:
    return reply if isinstance(reply, Done) else Done(problems=(f"answered by {type(reply).__name__}",))
