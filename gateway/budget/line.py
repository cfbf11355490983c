"""The budget of one line: each exchange of each controller, a round of them, and both without the gateway.

Spans are integers of nanoseconds.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final, NamedTuple

from gateway.budget.sequence import AS_MAPPED, Added, Blocks, RoundStep, Shapes, Why, added_of, round_of
from gateway.budget.wire import PduSizes, Wire, wire_of
from gateway.exchange.cut_through.delay import FrameShape, delay_ns, margin_ns, stored_ns
from gateway.exchange.plan import DEFAULT_BUDGET_US, AxisPlan, Role
from gateway.state.plan import ControllerLink, LinePlan
from gateway.times import NS_PER_MS, US_PER_MS

# --- one exchange, leg by leg, and a round of them ---------------------------------------------------------
#
# The route is the relay's: a request goes on as soon as its last byte is in (its length is predicted, silence
# is waited for only where it cannot be), each side keeps its silence from the last byte on that side, and the
# controller sends its next request as soon as the standard lets it. Drives and controllers are taken to
# answer at once where nobody knows better.

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
    request_overlap_ns: int = 0
    """0, or less: so much of the request has left before all of it came."""
    reply_overlap_ns: int = 0
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
        return self.request_in_ns + self.request_tail_ns + self.request_overlap_ns


class Delay(NamedTuple):
    """A frame that leaves while it arrives."""

    delay_ns: int
    """From its first bit on the one wire to its first bit on the other, with the margin."""
    saves_ns: int
    """So much sooner than stored; 0: it is not worth it, and is stored."""


def delay_of(shape: FrameShape, in_ns: int, out_ns: int) -> Delay:
    """Return how a frame leaves between two wires with so long characters, as ``MeasuredDelay`` has it.

    >>> from gateway.exchange.cut_through.delay import write_shape
    >>> delay_of(write_shape(2, 0, 2), 1_145_833, 1_145_833)  # both at 9 600 baud, 8E1
    Delay(delay_ns=4944790, saves_ns=9951039)
    """
    after_ns = delay_ns(shape, in_ns, out_ns) + margin_ns(out_ns)
    saves_ns = stored_ns(shape, in_ns) - after_ns
    return Delay(after_ns, saves_ns if saves_ns >= max(in_ns, out_ns) else 0)


def delays_of(route: Route, shapes: Shapes | None) -> tuple[Delay, Delay] | None:
    """Return how a request and its reply may be cut through; None: they are stored."""
    in_ns, out_ns = route.controller.character_ns, route.drives.character_ns
    if shapes is None or not in_ns or not out_ns:
        return None
    return delay_of(shapes.request, in_ns, out_ns), delay_of(shapes.reply, out_ns, in_ns)


def legs_of(route: Route, frame: PduSizes, gateway_ns: int, drive_ns: int = 0) -> Legs:
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
        request_overlap_ns=-request.saves_ns,
        reply_overlap_ns=-reply.saves_ns,
    )


def drive_side_ns(route: Route, frames: Iterable[PduSizes], drive_ns: int = 0) -> int:
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
        idle_ns = legs.reply_tail_ns + back_ns + legs.silence_ns + legs.reply_out_ns + legs.reply_overlap_ns
        idle_ns += route.controller.silence_ns
    return tuple(found), idle_ns


def _after(route: Route, quiet: Legs, idle_ns: int) -> Legs:
    """Return the legs of an exchange that begins when the drives' wire has been quiet for so long.

    A request that would have to wait for that silence before it begins to leave is stored.
    """
    if quiet.request_overlap_ns and idle_ns + quiet.arriving_ns < route.gap_ns:
        silence_ns = max(quiet.silence_ns + quiet.request_overlap_ns, 0)
        quiet = replace(quiet, request_overlap_ns=0, silence_ns=silence_ns)
    if quiet.request_overlap_ns:
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


def direct_of(route: Route, frame: PduSizes, drive_ns: int = 0) -> Direct:
    """Return what an exchange would take without the gateway."""
    wire = route.direct or Wire()
    waited_ns = drive_ns + wire.frame_ns(frame.reply_bytes)
    return Direct(wire.frame_ns(frame.request_bytes) + waited_ns, waited_ns)


def direct_round_ns(route: Route, exchanges: Sequence[Direct]) -> int:
    """Return what a round would take without the gateway: every frame waits for the drive's silence."""
    wire = route.direct or Wire()
    return sum(each.total_ns + max(wire.silence_ns, route.drive_gap_ns) for each in exchanges)


# --- a line and its controllers ----------------------------------------------------------------------------

BROADCAST = PduSizes(5, 0)
"""One register for all drives."""


@dataclass(frozen=True, slots=True)
class ForwardingBudget:
    """One exchange of a round whose frames leave while they arrive.

    No limit is held against it: whatever is not as usual is stored, and takes the time of that.
    """

    delays: tuple[Delay, Delay]
    """Of request and reply."""
    legs: Legs

    @property
    def saves_ns(self) -> int:
        """How much sooner it is over than stored; 0: it is not worth it."""
        return sum(delay.saves_ns for delay in self.delays)


@dataclass(frozen=True, slots=True)
class ExchangeBudget:
    """One exchange of a round, through the gateway and without it."""

    step: RoundStep
    request_bytes: int
    """On the controller's side."""
    reply_bytes: int
    legs: Legs
    """Behind the exchange before it in a round."""
    least_ns: int
    """What it waits on a quiet line with a gateway that takes no time: what nothing saves but the wires."""
    direct: Direct
    forwarding: "ForwardingBudget | None"
    """The same cut through, whether the line does that or not; None: it is always stored."""
    added_ns: int
    """What frames of the gateway's own can hold it up by (W8); not in ``legs``."""

    @property
    def with_added_ns(self) -> int:
        """What the controller waits when frames of the gateway's own go first."""
        return self.legs.waited_ns + self.added_ns


@dataclass(frozen=True, slots=True)
class RoundBudget:
    """All exchanges of a round, one after the other."""

    total_ns: int
    direct_ns: int
    added_ns: int
    forwarded_ns: int
    """With everything cut through that may be; ``total_ns`` where nothing may."""


@dataclass(frozen=True, slots=True)
class ControllerBudget:
    """What one controller has to reckon with while it is alone on the line."""

    index: int
    name: str
    role: Role
    wire: Wire
    timeout_ns: int
    exchanges: tuple[ExchangeBudget, ...]
    round: RoundBudget

    @property
    def slowest(self) -> ExchangeBudget | None:
        """The exchange that the controller waits for longest; None where none is known."""
        return max(self.exchanges, key=lambda each: each.legs.waited_ns, default=None)

    def longest_ns(self, counted: Callable[[ExchangeBudget], int]) -> int:
        """Return the most of what is counted of an exchange; 0 where none is known."""
        return max(map(counted, self.exchanges), default=0)


@dataclass(frozen=True, slots=True)
class AddedBudget:
    """Frames of the gateway's own, and how long they hold up what they go before."""

    added: Added
    hold_ns: int


@dataclass(frozen=True, slots=True)
class LineBudget:
    """What a line can hold."""

    name: str
    drives: Wire
    gap_ns: int
    """Silence before each request to the drives."""
    drive_gap_ns: int
    """That of it which the drives want."""
    response_ns: Mapping[str, int]
    """Time that a drive itself takes, by axis. Where it is not known it is missing, and reckoned with 0."""
    broadcast_ns: int
    """How long a broadcast of one register keeps the drives' wire, with its turnaround; 0 on Modbus TCP."""
    controllers: tuple[ControllerBudget, ...]
    added: tuple[AddedBudget, ...]

    def longest_other_ns(self, index: int) -> int:
        """Return the longest that one exchange of another controller, with its silence, can hold one up."""
        others = (each for each in self.controllers if each.index != index)
        return max(
            (
                # Both silences begin with the last byte of the reply.
                legs.request_out_ns + legs.drive_ns + legs.reply_in_ns + max(legs.reply_tail_ns, self.gap_ns)
                for controller in others
                for legs in (exchange.legs for exchange in controller.exchanges)
            ),
            default=0,
        )


def line_budget(plan: LinePlan, blocks: Blocks = AS_MAPPED) -> LineBudget:
    """Work out what a line can hold. Pure arithmetic; the plan is not changed."""
    drives = wire_of(plan.drives)
    drive_gap_ns = round(plan.timing.gap_ms * NS_PER_MS)
    alone = Route(Wire(), drives, drive_gap_ns)
    response_ns = {
        axis.name: round(axis.response_ms * NS_PER_MS) for axis in plan.axes if axis.response_ms is not None
    }
    added = tuple(
        AddedBudget(each, drive_side_ns(alone, each.frames, response_ns.get(axis.name, 0)))
        for axis in plan.axes
        for each in added_of(axis)
    )
    is_tcp = not drives.is_serial and not drives.is_hidden
    turnaround_ns = round(plan.timing.turnaround_ms * NS_PER_MS)
    return LineBudget(
        name=plan.name,
        drives=drives,
        gap_ns=alone.gap_ns,
        drive_gap_ns=drive_gap_ns,
        response_ns=response_ns,
        # The relay counts the turnaround from the moment at which it sends.
        broadcast_ns=0
        if is_tcp
        else max(drives.frame_ns(BROADCAST.request_bytes) + alone.gap_ns, turnaround_ns),
        controllers=tuple(
            _controller_budget(
                plan, index, Route(wire_of(link.endpoint), drives, drive_gap_ns), added, blocks
            )
            for index, link in enumerate(plan.controllers)
        ),
        added=added,
    )


def _controller_budget(
    plan: LinePlan, index: int, route: Route, added: tuple[AddedBudget, ...], blocks: Blocks
) -> ControllerBudget:
    link: ControllerLink = plan.controllers[index]
    steps = round_of(plan.axes, blocks, may_move=link.plan.role is Role.MOTION)
    axes = {axis.name: axis for axis in plan.axes}
    exchanges = _exchange_budgets(route, steps, axes, added)
    return ControllerBudget(
        index=index,
        name=link.plan.name,
        role=link.plan.role,
        wire=route.controller,
        timeout_ns=round(link.plan.timeout_ms * NS_PER_MS),
        exchanges=exchanges,
        round=RoundBudget(
            total_ns=round_ns(route, [each.legs for each in exchanges]),
            direct_ns=direct_round_ns(route, [each.direct for each in exchanges]),
            added_ns=sum(each.added_ns for each in exchanges),
            forwarded_ns=round_ns(
                route, [each.forwarding.legs if each.forwarding else each.legs for each in exchanges]
            ),
        ),
    )


def _exchange_budgets(
    route: Route, steps: Sequence[RoundStep], axes: Mapping[str, AxisPlan], added: tuple[AddedBudget, ...]
) -> tuple[ExchangeBudget, ...]:
    quiet = [
        legs_of(route, step.frame, gateway_ns(axes.get(step.axis)), _drive_ns(axes.get(step.axis)))
        for step in steps
    ]
    at_once = [
        legs_of(route, step.frame, gateway_ns=0, drive_ns=_drive_ns(axes.get(step.axis))) for step in steps
    ]
    return tuple(
        ExchangeBudget(
            step=step,
            request_bytes=route.controller.frame_bytes(step.frame.request_bytes),
            reply_bytes=route.controller.frame_bytes(step.frame.reply_bytes),
            legs=legs,
            least_ns=fastest.waited_ns,
            direct=direct_of(route, step.frame, legs.drive_ns),
            forwarding=forwarding,
            added_ns=_held_up_ns(
                [each for each in added if (each.added.axis, each.added.before) == (step.axis, step.what)]
            ),
        )
        for step, legs, fastest, forwarding in zip(
            steps, in_round(route, quiet), at_once, _forwardings(route, steps, quiet), strict=True
        )
    )


def _forwardings(
    route: Route, steps: Sequence[RoundStep], quiet: Sequence[Legs]
) -> list[ForwardingBudget | None]:
    """Return the exchanges of a round in which all is cut through that may be."""
    delays = [delays_of(route, step.shapes) for step in steps]
    early = [
        legs if delay is None else cut_through(route, legs, *delay)
        for legs, delay in zip(quiet, delays, strict=True)
    ]
    return [
        None if delay is None else ForwardingBudget(delay, legs)
        for delay, legs in zip(delays, in_round(route, early), strict=True)
    ]


def gateway_ns(axis: AxisPlan | None) -> int:
    """Return what the gateway may take for one exchange of an axis, or of no axis."""
    budget_us = DEFAULT_BUDGET_US if axis is None else axis.budget_us
    return round(budget_us * NS_PER_MS / US_PER_MS)


def _drive_ns(axis: AxisPlan | None) -> int:
    return 0 if axis is None else round((axis.response_ms or 0.0) * NS_PER_MS)


def _held_up_ns(added: Sequence[AddedBudget]) -> int:
    """Return the worst: a move is absolute or a distance, so of the reads only one is ever needed."""
    writes = [each.hold_ns for each in added if each.added.why is Why.REWRITE]
    reads = [each.hold_ns for each in added if each.added.why is not Why.REWRITE]
    return sum(writes) + max(reads, default=0)
