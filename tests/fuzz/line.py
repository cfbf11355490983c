"""A line with controllers and drives, in a time of its own, that sees what leaves it and what comes back."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from gateway.config.load import load
from gateway.drives import library
from gateway.exchange.commands import (
    ClearTable,
    Disable,
    Enable,
    EndDryRun,
    SetGain,
    SetReference,
    SetTemperature,
)
from gateway.exchange.control import ControlError
from gateway.exchange.events import Event
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import AxisPlan, CompensationMode, ControllerPlan, LineTiming, Reference, Role
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.exchange.transaction import Transaction
from gateway.modbus.crc import crc16
from gateway.modbus.mbap import MbapDecoder, encode_mbap
from gateway.modbus.pdu import EXCEPTION_BIT, MAX_PDU
from gateway.modbus.rtu import RtuReplyDecoder, RtuRequestDecoder, encode_rtu
from tests.exchange.line_bench import LOST_MOTION, MS, Memory, axis_plan, stream_plan
from tests.fuzz.script import Script
from tests.ledger import layouts
from tests.ledger.screws import Screw
from tests.ledger.world import SETUPS

FREE_UNIT: Final = 200
"""No axis is there: everything passes as it is."""
LONG_MS: Final = 120_000
AXES_AT_ONCE: Final = 3


@cache
def of_known_drives() -> tuple[AxisPlan, ...]:
    """Return an axis for each drive that comes with the gateway, as a configuration makes it."""
    text = (
        '[gateway]\nname = "m"\n[line.l]\ndrives = { tcp = "127.0.0.1:502" }\n'
        '[[line.l.controllers]]\nname = "cnc"\ntcp = "127.0.0.1:1502"\n'
    )
    for number, name in enumerate(library.names(), start=1):
        text += (
            f'[axis.a{number}]\nline = "l"\nunit_id = {number}\ndrive = "{name}"\nunits = "mm"\n'
            "counts_per_unit = 1000.0\ntravel = [-300.0, 300.0]\nmax_speed = 200.0\n"
            'referenced = "absolute"\ncompensation = "on"\n'
        )
    with TemporaryDirectory() as folder:
        path = Path(folder, "gateway.toml")
        path.write_text(text)
        (line,) = load(path).plan.lines
    return tuple(copied(axis, table=LOST_MOTION) for axis in line.axes)


def copied(plan: AxisPlan, **changes: object) -> AxisPlan:
    """Return a plan with changes."""
    fields = {name: getattr(plan, name) for name in AxisPlan.__dataclass_fields__}
    return AxisPlan(**{**fields, **changes})


@cache
def machines() -> tuple[tuple[AxisPlan, ...], ...]:
    """Return the axes of each line that can be chosen."""
    screw = Screw((0.0, 50.0, 100.0), (0.0, 0.02, 0.0), (-0.01, 0.01, 0.03))
    known = of_known_drives()
    dry = CompensationMode.SHADOW
    return (
        (
            axis_plan(),
            stream_plan(name="y", unit_id=2),
            axis_plan(name="z", unit_id=2, referenced=Reference.HOMING),
        ),
        *(tuple(layouts.axis_plan(layout, screw) for layout in setup.layouts) for setup in SETUPS),
        *(known[first : first + AXES_AT_ONCE] for first in range(0, len(known), AXES_AT_ONCE)),
        (
            axis_plan(compensation=dry),
            stream_plan(name="y", unit_id=2, compensation=dry),
            axis_plan(name="z", unit_id=3, compensation=dry, referenced=Reference.HOMING),
        ),
    )


class Controller(ControllerPort):
    """A controller at its port: what it sent, and what it still waits for."""

    def __init__(self, line: LineExchange, plan: ControllerPlan) -> None:
        super().__init__(plan)
        self._line = line
        self._rtu = RtuRequestDecoder()
        self._mbap = MbapDecoder()
        self.waits_for: list[tuple[int, int, bytes]] = []
        self.replies: list[bytes] = []
        self.drive_said: Callable[[], bytes] = bytes

    @property
    def deadline_ns(self) -> int | None:
        """When silence ends what it sent."""
        return self._rtu.deadline_ns

    def hear(self, data: bytes, now_ns: int) -> None:
        """Take bytes as they came."""
        if self.plan.serial:
            self.take([(0, *frame) for frame in self._rtu.feed(data, now_ns)], now_ns)
        else:
            self.take(self._mbap.feed(data), now_ns)

    def be_silent(self, now_ns: int) -> None:
        self.take([(0, *frame) for frame in self._rtu.on_silence(now_ns)], now_ns)

    def take(self, requests: Sequence[tuple[int, int, bytes]], now_ns: int) -> None:
        """Pass whole requests on."""
        for request in requests:
            self.waits_for.append(request)
            self._line.request(self, *request, now_ns)

    def framed(self, unit_id: int, pdu: bytes, transaction_id: int) -> bytes:
        """Return a request as this controller sends it."""
        return encode_rtu(unit_id, pdu) if self.plan.serial else encode_mbap(transaction_id, unit_id, pdu)

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        self.framed(unit_id, pdu, transaction_id)  # raises where that cannot be framed
        asked = [each for each in self.waits_for if each[:2] == (transaction_id, unit_id)]
        assert asked, f"unit {unit_id} answers {pdu.hex(' ')}, and nobody asked"
        # Some may have been given up without an answer; who uses an id twice cannot tell which.
        function = pdu[0] & ~EXCEPTION_BIT
        fitting = [each for each in asked if each[2][0] & ~EXCEPTION_BIT == function]
        self.waits_for.remove((fitting or asked)[0])
        if unit_id == FREE_UNIT:
            own = fitting and len(pdu) == 2 and pdu[0] & EXCEPTION_BIT
            assert own or pdu == self.drive_said(), "a reply that is not mapped was changed"
        self.replies.append(pdu)

    def begin_anew(self) -> None:
        """Forget the beginning of a frame, as a new connection does."""
        self._rtu.reset()
        self._mbap = MbapDecoder()


class Drives(DriveLink):
    """The drives and the way to them: sees that each frame leaves whole, alone, and once."""

    def __init__(self, *, is_serial: bool, mapped: frozenset[int]) -> None:
        super().__init__(is_serial=is_serial)
        self.line: LineExchange | None = None
        self.asked: tuple[int, int, bytes] | None = None
        """Transaction id, unit id and PDU of the frame that waits for its reply."""
        self.reply = b""
        """What was said last, for a frame that passes as it is."""
        self._mapped = mapped
        self._rtu = RtuReplyDecoder()
        self._mbap = MbapDecoder()
        self._last_id = 0
        self._sent: list[Transaction] = []
        self._memories: dict[int, Memory] = {}

    def memory(self, unit_id: int) -> Memory:
        """Return the registers of a drive."""
        return self._memories.setdefault(unit_id, Memory())

    @property
    def deadline_ns(self) -> int | None:
        """When silence ends what they sent."""
        return self._rtu.deadline_ns

    @property
    def is_within_frame(self) -> bool:
        """Whether a frame over TCP began that is not whole: nothing behind it can be told from it."""
        return not self._mbap.is_between_frames

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        assert self.line is not None
        assert self.asked is None, "a second frame while the first one waits for its reply"
        exchange = self.line._transactions.current
        self._last_id = (self._last_id + 1) & 0xFFFF
        frame = encode_rtu(unit_id, pdu) if self.is_serial else encode_mbap(self._last_id, unit_id, pdu)
        assert crc16(frame) == 0 if self.is_serial else frame[4] << 8 | frame[5] == len(frame) - 6
        if self.is_serial and unit_id == 0:
            assert exchange is None
            self._rtu.expect_echo(unit_id, pdu)
            return
        assert exchange is not None
        if exchange.added is None:
            assert not any(exchange is each for each in self._sent), "sent twice"
            self._sent.append(exchange)
            if unit_id not in self._mapped and unit_id != 0:
                assert (unit_id, pdu) == (exchange.unit_id, exchange.pdu), "changed, and it is not mapped"
        else:
            assert unit_id in self._mapped, "a frame of the gateway's own to somebody else's drive"
        self.asked = self._last_id, unit_id, pdu
        if self.is_serial:
            self._rtu.expect(unit_id, pdu)

    def abandon(self) -> None:
        self.asked = None
        self._rtu.cancel()

    def hear(self, data: bytes, now_ns: int) -> None:
        """Take bytes as they came."""
        assert self.line is not None
        if not self.is_serial:
            for transaction_id, _, pdu in self._mbap.feed(data):
                if self.asked is not None and transaction_id == self.asked[0]:
                    self._answered(self.asked[1], pdu, now_ns)
                else:
                    self.line.stray(now_ns)
            if self._mbap.counters.bad_headers:
                self.drop(now_ns)
                self.line.link_up(now_ns)
            return
        counters = self._rtu.counters
        stray_bytes, frames = counters.stray_bytes, counters.stray_frames + counters.foreign
        replies = self._rtu.feed(data, now_ns)
        is_frame = counters.stray_frames + counters.foreign != frames
        if is_frame or counters.stray_bytes != stray_bytes:
            self.line.stray(now_ns, unit_id=self._rtu.late_unit_id if is_frame else -1)
        for unit_id, pdu in replies:
            self._answered(unit_id, pdu, now_ns)

    def be_silent(self, now_ns: int) -> None:
        for unit_id, pdu in self._rtu.on_silence(now_ns):
            self._answered(unit_id, pdu, now_ns)

    def _answered(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        assert self.line is not None
        self.asked = None
        self.reply = pdu
        self.line.reply(unit_id, pdu, now_ns)

    def drop(self, now_ns: int) -> None:
        """Lose the way to the drives."""
        assert self.line is not None
        self.asked = None
        self._rtu.reset()
        self._mbap = MbapDecoder()
        self.line.link_down(now_ns)

    def framed(self, pdu: bytes, id_offset: int = 0) -> bytes:
        """Return a reply to what was asked as drives send it; nothing where nothing was asked."""
        if self.asked is None or not 0 < len(pdu) <= MAX_PDU:
            return b""
        transaction_id, unit_id, _ = self.asked
        if self.is_serial:
            return encode_rtu(unit_id, pdu)
        return encode_mbap(transaction_id - id_offset & 0xFFFF, unit_id, pdu)

    def answer(self) -> bytes:
        """Return what a drive that is plain memory says to what was asked."""
        if self.asked is None:
            return b""
        _, unit_id, pdu = self.asked
        is_long = pdu[0] in (3, 4, 23) and int.from_bytes(pdu[3:5], "big") > 125
        return (
            bytes((pdu[0] | EXCEPTION_BIT, 3))
            if is_long or len(pdu) < 5
            else self.memory(unit_id).answer(pdu)
        )


class Line:
    """One line with four controllers."""

    def __init__(self, setup: int) -> None:
        plans = machines()[(setup >> 2) % len(machines())]
        self.axes = [plan.name for plan in plans]
        self.plans = plans
        self.units = sorted({plan.unit_id for plan in plans})
        self.drives = Drives(is_serial=bool(setup & 2), mapped=frozenset(self.units))
        self.events: list[Event] = []
        self.line = LineExchange(plans, LineTiming(), self.drives, self.events.append)
        self.drives.line = self.line
        self.controllers = [
            Controller(self.line, plan)
            for plan in (
                ControllerPlan("cnc", serial=bool(setup & 1)),
                ControllerPlan("hmi", role=Role.MONITOR),
                ControllerPlan("panel", role=Role.OPERATOR),
                ControllerPlan("mes", timeout_ms=300.0),
            )
        ]
        for controller in self.controllers:
            controller.drive_said = lambda: self.drives.reply
        self.now_ns = 1000 * MS
        self.line.link_up(self.now_ns)

    def wait(self, ms: float) -> None:
        """Let time pass, and everything that falls due meanwhile happen in its order."""
        end_ns = self.now_ns + int(ms * MS)
        while True:
            due: list[tuple[int, int]] = []
            ends: list[LineExchange | Drives | Controller] = [self.line, self.drives, *self.controllers]
            for number, end in enumerate(ends):
                if end.deadline_ns is not None:
                    due.append((end.deadline_ns, number))
            if not due or min(due)[0] > end_ns:
                break
            deadline_ns, number = min(due)
            self.now_ns = max(self.now_ns, deadline_ns)
            end = ends[number]
            if isinstance(end, Drives | Controller):
                end.be_silent(self.now_ns)
            else:
                end.tick(self.now_ns)
            assert end.deadline_ns is None or end.deadline_ns > deadline_ns, "due again at once, for ever"
        self.now_ns = end_ns

    def request(self, number: int, script: Script, *, is_glued: bool) -> None:
        """Have a controller send a request, whole."""
        controller = self.controllers[number]
        place = script.byte()
        units = (*self.units, FREE_UNIT, 0, 255)
        pdu = script.text()[:MAX_PDU]
        if pdu:
            data = controller.framed(units[place % len(units)], pdu, place)
            if is_glued:
                data += script.text()
            controller.hear(data, self.now_ns)

    def control(self, does: int, script: Script) -> None:
        """Do what an operator does, or what happens to a cable."""
        line, now_ns = self.line, self.now_ns
        axis = self.axes[(does >> 4) % len(self.axes)]
        try:
            match does & 15:
                case 0:
                    self.drives.drop(now_ns)
                case 1:
                    line.link_up(now_ns)
                case 2:
                    line.command(Enable(axes=(axis,)), now_ns)
                case 3:
                    line.command(Disable(axes=(axis,)), now_ns)
                case 4:
                    line.command(SetReference(axis=axis), now_ns)
                case 5:
                    forward, backward = script.byte() / 255, script.byte() / 255
                    line.command(SetGain(axes=(axis,), forward=forward, backward=backward), now_ns)
                case 6:
                    line.command(ClearTable(axes=(axis,)), now_ns)
                case 7 | 8 | 9:
                    controller = self.controllers[does >> 4 & 3]
                    controller.begin_anew()
                    controller.waits_for.clear()
                    line.controller_gone(controller, now_ns)
                case 10:
                    line.command(SetTemperature(axis=axis, celsius=float(script.byte())), now_ns)
                case 11:
                    line.command(EndDryRun(axes=(axis,)), now_ns)
                case _:
                    self.arrive()
        except ControlError as error:
            assert str(error).strip()

    def arrive(self) -> None:
        """Let every drive be where it was told to go."""
        for plan in self.plans:
            if plan.command and plan.actual and plan.command[0].words == plan.actual[0].words:
                memory = self.drives.memory(plan.unit_id)
                memory.write(
                    plan.actual[0].address, memory.read(plan.command[0].address, plan.command[0].words)
                )

    def settle(self) -> None:
        """Let all end that was begun. A drive that broke off within a frame over TCP has to connect again."""
        if self.drives.is_within_frame:
            self.drives.drop(self.now_ns)
        self.line.link_up(self.now_ns)
        self.wait(LONG_MS)
        assert self.line.is_idle, "an exchange that never ends"
        assert self.line.deadline_ns is None, f"something is due for ever: {self.line.deadline_ns}"
        assert self.drives.asked is None
