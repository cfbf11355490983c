"""A line on the bench: a controller's port, a link that records, and a drive that is plain memory."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from enum import Enum
from typing import Any, ClassVar

from gateway.catalogue import exchange_events
from gateway.compensation.settings import AxisSettings, Setpoints
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.cut_through.delay import (
    LEARNED_AFTER,
    FrameShape,
    Piece,
    acknowledgement_shape,
    read_shape,
    reply_shape,
    write_shape,
)
from gateway.exchange.cut_through.forward import Forwarder, SerialTiming
from gateway.exchange.events import Event
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import AxisPlan, CompensationMode, ControllerPlan, LineTiming, Reference, Role
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.modbus.crc import INVERTED, append_crc, residue_after
from gateway.modbus.registers import PositionField, RegisterType, WordOrder

MS = 1_000_000
MOVE_MS = 1000.0
CNC = ControllerPlan("cnc")
LOST_MOTION = make_table([0, 100], [0.01, 0.01], [-0.01, -0.01], Units.MM)
"""20 µm of backlash: 10 counts more going forward, 10 less going backward at 1000 counts per mm."""
COMMAND = PositionField(0x0606, RegisterType.INT32, WordOrder.LOW_FIRST)
ACTUAL = PositionField(0x0520, RegisterType.INT32, WordOrder.LOW_FIRST)


def axis_plan(**changes: Any) -> AxisPlan:
    """An axis of 1000 counts per mm on unit id 1; keyword arguments replace settings or parts of the plan."""
    names = set(AxisSettings.__dataclass_fields__)
    settings = AxisSettings(Units.MM, 1000.0, max_speed=200.0, hysteresis=0.002)
    settings = replace(settings, **{k: v for k, v in changes.items() if k in names})
    plan = AxisPlan(
        name="x",
        unit_id=1,
        settings=settings,
        table=LOST_MOTION,
        compensation=CompensationMode.ON,
        referenced=Reference.ABSOLUTE,
        command=(COMMAND,),
        actual=(ACTUAL,),
    )
    return replace(plan, **{k: v for k, v in changes.items() if k not in names})


def stream_plan(**changes: Any) -> AxisPlan:
    """The same axis fed with a setpoint each cycle."""
    return axis_plan(setpoints=Setpoints.STREAM, **changes)


class Arrival(Enum):
    """How requests and replies come on a line between two serial wires."""

    STORED = "stored"
    """As whole frames, on a line that stores them."""
    AT_ONCE = "at once"
    """In one read, on a line that cuts through."""
    BY_CHARACTERS = "by characters"
    """One character after the other, each at its instant, on a line that cuts through."""


CHAR_NS = 100_000
WIRE = SerialTiming(CHAR_NS, 350_000)
"""The wires of a bench whose line cuts through: as fast as 115 200 Bd."""
KNOWN_REQUESTS = (read_shape(), *(write_shape(words, 0, 2) for words in (2, 3, 4)))
KNOWN_REPLIES = (acknowledgement_shape(), *(reply_shape(words, [(0, 2)]) for words in (2, 3, 4)))
"""The shapes whose delay such a bench has measured before it begins."""


class Port(ControllerPort):
    """A controller's port that records the replies to it."""

    def __init__(self, plan: ControllerPlan = CNC) -> None:
        super().__init__(plan)
        self.replies: list[tuple[int, int, bytes]] = []
        self.asked_id = 0
        """Transaction id of its last request; a line that cuts through has none."""
        self.left_early = b""
        """Bytes already sent of a reply that still arrives."""

    def may_forward(self, now_ns: int) -> bool:
        return True

    def forward(self, piece: bytes) -> None:
        self.left_early += piece

    def forward_last(self, transaction_id: int, unit_id: int, pdu: bytes, rest: bytes) -> None:
        assert self.left_early + rest == append_crc(bytes((unit_id,)) + pdu)
        self.left_early = b""
        self.replies.append((self.asked_id, unit_id, pdu))

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        self.replies.append((transaction_id, unit_id, pdu))

    def take(self) -> bytes:
        """Return the PDU of the only reply and forget it."""
        assert len(self.replies) == 1, [r[2].hex(" ") for r in self.replies]
        return self.replies.pop()[2]


class Link(DriveLink):
    """The link to the drives; it records the requests that are sent."""

    def __init__(self, *, is_serial: bool = True) -> None:
        super().__init__(is_serial=is_serial)
        self.sent: list[tuple[int, bytes]] = []
        self.abandoned = 0
        self.left_early = b""
        """Bytes already sent of a request that still arrives."""

    def may_forward(self, now_ns: int) -> bool:
        return True

    def forward(self, piece: bytes) -> None:
        self.left_early += piece

    def forward_last(self, unit_id: int, pdu: bytes, rest: bytes) -> None:
        assert self.left_early + rest == append_crc(bytes((unit_id,)) + pdu)
        self.left_early = b""
        self.sent.append((unit_id, pdu))

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        self.sent.append((unit_id, pdu))

    def abandon(self) -> None:
        self.abandoned += 1

    def take(self) -> bytes:
        """Return the PDU of the only request and forget it."""
        assert len(self.sent) == 1, [pdu.hex(" ") for _, pdu in self.sent]
        return self.sent.pop()[1]


class Memory:
    """A drive that is plain memory, written and read by FC03, FC04, FC06, FC16, FC22 and FC23."""

    def __init__(self) -> None:
        self.words: dict[int, int] = {}

    def read(self, address: int, quantity: int) -> bytes:
        return b"".join(self.words.get(address + i, 0).to_bytes(2, "big") for i in range(quantity))

    def write(self, address: int, data: bytes) -> None:
        for i in range(len(data) // 2):
            self.words[address + i] = int.from_bytes(data[2 * i : 2 * i + 2], "big")

    def answer(self, pdu: bytes) -> bytes:
        function, address = pdu[0], int.from_bytes(pdu[1:3], "big")
        if function in (3, 4):
            data = self.read(address, int.from_bytes(pdu[3:5], "big"))
            return bytes((function, len(data))) + data
        if function == 6:
            self.write(address, pdu[3:5])
            return pdu
        if function == 16:
            self.write(address, pdu[6:])
            return pdu[:5]
        if function == 22:
            and_mask, or_mask = int.from_bytes(pdu[3:5], "big"), int.from_bytes(pdu[5:7], "big")
            word = self.words.get(address, 0)
            self.words[address] = (word & and_mask) | (or_mask & ~and_mask & 0xFFFF)
            return pdu
        if function == 23:
            self.write(int.from_bytes(pdu[5:7], "big"), pdu[10:])
            data = self.read(address, int.from_bytes(pdu[3:5], "big"))
            return bytes((23, len(data))) + data
        return bytes((function | 0x80, 1))

    def put(self, place: PositionField, counts: float) -> None:
        self.write(place.address, place.pack(counts))

    def get(self, place: PositionField) -> float:
        return place.unpack(self.read(place.address, place.words))


class Bench:
    """One line with one controller and a drive that answers at once, or not at all."""

    arrival: ClassVar[Arrival] = Arrival.STORED
    """How requests come to benches between two serial wires; see ``conftest``."""

    def __init__(
        self,
        *plans: AxisPlan,
        timing: LineTiming | None = None,
        serial: bool = True,
        tcp_drive: bool = False,
        memory: Memory | None = None,
        groups: Iterable[Iterable[str]] = (),
        link: Link | None = None,
        before_up: Callable[[LineExchange], None] = lambda line: None,
        **options: Any,
    ) -> None:
        self.cuts_through = self.arrival is not Arrival.STORED and link is None and serial and not tcp_drive
        """False if a test has its own link, or if a side is not serial."""
        if self.cuts_through:
            options = {"cut_through": WIRE, **options}
        self.link = link or Link(is_serial=not tcp_drive)
        self.forwarders: dict[Port, Forwarder] = {}
        self.events: list[Event] = []
        self.line = LineExchange(
            plans, timing or LineTiming(), self.link, self.events.append, groups, **options
        )
        self.port = Port(ControllerPlan("cnc", serial=serial))
        self.memory = memory or Memory()
        self.seen: list[bytes] = []
        """Every PDU that the drive received."""
        self.now_ns = 1_000 * MS
        before_up(self.line)
        self.line.link_up(self.now_ns)
        self.serve()

    def wait(self, ms: float) -> None:
        """Let time pass."""
        self.now_ns += int(ms * MS)
        self.line.tick(self.now_ns)

    def serve(self) -> None:
        """Let the drive answer everything that was sent, one after the other."""
        while self.link.sent:
            unit_id, pdu = self.link.sent.pop(0)
            self.seen.append(pdu)
            reply = self.memory.answer(pdu)
            self._pass(MS, unit_id, reply)
            if unit_id or not self.link.is_serial:
                self.line.reply(unit_id, reply, self.now_ns)

    def serve_reads(self) -> None:
        """Let the drive answer a read that the gateway added, and nothing else."""
        while self.link.sent and self.link.sent[0][1][0] == 3:
            unit_id, pdu = self.link.sent.pop(0)
            self.seen.append(pdu)
            self.line.reply(unit_id, self.memory.answer(pdu), self.now_ns)

    def serve_writes(self) -> None:
        """Let the drive answer the writes that the gateway added before the last frame, and nothing else."""
        while self.link.sent and self.link.sent[0][1][0] == 16:
            unit_id, pdu = self.link.sent.pop(0)
            self.seen.append(pdu)
            self.line.reply(unit_id, self.memory.answer(pdu), self.now_ns)

    def send(self, pdu: bytes, port: Port | None = None, unit_id: int = 1, transaction_id: int = 7) -> None:
        """Send a request without letting the drive answer."""
        port = port or self.port
        has_left = port.is_serial and self.cuts_through and self._arrives(port, unit_id, pdu)
        port.asked_id = transaction_id
        if not has_left:
            self.line.request(port, transaction_id, unit_id, pdu, self.now_ns)
            self._end_silence()

    # --- lines that cut through -----------------------------------------------------------------------------

    def _forwarder(self, port: Port) -> Forwarder:
        """Return the forwarder of a port, which has measured the delays of the known shapes."""
        forwarder = self.forwarders.get(port)
        if forwarder is None:
            assert self.line.forwarding is not None
            forwarder = self.forwarders[port] = self.line.forwarding.follow(port, WIRE)
            way = self.line.forwarding.way_of(port)
            assert way is not None
            for _ in range(LEARNED_AFTER):
                for shape in KNOWN_REQUESTS:
                    way.heads.delays.measure(shape, _pieces(shape))
                for shape in KNOWN_REPLIES:
                    way.replies.delays.measure(shape, _pieces(shape))
        return forwarder

    def _arrives(self, port: Port, unit_id: int, pdu: bytes) -> bool:
        """Let a request come in; return whether it was forwarded whole."""
        forwarder, frame = self._forwarder(port), append_crc(bytes((unit_id,)) + pdu)
        if self.arrival is Arrival.AT_ONCE:
            return forwarder.feed(frame, self.now_ns, is_fresh=True)
        has_left, begun_ns = False, self.now_ns
        for number in range(len(frame)):
            came_ns = begun_ns + (number + 1) * CHAR_NS
            while (due_ns := forwarder.deadline_ns) is not None and self.now_ns < due_ns < came_ns:
                self.now_ns = due_ns
                forwarder.tick(due_ns)
            self.now_ns = came_ns
            has_left = forwarder.feed(frame[number : number + 1], came_ns, is_fresh=number == 0)
        return has_left

    def _end_silence(self) -> None:
        """Let the silence after a spoilt request end: the next request waits for it."""
        aborted, self.link.left_early = self.link.left_early, b""
        if aborted:
            assert residue_after(aborted) == INVERTED
            until_ns = self.line.rest.until_ns
            self.now_ns = self.now_ns if until_ns is None else max(self.now_ns, until_ns)
            self.line.tick(self.now_ns)

    def _pass(self, ns: int, unit_id: int, reply: bytes) -> None:
        """Let time pass until a reply has come whole."""
        if not self.cuts_through or not unit_id:
            self.now_ns += ns
            return
        assert self.line.forwarding is not None
        forwarder, frame = self.line.forwarding.drives, append_crc(bytes((unit_id,)) + reply)
        if self.arrival is Arrival.AT_ONCE:
            self.now_ns += ns
            forwarder.feed(frame, self.now_ns, is_fresh=True)
            return
        self.now_ns += max(0, ns - len(frame) * CHAR_NS)
        for number in range(len(frame)):
            came_ns = self.now_ns + CHAR_NS
            while (due_ns := forwarder.deadline_ns) is not None and self.now_ns < due_ns < came_ns:
                self.now_ns = due_ns
                forwarder.tick(due_ns)
            self.now_ns = came_ns
            forwarder.feed(frame[number : number + 1], came_ns, is_fresh=number == 0)

    def ask(self, pdu: bytes, port: Port | None = None, unit_id: int = 1) -> bytes:
        """Send a request, let the drive answer, return the controller's reply."""
        self.send(pdu, port, unit_id)
        self.serve()
        return (port or self.port).take()

    def sent_for(self, pdu: bytes) -> bytes:
        """Send a request and let the drive answer; return the last frame that the drive received for it."""
        self.ask(pdu)
        return self.seen[-1]

    def answers(self, reply: bytes) -> bytes:
        """Let the drive of unit id 1 answer the only request on the wire; return that request."""
        pdu = self.link.take()
        self.line.reply(1, reply, self.now_ns)
        return pdu

    def move(self, *counts: float, place: PositionField = COMMAND) -> bytes:
        """Command positions with FC16 and let the axis reach each; return the last frame to the drive."""
        for each in counts:
            assert self.ask(write(place, each)) == write(place, each)[:5]
            self.memory.put(ACTUAL, self.memory.get(place))
            self.wait(MOVE_MS)
        return self.seen[-1]

    def command(self, counts: float) -> float:
        """Command a position with FC16; return the target in the drive, in counts."""
        self.ask(write(COMMAND, counts))
        return self.memory.get(COMMAND)

    def reach(self, counts: float) -> float:
        """Command a position and let the axis reach it; return the target in the drive, in counts."""
        self.move(counts)
        return self.memory.get(COMMAND)

    def frames(self, pdu: bytes) -> list[bytes]:
        """Send a request and let the drive answer; return all frames that the drive received for it."""
        before = len(self.seen)
        self.ask(pdu)
        return self.seen[before:]

    def missed(self, pdu: bytes, *waits_ms: float, **to: Any) -> None:
        """Send a request that the drive leaves unanswered, and let time pass."""
        self.send(pdu, **to)
        assert len(self.link.sent) == 1
        self.link.sent.clear()
        for ms in waits_ms:
            self.wait(ms)

    def unanswered(self, pdu: bytes, *waits_ms: float, **to: Any) -> list[bytes]:
        """Do as :meth:`missed`; return the replies to the port, and forget them."""
        self.missed(pdu, *waits_ms, **to)
        replies, self.port.replies = self.port.replies, []
        return [each for _, _, each in replies]

    def leaves_after(self, ms: float) -> tuple[int, bytes]:
        """Let time pass, after which exactly one request is sent: nothing happens until 1 ms before."""
        before = list(self.port.replies)
        self.wait(ms - 1)
        assert (self.link.sent, self.port.replies) == ([], before)
        self.wait(1)
        [request] = self.link.sent
        self.link.sent.clear()
        return request

    def cut(self, ms: float) -> None:
        """Lose the link for ``ms``."""
        self.line.link_down(self.now_ns)
        self.wait(ms)
        self.line.link_up(self.now_ns)
        self.serve()

    def actual(self) -> float:
        """Read the actual position as the controller does."""
        return ACTUAL.unpack(self.ask(read(ACTUAL))[2:])

    def kinds(self) -> list[str]:
        """Names of the events so far, without ``cut-through-off``."""
        return [event.kind.name for event in self.events if event.kind is not exchange_events.CUT_THROUGH_OFF]


def _pieces(shape: FrameShape) -> list[Piece]:
    return [Piece(index * CHAR_NS, index + 1) for index in range(shape.length)]


def write(place: PositionField, counts: float) -> bytes:
    """FC16 that writes a whole position."""
    data = place.pack(counts)
    return bytes((16,)) + place.address.to_bytes(2, "big") + bytes((0, place.words, len(data))) + data


def read(place: PositionField, function: int = 3) -> bytes:
    """FC03 or FC04 that reads a whole position."""
    return bytes((function,)) + place.address.to_bytes(2, "big") + bytes((0, place.words))


def monitor() -> Port:
    """A second controller that may only read."""
    return Port(ControllerPlan("hmi", role=Role.MONITOR))
