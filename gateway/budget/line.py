"""The budget of one line: each exchange of each controller, a round of them, and both without the gateway."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from gateway.budget.cuts import Delay
from gateway.budget.frames import Frame
from gateway.budget.sequence import AS_MAPPED, Added, Blocks, Step, Why, added_of, round_of
from gateway.budget.timing import (
    Direct,
    Legs,
    Route,
    cut_through,
    delays_of,
    direct_of,
    direct_round_ns,
    drive_side_ns,
    in_round,
    legs_of,
    round_ns,
)
from gateway.budget.wire import Wire, wire_of
from gateway.exchange.plan import DEFAULT_BUDGET_US, AxisPlan, Role
from gateway.state.plan import ControllerLink, LinePlan
from gateway.times import NS_PER_MS, US_PER_MS

BROADCAST = Frame(5, 0)
"""One register for all drives."""


@dataclass(frozen=True, slots=True)
class CutBudget:
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

    step: Step
    request_bytes: int
    """On the controller's side."""
    reply_bytes: int
    legs: Legs
    """Behind the exchange before it in a round."""
    least_ns: int
    """What it waits on a quiet line with a gateway that takes no time: what nothing saves but the wires."""
    direct: Direct
    cut: "CutBudget | None"
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
    cut_ns: int
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
            cut_ns=round_ns(route, [each.cut.legs if each.cut else each.legs for each in exchanges]),
        ),
    )


def _exchange_budgets(
    route: Route, steps: Sequence[Step], axes: Mapping[str, AxisPlan], added: tuple[AddedBudget, ...]
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
            cut=cut,
            added_ns=_held_up_ns(
                [each for each in added if (each.added.axis, each.added.before) == (step.axis, step.what)]
            ),
        )
        for step, legs, fastest, cut in zip(
            steps, in_round(route, quiet), at_once, _cuts(route, steps, quiet), strict=True
        )
    )


def _cuts(route: Route, steps: Sequence[Step], quiet: Sequence[Legs]) -> list[CutBudget | None]:
    """Return the exchanges of a round in which all is cut through that may be."""
    delays = [delays_of(route, step.shapes) for step in steps]
    early = [
        legs if delay is None else cut_through(route, legs, *delay)
        for legs, delay in zip(quiet, delays, strict=True)
    ]
    return [
        None if delay is None else CutBudget(delay, legs)
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
    writes = [each.hold_ns for each in added if each.added.why is Why.RESTAGE]
    reads = [each.hold_ns for each in added if each.added.why is not Why.RESTAGE]
    return sum(writes) + max(reads, default=0)
