"""Worlds that close, around what registers can hold and what frames can do to them."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from gateway.compensation.settings import ThermalSettings
from gateway.drives.motion import MotionPlan, TriggerPlan
from gateway.exchange.plan import AxisPlan, ControllerPlan, CrossPlan, Late, Reference, Role
from gateway.modbus.registers import WordOrder
from tests.exchange.line_bench import ACTUAL, COMMAND
from tests.exchange.staged_bench import BITS, DEEDS, RUN, RUN_RELATIVE, TRIGGER
from tests.verify.designs_rules import ask
from tests.verify.rules import LIMIT
from tests.verify.world import TICK_MS, Design, Happening

Plan = Callable[..., AxisPlan]
Make = Callable[..., Design]
HOMED_TOO: Final = {"done": BITS["done"], "homed": BITS["homed"]}
HOMES: Final = MotionPlan(
    triggers=(TriggerPlan(TRIGGER, deeds={v: d for v, d in DEEDS.items() if v not in (RUN, RUN_RELATIVE)}),)
)
"""A drive that goes to each target as it is written, and can be homed."""
TRAVEL: Final = (-20.0, 40.0)
WARMING: Final = ThermalSettings(1e-4, rate_per_min=1e9)
"""A screw whose correction follows at once what its sensor says."""
CROSS: Final = CrossPlan("y", (0.0, 10.0), (0.0, 0.05))
"""5 µm for each mm of the other axis."""
HALF_A_TICK_MS: Final = TICK_MS / 2
WITH_MONITOR: Final = (
    ControllerPlan("cnc", timeout_ms=float(TICK_MS)),
    ControllerPlan("hmi", role=Role.MONITOR, timeout_ms=float(TICK_MS)),
)
SERIAL: Final = (ControllerPlan("cnc", timeout_ms=float(TICK_MS), serial=True),)
TWO_SERIAL: Final = (*SERIAL, ControllerPlan("plc", timeout_ms=float(TICK_MS), serial=True))
HIGH_FIRST: Final = replace(COMMAND, order=WordOrder.HIGH_FIRST)
ACTUAL_HIGH_FIRST: Final = replace(ACTUAL, order=WordOrder.HIGH_FIRST)
STEP_OF_5: Final = replace(COMMAND, scale=5.0)
STEP_OF_2: Final = replace(ACTUAL, scale=2.0)
STEP_OF_10: Final = replace(ACTUAL, scale=10.0)
STEP_OF_A_TENTH: Final = replace(ACTUAL, scale=0.1)


def designs(small: Make, small_staged: Make, plan: Plan, staged: Plan) -> tuple[Design, ...]:
    """Return the worlds, made of the two axes of ``designs`` and of what makes a world small there."""
    return (
        *_registers(small, small_staged, plan, staged),
        *_functions(small, small_staged, plan),
        *_wires(small, small_staged, plan),
        *_cut_through(small, small_staged, plan, staged),
        *_lines(small, small_staged, plan, staged),
    )


def large(plan: Plan) -> tuple[Design, ...]:
    """Return those that do not close: how long an exchange took is a number that only decays."""
    return (
        Design(
            "monitor",
            "a controller that may only read, and waits for a gap",
            (plan(actual=()),),
            menu=("to", "back"),
            answers=("ack",),
            happenings=("wait",),
            targets=(9007,),
            controllers=WITH_MONITOR,
            is_answered=True,
        ),
    )


def _registers(small: Make, small_staged: Make, plan: Plan, staged: Plan) -> tuple[Design, ...]:
    """Steps of registers, and borders of their words."""
    return (
        small(
            "s-carry-zero",
            "corrections that carry over zero: every word of the target changes, and its sign",
            targets=(-5, 12),
            menu=("to", "read", "back"),
            checks_way_back=False,
        ),
        small_staged(
            "s-carry-zero-halves",
            "the same word by word",
            menu=("low", "high", "run"),
            happenings=("wait",),
            targets=(12,),
            checks_way_back=False,
        ),
        small(
            "s-scaled",
            "a target's register in steps of 5 counts, a reading in steps of 2: no target is on its grid",
            plan(command=(STEP_OF_5,), actual=(STEP_OF_2,), hysteresis=0.01),
            menu=("to", "read", "back"),
            targets=(-7005, 9005),
        ),
        small(
            "s-scaled-near",
            "the same, nearer than the branches",
            plan(command=(STEP_OF_5,), actual=(STEP_OF_2,), hysteresis=0.01),
            targets=(9005, 9025),
        ),
        small(
            "s-scaled-blind",
            "the same where only the done bit is told: targets that go on in one direction, too",
            plan(command=(STEP_OF_5,), actual=(), hysteresis=0.01),
            menu=("to", "status"),
            targets=(9005, 9025, 9045),
        ),
        small_staged(
            "s-scaled-halves",
            "the same, staged, word by word, over the border of a word of its register",
            staged(
                command=(STEP_OF_5,),
                actual=(STEP_OF_2,),
                hysteresis=0.01,
                max_speed=10000.0,
                counts_per_unit=-1000.0,
            ),
            menu=("low", "high", "run"),
            targets=(5 * 65541,),
            checks_way_back=False,
        ),
        small(
            "s-coarse",
            "a reading in steps of 10 counts: of a target between them the nearest one is read",
            plan(actual=(STEP_OF_10,), hysteresis=0.02),
            targets=(-7003, 8932),
        ),
        small(
            "s-fine",
            "a reading in steps of a tenth of a count",
            plan(actual=(STEP_OF_A_TENTH,)),
            targets=(-7003, 9007),
        ),
    )


def _functions(small: Make, small_staged: Make, plan: Plan) -> tuple[Design, ...]:
    """Other functions than the usual: a mask over a word (FC22), written and read in one frame (FC23)."""
    return (
        small(
            "s-mask",
            "a mask laid over a word of the target",
            menu=("to", "mask", "read"),
            targets=(9007,),
        ),
        small(
            "s-mask-refused",
            "the same, refused",
            menu=("to", "mask"),
            answers=("ack", "refuse"),
            targets=(9007,),
        ),
        small_staged("s-mask-staged", "the same, staged", menu=("to", "mask", "run")),
        small(
            "s-mask-homing",
            "the same, homed: the drive of an axis without a reference may hold corrected words",
            plan(motion=HOMES, referenced=Reference.HOMING, bits=HOMED_TOO),
            menu=("to", "mask", "home"),
            targets=(9007,),
            masks=((0x00FF, 0x2400),),
            happenings=("arrive", "wait", "homed"),
            judges_blocks=False,
        ),
        small(
            "s-words-switch",
            "single words of a target that is gone to at once, off and on",
            menu=("low", "high"),
            targets=(9007,),
            happenings=("arrive", "wait", "switch"),
        ),
        small(
            "s-words-replaced",
            "the same, of targets of which one word may belong to each; only random steps reach far",
            plan(max_speed=10000.0),
            menu=("to", "low", "high"),
            targets=(9007, 5 * 65541),
            happenings=("arrive", "wait", "switch"),
            checks_way_back=False,
        ),
        small_staged(
            "s-halves-switch",
            "single words of a staged target, off and on",
            menu=("low", "high", "run"),
            targets=(9007,),
            happenings=("switch",),
        ),
        small(
            "s-both",
            "a target and a reading in one frame",
            menu=("both",),
            targets=(-7003, 9007),
        ),
        small(
            "s-both-refused",
            "the same, refused",
            menu=("both",),
            answers=("ack", "refuse"),
            targets=(9007,),
        ),
        small(
            "s-both-near",
            "the same, nearer than the branches",
            menu=("both", "to"),
            targets=(9007, 9019),
        ),
        small_staged("s-both-staged", "the same, staged", menu=("both", "run")),
    )


def _wires(small: Make, small_staged: Make, plan: Plan) -> tuple[Design, ...]:
    """What comes over a serial wire, and does not belong to the request that is out."""
    return (
        small(
            "s-before",
            "a drive that answers the request before last, of another function or size",
            menu=("to", "read"),
            answers=("ack", "before", "before-deaf"),
            targets=(9007,),
            checks_way_back=False,
        ),
        small(
            "s-before-status",
            "the same with reads of two sizes",
            menu=("to", "read", "status"),
            answers=("ack", "before", "before-deaf"),
            happenings=("arrive",),
            targets=(9007,),
            checks_way_back=False,
        ),
        small_staged(
            "s-before-staged",
            "the same, staged",
            menu=("to", "run"),
            answers=("ack", "before", "before-deaf"),
            happenings=("arrive",),
            checks_way_back=False,
        ),
        small(
            "b-rtu",
            "begins at bytes of RTU: half requests, and their tails at any time, bad check sums",
            menu=("to", "read"),
            targets=(9007,),
            happenings=("arrive", "wait", "half", "spoil"),
            controllers=SERIAL,
            is_bytes=True,
            is_rtu=True,
        ),
        small(
            "b-rtu-pairs",
            "the same: two requests in one read",
            menu=("to", "read"),
            targets=(9007,),
            happenings=("arrive", "pair"),
            controllers=SERIAL,
            is_bytes=True,
            is_rtu=True,
        ),
        small(
            "b-rtu-odd",
            "the same: requests behind a frame of another length than its function code says, for a device",
            menu=("to", "read"),
            targets=(9007,),
            happenings=("arrive", "wait", "odd"),
            controllers=SERIAL,
            is_bytes=True,
            is_rtu=True,
        ),
        small_staged(
            "b-rtu-odd-stop",
            "the same, staged: stops behind it too",
            menu=("to", "run", "stop"),
            targets=(9007,),
            happenings=("arrive", "odd"),
            controllers=SERIAL,
            is_bytes=True,
            is_rtu=True,
        ),
        small(
            "b-rtu-replies",
            "the same: replies with bad check sums, and twice in one read",
            plan(actual=()),
            menu=("to",),
            answers=("ack", "spoil", "twice"),
            targets=(9007,),
            happenings=("wait",),
            controllers=SERIAL,
            is_answered=False,
            is_bytes=True,
            is_rtu=True,
        ),
        small(
            "b-rtu-halves",
            "the same: replies in halves",
            plan(actual=()),
            menu=("to", "status"),
            targets=(9007,),
            happenings=("wait", "split"),
            controllers=SERIAL,
            is_answered=False,
            is_bytes=True,
            is_rtu=True,
        ),
        small(
            "b-rtu-late",
            "the same: late replies of another function, alone and in one read with the right one",
            plan(actual=()),
            menu=("to", "status"),
            targets=(9007,),
            answers=("ack", "obey"),
            happenings=("wait", "late", "late_glued"),
            controllers=SERIAL,
            late_ticks=2,
            is_answered=False,
            is_bytes=True,
            is_rtu=True,
            checks_way_back=False,
        ),
        small(
            "b-rtu-late-size",
            "the same, of another size",
            menu=("read", "status"),
            targets=(9007,),
            happenings=("wait", "late", "late_glued"),
            controllers=SERIAL,
            late_ticks=2,
            is_answered=False,
            is_bytes=True,
            is_rtu=True,
            checks_way_back=False,
        ),
    )


CUT_UP: Final[dict[str, Any]] = {"is_bytes": True, "is_rtu": True, "is_cut": True, "controllers": SERIAL}
SEEN_THERE: Final = (*ask("to", 0), ("arrive", 0), *ask("read"))
"""An axis is steady where it was seen to arrive, and its next target may be cut through."""


def _leaves(name: str, *before: Happening) -> tuple[Happening, ...]:
    """Let a request leave in pieces; what else can happen is tried in each state on this way."""
    target = (0,) if name == "to" else ()
    return (*before, ("half", 0, name, 0, *target), ("delay",), ("more",), ("tail",), ("drive", "ack"))


REFUSED: Final = (*SEEN_THERE, ("half", 0, "to", 0, 1), ("delay",), ("more",), ("tail",), ("wait",))
"""What its words tell is that the axis turns round: the frame is spoilt, and leaves stored."""
CHANGED: Final = (
    *(*SEEN_THERE, ("half", 0, "to", 0, 0), ("delay",), ("more",), ("table",)),
    *(("tail",), ("wait",), ("drive", "ack")),
)
"""What has left is not what would be sent by now: the frame is spoilt, and leaves stored."""
TAIL: Final = ("reply_tail",)
ODDLY_ACKNOWLEDGED: Final = (
    *(*SEEN_THERE, ("ask", 0, "to", 0, 0), ("split", "garble")),
    *(("reply_delay",), TAIL),
)
"""A drive acknowledges other registers than were written: of what has left nothing is right."""


def _comes_back(name: str, *before: Happening) -> tuple[Happening, ...]:
    """Let a reply leave in pieces."""
    target = (0,) if name == "to" else ()
    return (
        *(*before, ("ask", 0, name, 0, *target), ("split",)),
        *(("reply_delay",), ("reply_more",), ("reply_tail",)),
    )


def _early(small: Make, plan: Plan) -> tuple[Design, ...]:
    """Positions whose first byte may leave before they are whole: the highest word comes first."""
    high_first = plan(command=(HIGH_FIRST,), actual=(ACTUAL_HIGH_FIRST,))
    both: dict[str, Any] = {"menu": ("to", "read"), "targets": (9007,), **CUT_UP}
    to = {"ways": (_leaves("to", *SEEN_THERE),)}
    back = {"ways": (_comes_back("to", *SEEN_THERE), _comes_back("read", *SEEN_THERE))}
    return (
        small(
            "b-rtu-cut-early",
            "the first byte of a target leaves before the last one has come: another table meanwhile",
            high_first,
            **both | to | {"happenings": ("arrive", "wait", "half", "table", "switch")},
        ),
        small(
            "b-rtu-cut-early-ends",
            "the same: bad check sums, silence in the middle, bytes of the drives",
            high_first,
            **both | to | {"happenings": ("arrive", "wait", "half", "tail_bad", "noise")},
        ),
        small(
            "b-rtu-cut-early-turns",
            "the same: a target on the other side of the one before, or below 0, where nothing is corrected",
            high_first,
            **both | {"happenings": ("arrive", "wait", "half"), "targets": (9007, -3), "ways": (REFUSED,)},
        ),
        small(
            "b-rtu-cut-early-back",
            "the same of a position that is read: another table meanwhile",
            high_first,
            **both | back | {"happenings": ("arrive", "wait", "split", "table", "switch")},
        ),
    )


def _replies_cut_through(small: Make, small_staged: Make) -> tuple[Design, ...]:
    """Replies that leave while they arrive, and what may come between."""
    both: dict[str, Any] = {
        "menu": ("to", "read"),
        "targets": (9007,),
        "ways": (_comes_back("to", *SEEN_THERE), _comes_back("read", *SEEN_THERE)),
        **CUT_UP,
    }
    return (
        small(
            "b-rtu-cut-back",
            "replies leave while they arrive, and may come too slowly for that",
            **both | {"happenings": ("arrive", "wait", "split")},
        ),
        small(
            "b-rtu-cut-back-silent",
            "the same: a silence in the middle, which ends them",
            **both | {"happenings": ("arrive", "wait", "split", "silence")},
        ),
        small(
            "b-rtu-cut-back-bad",
            "the same of reads: bad check sums, and silences in the middle",
            **both
            | {
                "menu": ("read", "status"),
                "happenings": ("wait", "split", "reply_bad", "silence"),
                "ways": (_comes_back("read", *ask("read")), _comes_back("status", *ask("status"))),
            },
        ),
        small(
            "b-rtu-cut-back-odd",
            "the same: refusals, and acknowledgements of other registers",
            **both
            | {
                "happenings": ("arrive", "wait", "split", "split_odd"),
                "ways": (ODDLY_ACKNOWLEDGED, (*SEEN_THERE, ("ask", 0, "read", 0), ("split", "refuse"), TAIL)),
            },
        ),
        small(
            "b-rtu-cut-back-again",
            "the same: its controller asks again before it has its answer",
            **both | {"happenings": ("arrive", "wait", "split", "again")},
        ),
        small(
            "b-rtu-cut-back-link",
            "the same: the port of its controller, or the way to the drives, is lost meanwhile",
            **both | {"happenings": ("arrive", "wait", "split", "silence", "disconnect", "unplug", "plug")},
        ),
        small(
            "b-rtu-cut-back-changes",
            "the same: another table, or off and on, meanwhile",
            **both | {"happenings": ("arrive", "wait", "split", "table", "switch")},
        ),
        small(
            "b-rtu-cut-back-killed",
            "the same: the gateway is killed meanwhile",
            **both | {"happenings": ("arrive", "wait", "split", "kill"), "has_record": True},
        ),
        small_staged(
            "b-rtu-cut-back-stop",
            "the same: another controller stops the axis, or reads, meanwhile",
            menu=("read", "stop"),
            happenings=("wait", "split"),
            ways=(_comes_back("read", *ask("read")),),
            **CUT_UP | {"controllers": TWO_SERIAL},
        ),
        small(
            "b-rtu-cut-both",
            "requests and replies of reads leave while they arrive",
            **both
            | {
                "menu": ("read", "status"),
                "happenings": ("wait", "half", "split"),
                "ways": ((*_leaves("read", *ask("read"))[:-1], *_comes_back("read")[1:]),),
            },
        ),
    )


def _cut_through(small: Make, small_staged: Make, plan: Plan, staged: Plan) -> tuple[Design, ...]:
    """Requests that leave while they arrive, and what may come between."""
    both: dict[str, Any] = {
        "menu": ("to", "read"),
        "targets": (9007,),
        "ways": (_leaves("to", *SEEN_THERE), _leaves("read", *SEEN_THERE)),
        **CUT_UP,
    }
    return (
        small(
            "b-rtu-cut",
            "reads leave while they arrive: bad check sums, silence in the middle, bytes of the drives",
            **both
            | {"menu": ("read", "status"), "happenings": ("wait", "half", "tail_bad", "noise"), "ways": ()},
        ),
        small(
            "b-rtu-cut-to",
            "the same of a target and of reads",
            **both | {"happenings": ("arrive", "wait", "half", "tail_bad", "noise")},
        ),
        small(
            "b-rtu-cut-turns",
            "the same: a target on the other side of the one before, of which only the words tell that",
            **both | {"happenings": ("arrive", "wait", "half"), "targets": (9007, 5003), "ways": (REFUSED,)},
        ),
        small(
            "b-rtu-cut-anew",
            "the same: another request in one read with its rest",
            **both | {"happenings": ("arrive", "wait", "half", "anew")},
        ),
        small(
            "b-rtu-cut-stuck",
            "the same: the process stands still, and another request has come instead of its rest",
            **both | {"happenings": ("arrive", "wait", "half", "stuck")},
        ),
        small(
            "b-rtu-cut-link",
            "the same: the port of its controller, or the way to the drives, is lost meanwhile",
            **both | {"happenings": ("arrive", "wait", "half", "disconnect", "unplug", "plug")},
        ),
        small(
            "b-rtu-cut-changes",
            "the same: another table, or off and on, meanwhile",
            **both
            | {
                "happenings": ("arrive", "wait", "half", "table", "switch"),
                "ways": (*both["ways"], CHANGED),
            },
        ),
        small(
            "b-rtu-cut-killed",
            "the same: the gateway is killed meanwhile",
            **both | {"happenings": ("arrive", "wait", "half", "kill"), "has_record": True},
        ),
        small_staged(
            "b-rtu-cut-stop",
            "the same: another controller stops the axis, or reads, meanwhile",
            menu=("read", "stop"),
            happenings=("wait", "half"),
            ways=(_leaves("read", *ask("read")),),
            **CUT_UP | {"controllers": TWO_SERIAL},
        ),
        small(
            "b-rtu-cut-beside",
            "the same of a target and of reads: another controller stops another axis meanwhile",
            plan(),
            staged(name="y", unit_id=2),
            **both
            | {
                "menu": ("to", "read", "stop"),
                "happenings": ("arrive", "wait", "half"),
                "controllers": TWO_SERIAL,
            },
        ),
        *_replies_cut_through(small, small_staged),
        *_early(small, plan),
    )


def _lines(small: Make, small_staged: Make, plan: Plan, staged: Plan) -> tuple[Design, ...]:
    """What else changes a correction, or decides whether a target still leaves."""
    return (
        small(
            "s-warm",
            "a screw that is warm and cold in turn: its line comes with different targets only",
            plan(thermal=WARMING, travel=TRAVEL),
            menu=("to", "read"),
            targets=(9007,),
            happenings=("arrive", "wait", "temperature"),
        ),
        small(
            "s-cross",
            "an axis that is corrected by where another one is, which has no table of its own",
            plan(cross=(CROSS,)),
            plan(name="y", unit_id=2, table=None),
            menu=("to",),
            targets=(9007,),
            happenings=("arrive",),
        ),
        small(
            "s-limits",
            "a position that the drive compares its own with: half-way between the branches, whole",
            plan(limits=(LIMIT,)),
            menu=("to", "limit", "limit-low", "limit-back"),
            targets=(9007,),
            happenings=("arrive", "table"),
        ),
        small(
            "s-limits-refused",
            "the same, refused",
            plan(limits=(LIMIT,), actual=()),
            menu=("to", "limit", "limit-back"),
            answers=("ack", "refuse"),
            targets=(9007,),
            happenings=("table",),
        ),
        small(
            "s-late-forward",
            "a target that is late, and sent all the same",
            plan(deadline_ms=HALF_A_TICK_MS, unseen_ms=10_000.0),
            menu=("to",),
            answers=("ack", "obey"),
            targets=(9007,),
            is_answered=False,
        ),
        small_staged(
            "s-late-reject",
            "a staged target or its trigger that is late is refused, and blocks its triggers",
            staged(deadline_ms=HALF_A_TICK_MS, unseen_ms=10_000.0, late=Late.REJECT),
            menu=("to", "run"),
            happenings=("wait",),
            is_answered=False,
        ),
        small_staged(
            "s-monitor-staged",
            "the same, with triggers that it may not give",
            menu=("to", "run"),
            controllers=WITH_MONITOR,
            happenings=("wait",),
            judges_blocks=False,
        ),
    )
