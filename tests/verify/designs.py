"""The small worlds that are walked, the quickest first."""

from dataclasses import replace
from typing import Any, Final

from gateway.drives.motion import MotionPlan
from gateway.exchange.plan import AxisPlan
from tests.exchange.line_bench import axis_plan
from tests.exchange.staged_bench import BITS, COMMANDED, STAGED
from tests.verify.screw import WORN
from tests.verify.world import (
    DONE_DROP_TICKS,
    LOST_TICKS,
    TICK_MS,
    UNSEEN_TICKS,
    Design,
)

ONLY_DONE: Final = {"done": BITS["done"]}


def _plan(**changes: Any) -> AxisPlan:
    """An axis on a steep table, with all its times in ticks."""
    plan: dict[str, Any] = {
        "table": WORN.table(),
        "bits": ONLY_DONE,
        "fresh_ms": float(TICK_MS),
        "done_drop_ms": float(DONE_DROP_TICKS * TICK_MS),
        "unseen_ms": float(UNSEEN_TICKS * TICK_MS),
        "lost_ms": float(LOST_TICKS * TICK_MS),
        "has_one_writer": False,
    }
    return axis_plan(**(plan | changes))


def _staged(**changes: Any) -> AxisPlan:
    return _plan(**({"motion": STAGED, "commanded": (COMMANDED,)} | changes))


STOPPED: Final = replace(STAGED, is_staged=False)
DIRECT: Final = MotionPlan()

DESIGNS: Final = (
    Design(
        "direct",
        "a drive that goes to each absolute position as soon as it is written",
        (_plan(),),
        menu=("to", "read", "status"),
        answers=("ack", "refuse", "obey"),
        happenings=("arrive", "wait", "undone"),
        targets=(-7003, 9007),
    ),
    Design(
        "staged",
        "an absolute target that waits for its trigger",
        (_staged(),),
        menu=("to", "run", "stop", "read", "status"),
        happenings=("arrive", "wait", "undone"),
        targets=(-7003, 9007),
        is_staged=True,
    ),
)
BY_NAME: Final = {design.name: design for design in DESIGNS}
