"""Worlds that begin at bytes of RTU: the real ports, links and decoders around the same small world.

On a serial line nothing carries a number, and silence ends what is not whole. What is abstracted: the
silences of a line (1.75 ms, and 31.75 ms until what waits is given up) are shorter than a tick, so all of
them are over when a tick begins to pass, before anything that happens at its end; the exchange is told of
what they end at the instant of the last byte. Frames leave at once: the silence before one only delays it.
"""

from collections.abc import Callable
from typing import Final

from gateway.exchange.cut_through.forward import SerialTiming as LineWire
from gateway.exchange.events import Event
from gateway.exchange.plan import NO_OTHER_UNITS, OtherUnits
from gateway.exchange.ports import Stamps
from gateway.modbus.crc import append_crc, is_intact
from gateway.modbus.rtu import RtuReplyDecoder, RtuRequestDecoder, encode_rtu
from gateway.relay.controller_port import RtuControllerPort
from gateway.relay.drive_link import RtuDriveLink
from gateway.relay.pulse import Beats
from tests.verify.snapshot import Lens
from tests.verify.wires import (
    BytesLink,
    BytesSide,
    BytesWorld,
    Pipe,
    TimedLine,
    let_go,
    pass_by,
    timers_at_rest,
)
from tests.verify.world import TICK_NS, TIMING, Design, Happening, Side, Wire, World

ODD: Final = OtherUnits(frozenset({99}), frozenset({99}))
"""Of a device that is no axis, and takes odd frames."""
ODD_FRAME: Final = append_crc(bytes.fromhex("63 03 01 01 00 00 00 09 07"))
ODD_WRAPPED: Final = append_crc(b"\x63\x03" + append_crc(bytes.fromhex("01 06 00 00 00 01")))
"""Inside of it stands a request that nobody asked."""
ODD_FRONTS: Final = {
    "whole": ODD_FRAME,
    "damaged": ODD_FRAME[:-1] + bytes((ODD_FRAME[-1] ^ 0x5A,)),
    "wrapped": ODD_WRAPPED,
    "damaged-wrapped": ODD_WRAPPED[:-1] + bytes((ODD_WRAPPED[-1] ^ 0x5A,)),
}
"""What stands in one read before a request."""
NUMBERLESS: Final = -1
CUT: Final = 4
"""So many bytes of a frame come first."""


class WirePipe(Pipe):
    """One end of a serial line, which takes apart what is written to it."""

    is_high_first = False
    """Whether the highest word of a position comes first on it."""

    def write(self, data: bytes) -> None:
        """See ``Channel``."""
        assert is_intact(data), data.hex(" ")
        self._take(NUMBERLESS, data[0], on_the_wire(data[1:-2], is_high_first=self.is_high_first))


def on_the_wire(pdu: bytes, *, is_high_first: bool) -> bytes:
    """Return a PDU as it is on a wire where the highest word of a position comes first, and back.

    The worlds have the lowest word first.

    >>> on_the_wire(bytes.fromhex("10 06 06 00 02 04 23 2F 00 01"), is_high_first=True).hex(" ")
    '10 06 06 00 02 04 00 01 23 2f'
    """
    if is_high_first and pdu[0] == 0x10 and len(pdu) == 10:
        return pdu[:6] + pdu[8:] + pdu[6:8]
    if is_high_first and pdu[0] == 0x03 and len(pdu) == 6:
        return pdu[:2] + pdu[4:] + pdu[2:4]
    return pdu


class RtuSide(BytesSide):
    """One gateway between two serial lines, whose ports and link are the real ones."""

    pipe_kind: type[WirePipe] = WirePipe
    """Of the wire of the drives."""
    port_pipe_kind: type[WirePipe] = WirePipe
    """Of those of the controllers."""
    port_wire: LineWire | None = None
    """Of the controllers, where frames are cut through."""

    def __init__(self, design: Design, tell: Callable[[Event], None]) -> None:
        self.is_high_first = design.plans[0].command[0].is_high_first_pair
        with timers_at_rest():
            other = ODD if "odd" in design.happenings else NO_OTHER_UNITS
            real = RtuDriveLink(0, RtuReplyDecoder(odd_units=other.odd))
            self.link = BytesLink(real, self.pipe_kind)
            self.line = self.line_of(design, tell)
            real.attach(self.line)
        self.ports = [
            RtuControllerPort(
                plan, self.line, RtuRequestDecoder(odd_units=other.odd), 0, self.port_wire, beats=Beats()
            )
            for plan in design.controllers
        ]
        self.make_pipes(self.port_pipe_kind)
        for pipe in (*self.pipes, self.link.pipe):
            assert isinstance(pipe, WirePipe)
            pipe.is_high_first = self.is_high_first
        for number in range(len(self.ports)):
            self.open_port(number, 0)
        self.lens = Lens(self.roots(), TICK_NS, design.horizon_ticks, has_record=design.has_record)

    def encode(self, unit_id: int, pdu: bytes) -> bytes:
        """Return the frame of a PDU as it is on the wires of this side."""
        return encode_rtu(unit_id, on_the_wire(pdu, is_high_first=self.is_high_first))

    def line_of(self, design: Design, tell: Callable[[Event], None]) -> TimedLine:
        """Return the line."""
        other = ODD if "odd" in design.happenings else NO_OTHER_UNITS
        return TimedLine(design.plans, TIMING, self.link, tell, design.groups, other_units=other)

    def roots(self) -> list[object]:
        """Return what all that is kept hangs from."""
        return [self.line, *self.ports, *self.pipes, self.link]

    def open_port(self, number: int, now_ns: int) -> None:
        """Open the port of a controller."""
        port = self.ports[number]
        with timers_at_rest():
            port.opened(self.pipes[number], now_ns)
        let_go(port._wire_writer)
        port.stamps = Stamps()  # of replies that are cut through the instants count, and none is the world's

    def open(self, now_ns: int) -> None:
        """See ``BytesSide``."""
        self.line.world_ns = now_ns
        self.link.opened(now_ns)

    def feed(self, port: int, data: bytes, now_ns: int) -> None:
        """See ``BytesSide``."""
        self.line.world_ns = now_ns
        self.ports[port].received(data, now_ns)

    def hear(self, data: bytes, now_ns: int) -> None:
        """Bytes of the drives."""
        self.line.world_ns = now_ns
        super().hear(data, now_ns)

    def fall_silent(self, now_ns: int) -> None:
        """Let the silences pass that are waited for."""
        self.line.world_ns = now_ns
        for timer in (*(port._timer for port in self.ports), self.link.real._timer):
            pass_by(timer)

    def request(self, port: int, transaction_id: int, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """See ``Side``."""
        self.feed(port, self.encode(unit_id, pdu), now_ns)

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """See ``Side``."""
        self.hear(self.encode(unit_id, pdu), now_ns)

    def stray(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """See ``Side``."""
        self.reply(unit_id, pdu, now_ns)


class RtuWorld(BytesWorld):
    """A world whose controller and drives speak RTU, whole frames or not."""

    def side_of(self, ways: dict[str, int], tell: Callable[[Event], None]) -> Side:
        """See ``World``."""
        return RtuSide(self.design, tell)

    @property
    def _wire_side(self) -> RtuSide:
        side = self.sides[0]
        assert isinstance(side, RtuSide)
        return side

    def _number_anew(self) -> None:
        """There are no numbers."""

    def _collect(self, answered: Wire | None = None, reply: bytes = b"") -> None:
        """An answer is for what was asked last: whatever came before it was given up with it."""
        for asked, replies in zip(self.state.asked, self.sides[0].replies, strict=True):
            newest = asked[-1].transaction_id if asked else NUMBERLESS
            replies[:] = [(newest, pdu) for _, pdu in replies]
        super()._collect(answered, reply)

    def happenings(self) -> list[Happening]:
        """See ``World``."""
        design, state = self.design, self.state
        found = super().happenings()
        if "spoil" in design.happenings and not state.half:
            found += [("spoil", *each[1:]) for each in found if each[0] == "ask"]
        if "odd" in design.happenings and not state.half:
            found += [("odd", front, *each[1:]) for each in found if each[0] == "ask" for front in ODD_FRONTS]
        wire, late = state.wire, state.late
        if late is not None and wire is not None:
            found = [each for each in found if each[0] != "late"]
            if not wire.is_obeyed and self._is_another(wire, self.reply_to(late)):
                found += [(each,) for each in ("late", "late_glued") if each in design.happenings]
        if state.is_misled:  # of a reply of another size a line only knows that no other comes in time
            found = [each for each in found if each[0] in ("drive", "ask") and each[1] != "obey"]
        return found

    def _on_spoil(self, port: int, name: str, axis: int, number: int = 0) -> None:
        """A request comes with a bad check sum: its controller gives it up, and nothing of it counts."""
        data = self._wire_side.encode(self.design.plans[axis].unit_id, self.pdu(name, number))
        self._give_up(port)
        self._wire_side.feed(port, data[:-1] + bytes((data[-1] ^ 0x5A,)), self.now_ns)
        self._wire_side.fall_silent(self.now_ns)
        self._collect()

    def _on_odd(self, front: str, port: int, name: str, axis: int, number: int = 0) -> None:
        """A request comes in one read behind an odd frame, which its controller gives up with it (W5).

        However it is told from that, it leaves once, and nothing else does.
        """
        self._give_up(port)
        _, data = self._register_rtu(name, axis, number)
        self._wire_side.feed(port, ODD_FRONTS[front] + data, self.now_ns)
        self._wire_side.fall_silent(self.now_ns)
        self._collect()

    def _on_half(self, port: int, name: str, axis: int, number: int = 0) -> None:
        """The first bytes of a request come; it is its controller's newest one when it is whole."""
        self.state = self.state._replace(half=(name, axis, number, 0))
        data = self._wire_side.encode(self.design.plans[axis].unit_id, self.pdu(name, number))
        self._wire_side.feed(port, data[:CUT], self.now_ns)
        self._collect()

    def _on_tail(self) -> None:
        """The rest of it comes. After a silence it is no request, and its controller gives it up."""
        name, axis, number, ticks = self.state.half
        self.state = self.state._replace(half=())
        self._give_up(0)
        if ticks:
            data = self._wire_side.encode(self.design.plans[axis].unit_id, self.pdu(name, number))
        else:
            _, data = self._register_rtu(name, axis, number)
        self._wire_side.feed(0, data[CUT:], self.now_ns)
        if ticks:
            self._wire_side.fall_silent(self.now_ns)
        self._collect()

    def _register_rtu(self, name: str, axis: int, number: int = 0) -> tuple[int, bytes]:
        transaction_id, _ = self._register(name, axis, number)
        return transaction_id, self._wire_side.encode(self.design.plans[axis].unit_id, self.pdu(name, number))

    def _on_pair(self, one: Happening, other: Happening) -> None:
        """Two requests come in one read: with the second one its controller gives the first one up (W5)."""
        self._give_up(0)
        _, first = self._register_rtu(*one)
        self._give_up(0)
        _, second = self._register_rtu(*other)
        self._wire_side.feed(0, first + second, self.now_ns)
        self._collect()

    def _on_drive(self, what: str) -> None:
        wire = self.state.wire
        assert wire is not None
        if what == "spoil":  # it obeys, and its reply has a bad check sum
            self.state = self.state._replace(wire=wire._replace(is_obeyed=True))
            data = self._wire_side.encode(wire.unit_id, self._obey(wire))
            self._wire_side.hear(data[:-1] + bytes((data[-1] ^ 0x5A,)), self.now_ns)
            self._collect()
            return
        if what == "twice":
            self._answer_with(wire, lambda frame: frame + frame)
            return
        self.state = self.state._replace(is_misled=False)
        super()._on_drive(what)

    def _answer_with(self, wire: Wire, bytes_of: Callable[[bytes], bytes]) -> None:
        """The drive acknowledges, with more bytes in the same read."""
        self.state = self.state._replace(wire=None, is_misled=False)
        reply = self._obey(wire)
        self._wire_side.hear(bytes_of(self._wire_side.encode(wire.unit_id, reply)), self.now_ns)
        self._collect(answered=wire, reply=reply)
        if wire.aim is not None:
            self._on_wait()

    def _on_late(self) -> None:
        wire, late = self.state.wire, self.state.late
        assert late is not None
        if wire is not None:
            is_misled = self.reply_to(late)[0] == wire.pdu[0]
            self.state = self.state._replace(is_misled=is_misled)
        super()._on_late()

    def _on_late_glued(self) -> None:
        """A late reply comes in one read with the one that is waited for."""
        wire, late = self.state.wire, self.state.late
        assert wire is not None
        assert late is not None
        before = self._wire_side.encode(late.unit_id, self.reply_to(late))
        self.state = self.state._replace(late=None)
        self._answer_with(wire, lambda frame: before + frame)

    def _on_split(self) -> None:
        """The drive obeys, and the first bytes of its reply come."""
        wire = self.state.wire
        assert wire is not None
        reply = self._obey(wire)
        self.state = self.state._replace(wire=wire._replace(is_obeyed=True), split=(wire.unit_id, reply))
        self._wire_side.hear(self._wire_side.encode(wire.unit_id, reply)[:CUT], self.now_ns)
        self._collect()

    def _on_reply_tail(self) -> None:
        """The rest of it comes; after a silence it is part of nothing."""
        wire = self.state.wire
        assert self.state.split
        unit_id, reply = self.state.split
        self.state = self.state._replace(split=())
        is_whole = wire is not None and wire.is_obeyed and not self.state.is_cut_off
        if is_whole:
            self.state = self.state._replace(wire=None)
        self.state = self.state._replace(is_cut_off=False)
        self._wire_side.hear(self._wire_side.encode(unit_id, reply)[CUT:], self.now_ns)
        if not is_whole:
            self._collect()
            return
        assert wire is not None
        self._collect(answered=wire, reply=reply)
        if wire.aim is not None:
            self._on_wait()

    def _on_wait(self, _axis: int = 0) -> None:
        self._wire_side.fall_silent(self.now_ns)
        if self.state.split:
            self.state = self.state._replace(is_cut_off=True)
        self._wire_side.line.world_ns = self.now_ns + TICK_NS
        super()._on_wait()


__all__ = ["RtuWorld", "World"]
