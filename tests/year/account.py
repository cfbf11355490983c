"""The account: what each controller asked for, what left for the drives, and what came of it.

It sees the bytes on the wires alone, and the log. What must hold:

- A write leaves once, in time, and only if a controller asked for it (W5); one request is on a line at a time
  (W6). What is no position is the same byte for byte. The gateway itself may add reads, and write a staged
  target once more before its trigger (W8, M2).
- A target has the words of its nominal position, corrected for the direction in which the axis goes, by the
  table that is in force then; or the axis was flagged as unsure. The same target again has the same words,
  whatever was changed meanwhile (M4).
- A controller gets its drive's success only if the drive did what it asked for. An axis at rest reads back
  what was commanded.
- Without a fault nothing is refused, and nothing stays without an answer.
- A kill leaves a record of each axis that can be read. An axis that begins without it says so.
- Each table, gain and switch that comes into force was asked for. What the status says is so (``status.py``).
"""

import hashlib
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NoReturn

from gateway.exchange.plan import Reference
from tests.ledger.drives import Drive, Operation
from tests.ledger.frames import Parsed, crc, native_success, parse, words_of
from tests.ledger.layouts import MAX_SPEED_MM_S, RUN, STOP, Layout
from tests.ledger.screws import Screw
from tests.year.corrections import NONE, ROUNDING, Correction, span
from tests.year.groups import Group
from tests.year.homing import HomedDrive
from tests.year.machine import MS, Machine, S
from tests.year.setpoints import Flow

BESIDE: Final = 12
"""Counts beside an axis within which a target's direction is nobody's certainty."""
BAND: Final = 3
"""Counts that rounding may put a reading beside the two branches."""
LATE_NS: Final = 5 * MS
"""What a request may be late by the gateway's own steps."""
TOLD_NS: Final = 2 * S
"""A flag is reported with the end of the exchange that it concerns."""
TROUBLED_NS: Final = 15 * S
"""After a fault: the longest pause before a silent drive is tried again is 10 s."""
FRESH_NS: Final = 1_100 * MS
"""A homed bit older than 1 s is read again before a target; and the time of that exchange."""
MAX_CORRECTION_MM: Final = 0.5
KEPT: Final = 60
"""Lines of the story that are printed with a finding."""
UNSURE: Final = frozenset({"direction-unsure", "record-not-used", "reference-lost", "stood-still"})
"""Events by which an axis is flagged: its next words may be those of the other direction."""
ALARMS: Final = frozenset({"internal-fault", "unexpected", "no-progress"})
"""Events that are findings by themselves."""


class FindingError(SystemExit):
    """Something that must hold does not; the text is the story."""


class Book:
    """Counts, the last lines of the story, a digest of all of it, and the finding."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self.seen: Counter[str] = Counter()
        self.finding = ""
        self.trace: Callable[[str], None] | None = None
        self._story: deque[tuple[int, str, bytes]] = deque(maxlen=KEPT)
        self._digest = hashlib.sha256()

    def note(self, what: str, data: bytes = b"") -> None:
        """Write down what happened."""
        now_ns = self._machine.now_ns
        self._story.append((now_ns, what, data))
        # In whole microseconds: asyncio counts in floats, and how often it wakes up decides on nanoseconds.
        self._digest.update(b"%d %s " % (now_ns // 1000, what.encode()))
        self._digest.update(data)
        if self.trace is not None:
            self.trace(_line(now_ns, what, data))

    def find(self, kind: str, detail: str) -> NoReturn:
        """End the run with a finding.

        Raises:
            FindingError: always.
        """
        self.finding = f"{kind} at {self._machine.now_ns / S:.6f} s: {detail}"
        raise FindingError(self.finding)

    def story(self) -> str:
        """Return the last lines."""
        return "\n".join(_line(*each) for each in self._story)

    def digest(self) -> str:
        """Return the digest of everything so far: the same seed has the same."""
        return self._digest.hexdigest()[:16]


class Request:
    """A request of a controller."""

    __slots__ = (
        "arrived_ns",
        "asked_ns",
        "axis",
        "controller",
        "frame",
        "is_closed",
        "parsed",
        "patience_ns",
        "pdu",
        "unit",
    )

    def __init__(self, controller: str, unit: int, pdu: bytes, asked_ns: int, patience_ns: int) -> None:
        self.controller, self.unit, self.pdu = controller, unit, pdu
        self.asked_ns, self.patience_ns = asked_ns, patience_ns
        self.parsed = parse(pdu)
        self.axis: Axis | None = None
        self.frame: Frame | None = None
        self.arrived_ns = asked_ns
        """When the last of its bytes reaches the machine of the gateway."""
        self.is_closed = False
        """It was answered, or its controller has given up, or its connection is gone."""


class Frame:
    """A frame that left for a drive."""

    __slots__ = (
        "arrives_ns",
        "axis",
        "correction",
        "data",
        "doubled_ns",
        "is_acknowledged",
        "is_taken",
        "is_unheard",
        "others",
        "parsed",
        "pdu",
        "reply",
        "request",
        "sent_ns",
        "unit",
    )

    def __init__(self, unit: int, pdu: bytes, data: bytes, sent_ns: int) -> None:
        self.unit, self.pdu, self.data, self.sent_ns = unit, pdu, data, sent_ns
        self.parsed = parse(pdu)
        self.axis: Axis | None = None
        self.correction = NONE
        """That of its axis when it left."""
        self.others: tuple[Correction, ...] = ()
        """Those that its axis may go by too, behind a fault."""
        self.request: Request | None = None
        self.is_taken = False
        """Its drive has taken it."""
        self.is_unheard = False
        """The process stood still when it was on its way: its reply may count as none."""
        self.reply = b""
        """What its drive answered to it."""
        self.is_acknowledged = False
        """The success of its drive has arrived whole."""
        self.arrives_ns = 0
        """When its reply does."""
        self.doubled_ns = 0
        """When its reply has come once more: on RTU it may answer an equal read, and any other write."""


class Axis:
    """One axis as the account knows it."""

    def __init__(self, name: str, layout: Layout, drive: Drive, *, is_stream: bool = False) -> None:
        self.name, self.layout, self.drive = name, layout, drive
        self.flow = Flow(layout) if is_stream else None
        """Its setpoints, if a stream of them leads it."""
        self.group: Group | None = None
        self.reference = Reference.ABSOLUTE
        self.is_jump_due = False
        """It was seen at rest at its target, and will be read with another zero."""
        self.correction = NONE
        """In force for its next different target."""
        self.correction_before = NONE
        self.corrected_ns = 0
        """Since when; before that there was another."""
        self.wanted = NONE
        """The same, as it was asked for."""
        self.planned = ""
        """The table in its plan: what the next process begins with."""
        self.made_with = NONE
        """The words of the target that was run last were made with this."""
        self.mixture = [NONE]
        """What a reading may be a mixture of: that of before fades on the way."""
        self.staged: int | None = None
        """The nominal target that left last."""
        self.place: int | None = None
        """The nominal target that was run last; None: something else moved the axis."""
        self.words: int | None = None
        """With these corrected counts."""
        self.came_from: tuple[int | None, int | None] = (None, None)
        """Place and words before."""
        self.ran_ns = 0
        """When it was run."""
        self.sure = 0
        """Acknowledged moves since the last doubt."""
        self.is_settled = False
        """It has come to rest after a move that was acknowledged: the correction of before has faded."""
        self.faded = 0.0
        """Counts that a reading may lie beside the branches: that of before fades on the way."""
        self.is_flagged = True
        """Flagged since its last certain move."""
        self.flags = 0
        """How often it was flagged."""
        self.is_referenced = True
        self.is_decided = True
        """This process has said whether it goes on from its record; True: it is the first."""
        self.read_late: set[int] = set()
        """When reads left that the process had begun before it waited for the disk."""
        self.told = 0
        """How often its reference was reported as found or lost, or a process began."""
        self.is_blocked = False
        """Its triggers are refused."""
        self.is_new = True
        """No move since the process began, and its record was not restored."""
        self.was_known = False
        """The process went on from its record, or has had moves acknowledged."""
        self.is_told = True
        """This process has said if it goes on from the record of the one before; True: there was none."""
        self.readings: deque[tuple[int, int]] = deque(maxlen=16)
        """The newest positions that its drive has told this process: when the read left, and the counts."""

    @property
    def members(self) -> Sequence["Axis"]:
        """The axes of its group, or it alone."""
        return (self,) if self.group is None else self.group.axes

    def is_one_of(self, corrected: int, nominal: int, correction: Correction) -> bool:
        """Whether these are the words of a target: corrected, or those that the same target had before."""
        if (nominal, corrected) == (self.place, self.words):
            return True
        if self.flow is not None:
            return self.flow.covers(corrected, nominal) or self.begins(corrected, nominal)
        may_be_lost = not self.is_referenced or self.reference is not Reference.ABSOLUTE
        is_plain = may_be_lost and corrected == nominal
        return is_plain or correction.makes(self.layout, corrected, nominal)

    def begins(self, corrected: int, nominal: int) -> bool:
        """Whether these may be the words with which a stream begins in a process without its record."""
        at = self.readings[-1][1] if self.readings else nominal
        return self.flow is not None and not self.flow.is_begun and self.flow.begins(corrected, nominal, at)

    def goes(self, operation: Operation, correction: Correction) -> None:
        """Its drive goes to the staged target: what was before fades on the way."""
        is_at_rest = not operation.was_moving and self.place is not None and operation.was_at == self.words
        self.is_settled |= self.sure > 0 and is_at_rest
        if (self.staged, operation.end) == (self.place, self.words):
            correction = self.made_with  # kept words
        if is_at_rest:
            self.mixture = [self.made_with]
        if correction not in self.mixture:
            self.mixture.append(correction)
        low, high = span(self.layout, self.mixture, operation.was_at)
        self.faded = high - low + (0.0 if is_at_rest else self.faded)
        self.made_with = correction

    def move_unseen(self) -> None:
        """It is elsewhere, or is said to be."""
        self.doubt()
        self.place = None

    def shifts(self, counts: int) -> None:
        """Its drive counts from another zero, and says nothing."""
        assert isinstance(self.drive, HomedDrive)
        is_seen_at_rest = self.sure > 1 and not self.is_flagged and bool(self.readings)
        is_seen_at_rest &= self.place is not None
        self.is_jump_due = is_seen_at_rest and self.readings[-1][1] == self.words
        self.drive.shift(counts)
        self.move_unseen()

    def doubt(self) -> None:
        """Where it is, and from where it came, may not be known any more."""
        self.sure, self.is_flagged, self.is_settled = 0, True, False


class Line:
    """A bus of drives."""

    def __init__(
        self, name: str, axes: Mapping[int, Axis], open_frame: Callable[[bytes], tuple[int, bytes] | None]
    ):
        self.name, self.axes, self.open_frame = name, axes, open_frame
        self.frames: deque[Frame] = deque(maxlen=32)
        """The newest frames that left."""
        self.waiting: list[Request] = []
        """Writes that have not left."""
        self.may_abort = False
        """It cuts through: a frame that has begun to leave may have to be aborted."""
        self.is_swapped = False
        """Its drives are behind another device: what the gateway sends goes to a controller."""
        self.troubled_ns = 0
        self.left = 0
        """Frames that have left since the process began."""
        self.uncounted = 0
        """Of these, those that its status did not count when it was seen last."""
        self.counted_ns = 0
        """When that was; 0: never."""


class Account:
    """The account of all lines."""

    def __init__(self, machine: Machine, book: Book, lines: Mapping[str, Line]) -> None:
        self._machine, self.book, self.lines = machine, book, lines
        self.tables: dict[str, Screw] = {}
        """Each table that there may be, by the name of its file."""
        self.digests: dict[str, str] = {}
        """The same in compiled form."""
        self.began_ns = 0
        """When the process began."""
        self._boots = machine.boots
        """Of the machine when a process was ready."""

    # --- controllers

    def asked(self, line: Line, request: Request) -> None:
        """A controller sends a request."""
        request.axis = line.axes.get(request.unit)
        self.book.seen["requests"] += 1
        self.book.note(f"{request.controller} asks {request.unit}", request.pdu)
        line.waiting.append(request)
        if len(line.waiting) > 64:
            del line.waiting[:32]

    def answered(self, line: Line, request: Request, pdu: bytes) -> None:
        """A controller has its reply."""
        self.book.note(f"{request.controller} hears {request.unit}", pdu)
        self._close(line, request, is_answered=True)
        frames = self._equal_reads(line, request) if request.parsed.write is None else []
        if request.frame is not None and request.frame not in frames:
            frames.append(request.frame)
        if pdu[0] & 0x80:
            self.book.seen[f"exceptions {pdu[1]:#04x}"] += 1
            is_held = request.axis is not None and any(each.is_blocked for each in request.axis.members)
            if all(frame.reply != pdu for frame in frames) and not is_held:
                self._need_trouble(line, "refused-for-nothing", request, f"with {pdu[1]:#04x}")
            return
        if not frames and line.is_swapped:
            self.book.seen["requests of another wire taken for replies"] += 1
            return
        if not frames:
            self.book.find("reply-from-nowhere", f"{_text(request)}: {pdu.hex(' ')}, and it never left")
        if request.parsed.write is not None:
            if not native_success(request.pdu, pdu):
                self.book.find("wrong-echo", f"{_text(request)}: {pdu.hex(' ')}")
            if not frames[0].is_acknowledged and not self._answers_twice(line, frames[0], pdu):
                self.book.find("success-from-nowhere", f"{_text(request)}: its drive did not say so")
            self.book.seen["writes done"] += 1
        elif request.axis is not None:
            problems = [self._why_wrong_reply(request.axis, request, frame, pdu) for frame in frames]
            if all(problems):
                self.book.find("wrong-reading", f"axis {request.axis.name}: {problems[0]}")

    @staticmethod
    def _answers_twice(line: Line, frame: Frame, pdu: bytes) -> bool:
        """Whether a reply came once more, which on RTU nothing tells, or a stop was sent again."""
        return any(
            each.reply == pdu and max(each.doubled_ns, each.sent_ns * each.is_acknowledged) >= frame.sent_ns
            for each in line.frames
            if each.unit == frame.unit
        )

    @staticmethod
    def _equal_reads(line: Line, request: Request) -> list[Frame]:
        """Return the reads that a read may have been answered from: equal ones cannot be told apart."""
        return [
            frame
            for frame in line.frames
            if (frame.unit, frame.pdu) == (request.unit, request.pdu)
            and max(frame.sent_ns, frame.doubled_ns) >= request.asked_ns
        ]

    def gave_up(self, line: Line, request: Request) -> None:
        """A controller has no reply in time, or its connection has ended."""
        self.book.note(f"{request.controller} gives up on {request.unit}", request.pdu)
        self.book.seen["unanswered"] += 1
        self._close(line, request, is_answered=False)
        self._need_trouble(line, "unanswered", request, "no fault explains it")

    def _close(self, line: Line, request: Request, *, is_answered: bool) -> None:
        """Nobody waits for it any more: a write that was given up must not leave, and is kept to see that."""
        request.is_closed = True
        if request in line.waiting and (is_answered or request.parsed.write is None):
            line.waiting.remove(request)

    # --- to the drives

    def left(self, line: Line, data: bytes, began_ns: int) -> None:
        """The gateway has sent a frame to a drive; the first of it at this instant."""
        book = self.book
        opened = line.open_frame(data)
        if opened is None:
            self._no_frame(line, data)
            return
        frame = Frame(*opened, data, began_ns)
        # Its time-out counts from before the process waited for the disk.
        frame.is_unheard = self._machine.now_ns - self._machine.slow_ns <= LATE_NS
        book.seen["exchanges"] += 1
        line.left += 1
        book.note(f"to {line.name} {frame.unit}", frame.pdu)
        self._doubt_unacknowledged(line)
        frame.axis = axis = line.axes.get(frame.unit)
        if axis is not None:
            axis.is_jump_due &= frame.parsed.write is None  # it may move
            is_before = began_ns < axis.corrected_ns
            frame.correction = axis.correction_before if is_before else axis.correction
            if axis.group is not None:
                self._leaves_in_group(line, axis, axis.group, frame)
        frame.request = request = self._request_of(line, frame, axis)
        if request is not None:
            line.waiting.remove(request)
            request.frame = frame
            frame.is_unheard |= self._is_late(axis, request)
        elif frame.parsed.write is None:
            book.seen["added reads"] += 1
        elif axis is not None and axis.layout.is_staged and self._is_restaged(axis, frame):
            book.seen["restaged"] += 1
        elif _is_stop(axis, frame.parsed) and any(each.pdu == frame.pdu for each in line.frames):
            book.seen["stops sent again"] += 1  # one that left before the silence, and was not answered (M3)
        else:
            book.find("invented-write", f"line {line.name}, unit id {frame.unit}: {frame.pdu.hex(' ')}")
        line.frames.append(frame)
        if axis is not None and request is not None:
            nominal = target_of(axis.layout, request.parsed)
            if nominal is not None and axis.flow is not None:
                self._flows(line, axis, axis.flow, frame, nominal)
            corrected = target_of(axis.layout, frame.parsed)
            if nominal is not None and corrected is not None:
                self._need_homed(axis, frame, corrected, nominal)
            axis.staged = axis.staged if nominal is None else nominal

    def _is_late(self, axis: Axis | None, request: Request) -> bool:
        """Whether it leaves too late, which only a process that waited for the disk does not see (W5)."""
        now_ns = self._machine.now_ns
        late_ns = now_ns - request.arrived_ns - request.patience_ns
        if late_ns <= LATE_NS or _is_stop(axis, request.parsed):
            return False
        if now_ns - self._machine.slow_ns > LATE_NS:
            self.book.find("W5-too-old", f"{_text(request)} left {late_ns // MS} ms too late")
        self.book.seen["requests that left too old behind a slow store"] += 1
        return True

    def _leaves_in_group(self, line: Line, axis: Axis, group: Group, frame: Frame) -> None:
        is_target = target_of(axis.layout, frame.parsed) is not None
        group.leaves(
            axis,
            frame.sent_ns,
            runs=_is_trigger(axis, frame.parsed, RUN) if axis.layout.is_staged else is_target,
            is_target=is_target,
            is_stop=_is_stop(axis, frame.parsed),
        )
        frame.correction = group.fixed(axis)
        if self.is_troubled(line):
            frame.others = axis.correction, axis.correction_before

    def _flows(self, line: Line, axis: Axis, flow: Flow, frame: Frame, nominal: int) -> None:
        """A setpoint leaves: it goes on from the one before, or the stream begins with the drive's offset."""
        corrected = target_of(axis.layout, frame.parsed)
        assert corrected is not None
        self.book.seen["setpoints"] += 1
        if not flow.is_begun:
            self.book.seen["setpoints that begin a stream"] += 1
            before = line.frames[-2] if len(line.frames) > 1 else frame
            is_read = before.axis is axis and before.parsed.read == (axis.layout.actual, 2)
            is_calm = flow.is_new and line.troubled_ns < before.sent_ns - S
            if (
                is_calm
                and axis.is_new
                and axis.is_decided
                and is_read
                and before.request is None
                and before.arrives_ns
            ):
                self._begins_where_it_is(axis, flow, corrected, nominal)
            flow.begin(corrected, nominal)
            return
        self.book.seen["setpoints on one branch"] += flow.is_even(nominal)
        if why := flow.why_not(corrected, nominal):
            self.book.find("wrong-setpoint", f"axis {axis.name}: {why}")
        flow.go_on(corrected, nominal)

    def _begins_where_it_is(self, axis: Axis, flow: Flow, corrected: int, nominal: int) -> None:
        """The drive was asked where it is: the stream begins there, if a correction can explain it."""
        at = axis.readings[-1][1]
        low, high = flow.offsets(nominal, at, axis.correction)
        expected = min(max(at - nominal, low), high)
        self.book.seen["streams that begin where the drive is"] += 1
        if abs(corrected - nominal - expected) > BAND:
            self.book.find(
                "wrong-beginning", f"axis {axis.name}: {corrected} for {nominal}, with its drive at {at}"
            )

    def _no_frame(self, line: Line, data: bytes) -> None:
        """Bytes that no drive takes: a frame that was aborted (W12), or torn by a fault."""
        self.book.note(f"to {line.name}, no frame", data)
        is_aborted = line.may_abort and len(data) > 4 and _is_inverted(data)
        self.book.seen["aborted frames" if is_aborted else "torn frames"] += 1
        if not is_aborted and not (line.may_abort and self.is_troubled(line)):
            self.book.find("no-frame", f"line {line.name}: {data.hex(' ')}")

    def _doubt_unacknowledged(self, line: Line) -> None:
        """The next frame leaves: what was not acknowledged before may have been done or not."""
        if line.frames:
            before = line.frames[-1]
            is_heard = before.is_acknowledged and not before.is_unheard
            if is_heard and before.axis is not None and before.axis.flow is not None:
                before.axis.flow.acknowledged()
            if before.parsed.write is not None and not before.is_acknowledged and before.axis is not None:
                before.axis.doubt()

    def _request_of(self, line: Line, frame: Frame, axis: Axis | None) -> Request | None:
        """Return whose frame it is: the oldest request that waits, else one that was given up."""
        fitting = [request for request in line.waiting if self._may_become(request, frame, axis)]
        waiting = next((each for each in fitting if not each.is_closed), None)
        is_staged = axis is not None and axis.layout.is_staged
        if waiting is None and is_staged and self._is_restaged(axis, frame):
            return None
        return waiting or next(iter(fitting), None)

    def _may_become(self, request: Request, frame: Frame, axis: Axis | None) -> bool:
        if request.unit != frame.unit:
            return False
        if axis is None or target_of(axis.layout, request.parsed) is None:
            return request.pdu == frame.pdu
        return self._are_words_of(axis, request, frame)

    @staticmethod
    def _fits(axis: Axis, frame: Frame, corrected: int, nominal: int) -> bool:
        """Whether these are the words of a target by what its axis goes by, which its frame has then."""
        for each in (frame.correction, *frame.others):
            if axis.is_one_of(corrected, nominal, each):
                frame.correction = each
                return True
        return False

    def _are_words_of(self, axis: Axis, request: Request, frame: Frame) -> bool:
        """Whether a frame is a target that was asked for, corrected."""
        nominal = target_of(axis.layout, request.parsed)
        corrected = target_of(axis.layout, frame.parsed)
        if nominal is None or corrected is None:
            return False
        # While nothing shows where its axis is, a staged target waits as it came: it is judged when it runs.
        is_one = self._fits(axis, frame, corrected, nominal)
        return is_one or (axis.layout.is_staged and corrected == nominal)

    def _is_restaged(self, axis: Axis | None, frame: Frame) -> bool:
        if axis is None or axis.staged is None:
            return False
        corrected = target_of(axis.layout, frame.parsed)
        return corrected is not None and self._fits(axis, frame, corrected, axis.staged)

    # --- at the drives and back

    def taken(self, line: Line, unit: int, pdu: bytes, data: bytes) -> Frame | None:
        """A drive takes a frame: return it as it left; None if it never did, or twice."""
        for frame in reversed(line.frames):  # an equal one of before may never have come to it
            if frame.data == data and not frame.is_taken:
                frame.is_taken = True
                return frame
        self.book.note(f"line {line.name} {unit} takes a copy", pdu)
        return None

    def did(self, frame: Frame, reply: bytes, operations: Sequence[Operation]) -> None:
        """A drive has done what a frame asks for, and will reply so."""
        frame.reply = reply
        axis = frame.axis
        if axis is None:
            return
        if frame.parsed.read == (axis.layout.actual, 2):
            axis.readings.append((frame.sent_ns, axis.layout.join(_pair(reply[2:]))))
            if frame.is_unheard:
                axis.read_late.add(frame.sent_ns)
        for operation in operations:
            self._ran(axis, frame, operation)

    def _ran(self, axis: Axis, frame: Frame, operation: Operation) -> None:
        self.book.seen["moves"] += 1
        nominal, end = axis.staged, operation.end
        if operation.kind != "absolute":
            axis.place = None
            return
        is_right = axis.flow is not None  # a setpoint was judged as it left
        if nominal is None or not (is_right or self._fits(axis, frame, end, nominal)):
            if (
                frame.correction.is_plain or not axis.is_referenced
            ):  # what its drive holds runs: nothing is refused to such an axis (M9)
                axis.place = None
                axis.doubt()
                return
            self.book.find("wrong-target", f"axis {axis.name} goes to {end} for {nominal}")
        if axis.is_new:
            axis.doubt()
        axis.is_new = False
        axis.came_from, axis.ran_ns = (axis.place, axis.words), self._machine.now_ns
        if axis.flow is None:
            self._judge_way(axis, frame, nominal, operation)
        axis.place, axis.words = nominal, end

    def _judge_way(self, axis: Axis, frame: Frame, nominal: int, operation: Operation) -> None:
        """Its words are those of the direction in which it goes, or it is flagged."""
        end = operation.end
        if axis.group is not None and axis.group.went(axis, nominal, end):
            self.need_calm("skewed", f"axis {axis.name} goes to {end} for {nominal} by another decision")
        self.book.seen["moves by what a group had fixed"] += frame.correction != axis.correction
        axis.goes(operation, frame.correction)
        ways = self._ways(axis, nominal, operation)
        is_again = nominal == axis.place and axis.sure > 0 and not axis.is_flagged
        if is_again and end != axis.words and axis.group is None:  # all axes of a group keep words, or none
            self.book.find("M4-other-words", f"axis {axis.name}: {axis.words} became {end} for {nominal}")
        if len(ways) == 1 and not is_again:
            up, down = axis.made_with.branches(axis.layout, nominal)
            if abs(end - (up if ways[0] else down)) <= ROUNDING:
                axis.is_flagged = False
                self.book.seen["certain moves"] += 1
            elif axis.is_flagged:
                self.book.seen["unsure moves"] += 1
            else:
                way = "forward" if ways[0] else "backward"
                detail = f"axis {axis.name} goes {way} to {end} for {nominal}, from {operation.was_at}; "
                detail += f"forward {up:.3f}, backward {down:.3f}"
                self._machine.after(TOLD_NS, self._need_flag, axis, axis.flags, detail)

    @staticmethod
    def _ways(axis: Axis, nominal: int, operation: Operation) -> tuple[bool, ...]:
        """Directions in which a move may be taken to go: one, where two ways to see it agree."""
        if axis.place is None or axis.sure < 1:
            return (True, False)
        sign = axis.layout.machine_sign
        way = nominal - axis.place
        ends = axis.made_with.branches(axis.layout, nominal)
        # An axis may pass its target since it was read. The first trigger of a group reads all of its axes.
        is_read_before = operation.was_moving or axis.group is not None
        seen = [operation.was_at, *(each for _, each in list(axis.readings)[-1:] if is_read_before)]
        if way > BESIDE and min(ends) > max(seen) + BESIDE:
            return (sign > 0,)
        if way < -BESIDE and max(ends) < min(seen) - BESIDE:
            return (sign < 0,)
        return (True, False)

    def acknowledged(self, frame: Frame, arrives_ns: int) -> None:
        """The reply of a drive is on its way to the gateway, whole and in time."""
        frame.arrives_ns = arrives_ns
        if frame.axis is not None and frame.axis.is_jump_due:
            self._need_notice(frame.axis, frame)
        if frame.parsed.write is not None and native_success(frame.pdu, frame.reply):
            frame.is_acknowledged = True
            if frame.is_unheard and frame.axis is not None:
                frame.axis.doubt()
            elif frame.axis is not None and frame.axis.place == frame.axis.staged:
                frame.axis.sure += 1
                frame.axis.was_known |= frame.axis.sure > 1
                if frame.axis.flow is not None and frame.axis.sure > 1:
                    frame.axis.is_flagged = False  # no branch is guessed in a stream

    def _need_notice(self, axis: Axis, frame: Frame) -> None:
        """A drive has another zero since it was seen at rest: its reference is lost if it jumped (M9)."""
        if frame.parsed.read == (axis.layout.actual, 2):
            axis.is_jump_due = False
            (before_ns, before), (now_ns, now) = list(axis.readings)[-2:]
            way_mm = abs(now - before) / abs(axis.layout.counts_per_unit)
            may_be_mm = 2.0 * (2 * MAX_SPEED_MM_S * (now_ns - before_ns) / S + MAX_CORRECTION_MM)
            if way_mm > may_be_mm + 1.0 and axis.reference is Reference.HOMING:
                self.book.seen["other zeros that must be noticed"] += 1
                self._machine.after(TOLD_NS, self._need_lost, axis, axis.told)

    def _need_lost(self, axis: Axis, told: int) -> None:
        if axis.is_referenced and axis.told == told:
            self.book.find("other-zero", f"axis {axis.name} keeps its reference")

    def _need_homed(self, axis: Axis, frame: Frame, corrected: int, nominal: int) -> None:
        """A target leaves corrected only while its drive is homed, by a bit not older than 1 s (M9)."""
        drive = axis.drive
        if axis.reference is not Reference.DRIVE_BIT or not isinstance(drive, HomedDrive) or drive.is_homed:
            return
        since_ns = frame.sent_ns - drive.lost_ns
        self.book.seen["targets while the drive was not homed"] += 1
        if corrected != nominal and since_ns > FRESH_NS:
            self.book.find(
                "not-homed", f"axis {axis.name}: {corrected} for {nominal}, {since_ns // MS} ms after"
            )

    def _why_wrong_reply(self, axis: Axis, request: Request, frame: Frame, pdu: bytes) -> str:
        layout = axis.layout
        if request.parsed.read != (layout.actual, 2) or len(frame.reply) != len(pdu):
            return ""
        return self.why_no_reading(axis, layout.join(_pair(pdu[2:])), layout.join(_pair(frame.reply[2:])))

    def why_no_reading(self, axis: Axis, nominal: int, corrected: int) -> str:
        """Return why a position that was read back cannot be that of the drive, "" if it can."""
        if axis.is_new:
            self.book.seen["readings of axes that were not restored"] += 1
            is_known = axis.place is not None and not (axis.made_with.is_plain or axis.correction.is_plain)
            # A group is restored whole: while one of it is silent, the others are not told either.
            is_silent = is_known and not axis.is_told and axis.group is None and axis.is_referenced
            is_silent &= not self._machine.is_dead
            return "it begins without its record, and does not say so" if is_silent else ""
        if axis.sure > 1 and not axis.is_flagged and corrected == axis.words and axis.place is not None:
            self.book.seen["exact readings"] += 1
            if nominal == corrected and axis.reference is not Reference.ABSOLUTE:
                return ""  # its reference may be lost, and reported with the end of the exchange
            return "" if nominal == axis.place else f"{nominal} for {axis.place} at {corrected}"
        is_stream = axis.flow is not None
        low, high = axis.flow.span(nominal) if axis.flow else span(axis.layout, axis.mixture, nominal)
        band = BAND + axis.faded
        if not axis.is_referenced or low - band <= corrected <= high + band:
            return ""
        if axis.is_flagged or not (axis.is_settled or is_stream):
            self.book.seen["unsure readings"] += 1
            return ""
        return f"{nominal} for {corrected} of the drive, not {low:.2f} to {high:.2f}"

    # --- the process

    def event(self, name: str, fields: Mapping[str, Any]) -> None:
        """The process logs an event."""
        self.book.seen[f"event {name}"] += 1
        named = fields.get("axis")
        lines = [line for line in self.lines.values() if fields.get("line") in (line.name, None)]
        for axis in (axis for line in lines for axis in line.axes.values()):
            if named in (axis.name, None):
                axis.is_flagged |= name in UNSURE
                axis.flags += name in UNSURE
                axis.is_new &= name != "restored"
                axis.was_known |= name == "restored"
                axis.is_told |= name in ("restored", "record-not-used")
                axis.is_decided |= name in ("restored", "record-not-used")
                if name in ("axis-blocked", "group-skewed", "axis-released"):
                    axis.is_blocked = name != "axis-released"
                if name in ("reference-lost", "axis-referenced"):
                    axis.is_referenced = name == "axis-referenced"
                    axis.told += 1
                if axis.flow is not None:
                    axis.flow.is_begun |= name == "restored" and axis.flow.has_before
                self._corrected(axis, name, fields)
        if name == "ready":
            self._boots = self._machine.boots
        if name == "record-not-used" and "damaged" in fields["detail"] and self._boots == self._machine.boots:
            self.book.find("record-damaged", f"without a power cut: {fields['detail']}")
        if name in ALARMS:
            self.book.find(f"event-{name}", str(fields.get("detail", "")) + str(fields.get("traceback", "")))

    def _corrected(self, axis: Axis, name: str, fields: Mapping[str, Any]) -> None:
        """Something else comes into force: what was asked for, and at the start what is in the plan."""
        now = axis.correction
        if name == "axis":
            table = fields["table"] or ""
            now = axis.wanted = Correction(table, self.tables.get(table))
            axis.is_referenced = axis.reference is Reference.ABSOLUTE
            axis.told += 1
            if table != axis.planned:
                self.book.find("other-table", f"axis {axis.name} begins with {table}, not {axis.planned}")
        elif name == "table-activated":
            now = now._replace(table=fields["table"], screw=self.tables[fields["table"]])
        elif axis.name not in fields.get("axes", ()):
            return
        elif name == "table-removed":
            now = now._replace(table="", screw=None)
        elif name == "gain-changed":
            now = now._replace(forward=fields["forward"], backward=fields["backward"])
        elif name in ("enabled", "disabled"):
            now = now._replace(is_on=name == "enabled")
        if now == axis.correction:
            return
        axis.correction_before, axis.corrected_ns = axis.correction, self._machine.now_ns
        axis.correction = now
        if axis.flow is not None:
            axis.flow.change(now)
        if now != axis.wanted:
            self.book.find("changed-unasked", f"axis {axis.name}: {name}")

    def began(self) -> None:
        """A process begins: what it knows of the axes is in their records."""
        self.began_ns = self._machine.now_ns
        is_first = self._boots != self._machine.boots
        for line in self.lines.values():
            self._doubt_unacknowledged(line)
            line.frames.clear()
            line.left = line.counted_ns = 0
            line.waiting = [each for each in line.waiting if each.arrived_ns > self._machine.now_ns]
            for axis in line.axes.values():
                axis.is_told = is_first or not axis.was_known
                axis.is_decided = not self.began_ns
                axis.is_new, axis.was_known = True, False
                axis.is_blocked = axis.is_jump_due = False
                axis.readings.clear()
                if axis.flow is not None:
                    axis.flow.restart(is_recorded=not is_first)
            self.trouble(line)

    def trouble(self, line: Line, lasts_ns: int = 0) -> None:
        """A fault on a line: for a while it explains what is refused or not answered."""
        now_ns = self._machine.now_ns
        line.troubled_ns = max(line.troubled_ns, now_ns + lasts_ns)
        for frame in line.frames:
            frame.is_unheard |= not frame.arrives_ns
            if frame.arrives_ns > now_ns and frame.axis is not None:
                frame.axis.doubt()  # its reply may not arrive any more

    def need_calm(self, kind: str, why: str) -> None:
        """Something failed that no fault explains: none was there for a while, on no line."""
        if not any(map(self.is_troubled, self.lines.values())):
            self.book.find(kind, why)

    def is_troubled(self, line: Line) -> bool:
        """Whether a fault of a line may still have its effects."""
        return self._machine.now_ns - line.troubled_ns <= TROUBLED_NS

    def _need_flag(self, axis: Axis, flags: int, detail: str) -> None:
        """An axis moved in an unlikely direction, and must have been flagged since it had so many flags."""
        if axis.flags == flags:
            self.book.find("wrong-branch", detail)

    def _need_trouble(self, line: Line, kind: str, request: Request, why: str) -> None:
        if min(self._machine.now_ns, request.asked_ns) - line.troubled_ns > TROUBLED_NS:
            self.book.find(kind, f"{_text(request)}: {why}")


def target_of(layout: Layout, parsed: Parsed) -> int | None:
    """Return the target that a request writes; None if it writes none."""
    if parsed.write is None or parsed.write[0] != layout.command or len(parsed.write[1]) != 2:
        return None
    return layout.join((parsed.write[1][0], parsed.write[1][1]))


def _is_inverted(data: bytes) -> bool:
    """Whether both bytes of a check sum are inverted."""
    return bytes(each ^ 0xFF for each in data[-2:]) == crc(data[:-2])


def _is_stop(axis: Axis | None, parsed: Parsed) -> bool:
    """Whether it stops its axis: a stop leaves however old it is."""
    return axis is not None and _is_trigger(axis, parsed, STOP)


def _is_trigger(axis: Axis, parsed: Parsed, value: int) -> bool:
    return parsed.write == (axis.layout.trigger, (value,))


def _pair(data: bytes) -> tuple[int, int]:
    first, second = words_of(data[:4])
    return first, second


def _text(request: Request) -> str:
    return f"{request.controller} unit id {request.unit} {request.pdu.hex(' ')}"


def _line(now_ns: int, what: str, data: bytes) -> str:
    return f"{now_ns / S:14.6f} s  {what:<28} {data.hex(' ') if len(data) < 300 else data[:300].hex(' ')}"
