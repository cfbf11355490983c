"""The supervisor: follows the relay and the table files, and keeps one model for all who show it."""

import asyncio
import contextlib
import time
import traceback
from collections.abc import Awaitable, Callable, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final

from gateway.catalogue.entry import EventEntry, Severity
from gateway.catalogue.process_events import RELAY_NOT_REACHED, RELAY_REACHED, SUPERVISING
from gateway.catalogue.publishing_events import ALARM_ACKNOWLEDGED
from gateway.catalogue.table_events import (
    CONFIGURATION_CHANGED,
    NOTHING_TO_RELOAD,
    RELOAD_REFUSED,
    STATE_FOLDER_UNUSABLE,
    STATE_FOLDER_USABLE,
    TABLE_HANDED_OVER,
    TABLE_MENDED,
    TABLE_REJECTED,
    TABLE_TAKEN_AWAY,
    TABLE_WAITING,
    WATCHING_BY_LOOKS,
)
from gateway.compensation.settings import AxisSettings
from gateway.config.compile import sources_of
from gateway.config.load import Loaded
from gateway.exchange.commands import Command
from gateway.ipc.address import socket_path
from gateway.ipc.client import ask
from gateway.ipc.log import LogEntry, log_entry
from gateway.ipc.messages import Happened
from gateway.state.folder import FolderProblem, StateError, identity_of, why_not_usable
from gateway.state.plan import GatewayPlan
from gateway.status.model import ConfigurationStatus, FolderStatus, SupervisorStatus
from gateway.supervisor.acknowledged import AlarmAcknowledgement
from gateway.supervisor.alarm_output import AlarmOutput
from gateway.supervisor.broadcast import Broadcast
from gateway.supervisor.capturing import Capturing
from gateway.supervisor.http.documents import Window, settings_in
from gateway.supervisor.http.service import HttpService
from gateway.supervisor.in_thread import in_thread
from gateway.supervisor.interventions import AT_START, BY_FILE, BY_SIGNAL, Cause, Interventions
from gateway.supervisor.link import RelayLink
from gateway.supervisor.model import whole_model
from gateway.supervisor.mqtt.interfaces import Orders
from gateway.supervisor.mqtt.service import MqttService
from gateway.supervisor.mqtt.settings import settings_of
from gateway.supervisor.outcome import ReloadOutcome
from gateway.supervisor.past import Noted, Past
from gateway.supervisor.recent_history import RecentHistory
from gateway.supervisor.table_files import TableFiles
from gateway.supervisor.tables import Reloader
from gateway.supervisor.temperatures import Temperatures
from gateway.supervisor.watching import SLOW_S, Watch, wake_on_change

TICK_S: Final = 1.2
"""A model comes at least at this interval, also if the relay is silent; otherwise the relay causes it
earlier."""
RETRY_S: Final = 5.0
"""Delay before a failed operation, as with a full disk, is retried; no file has to change for it."""

STATE_EVERY_S: Final = 5.0
"""Interval between checks that the state folder is writable."""


def _name_nobody(_gateway: str) -> None:
    pass


class Supervisor:
    """Follows the relay of a state folder and the tables of a configuration.

    ``write`` takes a log entry and does not block. ``name_gateway`` gives the log the gateway's name.
    """

    def __init__(
        self,
        config: Path,
        state: Path,
        write: Callable[[LogEntry], None],
        *,
        tells_events: bool = False,
        name_gateway: Callable[[str], None] = _name_nobody,
    ) -> None:
        self._link = RelayLink(
            socket_path(state), self._reached, self._lost, self._happened, self._snapshot_came
        )
        self.broadcast = Broadcast(self._link.want)
        """The status model and the events, for all readers."""
        self._recent = RecentHistory()
        self._past = Past(state, self._recent, self._log)
        self._interventions = Interventions(state, self._log)
        self._config = config
        self._state = state
        self._write = write
        self._name_gateway = name_gateway
        self._tells_events = tells_events
        self._reloader = Reloader(config, lambda: self._link.is_up)
        self._watch = Watch()
        self._table_files = TableFiles()
        self._work_due = asyncio.Event()
        self._reloads: list[tuple[asyncio.Future[ReloadOutcome], Cause]] = []
        self._is_reload_requested = True
        self._is_asked = False
        self._is_relay_new = False
        self._refused: tuple[str, ...] = ()
        """Why the configuration in its file is not the one in force."""
        self._is_owed = False
        """Whether the supervisor retries it automatically."""
        self._problems: tuple[str, ...] = ()
        """Why not all tables are where they belong."""
        self._state_problem: FolderProblem | None = None
        self._rejected: dict[str, str] = {}
        self._waker: asyncio.Task[None] | None = None
        self._published_s = -TICK_S
        window = Window(
            self.broadcast,
            state,
            self._settings_of,
            lambda who: self.reload(Cause("http", who)),
            self._log,
            self._history,
            self._plan,
            self._acknowledge,
            lambda person, before, who: self._interventions.erase(person, before, Cause("http", who)),
        )
        self._http = HttpService(window)
        orders = Orders(self._reload_for_mqtt, partial(ask, socket_path(state)), self._commanded_over_mqtt)
        self._temperatures = Temperatures(orders.ask, self._log)
        self._capturing = Capturing(state, self._log)
        self._alarm_output = AlarmOutput(lambda: self.broadcast.model, self._log)
        self._mqtt = MqttService(
            self.broadcast, self._log, orders, state, on_message=self._temperatures.on_message
        )

    async def run(self) -> None:
        """Run until cancelled."""
        await self._past.recall()
        await self._interventions.recall()
        self._log(SUPERVISING, config=str(self._config))
        self._work_due.set()
        await self._all(
            self._link.run(),
            self._process_work(),
            self._watch_files(),
            self._publish_regularly(),
            self._monitor_state_folder(),
            self._http.run(),
            self._mqtt.run(),
            self._temperatures.run(),
            self._capturing.run(),
            self._alarm_output.run(),
            self._past.run(),
            self._interventions.run(),
        )

    async def reload(self, cause: Cause) -> ReloadOutcome:
        """Read configuration and tables again, and note who caused it; return the result."""
        done: asyncio.Future[ReloadOutcome] = asyncio.get_running_loop().create_future()
        self._reloads.append((done, cause))
        self._work_due.set()
        return await done

    def reload_soon(self) -> None:
        """Read configuration and tables again; events report the result."""
        self._is_reload_requested = self._is_asked = True
        self._work_due.set()

    async def _all(self, *works: Awaitable[None]) -> None:
        """Run all of them until one ends, which is a bug; then end the others too."""
        tasks = [asyncio.ensure_future(work) for work in works]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in tasks:
                if task.done():
                    task.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _watch_files(self) -> None:
        try:
            while True:
                if await self._watch.scan():
                    self._work_due.set()
                await self._watch.rest()
        finally:
            if self._waker is not None:
                self._waker.cancel()

    async def _publish_regularly(self) -> None:
        while True:
            if (rest_s := self._published_s + TICK_S - time.monotonic()) <= 0.0:
                self._publish()
                rest_s = TICK_S
            await asyncio.sleep(rest_s)

    async def _monitor_state_folder(self) -> None:
        """Report when the state folder is not writable. Otherwise only the next start would show it."""
        identity = await in_thread(partial(identity_of, self._state))
        while True:
            found = await in_thread(partial(why_not_usable, self._state, identity)) or (
                self._past.problem or self._interventions.problem
            )
            before, self._state_problem = self._state_problem, found
            if found is not None and before is None:
                self._log(STATE_FOLDER_UNUSABLE, detail=str(found))
            elif found is None and before is not None:
                self._log(STATE_FOLDER_USABLE, folder=str(self._state))
            await asyncio.sleep(STATE_EVERY_S)

    async def _process_work(self) -> None:
        while True:
            is_retry = self._is_owed and not self._problems
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(RETRY_S if self._problems or self._is_owed else None):
                    await self._work_due.wait()
                    is_retry = False
            self._work_due.clear()
            asked, self._reloads = self._reloads, []
            is_reload, self._is_reload_requested = self._is_reload_requested or bool(asked), False
            is_asked, self._is_asked = self._is_asked or bool(asked), False
            first = self._reloader.loaded is None or self._is_relay_new
            cause = asked[0][1] if asked else BY_SIGNAL if is_asked else AT_START if first else BY_FILE
            outcome = await self._bring_up_to_date(is_reload=is_reload, is_asked=is_asked, is_retry=is_retry)
            await self._note_reload(outcome, cause)
            for done, _ in asked:
                if not done.done():
                    done.set_result(outcome)

    async def _bring_up_to_date(self, *, is_reload: bool, is_asked: bool, is_retry: bool) -> ReloadOutcome:
        """Read what is due, and report the result."""
        still = self._watch.still
        is_new, self._is_relay_new = self._is_relay_new, False
        if is_reload:
            work = partial(self._reloader.reload, None if is_asked else still)
        elif is_retry:
            work = partial(self._reloader.retry, still)
        else:
            work = partial(self._reloader.refresh, still)
        began_s = time.monotonic()
        outcome = await self._done(work)
        if (loaded := self._reloader.loaded) is not None:
            self._configure(loaded)
        if outcome.has_read:
            self._watch.take(outcome.stamps, outcome.waiting, began_s=began_s)
            self._table_files.enter(self._reloader.names, outcome)
        self._report(outcome, is_asked=is_asked)
        if is_reload or is_retry:
            self._refused = outcome.problems if outcome.is_refused else ()
            self._is_owed = outcome.is_refused and outcome.is_owed
        elif (
            is_new
            and not outcome.is_refused
            and self._refused
            and await in_thread(self._reloader.is_file_unchanged)
        ):
            self._refused, self._is_owed = (), False  # the request to restart the relay was followed
        if not outcome.is_refused:
            self._problems = outcome.problems
        self._publish()
        return outcome

    async def _done(self, work: Callable[[], ReloadOutcome]) -> ReloadOutcome:
        """Do it in a thread. A bug in it changes nothing and is reported like any other problem."""
        try:
            return await in_thread(work)
        except Exception as error:  # noqa: BLE001 - a table must not stop the status
            frame = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(frame.filename).name}:{frame.lineno}"
            what = f"an error in the supervisor: {type(error).__name__}: {error} ({where})"
            return ReloadOutcome(
                problems=(f"{self._config}: {what}; the previous configuration and tables stay active",),
                has_read=False,
            )

    async def _note_reload(self, outcome: ReloadOutcome, cause: Cause) -> None:
        if (loaded := self._reloader.loaded) is not None:
            with contextlib.suppress(StateError):  # a profile is gone: noted when the configuration is
                for file, digest in (await in_thread(partial(sources_of, loaded))).items():
                    self._interventions.note("configuration", cause, None, file, digest)
        for command, changed in outcome.given:
            self._interventions.commanded(command, changed, cause)

    def _configure(self, loaded: Loaded) -> None:
        """Apply a configuration; unchanged parts change nothing."""
        self._name_gateway(loaded.plan.name)
        self._follow(loaded.tables_folder, signed=loaded.sections.allowed_signers is not None)
        self._http.configure(loaded.sections.http, loaded.plan.name, loaded.path.parent)
        mqtt = loaded.sections.mqtt
        folder = loaded.path.parent
        self._temperatures.follow(loaded.sections)
        self._capturing.follow(loaded)
        self._alarm_output.follow(loaded.sections.alarm_output)
        topics = self._temperatures.topics
        self._mqtt.follow(None if mqtt is None else settings_of(mqtt, loaded.plan.name, folder, topics))

    def _follow(self, folder: Path, *, signed: bool) -> None:
        if self._waker is None or folder != self._watch.folder:
            if self._waker is not None:
                self._waker.cancel()
            self._waker = asyncio.create_task(wake_on_change(folder, self._watch.wake, self._cannot_watch))
        self._watch.follow(folder, self._reloader.names, signed=signed)

    def _cannot_watch(self, why: str) -> None:
        detail = f"{why}; the folder is still read every second"
        self._log(WATCHING_BY_LOOKS, folder=str(self._watch.folder), detail=detail)

    def _report(self, outcome: ReloadOutcome, *, is_asked: bool) -> None:
        for axis, comes in outcome.comes.items():
            what = TABLE_TAKEN_AWAY if axis in outcome.gone else TABLE_HANDED_OVER
            self._log(what, axis=axis, comes=comes)
        if outcome.changed:
            self._log(CONFIGURATION_CHANGED, keys=list(outcome.changed))
        reported = self._refused if outcome.is_refused else self._problems
        if outcome.problems and (is_asked or outcome.problems != reported):
            detail = "the previous configuration and tables stay active"
            self._log(RELOAD_REFUSED, problems=list(outcome.problems), detail=detail)
        elif is_asked and not outcome.comes and not outcome.changed and not outcome.all_problems:
            there = "nothing has changed" if outcome.is_running else "no gateway runs: kept for its start"
            self._log(NOTHING_TO_RELOAD, detail=there)
        if is_asked and outcome.saving:
            self._log(TABLE_WAITING, problems=list(outcome.saving))
        if outcome.has_read:
            self._report_files(outcome)

    def _report_files(self, outcome: ReloadOutcome) -> None:
        """Report each bad file once, and again when it is good."""
        for axis, problems in outcome.rejected.items():
            text = "\n".join(map(str, problems))
            if self._rejected.get(axis) != text:
                self._rejected[axis] = text
                first = problems[0]
                self._log(
                    TABLE_REJECTED,
                    axis=axis,
                    file=first.file,
                    line=first.line,
                    problems=[str(problem) for problem in problems],
                    detail="the last good table stays",
                )
        for axis in self._rejected.keys() - outcome.rejected.keys() - outcome.waiting:
            del self._rejected[axis]
            if axis not in outcome.absent:
                self._log(TABLE_MENDED, axis=axis)

    def _publish(self) -> None:
        self._published_s = time.monotonic()
        loaded = self._reloader.loaded
        self.broadcast.publish(
            whole_model(
                self._config.stem if loaded is None else loaded.plan.name,
                self._link.snapshot,
                is_relay_up=self._link.is_up,
                snapshot_age_s=self._link.snapshot_age_s,
                tables=self._table_files.entries(self._watch.unread, self._watch.overdue),
                supervisor=self._own_status(),
                recent=self._recent,
                silent_after_s={} if loaded is None else loaded.sections.silent_after_s,
            )
        )
        self._alarm_output.changed()

    async def _history(self, axis: str, span_s: float) -> Sequence[Noted] | None:
        return await self._past.of(axis, span_s, time.monotonic(), time.time())

    def _acknowledge(
        self, kind: str, where: str, since: str, by: str, address: str
    ) -> AlarmAcknowledgement | None:
        version = self._recent.acknowledged.version
        done = self._recent.acknowledge(kind, where, since, by, datetime.now(UTC))
        if self._recent.acknowledged.version != version:
            self._past.wake()
            alarm = {"kind": kind, "where": where, "since": since}
            cause = Cause("http", {"name": by, "address": address})
            self._interventions.note("acknowledged", cause, None, None, alarm)
            self._log(ALARM_ACKNOWLEDGED, kind=kind, where=where, by=by)
        return done

    async def _reload_for_mqtt(self) -> ReloadOutcome:
        return await self.reload(self._by_mqtt)

    def _commanded_over_mqtt(self, command: Command, changed: Sequence[str]) -> None:
        self._interventions.commanded(command, changed, self._by_mqtt)

    @property
    def _by_mqtt(self) -> Cause:
        return Cause("mqtt", {"broker": self._mqtt.status().broker})

    def _plan(self) -> GatewayPlan | None:
        loaded = self._reloader.loaded
        return None if loaded is None else loaded.plan

    def _settings_of(self, axis: str) -> AxisSettings | None:
        return settings_in(self._plan(), axis)

    def _own_status(self) -> SupervisorStatus:
        silent_s = self._watch.silent_s
        problems = list(self._problems)
        if silent_s > SLOW_S:
            problems.insert(0, f"{self._watch.folder} has not answered for {silent_s:.0f} s")
        state_problem = str(self._state_problem) if self._state_problem else None
        return SupervisorStatus(
            configuration=ConfigurationStatus(
                file=str(self._config), problem="; ".join(self._refused) or None
            ),
            tables_folder=FolderStatus(folder=str(self._watch.folder), problem="; ".join(problems) or None),
            state_folder=FolderStatus(folder=str(self._state), problem=state_problem),
            http=self._http.status,
            mqtt=self._mqtt.status(),
            alarm_output=self._alarm_output.status,
            journal=self._interventions.status,
        )

    def _reached(self) -> None:
        self._log(RELAY_REACHED)
        self._is_relay_new = True
        self._work_due.set()

    def _lost(self, why: str) -> None:
        self._log(RELAY_NOT_REACHED, detail=why)
        self._publish()

    def _snapshot_came(self) -> None:
        if (snapshot := self._link.snapshot) is not None:
            self._interventions.compare(snapshot, self._http.status.certificates)
        self._publish()

    def _happened(self, happened: Happened) -> None:
        self._interventions.happened(happened)
        fields = {**happened.fields, "process": "relay"}
        entry = LogEntry(Severity(happened.severity), happened.event, fields, happened.wall_s)
        self.broadcast.publish_event(entry)
        self._capturing.happened(entry.event)
        if self._tells_events:
            self._write(entry)

    def _log(self, event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
        entry = log_entry(event, {**fields, "process": "supervisor"}, time.time(), severity)
        self.broadcast.publish_event(entry)
        self._write(entry)
        self._capturing.happened(entry.event)
        self._publish()  # when the event arrives, the status already has it
