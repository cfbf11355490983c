"""The budget of one line: each exchange of each controller, a round of them, and both without a gateway.

Spans are integers of nanoseconds.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

from msgspec import Struct

from gateway.budget.sequence import AS_MAPPED, Added, Blocks, RoundStep, Shapes, Why, added_of, round_of
from gateway.budget.wire import PduSizes, Wire, wire_of
from gateway.exchange.cut_through.delay import FrameShape, delay_ns, margin_ns, stored_ns
from gateway.exchange.plan import DEFAULT_BUDGET_US, AxisPlan, Role
from gateway.state.plan import ControllerLink, LinePlan
from gateway.times import NEVER_NS, NS_PER_MS, US_PER_MS

# --- one exchange, leg by leg, and a round of them ---------------------------------------------------------
#
# The route is the relay's. A request is sent on when its last byte has arrived: its length is predicted, and
# only where that is impossible the gateway waits for silence. Each side keeps its silence from the last byte
# on that side. The controller sends its next request as soon as the standard permits. Drives and controllers
# count as answering immediately unless their delay is known.


class Route(Struct, frozen=True):
    """The way from one controller to the drives and back."""

    controller: Wire
    drives: Wire
    drive_gap_ns: int
    """Silence that the drives require before a request, beyond that of their wire."""

    @property
    def gap_ns(self) -> int:
        """Silence before each request to the drives."""
        return max(self.drive_gap_ns, self.drives.silence_ns)

    @property
    def direct(self) -> Wire | None:
        """The only wire without the gateway; None if its times are unknown.

        It is the controller's own. A controller on TCP would have a converter before the drives' wire.
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
    """The gateway's budget, for both directions together."""
    gap_ns: int
    """Rest of the silence on the drives' side since the exchange before; 0 on a quiet line."""
    request_out_ns: int
    """Gateway to drive."""
    drive_ns: int
    """The drive's own time; 0 if unknown."""
    reply_in_ns: int
    """Drive to gateway."""
    reply_tail_ns: int
    """Silence that ends a reply of unknown length."""
    silence_ns: int
    """Rest of the silence that the controller's wire requires between request and reply."""
    reply_out_ns: int
    """Gateway to controller."""
    request_overlap_ns: int = 0
    """0 or less: the part of the request that is sent on before all of it has arrived."""
    reply_overlap_ns: int = 0
    """The same for the reply."""

    @property
    def total_ns(self) -> int:
        """From the first byte that the controller sends to the last that it receives."""
        return sum(getattr(self, leg.name) for leg in fields(self))

    @property
    def waited_ns(self) -> int:
        """From the last byte that the controller sends to the last that it receives, as for its time-out."""
        return self.total_ns - self.request_in_ns

    @property
    def arriving_ns(self) -> int:
        """Time until the request starts to be sent on, without the gateway's share and silences."""
        return self.request_in_ns + self.request_tail_ns + self.request_overlap_ns


class Delay(NamedTuple):
    """Cut-through forwarding of one frame."""

    delay_ns: int
    """From its first bit on one wire to its first bit on the other, with the margin."""
    saves_ns: int
    """Gain against storing the frame; 0: no gain, and the frame is stored."""


def delay_of(shape: FrameShape, in_ns: int, out_ns: int) -> Delay:
    """Return the forwarding of a frame between wires with these character times, as in ``MeasuredDelay``.

    >>> from gateway.exchange.cut_through.delay import write_shape
    >>> delay_of(write_shape(2, 0, 2), 1_145_833, 1_145_833)  # both at 9 600 baud, 8E1
    Delay(delay_ns=4944790, saves_ns=9951039)
    """
    after_ns = delay_ns(shape, in_ns, out_ns) + margin_ns(out_ns)
    saves_ns = stored_ns(shape, in_ns) - after_ns
    return Delay(after_ns, saves_ns if saves_ns >= max(in_ns, out_ns) else 0)


def delays_of(route: Route, shapes: Shapes | None) -> tuple[Delay, Delay] | None:
    """Return the forwarding of a request and of its reply; None: they are stored."""
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
    """Return the legs of an exchange with cut-through forwarding, on a line that was quiet."""
    passed_ns = quiet.total_ns - quiet.request_in_ns - quiet.silence_ns - quiet.reply_out_ns
    passed_ns -= request.saves_ns + reply.saves_ns
    return replace(
        quiet,
        silence_ns=max(route.controller.silence_ns - passed_ns, 0),
        request_overlap_ns=-request.saves_ns,
        reply_overlap_ns=-reply.saves_ns,
    )


def drive_side_ns(route: Route, frames: Iterable[PduSizes], drive_ns: int = 0) -> int:
    """Return how long the gateway's own frames delay what follows: each with the silence after it."""
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

    A silence on the drive side costs only what is not hidden behind the controller's own wire. A round passes
    one value on to the next: how long the drives' wire has been quiet when the controller may send again. A
    longer quiet time before a round never gives a shorter one after it, and the difference never grows. The
    value also has a lower and an upper limit. So rounds that begin just after the last exchange either repeat
    from the second on, or become those that begin on a quiet line.
    """
    _, idle_ns = _one_round(route, quiet, 0)
    legs, left_ns = _one_round(route, quiet, idle_ns)
    if left_ns == idle_ns:
        return legs
    _, idle_ns = _one_round(route, quiet, NEVER_NS)
    return _one_round(route, quiet, idle_ns)[0]


def round_ns(route: Route, legs: Sequence[Legs]) -> int:
    """Return the duration of one round: its exchanges, each with the silence that the controller keeps."""
    return sum(each.total_ns + route.controller.silence_ns for each in legs)


def _one_round(route: Route, quiet: Sequence[Legs], idle_ns: int) -> tuple[tuple[Legs, ...], int]:
    """Return the legs, and the quiet time of the drives' wire at the end; ``idle_ns``: at the start."""
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

    A request that would have to wait for that silence before it can be sent on is stored.
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
    """Return the gateway's share before the request goes out: assumed half; the real part is not known."""
    return legs.gateway_ns // 2


class Direct(Struct, frozen=True):
    """The same exchange on one wire, without a gateway."""

    total_ns: int
    waited_ns: int


def direct_of(route: Route, frame: PduSizes, drive_ns: int = 0) -> Direct:
    """Return the times of an exchange without the gateway."""
    wire = route.direct or Wire()
    waited_ns = drive_ns + wire.frame_ns(frame.reply_bytes)
    return Direct(wire.frame_ns(frame.request_bytes) + waited_ns, waited_ns)


def direct_round_ns(route: Route, exchanges: Sequence[Direct]) -> int:
    """Return the duration of a round without the gateway: every frame waits for the drive's silence."""
    wire = route.direct or Wire()
    return sum(each.total_ns + max(wire.silence_ns, route.drive_gap_ns) for each in exchanges)


# --- a line and its controllers ----------------------------------------------------------------------------

BROADCAST = PduSizes(5, 0)
"""One register for all drives."""


class ForwardingBudget(Struct, frozen=True):
    """One exchange of a round with cut-through forwarding.

    No limit is checked against it: an unusual frame is stored, and takes the time of storing.
    """

    delays: tuple[Delay, Delay]
    """Of request and reply."""
    legs: Legs

    @property
    def saves_ns(self) -> int:
        """Gain against storing; 0: no gain."""
        return sum(delay.saves_ns for delay in self.delays)


class ExchangeBudget(Struct, frozen=True):
    """One exchange of a round, with and without the gateway."""

    step: RoundStep
    request_bytes: int
    """On the controller's side."""
    reply_bytes: int
    legs: Legs
    """After the exchange before it in a round."""
    least_ns: int
    """Its time on a quiet line with a gateway that takes no time: only faster wires can reduce it."""
    direct: Direct
    forwarding: "ForwardingBudget | None"
    """The same with cut-through forwarding, whether or not the line uses it; None: it is always stored."""
    added_ns: int
    """Longest delay by the gateway's own frames (W8); not in ``legs``."""

    @property
    def with_added_ns(self) -> int:
        """The controller's waiting time when the gateway's own frames go first."""
        return self.legs.waited_ns + self.added_ns


class RoundBudget(Struct, frozen=True):
    """All exchanges of a round, one after the other."""

    total_ns: int
    direct_ns: int
    added_ns: int
    forwarded_ns: int
    """With all possible cut-through forwarding; equal to ``total_ns`` if there is none."""


class ControllerBudget(Struct, frozen=True):
    """Times of one controller while it is alone on the line."""

    index: int
    name: str
    role: Role
    wire: Wire
    timeout_ns: int
    exchanges: tuple[ExchangeBudget, ...]
    round: RoundBudget

    @property
    def slowest(self) -> ExchangeBudget | None:
        """The exchange that the controller waits for longest; None if none is known."""
        return max(self.exchanges, key=lambda each: each.legs.waited_ns, default=None)

    def longest_ns(self, counted: Callable[[ExchangeBudget], int]) -> int:
        """Return the maximum of ``counted`` over the exchanges; 0 if none is known."""
        return max(map(counted, self.exchanges), default=0)


class AddedBudget(Struct, frozen=True):
    """The gateway's own frames, and how long they delay what follows."""

    added: Added
    hold_ns: int


class LineBudget(Struct, frozen=True):
    """The budget of a line."""

    name: str
    drives: Wire
    gap_ns: int
    """Silence before each request to the drives."""
    drive_gap_ns: int
    """The part of it that the drives require."""
    response_ns: Mapping[str, int]
    """The drive's own time, by axis. An axis with an unknown time is missing and counts as 0."""
    broadcast_ns: int
    """How long a broadcast of one register occupies the drives' wire, with its turnaround; 0 on Modbus
    TCP."""
    controllers: tuple[ControllerBudget, ...]
    added: tuple[AddedBudget, ...]

    def longest_other_ns(self, index: int) -> int:
        """Return the longest delay by one exchange of another controller, with its silence."""
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
    """Return the budget of a line. Pure arithmetic; the plan is not changed."""
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
        # The relay counts the turnaround from the moment of sending.
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
    """Return the exchanges of a round with all possible cut-through forwarding."""
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
    """Return the gateway's budget for one exchange of an axis, or of no axis."""
    budget_us = DEFAULT_BUDGET_US if axis is None else axis.budget_us
    return round(budget_us * NS_PER_MS / US_PER_MS)


def _drive_ns(axis: AxisPlan | None) -> int:
    return 0 if axis is None else round((axis.response_ms or 0.0) * NS_PER_MS)


def _held_up_ns(added: Sequence[AddedBudget]) -> int:
    """Return the longest delay.

    A move is either absolute or relative, so only one of the reads is ever needed.
    """
    writes = [each.hold_ns for each in added if each.added.why is Why.REWRITE]
    reads = [each.hold_ns for each in added if each.added.why is not Why.REWRITE]
    return sum(writes) + max(reads, default=0)
