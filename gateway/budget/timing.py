"""How long one exchange takes, leg by leg, and how long a round of them. Spans are integers of nanoseconds.

The route is the relay's: a request goes on as soon as its last byte is in (its length is predicted, silence
is waited for only where it cannot be), each side keeps its silence from the last byte on that side, and the
controller sends its next request as soon as the standard lets it. Drives and controllers are taken to answer
at once where nobody knows better.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

from gateway.budget.cuts import Delay, Shapes, delay_of
from gateway.budget.frames import Frame
from gateway.budget.wire import Wire
from gateway.times import NS_PER_MS, US_PER_MS

NS_PER_US = NS_PER_MS // US_PER_MS
FOR_EVER_NS: Final = 1 << 62
"""A line that was quiet."""


@dataclass(frozen=True, slots=True)
class Route:
    """The way from one controller to the drives and back."""

    controller: Wire
    drives: Wire
    drive_gap_ns: int
    """Silence that the drives want before a request, beyond what their wire wants."""

    @property
    def gap_ns(self) -> int:
        """Silence before each request to the drives."""
        return max(self.drive_gap_ns, self.drives.silence_ns)

    @property
    def direct(self) -> Wire | None:
        """The one wire that there would be without the gateway; None where no time on it is known.

        It is the controller's own; a controller on TCP would have some converter before the drives' wire.
        """
        return next((wire for wire in (self.controller, self.drives) if wire.is_serial), None)


@dataclass(frozen=True, slots=True)
class Legs:
    """One exchange, in the order of its legs."""

    request_in_ns: int
    """Controller to gateway."""
    request_tail_ns: int
    """Silence that ends a request of unknown length."""
    gateway_ns: int
    """The gateway's share, both ways together: its budget."""
    gap_ns: int
    """What is left of the silence on the drives' side since the exchange before; 0 on a quiet line."""
    request_out_ns: int
    """Gateway to drive."""
    drive_ns: int
    """The drive's own time; 0 where it is not known."""
    reply_in_ns: int
    """Drive to gateway."""
    reply_tail_ns: int
    """Silence that ends a reply of unknown length."""
    silence_ns: int
    """What is left of the silence that the controller's wire wants between request and reply."""
    reply_out_ns: int
    """Gateway to controller."""
    request_cut_ns: int = 0
    """0, or less: so much of the request has left before all of it came."""
    reply_cut_ns: int = 0
    """The same of the reply."""

    @property
    def total_ns(self) -> int:
        """From the first byte that the controller sends to the last that it gets."""
        return sum(getattr(self, leg.name) for leg in fields(self))

    @property
    def waited_ns(self) -> int:
        """From the last byte that the controller sends to the last that it gets: what its time-out sees."""
        return self.total_ns - self.request_in_ns

    @property
    def arriving_ns(self) -> int:
        """What passes before the request begins to leave, without the gateway's share and silences."""
        return self.request_in_ns + self.request_tail_ns + self.request_cut_ns


def delays_of(route: Route, shapes: Shapes | None) -> tuple[Delay, Delay] | None:
    """Return how a request and its reply may be cut through; None: they are stored."""
    in_ns, out_ns = route.controller.character_ns, route.drives.character_ns
    if shapes is None or not in_ns or not out_ns:
        return None
    return delay_of(shapes.request, in_ns, out_ns), delay_of(shapes.reply, out_ns, in_ns)


def legs_of(route: Route, frame: Frame, gateway_ns: int, drive_ns: int = 0) -> Legs:
    """Return the legs of one exchange on a line that was quiet."""
    controller, drives = route.controller, route.drives
    request_tail_ns = controller.tail_ns if frame.ends_by_silence else 0
    reply_tail_ns = drives.tail_ns if frame.ends_by_silence else 0
    request_out_ns = drives.frame_ns(frame.request_bytes)
    reply_in_ns = drives.frame_ns(frame.reply_bytes)
    passed_ns = request_tail_ns + gateway_ns + request_out_ns + drive_ns + reply_in_ns + reply_tail_ns
    return Legs(
        request_in_ns=controller.frame_ns(frame.request_bytes),
        request_tail_ns=request_tail_ns,
        gateway_ns=gateway_ns,
        gap_ns=0,
        request_out_ns=request_out_ns,
        drive_ns=drive_ns,
        reply_in_ns=reply_in_ns,
        reply_tail_ns=reply_tail_ns,
        silence_ns=max(controller.silence_ns - passed_ns, 0),
        reply_out_ns=controller.frame_ns(frame.reply_bytes),
    )


def cut_through(route: Route, quiet: Legs, request: Delay, reply: Delay) -> Legs:
    """Return the legs of an exchange on a line that was quiet whose frames leave while they arrive."""
    passed_ns = quiet.total_ns - quiet.request_in_ns - quiet.silence_ns - quiet.reply_out_ns
    passed_ns -= request.saves_ns + reply.saves_ns
    return replace(
        quiet,
        silence_ns=max(route.controller.silence_ns - passed_ns, 0),
        request_cut_ns=-request.saves_ns,
        reply_cut_ns=-reply.saves_ns,
    )


def drive_side_ns(route: Route, frames: Iterable[Frame], drive_ns: int = 0) -> int:
    """Return how long frames of the gateway's own hold up what follows: each with a silence after it."""
    return sum(
        route.drives.frame_ns(frame.request_bytes)
        + drive_ns
        + route.drives.frame_ns(frame.reply_bytes)
        # Both silences begin with the last byte of the reply.
        + max(route.drives.tail_ns if frame.ends_by_silence else 0, route.gap_ns)
        for frame in frames
    )


def in_round(route: Route, quiet: Sequence[Legs]) -> tuple[Legs, ...]:
    """Return the legs of exchanges that follow one another without end, from their legs on a quiet line.

    A silence on the drive side costs only what is not hidden behind the controller's own wire. What one round
    leaves to the next is how long the drives' wire has been quiet when the controller may send again. That
    never falls when it was longer before, by no more than it was longer, and it has a least and a highest
    value. So rounds that begin with the last exchange just over either repeat themselves from the second on,
    or come to those that begin on a quiet line.
    """
    _, idle_ns = _one_round(route, quiet, 0)
    legs, left_ns = _one_round(route, quiet, idle_ns)
    if left_ns == idle_ns:
        return legs
    _, idle_ns = _one_round(route, quiet, FOR_EVER_NS)
    return _one_round(route, quiet, idle_ns)[0]


def round_ns(route: Route, legs: Sequence[Legs]) -> int:
    """Return how long one round takes: its exchanges, each with the silence that the controller keeps."""
    return sum(each.total_ns + route.controller.silence_ns for each in legs)


def _one_round(route: Route, quiet: Sequence[Legs], idle_ns: int) -> tuple[tuple[Legs, ...], int]:
    """Return the legs, and for how long the drives' wire is quiet at the end; ``idle_ns``: at the start."""
    found = []
    for each in quiet:
        legs = _after(route, each, idle_ns)
        found.append(legs)
        back_ns = legs.gateway_ns - _there_ns(legs)
        idle_ns = legs.reply_tail_ns + back_ns + legs.silence_ns + legs.reply_out_ns + legs.reply_cut_ns
        idle_ns += route.controller.silence_ns
    return tuple(found), idle_ns


def _after(route: Route, quiet: Legs, idle_ns: int) -> Legs:
    """Return the legs of an exchange that begins when the drives' wire has been quiet for so long.

    A request that would have to wait for that silence before it begins to leave is stored.
    """
    if quiet.request_cut_ns and idle_ns + quiet.arriving_ns < route.gap_ns:
        silence_ns = max(quiet.silence_ns + quiet.request_cut_ns, 0)
        quiet = replace(quiet, request_cut_ns=0, silence_ns=silence_ns)
    if quiet.request_cut_ns:
        return quiet
    ready_ns = idle_ns + quiet.arriving_ns + _there_ns(quiet)
    held_ns = max(route.gap_ns - ready_ns, 0)
    return replace(quiet, gap_ns=held_ns, silence_ns=max(quiet.silence_ns - held_ns, 0))


def _there_ns(legs: Legs) -> int:
    """Return the gateway's share before the request goes out: half; how much it really is is not known."""
    return legs.gateway_ns // 2


@dataclass(frozen=True, slots=True)
class Direct:
    """The same exchange on one wire, without a gateway."""

    total_ns: int
    waited_ns: int


def direct_of(route: Route, frame: Frame, drive_ns: int = 0) -> Direct:
    """Return what an exchange would take without the gateway."""
    wire = route.direct or Wire()
    waited_ns = drive_ns + wire.frame_ns(frame.reply_bytes)
    return Direct(wire.frame_ns(frame.request_bytes) + waited_ns, waited_ns)


def direct_round_ns(route: Route, exchanges: Sequence[Direct]) -> int:
    """Return what a round would take without the gateway: every frame waits for the drive's silence."""
    wire = route.direct or Wire()
    return sum(each.total_ns + max(wire.silence_ns, route.drive_gap_ns) for each in exchanges)
