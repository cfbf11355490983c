"""The small worlds that are walked, the quickest first."""

from dataclasses import replace
from typing import Any, Final

from gateway.exchange.plan import AxisPlan, CompensationMode, ControllerPlan, Reference
from tests.exchange.line_bench import axis_plan
from tests.exchange.staged_bench import BITS, COMMANDED, STAGED
from tests.verify import designs_frames, designs_mutants
from tests.verify.designs_pairs import LARGER, TWO_AT_ONCE, pair_world
from tests.verify.designs_rules import SETTLE, ask
from tests.verify.designs_rules import designs as designs_of_rules
from tests.verify.screw import WORN
from tests.verify.world import (
    DONE_DROP_TICKS,
    DRAIN_TICKS,
    LOST_TICKS,
    TICK_MS,
    UNSEEN_TICKS,
    Design,
    Happening,
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
    *designs_frames.large(_plan),
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
    Design(
        "killed-near",
        "a gateway that is killed while its axis stands between targets nearer than their branches",
        (_plan(),),
        menu=("to", "read"),
        answers=("ack", "obey"),
        happenings=("arrive", "wait", "kill"),
        targets=(9007, 9019),
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
        ways=(
            (
                ("ask", 0, "to", 0, 1),
                ("drive", "ack"),
                ("drive", "obey"),
                ("reboot", 0),
                ("ask", 0, "run", 0),
                ("settle",),
                ("wait",),
            ),
        ),
    ),
)


WAIT: Final = ("wait",)
ASK_TO: Final = ("ask", 0, "to", 0, 0)
ASK_READ: Final = ("ask", 0, "read", 0)
ASK_TO_Y: Final = ("ask", 0, "to", 1, 0)


def _small(name: str, about: str, *plans: AxisPlan, **changes: Any) -> Design:
    """A world that closes: one family of events beside targets and time; the drive answers in time."""
    parts: dict[str, Any] = {
        "menu": ("to", "read"),
        "answers": ("ack",),
        "happenings": ("arrive", "wait"),
        "targets": (-7003, 9007),
        "is_answered": True,
    }
    parts |= changes
    parts.setdefault("checks_way_back", len(parts["targets"]) > 1)  # an unsure branch needs another target
    return Design(name, about, plans or (_plan(),), **parts)


def _small_staged(name: str, about: str, *plans: AxisPlan, **changes: Any) -> Design:
    parts: dict[str, Any] = {"menu": ("to", "run", "read"), "is_staged": True, "targets": (9007,)}
    return _small(name, about, *(plans or (_staged(),)), **(parts | changes))


LOST_BETWEEN: Final = (
    *ask("to", 0),
    *ask("to", 0, axis=1),
    *ask("run"),
    ("homed_bit", 1),
    *ask("status-wide", axis=1),
    *ask("run", axis=1),
    ("homed_bit", 1),
    *ask("status-wide", axis=1),
)
UNCONFIRMED: Final[tuple[tuple[Happening, ...], ...]] = (
    (("drive", "obey-refuse"),),
    (("drive", "obey"), *(("wait",),) * (2 + DRAIN_TICKS)),
)
"""The last frame is obeyed, and its answer proves nothing of that, or does not come."""
BOTH_TO: Final = (*ask("to", 0), *ask("to", 0, axis=1))
BOTH_RUN: Final = (*ask("run"), *ask("run", axis=1))


def _perhaps_gone(answer: tuple[Happening, ...], change: Happening) -> tuple[Happening, ...]:
    """The first trigger is not proven, something changes, and both are told the same once more."""
    bits = (*ask("status-wide"), *ask("status-wide", axis=1)) if change[0] == "homed_bit" else ()
    # Of each axis the place is read and the target written anew.
    first = (*BOTH_TO, *bits, ("ask", 0, "run", 0), *(("drive", "ack"),) * 4, *answer)
    told = ask("status-wide", axis=1) if bits else ()
    return (*first, *ask("run", axis=1), change, *told, *BOTH_TO, *BOTH_RUN)


def _movers_perhaps_gone(answer: tuple[Happening, ...]) -> tuple[Happening, ...]:
    """The same of drives that go as they are written."""
    return (("ask", 0, "to", 0, 0), ("drive", "ack"), *answer, ("switch",), *BOTH_TO)


KEPT_BESIDE_ANEW: Final = (*BOTH_TO, ("switch",), *ask("to", 1, axis=1), *ask("to", 0))
"""One axis goes by what was switched, and another one is told the same as before."""
STORED_PASS: Final = replace(STAGED, passes_stored_moves=True)
TIME: Final = ("arrive", "wait")
CLOSING: Final = (
    _small("s-status", "done bit and position", menu=("to", "read", "status")),
    _small(
        "s-near", "the same, nearer than the branches", menu=("to", "read", "status"), targets=(9007, 9019)
    ),
    _small(
        "s-hair", "the same, nearer than the hysteresis", menu=("to", "read", "status"), targets=(9007, 9008)
    ),
    _small("s-three", "three targets", targets=(-7003, 9007, 9019)),
    _small("s-refused", "writes and reads refused", answers=("ack", "refuse")),
    _small("s-refused-near", "the same, near", answers=("ack", "refuse"), targets=(9007, 9019)),
    _small(
        "s-early",
        "done earlier than there",
        menu=("to", "status"),
        happenings=(*TIME, "done"),
        targets=(9007,),
        checks_way_back=False,
    ),
    _small(
        "s-later",
        "done later than there",
        menu=("to", "status"),
        happenings=("wait", "arrive_undone", "done"),
        targets=(9007,),
        checks_way_back=False,
    ),
    _small(
        "s-falls",
        "done falls late",
        _plan(done_drop_ms=2.0 * TICK_MS),
        menu=("to", "status"),
        happenings=(*TIME, "undone"),
        drop_ticks=2,
    ),
    _small(
        "s-falls-read",
        "the same, and read; one target",
        menu=("to", "read", "status"),
        targets=(9007,),
        happenings=(*TIME, "undone", "arrive_undone", "done"),
        checks_way_back=False,
    ),
    _small(
        "s-silent",
        "frames that are not answered",
        answers=("ack", "obey"),
        targets=(9007,),
        is_answered=False,
    ),
    _small(
        "s-silent-status",
        "the same with the done bit",
        menu=("to", "status"),
        answers=("ack", "obey"),
        targets=(9007,),
        is_answered=False,
    ),
    _small(
        "s-polled",
        "a drive that is silent, and late, is read and written, whoever waits",
        menu=("to", "read"),
        answers=("ack",),
        happenings=("wait", "arrive", "late"),
        targets=(9007,),
        is_answered=False,
        checks_way_back=False,
        ways=(
            (ASK_READ, WAIT, ASK_READ, ASK_READ, ASK_READ, WAIT, ("drive", "ack")),
            (ASK_READ, WAIT, ASK_READ, ASK_TO, ASK_TO, ASK_READ, WAIT, ("drive", "ack"), ASK_TO),
            (ASK_READ, WAIT, ("late",), ASK_READ, ASK_READ, ASK_READ, WAIT, ("drive", "ack")),
        ),
    ),
    _small("s-garbled", "answers that prove nothing", answers=("ack", "garble")),
    _small(
        "s-obeyed",
        "refused and carried out all the same",
        answers=("ack", "obey-refuse"),
        targets=(9007,),
        checks_way_back=False,
    ),
    _small(
        "s-jogged",
        "moved on its own panel",
        happenings=(*TIME, "jog"),
        targets=(9007,),
        checks_way_back=False,
    ),
    _small(
        "s-jogged-refused",
        "the same, refused",
        happenings=(*TIME, "jog"),
        answers=("ack", "refuse"),
        targets=(9007,),
        checks_way_back=False,
    ),
    _small(
        "s-blinks",
        "done blinks, the axis creeps",
        menu=("to", "read", "status"),
        targets=(9007,),
        happenings=(*TIME, "blink", "creep", "done"),
        checks_way_back=False,
    ),
    _small(
        "s-crept-past",
        "done falls of an axis that stands, is seen there yet, and goes past the next target unseen",
        menu=("to", "read", "status"),
        targets=(9007, 5003),
        happenings=(*TIME, "blink", "creep"),
    ),
    _small(
        "s-jogged-past",
        "moved on its own panel, past its target",
        happenings=(*TIME, "jog"),
        targets=(2003,),
        checks_way_back=False,
    ),
    _small(
        "s-nudged",
        "moved a little by hand, past its next target, and seen there",
        menu=("to", "read", "status"),
        targets=(9007, 9107),
        happenings=(*TIME, "nudge"),
        ways=(
            (
                *ask("to", 0),
                ("arrive", 0),
                *ask("read"),
                ("nudge", 0),
                *ask("read"),
                *ask("status"),
                *ask("to", 1),
            ),
        ),
    ),
    _small(
        "s-nudged-silent",
        "the same, and the next target is not answered",
        menu=("to", "read", "status"),
        answers=("ack", "obey"),
        targets=(9007, 9107),
        happenings=(*TIME, "nudge"),
        is_answered=False,
        checks_way_back=False,
        ways=(
            (
                *ask("to", 0),
                ("arrive", 0),
                *ask("status"),
                *ask("read"),
                ("nudge", 0),
                *ask("read"),
                ("ask", 0, "to", 0, 1),
                ("drive", "obey"),
                WAIT,
                WAIT,
                WAIT,
            ),
        ),
    ),
    _small("s-blind", "done and no position", _plan(actual=()), menu=("to", "status")),
    _small(
        "s-blind-near",
        "the same, near and refused",
        _plan(actual=()),
        menu=("to", "status"),
        answers=("ack", "refuse"),
        targets=(9007, 9008),
    ),
    _small(
        "s-deaf",
        "reads refused",
        refuses_reads=True,
        answers=("ack", "refuse"),
        targets=(9007,),
        checks_way_back=False,
    ),
    _small("s-slow", "stands as long as it likes", is_prompt=False),
    _small(
        "s-slow-near",
        "the same, near",
        is_prompt=False,
        targets=(9007, 9019),
    ),
    _small(
        "s-back",
        "its target register read back",
        menu=("to", "back", "read"),
        answers=("ack", "refuse"),
        targets=(9007,),
    ),
    _small(
        "s-table",
        "another table",
        happenings=(*TIME, "table"),
        targets=(9007,),
    ),
    _small(
        "s-gain",
        "half a gain",
        happenings=(*TIME, "gain"),
        targets=(9007,),
    ),
    _small(
        "s-switch",
        "off and on",
        happenings=(*TIME, "switch"),
        targets=(9007,),
    ),
    _small(
        "s-dry-run",
        "a dry run, and its end",
        _plan(compensation=CompensationMode.SHADOW),
        menu=("to", "read", "status"),
        happenings=(*TIME, "end_dry_run"),
    ),
    _small(
        "s-dry-run-refused",
        "the same, refused and obeyed without an answer",
        _plan(compensation=CompensationMode.SHADOW),
        answers=("ack", "refuse", "obey"),
        happenings=(*TIME, "end_dry_run"),
        targets=(9007,),
        is_answered=False,
    ),
    _small_staged(
        "s-dry-run-staged",
        "the same, staged, stopped and jogged",
        _staged(compensation=CompensationMode.SHADOW),
        menu=("to", "run", "stop", "read", "status"),
        happenings=(*TIME, "jog", "end_dry_run"),
        ways=(
            (
                *(*ask("to", 0), *ask("run"), ("arrive", 0), *ask("read"), ("jog", 0)),
                *(("ask", 0, "read", 0), ("end_dry_run",), SETTLE, *ask("run")),
            ),
        ),
    ),
    _small(
        "s-table-switch",
        "table and switch",
        menu=("to",),
        happenings=(*TIME, "table", "switch"),
        targets=(9007,),
    ),
    _small(
        "s-deaf-link",
        "reads refused until the link is lost and comes back",
        menu=("to",),
        answers=("ack", "refuse"),
        refuses_reads=True,
        happenings=(*TIME, "unplug", "plug"),
        targets=(-7003, 9007),
        ways=(
            (
                *(("ask", 0, "to", 0, 1), ("drive", "ack"), ("drive", "ack"), ("arrive", 0)),
                *(("ask", 0, "to", 0, 0), ("drive", "refuse"), ("drive", "refuse"), ("drive", "ack")),
                *(("arrive", 0), ("wait",), ("wait",), ("wait",)),
                *(("ask", 0, "to", 0, 1), ("drive", "ack"), ("arrive", 0)),  # it is not asked any more
                *(("unplug",), ("plug",), ("ask", 0, "to", 0, 0), ("drive", "refuse")),
                *(("drive", "ack"), ("drive", "ack"), ("arrive", 0)),
            ),
        ),
    ),
    _small(
        "s-link",
        "the link is lost and comes back",
        happenings=(*TIME, "unplug", "plug"),
        targets=(9007,),
    ),
    _small(
        "s-killed",
        "killed with its record",
        happenings=(*TIME, "kill"),
        has_record=True,
        targets=(-7003, 9007),
        menu=("to",),
    ),
    _small(
        "s-killed-jogged",
        "killed with its record, and moved on its own panel",
        targets=(9007,),
        has_record=True,
        happenings=(*TIME, "kill", "jog"),
        checks_way_back=False,
    ),
    _small_staged(
        "s-killed-deaf",
        "killed, and told nothing of where it stands before it is moved",
        menu=("to", "run", "jog-on"),
        answers=("ack", "refuse"),
        has_record=True,
        refuses_reads=True,
        happenings=(*TIME, "kill"),
        checks_way_back=False,
        ways=(
            (
                ("ask", 0, "to", 0, 0),
                ("drive", "ack"),
                ("ask", 0, "run", 0),
                *(("drive", "refuse"),) * 2,
                ("drive", "ack"),
                ("arrive", 0),
                ("kill",),
                *(("drive", "refuse"),) * 2,
                ("ask", 0, "jog-on", 0),
                ("drive", "ack"),
            ),
        ),
    ),
    _small(
        "s-killed-bare",
        "killed without",
        happenings=(*TIME, "kill", "kill_bare"),
        has_record=True,
        menu=("to",),
        targets=(-7003, 9007),
    ),
    _small(
        "s-killed-obeyed",
        "killed before the drive has answered",
        happenings=(*TIME, "kill"),
        menu=("to",),
        answers=("ack", "obey"),
        has_record=True,
        targets=(9007,),
    ),
    _small_staged("s-staged", "a target that waits for its trigger"),
    _small_staged("s-staged-two", "two of them", menu=("to", "run"), targets=(-7003, 9007)),
    _small_staged(
        "s-staged-refused",
        "refused",
        menu=("to", "run"),
        answers=("ack", "refuse"),
        targets=(9007,),
    ),
    _small_staged(
        "s-stop",
        "stopped",
        menu=("to", "run", "stop"),
        targets=(-7003, 9007),
    ),
    _small_staged(
        "s-stop-refused", "stopped and refused", menu=("to", "run", "stop"), answers=("ack", "refuse")
    ),
    _small_staged("s-halves", "word by word", menu=("low", "high", "run"), happenings=("wait",)),
    _small_staged(
        "s-halves-unwritten",
        "word by word, refused with proof that nothing was written: no trigger runs beside it",
        _staged(exception_writes_nothing=True),
        menu=("low", "high", "run", "to"),
        answers=("ack", "refuse"),
        happenings=("wait",),
        targets=(9007,),
    ),
    _small(
        "s-halves-moving",
        "word by word to a drive that moves with each, refused with proof that nothing was written",
        _plan(exception_writes_nothing=True),
        menu=("low", "high"),
        answers=("ack", "refuse"),
        targets=(9007,),
    ),
    _small_staged(
        "s-halves-refused",
        "word by word, refused",
        menu=("low", "high", "run"),
        answers=("ack", "refuse"),
        happenings=("wait",),
    ),
    _small_staged(
        "s-distance",
        "a distance",
        _staged(travel=(-12.0, 12.0)),
        menu=("to", "by", "run", "distance"),
        distances=(-4003,),
        checks_way_back=False,
    ),
    _small_staged(
        "s-homed",
        "a homed bit, switched off and on",
        _staged(referenced=Reference.DRIVE_BIT, bits=HOMED_TOO),
        menu=("to", "run", "home"),
        happenings=(*TIME, "reboot", "homed"),
        horizon_ticks=14,
    ),
    _small_staged(
        "s-homing",
        "homing and a position that is set",
        _staged(referenced=Reference.HOMING, bits=HOMED_TOO),
        menu=("to", "run", "home", "zero"),
        happenings=(*TIME, "homed"),
    ),
    _small_staged(
        "s-writers",
        "two controllers",
        _staged(has_one_writer=True, writer_hold_s=HELD_S),
        menu=("to", "run"),
        controllers=_controllers("cnc", "plc"),
    ),
    _small_staged(
        "s-group",
        "a beam",
        _staged(),
        _staged(name="y", unit_id=2),
        menu=("to", "run"),
        groups=(("x", "y"),),
        happenings=("wait",),
    ),
    _small_staged(
        "s-group-switch",
        "a beam, switched between the triggers of its axes",
        _staged(),
        _staged(name="y", unit_id=2),
        menu=("to", "run"),
        groups=(("x", "y"),),
        happenings=(
            "switch",
            "wait",
        ),
        answers=("ack", "obey-refuse", "obey"),
        is_answered=False,
        judges_blocks=False,
        ways=tuple(_perhaps_gone(each, ("switch",)) for each in UNCONFIRMED),
    ),
    _small_staged(
        "s-group-bit",
        "a beam of which the homed bit of an axis falls between the triggers",
        _staged(referenced=Reference.DRIVE_BIT, bits=BITS),
        _staged(name="y", unit_id=2, referenced=Reference.DRIVE_BIT, bits=BITS),
        menu=("to", "run", "status-wide"),
        groups=(("x", "y"),),
        happenings=("homed_bit", "arrive", "wait"),
        answers=("ack", "obey-refuse", "obey"),
        is_answered=False,
        horizon_ticks=14,
        judges_blocks=False,
        checks_way_back=False,
        ways=(LOST_BETWEEN, *(_perhaps_gone(each, ("homed_bit", 1)) for each in UNCONFIRMED)),
    ),
    _small(
        "s-group-movers",
        "a beam of drives that go as they are written, switched between two targets",
        _plan(),
        _plan(name="y", unit_id=2),
        menu=("to",),
        targets=(9007, 5003),
        groups=(("x", "y"),),
        happenings=("switch", "arrive", "wait"),
        answers=("ack", "obey-refuse", "obey"),
        is_answered=False,
        judges_blocks=False,
        ways=(*(_movers_perhaps_gone(each) for each in UNCONFIRMED), KEPT_BESIDE_ANEW),
    ),
    _small_staged(
        "s-group-refused",
        "a beam, refused",
        _staged(),
        _staged(name="y", unit_id=2),
        menu=("to", "run"),
        groups=(("x", "y"),),
        happenings=(),
        answers=("ack", "refuse"),
    ),
    _small_staged(
        "s-group-unwritten",
        "a beam, refused with proof that nothing was written",
        _staged(exception_writes_nothing=True),
        _staged(name="y", unit_id=2, exception_writes_nothing=True),
        menu=("to", "run"),
        groups=(("x", "y"),),
        happenings=(),
        answers=("ack", "refuse"),
    ),
    _small_staged(
        "s-impatient",
        "asks again before it is answered",
        menu=("to", "run", "stop"),
        controllers=_controllers("cnc", serial=True),
        most_asked=2,
        happenings=("arrive",),
    ),
    _small(
        "b-requests",
        "begins at bytes: half requests, and their tails at any time",
        targets=(9007,),
        happenings=(*TIME, "half"),
        is_serial=False,
        is_bytes=True,
    ),
    _small(
        "b-pairs",
        "begins at bytes: two requests in one read, a connection that closes",
        targets=(9007,),
        happenings=(*TIME, "pair", "disconnect"),
        is_serial=False,
        is_bytes=True,
        most_asked=2,
        menu=("to",),
    ),
    _small(
        "b-replies",
        "begins at bytes: replies in two pieces, and late ones before the next",
        targets=(9007,),
        happenings=(*TIME, "split", "late"),
        is_serial=False,
        is_bytes=True,
        is_answered=False,
        menu=("to",),
        answers=("ack",),
    ),
    _small(
        "s-killed-within",
        "killed in the middle of an event, before each store of its record",
        menu=("to",),
        happenings=(*TIME, "kill_at"),
        has_record=True,
        targets=(9007,),
    ),
    _small(
        "s-killed-within-near",
        "the same, with two targets near each other",
        menu=("to",),
        happenings=("arrive", "kill_at"),
        has_record=True,
        targets=(9007, 9019),
    ),
    _small_staged(
        "s-killed-staged",
        "killed in the middle of an event, staged",
        menu=("to", "run"),
        has_record=True,
        happenings=("arrive", "kill_at"),
    ),
    _small(
        "s-other-boot",
        "switched off and on with its record",
        menu=("to",),
        happenings=(*TIME, "kill_boot"),
        has_record=True,
        targets=(9007, 9019),
    ),
    _small(
        "s-torn",
        "switched off and on, the newest record torn in the middle",
        menu=("to",),
        happenings=(*TIME, "kill_torn"),
        has_record=True,
        targets=(9007,),
        checks_way_back=False,
    ),
    _small_staged(
        "s-group-half",
        "a beam of which one axis lost its record",
        _staged(),
        _staged(name="y", unit_id=2),
        menu=("to", "run"),
        groups=(("x", "y"),),
        happenings=("arrive", "kill_half"),
        has_record=True,
    ),
    _small(
        "s-two-units",
        "two drives on a line",
        _plan(),
        _plan(name="y", unit_id=2),
        menu=("to",),
        targets=(9007,),
    ),
    _small(
        "s-two-silent",
        "the same, silent; a dead one is tried again",
        _plan(),
        _plan(name="y", unit_id=2),
        menu=("to", "read"),
        answers=("ack", "obey"),
        targets=(9007,),
        is_answered=False,
        retry_ms=2.0 * TICK_MS,
        checks_way_back=False,
        ways=((ASK_TO_Y, WAIT, WAIT, ASK_TO_Y, WAIT, WAIT, ASK_TO_Y, WAIT, WAIT, ASK_TO_Y, WAIT, ASK_TO_Y),),
    ),
    _small(
        "s-two-group-silent",
        "the same, on one beam",
        _plan(),
        _plan(name="y", unit_id=2),
        menu=("to",),
        answers=("ack", "obey"),
        targets=(9007,),
        groups=(("x", "y"),),
        is_answered=False,
        retry_ms=2.0 * TICK_MS,
        checks_way_back=False,
        ways=((ASK_TO_Y, WAIT, WAIT, ASK_TO_Y, WAIT, WAIT, ASK_TO_Y, WAIT, ASK_TO_Y),),
    ),
    _small(
        "s-down", "a drive that counts the other way", _plan(counts_per_unit=-1000.0), targets=(-7003, 9007)
    ),
    _small(
        "s-down-near",
        "the same, near",
        _plan(counts_per_unit=-1000.0),
        menu=("to", "read", "status"),
        targets=(9007, 9019),
    ),
    _small(
        "s-carry",
        "corrections that carry from one word to the other",
        _plan(max_speed=1000.0),
        targets=(65530, 65541),
        checks_way_back=False,
    ),
    _small_staged(
        "s-carry-halves",
        "the same word by word",
        menu=("low", "high", "run"),
        happenings=("wait",),
        targets=(65530,),
        checks_way_back=False,
    ),
    _small(
        "s-vendor",
        "refuses with another function byte",
        answers=("ack", "vendor"),
        refuses_reads=True,
        targets=(9007,),
        checks_way_back=False,
    ),
    _small(
        "s-vendor-named",
        "the same, and its map names it",
        _plan(refused_read=0x81),
        answers=("ack", "vendor"),
        refuses_reads=True,
        targets=(9007,),
        checks_way_back=False,
    ),
    _small(
        "s-in-position",
        "says in-position instead of done",
        _plan(done_is_in_position=True),
        menu=("to", "read", "status"),
        is_in_position=True,
    ),
    _small_staged(
        "s-stored",
        "runs positions that the drive keeps",
        _staged(motion=STORED_PASS),
        menu=("to", "run", "stored"),
    ),
    _small_staged("s-stored-refused", "must not run them", menu=("to", "run", "stored")),
    _small_staged("s-jog-on", "jogged by its controller", menu=("to", "run", "jog-on", "stop")),
    _small_staged(
        "s-jog-on-near",
        "the same, to a place near its target, and its done bit may be old",
        menu=("to", "run", "jog-on"),
        targets=(2960, 9007),
        drop_ticks=3,
        ways=((*ask("to", 1), *ask("run"), ("arrive", 0), *ask("jog-on"), *ask("to", 0), *ask("run")),),
    ),
    _small(
        "s-ways", "fast and slow path", menu=("to", "read", "status"), is_twin=True, checks_way_back=False
    ),
    *designs_frames.designs(_small, _small_staged, _plan, _staged),
    *designs_mutants.designs(_small, _small_staged, _plan, _staged),
)
"""Worlds that close: together they have in pairs what the large ones have at once."""


def _pair(name: str, about: str, *plans: AxisPlan, **changes: Any) -> Design:
    """The smallest world with two families of events at once: one target, which is written and not read."""
    parts: dict[str, Any] = {"menu": ("to",), "targets": (9007,)}
    if changes.pop("is_silent", False):
        parts |= {"answers": ("ack", "obey"), "is_answered": False}
    if changes.pop("is_triggered", False):
        parts |= {"menu": ("to", "run"), "is_staged": True}
        plans = plans or (_staged(),)
    return _small(name, about, *plans, **(parts | changes))


STATUS_TOO: Final = ("to", "status")
HOMING_PLAN: Final = _staged(referenced=Reference.HOMING, bits=HOMED_TOO)
SWITCHED_PLAN: Final = _staged(referenced=Reference.DRIVE_BIT, bits=HOMED_TOO)
PAIRS: Final = (
    _pair("p-refuse-silent", "refused, and silent", answers=("ack", "refuse", "obey"), is_answered=False),
    _pair(
        "p-done-silent",
        "done early and late, silent",
        menu=STATUS_TOO,
        is_silent=True,
        happenings=("wait", "arrive_undone", "done"),
    ),
    _pair(
        "p-falls-silent",
        "done falls late, silent",
        menu=STATUS_TOO,
        is_silent=True,
        happenings=(*TIME, "undone"),
    ),
    _pair(
        "p-refuse-done",
        "done at any time, refused",
        menu=STATUS_TOO,
        answers=("ack", "refuse"),
        happenings=(*TIME, "arrive_undone", "done", "undone"),
    ),
    _pair("p-jog-silent", "jogged, silent", is_silent=True, happenings=(*TIME, "jog")),
    _pair(
        "p-jog-blinks",
        "jogged, done blinks",
        menu=STATUS_TOO,
        happenings=(*TIME, "jog", "blink", "creep", "done"),
    ),
    _pair(
        "p-blinks-silent",
        "done blinks, silent",
        menu=STATUS_TOO,
        is_silent=True,
        happenings=(*TIME, "blink", "creep"),
    ),
    _pair("p-answers", "every answer that there is", answers=("ack", "refuse", "garble", "obey-refuse")),
    _pair(
        "p-answers-silent",
        "the same, silent and late",
        answers=("ack", "garble", "obey-refuse", "obey"),
        happenings=(*TIME, "late"),
        is_answered=False,
        controllers=_controllers("cnc", serial=True),
    ),
    _pair(
        "p-late-read",
        "read, refused and late",
        menu=("to", "read"),
        answers=("ack", "refuse"),
        happenings=("wait", "late"),
        is_answered=False,
        controllers=_controllers("cnc", serial=True),
    ),
    _pair("p-run-silent", "triggered, silent", is_silent=True, is_triggered=True),
    _pair(
        "p-stop-silent",
        "stopped, silent",
        menu=("to", "run", "stop"),
        is_silent=True,
        is_triggered=True,
        happenings=("wait",),
    ),
    _pair(
        "p-run-status",
        "triggered, stopped, done falls late",
        _staged(done_drop_ms=2.0 * TICK_MS),
        menu=("to", "run", "stop", "status"),
        is_triggered=True,
        happenings=(*TIME, "undone"),
        drop_ticks=2,
    ),
    _pair("p-stop-read", "stopped and read", menu=("to", "run", "stop", "read"), is_triggered=True),
    _pair(
        "p-pipe",
        "two requests open, a connection that closes",
        menu=("to", "run", "stop"),
        answers=("ack", "refuse"),
        happenings=("disconnect",),
        is_triggered=True,
        is_serial=False,
        most_asked=2,
    ),
    _pair(
        "p-pipe-silent",
        "the same, silent",
        menu=("run", "stop"),
        happenings=("wait", "disconnect"),
        is_triggered=True,
        is_serial=False,
        most_asked=2,
        is_answered=False,
    ),
    _pair("p-halves-read", "word by word, and read", menu=("low", "high", "run", "read"), is_triggered=True),
    _pair(
        "p-halves-silent",
        "word by word, silent",
        menu=("low", "high", "run"),
        is_silent=True,
        is_triggered=True,
        happenings=("wait",),
    ),
    _pair(
        "p-distance-silent",
        "a distance, silent",
        _staged(travel=(-12.0, 12.0)),
        is_triggered=True,
        menu=("by", "run", "distance"),
        distances=(-4003,),
        is_silent=True,
    ),
    _pair(
        "p-distance-stop",
        "a distance, stopped",
        _staged(travel=(-12.0, 12.0)),
        is_triggered=True,
        menu=("to", "by", "run", "distance", "stop"),
        distances=(-4003,),
    ),
    _pair(
        "p-link-run", "the link is lost, triggered", is_triggered=True, happenings=(*TIME, "unplug", "plug")
    ),
    _pair("p-link-silent", "the link is lost, silent", is_silent=True, happenings=(*TIME, "unplug", "plug")),
    _pair(
        "p-kill-read",
        "killed and read",
        menu=("to", "read"),
        has_record=True,
        happenings=(*TIME, "kill", "kill_bare"),
    ),
    _pair(
        "p-kill-silent",
        "killed, silent",
        has_record=True,
        is_silent=True,
        happenings=(*TIME, "kill", "kill_bare"),
    ),
    _pair(
        "p-home-silent",
        "homed, switched off and on, silent",
        SWITCHED_PLAN,
        is_triggered=True,
        is_silent=True,
        menu=("to", "run", "home"),
        happenings=("arrive", "wait", "reboot", "homed"),
        horizon_ticks=14,
    ),
    _pair(
        "p-home-read",
        "homed, switched off and on, read",
        SWITCHED_PLAN,
        is_triggered=True,
        menu=("to", "run", "home", "read"),
        happenings=(*TIME, "reboot", "homed"),
        horizon_ticks=14,
    ),
    _pair(
        "p-zero-read",
        "a position that is set, read",
        HOMING_PLAN,
        is_triggered=True,
        menu=("to", "run", "home", "zero", "read"),
        happenings=(*TIME, "homed"),
    ),
    _pair(
        "p-zero-silent",
        "homing and a position that is set, silent",
        HOMING_PLAN,
        is_triggered=True,
        is_silent=True,
        menu=("run", "home", "zero"),
        happenings=("wait", "homed"),
    ),
    _pair("p-back-silent", "its register read back, silent", menu=("to", "back"), is_silent=True),
    _pair("p-back-jog", "its register read back, jogged", menu=("to", "back"), happenings=(*TIME, "jog")),
    _pair(
        "p-back-status",
        "its register read back, done falls late",
        _plan(done_drop_ms=2.0 * TICK_MS),
        menu=("to", "back", "status"),
        happenings=(*TIME, "undone"),
        drop_ticks=2,
    ),
    _pair("p-table-silent", "another table, silent", is_silent=True, happenings=(*TIME, "table")),
    _pair("p-gain-silent", "half a gain, silent", is_silent=True, happenings=(*TIME, "gain")),
    _pair("p-switch-silent", "off and on, silent", is_silent=True, happenings=(*TIME, "switch")),
    _pair("p-changes", "table, gain and switch", happenings=(*TIME, "table", "gain", "switch")),
)
"""Two families of events at once, where no other world that closes has them."""
MADE: Final = tuple(pair_world(one, other, _plan, _staged, HOMED_TOO) for one, other in TWO_AT_ONCE)
LATER: Final = tuple(pair_world(one, other, _plan, _staged, HOMED_TOO) for one, other in LARGER)
BY_NAME: Final = {design.name: design for design in (*CLOSING, *PAIRS, *MADE, *DESIGNS, *LATER)}
_CLOSE: Final = """
    b-requests b-rtu b-rtu-cut b-rtu-cut-back b-rtu-cut-both b-rtu-cut-early-ends b-rtu-cut-stuck
    b-rtu-late-size b-rtu-odd b-rtu-pairs b-rtu-replies p-answers p-back-jog p-back-status s-back
    s-before s-blind s-both s-both-near s-both-refused s-both-staged s-carry s-carry-halves s-carry-zero
    s-carry-zero-halves s-coarse s-cross s-down s-early s-falls s-falls-read s-fine s-gain s-halves
    s-halves-moving s-homing-alarm s-jogged s-jogged-past s-jogged-refused s-killed-jogged s-killed-obeyed
    s-killed-within s-late-forward s-later s-limits s-limits-refused s-mask s-mask-homing
    s-monitor-staged s-near s-obeyed s-scaled s-scaled-halves s-scaled-near s-slow s-slow-near s-staged
    s-starts s-stored s-stored-refused s-switch s-table s-torn s-two-units s-warm
"""
CLOSES: Final = frozenset((*_CLOSE.split(), *(design.name for design in MADE)))
"""Worlds that ``make verify`` walks until nothing is new: each takes a minute at most."""
CLOSES_LATER: Final = frozenset(design.name for design in LATER)
"""Worlds that take longer to close: ``make verify`` leaves them out, ``--later`` walks them."""
