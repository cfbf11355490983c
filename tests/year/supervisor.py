"""A stand-in for the supervisor: it speaks with the relay over the relay's own socket.

It subscribes, as the supervisor does; now and then it asks for something, as the supervisor and the commands
do. The socket, its messages and their descriptors are real (``gateway.ipc``). Both ends are in this program:
what one writes, the other can read at the same instant. A new table is first in the plan and then in force.
"""

import os
import random
import socket
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.exchange.commands import ClearTable, Command, Disable, Enable, SetGain, SetTable, TableFor
from gateway.exchange.plan import AxisPlan
from gateway.ipc.address import socket_path
from gateway.ipc.client import CHUNK_BYTES
from gateway.ipc.messages import (
    Done,
    GetStatus,
    Happened,
    Reply,
    Request,
    Snapshot,
    Status,
    Subscribe,
    Subscribed,
    decode_reply,
    encode,
)
from gateway.ipc.sealed_memory import seal
from gateway.state.plan import GatewayPlan, write_plan
from gateway.state.tables import compiled, digest_of
from tests.ledger.screws import Screw
from tests.year.account import Account, Axis
from tests.year.disk import Disk
from tests.year.machine import MS, Machine, S
from tests.year.status import StatusCheck

BETWEEN_S: Final = 0.5, 15.0
"""From one request to the next."""
SNAPSHOTS_S: Final = 5.0
ANSWERS_NS: Final = 5 * S
"""Within this time a command has its answer, as ``gateway.ipc.client`` demands."""
GAINS: Final = (0.0, 0.5, 1.0)
TABLES: Final = 3
"""Of each axis: it gets another one of them."""


Changes = Mapping[Axis, Mapping[str, Any]]


def table_name(axis: str, number: int) -> str:
    """Return the name of a table of an axis."""
    return f"{axis}-{number}.csv"


def table_of(screw: Screw) -> CorrectionTable:
    """Return the table that corrects a screw."""
    return make_table(screw.positions, screw.forward, screw.backward, Units.MM)


class Connection:
    """One connection to the relay. ``heard`` gets each message; ``ended`` is called if the relay ends it.

    Raises:
        OSError: nobody listens.
    """

    def __init__(
        self, machine: Machine, path: Path, heard: Callable[[Reply], None], ended: Callable[[], object]
    ) -> None:
        self._machine, self._heard, self._ended = machine, heard, ended
        self._data = b""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.setblocking(False)
            self._socket.connect(str(path))
        except OSError:
            self._socket.close()
            raise
        machine.real_ends[self._socket.fileno()] = self._readable

    def ask(self, request: Request, descriptors: Sequence[int] = ()) -> None:
        """Send a request with its descriptors, which are closed here."""
        with suppress(BrokenPipeError, ConnectionResetError):  # it has ended: that is read
            socket.send_fds(self._socket, [encode(request)], descriptors)
        for each in descriptors:
            os.close(each)
        self._machine.look()

    def close(self) -> None:
        """End it."""
        self._machine.real_ends.pop(self._socket.fileno(), None)
        self._socket.close()
        self._machine.is_stirred = True

    def _readable(self) -> None:
        try:
            data = self._socket.recv(CHUNK_BYTES)
        except ConnectionResetError:
            data = b""
        if not data:
            self._ended()
            return
        *lines, self._data = (self._data + data).split(b"\n")
        for line in lines:
            self._heard(decode_reply(line))


class Supervisor:
    """Asks for one thing after the other. ``screws`` has those of each axis, one for each of its tables."""

    def __init__(
        self,
        machine: Machine,
        account: Account,
        disk: Disk,
        screws: Mapping[str, Sequence[Screw]],
        rng: random.Random,
    ) -> None:
        self._machine, self._account, self._disk, self._rng = machine, account, disk, rng
        self._status = StatusCheck(machine, account)
        self._axes = {axis.name: axis for line in account.lines.values() for axis in line.axes.values()}
        self._tables = {
            table_name(name, number): table_of(screw)
            for name, each in screws.items()
            for number, screw in enumerate(each)
        }
        account.tables = {
            table_name(name, number): screw
            for name, each in screws.items()
            for number, screw in enumerate(each)
        }
        account.digests = {name: digest_of(compiled(table)) for name, table in self._tables.items()}
        self._path = socket_path(disk.folder)
        self._commands = 0
        self._commanded: tuple[Axis, ...] = ()
        """The axes of the newest command."""
        self._listening: Connection | None = None
        self._asking: Connection | None = None

    def begin(self, plan: GatewayPlan) -> None:
        """Write the first plan, and begin to ask."""
        self._write(plan)
        self._later(self._go_on)

    def hang_up(self) -> None:
        """The process of the relay has ended: nothing is heard of what was asked for."""
        for connection in (self._listening, self._asking):
            if connection is not None:
                connection.close()
        self._listening = self._asking = None

    # --- one thing after the other

    def _later(self, what: Callable[[], None]) -> None:
        self._machine.after(int(self._rng.uniform(*BETWEEN_S) * S), what)

    def _go_on(self) -> None:
        self._later(self._go_on)
        if self._asking is not None or self._machine.is_dead:
            return
        if self._listening is None:
            self._listening = self._connect()
            if self._listening is not None:
                self._listening.ask(Subscribe(interval_s=SNAPSHOTS_S))
            return
        axis = self._rng.choice(tuple(self._axes.values()))
        deeds = (self._look, self._load, self._load, self._remove, self._set_gain, self._turn)
        self._rng.choice(deeds)(axis)

    def _connect(self) -> Connection | None:
        try:
            return Connection(self._machine, self._path, self._heard, self._ended)
        except OSError:
            return None

    def _look(self, _axis: Axis) -> None:
        self._ask(GetStatus())

    def _load(self, axis: Axis) -> None:
        """Give an axis another table, or the same one again: first for the next start, then for now.

        All axes of a group get one: none of them may be left without.
        """
        plan, changes, tables = self._plan, dict[Axis, Mapping[str, object]](), list[TableFor]()
        for each in axis.members:
            name = table_name(each.name, self._rng.randrange(TABLES))
            plan = _with_table(plan, each.name, name, self._tables[name])
            tables.append(TableFor(each.name, name, "csv", self._account.digests[name]))
            changes[each] = {"table": name, "screw": self._account.tables[name]}
        if not self._write(plan):
            return
        self._soon(
            changes, SetTable(tables=tuple(tables)), [compiled(self._tables[each.file]) for each in tables]
        )

    def _remove(self, axis: Axis) -> None:
        plan = self._plan
        for each in axis.members:
            plan = _with_table(plan, each.name, "", None)
        if not self._write(plan):
            return
        self._for_all(axis, ClearTable(axes=(axis.name,)), {"table": "", "screw": None})

    def _set_gain(self, axis: Axis) -> None:
        forward, backward = self._rng.choice(GAINS), self._rng.choice(GAINS)
        request = SetGain(axes=(axis.name,), forward=forward, backward=backward)
        self._for_all(axis, request, {"forward": forward, "backward": backward})

    def _turn(self, axis: Axis) -> None:
        """Switch the compensation of an axis on or off; without a table it stays as it is."""
        is_on = self._rng.random() < 0.7
        if axis.correction.screw is not None or not is_on:
            self._for_all(axis, (Enable if is_on else Disable)(axes=(axis.name,)), {"is_on": is_on})

    # --- a command and its result

    def _for_all(self, axis: Axis, command: Command, change: Mapping[str, object]) -> None:
        """Send a command that changes an axis and its whole group."""
        self._soon(dict.fromkeys(axis.members, change), command)

    def _soon(self, changes: Changes, command: Command, tables: Sequence[bytes] = ()) -> None:
        """Send a command a little later: meanwhile the relay may be killed."""
        self._commands += 1
        delay_ns = self._rng.randrange(200 * MS)
        self._machine.after(delay_ns, self._command, self._commands, changes, command, tables)

    def _command(self, number: int, changes: Changes, command: Command, tables: Sequence[bytes]) -> None:
        if number != self._commands or self._machine.is_dead:
            return
        self._commanded = tuple(changes)
        for axis, change in changes.items():
            axis.wanted = axis.correction._replace(**change)
        self._account.book.note(f"command {self._commanded[0].name}", encode(command))
        self._ask(command, [seal(table, "table") for table in tables])

    def _ask(self, request: Request, descriptors: Sequence[int] = ()) -> None:
        """Ask on a connection of its own, as ``gateway.ipc.client.ask`` does."""
        self._asking = self._connect()
        if self._asking is not None:
            self._asking.ask(request, descriptors)
            self._machine.after(ANSWERS_NS, self._need_answer, self._asking)

    def _need_answer(self, asking: Connection) -> None:
        if asking is self._asking:
            self._account.need_calm("command-unanswered", "the relay has not answered on its socket")

    def _heard(self, reply: Reply) -> None:
        book = self._account.book
        book.seen[f"socket {type(reply).__name__.lower()}"] += 1
        if isinstance(reply, Snapshot | Status):
            self._status.shown(reply.status)
        elif isinstance(reply, Done):
            for axis in self._commanded:
                self._done(reply, axis)
        elif not isinstance(reply, Happened | Subscribed):
            book.find("socket-refused", str(reply))
        if isinstance(reply, Status | Done) and self._asking is not None:
            self._asking.close()
            self._asking = None

    def _done(self, done: Done, axis: Axis) -> None:
        if done.problems or axis.correction != axis.wanted:
            self._account.book.find("command-not-done", f"{axis.name}: {done}")
        comes = "next-target" if axis.flow is None else "blended"
        may_come = {comes if axis.correction.is_on and axis.is_referenced else "not-in-force"}
        if axis.correction.screw is None:
            may_come.add("not-in-force")  # a gain, without a table
        if not may_come.issuperset(done.comes.values()):
            self._account.book.find("comes-otherwise", f"{axis.name}: {done}")

    def _ended(self) -> None:
        """The relay has ended a connection: only because it stops."""
        self._account.need_calm("socket-closed", "the relay has closed a connection")
        self.hang_up()

    # --- the plan

    def _write(self, plan: GatewayPlan) -> bool:
        """Write the plan of the next start, with its tables; return whether the disk takes it."""
        try:
            write_plan(self._disk.folder, plan, {}, "")
        except OSError:
            self._account.book.seen["plans for which the disk was full"] += 1
            return False
        self._plan = plan
        self._disk.sync(self._machine.now_ns)
        for line in plan.lines:
            for axis in line.axes:
                self._axes[axis.name].planned = axis.table_name
        return True


def _with_table(plan: GatewayPlan, name: str, file: str, table: CorrectionTable | None) -> GatewayPlan:
    def given(axis: AxisPlan) -> AxisPlan:
        return replace(axis, table=table, table_name=file) if axis.name == name else axis

    lines = (replace(line, axes=tuple(map(given, line.axes))) for line in plan.lines)
    return replace(plan, lines=tuple(lines))
