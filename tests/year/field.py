"""Around the gateway: drives on their lines, and controllers of three manners with their programs.

The drives are those of ``tests/ledger``. A controller is a program, a generator: it yields a request and gets
the reply, None if there was none; or it yields a pause in milliseconds.
"""

import random
from collections.abc import Callable, Generator
from enum import Enum
from functools import partial
from typing import Final, NamedTuple

from tests.ledger.drives import Drive, settle_ms
from tests.ledger.frames import mbap, open_mbap, open_rtu, read_pdu, rtu, single_pdu, write_pdu
from tests.ledger.layouts import DONE_BIT, RUN, STOP, Layout, Style
from tests.ledger.screws import TRAVEL_MM
from tests.year.account import Account, Axis, Frame, Line, Request
from tests.year.faults import Share
from tests.year.homing import HOME, HOMED, HomedDrive
from tests.year.machine import MS, Machine
from tests.year.network import Network, Peer
from tests.year.serial_ports import Wire

Step = tuple[int, bytes] | float
Program = Generator[Step, bytes | None, None]
TIMEOUT_MS: Final = 150.0
"""``response_timeout_ms``: how long the gateway waits for replies to its own reads."""
PATIENCE_MS: Final = 1_000.0
"""Of each controller. The gateway waits as long for a drive (W7)."""
PATIENCE_NS: Final = int(PATIENCE_MS * MS)
ON_WIRE_NS: Final = 3 * MS
"""The longest way of a short reply."""
ON_TCP: Final = {"request-garbled": "request-lost", "reply-garbled": "reply-lost"}
"""TCP garbles nothing."""
Answer = Callable[[bytes, bool], int]
"""Sends the PDU of a reply, True: damaged on its way; returns when it arrives."""


class Bus:
    """The drives of a line: they take frames, and answer after a while."""

    def __init__(
        self,
        machine: Machine,
        account: Account,
        line: Line,
        rng: random.Random,
        faults: Share,
        *,
        is_tcp: bool,
    ) -> None:
        self._machine, self._account, self._line, self._rng = machine, account, line, rng
        self._faults, self._is_tcp = faults, is_tcp
        self.axes = line.axes
        self.is_silent = False
        """They are switched off."""
        self.silent_units: set[int] = set()
        """Those that reboot."""

    def take(self, data: bytes, unit: int, pdu: bytes, answer: Answer) -> None:
        """Take a frame; ``answer`` gets the PDU of the reply."""
        axis = self._line.axes.get(unit)
        frame = self._account.taken(self._line, unit, pdu, data)
        if axis is None or self.is_silent or unit in self.silent_units or frame is None:
            return
        fault = self._faults.choose()
        if self._is_tcp:
            fault = ON_TCP.get(fault, fault)
        if fault:
            self._account.book.note(f"fault {fault}")
            self._account.trouble(self._line)
        if fault in ("request-lost", "request-garbled"):
            return
        self._machine.after(self._rng.randrange(200_000, 2 * MS), self._do, axis, frame, fault, answer)

    def _do(self, axis: Axis, frame: Frame, fault: str, answer: Answer) -> None:
        reply, operations = axis.drive.execute(frame.pdu, self._machine.now_ns)
        self._account.did(frame, reply, operations)
        if fault == "reply-lost":
            return
        if fault == "refused":
            reply = frame.reply = bytes((frame.pdu[0] | 0x80, 4))
        if fault == "reply-late":
            patience_ms = TIMEOUT_MS if frame.request is None else PATIENCE_MS
            late_ms = patience_ms + self._rng.uniform(5.0, 60.0)  # within the silence that follows (W6)
            self._machine.after(int(late_ms * MS), answer, reply, False)
            return
        is_garbled = fault == "reply-garbled"
        arrives_ns = answer(reply, is_garbled)
        if not is_garbled:
            self._account.acknowledged(frame, arrives_ns)
        if fault == "reply-doubled":
            again_ns = self._rng.randrange(MS, 40 * MS)
            frame.doubled_ns = self._machine.now_ns + again_ns + ON_WIRE_NS
            self._machine.after(again_ns, answer, reply, False)


class SerialDrives:
    """A bus at the end of a wire."""

    def __init__(self, bus: Bus, wire: Wire, rng: random.Random) -> None:
        self._bus, self._wire, self._rng = bus, wire, rng
        wire.heard = self._heard

    def _heard(self, data: bytes) -> None:
        opened = open_rtu(data)
        if opened is not None:
            self._bus.take(data, *opened, partial(self._answer, opened[0]))

    def _answer(self, unit: int, reply: bytes, is_garbled: bool) -> int:
        frame = rtu(unit, reply)
        if is_garbled:
            at = self._rng.randrange(len(frame))
            frame = frame[:at] + bytes((frame[at] ^ 1 << self._rng.randrange(8),)) + frame[at + 1 :]
        return self._wire.send(frame)


class TcpDrives(Peer):
    """A bus behind one connection of the gateway."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus

    def received(self, data: bytes) -> None:
        """See ``Peer``: each frame of the gateway is one write."""
        number, unit, pdu = open_mbap(data)
        self._bus.take(data, unit, pdu, lambda reply, _: self.send(mbap(number, unit, reply)))


# --- Controllers


class Site(NamedTuple):
    """Where a controller is, and what it does there."""

    name: str
    machine: Machine
    account: Account
    line: Line
    programs: Callable[[], Program]
    """Returns one round after the other."""


class Controller:
    """Runs its programs, one request at a time."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._machine, self._account, self._line = site.machine, site.account, site.line
        self._program = site.programs()
        self._request: Request | None = None
        self._number = 0
        """Counts the requests: what comes later for an older one is not for this one."""

    def begin(self) -> None:
        """Begin the program."""
        self._go_on(None)

    def _go_on(self, reply: bytes | None) -> None:
        try:
            step = self._program.send(reply)
        except StopIteration:
            self._program = self._site.programs()
            step = next(self._program)
        if isinstance(step, float):
            self._machine.after(int(step * MS), self._go_on, None)
        else:
            self._ask(*step)

    def _ask(self, unit: int, pdu: bytes) -> None:
        if not self._may_ask():
            self._machine.after(200 * MS, self._ask, unit, pdu)
            return
        self._number += 1
        now_ns = self._machine.now_ns
        self._request = Request(self._site.name, unit, pdu, now_ns, PATIENCE_NS)
        self._account.asked(self._line, self._request)
        self._machine.at(now_ns + PATIENCE_NS, self._no_reply, self._number)
        self._request.arrived_ns = self._send(unit, pdu)

    def _replied(self, pdu: bytes) -> None:
        request, self._request = self._request, None
        if request is not None:
            self._number += 1
            self._account.answered(self._line, request, pdu)
            self._machine.after(MS, self._go_on, pdu)

    def _no_reply(self, number: int) -> None:
        request = self._request
        if number == self._number and request is not None:
            self._request = None
            self._account.gave_up(self._line, request)
            self._lost_patience()
            self._machine.after(20 * MS, self._go_on, None)

    def _may_ask(self) -> bool:
        return True

    def _lost_patience(self) -> None:
        """After a request without a reply."""

    def _send(self, unit: int, pdu: bytes) -> int:
        """Send a request; return when it arrives."""
        raise NotImplementedError


class SerialController(Controller):
    """A controller on a wire: it takes the first frame of its drive for the reply."""

    def over(self, wire: Wire) -> None:
        """Use a wire."""
        self._wire = wire
        self._heard_bytes = b""
        wire.heard = self._heard

    def _send(self, unit: int, pdu: bytes) -> int:
        self._heard_bytes = b""
        return self._wire.send(rtu(unit, pdu))

    def _heard(self, data: bytes) -> None:
        if self._request is None:
            return
        self._heard_bytes += data
        opened = open_rtu(self._heard_bytes)
        if opened is not None and opened[0] == self._request.unit:
            self._replied(opened[1])


class TcpController(Controller, Peer):
    """A controller that connects, and connects again where its connection ends.

    ``hangs_up``: it closes its connection after a request without a reply.
    """

    def over(self, network: Network, host: str, port: int, *, hangs_up: bool) -> None:
        """Connect from this host."""
        self._network, self._host, self._port, self._hangs_up = network, host, port, hangs_up
        self._is_open = False
        self._transaction = 0
        self._rest = b""
        network.connect(self, host, port)

    def opened(self) -> None:
        """See ``Peer``."""
        self._is_open, self._rest = True, b""

    def closed(self) -> None:
        """See ``Peer``."""
        self._is_open = False
        request, self._request = self._request, None
        if request is not None:
            self._number += 1
            self._account.gave_up(self._line, request)
            self._machine.after(20 * MS, self._go_on, None)
        self._machine.after(500 * MS, self._network.connect, self, self._host, self._port)

    def received(self, data: bytes) -> None:
        """See ``Peer``."""
        data = self._rest + data
        while len(data) >= 6 and len(data) >= (size := 6 + int.from_bytes(data[4:6], "big")):
            number, _, pdu = open_mbap(data[:size])
            data = data[size:]
            if number == self._transaction:
                self._replied(pdu)
        self._rest = data

    def _may_ask(self) -> bool:
        return self._is_open

    def _lost_patience(self) -> None:
        if self._hangs_up and self._is_open:
            self.close()
            self.closed()

    def _send(self, unit: int, pdu: bytes) -> int:
        self._transaction = self._transaction % 0xFFFF + 1
        return self.send(mbap(self._transaction, unit, pdu))


# --- Their programs


class Manner(Enum):
    """How a controller works."""

    STREAM = "streams targets on their way, then looks where the axis came to rest"
    SEQUENCE = "writes a target, starts it, and waits until the drive is done"
    SETPOINTS = "leads its axes along together, with a setpoint for each in every cycle"
    BEAM = "leads its axes together: a target for each, then each is started"
    WATCH = "only reads"


def program(manner: Manner, axes: list[Axis], machine: Machine, rng: random.Random) -> Program:
    """Return one round of a program, for any axis of its own."""
    axis = rng.choice(axes)
    if manner is Manner.SETPOINTS:
        return _setpoints(axes, machine, rng)
    if manner is Manner.BEAM:
        return _beam(axes, machine, rng)
    if manner is Manner.WATCH:
        return _watch(axis, rng)
    return _stream(axis, machine, rng) if manner is Manner.STREAM else _sequence(axis, machine, rng)


def _watch(axis: Axis, rng: random.Random) -> Program:
    layout = axis.layout
    yield layout.unit, read_pdu(rng.choice((layout.actual, layout.actual, layout.status)), 2)
    yield 1000.0


def _position(axis: Axis, rng: random.Random) -> int:
    return axis.layout.counts(rng.uniform(1.0, TRAVEL_MM - 1.0))


def _stream(axis: Axis, machine: Machine, rng: random.Random) -> Program:
    """Go in small steps to somewhere, let it arrive, look, and have a rest."""
    layout = axis.layout
    at, end = axis.drive.target, _position(axis, rng)
    if axis.place is not None:
        at = axis.place
    step = rng.choice((200, 900, 3_000)) * (1 if end > at else -1)
    for _ in range(rng.randint(3, 25)):
        at = min(at + step, end) if step > 0 else max(at + step, end)
        yield layout.unit, write_pdu(layout.command, layout.split(at))
        yield rng.uniform(60.0, 180.0)
        if rng.random() < 0.2:
            yield layout.unit, read_pdu(layout.actual, 2)
        if at == end:
            break
    yield from _look_at_rest(axis, machine, rng)


def _sequence(axis: Axis, machine: Machine, rng: random.Random) -> Program:
    """Move to somewhere, wait for the done bit, look; now and then stop on the way."""
    layout = axis.layout
    if not axis.is_referenced and rng.random() < 0.8:
        yield from _home(axis, rng)
    target = axis.place if axis.place is not None and rng.random() < 0.1 else _position(axis, rng)
    if (yield layout.unit, write_pdu(layout.command, layout.split(target))) is None:
        return
    if layout.style is Style.TRIGGERED:
        yield layout.unit, single_pdu(layout.trigger, RUN)
    if rng.random() < 0.05:
        yield rng.uniform(20.0, 200.0)
        yield layout.unit, single_pdu(layout.trigger, STOP)
    for _ in range(60):
        yield 250.0
        reply = yield layout.unit, read_pdu(layout.status, 1)
        if reply is not None and len(reply) == 4 and reply[3] >> DONE_BIT & 1:
            break
    yield from _look_at_rest(axis, machine, rng)


def _setpoints(axes: list[Axis], machine: Machine, rng: random.Random) -> Program:
    """Lead all axes along for some legs, now and then holding the last setpoint; look, and have a rest."""
    cycle_ms = rng.choice((8.0, 20.0, 50.0))
    at = {axis: axis.drive.target if axis.place is None else axis.place for axis in axes}
    for _ in range(rng.randint(1, 4)):
        ends = {axis: _near(axis, at[axis], rng) for axis in axes}
        count = rng.randint(10, 40)
        for number in (*range(1, count + 1), *[count] * rng.choice((0, 0, 3))):
            for axis in axes:
                setpoint = at[axis] + (ends[axis] - at[axis]) * number // count
                yield axis.layout.unit, write_pdu(axis.layout.command, axis.layout.split(setpoint))
            yield cycle_ms
        at = ends
    for axis in axes:
        yield from _look_at_rest(axis, machine, rng)


def _beam(axes: list[Axis], machine: Machine, rng: random.Random) -> Program:
    """Lead a beam on two axes to one place or several, without waiting; look, and have a rest.

    It is stopped if something of it was refused or not answered. Another axis may go first then: the group
    waits for the target that was lost (M3).
    """
    axes = rng.sample(axes, len(axes))
    for _ in range(rng.choice((1, 1, 3))):
        place_mm = rng.uniform(1.0, TRAVEL_MM - 1.0)
        steps = [(each.layout, each.layout.command, each.layout.counts(place_mm)) for each in axes]
        writes = [(at.unit, write_pdu(address, at.split(counts))) for at, address, counts in steps]
        writes += [
            (each.layout.unit, single_pdu(each.layout.trigger, RUN)) for each in axes if each.layout.is_staged
        ]
        for unit, pdu in writes:
            reply = yield unit, pdu
            if reply is None or reply[0] & 0x80:
                for each in axes:
                    if each.layout.style is not Style.PLAIN:
                        yield each.layout.unit, single_pdu(each.layout.trigger, STOP)
                yield 1000.0
                return
            yield rng.choice((0.0, 30.0, 600.0))
        yield rng.uniform(60.0, 400.0)
    for axis in axes:
        yield from _look_at_rest(axis, machine, rng)


def _near(axis: Axis, counts: int, rng: random.Random) -> int:
    """Return a position at most 20 mm away, often only some micrometres."""
    end_mm = axis.layout.machine_mm(counts) + rng.choice((0.005, 0.5, 20.0)) * rng.uniform(-1.0, 1.0)
    return axis.layout.counts(min(max(end_mm, 1.0), TRAVEL_MM - 1.0))


def _home(axis: Axis, rng: random.Random) -> Program:
    """Home an axis that is shown without a reference, and look at the bit that says so."""
    yield axis.layout.unit, single_pdu(axis.layout.trigger, HOME)
    for _ in range(20):
        yield rng.uniform(50.0, 200.0)
        reply = yield axis.layout.unit, read_pdu(axis.layout.status, 1)
        if reply is not None and len(reply) == 4 and reply[3] >> HOMED & 1:
            break
    yield 500.0


def _look_at_rest(axis: Axis, machine: Machine, rng: random.Random) -> Program:
    yield settle_ms(axis.drive, machine.now_ns) + rng.uniform(50.0, 400.0)
    yield axis.layout.unit, read_pdu(axis.layout.actual, 2)
    yield rng.uniform(20.0, 3_000.0)


def make_drive(layout: Layout, machine: Machine, rng: random.Random, *, is_homed: bool) -> Drive:
    """Return a drive that stands somewhere."""
    at, speed_mm_s = layout.counts(rng.uniform(5.0, TRAVEL_MM - 5.0)), rng.uniform(30.0, 150.0)
    return HomedDrive(machine, layout, at, speed_mm_s) if is_homed else Drive(layout, at, speed_mm_s)
