"""A line between two serial wires in simulated time: a controller, the gateway's exchange, a drive.

Exchange, decoders and forwarders are the real ones; wires, adapters and the drive's ear are the simulator's.
Time is a number, so that a million exchanges need no machine with a million exchanges' patience.

    python -m bench.cut_line --baudrate 9600 --count 10000 --jitter 0.1
    python -m bench.cut_line --baudrate 9600 --count 10000 --damage 0.5 --hearing merging
"""

import argparse
import json
import sys
from collections import Counter
from dataclasses import dataclass, field, replace
from random import Random
from statistics import median
from typing import Final

from bench.hot_path import COMMAND, plan_of_x
from gateway.exchange.cut_through.delay import CRC_BYTES
from gateway.exchange.cut_through.forward import Forwarder, SerialTiming
from gateway.exchange.cut_through.frame import ForwardEvent
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import ControllerPlan, LineTiming
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.modbus.crc import append_crc, is_intact
from gateway.modbus.registers import PositionField, RegisterType
from gateway.modbus.rtu import RtuReplyDecoder, RtuRequestDecoder, encode_rtu
from gateway.modbus.rtu_line import silence_ns
from gateway.simulator.ears import Hearing, Uart, ends_ns
from gateway.simulator.wire import AT_ONCE, Adapter, PacedWire
from gateway.times import NS_PER_MS, NS_PER_S

BITS: Final = 11
ACTUAL: Final = PositionField(0x6301, RegisterType.INT32)
TRAVEL_COUNTS: Final = 900_000
STEP_COUNTS: Final = 40
"""From one setpoint to the next; a stream turns at the ends of its travel."""
WRITE_HEAD: Final = bytes((1, 16)) + COMMAND.address.to_bytes(2, "big") + b"\x00\x02\x04"
ACKNOWLEDGEMENT: Final = append_crc(WRITE_HEAD[:6])
READ: Final = append_crc(bytes((1, 3)) + ACTUAL.address.to_bytes(2, "big") + b"\x00\x03")
"""Position and status."""
READ_REPLY_BYTES: Final = 11
GIVEN_UP_CHARACTERS: Final = 120


@dataclass(frozen=True)
class Way:
    """What lies between the controller and the drive."""

    baudrate: int
    drives_baudrate: int = 0
    """0: the same."""
    cuts: bool = True
    adapter: Adapter = AT_ONCE
    """Of both ports of the gateway."""
    late_ms: float = 0.0
    """Timers of the gateway ring up to so much late."""
    hearing: Hearing = Hearing.STANDARD
    seed: int = 1

    @property
    def out_baudrate(self) -> int:
        """Of the drives' wire."""
        return self.drives_baudrate or self.baudrate


@dataclass
class Found:
    """What was seen."""

    write_ns: list[int] = field(default_factory=list)
    """From the first bit of a request to the last of its reply."""
    read_ns: list[int] = field(default_factory=list)
    unanswered: int = 0
    damaged: int = 0
    torn: int = 0
    """Frames inside of which the transmitter was empty."""
    foreign: int = 0
    """Frames that the drive took and the gateway had not sent."""
    forged: int = 0
    """Damaged requests of which the gateway made a good one."""
    broken: int = 0
    """Frames that the drive broke off for a pause."""


class _Sender:
    """A port of the gateway as it writes: each frame behind a silence, pieces as they come."""

    def __init__(self, wire: PacedWire, silence: int, char_ns: int) -> None:
        self.wire = wire
        self.char_ns = char_ns
        self._silence = silence
        self.quiet_ns = -silence
        self._held: list[bytes] = []

    @property
    def deadline_ns(self) -> int | None:
        return self.quiet_ns + self._silence if self._held else None

    def may_begin(self, now_ns: int) -> bool:
        return not self._held and now_ns >= self.quiet_ns + self._silence

    def send(self, frame: bytes, now_ns: int) -> None:
        if self.may_begin(now_ns):
            self.add(frame, now_ns)
        else:
            self._held.append(frame)

    def tick(self, now_ns: int) -> None:
        if self._held and now_ns >= self.quiet_ns + self._silence:
            self.add(self._held.pop(0), now_ns)

    def add(self, data: bytes, now_ns: int) -> None:
        self.wire.send(data, now_ns)
        self.quiet_ns = max(self.quiet_ns, now_ns) + len(data) * self.char_ns


class _Port(ControllerPort):
    def __init__(self, line: "SimulatedLine", sender: _Sender) -> None:
        super().__init__(ControllerPlan("cnc", serial=True))
        self._line = line
        self.sender = sender

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        self.sender.send(encode_rtu(unit_id, pdu), self._line.now_ns)

    def may_forward(self, now_ns: int) -> bool:
        return self.sender.may_begin(now_ns)

    def forward(self, piece: bytes) -> None:
        self.sender.add(piece, self._line.now_ns)

    def forward_last(self, transaction_id: int, unit_id: int, pdu: bytes, rest: bytes) -> None:
        self.sender.add(rest, self._line.now_ns)


class _Link(DriveLink):
    def __init__(self, line: "SimulatedLine", sender: _Sender, decoder: RtuReplyDecoder) -> None:
        super().__init__(is_serial=True)
        self._line = line
        self.sender = sender
        self.decoder = decoder
        self.sent: list[bytes] = []
        """Frames that left with a good check sum and that the drive has not taken yet."""
        self.commits = 0
        """How many they were."""

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        frame = encode_rtu(unit_id, pdu)
        self.sent.append(frame)
        self.commits += 1
        self.decoder.expect(unit_id, pdu)
        self.sender.send(frame, self._line.now_ns)

    def abandon(self) -> None:
        self.decoder.cancel()

    def may_forward(self, now_ns: int) -> bool:
        return self.sender.may_begin(now_ns)

    def forward(self, piece: bytes) -> None:
        self.sender.add(piece, self._line.now_ns)

    def forward_last(self, unit_id: int, pdu: bytes, rest: bytes) -> None:
        self.sent.append(encode_rtu(unit_id, pdu))
        self.commits += 1
        self.decoder.expect(unit_id, pdu)
        self.sender.add(rest, self._line.now_ns)


class SimulatedLine:
    """All of it; :meth:`exchange` lets the controller ask for something, and time pass until it has it."""

    def __init__(self, way: Way) -> None:
        self.way = way
        self.now_ns = NS_PER_S
        self.found = Found()
        self.events: Counter[str] = Counter()
        self.rng = Random(way.seed)
        char_ns = [round(BITS * NS_PER_S / baudrate) for baudrate in (way.baudrate, way.out_baudrate)]
        silences = [silence_ns(baudrate) for baudrate in (way.baudrate, way.out_baudrate)]
        self.char_ns, self.silence_ns = char_ns[0], silences[0]
        self.asking = PacedWire(way.baudrate, adapter=replace(way.adapter, seed=way.seed))
        self.told = PacedWire(way.baudrate)
        self.out = PacedWire(way.out_baudrate)
        self.back = PacedWire(way.out_baudrate, adapter=replace(way.adapter, seed=way.seed + 1))
        self.uart = Uart(way.hearing, way.out_baudrate)
        self.port = _Port(self, _Sender(self.told, silences[0], char_ns[0]))
        self.requests = RtuRequestDecoder(silences[0])
        self.replies = RtuReplyDecoder(silences[1])
        self.link = _Link(self, _Sender(self.out, silences[1], char_ns[1]), self.replies)
        plan = replace(plan_of_x(), actual=(ACTUAL,))
        self.line = LineExchange(
            [plan],
            LineTiming(response_timeout_ms=500.0, drain_ms=5.0),
            self.link,
            lambda event: self.events.update((event.kind.name,)),
            cut_through=SerialTiming(char_ns[1], silences[1]) if way.cuts else None,
        )
        self.line.link_up(self.now_ns)
        forwarding = self.line.forwarding
        self.forwarder: Forwarder | None = (
            None
            if forwarding is None
            else forwarding.follow(self.port, SerialTiming(char_ns[0], silences[0]))
        )
        self._told: list[int] = []
        """When each byte of the reply was there."""
        self._heard = b""
        self._position = b"\x00\x00\x00\x00"
        self._planned: tuple[int, int] | None = None

    # --- the controller ---------------------------------------------------------------------------------

    def exchange(self, pieces: list[tuple[int, bytes]], reply_bytes: int) -> int | None:
        """Send pieces, each so long after the one before; return how long it took; None: no reply came."""
        begun_ns = self.now_ns
        self._told.clear()
        self._heard = b""
        for pause_ns, piece in pieces:
            if pause_ns:
                self._pass_to(self.now_ns + pause_ns)
            self.asking.send(piece, self.now_ns)
            if pause_ns or len(pieces) > 1:
                self._pass_to(self.now_ns + len(piece) * self.char_ns)
        give_up_ns = self.now_ns + GIVEN_UP_CHARACTERS * self.char_ns + 40 * NS_PER_MS
        while len(self._told) < reply_bytes and self.now_ns < give_up_ns:
            self._step(give_up_ns)
        ended_ns = self._told[reply_bytes - 1] if len(self._told) >= reply_bytes else None
        self._pass_to(self.now_ns + self.silence_ns + self.char_ns + self.rng.randrange(self.char_ns))
        if ended_ns is None or not is_intact(self._heard[:reply_bytes]):
            return None
        return ended_ns - begun_ns

    # --- time -------------------------------------------------------------------------------------------

    def _pass_to(self, until_ns: int) -> None:
        while self._step(until_ns):
            pass

    def _gateway_ns(self) -> int | None:
        forwarding = self.line.forwarding
        due = (
            self.requests.deadline_ns,
            self.replies.deadline_ns,
            self.line.deadline_ns,
            self.port.sender.deadline_ns,
            self.link.sender.deadline_ns,
            None if self.forwarder is None else self.forwarder.deadline_ns,
            None if forwarding is None else forwarding.drives.deadline_ns,
        )
        first = min((each for each in due if each is not None), default=None)
        if first is None:
            self._planned = None
            return None
        if self._planned is None or self._planned[0] != first:
            late_ns = round(self.rng.random() * self.way.late_ms * NS_PER_MS)
            self._planned = (first, max(first, self.now_ns) + late_ns)
        return self._planned[1]

    def _step(self, until_ns: int) -> bool:
        """Let the next thing happen that falls due before ``until_ns``; return whether there was one."""
        gateway_ns = self._gateway_ns()
        due = (
            gateway_ns,
            self.asking.deadline_ns,
            self.told.deadline_ns,
            self.out.deadline_ns,
            self.back.deadline_ns,
            self.uart.deadline_ns,
        )
        first = min((each for each in due if each is not None), default=None)
        if first is None or first > until_ns:
            self.now_ns = max(self.now_ns, until_ns)
            return False
        now_ns = self.now_ns = max(first, self.now_ns)
        for came_ns, byte in self.told.arrivals(now_ns):
            self._told.append(came_ns)
            self._heard += bytes((byte,))
        for arrival in self.out.arrivals(now_ns):
            self._obey(self.uart.receive(arrival))
        self._obey(self.uart.take(now_ns))
        self._hear_requests(self.asking.receive(now_ns))
        self._hear_replies(self.back.receive(now_ns))
        if gateway_ns is not None and gateway_ns <= now_ns:
            self._tick(now_ns)
        return True

    # --- the gateway ------------------------------------------------------------------------------------

    def _tick(self, now_ns: int) -> None:
        self._planned = None
        if self.forwarder is not None:
            self.forwarder.tick(now_ns)
        self._ask(self.requests.on_silence(now_ns))
        if self.line.forwarding is not None:
            self.line.forwarding.drives.tick(now_ns)
        for unit_id, pdu in self.replies.on_silence(now_ns):
            self.line.reply(unit_id, pdu, now_ns)
        deadline_ns = self.line.deadline_ns
        if deadline_ns is not None and now_ns >= deadline_ns:
            self.line.tick(now_ns)
        self.port.sender.tick(now_ns)
        self.link.sender.tick(now_ns)

    def _ask(self, requests: list[tuple[int, bytes]]) -> None:
        for unit_id, pdu in requests:
            self.line.request(self.port, 0, unit_id, pdu, self.now_ns)

    def _hear_requests(self, data: bytes) -> None:
        if not data:
            return
        now_ns = self.now_ns
        sender = self.port.sender
        sender.quiet_ns = max(sender.quiet_ns, now_ns)
        has_left = False
        if self.forwarder is not None:
            has_left = self.forwarder.feed(data, now_ns, is_fresh=self.requests.is_between_frames)
        self._ask(self.requests.feed(data, now_ns)[has_left:])

    def _hear_replies(self, data: bytes) -> None:
        if not data:
            return
        now_ns, decoder = self.now_ns, self.replies
        sender = self.link.sender
        sender.quiet_ns = max(sender.quiet_ns, now_ns)
        if self.line.forwarding is not None:
            self.line.forwarding.drives.feed(data, now_ns, is_fresh=decoder.is_at_reply)
        counters = decoder.counters
        before = counters.stray_bytes + counters.stray_frames + counters.foreign
        replies = decoder.feed(data, now_ns)
        if counters.stray_bytes + counters.stray_frames + counters.foreign != before:
            self.line.stray(now_ns)
        for unit_id, pdu in replies:
            self.line.reply(unit_id, pdu, now_ns)

    # --- the drive --------------------------------------------------------------------------------------

    def _obey(self, frame: bytes) -> None:
        if not frame:
            return
        if frame not in self.link.sent:
            self.found.foreign += 1
        else:
            self.link.sent.clear()
        if frame[1] == WRITE_HEAD[1]:
            self._position = frame[7:11]
            self.back.send(ACKNOWLEDGEMENT, self.now_ns)
        else:
            self.back.send(append_crc(b"\x01\x03\x06" + self._position + b"\x00\x07"), self.now_ns)


def targets(rng: Random) -> "list[int]":
    """Return setpoints of one way there and back, from a place somewhere."""
    first = rng.randrange(0, 1000)
    there = list(range(first, TRAVEL_COUNTS, STEP_COUNTS))
    return there + there[::-1]


def damaged(rng: Random, frame: bytes, pause_ns: int) -> list[tuple[int, bytes]]:
    """Return a frame as it must not reach a drive: pieces, each so long after the one before."""
    kind, at = rng.randrange(9), rng.randrange(1, len(frame))
    data = bytearray(frame)
    match kind:
        case 0:
            data[at] ^= 1 << rng.randrange(8)
        case 1:
            for _ in range(rng.randrange(2, 9)):
                data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        case 2:
            data[at] = rng.randrange(0x100)
        case 3:
            del data[at]
        case 4:
            data.insert(at, rng.randrange(0x100))
        case 5:
            del data[at:]
        case 6:
            data[-CRC_BYTES:] = data[:-3:-1]
        case 7:
            data[-CRC_BYTES:] = rng.randbytes(2)
        case _:
            data[at] ^= 1 << rng.randrange(8)
            return [(0, bytes(data[:at])), (pause_ns, bytes(data[at:]))]
    return [(0, bytes(data))]


def run(way: Way, count: int, damage: float = 0.0) -> tuple[Found, SimulatedLine]:
    """Let a controller write setpoints and read the position in turns; a share of its writes is damaged."""
    line = SimulatedLine(way)
    found, rng = line.found, Random(way.seed)
    stream: list[int] = []
    for number in range(count):
        if number % 2:
            took_ns = line.exchange([(0, READ)], READ_REPLY_BYTES)
            kept = found.read_ns
        else:
            stream = stream or targets(rng)
            frame = append_crc(WRITE_HEAD + COMMAND.pack(stream.pop(0)))
            pieces = [(0, frame)]
            if rng.random() < damage:
                pieces = damaged(rng, frame, 2 * line.silence_ns // 3)
                came = b"".join(piece for _, piece in pieces)
                if not has_whole(came):
                    found.damaged += 1
                    before = line.link.commits
                    line.exchange(pieces, len(ACKNOWLEDGEMENT))
                    found.forged += line.link.commits - before
                    continue
            took_ns = line.exchange(pieces, len(ACKNOWLEDGEMENT))
            kept = found.write_ns
        if took_ns is None:
            found.unanswered += 1
        else:
            kept.append(took_ns)
    found.torn = 0 if line.line.forwarding is None else line.line.forwarding.underruns
    found.broken = line.uart.frames_broken
    return found, line


def has_whole(came: bytes) -> bool:
    """Whether somewhere in bytes stands a request of this controller with a good check sum."""
    return any(
        is_intact(came[at : at + length]) for length in (8, 13) for at in range(len(came) - length + 1)
    )


def direct_ns(way: Way, characters: int) -> int:
    """Return what an exchange takes on one wire, with the silence by which the drive knows its end."""
    char_ns = BITS * NS_PER_S / way.out_baudrate
    return round((characters + 1) * char_ns) + ends_ns(way.hearing, way.out_baudrate)


def shares(way: Way, found: Found) -> tuple[float, float]:
    """Return what the gateway adds to a write and to a read, of one direct round trip of characters."""
    char_ns = BITS * NS_PER_S / way.out_baudrate
    added = []
    for took, characters in ((found.write_ns, 21), (found.read_ns, 19)):
        added.append((median(took) - direct_ns(way, characters)) / (characters * char_ns))
    return added[0], added[1]


def main() -> None:
    """Run one way, and say what was seen as JSON."""
    parser = argparse.ArgumentParser(prog="python -m bench.cut_line")
    parser.add_argument("--baudrate", type=int, default=9600)
    parser.add_argument("--drives-baudrate", type=int, default=0)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--latency-timer", type=float, default=0.0)
    parser.add_argument("--lump", type=int, default=62)
    parser.add_argument("--quiet", type=float, default=0.0, help="characters")
    parser.add_argument("--jitter", type=float, default=0.0, help="ms")
    parser.add_argument("--late", type=float, default=0.0, help="ms")
    parser.add_argument("--damage", type=float, default=0.0)
    parser.add_argument("--hearing", default=Hearing.STANDARD.value)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--stored", action="store_true")
    given = parser.parse_args()
    adapter = Adapter(given.latency_timer, given.quiet, given.lump, given.jitter)
    way = Way(
        given.baudrate,
        given.drives_baudrate,
        not given.stored,
        adapter,
        given.late,
        Hearing(given.hearing),
        given.seed,
    )
    found, line = run(way, given.count, given.damage)
    forwarding = line.line.forwarding
    said = {
        "added": [round(share, 3) for share in shares(way, found)],
        **{
            name: getattr(found, name)
            for name in ("unanswered", "damaged", "torn", "foreign", "forged", "broken")
        },
        "requests": {} if forwarding is None else _said(forwarding.requests.ended),
        "replies": {} if forwarding is None else _said(forwarding.replies.ended),
        "events": line.events,
    }
    sys.stdout.write(json.dumps(said) + "\n")


def _said(events: dict[ForwardEvent, int]) -> dict[str, int]:
    return {event.value: number for event, number in events.items() if number}


if __name__ == "__main__":
    main()
