"""One writer at a time for each axis: the writer that moves it holds it, others are refused (W10).

A refused frame is a loss only for its sender: the axis continues for the writer that holds it. The loss takes
effect when the sender takes the axis over (M3).
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Final, NamedTuple

from gateway.catalogue import exchange_events
from gateway.drives.motion import Action
from gateway.exchange.access import MONITOR_FUNCTIONS
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.registers import Loss
from gateway.exchange.decode import AxisCommand, DecodedRequest, decode
from gateway.exchange.dispatch import UnitMaps
from gateway.exchange.effects import lose
from gateway.exchange.events import Event
from gateway.exchange.ports import ControllerPort
from gateway.exchange.request import Request, has_a_stop, part_of, written_part
from gateway.exchange.transaction import Transaction
from gateway.exchange.unit import FieldHit
from gateway.exchange.writer_conflicts import WriterConflicts
from gateway.limits import Reports, others_of_pairs, times
from gateway.modbus.pdu import ExceptionCode

LOST_BY_WRITER: Final = 32
"""Lost requests of one writer to one axis that are remembered; above it, everything of the axis is lost."""
KEPT: Final = 256
"""Number of pairs of axis and writer for which losses are remembered; the oldest is dropped for the next."""

_BUSY: Final = ExceptionCode.SERVER_DEVICE_BUSY
_HEAD_BYTES: Final = {0x17: 9, 0x2B: 8}
"""By function code: length of the head of a PDU that names what it writes; for all others 5 (``access``)."""


class Unsent(NamedTuple):
    """A request that never reached the drive."""

    pdu: bytes
    frames: tuple[DecodedRequest, ...]
    arrived_ns: int
    follows_ns: int


class Ownership:
    """Decides who moves which axis of one line."""

    def __init__(self, axes: Sequence[Axis], units: UnitMaps, on_event: Callable[[Event], None]) -> None:
        self._axes = axes
        self._units = units
        self._on_event = on_event
        self._connections: dict[str, int] = {}
        self._lost: dict[tuple[str, str], dict[tuple[int, bytes], Unsent]] = {}
        """By axis and writer; of the requests with the same head, the newest."""
        self._reports: Reports[tuple[str, str]] = Reports(others=others_of_pairs)
        self.writer_conflicts = WriterConflicts()

    def came(self, port: ControllerPort) -> None:
        """Record a connection that sends its first request."""
        self._connections[port.writer] = self._connections.get(port.writer, 0) + 1

    def gone(self, port: ControllerPort, now_ns: int, *, is_broken: bool) -> None:
        """Record that such a connection is gone: after its last one, a writer soon releases every axis.

        A part of a position that the drive has acknowledged can be completed from another connection: a
        controller may close its own after each request. Not if the connection broke. A part that never
        reached the drive is never completed from another connection.
        """
        if is_broken:
            self.forget_parts(port)
        left = self._connections.pop(port.writer, 1) - 1
        if left > 0:
            self._connections[port.writer] = left
            return
        for axis in self._axes:
            if axis.hold.writer == port.writer:
                axis.hold.leave(now_ns)

    def forget_parts(self, port: ControllerPort) -> None:
        """Forget parts of positions that came on a connection that broke: nothing completes them."""
        for axis in self._axes:
            if axis.hold.is_shared or axis.hold.writer in ("", port.writer):
                axis.forget_parts()

    def may_move(self, transaction: Transaction, axes: Iterable[Axis], now_ns: int) -> bool:
        """Return whether other writers allow a request to be sent; if so, its writer takes over its axes.

        ``axes``: those that it reaches. Stops always may, and take nothing over (M3).
        """
        port = transaction.port
        assert port is not None
        writer = port.writer
        for axis in axes:
            if axis.hold.writer != writer or axis.hold.overwritten_by:
                return self._may_take(transaction, port, now_ns)
        return True

    def moved(self, transaction: Transaction, now_ns: int) -> None:
        """Record that a request was sent: its writer continues to hold what it moves."""
        port = transaction.port
        assert port is not None
        requests = transaction.requests
        has_stop = self._units.have_rules and has_a_stop(requests)
        for request in requests:
            for command in request.commands:
                if command.is_empty:
                    continue
                _hold_on(command.axis, port.writer, now_ns)
                _set_jog(command, port.writer)
                if has_stop and request.frame.unit.has_rules:
                    _mark_beside_stop(command, request, port)

    def lose(self, transaction: Transaction, code: int, loss: Loss) -> None:
        """Record that a request never reached the drive; for axes of another writer this counts later."""
        port = transaction.port
        assert port is not None
        frames = self._units.frames_of(transaction)
        unsent = Unsent(transaction.pdu, frames, transaction.arrived_ns, transaction.follows_ns)
        for frame in unsent.frames:
            for own in frame.by_axis:
                hold = own.axis.hold
                if hold.is_shared or hold.writer in ("", port.writer):
                    _lose_of_axis(own.axis, unsent, code, loss)
                else:
                    self._remember((own.axis.plan.name, port.writer), transaction.unit_id, unsent)

    def _remember(self, whose: tuple[str, str], unit_id: int, unsent: Unsent) -> None:
        lost = self._lost.get(whose)
        if lost is None:
            if len(self._lost) >= KEPT:
                del self._lost[next(iter(self._lost))]
            lost = self._lost[whose] = {}
        if len(lost) <= LOST_BY_WRITER:  # one more marks that there were too many
            lost[unit_id, unsent.pdu[: _HEAD_BYTES.get(unsent.pdu[0], 5)]] = unsent

    def _may_take(self, transaction: Transaction, port: ControllerPort, now_ns: int) -> bool:
        """Judge a request to axes that another writer moved last, or none."""
        if transaction.pdu[0] in MONITOR_FUNCTIONS:
            return True
        claims = self._claims(transaction)
        if self._units.stops_of(self._units.frames_of(transaction)):
            claims = [each for each in claims if self._is_free(*each, port.writer, now_ns)]
        for axis, command in claims:
            for member in (axis, *axis.peers):
                hold = member.hold
                if hold.is_barred(port.writer, now_ns):
                    self._refuse(transaction, port, member, f"{hold.writer} moves it", now_ns)
                    return False
            if _runs_of_another(axis, command, port.writer):
                whose = axis.hold.overwritten_by or axis.hold.writer
                why = f"it would run what {whose} wrote: write the whole target again"
                self._refuse(transaction, port, axis, why, now_ns)
                return False
        for axis, command in claims:
            if command is not None and _changes_nothing(command):
                continue
            for member in (axis, *axis.peers):
                self._take_over(member, port.writer, now_ns)
            if command is not None and command.hits:
                axis.hold.overwrite("")
        return True

    @staticmethod
    def _is_free(axis: Axis, command: AxisCommand | None, writer: str, now_ns: int) -> bool:
        """Whether a frame that stops another axis may take this axis over; the frame passes in any case."""
        if command is not None and command.is_idle:
            return False
        members = (axis, *axis.peers)
        is_barred = any(member.hold.is_barred(writer, now_ns) for member in members)
        return not is_barred and not _runs_of_another(axis, command, writer)

    def _claims(self, transaction: Transaction) -> list[tuple[Axis, AxisCommand | None]]:
        """Return the axes that a request would move or prepare to move; not those that it stops.

        For the writer that jogs an axis, the release of the jog is a stop.
        """
        writer = "" if transaction.port is None else transaction.port.writer
        claims: list[tuple[Axis, AxisCommand | None]] = []
        for frame in self._units.frames_of(transaction):
            found = decode(frame) if frame.unit.has_rules else []
            for own in frame.by_axis:
                command = next((each for each in found if each.axis is own.axis), None)
                if command is None or not (command.is_stop or lets_go(command, writer)):
                    claims.append((own.axis, command))
        return claims

    def _refuse(
        self, transaction: Transaction, port: ControllerPort, axis: Axis, why: str, now_ns: int
    ) -> None:
        self.writer_conflicts.refused(axis.plan.name, axis.hold.writer, port.writer, now_ns)
        count = self._reports.due((axis.plan.name, port.writer), now_ns)
        if count:
            more = (
                ("holder", axis.hold.writer),
                ("controller", port.plan.name),
                ("peer", port.peer),
                ("function_code", transaction.pdu[0]),
                ("unit_id", transaction.unit_id),
            )
            detail = f"{port.writer} was refused: {why}{times(count)}"
            self._on_event(Event(exchange_events.SECOND_WRITER, axis.plan.name, detail, more))

    def _take_over(self, axis: Axis, writer: str, now_ns: int) -> None:
        hold = axis.hold
        former = hold.writer
        hold.move(writer, now_ns)
        if former != writer:
            if former:
                self.writer_conflicts.changed(axis.plan.name, former, writer, now_ns)
            if former and not hold.is_shared:
                axis.take_over(former, _BUSY)
            self._apply_lost(axis, writer)

    def _apply_lost(self, axis: Axis, writer: str) -> None:
        """Apply the losses of a writer from the time in which another one held the axis."""
        lost = self._lost.pop((axis.plan.name, writer), {})
        if len(lost) > LOST_BY_WRITER:
            axis.lose_everything(_BUSY)
            return
        for unsent in lost.values():
            _lose_of_axis(axis, unsent, _BUSY, Loss.DENIED)


def _hold_on(axis: Axis, writer: str, now_ns: int) -> None:
    for member in (axis, *axis.peers):
        if member.hold.writer == writer:
            member.hold.extend(now_ns)


def _lose_of_axis(axis: Axis, lost: Unsent, code: int, loss: Loss) -> None:
    """Record for one axis that a request never reached its drive."""
    for frame in lost.frames:
        for own in frame.by_axis:
            if own.axis is axis:
                written = [hit for hit in own.fields if hit.mapped.image is not None]
                parts = [part_of(hit, lost.pdu, frame.access) for hit in written]
                found = decode(frame) if frame.unit.has_rules else []
                command = next((command for command in found if command.axis is axis), None)
                lose(axis, parts, command, code, loss, arrived_ns=lost.arrived_ns, follows_ns=lost.follows_ns)


def _runs_of_another(axis: Axis, command: AxisCommand | None, writer: str) -> bool:
    """Whether a request runs a target that another writer may have written."""
    hold = axis.hold
    is_own = hold.is_shared or hold.writer in ("", writer)
    if command is None or (is_own and not hold.overwritten_by):
        return False
    return command.runs_alone or (command.action is Action.UNKNOWN and not command.hits)


def _set_jog(command: AxisCommand, writer: str) -> None:
    hold, action = command.axis.hold, command.action
    if action is Action.OTHER_MOTION:
        hold.set_jog(writer)
    elif command.is_stop or command.runs_target or action is Action.HOME:
        hold.set_jog("")


def _changes_nothing(command: AxisCommand) -> bool:
    """Whether a request is idle for an axis, and later positions mean the same after it: an alarm reset."""
    touched = {*command.words, *command.unclear_words}
    return command.is_idle and not any(trigger.address in touched for trigger in command.axis.rules.following)


def lets_go(command: AxisCommand, writer: str) -> bool:
    """Whether a request of the writer that jogs an axis starts nothing: it may end the jog."""
    return command.is_idle and command.axis.hold.jogged_by == writer


def _mark_beside_stop(command: AxisCommand, request: Request, port: ControllerPort) -> None:
    """A stop from another writer changed something more: the axis's writer must write that again (M3).

    This also holds if another axis is stopped in the same frame: the frame passed because of that.
    """
    axis, hold = command.axis, command.axis.hold
    is_writer = hold.is_shared or hold.writer in ("", port.writer)
    if is_writer and port.is_motion:
        if command.hits:
            hold.overwrite("")
        return
    for address in command.modes_written:
        if address in command.unclear_words or command.words[address] != axis.rules.word(address):
            axis.lose_mode(address, _BUSY)
    changed = [hit.mapped.number for hit in command.hits if _is_changed(hit, request)]
    axis.overwrite(changed, port.writer, _BUSY)


def _is_changed(hit: FieldHit, request: Request) -> bool:
    """Whether a request writes other words to a command field than its writer believes to be there."""
    image, access = hit.mapped.image, request.frame.access
    assert image is not None
    if image.is_incomplete or image.nominal_words is None or access.is_mask or not access.is_consistent:
        return True
    first, words = written_part(hit, request.frame.pdu, access)
    return image.nominal_words[2 * first : 2 * first + len(words)] != words
