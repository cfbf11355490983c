"""What is sent next for one request: the request itself, or a frame that it needs first."""

from collections.abc import Iterable, Sequence
from typing import Final

from gateway.catalogue import refusals
from gateway.drives.motion import Action
from gateway.exchange.access import HEAD_BYTES, access_of, coils_written, is_truncated
from gateway.exchange.added_frames import AddedFrame
from gateway.exchange.aliases import Aliases, only_stops_alone, why_not_passed
from gateway.exchange.axis.axis import Axis
from gateway.exchange.decode import NO_ACCESS, AxisCommand, DecodedRequest, decode
from gateway.exchange.fast_path import find_path
from gateway.exchange.group import next_of_groups, settle_group, settle_groups
from gateway.exchange.plan import NO_OTHER_UNITS, OtherUnits
from gateway.exchange.prepare import prepare
from gateway.exchange.prerequisites import next_frame, run_beside_stop
from gateway.exchange.refusal import refused
from gateway.exchange.request import NOTHING_PREFETCHED, has_a_stop, understand
from gateway.exchange.transaction import FastPath, Transaction
from gateway.exchange.unit import UnitMap
from gateway.modbus.pdu import BROADCAST_UNIT_ID

REMEMBERED_PATHS: Final = 4096
"""Number of request heads whose fast path is remembered; a controller uses a few dozen."""
UNIT_IDS: Final = 256
SHORTEST_REQUEST: Final = 5
"""Bytes of the shortest PDU with a fast path."""


class UnitMaps:
    """The register maps of all unit ids of one line."""

    def __init__(
        self,
        axes: Sequence[Axis],
        *,
        is_serial: bool,
        remembered_paths: int = REMEMBERED_PATHS,
        other_units: OtherUnits = NO_OTHER_UNITS,
    ) -> None:
        unit_ids = dict.fromkeys(axis.plan.unit_id for axis in axes)
        self._units = {
            unit_id: UnitMap(axis for axis in axes if axis.plan.unit_id == unit_id) for unit_id in unit_ids
        }
        self.aliases = Aliases(tuple(self._units.values()), other_units, is_serial=is_serial)
        self.heard: set[int] = set()
        """Unit ids that controllers have addressed."""
        # The mapped units that a request reaches: on a serial line a broadcast reaches all.
        self._reached: dict[int, tuple[UnitMap, ...]] = {
            unit_id: (unit,) for unit_id, unit in self._units.items()
        }
        if is_serial:
            self._reached[BROADCAST_UNIT_ID] = tuple(self._units.values())
        self._axes = {
            unit_id: tuple(axis for unit in reached for axis in unit.axes)
            for unit_id, reached in self._reached.items()
        }
        self._partners = {unit_id: _partners(own) for unit_id, own in self._axes.items()}
        if is_serial:
            grouped = [axis for axis in axes if axis.peers]
            self._partners[BROADCAST_UNIT_ID] = _partners(grouped)
        self.have_rules = any(unit.has_rules for unit in self._units.values())
        """Whether a frame may mean something other than a position to go to immediately."""
        self.have_groups = any(axis.member.gantry is not None for axis in axes)
        """Whether axes move together (M11)."""
        self.broadcast_unit_ids = frozenset(unit_ids) if is_serial else None
        """The mapped unit ids that a broadcast reaches; None: there are no broadcasts."""
        self._paths: list[dict[bytes, FastPath | None]] = [{} for _ in range(UNIT_IDS)]
        self._remembered_paths = self._paths_left = remembered_paths

    def __contains__(self, unit_id: int) -> bool:
        """Whether a unit id has an axis."""
        return unit_id in self._units

    def get(self, unit_id: int) -> UnitMap | None:
        """Return a unit id's register map; None: it has none."""
        return self._units.get(unit_id)

    def path_of(self, unit_id: int, pdu: bytes) -> FastPath | None:
        """Return the fast path of a request; None: it takes the slow one."""
        head = pdu[: HEAD_BYTES[pdu[0]]]
        paths = self._paths[unit_id]
        path = paths.get(head)
        if path is not None:
            return path
        return None if head in paths else self._find_path(unit_id, pdu, head)

    def forget_paths(self) -> None:
        """Find all fast paths again: an axis has more of them now."""
        for paths in self._paths:
            paths.clear()
        self._paths_left = self._remembered_paths

    def _find_path(self, unit_id: int, pdu: bytes, head: bytes) -> FastPath | None:
        self.heard.add(unit_id)
        if (
            not head
            or len(pdu) < SHORTEST_REQUEST
            or unit_id == BROADCAST_UNIT_ID
            or not self._remembered_paths
            or (unit_id not in self._units and self.aliases.is_unknown(unit_id))
        ):
            return None
        if not self._paths_left:
            self.forget_paths()
        self._paths_left -= 1
        path = find_path(self._units.get(unit_id), unit_id, pdu)
        self._paths[unit_id][head] = path
        return path

    def axes_of(self, unit_id: int) -> tuple[Axis, ...]:
        """Return the axes that a request to a unit id reaches."""
        return self._axes.get(unit_id, ())

    def partners(self, unit_id: int) -> tuple[int, ...]:
        """Return the unit ids that must be reachable for a request to one: itself and its group (M11).

        For a broadcast, all that are in a group: if only one of two drives on a gantry receives it, only that
        one moves.
        """
        return self._partners.get(unit_id) or (unit_id,)

    def frames_of(self, transaction: Transaction) -> tuple[DecodedRequest, ...]:
        """Return a request, decoded for each mapped unit that it reaches; parsed at the first call only."""
        frames = transaction.frames
        if frames is None:
            pdu, reached = transaction.pdu, self._reached.get(transaction.unit_id, ())
            if reached:
                access, coils = access_of(pdu) or NO_ACCESS, coils_written(pdu)
                frames = tuple([DecodedRequest(unit, pdu, access, coils) for unit in reached])
            else:
                frames = self._stops_by_alias(transaction.unit_id, pdu)
                transaction.is_by_alias = bool(frames)
            transaction.frames = frames
        return frames

    def _stops_by_alias(self, unit_id: int, pdu: bytes) -> tuple[DecodedRequest, ...]:
        """Return a stop to a unit id that may be another name of an axis, as decoded for it; else nothing."""
        if not (self.have_rules and self.aliases.may_reach_axis(unit_id)):
            return ()
        frames = tuple(self.aliases.frames(pdu))
        return frames if self.stops_of(frames) and only_stops_alone(pdu, frames) else ()

    @staticmethod
    def stops_of(frames: Iterable[DecodedRequest]) -> list[AxisCommand]:
        """Return what a request stops; a stop goes before everything else (M3)."""
        return [
            command
            for frame in frames
            if frame.unit.has_rules
            for command in decode(frame)
            if command.is_stop
        ]

    @staticmethod
    def given_targets(frames: Iterable[DecodedRequest]) -> list[Axis]:
        """Return the axes whose targets a request writes or runs."""
        return [
            command.axis
            for frame in frames
            if frame.unit.has_rules
            for command in decode(frame)
            if command.hits or command.runs_target
        ]

    @staticmethod
    def only_stops(frames: Iterable[DecodedRequest]) -> bool:
        """Whether a request only stops axes, whenever it is sent and however often."""
        for frame in frames:
            # A bit that is set now may be cleared before the request is sent, or before it is sent again.
            found = {command.axis.plan.name: command for command in decode(frame, may_have_risen=True)}
            for own in frame.by_axis:
                command = found.get(own.axis.plan.name)
                if not (command is not None and command.is_stop) and (
                    own.fields or (command is not None and not command.is_idle)
                ):
                    return False
        return True

    def next_to_send(self, transaction: Transaction, now_ns: int) -> tuple[AddedFrame | None, bytes]:
        """Return what is sent next for a transaction: a frame that it needs first, or its own request.

        Raises:
            RefusedRequestError: it must not reach the drive.
        """
        frames = self.frames_of(transaction)
        port = transaction.port
        may_be_short = transaction.is_odd and port is not None and port.ends_by_silence
        if is_truncated(transaction.pdu) and not may_be_short and not self.stops_of(frames):
            raise refused(refusals.TOO_SHORT, "")
        if transaction.unit_id not in self._units and not (self.have_rules and self.stops_of(frames)):
            refusal = why_not_passed(self.aliases, transaction.unit_id, transaction.pdu)
            if refusal is not None:
                raise refused(refusal, "", unit_id=transaction.unit_id)
        prefetched = (
            transaction.knowledge() if self.have_rules else transaction.prefetched or NOTHING_PREFETCHED
        )
        requests = []
        arrived_ns, follows_ns = transaction.arrived_ns, transaction.follows_ns
        for frame in frames:
            if self.have_groups:
                for axis in frame.unit.axes:
                    settle_group(axis, now_ns)
            requests.append(understand(frame, prefetched, now_ns, arrived_ns, follows_ns))
        has_stop = self.have_rules and has_a_stop(requests)
        for i, request in enumerate(requests if self.have_groups else ()):
            if settle_groups(request, has_stop=has_stop):
                requests[i] = understand(request.frame, prefetched, now_ns, arrived_ns, follows_ns)
        requests = [each for each in requests if each.frame.access is not NO_ACCESS or each.commands]
        if self.have_groups and not has_stop:
            added = next_of_groups(requests)
            if added is not None:
                return added, b""
        for request in requests:
            if has_stop:
                run_beside_stop(request)
                continue
            added = next_frame(request)
            if added is not None:
                return added, b""
        for request in requests:
            prepare(request, has_stop=has_stop)
        transaction.set_requests(tuple(requests))
        is_one = len(requests) == 1 and not transaction.is_by_alias
        return None, requests[0].sent_pdu if is_one else transaction.pdu


def _partners(axes: Sequence[Axis]) -> tuple[int, ...]:
    return tuple(dict.fromkeys(each.plan.unit_id for axis in axes for each in (axis, *axis.peers)))


def is_acting_on(units: UnitMaps, transaction: Transaction, axes: Sequence[Axis]) -> bool:
    """Whether a request is no stop, and would move one of these axes or give it a target."""
    return not transaction.is_stop and moves_one_of(units, transaction, axes)


def rewrites(units: UnitMaps, transaction: Transaction, frames: Iterable[DecodedRequest]) -> bool:
    """Whether a request writes a register or coil that these frames write too."""
    if transaction.port is None:
        return False
    return any(
        mine.unit is other.unit
        and (mine.access.writes_over(other.access) or not mine.coils.keys().isdisjoint(other.coils))
        for mine in units.frames_of(transaction)
        for other in frames
    )


def moves_one_of(units: UnitMaps, transaction: Transaction, axes: Sequence[Axis]) -> bool:
    """Whether a request would move one of these axes or give it a target, whatever else it stops."""
    if transaction.port is None:
        return False
    for frame in units.frames_of(transaction):
        # A bit that is set now may be cleared by a request that waits before this one.
        for command in decode(frame, may_have_risen=True):
            acts = bool(command.hits) or command.action is not Action.IGNORE
            if acts and not (transaction.is_stop and command.is_stop) and command.axis in axes:
                return True
    return False
