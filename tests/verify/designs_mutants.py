"""Small worlds made for mutants that no other world had noticed (``mutants``)."""

from collections.abc import Callable
from typing import Final

from gateway.compensation.settings import Setpoints
from gateway.drives.motion import Action, ModePlan, MotionPlan, NextTarget, TriggerPlan
from gateway.exchange.plan import AxisPlan, Reference
from gateway.modbus.registers import BitField
from tests.exchange.line_bench import COMMAND
from tests.exchange.staged_bench import ALARM_BIT, BITS, COMMANDED, DEEDS, MODE, RUN, TRIGGER
from tests.verify.designs_frames import SERIAL
from tests.verify.designs_rules import SETTLE, WAIT, ask, go, seen
from tests.verify.world import ALARMS, TICK_MS, Design

Plan = Callable[..., AxisPlan]
Make = Callable[..., Design]
HOMED_TOO: Final = {"done": BITS["done"], "homed": BITS["homed"]}
TIME: Final = ("arrive", "wait")
RISING: Final = MotionPlan(is_staged=True, triggers=(TriggerPlan(TRIGGER, rising=1, deeds=DEEDS),))
"""A drive that runs its target when the lowest bit of its trigger rises."""
MODED: Final = MotionPlan(
    modes=(ModePlan(MODE, actions={1: Action.ABSOLUTE, 2: Action.RELATIVE_TO_COMMANDED}, resets_to=1),)
)
STARTING: Final = MotionPlan(
    starts_on=frozenset({COMMAND.address}), triggers=(TriggerPlan(TRIGGER, deeds=DEEDS),)
)
"""A drive that goes as the low word of its target is written, and again at its trigger."""
COIL: Final = MotionPlan(
    is_staged=True,
    triggers=(TriggerPlan(TRIGGER, is_coil=True, rising=1, deeds={1: DEEDS[RUN], 0: DEEDS[0]}),),
)


def designs(small: Make, small_staged: Make, plan: Plan, staged: Plan) -> tuple[Design, ...]:
    """Return the worlds, made of the two axes of ``designs`` and of what makes a world small there."""
    return (
        *_records(small, plan),
        _run(small_staged),
        _distance(small_staged, staged),
        _kept(small),
        *_proofs(small),
        *_motions(small, small_staged, plan, staged),
    )


def _records(small: Make, plan: Plan) -> tuple[Design, ...]:
    return (
        small(
            "s-killed-stream",
            "killed in a stream of setpoints that goes on in one direction",
            plan(setpoints=Setpoints.STREAM, reload_distance=3.0, fresh_ms=1.0),
            menu=("to",),
            targets=(1003, 5003, 9007, 9047),
            answers=("ack", "obey"),
            happenings=(*TIME, "kill"),
            has_record=True,
            is_stream=True,
            is_answered=False,
            checks_way_back=False,
            ways=(
                (
                    *(*ask("to", 0), ("arrive", 0)),
                    *(*ask("to", 1), ("arrive", 0)),
                    *(*ask("to", 2), ("arrive", 0)),
                    ("ask", 0, "to", 0, 3),
                    ("drive", "obey"),
                    ("arrive", 0),
                    ("kill",),
                    *ask("to", 3),
                ),
            ),
        ),
        small(
            "s-killed-onward",
            "killed while it goes on and on in one direction",
            menu=("to", "read", "status"),
            targets=(203, 5003, 9007),
            answers=("ack", "obey"),
            happenings=(*TIME, "kill"),
            has_record=True,
            ways=(
                (
                    *go(0, is_staged=False),
                    ("ask", 0, "to", 0, 1),
                    ("drive", "obey"),
                    ("kill",),
                    SETTLE,
                    *ask("read"),
                ),
            ),
        ),
    )


def _run(staged: Make) -> Design:
    obeyed = (*ask("to", 1), ("ask", 0, "run", 0), ("drive", "obey"), ("arrive", 0))
    return staged(
        "s-killed-run",
        "killed after a target ran that nobody acknowledged, and where it has come",
        menu=("to", "run", "read"),
        targets=(-7003, 9020),
        answers=("ack", "obey"),
        happenings=(*TIME, "kill"),
        has_record=True,
        is_answered=False,
        ways=((*ask("to", 0), *ask("run"), ("arrive", 0), *ask("read"), *obeyed, ("kill",), SETTLE),),
    )


def _distance(small_staged: Make, staged: Plan) -> Design:
    sent = (*ask("by", 0), ("ask", 0, "distance", 0), *(("drive", "ack"),) * 3)
    unseen = (*ask("to", 0), *ask("run"), ("arrive", 0), *sent)
    return small_staged(
        "s-killed-distance",
        "killed with a distance on the wire that ends on the way of the target before",
        staged(travel=(-30.0, 30.0), bits={"moving": BITS["moving"]}),
        menu=("to", "by", "run", "distance", "read"),
        targets=(9007,),
        distances=(-4003,),
        answers=("ack", "obey"),
        happenings=(*TIME, "kill"),
        has_record=True,
        is_answered=False,
        response_ticks=2,
        checks_way_back=False,
        ways=(
            (*unseen, ("drive", "obey"), ("arrive", 0), ("kill",), SETTLE, *ask("read"), *ask("distance")),
            (*unseen, ("kill",), SETTLE, *ask("read"), *ask("distance")),
            (*unseen, ("drive", "obey"), ("arrive", 0), ("kill",), ("kill",), SETTLE),
        ),
    )


def _kept(small: Make) -> Design:
    return small(
        "s-killed-hair",
        "killed where it stands, between targets nearer than the hysteresis: that it has arrived is kept",
        menu=("to", "read", "status"),
        targets=(9007, 9008),
        happenings=(*TIME, "kill"),
        has_record=True,
        ways=((*go(0, is_staged=False), ("kill",), SETTLE, *ask("to", 1)),),
    )


def _proofs(small: Make) -> tuple[Design, ...]:
    proven = (("ask", 0, "to", 0, 1), ("drive", "ack"), ("drive", "obey"), ("wait",), ("arrive", 0))
    return (
        small(
            "s-proven",
            "targets that nobody acknowledged, and an axis that is seen to come there",
            menu=("to", "read", "status"),
            answers=("ack", "obey"),
            targets=(-7003, 9007),
            is_answered=False,
            judges_proof=True,
            ways=((*proven, *seen(), *ask("to", 0), ("arrive", 0), *ask("read")),),
        ),
        small(
            "s-proven-back",
            "the same, and read back from the register",
            menu=("to", "read", "back"),
            answers=("ack", "obey"),
            targets=(-7003, 9007),
            is_answered=False,
            judges_proof=True,
            ways=((*proven, *ask("back"), *ask("read"), *ask("to", 0)),),
        ),
        small(
            "s-proven-killed",
            "the same, and killed on the way to the next one",
            menu=("to", "read", "status"),
            answers=("ack", "obey"),
            happenings=(*TIME, "kill"),
            targets=(-7003, 9007),
            has_record=True,
            is_answered=False,
            judges_proof=True,
            ways=(
                (
                    *go(0, is_staged=False),
                    ("ask", 0, "to", 0, 1),
                    ("drive", "obey"),
                    ("wait",),
                    ("arrive", 0),
                    ("ask", 0, "to", 0, 0),
                    ("drive", "ack"),
                    ("drive", "obey"),
                    ("kill",),
                    SETTLE,
                    ("arrive", 0),
                    *ask("read"),
                ),
            ),
        ),
    )


def _motions(small: Make, small_staged: Make, plan: Plan, staged: Plan) -> tuple[Design, ...]:
    edges = tuple(
        small_staged(
            f"s-edge-{edge}{'-up' if is_up else ''}",
            f"runs its target when a {edge} rises{', which is up at the start' if is_up else ''}",
            staged(motion=RISING if edge == "register" else COIL),
            menu=("to", "run", "idle", "read"),
            targets=(-7003, 9007),
            edge=edge,
            is_up_at_start=is_up,
        )
        for edge in ("register", "coil")
        for is_up in (False, True)
    )
    cut = (*ask("to", 1), ("arrive", 0), *ask("read"), ("unplug",), ("reboot", 0), ("plug",), SETTLE)
    to_stop = (*ask("to", 1), *ask("run"), *ask("stop"), *ask("read"))
    return (
        *edges,
        small(
            "s-mode-direct",
            "a drive that goes at once, and whose mode register says whether to a place or a distance",
            plan(
                motion=MODED,
                commanded=(COMMANDED,),
                referenced=Reference.HOMING,
                bits=HOMED_TOO,
            ),
            menu=("to", "by", "mode-absolute", "mode-distance", "read"),
            targets=(9007,),
            distances=(-4003,),
            happenings=(*TIME, "declare", "unplug", "plug"),
            ways=(
                (
                    *(("declare",), *ask("mode-absolute"), *ask("to", 0), ("arrive", 0), *ask("read")),
                    *(("unplug",), *WAIT * 3, ("plug",), SETTLE, *ask("mode-distance"), *ask("by", 0)),
                    ("arrive", 0),
                    *(("declare",), *ask("to", 0)),
                ),
            ),
            on_the_way_counts=tuple(range(-19501, 39501, 500)),
            judges_blocks=False,
            checks_way_back=False,
        ),
        small(
            "s-starts",
            "a drive that goes as a word of its target is written, and again at its trigger; jogged",
            plan(motion=STARTING),
            menu=("to", "run", "jog-on"),
            targets=(2003,),
            ways=((*ask("to", 0), ("arrive", 0), *ask("jog-on"), *ask("run"), *ask("to", 0)),),
        ),
        small(
            "s-queued",
            "a drive that goes to the target before first, and whose map says so",
            plan(next_target=NextTarget.QUEUED),
            menu=("to", "read", "status"),
            targets=(9007, 5003, 9019),
            is_buffered=True,
            checks_way_back=False,
        ),
        small(
            "s-queued-silent",
            "the same, and frames that are not answered",
            plan(next_target=NextTarget.QUEUED),
            menu=("to", "read"),
            targets=(9007, 5003),
            answers=("ack", "obey"),
            is_answered=False,
            is_buffered=True,
            checks_way_back=False,
        ),
        small(
            "s-blinks-table",
            "another table while the done bit falls and rises where the axis stands",
            menu=("to", "read", "status"),
            targets=(9007,),
            happenings=(*TIME, "blink", "done", "table"),
            checks_way_back=False,
            ways=(
                (
                    *go(0, is_staged=False),
                    ("blink", 0),
                    *ask("status"),
                    ("done", 0),
                    *ask("status"),
                    ("table",),
                    *ask("to", 0),
                ),
            ),
        ),
        small(
            "s-link-homed",
            "a drive whose homed bit counts and whose link is lost, while it is switched off and on",
            plan(referenced=Reference.DRIVE_BIT, bits=HOMED_TOO),
            targets=(-7003, 9007),
            happenings=(*TIME, "unplug", "plug", "reboot", "homed"),
            horizon_ticks=14,
            judges_proof=True,
            ways=((*cut, *ask("to", 1)), (*cut, *ask("read"), ("homed", 0), *ask("to", 1))),
        ),
        small(
            "s-alarm-apart",
            "a drive whose homed bit counts, and whose alarm bit stands in another register",
            plan(referenced=Reference.DRIVE_BIT, bits={**HOMED_TOO, "alarm": BitField(ALARMS, ALARM_BIT)}),
            menu=("to", "status", "alarms"),
            targets=(9007,),
            happenings=(*TIME, "alarm", "calm"),
            horizon_ticks=14,
            judges_blocks=False,
            checks_way_back=False,
            ways=(
                (*ask("to", 0), ("arrive", 0), *ask("status"), ("alarm", 0), *ask("alarms"), *ask("to", 0)),
            ),
        ),
        small_staged(
            "s-homing-alarm",
            "a homing command that an alarm ends, and another one",
            staged(referenced=Reference.HOMING, bits={**HOMED_TOO, "alarm": BITS["alarm"]}),
            menu=("home", "status"),
            targets=(9007,),
            happenings=("wait", "homed", "alarm", "calm"),
            horizon_ticks=14,
            judges_blocks=False,
            checks_way_back=False,
            ways=((*ask("home"), ("alarm", 0), *ask("status"), ("calm", 0), *ask("home"), *ask("status")),),
        ),
        small(
            "s-drops-late",
            "a drive whose done bit stays up for two ticks after it was told to go, and tells nothing else",
            plan(actual=(), done_drop_ms=2.0 * TICK_MS),
            menu=("to", "status"),
            targets=(-7003, 5003, 9107),
            drop_ticks=2,
            ways=(
                (*ask("to", 0), ("arrive", 0), *ask("status"), *ask("to", 2), *ask("status"), *ask("to", 1)),
            ),
        ),
        small_staged(
            "s-link-homed-staged",
            "the same of a target that waits for its trigger",
            staged(referenced=Reference.DRIVE_BIT, bits=HOMED_TOO),
            menu=("to", "run"),
            targets=(9007,),
            happenings=(*TIME, "unplug", "plug", "reboot", "homed"),
            horizon_ticks=14,
            ways=((*ask("to", 0), ("unplug",), ("reboot", 0), ("plug",), SETTLE, *ask("run")),),
        ),
        small_staged(
            "s-broadcast",
            "targets and triggers to all drives of the line, which nobody answers, without a reference",
            staged(referenced=Reference.HOMING, bits=HOMED_TOO),
            menu=("to", "to-all", "run", "run-all", "read"),
            controllers=SERIAL,
            checks_way_back=False,
        ),
        small_staged(
            "s-two-stops",
            "two axes: the stop of one goes before what a trigger of the other needs first",
            staged(),
            staged(name="y", unit_id=2),
            menu=("to", "run", "stop"),
            targets=(9007,),
            is_serial=False,
            most_asked=2,
            happenings=("arrive",),
            checks_way_back=False,
            ways=(
                (
                    *ask("to", 0),
                    ("ask", 0, "run", 0),
                    ("ask", 0, "stop", 1),
                    SETTLE,
                ),
            ),
        ),
        small_staged(
            "s-stopped-near",
            "stopped on its way, beside its next target",
            menu=("to", "run", "stop", "read"),
            targets=(1551, 9007),
            ways=((*to_stop, *ask("to", 0), *ask("run"), ("arrive", 0), *ask("read")),),
        ),
        small_staged(
            "s-stopped-onward",
            "stopped on its way, told to go on, and told a nearer target on that way",
            menu=("to", "run", "stop", "read"),
            targets=(9007, 9019),
            ways=((*to_stop, *ask("to", 1), *ask("run"), *ask("to", 0), *ask("run")),),
        ),
        small_staged(
            "s-stopped-killed",
            "the same, and killed",
            menu=("to", "run", "stop", "read"),
            targets=(1551, 9007),
            happenings=(*TIME, "kill"),
            has_record=True,
            ways=((*to_stop, ("kill",), SETTLE, *ask("to", 0), *ask("run"), ("arrive", 0), *ask("read")),),
        ),
        small_staged(
            "s-edge-blind",
            "the same of a register that is up at the start, where only the done bit is told",
            staged(motion=RISING, actual=(), commanded=()),
            menu=("to", "run", "idle", "status"),
            targets=(-7003, 9007, 9019),
            edge="register",
            is_up_at_start=True,
        ),
        small(
            "p-other-silent",
            "a register that no map knows, silent; a person declares where the axis is",
            plan(referenced=Reference.HOMING, bits=HOMED_TOO),
            menu=("to", "other"),
            targets=(9007,),
            answers=("ack", "obey"),
            happenings=("wait", "declare"),
            is_answered=False,
        ),
        small_staged(
            "s-distance-off",
            "distances while the compensation is off, and targets when it is on again",
            menu=("to", "by", "run", "distance"),
            targets=(9007, -7003),
            distances=(-4003,),
            happenings=(*TIME, "switch"),
            checks_way_back=False,
        ),
    )
