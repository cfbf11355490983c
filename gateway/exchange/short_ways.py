"""The short way: most frames need no judgement, and leave with a lookup or with one correction.

A *way* is found once for a unit id and the head of a request, which says what registers it touches, and is
remembered. It takes the usual case only: whenever anything is not as usual it returns None, and the request
or the reply goes the long way (``dispatch``, ``preparing``, ``answering``), which knows every case. Both come
to the same bytes and leave the same state behind; tests/exchange/test_short_ways.py holds one against the
other.
"""

from typing import Final, NamedTuple

from gateway.counts import Counts
from gateway.exchange.access import ACCESS, Access
from gateway.exchange.aliases import ANY_TCP_DRIVE
from gateway.exchange.answering import READS_BITS, note_bits
from gateway.exchange.arrival import Stage
from gateway.exchange.axis import AxisExchange
from gateway.exchange.draft import Place
from gateway.exchange.life import Exchange
from gateway.exchange.observing import observe_actual
from gateway.exchange.rendering import nominal_limit
from gateway.exchange.shadow import Shadow
from gateway.exchange.unit import FieldHit, FieldRole, Hits, UnitMap
from gateway.exchange.way import Way
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.pdu import ExceptionCode, FunctionCode, exception_pdu
from gateway.modbus.registers import BitTable, PositionField

ARRIVED: Final = Stage.ARRIVED
MAY_HAVE_LEFT: Final = Stage.MAY_HAVE_LEFT
NOBODY: Final[frozenset[str]] = frozenset()
"""Names of the axes that a read sends somewhere."""


class _Read(NamedTuple):
    """A position inside a reply: where its bytes are."""

    axis: AxisExchange
    role: FieldRole
    is_first_actual: bool
    number: int
    shadow: Shadow | None
    field: PositionField
    start: int
    end: int


class ReadWay(Way):
    """Reads of whole positions and status bits."""

    __slots__ = ("_access", "_asks_for_bits", "_hits", "_reads", "_unit")

    def __init__(self, unit: UnitMap, access: Access, hits: Hits) -> None:
        super().__init__(5, unit.axes)
        self._unit = unit
        self._access = access
        self._hits = hits
        self._asks_for_bits = unit.asks_for_bits
        self._reads = tuple(_read(hit) for hit in hits.fields if hit.place.role.is_position)

    def sent(self, exchange: Exchange, now_ns: int) -> bytes | None:
        """See ``Way``."""
        for axis in self.axes:
            if axis.silent_since_ns is not None or axis.is_recalling:
                return None
        if self._asks_for_bits:
            for read in self._reads:
                if read.axis.needs_reference(now_ns, is_target=False):
                    return None
        exchange.readbacks = [
            None if read.axis.reads_unchanged else read.axis.compensation.readback for read in self._reads
        ]
        return exchange.pdu

    def answered(self, exchange: Exchange, reply: bytes, now_ns: int) -> bytes | None:
        """See ``Way``."""
        if reply[0] != exchange.pdu[0] or len(reply) != 2 + 2 * self._access.read_quantity:
            return reply
        if reply[1] != len(reply) - 2:
            return reply
        data = bytearray(reply)
        try:
            for read, readback in zip(self._reads, exchange.readbacks, strict=True):
                axis, role, is_first_actual, number, shadow, field, start, end = read
                words = reply[start:end]
                if is_first_actual:
                    observe_actual(axis, field, words, exchange.sent_ns)  # as old as its request
                if readback is None:
                    continue
                if role is FieldRole.COMMAND and shadow is not None:
                    data[start:end] = axis.command_words(shadow, field, words, readback)
                elif role is FieldRole.LIMIT and shadow is not None:
                    data[start:end] = nominal_limit(axis, shadow, number, words)
                else:
                    data[start:end] = axis.nominal_words(field, words, readback)
        except RegisterRangeError:
            return exception_pdu(reply[0], ExceptionCode.SERVER_DEVICE_FAILURE)
        if self._hits.bits:
            note_bits(self._hits.bits, data[2:], NOBODY, exchange.sent_ns)
        return bytes(data)


class WriteWay(Way):
    """Writes of one whole target, in a frame that may hold other words beside it."""

    __slots__ = (
        "_asks_for_bits",
        "_axis",
        "_echo",
        "_end",
        "_hold",
        "_pack",
        "_place",
        "_scale",
        "_shadow",
        "_start",
        "_terms",
        "_unpack",
    )

    def __init__(self, pdu: bytes, place: Place) -> None:
        unit, access, hit = place
        super().__init__(len(pdu), unit.axes)
        assert hit.place.shadow is not None
        self._place = place
        self._axis = hit.place.axis
        self._hold = self._axis.hold
        self._terms = self._axis.terms
        self._shadow = hit.place.shadow
        codec = hit.place.field.codec
        self._pack, self._unpack, self._scale = codec.pack, codec.unpack, hit.place.field.scale
        self._start = access.data_offset + 2 * hit.word
        self._end = self._start + 2 * hit.place.field.words
        self._echo = pdu[:5]
        self._asks_for_bits = unit.asks_for_bits

    def sent(self, exchange: Exchange, now_ns: int) -> bytes | None:
        """See ``Way``."""
        axis, shadow, pdu = self._axis, self._shadow, exchange.pdu
        compensation = axis.compensation
        port = exchange.port
        if port is None or (port.writer != self._hold.writer and not self._hold.is_shared):
            return None  # another one moved it last, or nobody
        if not compensation.is_steady or len(pdu) != self._size or not self._is_usual(now_ns):
            return None
        start, end = self._start, self._end
        words = pdu[start:end]
        steady = None
        corrected_counts: Counts = 0.0
        if words == shadow.nominal_words:
            if compensation.accepted is None or shadow.corrected_words is None:
                return None
            if shadow is not axis.last_shadow:
                return None  # another register of the axis was written since: this is a target
            corrected_words = shadow.corrected_words
        else:
            if self._terms is not None and self._terms.is_due(now_ns):
                return None
            raw = self._unpack(words, 0)
            nominal_counts = raw if self._scale == 1.0 else raw * self._scale
            steady = compensation.plan_steady(nominal_counts, now_ns, axis.arrival.stage is ARRIVED)
            if steady is None:
                return None
            raw += round(steady[1] / self._scale)
            try:
                corrected_words = self._pack(raw)
            except RegisterRangeError:
                return None
            corrected_counts = raw if self._scale == 1.0 else raw * self._scale
        exchange.draft = (self._place, words, corrected_words, corrected_counts, shadow.losses, steady)
        memory = axis.memory
        if memory is not None:
            memory.sending(exchange.drafted())
        return pdu[:start] + corrected_words + pdu[end:]

    def left(self, exchange: Exchange) -> None:
        """See ``Way``."""
        assert exchange.port is not None
        self._hold.writer = exchange.port.writer
        self._hold.last_ns = exchange.sent_ns

    def _is_usual(self, now_ns: int) -> bool:
        """Whether nothing has happened that must be looked at before the next target."""
        axis = self._axis
        for each in self.axes:
            if each.silent_since_ns is not None or each.is_recalling:
                return False
        if not axis.compensation.is_stream and axis.has_branches and axis.is_unseen(now_ns):
            return False
        if axis.unproven is not None or axis.arrival.stage is MAY_HAVE_LEFT or self._shadow.is_torn:
            return False
        return not (self._asks_for_bits and axis.needs_reference(now_ns, is_target=True))

    def answered(self, exchange: Exchange, reply: bytes, now_ns: int) -> bytes | None:
        """See ``Way``."""
        return reply if reply == self._echo else None

    def settle(self, exchange: Exchange, now_ns: int) -> None:
        """See ``Way``."""
        assert exchange.draft is not None
        self._axis.commit(exchange.drafted(), now_ns, exchange.draft[4])
        if self._axis.memory is not None:
            self._axis.memory.conclude()


def find_way(unit: UnitMap | None, unit_id: int, pdu: bytes) -> Way | None:
    """Return the short way of the requests to a unit id that begin as this one does; None: there is none."""
    access = ACCESS[pdu[0]](pdu) if pdu[0] in ACCESS else None
    if access is not None and not access.is_consistent:
        return None
    if unit is None:
        return None if unit_id in ANY_TCP_DRIVE else Way(len(pdu))
    if unit.has_objects:
        return None
    if access is None:
        return Way(len(pdu), unit.axes) if pdu[0] in READS_BITS and not _has_bits(unit, pdu) else None
    if access.write_quantity:
        return _write_way(unit, pdu, access)
    hits = unit.read(access.read_address, access.read_quantity)
    if not (hits.fields or hits.bits):
        return Way(len(pdu), unit.axes)
    if all(hit.is_whole and hit.place.role.is_position for hit in hits.fields):
        return ReadWay(unit, access, hits)
    return None


def _write_way(unit: UnitMap, pdu: bytes, access: Access) -> Way | None:
    hits = unit.written(access.write_address, access.write_quantity)
    if hits.rules:
        return None
    if not hits.fields:
        return Way(len(pdu), unit.axes)
    hit = hits.fields[0]
    is_target = len(hits.fields) == 1 and hit.is_whole and hit.place.role is FieldRole.COMMAND
    is_plain = not (unit.has_rules or hit.place.axis.is_shadow or hit.place.field.type.is_float)
    is_block = pdu[0] == FunctionCode.WRITE_MULTIPLE_REGISTERS
    return WriteWay(pdu, Place(unit, access, hit)) if is_target and is_plain and is_block else None


def _has_bits(unit: UnitMap, pdu: bytes) -> bool:
    table = BitTable.COIL if pdu[0] == FunctionCode.READ_COILS else BitTable.INPUT
    address, quantity = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
    return bool(unit.read_bits(table, address, quantity))


def _read(hit: FieldHit) -> _Read:
    axis, role, number, field, shadow = hit.place
    start = 2 + 2 * hit.word
    is_first_actual = role is FieldRole.ACTUAL and number == 0
    return _Read(axis, role, is_first_actual, number, shadow, field, start, start + 2 * field.words)
