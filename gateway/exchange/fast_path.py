"""The fast path: most frames need no decision, and are sent after a lookup or after one correction.

The head of a request names the registers that it touches. A path is found once for a unit id and a head, and
is then cached. A path decides nothing: it holds prepared lookups, handles the usual case only, and calls the
same transitions as the slow path. If anything is unusual it returns None. The request or reply then takes the
slow path (``dispatch``, ``prepare``, ``transaction``), which handles every case. Both give the same bytes and
leave the same state; tests/exchange/test_fast_path.py compares them.
"""

from typing import Final, NamedTuple

from gateway.exchange.access import ACCESS, Access
from gateway.exchange.aliases import ANY_TCP_DRIVE
from gateway.exchange.axis.acknowledge import Rendering, SteadyTarget
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.motion import MAY_BE_ELSEWHERE, MotionState
from gateway.exchange.decode import DecodedRequest, Part, decode
from gateway.exchange.field_counts import nearest
from gateway.exchange.plan import writes_alone
from gateway.exchange.ports import ControllerPort
from gateway.exchange.render import nominal_limit
from gateway.exchange.reply import READS_BITS, nominal_command, nominal_position, observe_bits
from gateway.exchange.request import NOTHING_PREFETCHED, Request
from gateway.exchange.transaction import FastPath, Transaction
from gateway.exchange.unit import FieldHit, FieldRole, Hits, UnitMap
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.pdu import ExceptionCode, FunctionCode, exception_pdu
from gateway.modbus.registers import BitTable, PositionField
from gateway.modbus.words import Integer

ARRIVED: Final = MotionState.ARRIVED

LOWEST: Final = b"\x00"
HIGHEST: Final = b"\xff"
"""Together with LOWEST, the range of the last byte of a position of which all others have come."""
NO_AXES: Final[frozenset[str]] = frozenset()
"""Names of the axes that a read moves: none."""


class _Read(NamedTuple):
    """A position inside a reply: where its bytes are."""

    axis: Axis
    role: FieldRole
    is_first_actual: bool
    number: int
    field: PositionField
    start: int
    end: int


class ReadPath(FastPath):
    """Reads of complete positions and status bits."""

    __slots__ = ("_access", "_asks_for_bits", "_hits", "_reads", "_unit", "_watched")

    def __init__(self, unit: UnitMap, access: Access, hits: Hits) -> None:
        super().__init__(5, unit.axes)
        self._unit = unit
        self._access = access
        self._hits = hits
        self._asks_for_bits = unit.asks_for_bits
        self._watched = tuple([(axis.reach, axis.recall, axis.member) for axis in unit.axes])
        self._reads = tuple(_read(hit) for hit in hits.fields if hit.mapped.role.is_position)

    def sent(self, transaction: Transaction, now_ns: int) -> bytes | None:
        """See ``FastPath``."""
        for reach, recall, member in self._watched:
            record = recall.record
            if reach.silent_since_ns is not None or (record is not None and record.saved is not None):
                return None
            if member.fixed is not None:
                return None  # the decision of the group may have ended by now
        if self._asks_for_bits:
            for read in self._reads:
                if read.axis.needs_reference(now_ns, is_target=False):
                    return None
        readbacks = [
            None if read.axis.reads_unchanged else read.axis.compensation.readback for read in self._reads
        ]
        transaction.readbacks = readbacks
        return transaction.pdu

    def answered(self, transaction: Transaction, reply: bytes, now_ns: int) -> bytes | None:
        """See ``FastPath``."""
        if reply[0] != transaction.pdu[0] or len(reply) != 2 + 2 * self._access.read_quantity:
            return reply
        if reply[1] != len(reply) - 2:
            return reply
        data = bytearray(reply)
        try:
            for read, readback in zip(self._reads, transaction.readbacks, strict=True):
                axis, role, is_first_actual, number, field, start, end = read
                words = reply[start:end]
                if is_first_actual:
                    axis.observe_actual(field, words, transaction.sent_ns)  # as old as its request
                if readback is None:
                    continue
                if role is FieldRole.COMMAND:
                    data[start:end] = nominal_command(axis, number, field, words, readback)
                elif role is FieldRole.LIMIT:
                    data[start:end] = nominal_limit(axis, number, words)
                else:
                    data[start:end] = nominal_position(axis, field, words, readback)
        except RegisterRangeError:
            return exception_pdu(reply[0], ExceptionCode.SERVER_DEVICE_FAILURE)
        if self._hits.bits:
            observe_bits(self._hits.bits, data[2:], NO_AXES, transaction.sent_ns)
        return bytes(data)

    @property
    def quantity(self) -> int:
        """Number of registers that it reads."""
        return self._access.read_quantity

    @property
    def byte_ranges(self) -> tuple[tuple[int, int], ...]:
        """Where each position begins and ends in the PDU of a reply."""
        return tuple((read.start, read.end) for read in self._reads)

    @property
    def is_sure(self) -> bool:
        """Whether no position in the reply can prove something that changes how it is converted back."""
        for read in self._reads:
            record = read.axis.recall.record
            if read.axis.motion.unacknowledged is not None:
                return False
            if record is not None and record.saved is not None:
                return False
        return True

    def nominal_words(self, transaction: Transaction, which: int, words: bytes) -> bytes | None:
        """Return the words of one position as ``answered`` would convert them; None: not decided yet.

        It changes nothing.
        """
        if not self.is_sure:
            return None
        axis, role, _, number, field, _, _ = self._reads[which]
        readback = transaction.readbacks[which]
        if readback is None:
            return words
        try:
            if role is FieldRole.LIMIT:
                return nominal_limit(axis, number, words)
            meant = axis.fields[number].means(words) if role is FieldRole.COMMAND else None
            return meant or nominal_position(axis, field, words, readback)
        except RegisterRangeError:
            return None

    def is_early(self, which: int) -> bool:
        """Whether all bytes but the last may decide the first byte of a position.

        Not for a limit: 0 passes unchanged.
        """
        read = self._reads[which]
        return read.field.is_high_first_pair and read.role is not FieldRole.LIMIT

    def begins_with(self, byte: int, transaction: Transaction, which: int, begun: bytes) -> bool:
        """Whether :meth:`nominal_words` begins with this byte, whatever the last byte after ``begun`` is.

        Conversion keeps the order of positions, so checking both ends is enough. A command may also be
        recognised by its words, so that is checked too.
        """
        axis, role, _, number, _, _, _ = self._reads[which]
        candidates = [begun + LOWEST, begun + HIGHEST]
        if role is FieldRole.COMMAND:
            there = axis.fields[number].corrected_words
            if there is not None and there.startswith(begun):
                candidates.append(there)
        for words in candidates:
            nominal_words = self.nominal_words(transaction, which, words)
            if nominal_words is None or nominal_words[0] != byte:
                return False
        return True


class WritePath(FastPath):
    """Writes of one complete target, in a frame that may hold other words too."""

    __slots__ = (
        "_access",
        "_asks_for_bits",
        "_axis",
        "_codec",
        "_correction",
        "_echo",
        "_end",
        "_head",
        "_hold",
        "_image",
        "_is_last",
        "_number",
        "_recall",
        "_scale",
        "_start",
        "_targets",
        "_terms",
        "_unit",
        "_watched",
        "is_early",
    )

    def __init__(self, pdu: bytes, unit: UnitMap, access: Access, hit: FieldHit) -> None:
        super().__init__(len(pdu), unit.axes)
        assert hit.mapped.image is not None
        self._unit, self._access = unit, access
        self._axis = hit.mapped.axis
        self._hold, self._targets = self._axis.hold, self._axis.targets
        self._recall = self._axis.recall
        self._watched = tuple([(axis.reach, axis.recall) for axis in unit.axes])
        self._correction, self._terms = self._axis.correction, self._axis.correction.terms
        self._image = hit.mapped.image
        self._number = hit.mapped.number
        codec = hit.mapped.field.codec
        assert isinstance(codec, Integer), "a path is found for whole numbers only"
        self._codec, self._scale = codec, hit.mapped.field.scale
        self._start = access.data_offset + 2 * hit.word
        self._end = self._start + 2 * hit.mapped.field.words
        self._is_last = self._start == access.data_offset and self._end == len(pdu)
        """The frame writes the target only; otherwise it holds other words too."""
        self._head = pdu[: access.data_offset]
        """Common beginning of all requests on this path."""
        self._echo = pdu[:5]
        self._asks_for_bits = unit.asks_for_bits
        is_first = self._start == access.data_offset
        is_alone = writes_alone((axis.plan for axis in unit.axes), hit.mapped.field)
        self.is_early = is_first and is_alone and hit.mapped.field.is_high_first_pair
        """Whether it may be sent from the first byte of its address on, and its position from its last byte
        but one on: see ``cut_through.delay.write_shape``."""

    def sent(self, transaction: Transaction, now_ns: int) -> bytes | None:
        """See ``FastPath``."""
        pdu = transaction.pdu
        if len(pdu) != self._size:
            return None
        start, end = self._start, self._end
        target = self.judged(transaction.port, pdu[start:end], now_ns)
        if target is None:
            return None
        self.write_ahead(transaction, target)
        words = target.corrected_words
        return self._head + words if self._is_last else pdu[:start] + words + pdu[end:]

    def write_ahead(self, transaction: Transaction, target: SteadyTarget) -> None:
        """A target is sent next: record what must survive a kill."""
        axis = self._axis
        transaction.path, transaction.target = self, target
        if self._recall.record is not None and not axis.send_steady(target):
            axis.send_target(transaction.rendering())

    def is_ready(self, port: ControllerPort | None, now_ns: int) -> bool:
        """Whether only the words of a target can still keep it from this path."""
        axis = self._axis
        if port is None or (port.writer != self._hold.writer and not self._hold.is_shared):
            return False  # another writer moved the axis last, or no writer has
        if not axis.compensation.is_steady:
            return False
        # After any of these, the slow path checks the next target.
        for reach, recall in self._watched:
            record = recall.record
            if reach.silent_since_ns is not None or (record is not None and record.saved is not None):
                return False
        motion = axis.motion
        if not axis.compensation.is_stream and self._correction.has_branches and motion.is_unseen(now_ns):
            return False
        if motion.unacknowledged is not None or motion.state in MAY_BE_ELSEWHERE or self._image.is_incomplete:
            return False
        return not (self._asks_for_bits and axis.needs_reference(now_ns, is_target=True))

    @property
    def byte_range(self) -> tuple[int, int]:
        """Where the position begins and ends in the PDU."""
        return self._start, self._end

    @property
    def echo(self) -> bytes:
        """The reply with which a drive acknowledges it."""
        return self._echo

    def judged(self, port: ControllerPort | None, words: bytes, now_ns: int) -> SteadyTarget | None:
        """Return the target for these words as it would be sent now; None: it takes the slow path.

        It changes nothing. Called again with the same time it returns the same, unless something has happened
        to the axis in between.
        """
        axis, image = self._axis, self._image
        compensation = axis.compensation
        if not self.is_ready(port, now_ns):
            return None
        if words == image.nominal_words:
            if compensation.accepted is None or image.corrected_words is None:
                return None
            if self._number != axis.motion.last_number:
                return None  # another register of the axis was written since: this is a new target
            return SteadyTarget(words, image.corrected_words, 0.0, image.epoch, None)
        if self._terms is not None and self._terms.is_due(now_ns):
            return None
        raw = self._codec.unpack(words, 0)
        nominal_counts = raw if self._scale == 1.0 else raw * self._scale
        steady = compensation.plan_steady(nominal_counts, now_ns, axis.motion.state is ARRIVED)
        if steady is None:
            return None
        raw += nearest(steady.correction_counts / self._scale)
        try:
            corrected_words = self._codec.pack(raw)
        except RegisterRangeError:
            return None
        corrected_counts = raw if self._scale == 1.0 else raw * self._scale
        return SteadyTarget(words, corrected_words, corrected_counts, image.epoch, steady)

    def begins_with(self, byte: int, port: ControllerPort | None, begun: bytes, now_ns: int) -> bool:
        """Whether the words that :meth:`judged` sends, if any, begin with this byte.

        The last byte after ``begun`` may have any value. Correction keeps the order of targets, so checking
        both ends is enough. A repeated target gets the same words as before, so that is checked too.
        """
        image = self._image
        if not self.is_ready(port, now_ns) or (self._terms is not None and self._terms.is_due(now_ns)):
            return False
        if image.nominal_words is not None and image.nominal_words.startswith(begun):
            there = image.corrected_words
            if there is None or there[0] != byte:
                return False
        for last in (LOWEST, HIGHEST):
            raw = self._codec.unpack(begun + last, 0)
            counts = self._axis.compensation.steady_correction(raw * self._scale)
            try:
                words = self._codec.pack(raw + nearest(counts / self._scale))
            except RegisterRangeError:
                return False
            if words[0] != byte:
                return False
        return True

    def left(self, transaction: Transaction) -> None:
        """See ``FastPath``."""
        assert transaction.port is not None
        self._hold.move(transaction.port.writer, transaction.sent_ns)

    def answered(self, transaction: Transaction, reply: bytes, now_ns: int) -> bytes | None:
        """See ``FastPath``."""
        return reply if reply == self._echo else None

    def settle(self, transaction: Transaction, now_ns: int) -> None:
        """See ``FastPath``."""
        assert transaction.target is not None
        self._targets.acknowledge_steady(self._number, transaction.target, now_ns)
        if self._recall.record is not None:
            self._axis.acknowledgement.conclude(self._axis.motion.unacknowledged)

    def rendering(self, transaction: Transaction) -> Rendering:
        """See ``FastPath``."""
        assert transaction.target is not None
        target, steady = transaction.target, transaction.target.steady
        move = None if steady is None else self._axis.compensation.move_of(steady)
        return Rendering(
            self._number, target.nominal_words, target.corrected_words, target.corrected_counts, move
        )

    def request(self, transaction: Transaction) -> Request:
        """See ``FastPath``."""
        assert transaction.target is not None
        rendering = transaction.rendering()
        self._axis.acknowledgement.name(rendering)
        pdu, words = transaction.pdu, rendering.corrected_words
        frame = DecodedRequest(self._unit, pdu, self._access, {})
        sent_ns, arrived_ns = transaction.sent_ns, transaction.arrived_ns
        request = Request(frame, decode(frame), NOTHING_PREFETCHED, sent_ns, arrived_ns=arrived_ns)
        request.send_instead(pdu[: self._start] + words + pdu[self._end :])
        command = request.of(self._axis)
        command.targets.append(rendering)
        command.parts.append(Part(self._image, -1, b""))
        command.epochs[self._number] = transaction.target.epoch
        return request


def find_path(unit: UnitMap | None, unit_id: int, pdu: bytes) -> FastPath | None:
    """Return the fast path of the requests to a unit id with this beginning; None: there is none."""
    access = ACCESS[pdu[0]](pdu) if pdu[0] in ACCESS else None
    if access is not None and not access.is_consistent:
        return None
    if unit is None:
        return None if unit_id in ANY_TCP_DRIVE else FastPath(len(pdu))
    if unit.has_objects:
        return None
    if access is None:
        return FastPath(len(pdu), unit.axes) if pdu[0] in READS_BITS and not _has_bits(unit, pdu) else None
    if access.write_quantity:
        return _write_path(unit, pdu, access)
    hits = unit.read(access.read_address, access.read_quantity)
    if not (hits.fields or hits.bits):
        return FastPath(len(pdu), unit.axes)
    if all(hit.is_whole and hit.mapped.role.is_position for hit in hits.fields):
        return ReadPath(unit, access, hits)
    return None


def _write_path(unit: UnitMap, pdu: bytes, access: Access) -> FastPath | None:
    hits = unit.written(access.write_address, access.write_quantity)
    if hits.rules:
        return None
    if not hits.fields:
        return FastPath(len(pdu), unit.axes)
    hit = hits.fields[0]
    is_target = len(hits.fields) == 1 and hit.is_whole and hit.mapped.role is FieldRole.COMMAND
    is_plain = not (unit.has_rules or hit.mapped.axis.correction.is_dry_run or hit.mapped.field.type.is_float)
    is_block = pdu[0] == FunctionCode.WRITE_MULTIPLE_REGISTERS
    return WritePath(pdu, unit, access, hit) if is_target and is_plain and is_block else None


def _has_bits(unit: UnitMap, pdu: bytes) -> bool:
    table = BitTable.COIL if pdu[0] == FunctionCode.READ_COILS else BitTable.INPUT
    address, quantity = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
    return bool(unit.read_bits(table, address, quantity))


def _read(hit: FieldHit) -> _Read:
    axis, role, number, field, _ = hit.mapped
    start = 2 + 2 * hit.word
    is_first_actual = role is FieldRole.ACTUAL and number == 0
    return _Read(axis, role, is_first_actual, number, field, start, start + 2 * field.words)
