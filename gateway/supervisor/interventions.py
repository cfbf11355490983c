"""Keeps the journal of interventions (``state.interventions``): what changed, before and after, and by whom.

The supervisor notes what it did itself, for a file, HTTP or MQTT, from the results of its commands. What
other processes did at the relay's socket it notes from the relay's events. Everything else, also while no
supervisor ran, shows in the relay's status: it is compared with the last noted state, and noted as found.
"""

import asyncio
import contextlib
import errno
import os
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

from msgspec import UNSET

import gateway
from gateway.catalogue import table_events as tables
from gateway.exchange.commands import (
    ClearTable,
    Command,
    Disable,
    Enable,
    EndDryRun,
    SetGain,
    SetLimits,
    SetReference,
    SetTable,
    SetTemperature,
)
from gateway.exchange.limits import values_of
from gateway.ipc.messages import Happened
from gateway.state.folder import FolderProblem, problem_of
from gateway.state.interventions import (
    FOLDER_NAME,
    OWN,
    STRANGER,
    Entry,
    Head,
    Intervention,
    Verification,
    Writer,
    head_in,
    locked,
    newest_files_in,
)
from gateway.status.line import CertificateStatus
from gateway.status.model import JournalStatus, RelayModel
from gateway.supervisor.event_log import LogEvent
from gateway.supervisor.in_thread import FINISH_S, in_thread

RETRY_S: Final = 5.0
"""Delay before a failed write is tried again."""
MOST_WAITING: Final = 1000
"""Entries that wait for room on the disk. More are counted, and the count is an entry."""
SETTLED_S: Final = 10.0
"""The status of the relay is compared so long after its last event about an intervention: the result of a
command of our own may come later than its event."""
LATE_S: Final = 10.0
"""A disk that has not answered for so long is a problem: of a network, or another process has locked it."""
OF_AXES: Final = ("table", "gain", "limits", "compensation", "mode")
KEPT: Final = (*OF_AXES, "configuration", "version", "certificate")
"""Interventions that set a value, which lasts; the others are single events."""
OF_PEER: Final = ("user", "pid", "program", "login")
"""Fields of an event that say which process sent the command (``ipc.address.Peer``)."""
OF_PERSON: Final = ("name", "login", "user", "address", "broker")
"""Fields of ``who`` that say who it was or from where; the others say how."""
Key = tuple[str, str]
"""What, and of which axis or file."""
Change = tuple[str, str, str | None, Any]
"""What changed, of which axis, in which file, and the new value."""


@dataclass(frozen=True, slots=True)
class Cause:
    """How an intervention came, and the personal part: who, and from where."""

    via: str
    who: Mapping[str, object] = field(default_factory=dict)


BY_FILE: Final = Cause("file")
BY_SIGNAL: Final = Cause("signal")
AT_START: Final = Cause("start")
FOUND: Final = Cause("found")


class Interventions:
    """The journal of one supervisor."""

    def __init__(
        self, state: Path, log: LogEvent, settled_s: float = SETTLED_S, late_s: float = LATE_S
    ) -> None:
        self._folder = state / FOLDER_NAME
        self._log = log
        self._settled_s = settled_s
        self._late_s = late_s
        self._known: dict[Key, Any] = {}
        """The last noted state."""
        self._writer = Writer(self._folder, state=self._listed)
        self._is_new = True
        self._waiting: deque[Intervention] = deque()
        self._lost = 0
        self._woken = asyncio.Event()
        self._active_s = -settled_s
        self._newest: Head | None = None
        """As it was on the disk at the start; None: there was none."""
        self.problem: FolderProblem | None = None
        """Why entries cannot be written at present, or not in the next file."""

    @property
    def status(self) -> JournalStatus:
        """Return the newest entry that is on the disk."""
        head = self._writer.head or self._newest
        return JournalStatus() if head is None else JournalStatus(seq=head.seq, digest=head.digest)

    async def recall(self) -> None:
        """Read the last noted state, and report a journal that was changed; call it first."""
        try:
            async with asyncio.timeout(self._late_s):  # the supervisor has more to do than this journal
                verification, self._known, self._newest = await in_thread(partial(_last_state, self._folder))
        except TimeoutError:
            self._be_late()
        except OSError as error:
            self.problem = problem_of(error, self._folder)
        else:
            self._is_new = not verification.entries
            if verification.problems:
                detail, count = verification.problems[0], len(verification.problems)
                self._log(tables.INTERVENTIONS_DAMAGED, folder=str(self._folder), detail=detail, count=count)
        version = gateway.__version__
        before = self._known.get(("version", "supervisor"))
        self._add(Intervention("start", AT_START.via, None, "supervisor", before, version))
        self._known["version", "supervisor"] = version

    async def run(self) -> None:
        """Write until cancelled; then what still waits, if the disk takes it."""
        try:
            while True:
                await self._write()
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(RETRY_S if self._waiting or self.problem else None):
                        await self._woken.wait()
                self._woken.clear()
        finally:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(FINISH_S):
                    await self._write()

    def note(self, what: str, cause: Cause, axis: str | None, file: str | None, after: object) -> None:
        """Note an intervention. One that leaves a state is noted only if it changes it."""
        before = None
        if what in KEPT:
            key = (what, axis or file or "")
            before = self._known.get(key)
            if before == after and (key in self._known or after is None):
                return
            self._known[key] = after
        self._add(Intervention(what, cause.via, axis, file, before, after, cause.who))

    def commanded(self, command: Command, changed: Sequence[str], cause: Cause) -> None:
        """Note what a command of this process has changed."""
        for what, axis, file, after in _changes_of(command, changed):
            self.note(what, cause, axis, file, after)

    def happened(self, happened: Happened) -> None:
        """Note what another process did at the relay's socket."""
        changes = list(_changes_in(happened.event, happened.fields))
        if changes:
            self._active_s = time.monotonic()
        who = {key: value for key, value in happened.fields.items() if key in OF_PEER}
        if who.get("pid") not in (None, os.getpid()):
            for what, axis, file, after in changes:
                self.note(what, Cause("socket", who), axis, file, after)

    def compare(self, model: RelayModel, certificates: Sequence[CertificateStatus]) -> None:
        """Compare the relay's status with the last noted state, and note what is different as found."""
        if time.monotonic() < self._active_s + self._settled_s:
            return
        found = dict(_state_of(model, certificates))
        gone = {key: None for key in self._known if key[0] in OF_AXES and key not in found}
        for key, after in {**found, **gone}.items():
            if self._known.get(key, ...) != after:
                what, where = key
                is_axis = what in OF_AXES
                cause = AT_START if self._is_new else FOUND
                self.note(what, cause, where if is_axis else None, None if is_axis else where, after)
        for key in gone:
            del self._known[key]
        self._is_new = False

    async def erase(self, person: str, before: str, cause: Cause) -> int:
        """Take ``who`` out of all entries about a person, or before a time (ISO); return their number.

        ``person`` is the whole value of one of :data:`OF_PERSON`.

        Raises:
            OSError: the disk takes nothing.
        """

        def is_meant(entry: Entry) -> bool:
            named = [str(entry["who"][key]) for key in OF_PERSON if key in entry["who"]]
            return bool(before and entry["time"] < before) or bool(person and person in named)

        await self._write()
        by = Intervention("erasure", cause.via, who=cause.who)
        return await in_thread(partial(self._writer.erase, is_meant, by))

    def _listed(self) -> list[tuple[str, str, Any]]:
        return [(*key, value) for key, value in sorted(self._known.copy().items())]

    def _add(self, one: Intervention) -> None:
        if len(self._waiting) >= MOST_WAITING:
            self._lost += 1
        else:
            self._waiting.append(one)
        self._woken.set()

    def _be_late(self) -> None:
        late = TimeoutError(errno.ETIMEDOUT, "does not answer", str(self._folder))
        self.problem = problem_of(late, self._folder)

    async def _write(self) -> None:
        late = asyncio.get_running_loop().call_later(self._late_s, self._be_late)
        try:
            if self._waiting or self.problem is not None:
                await in_thread(partial(self._writer.write, self._waiting))
            if self._lost:
                lost, self._lost = self._lost, 0
                self._waiting.append(Intervention("lost", OWN, after=lost))
                await in_thread(partial(self._writer.write, self._waiting))
        except FileNotFoundError:
            self.problem = None  # the state folder itself is not there, which is reported as such
        except OSError as error:
            self.problem = problem_of(error, self._folder)
        else:
            self.problem = self._stranger()
        finally:
            late.cancel()

    def _stranger(self) -> FolderProblem | None:
        for found in self._writer.strangers:
            return FolderProblem(f"{found}: {STRANGER}", "move it away; meanwhile the journal goes on")
        return None


def _last_state(folder: Path) -> tuple[Verification, dict[Key, Any], Head | None]:
    head: Head | None = None
    state: dict[Key, Any] = {}
    verification = Verification()
    if folder.is_dir():
        with locked(folder):
            files, is_end = newest_files_in(folder)  # a whole journal would hold up the start
            head = head_in(folder)
            verification = Verification(head, is_end=is_end)
            for entry in verification.read(files):
                with contextlib.suppress(TypeError, ValueError):  # no entry of this program
                    if entry["what"] == "state":
                        state = {(str(what), str(where)): value for what, where, value in entry["after"]}
                    elif entry["what"] in KEPT:
                        state[entry["what"], entry["axis"] or entry["file"] or ""] = entry["after"]
                    elif entry["what"] == "start":
                        state["version", "supervisor"] = entry["after"]
        verification.finish()
    return verification, state, head


def _changes_of(command: Command, changed: Sequence[str]) -> Iterator[Change]:
    match command:
        case SetTable():
            yield from (("table", one.axis, one.file, one.sha256) for one in command.tables)
        case ClearTable():
            yield from (("table", axis, None, None) for axis in changed)
        case Enable() | Disable():
            word = "on" if isinstance(command, Enable) else "off"
            yield from (("compensation", axis, None, word) for axis in changed)
        case EndDryRun():
            yield from (("mode", axis, None, "on") for axis in changed)
        case SetReference():
            yield from (("reference", axis, None, "declared") for axis in changed)
        case SetGain():
            gain = {"forward": command.forward, "backward": command.backward}
            yield from (("gain", axis, None, gain) for axis in changed)
        case SetLimits():
            yield from (("limits", axis, None, values_of(command)) for axis in changed)
        case SetTemperature():
            pass


def _changes_in(event: str, fields: Mapping[str, Any]) -> Iterator[Change]:
    """Yield the same from an event of the relay."""
    axes: Sequence[str] = fields.get("axes", ())
    values = {key: value for key, value in fields.items() if isinstance(value, float)}
    if event == tables.TABLE_ACTIVATED.name:
        yield "table", fields["axis"], fields["table"], fields.get("sha256")
    elif (change := _OF_EVENTS.get(event)) is not None:
        what, after = change
        yield from ((what, axis, None, values if after is ... else after) for axis in axes)


_OF_EVENTS: Final[Mapping[str, tuple[str, Any]]] = {
    tables.TABLE_REMOVED.name: ("table", None),
    tables.ENABLED.name: ("compensation", "on"),
    tables.DISABLED.name: ("compensation", "off"),
    tables.DRY_RUN_ENDED.name: ("mode", "on"),
    tables.REFERENCED.name: ("reference", "declared"),
    tables.GAIN_CHANGED.name: ("gain", ...),
    tables.LIMITS_CHANGED.name: ("limits", ...),
}
"""What each event of the relay means; …: its numbers are the new values."""


def _state_of(model: RelayModel, certificates: Sequence[CertificateStatus]) -> Iterator[tuple[Key, Any]]:
    """Yield what is in force, as the relay says it."""
    for name, axis in model.axes.items():
        yield ("table", name), axis.table.sha256
        yield ("gain", name), {"forward": axis.gain.forward, "backward": axis.gain.backward}
        is_on = axis.compensation != "off" if axis.is_enabled is UNSET else axis.is_enabled
        yield ("compensation", name), "on" if is_on else "off"
        yield ("mode", name), axis.configured.get("compensation")
        limits = {key: value for key, value in axis.configured.items() if key not in ("compensation", "gain")}
        yield ("limits", name), limits
    yield ("version", "relay"), model.gateway.version
    held = [*certificates]
    for line in model.lines.values():
        for controller in line.controllers:
            if controller.tls:
                held += controller.tls.certificates
    for each in held:
        after = {"subject": each.subject, "ends": each.ends, "sha256": each.sha256}
        yield ("certificate", f"{each.key} {each.file}"), after
