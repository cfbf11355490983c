"""Worlds that begin at bytes: the real ports, links and decoders of Modbus/TCP around the same small world.

A request comes in two pieces, or two in one read; so does a reply, and one that is late comes while the next
request is out. What is not here: the silences of a wire and of a drive, which the links keep with timers of
the system (``gateway.relay.pacing``): a frame leaves at once. Numbers of frames only grow, and are compared
with each other alone: where none is out and none may come late they begin anew.

Ports, links, senders and timers are those of the gateway as they are, for compiled classes take no others in
their place, and few have classes of Python derived from them. No timer of theirs ever rings by itself.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, Final
from unittest import mock

from gateway.exchange.events import Event
from gateway.exchange.line import LineExchange
from gateway.exchange.ports import ControllerPort as AnyPort
from gateway.exchange.ports import DriveLink
from gateway.modbus.mbap import MbapCounters, MbapDecoder, encode_mbap
from gateway.relay.controller_port import MbapControllerPort
from gateway.relay.drive_link import NONE, MbapDriveLink, RtuDriveLink
from gateway.relay.pacing import WireWriter
from gateway.relay.pulse import Beats
from gateway.transport.channel import Channel
from gateway.transport.timer import Timer
from tests.verify import rules
from tests.verify.snapshot import Lens
from tests.verify.world import TICK_NS, TIMING, Asked, Design, Happening, Side, Wire, World

NOBODY: Final = 0xFFFF
"""The number of a late reply to a request of a connection before."""
CUT: Final = 9
"""So many bytes of a request come first: its header, its function code, a byte of its address."""
REPLY_CUT: Final = 8
"""A silence that is over, whatever was heard: the clock of a sender is not that of a world."""
NO_DESCRIPTOR: Final = -1


class NoLoop:
    """In the place of the loop that wakes timers."""

    def add_reader(self, _fd: int, _callback: Callable[[], None]) -> None:
        """Nobody is woken."""


@contextmanager
def timers_at_rest() -> Iterator[None]:
    """Timers that are made meanwhile keep their deadline, and that is all."""
    with (
        mock.patch("gateway.transport.timer.create_timer", return_value=NO_DESCRIPTOR),
        mock.patch("asyncio.get_running_loop", NoLoop),
    ):
        yield


def pass_once(timer: Timer) -> None:
    """Let the time of a timer come."""
    deadline_ns = timer.deadline_ns
    assert deadline_ns is not None
    timer.arm(None)
    timer._callback(deadline_ns)


def pass_by(timer: Timer) -> None:
    """Let every time pass that is waited for."""
    while timer.deadline_ns is not None:
        pass_once(timer)


def let_go(wire: WireWriter) -> None:
    """Let a wire that was opened need no silence, and not the one at its beginning either."""
    wire._gap_ns = 0
    wire.stamps.next_ns = 0


class Pipe(Channel):
    """One open connection, which takes apart what is written to it."""

    def __init__(self, take: Callable[[int, int, bytes], None]) -> None:
        self._take = take
        self.peer = ""
        self.is_closed = False

    def write(self, data: bytes) -> None:
        """See ``Channel``."""
        frames = MbapDecoder().feed(data)
        assert len(frames) == 1, data.hex(" ")
        self._take(*frames[0])

    def has_gone(self, *, asks: bool) -> bool:
        """See ``Channel``."""
        return False

    def close(self) -> None:
        """See ``Channel``."""
        self.is_closed = True


class BytesLink(DriveLink):
    """A real link, and what left over it and is not waited for any more."""

    def __init__(self, link: MbapDriveLink | RtuDriveLink, pipe: type[Pipe] = Pipe) -> None:
        super().__init__(is_serial=link.is_serial)
        self.real = link
        self.sent: list[tuple[int, bytes]] = []
        self.is_abandoned = False
        self.pipe = pipe(lambda _number, unit_id, pdu: self.sent.append((unit_id, pdu)))

    @property
    def is_awaiting(self) -> bool:
        """Whether a reply is waited for."""
        link = self.real
        if isinstance(link, RtuDriveLink):
            return link._decoder.is_expecting
        return link._awaited_id != NONE

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        """See ``DriveLink``."""
        self.real.send_request(unit_id, pdu)

    def abandon(self) -> None:
        """See ``DriveLink``."""
        self.is_abandoned |= self.is_awaiting
        self.real.abandon()

    def may_forward(self, now_ns: int) -> bool:
        """See ``DriveLink``."""
        return self.real.may_forward(now_ns)

    def forward(self, piece: bytes) -> None:
        """See ``DriveLink``."""
        self.real.forward(piece)

    def forward_last(self, unit_id: int, pdu: bytes, rest: bytes) -> None:
        """See ``DriveLink``."""
        self.real.forward_last(unit_id, pdu, rest)

    def opened(self, now_ns: int) -> None:
        """See ``Receiver``."""
        self.real.opened(self.pipe, now_ns)
        let_go(self.real._wire)


class TimedLine(LineExchange):
    """A line to which everything comes at an instant of the world.

    ``world_ns``: that instant; 0: when ports and link say.
    """

    world_ns = 0

    def request(
        self,
        port: AnyPort,
        transaction_id: int,
        unit_id: int,
        pdu: bytes,
        now_ns: int,
        *,
        why_given_up: str = "",
    ) -> None:
        """See ``LineExchange``."""
        now_ns = self.world_ns or now_ns
        super().request(port, transaction_id, unit_id, pdu, now_ns, why_given_up=why_given_up)

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """See ``LineExchange``."""
        super().reply(unit_id, pdu, self.world_ns or now_ns)

    def stray(self, now_ns: int, *, unit_id: int = -1) -> None:
        """See ``LineExchange``."""
        super().stray(self.world_ns or now_ns, unit_id=unit_id)

    def link_up(self, now_ns: int) -> None:
        """See ``LineExchange``."""
        super().link_up(self.world_ns or now_ns)

    def link_down(self, now_ns: int, reason: str = "", *, is_orderly: bool = False) -> None:
        """See ``LineExchange``."""
        super().link_down(self.world_ns or now_ns, reason, is_orderly=is_orderly)


def _keep(replies: list[tuple[int, bytes]], number: int, _unit_id: int, pdu: bytes) -> None:
    replies.append((number, pdu))


class BytesSide(Side):
    """One gateway whose ports and link are the real ones."""

    line: TimedLine
    link: Any

    def __init__(self, design: Design, tell: Callable[[Any], None]) -> None:
        with timers_at_rest():
            real = MbapDriveLink(0)
            self.link = BytesLink(real)
            self.line = TimedLine(design.plans, TIMING, self.link, tell, design.groups)
        real.attach(self.line)
        self.ports = [
            MbapControllerPort(plan, self.line, MbapCounters(), lambda _peer: None, beats=Beats())
            for plan in design.controllers
        ]
        self.make_pipes(Pipe)
        roots = [self.line, *self.ports, *self.pipes, self.link]
        self.lens = Lens(roots, TICK_NS, design.horizon_ticks)

    def make_pipes(self, kind: type[Pipe]) -> None:
        """Give each controller a connection, and keep what it is answered."""
        self.replies = [[] for _ in self.ports]
        self.pipes = [kind(partial(_keep, replies)) for replies in self.replies]

    def number(self, *, is_late: bool) -> int:
        """Return the number of the request that is out, or of the newest that was given up."""
        link: MbapDriveLink = self.link.real
        if not is_late and link._awaited_id != NONE:
            return link._awaited_id
        return next(reversed(link._unanswered), NOBODY)

    def open(self, now_ns: int) -> None:
        """Open every connection."""
        self.link.opened(now_ns)
        for port in range(len(self.ports)):
            self._open(port, now_ns)

    def _open(self, port: int, now_ns: int) -> None:
        self.pipes[port].is_closed = False
        self.ports[port]._decoder = MbapDecoder(MbapCounters())
        self.ports[port].unfinished_ns = 0
        self.ports[port].opened(self.pipes[port], now_ns)

    def feed(self, port: int, data: bytes, now_ns: int) -> None:
        """Bytes of a controller."""
        self.ports[port].received(data, now_ns)

    def hear(self, data: bytes, now_ns: int) -> None:
        """Bytes of the drives."""
        self.link.real.received(data, now_ns)

    def request(self, port: int, transaction_id: int, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """See ``Side``."""
        self.feed(port, encode_mbap(transaction_id, unit_id, pdu), now_ns)

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """See ``Side``."""
        self.hear(encode_mbap(self.number(is_late=False), unit_id, pdu), now_ns)

    def stray(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """See ``Side``."""
        self.hear(encode_mbap(self.number(is_late=True), unit_id, pdu), now_ns)

    def gone(self, port: int, now_ns: int) -> None:
        """See ``Side``."""
        self.ports[port].closed("", now_ns)
        self._open(port, now_ns)


class BytesWorld(World):
    """A world whose controllers and drive speak in bytes, whole frames or not."""

    def side_of(self, ways: dict[str, int], tell: Callable[[Event], None]) -> Side:
        """See ``World``."""
        return BytesSide(self.design, tell)

    def _call(self, name: str, *args: Any) -> None:
        if name == "link_up":
            for side in self.sides:
                assert isinstance(side, BytesSide)
                side.open(*args)
            return
        super()._call(name, *args)

    @property
    def _side(self) -> BytesSide:
        side = self.sides[0]
        assert isinstance(side, BytesSide)
        return side

    def happen(self, event: Happening) -> None:
        """See ``World``."""
        super().happen(event)
        self._number_anew()

    def _number_anew(self) -> None:
        """Let the numbers of frames begin at 1 again: only which of them are the same counts."""
        state, link = self.state, self._side.link.real
        buffer = link._decoder._buffer
        split = int.from_bytes(buffer[:2], "big") if state.split else 0
        late = self._side.number(is_late=True) if state.late is not None else 0
        asked = dict(link._unanswered)
        kept = [each for each in asked if each in (split, late)]
        if link._awaited_id != NONE:
            kept.append(link._awaited_id)
        numbers = {before: number for number, before in enumerate(kept, 1)}
        link._last_id = len(kept)
        if link._awaited_id != NONE:
            link._awaited_id = numbers[link._awaited_id]
        link._unanswered.clear()
        link._unanswered.update(
            (numbers[each], asked[each]) for each in kept if numbers[each] != link._awaited_id
        )
        if state.split:
            link._decoder._buffer = numbers.get(split, NOBODY).to_bytes(2, "big") + buffer[2:]

    def happenings(self) -> list[Happening]:
        """See ``World``."""
        design, state = self.design, self.state
        found = super().happenings()
        asks = [each for each in found if each[0] == "ask"]
        if state.half:
            found = [each for each in found if each[0] not in ("ask", "disconnect")] + [("tail",)]
        elif "half" in design.happenings:
            found += [("half", *each[1:]) for each in asks]
        if "pair" in design.happenings and not state.half and not state.asked[0]:
            found += [("pair", one[2:], other[2:]) for one in asks for other in asks]
        if state.split:  # in a stream of bytes nothing overtakes it
            found = [each for each in found if each[0] not in ("drive", "late")] + [("reply_tail",)]
        elif "split" in design.happenings and state.wire is not None and not state.wire.is_obeyed:
            found.append(("split",))
        return found

    def _register(self, name: str, axis: int, number: int = 0, ticks: int = 0) -> tuple[int, bytes]:
        """Let a request be one that its controller waits for; return its number and its bytes."""
        pdu = self.pdu(name, number)
        taken = {each.transaction_id for each in self.state.asked[0]}
        taken.update(given for owner, given in self.state.given_up if owner == 0)
        transaction_id = next(i for i in range(1, 99) if i not in taken)
        is_owed = self.state.axes[axis].hush_ticks > 0
        asked = (*self.state.asked[0], Asked(pdu, transaction_id, ticks=ticks, axis=axis, is_owed=is_owed))
        order = (*self.state.order, (0, transaction_id))
        self.state = self.state._replace(asked=(asked, *self.state.asked[1:]), order=order)
        return transaction_id, encode_mbap(transaction_id, self.design.plans[axis].unit_id, pdu)

    def _on_half(self, port: int, name: str, axis: int, number: int = 0) -> None:
        """The first bytes of a request come; its controller waits for an answer from now on."""
        before = self.state
        _, data = self._register(name, axis, number)
        self.state = before._replace(half=(name, axis, number, 0))
        self._side.feed(port, data[:CUT], self.now_ns)
        self._collect()

    def _on_tail(self) -> None:
        """The rest of it comes. A request that took too long is not sent, and ends the connection (W5)."""
        name, axis, number, ticks = self.state.half
        self.state = self.state._replace(half=())
        _, data = self._register(name, axis, number, ticks)
        self._side.feed(0, data[CUT:], self.now_ns)
        self._collect()
        if self._side.pipes[0].is_closed:
            self._on_disconnect(0)

    def _on_pair(self, one: Happening, other: Happening) -> None:
        """Two requests come in one read."""
        data = b"".join(self._register(*each)[1] for each in (one, other))
        self._side.feed(0, data, self.now_ns)
        self._collect()

    def _on_split(self) -> None:
        """The drive obeys, and the first bytes of its reply come."""
        wire = self.state.wire
        assert wire is not None
        reply = self._obey(wire)
        data = encode_mbap(self._side.number(is_late=False), wire.unit_id, reply)
        self.state = self.state._replace(wire=wire._replace(is_obeyed=True), split=(wire.unit_id, reply))
        self._side.hear(data[:REPLY_CUT], self.now_ns)
        self._collect()

    def _on_reply_tail(self) -> None:
        """The rest of it comes: in time, or when nobody waits for it any more."""
        wire = self.state.wire
        assert self.state.split
        reply = self.state.split[1]
        self.state = self.state._replace(split=())
        is_awaited = wire is not None and wire.is_obeyed
        rest = encode_mbap(0, 0, reply)[REPLY_CUT:]
        if is_awaited:
            assert wire is not None
            self.state = self.state._replace(wire=None)
        self._side.hear(rest, self.now_ns)
        if is_awaited:
            self._collect(answered=wire, reply=reply)
            if wire is not None and wire.aim is not None:
                self._on_wait()
        else:
            self._collect()

    def _on_wait(self, _axis: int = 0) -> None:
        if self.state.half:
            *what, ticks = self.state.half
            self.state = self.state._replace(half=(*what, min(ticks + 1, rules.PATIENCE_TICKS + 2)))
        super()._on_wait()

    def _on_disconnect(self, port: int) -> None:
        self.state = self.state._replace(half=())
        super()._on_disconnect(port)


def world_of(design: Design) -> World:
    """Return the world of a design."""
    if design.is_cut:
        from tests.verify.wires_cut import ForwardingWorld

        return ForwardingWorld(design)
    if design.is_rtu:
        from tests.verify.wires_rtu import RtuWorld

        return RtuWorld(design)
    return BytesWorld(design) if design.is_bytes else World(design)


__all__ = ["BytesWorld", "Wire", "world_of"]
