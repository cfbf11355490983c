"""Requests and frames as the ledger keeps them, and whether one may have become the other."""

from typing import NamedTuple

from gateway.exchange.plan import Role
from tests.ledger.frames import Parsed, parse
from tests.ledger.layouts import Layout
from tests.ledger.registers import Written
from tests.ledger.witness import Intent


class Controller:
    """One connection, and what it is waiting for."""

    def __init__(self, name: str, *, is_serial: bool, timeout_ns: int, role: Role) -> None:
        self.name = name
        self.is_serial = is_serial
        self.timeout_ns = timeout_ns
        self.is_motion = role is Role.MOTION
        self.may_write = role is not Role.MONITOR
        self.is_closed = False
        """By either end: nobody waits for anything of it."""
        self.pending: list[Request] = []
        """Not on the wire yet, oldest first."""
        self.unanswered: dict[int, Request] = {}
        """By transaction id; serial: the last request alone, at 0."""


class Request:
    __slots__ = (
        "arrived_ns",
        "controller",
        "goes_again",
        "is_foreign",
        "is_lost",
        "is_stop",
        "parsed",
        "pdu",
        "restaged",
        "transaction_id",
        "unit",
        "written_ns",
    )

    def __init__(
        self,
        controller: Controller,
        transaction_id: int,
        unit: int,
        pdu: bytes,
        arrived_ns: int,
        *,
        written_ns: int,
    ) -> None:
        self.controller = controller
        self.transaction_id = transaction_id
        self.unit = unit
        self.pdu = pdu
        self.parsed = parse(pdu)
        self.arrived_ns = arrived_ns
        """When the gateway had read all of it."""
        self.written_ns = written_ns
        """When its controller sent its first byte."""
        self.is_stop = self.is_lost = self.goes_again = False
        self.is_foreign = False
        """It is for a unit id that no drive was given, on a line whose drive does not look at them."""
        self.restaged = 0

    @property
    def may_leave(self) -> bool:
        """Whether the role of its controller allows it; what it does not waits for its refusal alone (W9)."""
        return self.controller.is_motion or self.is_stop or self.parsed.is_read


class Sample(NamedTuple):
    """The axis when the drive took a frame."""

    at: int
    is_stationary: bool
    faded: float
    """Counts by which a reading of it may lie beside the branches."""


class Frame:
    """One frame that the gateway sent to a drive."""

    __slots__ = (
        "before",
        "candidates",
        "connection",
        "has_moved",
        "intent",
        "is_early",
        "is_interruption",
        "may_be_added",
        "parsed",
        "pdu",
        "reply",
        "request",
        "sample",
        "sent_ns",
        "unit",
        "written",
        "written_before",
    )

    def __init__(self, unit: int, pdu: bytes, sent_ns: int) -> None:
        self.unit = unit
        self.pdu = pdu
        self.sent_ns = sent_ns
        self.parsed = parse(pdu)
        self.is_early = False
        """A stop that left while a late reply might come: only its exact echo is its answer (M3)."""
        self.request: Request | None = None
        """Whose it is; None: the gateway's own, or not certain yet."""
        self.candidates: list[Request] = []
        """Reads that it may be."""
        self.written: Written | None = None
        """What was written of the target when it was sent."""
        self.before: Written | None = None
        """The same before it."""
        self.connection = 0
        self.intent: Intent | None = None
        self.is_interruption = False
        self.may_be_added = False
        """The gateway may have sent it for a write that waits."""
        self.has_moved = False
        """The drive has done something with it."""
        self.reply: bytes | None = None
        self.sample: Sample | None = None
        self.written_before: Frame | None = None
        """The write to this unit id before this one."""


class Window(NamedTuple):
    start: int
    end: int

    def widened(self, fields: list[int]) -> "Window":
        """Return the window that cuts none of these positions of two words."""
        start, end = self.start, self.end
        for address in fields:
            if address < end and address + 2 > start:
                start, end = min(start, address), max(end, address + 2)
        return Window(start, end)


def read_fields(layout: Layout) -> list[int]:
    """Addresses of the positions that can be read, in ascending order."""
    found = [layout.actual]
    if layout.commanded is not None:
        found.append(layout.commanded)
    if layout.actual != layout.command:
        found.append(layout.command)
    return sorted(found)


def may_become(request: Parsed, request_pdu: bytes, frame: Frame, layout: Layout) -> bool:
    """Whether a frame is what a request has to look like towards the drive, but for the target's words."""
    sent = frame.parsed
    if request.write is None:
        if request.read is None:
            return request_pdu == frame.pdu
        window = _window(request.read).widened(read_fields(layout))
        return sent == request._replace(read=(window.start, window.end - window.start))
    if request.read is not None and request.read != sent.read:
        window = _window(request.read).widened(read_fields(layout))
        if sent.read != (window.start, window.end - window.start):
            return False
    return _writes_the_same(request, request_pdu, frame, layout)


def _writes_the_same(request: Parsed, request_pdu: bytes, frame: Frame, layout: Layout) -> bool:
    assert request.write is not None
    sent, (address, words) = frame.parsed, request.write
    target = Window(layout.command, layout.command + 2)
    own = Window(address, address + len(words))
    if target.end <= own.start or target.start >= own.end:
        return frame.pdu == request_pdu
    if frame.pdu == request_pdu:
        return True  # a half that goes out as it came
    wanted = own.widened([layout.command])
    if sent.write is None or sent.write[0] != wanted.start or len(sent.write[1]) != wanted.end - wanted.start:
        return False
    if sent.function not in {request.function, 16}:
        return False
    others = [a for a in range(own.start, own.end) if not target.start <= a < target.end]
    return all(sent.write[1][a - wanted.start] == words[a - own.start] for a in others)


def _window(span: tuple[int, int]) -> Window:
    return Window(span[0], span[0] + span[1])
