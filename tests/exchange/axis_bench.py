"""One axis without a line: the tests pass acknowledgements, readings and bits to its parts directly.

The table is LOST_MOTION, at 1000 counts per mm: forward, 10 counts more. Commands come at 1 ms.
"""

from collections.abc import Callable
from typing import Any, Final

from gateway.compensation.moves import Accepted
from gateway.drives.motion import Action
from gateway.exchange.access import Access
from gateway.exchange.axis.acknowledge import Outcome, Rendering
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.decode import AxisCommand, DecodedRequest
from gateway.exchange.effects import finish
from gateway.exchange.request import NOTHING_PREFETCHED, Request
from gateway.exchange.unit import UnitMap
from gateway.modbus.registers import BitField
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, axis_plan

DONE_BIT: Final = {"done": BitField(0x30, 0)}
WRITE: Final = bytes((0x10,)) + COMMAND.address.to_bytes(2, "big") + bytes.fromhex("0002 04 00000000")


def an_axis(*, has_actual: bool = True, **changes: Any) -> Axis:
    changes = {"bits": DONE_BIT, "done_drop_ms": 0.0, "actual": (ACTUAL,) if has_actual else (), **changes}
    return Axis(axis_plan(**changes))


def target(axis: Axis, counts: int, *, is_distance: bool = False) -> Rendering:
    move = axis.compensation.plan(counts, None, 0)
    start = Accepted(1000, 1010) if is_distance else None
    return Rendering(
        0, COMMAND.pack(counts), COMMAND.pack(counts + 10), counts + 10, move, is_distance, start
    )


def see(axis: Axis, counts: int) -> None:
    axis.observe_actual(ACTUAL, ACTUAL.pack(counts), 5 * MS)


def do(axis: Axis, action: Action) -> None:
    end(AxisCommand(axis, action), Outcome.ACKNOWLEDGED, 0, 1 * MS)


def end(command: AxisCommand, outcome: Outcome, code: int, now_ns: int) -> None:
    """End a request that contains only this command of its axis."""
    frame = DecodedRequest(
        UnitMap([command.axis]), WRITE, Access(write_address=COMMAND.address, write_quantity=2), {}
    )
    finish(Request(frame, [command], NOTHING_PREFETCHED, 0, arrived_ns=0), outcome, code, now_ns)


def acknowledge(axis: Axis, counts: int = 50_000) -> None:
    axis.targets.acknowledge(target(axis, counts), 1 * MS)


def leave_unacknowledged(axis: Axis) -> None:
    axis.targets.leave_unacknowledged(target(axis, 70_000, is_distance=True), 1 * MS)


def done(at_ms: int, *, is_done: bool = True) -> Callable[[Axis], None]:
    return lambda axis: axis.motion.observe_done(at_ms * MS, is_done=is_done)


REACHED: Final[dict[str, tuple[MotionState, tuple[Callable[[Axis], None], ...]]]] = {
    "unknown": (MotionState.UNKNOWN, (acknowledge, lambda axis: do(axis, Action.OTHER_MOTION))),
    "stopped": (MotionState.STOPPED, (acknowledge, lambda axis: do(axis, Action.STOP))),
    "unreferenced": (MotionState.SUPERSEDED, (acknowledge, lambda axis: axis.wait_for_peers(waits=True))),
    "out-of-reach": (MotionState.SUPERSEDED, (acknowledge, lambda axis: axis.lose_link(2 * MS))),
    "unacknowledged": (MotionState.UNACKNOWLEDGED, (leave_unacknowledged,)),
    "unacknowledged-done": (MotionState.UNACKNOWLEDGED, (leave_unacknowledged, done(3))),
    "moving": (MotionState.MOVING, (acknowledge,)),
    "moving-from-a-known-start": (
        MotionState.MOVING,
        (lambda axis: acknowledge(axis, 40_000), lambda axis: do(axis, Action.STOP), acknowledge),
    ),
    "done-reported": (MotionState.DONE_REPORTED, (acknowledge, done(3))),
    "in-window": (MotionState.IN_WINDOW, (acknowledge, lambda axis: see(axis, 50_010))),
    "arrived": (MotionState.ARRIVED, (acknowledge, done(3), lambda axis: see(axis, 50_010))),
    "may-have-left": (MotionState.MAY_HAVE_LEFT, (acknowledge, done(3), done(4, is_done=False))),
    "at-rest": (MotionState.AT_REST, (acknowledge, done(3), done(4, is_done=False), done(4))),
}
"""Each state, with what it may bring along, and what leads there."""


def reached(way: str, axis: Axis | None = None) -> Axis:
    """Return an axis in the named state."""
    axis = axis or an_axis()
    for step in REACHED[way][1]:
        step(axis)
    return axis


def kinds(axis: Axis) -> list[str]:
    return [event.kind.name for event in axis.take_events()]
