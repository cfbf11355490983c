"""The way to the drives, at the level of bytes: framed, delayed, lost, garbled, split, answered late."""

import random

from gateway.exchange.line import LineExchange
from gateway.exchange.ports import DriveLink
from gateway.exchange.transaction import Stopping
from gateway.modbus.mbap import MbapDecoder, encode_mbap
from gateway.modbus.rtu import RtuReplyDecoder, encode_rtu
from tests.ledger.clock import MS, Clock
from tests.ledger.drives import Drive
from tests.ledger.exchanges import Frame
from tests.ledger.faults import EXCEPTION_CODES, IS_DONE, OF_WHAT_MAY_BE_DONE, Fault, choose, stale_reply
from tests.ledger.frames import mbap, open_mbap, open_rtu, rtu
from tests.ledger.ledger import Ledger
from tests.ledger.stillness import Stillness

TIMEOUT_MS = 150.0
DRAIN_MS = 80.0
ON_TCP = {Fault.REQUEST_GARBLED: Fault.REQUEST_LOST, Fault.REPLY_GARBLED: Fault.REPLY_LOST}
"""TCP garbles nothing."""


class Wire(DriveLink):
    """A drive link for the gateway, with the drives behind it."""

    speaks_rtu = True

    def __init__(
        self,
        clock: Clock,
        ledger: Ledger,
        drives: dict[int, Drive],
        rng: random.Random,
        fault_share: float,
        *,
        stillness: Stillness,
    ) -> None:
        super().__init__(is_serial=self.speaks_rtu)
        self._clock, self._ledger, self._drives, self._rng = clock, ledger, drives, rng
        self._alone = next(iter(drives.values())) if len(drives) == 1 else None
        """Does not look at unit ids."""
        self._stillness = stillness
        self._fault_share = fault_share
        self._taken_ns = 0
        self.line: LineExchange | None = None
        self.gap_ns = 0
        """The silence that it needs before each frame."""
        self._heard_for: Frame | None = None
        """The frame that the bytes on their way in answer."""
        self._connection = 0
        self._is_open = False
        self._begin()

    def _begin(self) -> None:
        """Make what one framing needs beside all that."""
        raise NotImplementedError

    def open(self) -> None:
        assert self.line is not None
        self._is_open = True
        self._connection += 1
        self._ledger.is_down = False
        self._begin_silence()
        self.line.link_up(self._clock.now_ns)

    def _begin_silence(self) -> None:
        """A frame leaves, or bytes came: the next frame waits."""
        if self.gap_ns:
            self.stamps.next_ns = self._clock.now_ns + self.gap_ns

    def drop(self) -> None:
        """Lose the connection: what is on its way to a drive arrives, what comes back does not."""
        assert self.line is not None
        self._is_open = False
        self._reset()
        self._ledger.dropping()
        self.line.link_down(self._clock.now_ns)
        self._ledger.acted()

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        frame, fault = self._accounted(unit_id, pdu)
        self._put(self._framed(unit_id, pdu), frame, fault)

    def _accounted(self, unit_id: int, pdu: bytes) -> tuple[Frame, Fault]:
        """Have a frame judged that goes out, and choose what happens to it."""
        current = None if self.line is None else self.line._transactions.current
        is_early = current is not None and current.stopping is Stopping.EARLY
        frame = self._ledger.sent(unit_id, pdu, is_early=is_early)
        if self._clock.now_ns < self.stamps.next_ns:
            self._ledger.book.violation("W1-no-silence", pdu.hex(" "), self._ledger.witness(unit_id).journal)
        self._begin_silence()
        frame.connection = self._connection
        drive = self._drive(unit_id)
        fault = choose(
            self._rng, self._fault_share, exception_writes_nothing=drive.layout.exception_writes_nothing
        )
        if not self.is_serial:
            fault = ON_TCP.get(fault, fault)
        if fault is not Fault.NONE:
            self._ledger.book.seen[f"fault: {fault.value}"] += 1
            self._ledger.witness(unit_id).journal.note(f"fault: {fault.value}")
        return frame, fault

    def _put(self, data: bytes, frame: Frame, fault: Fault, ended_ns: int = 0) -> None:
        """A frame goes to its drive, which hears its last byte at ``ended_ns``, or now."""
        if fault is Fault.REQUEST_LOST:
            return
        if fault is Fault.REQUEST_GARBLED:
            data = self._garbled(data)
        taken_ns = max(ended_ns, self._clock.now_ns) + int(self._rng.uniform(0.3, 2.0) * MS)
        if fault is Fault.LATE_BOTH:
            taken_ns += int(self._rng.uniform(0.5, 1.2) * TIMEOUT_MS * MS)
        self._taken_ns = max(self._taken_ns, taken_ns)
        self._clock.at(self._taken_ns, lambda: self._taken(data, frame, fault))

    def _drive(self, unit_id: int) -> Drive:
        drive = self._drives.get(unit_id, self._alone)
        assert drive is not None
        return drive

    def _taken(self, data: bytes, frame: Frame, fault: Fault) -> None:
        opened = self._opened(data)
        if opened is None:
            return
        key, unit_id, pdu = opened
        if fault in IS_DONE or fault is Fault.NONE:
            reply, operations = self._drive(unit_id).execute(pdu, self._clock.now_ns)
            self._ledger.did(frame, operations)
        else:
            reply = pdu[:5]
        if fault in (Fault.REFUSED, Fault.REFUSED_DONE):
            codes = EXCEPTION_CODES if fault is Fault.REFUSED else OF_WHAT_MAY_BE_DONE
            reply = bytes((pdu[0] | 0x80, self._rng.choice(codes)))
        elif fault in (Fault.STALE, Fault.STALE_NOT_DONE):
            stale = stale_reply(pdu, reply, self._rng)
            if stale is None and fault is Fault.STALE_NOT_DONE:
                return
            reply = stale or reply
        if fault is not Fault.REPLY_LOST:
            self._answer(key, frame, reply, fault)

    def _answer(self, key: int, frame: Frame, reply: bytes, fault: Fault) -> None:
        delay_ms = self._rng.uniform(0.3, 4.0)
        if fault is Fault.DELAYED:
            delay_ms = self._rng.uniform(0.2, 0.9) * TIMEOUT_MS
        elif fault is Fault.LATE:
            delay_ms = TIMEOUT_MS + self._rng.uniform(0.1, 0.7) * DRAIN_MS
        data = self._framed_reply(key, frame.unit, reply)
        if fault is Fault.REPLY_GARBLED:
            data = self._garbled(data)
        self._send_back(data, frame, self._clock.now_ns + int(delay_ms * MS))

    def _send_back(self, data: bytes, frame: Frame, at_ns: int) -> None:
        """The reply to a frame begins to come in."""
        if self._rng.random() < 0.1 and len(data) > 4:
            cut = self._rng.randrange(1, len(data))
            self._clock.at(at_ns, lambda: self._heard(data[:cut], frame))
            # Other replies of a TCP drive may come at any time, but never in the middle of this one.
            pause_ms = 0.4 if self.is_serial else 0.0
            self._clock.at(at_ns + int(pause_ms * MS), lambda: self._heard(data[cut:], frame))
        else:
            self._clock.at(at_ns, lambda: self._heard(data, frame))

    def _heard(self, data: bytes, frame: Frame) -> None:
        self._stillness.reaches(self, lambda: self._read(data, frame))

    def _read(self, data: bytes, frame: Frame) -> None:
        if frame.connection == self._connection and self._is_open:
            self._heard_for = frame
            self._begin_silence()
            self._received(data)

    def _garbled(self, data: bytes) -> bytes:
        index = self._rng.randrange(len(data))
        return data[:index] + bytes((data[index] ^ 1 << self._rng.randrange(8),)) + data[index + 1 :]

    def _deliver(self, unit_id: int, pdu: bytes) -> None:
        assert self.line is not None
        self._ledger.delivering(pdu, self._heard_for)
        self.line.reply(unit_id, pdu, self._clock.now_ns)
        self._ledger.delivered()

    def abandon(self) -> None:
        self._ledger.abandoned()

    def _reset(self) -> None:
        raise NotImplementedError

    def _framed(self, unit_id: int, pdu: bytes) -> bytes:
        raise NotImplementedError

    def _opened(self, data: bytes) -> tuple[int, int, bytes] | None:
        raise NotImplementedError

    def _framed_reply(self, key: int, unit_id: int, reply: bytes) -> bytes:
        raise NotImplementedError

    def _received(self, data: bytes) -> None:
        raise NotImplementedError


class RtuWire(Wire):
    """RTU on a serial bus."""

    speaks_rtu = True

    def _begin(self) -> None:
        self._decoder = RtuReplyDecoder()

    def _reset(self) -> None:
        self._decoder.reset()

    def _framed(self, unit_id: int, pdu: bytes) -> bytes:
        self._decoder.expect(unit_id, pdu)
        return encode_rtu(unit_id, pdu)

    def _opened(self, data: bytes) -> tuple[int, int, bytes] | None:
        opened = open_rtu(data)
        return None if opened is None else (0, *opened)

    def _framed_reply(self, key: int, unit_id: int, reply: bytes) -> bytes:
        return rtu(unit_id, reply)

    def abandon(self) -> None:
        super().abandon()
        self._decoder.cancel()

    def _received(self, data: bytes) -> None:
        assert self.line is not None
        counters, now_ns = self._decoder.counters, self._clock.now_ns
        stray_bytes, frames = counters.stray_bytes, counters.stray_frames + counters.foreign
        replies = self._decoder.feed(data, now_ns)
        is_frame = counters.stray_frames + counters.foreign != frames
        if is_frame or counters.stray_bytes != stray_bytes:
            self.line.stray(now_ns, unit_id=self._decoder.late_unit_id if is_frame else -1)
        self._pass_on(replies)

    def _pass_on(self, replies: list[tuple[int, bytes]]) -> None:
        if self._decoder.deadline_ns is not None:
            self._clock.at(self._decoder.deadline_ns, lambda: self._stillness.reaches(self, self._silent))
        for unit_id, pdu in replies:
            self._deliver(unit_id, pdu)

    def _silent(self) -> None:
        replies = self._decoder.on_silence(self._clock.now_ns)
        if replies or self._decoder.deadline_ns is not None:
            self._pass_on(replies)


class TcpWire(Wire):
    """Modbus/TCP: transaction ids of the gateway's own; late replies carry an old one."""

    speaks_rtu = False

    def _begin(self) -> None:
        self._decoder = MbapDecoder()
        self._last_id = self._rng.randrange(0x10000)
        self._awaited: int | None = None

    def _reset(self) -> None:
        self._decoder = MbapDecoder()
        self._awaited = None

    def _framed(self, unit_id: int, pdu: bytes) -> bytes:
        self._last_id = (self._last_id + 1) & 0xFFFF
        self._awaited = self._last_id
        return encode_mbap(self._last_id, unit_id, pdu)

    def _opened(self, data: bytes) -> tuple[int, int, bytes] | None:
        return open_mbap(data)

    def _framed_reply(self, key: int, unit_id: int, reply: bytes) -> bytes:
        return mbap(key, unit_id, reply)

    def abandon(self) -> None:
        super().abandon()
        self._awaited = None

    def _received(self, data: bytes) -> None:
        assert self.line is not None
        for transaction_id, unit_id, pdu in self._decoder.feed(data):
            if transaction_id == self._awaited:
                self._awaited = None
                self._deliver(unit_id, pdu)
            else:
                self._ledger.book.seen["late replies"] += 1
                self.line.stray(self._clock.now_ns)
