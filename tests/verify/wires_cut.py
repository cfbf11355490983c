"""Worlds in which requests and replies leave while they arrive: the real forwarders, bytes in pieces.

What is abstracted, beside what :mod:`tests.verify.wires_rtu` says: the pieces of a frame come at one instant,
and its first byte leaves with a delay of 1 ns. So each piece comes before the delay is over or after it, as
the world has it, and in time unless the world lets the forwarder's deadline pass (``stall``). What ports need
is not learned, and whether it pays is not weighed: both would go on for ever, and are forgotten with each
event.

A witness on each wire (:class:`ForwardingPipe`) takes apart what leaves, and knows nothing of forwarders.

A controller whose reply was spoilt has heard nothing, and gives its request up; the gateway counts the reply.
"""

from collections.abc import Callable, Iterable
from typing import Any, Final

from gateway.exchange.cut_through.delay import (
    FrameShape,
    MeasuredDelay,
    acknowledgement_shape,
    margin_ns,
    read_shape,
    reply_shape,
    write_shape,
)
from gateway.exchange.cut_through.forward import Forwarding, RequestWay
from gateway.exchange.cut_through.forward import SerialTiming as LineWire
from gateway.exchange.cut_through.frame import ForwardEvent, ForwardState
from gateway.exchange.cut_through.replies import Passed
from gateway.exchange.events import Event
from gateway.exchange.ports import ControllerPort
from gateway.exchange.transaction import Phase
from gateway.modbus.crc import INTACT, INVERTED, SEAM, residue_after
from gateway.modbus.pdu import EXCEPTION_BIT
from tests.verify import rules
from tests.verify.errors import BrokenRuleError
from tests.verify.snapshot import Lens, on_its_way
from tests.verify.wires import TimedLine, pass_by, pass_once
from tests.verify.wires_rtu import CUT, RtuSide, RtuWorld, WirePipe
from tests.verify.world import EXCEPTION, TAKES_TIME, TICK_NS, TIMING, Design, Happening, Wire

CHAR_NS: Final = 200_000
DRIVES: Final = LineWire(CHAR_NS, 1_750_000)
CONTROLLER: Final = LineWire(CHAR_NS, 0)
"""A silence of no length: what begins after a whole frame, at the same instant, begins after a silence."""
DELAY_NS: Final = 1
DATA: Final = 11
"""So many bytes of a write have come when its position is whole; of a read all but its check sum, nearly."""
BLOCK: Final = 0x10
READ: Final = 0x03
QUIET: Final = (
    *("half", "delay", "more", "stall", "noise", "tail_bad", "tail_odd"),
    *("split", "reply_delay", "reply_more", "reply_stall", "reply_bad"),
)
"""Events with which no request and no reply is whole: they change no axis."""
ENDS: Final = tuple(f"{name} {event.value}" for name in ("request", "reply") for event in ForwardEvent)
CUTS_OFF: Final = ("unplug", "kill", "kill_bare")
"""After these nothing of a request follows on what has left."""
CUTS_REPLY_OFF: Final = ("disconnect", "kill", "kill_bare")
"""The same of a reply."""


def steady(*shapes: FrameShape) -> dict[FrameShape, MeasuredDelay]:
    """Return the delays of a port that was measured before."""
    delays = {shape: MeasuredDelay(shape, CHAR_NS, CHAR_NS, margin_ns(CHAR_NS)) for shape in shapes}
    for delay in delays.values():
        delay.delay_ns = DELAY_NS
    return delays


def forget_measured(way: RequestWay) -> None:
    """What requests begin like, and what is answered, stays; how they come and what they gain is known.

    Ports learn from a frame when the next one begins, which is after this. Of what is answered only the data
    fill up, and no more than their length counts, and that they begin with 00. The next position is expected
    near the one before: where it begins otherwise its first byte waits.
    """
    way.forwarder._came = None
    heads, replies = way.heads, way.replies
    heads._gains.clear()
    heads._stored.clear()
    replies._stored.clear()
    for key, (frame, _) in replies._passed.items():
        replies._passed[key] = Passed(frame[:3] + bytes(len(frame) - 3), reach=0)
    for beginning, expected in heads._expected.items():
        if expected is not None:
            heads._expected[beginning] = expected._replace(reach=0)


def request_length_of(frame: bytes) -> int:
    """Return how long a request will be of which some bytes have left, as drives reckon.

    >>> request_length_of(bytes.fromhex("01 03")), request_length_of(bytes.fromhex("01 10 06 06 00 02 04"))
    (8, 13)
    """
    if len(frame) < 2 or frame[1] != BLOCK:
        return 8
    return 9 + frame[6] if len(frame) > 6 else 9


def reply_length_of(frame: bytes) -> int:
    """The same of a reply, as controllers reckon.

    >>> [reply_length_of(bytes.fromhex(each)) for each in ("01 03", "01 03 04", "01 10 06 06", "01 83")]
    [5, 9, 8, 5]
    """
    if len(frame) < 2 or frame[1] >= EXCEPTION_BIT:
        return 5
    if frame[1] != READ:
        return 8
    return 5 + frame[2] if len(frame) > 2 else 5


class ForwardingPipe(WirePipe):
    """The wire of the drives: each frame on it is whole, or is none and has its full length (W3)."""

    length_of: Callable[[bytes], int] = staticmethod(request_length_of)

    def __init__(self, take: Callable[[int, int, bytes], None]) -> None:
        super().__init__(take)
        self.leaving = b""
        """What has left of a frame that is not whole."""
        self.needs_silence = False
        """A spoilt frame was the last one."""
        self.ends: list[str] = []
        """How frames have ended since the last event of the world began."""
        self.written: list[bytes] = []
        """What was written since that was looked at."""

    def write(self, data: bytes) -> None:
        """See ``Channel``. Raises BrokenRuleError."""
        if self.needs_silence:
            raise BrokenRuleError(f"no silence behind a spoilt frame: {data.hex(' ')} (W12)")
        self.written.append(data)
        frame = self.leaving = self.leaving + data
        residue, length = residue_after(frame), self.length_of(frame)
        if len(frame) < length:
            if residue in (INTACT, SEAM):
                raise BrokenRuleError(f"what has left may be a frame: {frame.hex(' ')} (W12)")
            return
        if len(frame) > length or residue not in (INTACT, INVERTED):
            raise BrokenRuleError(f"neither a frame nor one that was spoilt: {frame.hex(' ')} (W12)")
        self.leaving = b""
        self.needs_silence = residue == INVERTED
        self.ends.append("spoilt" if self.needs_silence else "whole")
        if not self.needs_silence:
            super().write(frame)

    def break_off(self) -> None:
        """It was lost: what comes later comes after a long silence."""
        self.leaving = b""
        self.needs_silence = False


class ReplyPipe(ForwardingPipe):
    """The wire of a controller. Nothing is said at once behind a spoilt reply."""

    length_of = staticmethod(reply_length_of)


class ForwardingSide(RtuSide):
    """One gateway between two serial lines that cuts requests and replies through."""

    pipe_kind = ForwardingPipe
    port_pipe_kind = ReplyPipe
    port_wire = CONTROLLER

    def __init__(self, design: Design, tell: Callable[[Event], None]) -> None:
        self._ways: dict[ControllerPort, RequestWay] = {}
        super().__init__(design, tell)

    def line_of(self, design: Design, tell: Callable[[Event], None]) -> TimedLine:
        """See ``RtuSide``."""
        return TimedLine(design.plans, TIMING, self.link, tell, design.groups, cut_through=DRIVES)

    def open_port(self, number: int, now_ns: int) -> None:
        """See ``RtuSide``. What follows its requests is that of before, emptied; it knows how they come."""
        super().open_port(number, now_ns)
        port, forwarding = self.ports[number], self.line.forwarding
        assert forwarding is not None
        way = self._ways.get(port)
        if way is None:
            way = self._ways[port] = forwarding._ways[port]
            write, position = write_shape(2, 0, 2, is_early=True), reply_shape(2, [(0, 2)], [0])
            assert write.late is not None
            assert position.late is not None
            way.heads.delays.measured |= steady(read_shape(), write, write.late)
            way.replies.delays.measured |= steady(
                acknowledgement_shape(), reply_shape(1), position, position.late
            )
        way.heads._expected.clear()
        way.heads._pages.clear()
        way.replies._passed.clear()
        way.forwarder.drop()
        forwarding._ways[port] = way
        port._forwarder = way.forwarder

    def roots(self) -> list[object]:
        """See ``RtuSide``."""
        return [*super().roots(), *(self._ways[port].replies for port in self.ports)]

    def fall_silent(self, now_ns: int) -> None:
        """See ``RtuSide``: forwarders are the first to miss what does not come.

        What has begun to come and stands still since is stored: with the next byte its forwarder sees that.
        """
        self.line.world_ns = now_ns
        for each in (*self.ports, self.link.real):
            pass_by(each._forward_timer)
        if any(pipe.leaving for pipe in (*self.wires, self.link.pipe)):
            raise BrokenRuleError("a frame stands still in the middle, and is not filled up (W12)")
        super().fall_silent(now_ns)
        for pipe in (*self.wires, self.link.pipe):
            pipe.needs_silence = False
        for port in self.ports:
            frame = port._forwarder._frame
            if frame is not None and frame.state is ForwardState.BEGUN:
                port._forwarder.drop()

    def gone(self, port: int, now_ns: int) -> None:
        """See ``Side``."""
        self.line.world_ns = now_ns
        self.ports[port].closed("", now_ns)
        self.wires[port].break_off()
        self.open_port(port, now_ns)

    def drop_what_is_over(self) -> None:
        """Let go of what nothing is asked of any more, so that states need not differ.

        Of frames that have ended; of bytes that answer nothing, which wait, 256 of them, to be a late frame,
        and no frame is late here; of timers that would ring in vain.
        """
        self.link.real._decoder._stray = b""
        self.forwarding.drives._came = None
        for port in self.ports:
            forget_measured(self._ways[port])
            if port._forwarder._frame is not None and port._forwarder._frame.is_over:
                port._forwarder.drop()
        drives, way = self.forwarding.drives, self.forwarding._reply_way
        transaction = way._transaction
        if transaction is not None and transaction.phase is not Phase.SENT:
            way._transaction = way._judge = None
            drives.drop()
        is_for_nobody = transaction is not None and transaction.is_orphan
        if is_for_nobody and drives._frame is not None and drives._frame.is_over:
            self.drop_reply()  # for nobody no other one begins
        followed = [(port, port._forwarder) for port in self.ports]
        for each, forwarder in (*followed, (self.link.real, drives)):
            if forwarder.deadline_ns is None:
                each._forward_timer.arm(None)

    def drop_reply(self) -> None:
        """Let go of the reply that arrives, or came last."""
        self.forwarding._reply_way._judge = None
        self.forwarding.drives.drop()

    @property
    def wires(self) -> list[ForwardingPipe]:
        """Of the controllers."""
        return [pipe for pipe in self.pipes if isinstance(pipe, ForwardingPipe)]

    @property
    def forwarding(self) -> Forwarding:
        """Of the line."""
        assert self.line.forwarding is not None
        return self.line.forwarding

    @property
    def pipe_of_reply(self) -> ForwardingPipe | None:
        """The wire on which a reply leaves, as the line has it."""
        frame, transaction = self.forwarding.drives._frame, self.forwarding._reply_way._transaction
        if frame is None or not frame.is_on_the_way:
            return None
        assert transaction is not None
        return self.wires[self.ports.index(transaction.port)]

    def ends(self) -> tuple[int, ...]:
        """Return how often each end of ``ENDS`` was met so far by a frame of which bytes had left."""
        return tuple(
            totals.ended[event] - totals.stored[event]
            for totals in (self.forwarding.requests, self.forwarding.replies)
            for event in ForwardEvent
        )

    def cut_off(self, now_ns: int) -> None:
        """The way to the drives is lost."""
        self.line.world_ns = now_ns
        self.link.real.closed("", now_ns)
        self.link.pipe.break_off()


class ForwardingWorld(RtuWorld):
    """A world whose requests come in pieces, and leave so where they may."""

    def __init__(self, design: Design) -> None:
        super().__init__(design)
        side = self._forwarding_side
        axes = {id(each) for each in Lens(side.line.axes, TICK_NS, design.horizon_ticks).objects}
        self._of_axes = tuple(i for i, each in enumerate(side.lens.objects) if id(each) in axes)

    def side_of(self, ways: dict[str, int], tell: Callable[[Event], None]) -> ForwardingSide:
        """See ``World``."""
        return ForwardingSide(self.design, tell)

    @property
    def _forwarding_side(self) -> ForwardingSide:
        side = self.sides[0]
        assert isinstance(side, ForwardingSide)
        return side

    @property
    def is_leaving(self) -> bool:
        """Whether the line says that a request is leaving."""
        found = on_its_way(self._forwarding_side.line)
        return found is not None and found.phase is Phase.LEAVING

    @property
    def is_replying(self) -> bool:
        """Whether a reply is leaving."""
        return self._forwarding_side.pipe_of_reply is not None

    # --- what can happen -------------------------------------------------------------------------------

    def happenings(self) -> list[Happening]:
        """See ``World``. Where there are two axes one controller only stops, and the other one never does."""
        found = self._anything()
        if len(self.design.plans) < 2:
            return found
        return [e for e in found if e[0] not in ("ask", "half") or (e[2] == "stop") == (e[1] == 1)]

    def _anything(self) -> list[Happening]:
        design, state = self.design, self.state
        found = [each for each in super().happenings() if each[0] != "half" or each[1] == 0]
        if not self._has_begun_to_reply:
            found += self._odd_replies()
        else:
            if "again" not in design.happenings:  # who heard a spoilt one asks again when all of it has come
                found = [each for each in found if each[0] not in ("ask", "half") or each[1]]
            found += self._while_replying()
        if not state.half:
            return found
        *_, ticks = state.half
        for port in range(1, len(design.controllers)):
            if len(state.asked[port]) < design.most_asked:
                found += [("ask", port, *each) for each in self._requests()]
        if "disconnect" in design.happenings:
            found.append(("disconnect", 0))
        if ticks:
            return found
        if "tail_bad" in design.happenings:
            found.append(("tail_bad",))
            if state.come == CUT and state.half[0] == "to":
                found.append(("tail_odd",))
        if state.come == CUT:
            found.append(("more",))
        if "anew" in design.happenings:
            found += [("anew", *each) for each in self._requests()]
        if self.is_leaving and "stuck" in design.happenings:
            found += [("stuck", *each) for each in self._requests()]
        is_waited_for = self._forwarding_side.ports[0]._forward_timer.deadline_ns is not None
        if is_waited_for:
            found.append(("stall",) if self.is_leaving else ("delay",))
        if self.is_leaving and "noise" in design.happenings:
            found.append(("noise",))
        return found

    @property
    def _has_begun_to_reply(self) -> bool:
        wire = self.state.wire
        return bool(self.state.split) or (wire is not None and wire.is_obeyed)

    def _odd_replies(self) -> list[Happening]:
        """What else than an acknowledgement can begin to come."""
        wire = self.state.wire
        if wire is None or "split_odd" not in self.design.happenings:
            return []
        refused: list[Happening] = [("split", "refuse")] if wire.owner >= 0 else []
        return refused + ([("split", "garble")] if wire.pdu[0] == BLOCK else [])

    def _while_replying(self) -> list[Happening]:
        """What else can happen while a reply comes, or after it came damaged."""
        design, state = self.design, self.state
        found: list[Happening] = [("wait",)] if "silence" in design.happenings else []
        if not state.split or state.is_cut_off:
            return found
        if "reply_bad" in design.happenings:
            found.append(("reply_bad",))
        if state.reply_come == CUT:
            found.append(("reply_more",))
        if "again" in design.happenings and state.asked[0]:
            found += [("ask", 0, *each) for each in self._requests()]
        if self._forwarding_side.link.real._forward_timer.deadline_ns is not None:
            found.append(("reply_stall",) if self.is_replying else ("reply_delay",))
        return found

    def _requests(self) -> Iterable[tuple[Any, ...]]:
        """See ``World``. Of two axes one is only stopped."""
        found = super()._requests()
        if len(self.design.plans) < 2:
            return found
        return [each for each in found if (each[0] == "stop") == (each[1] == 1)]

    # --- making it happen ------------------------------------------------------------------------------

    def happen(self, event: Happening) -> None:
        """See ``World``."""
        side = self._forwarding_side
        reply_pipe, cut_ends = side.pipe_of_reply, side.ends()
        for each in side.wires:
            each.ends.clear()
            each.needs_silence = False
        self._happen(event)
        for each in (*side.wires, side.link.pipe):
            self.tally.note(each.written)
            each.written.clear()
        ends = side.ends()
        if ends != cut_ends:
            self.tally.cuts |= {
                ENDS[i] for i, (a, b) in enumerate(zip(ends, cut_ends, strict=True)) if a != b
            }
        leaving = [each for each in side.wires if each.leaving]
        if leaving != ([] if side.pipe_of_reply is None else [side.pipe_of_reply]):
            raise BrokenRuleError(
                f"a reply is cut short: {[each.leaving.hex(' ') for each in leaving]} (W12)"
            )
        has_ended = reply_pipe is not None and not reply_pipe.leaving
        if reply_pipe is not None and has_ended and event[0] not in CUTS_REPLY_OFF and not reply_pipe.ends:
            raise BrokenRuleError("what was leaving to a controller has no end (W12)")
        for each in side.wires:
            each.ends.clear()

    def _happen(self, event: Happening) -> None:
        pipe = self._forwarding_side.link.pipe
        was_leaving, may_be_untouched = self.is_leaving, event[0] in (*QUIET, "tail")
        axes = self._axes() if may_be_untouched else ()
        pipe.ends.clear()
        super().happen(event)
        self._forwarding_side.drop_what_is_over()
        ends = tuple(pipe.ends)
        pipe.ends.clear()
        if self.is_leaving is not bool(pipe.leaving):
            raise BrokenRuleError(f"a frame is cut short: {pipe.leaving.hex(' ')} (W12)")
        if self.is_leaving and self.state.wire is not None:
            raise BrokenRuleError("a frame leaves while another one is on the wire (W6)")
        if (
            was_leaving
            and not self.is_leaving
            and event[0] not in CUTS_OFF
            and not (
                len(ends) == 1
                or (ends == ("spoilt", "whole") and event[0] in TAKES_TIME)  # behind its silence
            )
        ):
            raise BrokenRuleError(f"what was leaving has ended as {ends} (W12)")
        is_untouched = event[0] in QUIET or ends == ("spoilt",)
        if may_be_untouched and is_untouched and "whole" not in ends and axes != self._axes():
            raise BrokenRuleError("what never left whole has changed its axis (W12)")

    def _axes(self) -> tuple[int, ...]:
        """Return what is to be known of the axes."""
        tokens = self._forwarding_side.lens.take(self.now_ns).tokens
        return tuple(tokens[i] for i in self._of_axes)

    def _collect(self, answered: Wire | None = None, reply: bytes = b"") -> None:
        wire = answered if answered is not None else self.state.wire
        for number, pipe in enumerate(self._forwarding_side.wires):
            if "spoilt" in pipe.ends and wire is not None and wire.owner == number:
                self._hear_nothing(wire)
        super()._collect(answered, reply)
        if not self.state.is_up:  # over a serial port nobody is told that, and gives up (W7)
            for port in range(len(self.design.controllers)):
                self._give_up(port)

    def _hear_nothing(self, wire: Wire) -> None:
        """The controller of a request was answered with something that is no frame, and gives it up."""
        for each in self.state.asked[wire.owner]:
            if each.transaction_id == wire.transaction_id:
                self._lose(wire.owner, each)
                rules.end(self, wire.owner, each)

    def _call(self, name: str, *args: Any) -> None:
        if name == "link_down":
            self._forwarding_side.cut_off(*args)
            return
        super()._call(name, *args)

    @property
    def _missing(self) -> int:
        """How many bytes of a position need not have come for its first one to leave."""
        return self._forwarding_side.is_high_first

    def _half_bytes(self) -> bytes:
        name, axis, number, _ = self.state.half
        return self._forwarding_side.encode(self.design.plans[axis].unit_id, self.pdu(name, number))

    def _end_half(self) -> bytes:
        """Return the rest of what has begun to come; it comes now."""
        rest = self._half_bytes()[self.state.come :]
        self.state = self.state._replace(half=(), come=0)
        return rest

    def _on_half(self, port: int, name: str, axis: int, number: int = 0) -> None:
        self.state = self.state._replace(come=CUT)
        super()._on_half(port, name, axis, number)

    def _on_more(self) -> None:
        """More bytes come: of a write those of its position, but the last one where that decides less."""
        data = self._half_bytes()
        come = min(DATA - self._missing, len(data) - 1)
        piece = data[self.state.come : come]
        self.state = self.state._replace(come=come)
        self._forwarding_side.feed(0, piece, self.now_ns)
        self._collect()

    def _on_delay(self) -> None:
        """The delay of the first byte is over."""
        self._pass_once()

    def _on_stall(self) -> None:
        """The next bytes do not come in time. The decoder has more patience, and takes them all the same."""
        self._pass_once()

    def _pass_once(self) -> None:
        self._forwarding_side.line.world_ns = self.now_ns
        pass_once(self._forwarding_side.ports[0]._forward_timer)
        self._collect()

    def _on_noise(self) -> None:
        """Bytes come from the drives while a request leaves to them."""
        self._forwarding_side.hear(b"\x55", self.now_ns)
        self._collect()

    def _on_tail(self) -> None:
        """The rest comes; see ``RtuWorld``. What leaves is what would leave if all had been stored."""
        name, axis, number, ticks = self.state.half
        rest = self._end_half()
        self._give_up(0)
        if ticks:
            self._forwarding_side.feed(0, rest, self.now_ns)
            self._forwarding_side.fall_silent(self.now_ns)
            self._collect()
            return
        transaction_id, _ = self._register(name, axis, number)
        stored = self._stored(rest) if self.is_leaving else None
        self._forwarding_side.feed(0, rest, self.now_ns)
        sent = list(self._forwarding_side.link.sent)
        if stored is not None and sent and (sent, self._axes()) != stored:
            raise BrokenRuleError(f"stored it would have left as {stored[0]}, not as {sent} (W12)")
        if stored is not None and sent:  # it has had the line since it began
            mine = 0, transaction_id
            others = tuple(each for each in self.state.order if each != mine)
            self.state = self.state._replace(order=(mine, *others))
        self._collect()

    def _stored(self, rest: bytes) -> tuple[list[tuple[int, bytes]], tuple[int, ...]]:
        """Return what would leave if nothing had left yet, and what was known of the axes then."""
        side = self._forwarding_side
        before, told, met = side.lens.take(self.now_ns), list(self.told), set(self.tally.events)
        side.line._transactions.current = None
        side.ports[0]._forwarder.drop()
        side.link.pipe.leaving = b""
        side.feed(0, rest, self.now_ns)
        found = list(side.link.sent), self._axes()
        side.lens.restore(before, is_live_known=False)
        side.forget_replies()
        self.told[:], self.tally.events = told, met
        return found

    def _on_tail_bad(self) -> None:
        """The rest comes with a bad check sum: nobody has asked for anything."""
        rest = self._end_half()
        self._give_up(0)
        self._forwarding_side.feed(0, rest[:-1] + bytes((rest[-1] ^ 0x5A,)), self.now_ns)
        self._forwarding_side.fall_silent(self.now_ns)
        self._collect()

    def _on_tail_odd(self) -> None:
        """It goes on with another head, that of a write of one register, and with a bad check sum."""
        self._end_half()
        self._give_up(0)
        self._forwarding_side.feed(0, bytes.fromhex("00 01 02 12 34 00 00"), self.now_ns)
        self._forwarding_side.fall_silent(self.now_ns)
        self._collect()

    def _on_anew(self, name: str, axis: int, number: int = 0) -> None:
        """The rest comes in one read with another request, with which its controller gives it up (W5)."""
        before = self.state.half
        rest = self._end_half()
        self._give_up(0)
        self._register(*before[:3])
        self._give_up(0)
        _, data = self._register_rtu(name, axis, number)
        self._forwarding_side.feed(0, rest + data, self.now_ns)
        self._collect()

    def _on_stuck(self, name: str, axis: int, number: int = 0) -> None:
        """The process stands still: the decoder has given up what never came whole, and another one is there.

        The forwarder's own timer would have been the first to ring, and nobody has looked at it.
        """
        self._end_half()
        self._give_up(0)
        _, data = self._register_rtu(name, axis, number)
        side = self._forwarding_side
        side.line.world_ns = self.now_ns
        pass_by(side.ports[0]._timer)
        side.feed(0, data, self.now_ns)
        self._collect()

    def _on_disconnect(self, port: int) -> None:
        if not port:
            self.state = self.state._replace(come=0)
        super()._on_disconnect(port)

    def _on_wait(self, _axis: int = 0) -> None:
        super()._on_wait()
        if self.state.split:  # how much of it has come says nothing any more
            self.state = self.state._replace(reply_come=CUT)

    def _on_unplug(self) -> None:
        super()._on_unplug()
        self._forget_reply()

    def _restart(self, *, is_record_kept: bool, is_whole: bool = True) -> None:
        self.state = self.state._replace(half=(), come=0)
        self._forget_reply()
        super()._restart(is_record_kept=is_record_kept, is_whole=is_whole)

    # --- replies ---------------------------------------------------------------------------------------

    def _forget_reply(self) -> None:
        self.state = self.state._replace(split=(), reply_come=0, is_cut_off=False)

    def _reply_to_come(self) -> bytes:
        """Return the rest of the reply of which a part has come."""
        assert self.state.split
        return self._forwarding_side.encode(*self.state.split)[self.state.reply_come :]

    def _on_split(self, what: str = "ack") -> None:
        """The drive obeys, or refuses, and the first bytes of its reply come."""
        wire = self.state.wire
        assert wire is not None
        if what == "refuse":
            reply = bytes((wire.pdu[0] | EXCEPTION_BIT, EXCEPTION))
        elif what == "garble":
            self._obey(wire)
            reply = wire.pdu[:3] + b"\0\0"
        else:
            reply = self._obey(wire)
        self.state = self.state._replace(
            wire=wire._replace(is_obeyed=True), split=(wire.unit_id, reply), reply_come=CUT
        )
        self._forwarding_side.hear(self._forwarding_side.encode(wire.unit_id, reply)[:CUT], self.now_ns)
        self._collect()

    def _on_reply_more(self) -> None:
        """All of it comes but its check sum, and the last byte before it where that decides less."""
        rest = self._reply_to_come()[: -2 - self._missing]
        self.state = self.state._replace(reply_come=self.state.reply_come + len(rest))
        self._forwarding_side.hear(rest, self.now_ns)
        self._collect()

    def _on_reply_delay(self) -> None:
        """The delay of its first byte is over."""
        self._pass_reply_timer()

    def _on_reply_stall(self) -> None:
        """Its next bytes do not come in time. The decoder has more patience, and takes them all the same."""
        self._pass_reply_timer()

    def _pass_reply_timer(self) -> None:
        self._forwarding_side.line.world_ns = self.now_ns
        pass_once(self._forwarding_side.link.real._forward_timer)
        self._collect()

    def _on_reply_bad(self) -> None:
        """The rest comes with a bad check sum: nobody has said anything."""
        rest = self._reply_to_come()
        self._forget_reply()
        self._forwarding_side.hear(rest[:-1] + bytes((rest[-1] ^ 0x5A,)), self.now_ns)
        self._collect()

    def _on_reply_tail(self) -> None:
        """The rest comes; after a silence it is part of nothing.

        What is known of the axes then, and what leaves next, is what would be if all had been stored.
        """
        wire, is_cut_off, rest = self.state.wire, self.state.is_cut_off, self._reply_to_come()
        assert self.state.split
        reply = self.state.split[1]
        pipe = self._forwarding_side.pipe_of_reply
        stored = None if pipe is None else self._stored_reply(pipe, rest)
        self._forget_reply()
        is_whole = wire is not None and wire.is_obeyed and not is_cut_off
        if is_whole:
            self.state = self.state._replace(wire=None)
        self._forwarding_side.hear(rest, self.now_ns)
        found = self._passed(), list(self._forwarding_side.link.sent), self._axes()
        if pipe is not None and stored is not None:
            if "spoilt" in pipe.ends:
                found = stored[0], *found[1:]
            if found != stored:
                raise BrokenRuleError(f"stored it would have ended as {stored[:2]}, not as {found[:2]} (W12)")
        if not is_whole:
            self._collect()
            return
        assert wire is not None
        self._collect(answered=wire, reply=reply)
        if wire.aim is not None and self.state.wire is None:
            self._on_wait()

    def _passed(self) -> list[list[bytes]]:
        return [[pdu for _, pdu in replies] for replies in self._forwarding_side.replies]

    def _stored_reply(
        self, pipe: ForwardingPipe, rest: bytes
    ) -> tuple[list[list[bytes]], list[tuple[int, bytes]], tuple[int, ...]]:
        """Return what controllers would hear, and what would be, if nothing of a reply had left yet."""
        side = self._forwarding_side
        before, told, met = side.lens.take(self.now_ns), list(self.told), set(self.tally.events)
        side.drop_reply()
        pipe.leaving = b""
        side.hear(rest, self.now_ns)
        found = self._passed(), list(side.link.sent), self._axes()
        side.lens.restore(before, is_live_known=False)
        side.forget_replies()
        self.told[:], self.tally.events = told, met
        return found


__all__ = ["ForwardingWorld"]
