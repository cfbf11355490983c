"""Unit ids that may reach an axis although they are not its own.

A broadcast reaches every drive of a serial line. A Modbus/TCP drive may answer to 0 and 255 besides its own
unit id (Messaging on TCP/IP implementation guide V1.0b, p. 23), and many ignore the unit id completely. In
none of these ways may a position bypass the correction.

So on a Modbus/TCP line with one axis unit id, a request to any other one counts as reaching that axis. Unit
ids of devices that the configuration names (``other_units``) are excepted. Several axis unit ids mean that
there is a converter, which evaluates them.
"""

from collections.abc import Collection, Iterable
from typing import Final

from gateway.catalogue import refusals
from gateway.catalogue.entry import RefusalEntry
from gateway.drives.motion import Action
from gateway.exchange.access import access_of, coils_written
from gateway.exchange.decode import NO_ACCESS, AxisCommand, DecodedRequest, decode
from gateway.exchange.plan import OtherUnits, StopWord
from gateway.exchange.unit import UnitMap
from gateway.modbus.pdu import BROADCAST_UNIT_ID, FunctionCode

ANY_TCP_DRIVE: Final = frozenset({BROADCAST_UNIT_ID, 0xFF})
_HARMLESS: Final = frozenset({Action.STOP, Action.IGNORE, Action.UNKNOWN})


class Aliases:
    """The unit ids of one line that have no axis: which are known, and what may pass to them."""

    def __init__(self, units: Collection[UnitMap], other: OtherUnits, *, is_serial: bool) -> None:
        self._units = units
        self._other = other
        self.is_serial = is_serial
        self.is_alone = len(units) == 1
        """Whether there is only one unit id with an axis."""
        self.requests: dict[int, int] = {}
        """Number of requests to each unknown unit id."""

    @property
    def requests_by_name(self) -> dict[str, int]:
        """The same, as the status shows it."""
        return {str(unit_id): count for unit_id, count in self.requests.items()}

    @property
    def expected_unit_ids(self) -> frozenset[int]:
        """Unit ids that have an axis, that the configuration names, or that reach every drive."""
        axes = {axis.plan.unit_id for unit in self._units for axis in unit.axes}
        return (
            self._other.unit_ids
            | axes
            | (frozenset({BROADCAST_UNIT_ID}) if self.is_serial else ANY_TCP_DRIVE)
        )

    def is_unknown(self, unit_id: int) -> bool:
        """Whether a unit id without an axis is unknown, on Modbus/TCP."""
        return (
            not self.is_serial
            and bool(self._units)
            and unit_id not in ANY_TCP_DRIVE
            and unit_id not in self._other.unit_ids
        )

    def may_reach_axis(self, unit_id: int) -> bool:
        """Whether a unit id without an axis may be another name of one, on Modbus/TCP."""
        if self.is_serial:
            return False
        return unit_id in ANY_TCP_DRIVE or (self.is_alone and self.is_unknown(unit_id))

    def count_request(self, unit_id: int) -> bool:
        """Count a request to an unknown unit id; return whether it is the first one."""
        count = self.requests[unit_id] = self.requests.get(unit_id, 0) + 1
        return count == 1

    def frames(self, pdu: bytes) -> list[DecodedRequest]:
        """Return a request as decoded for each axis unit id."""
        access, coils = access_of(pdu) or NO_ACCESS, coils_written(pdu)
        return [DecodedRequest(unit, pdu, access, coils) for unit in self._units]

    def is_stop(self, pdu: bytes, frames: Iterable[DecodedRequest]) -> bool:
        """Whether a request is a stop of a known drive, and does nothing else to the axes of this line."""
        word = _only_word(pdu)
        is_coil = pdu[0] == FunctionCode.WRITE_SINGLE_COIL
        if word is None or not any(_is_that_stop(stop, word, is_coil=is_coil) for stop in self._other.stops):
            return False
        return _is_harmless(frames)


def only_stops_alone(pdu: bytes, frames: Iterable[DecodedRequest]) -> bool:
    """Whether a request writes a single register or coil, and runs nothing by any register map."""
    return _only_word(pdu) is not None and _is_harmless(frames)


def _is_harmless(frames: Iterable[DecodedRequest]) -> bool:
    return all(command.action in _HARMLESS and not command.hits for command in _commands(frames))


def why_not_passed(aliases: Aliases, unit_id: int, pdu: bytes) -> RefusalEntry | None:
    """Return why a request to a unit id without axes must not pass; None: it may."""
    if aliases.is_serial:
        if unit_id == BROADCAST_UNIT_ID and _writes_position(aliases.frames(pdu)):
            return refusals.BROADCAST_POSITION
    elif unit_id in ANY_TCP_DRIVE:
        frames = aliases.frames(pdu)
        if _touches(frames) or _reads_position(frames):
            return refusals.UNIT_NOT_MAPPED
    elif aliases.is_alone and aliases.is_unknown(unit_id):
        frames = aliases.frames(pdu)
        if _touches(frames) and not aliases.is_stop(pdu, frames):
            return refusals.UNIT_WITHOUT_AXIS
    return None


def _touches(frames: Iterable[DecodedRequest]) -> bool:
    """Whether a request writes a position of a corrected axis, sets its mode or makes its drive act.

    Stops may pass.
    """
    return _writes_position(frames) or any(
        not (command.axis.passes_unchanged or command.is_stop) for command in _commands(frames)
    )


def _writes_position(frames: Iterable[DecodedRequest]) -> bool:
    """Whether a request writes a position of a corrected axis."""
    return any(own.fields and not own.axis.passes_unchanged for frame in frames for own in frame.by_axis)


def _reads_position(frames: Iterable[DecodedRequest]) -> bool:
    """Whether a request reads a position of a corrected axis."""
    return any(
        not hit.mapped.axis.passes_unchanged
        for frame in frames
        for hit in frame.unit.read(frame.access.read_address, frame.access.read_quantity).fields
    )


def _commands(frames: Iterable[DecodedRequest]) -> list[AxisCommand]:
    return [
        command for frame in frames if frame.unit.has_rules for command in decode(frame, may_have_risen=True)
    ]


def _only_word(pdu: bytes) -> tuple[int, int] | None:
    """Return address and content of the only register or coil that a request writes; None: not only one."""
    if len(pdu) == 5 and pdu[0] in (FunctionCode.WRITE_SINGLE_REGISTER, FunctionCode.WRITE_SINGLE_COIL):
        content = int.from_bytes(pdu[3:5], "big")
        is_coil = pdu[0] == FunctionCode.WRITE_SINGLE_COIL
        return int.from_bytes(pdu[1:3], "big"), int(content == 0xFF00) if is_coil else content
    if len(pdu) == 8 and pdu[0] == FunctionCode.WRITE_MULTIPLE_REGISTERS and pdu[3:6] == b"\0\1\2":
        return int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[6:8], "big")
    return None


def _is_that_stop(stop: StopWord, word: tuple[int, int], *, is_coil: bool) -> bool:
    address, content = word
    return (stop.address, stop.is_coil) == (address, is_coil) and content & stop.mask == stop.value
