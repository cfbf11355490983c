"""The small worlds that are walked, the quickest first."""

from typing import Any, Final

from gateway.exchange.plan import AxisPlan, ControllerPlan, Reference
from tests.exchange.line_bench import axis_plan
from tests.exchange.staged_bench import BITS, COMMANDED, STAGED
from tests.verify.designs_rules import designs as designs_of_rules
from tests.verify.screw import WORN
from tests.verify.world import (
    DONE_DROP_TICKS,
    LOST_TICKS,
    TICK_MS,
    UNSEEN_TICKS,
    Design,
)

ONLY_DONE: Final = {"done": BITS["done"]}
HOMED_TOO: Final = {"done": BITS["done"], "homed": BITS["homed"]}


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


HELD_S: Final = 3 * TICK_MS / 1000
"""So long a writer holds an axis."""


def _controllers(*names: str, serial: bool = False) -> tuple[ControllerPlan, ...]:
    return tuple(ControllerPlan(name, timeout_ms=float(TICK_MS), serial=serial) for name in names)


DESIGNS: Final = (
    Design(
        "short",
        "two targets nearer to each other than the hysteresis, on a drive that always answers",
        (_plan(),),
        menu=("to", "read", "status"),
        answers=("ack",),
        targets=(9007, 9008),
    ),
    Design(
        "small",
        "a direct drive that always answers: closes in seconds",
        (_plan(),),
        menu=("to", "read"),
        answers=("ack", "refuse"),
        targets=(-7003, 9007),
        happenings=("arrive", "wait"),
    ),
    Design(
        "direct",
        "a drive that goes to each absolute position as soon as it is written; done early and late",
        (_plan(),),
        menu=("to", "read", "status"),
        happenings=("arrive", "arrive_undone", "wait", "undone", "done"),
        targets=(-7003, 9007),
    ),
    Design(
        "near",
        "targets nearer to each other than their branches, and than the hysteresis",
        (_plan(),),
        menu=("to", "read", "status"),
        answers=("ack", "refuse"),
        happenings=("arrive", "wait"),
        targets=(9007, 9008, 9019),
    ),
    Design(
        "moved",
        "an axis that is jogged on the drive's own panel, and whose done bit blinks",
        (_plan(),),
        menu=("to", "read", "status"),
        answers=("ack", "obey"),
        happenings=("arrive", "wait", "jog", "blink", "creep", "done"),
        targets=(9007, 9008),
    ),
    Design(
        "blind",
        "a drive that says done and not where it is",
        (_plan(actual=()),),
        menu=("to", "status"),
        happenings=("arrive", "wait", "undone"),
        targets=(-7003, 9007, 9008),
    ),
    Design(
        "garbled",
        "a drive that obeys and refuses, or says something else; late frames; a serial controller",
        (_plan(),),
        menu=("to", "read"),
        answers=("ack", "refuse", "obey", "obey-refuse", "garble"),
        happenings=("arrive", "wait", "late"),
        targets=(-7003, 9007),
        controllers=_controllers("cnc", serial=True),
    ),
    Design(
        "impatient",
        "a serial controller that asks again before it is answered",
        (_staged(),),
        menu=("to", "run", "stop"),
        answers=("ack", "obey"),
        targets=(-7003, 9007),
        is_staged=True,
        controllers=_controllers("cnc", serial=True),
        most_asked=2,
    ),
    Design(
        "pipelined",
        "a TCP controller with two requests open, which may close its connection",
        (_staged(),),
        menu=("to", "run", "stop"),
        answers=("ack", "refuse"),
        happenings=("arrive", "wait", "disconnect"),
        targets=(-7003, 9007),
        is_staged=True,
        is_serial=False,
        most_asked=2,
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
    Design(
        "halves",
        "a target written word by word",
        (_staged(travel=(-20.0, 40.0)),),
        menu=("low", "high", "run", "read"),
        targets=(-7003, 9007),
        is_staged=True,
    ),
    Design(
        "relative",
        "a distance that waits for its trigger, from where the drive's own profile stands",
        (_staged(travel=(-12.0, 12.0)),),
        menu=("to", "by", "run", "distance", "stop"),
        targets=(9007,),
        distances=(-4003,),
        answers=("ack", "obey"),
        is_staged=True,
        checks_way_back=False,
    ),
    Design(
        "unplugged",
        "a link that is lost and comes back at any moment",
        (_staged(),),
        menu=("to", "run", "read"),
        answers=("ack", "obey"),
        happenings=("arrive", "wait", "unplug", "plug"),
        targets=(-7003, 9007),
        is_staged=True,
    ),
    Design(
        "killed",
        "a gateway that is killed and started again at any moment, with its record and without",
        (_plan(),),
        menu=("to", "read"),
        answers=("ack", "obey"),
        happenings=("arrive", "wait", "kill", "kill_bare"),
        targets=(-7003, 9007),
        has_record=True,
    ),
    Design(
        "homed",
        "a drive whose homed bit counts, which is switched off and on, and homed",
        (_staged(referenced=Reference.DRIVE_BIT, bits=HOMED_TOO),),
        menu=("to", "run", "home", "read"),
        answers=("ack", "obey"),
        happenings=("arrive", "wait", "reboot", "homed"),
        targets=(-7003, 9007),
        is_staged=True,
        horizon_ticks=14,
    ),
    Design(
        "homing",
        "a reference that a homing command finds, and a position that is set",
        (_staged(referenced=Reference.HOMING, bits=HOMED_TOO),),
        menu=("to", "run", "home", "zero", "read"),
        answers=("ack", "obey"),
        happenings=("arrive", "wait", "homed"),
        targets=(-7003, 9007),
        is_staged=True,
    ),
    Design(
        "writers",
        "two controllers of which only one may move the axis",
        (_staged(has_one_writer=True, writer_hold_s=HELD_S),),
        menu=("to", "run", "stop"),
        answers=("ack", "refuse"),
        targets=(-7003, 9007),
        controllers=_controllers("cnc", "plc"),
        is_staged=True,
    ),
    Design(
        "two-ways",
        "the fast path and the slow one side by side",
        (_plan(),),
        menu=("to", "read", "status", "back"),
        happenings=("arrive", "wait", "undone"),
        targets=(-7003, 9007),
        is_twin=True,
        checks_way_back=False,
    ),
    Design(
        "group",
        "two axes that carry one beam, each with its drive",
        (_staged(), _staged(name="y", unit_id=2)),
        menu=("to", "run", "stop"),
        answers=("ack", "refuse"),
        targets=(9007,),
        groups=(("x", "y"),),
        is_staged=True,
    ),
    Design(
        "late-start",
        "a direct drive that is told to go and stands for as long as it likes",
        (_plan(),),
        menu=("to", "read"),
        answers=("ack", "obey"),
        targets=(-7003, 9007),
        is_prompt=False,
    ),
    Design(
        "deaf",
        "a direct drive that refuses to be read",
        (_plan(),),
        menu=("to", "read"),
        targets=(9007, 9019),
        refuses_reads=True,
    ),
    *designs_of_rules(_plan, _staged),
)
BROKEN: Final = (
    Design(
        "changes",
        "another table, half a gain, compensation off and on, at any moment",
        (_plan(),),
        menu=("to", "read"),
        answers=("ack", "obey"),
        happenings=("arrive", "wait", "table", "gain", "switch"),
        targets=(-7003, 9007),
    ),
    Design(
        "read-back",
        "a jogged axis whose target was not acknowledged and is read back from its register",
        (_plan(),),
        menu=("to", "read", "back"),
        answers=("ack", "obey"),
        happenings=("arrive", "wait", "jog"),
        targets=(9007, 9008),
    ),
)
"""Worlds in which a rule is broken today (docs/verify.md); they are walked by their names only."""
BY_NAME: Final = {design.name: design for design in (*DESIGNS, *BROKEN)}
