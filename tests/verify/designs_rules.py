"""Small worlds each of which is aimed at one family of rows, or at one kind of event.

Each declares ways: traces to places that are far from the start, walked first, with every event tried in
every state on them. A way that cannot be gone any more is a broken rule (10).
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from gateway.compensation.settings import Setpoints
from gateway.drives.motion import Action, ModePlan, MotionPlan, Operation, TriggerPlan
from gateway.exchange.plan import AxisPlan, ControllerPlan, Reference
from gateway.exchange.rights import Rights
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from tests.exchange.staged_bench import BITS, DEEDS, MODE, RUN, TRIGGER
from tests.verify.world import REMAPPING, TICK_MS, Design, Happening

Plan = Callable[..., AxisPlan]
ALL_BITS: Final = {"done": BITS["done"], "moving": BITS["moving"], "alarm": BITS["alarm"]}
HOMED_TOO: Final = {**ALL_BITS, "homed": BITS["homed"]}
SETTLE: Final[Happening] = ("settle",)


def ask(name: str, *numbers: int, port: int = 0, axis: int = 0) -> tuple[Happening, ...]:
    """A controller asks, and all that follows is acknowledged."""
    return (("ask", port, name, axis, *numbers), SETTLE)


def go(number: int, *, is_staged: bool = True, axis: int = 0) -> tuple[Happening, ...]:
    """A target is written, run, reached and seen to be reached."""
    run = ask("run", axis=axis) if is_staged else ()
    return (*ask("to", number, axis=axis), *run, ("arrive", axis), *seen(axis))


def seen(axis: int = 0) -> tuple[Happening, ...]:
    """Status and place are read."""
    return (*ask("status", axis=axis), *ask("read", axis=axis))


WAIT: Final[tuple[Happening, ...]] = (("wait",),)
LONG: Final = WAIT * 14
"""Longer than a homed bit counts."""
STICKY: Final = MotionPlan(
    is_staged=True,
    modes=(
        ModePlan(
            MODE,
            actions={1: Action.ABSOLUTE, 2: Action.RELATIVE_TO_COMMANDED, 3: Action.OTHER_MOTION},
            resets_to=1,
        ),
    ),
    triggers=(TriggerPlan(TRIGGER, deeds={**DEEDS, RUN: Operation(Action.START)}),),
)


def designs(direct: Plan, staged: Plan) -> tuple[Design, ...]:
    """Return the worlds, made of the two axes of ``designs``."""
    return (*_references(staged), *_places(direct, staged), *_others(direct, staged))


def _references(staged: Plan) -> tuple[Design, ...]:
    about = "positions that are set, homing, alarms, a person who declares; the reference is {}"
    menu = ("to", "run", "home", "zero", "stop", "read", "status")
    happenings = ("arrive", "wait", "homed", "alarm", "calm", "declare")
    set_and_lost = (
        *ask("zero"), *go(0), *ask("home"), *ask("zero"), *ask("home"), *ask("stop"), *ask("zero"),
        *ask("home"), ("declare",), *go(1), ("alarm", 0), *seen(), ("calm", 0), *seen(), ("declare",),
        *go(0), *ask("zero"), *ask("to", 1), *ask("run"), *ask("status"), *ask("zero"), ("declare",),
    )  # fmt: skip
    homed = (
        *ask("home"), ("wait",), ("wait",), ("homed", 0), *seen(), *go(1), *ask("home"), *ask("stop"),
        ("homed", 0), *seen(), *go(0), *ask("home"), *ask("status"), ("homed", 0), *seen(), *go(1),
        ("alarm", 0), *seen(), ("calm", 0), *seen(), *ask("zero"), *seen(), *LONG, *ask("read"),
        *ask("to", 0),
    )  # fmt: skip
    silent = (*go(1), *ask("home"), ("homed", 0), ("ask", 0, "read", 0), *WAIT * 3, *ask("read"), *go(0))
    hushed = (*go(1), ("ask", 0, "read", 0), *WAIT * 3, *ask("read"), *ask("read"), *ask("to", 0))
    lost = (
        ("ask", 0, "to", 0, 0),
        *WAIT * 2,
        ("ask", 0, "to", 0, 0),
        *WAIT * 2,
        ("ask", 0, "read", 0),
        *WAIT * 3,
    )
    again = (
        *go(1), *ask("home"), *ask("status"), *ask("stop"), *ask("home"), ("homed", 0), *ask("status"),
        *ask("to", 0),
    )  # fmt: skip
    untold = (*WAIT * 3, *ask("home"), *ask("stop"), ("homed", 0), *ask("status"), *ask("read"))
    # The bit is up and down at each step of a homing that was seen, lost, given twice, or is silent.
    unseen = (
        *WAIT * 3,
        *ask("home"),
        *ask("status"),
        *ask("home"),
        *ask("read"),
        *ask("status"),
        *ask("read"),
    )
    unheard = (
        *WAIT * 3,
        ("ask", 0, "home", 0),
        ("drive", "obey"),
        *WAIT * 3,
        *ask("status"),
        *ask("read"),
        *ask("read"),
    )
    unmoved = (*WAIT * 3, ("ask", 0, "home", 0), *WAIT * 2, *ask("status"), *ask("read"), *go(0))
    quiet = (*ask("home"), *ask("status"), ("ask", 0, "read", 0), *WAIT * 3, *ask("read"), *ask("read"))
    met = (*ask("zero"), *go(0), *ask("stop"), *ask("home"), ("alarm", 0), *ask("status"))
    alarmed = (*go(1), *WAIT * 2, ("alarm", 0), *ask("status"), ("calm", 0), *ask("to", 1), *ask("run"))
    away = (("declare",), *go(1), ("ask", 0, "read", 0), *WAIT * 4, *ask("read"), *ask("to", 1), *ask("run"))
    # What a silence has cost is told with whatever comes next, be it no echo of a stop.
    early = (
        ("ask", 0, "to", 0, 1), ("declare",), *WAIT, ("ask", 0, "to", 0, 0), *WAIT * 2,
        ("ask", 0, "stop", 0), ("drive", "refuse"),
    )  # fmt: skip
    declared = (("ask", 0, "home", 0), *WAIT, ("ask", 0, "status", 0), *WAIT * 2, ("declare",), *ask("stop"))
    found = []
    for name, way, ways in (
        ("set-position", Reference.SET_POSITION, (set_and_lost, met)),
        ("absolute", Reference.ABSOLUTE, (set_and_lost, alarmed)),
        ("homing-all", Reference.HOMING, (homed, set_and_lost, silent, away, early, declared)),
        (
            "drive-bit",
            Reference.DRIVE_BIT,
            (homed, silent, hushed, lost, again, untold, unseen, unheard, unmoved, quiet),
        ),
    ):
        found.append(
            Design(
                name,
                about.format(way.value),
                (staged(referenced=way, bits=HOMED_TOO),),
                menu=menu,
                happenings=happenings[: -1 if way is Reference.DRIVE_BIT else None],
                targets=(-7003, 9007),
                is_staged=True,
                horizon_ticks=14 if way is Reference.DRIVE_BIT else 4,
                judges_blocks=False,
                ways=ways,
            )
        )
    return tuple(found)


def _places(direct: Plan, staged: Plan) -> tuple[Design, ...]:
    def to(number: int) -> tuple[Happening, ...]:
        return (*ask("to", number), ("arrive", 0))

    left = (
        *to(1), *seen(), *to(0), *ask("status"), ("blink", 0), *ask("status"), ("creep", 0), *ask("read"),
        *ask("to", 0),
    )  # fmt: skip
    flickered = (
        *to(1),
        *seen(),
        *to(0),
        *seen(),
        ("blink", 0),
        *ask("status"),
        *ask("to", 0),
    )
    near = (*to(1), *seen(), ("blink", 0), *ask("status"), *ask("read"), ("done", 0), *seen(), *ask("to", 0))
    beside = (*to(1), *seen(), ("blink", 0), *ask("status"), ("tremble", 0), *ask("read"), *ask("to", 1))
    return (
        Design(
            "left",
            "an axis whose done bit falls after it has arrived, and which is elsewhere then",
            (direct(),),
            menu=("to", "read", "status"),
            answers=("ack", "obey"),
            happenings=("arrive", "wait", "blink", "creep", "tremble", "done"),
            targets=(9007, 9020),
            ways=(left, flickered, near, beside),
        ),
        Design(
            "blind-staged",
            "a staged drive that says done, and not where it is",
            (staged(actual=(), commanded=(), bits=ALL_BITS),),
            menu=("to", "run", "stop", "status"),
            happenings=("arrive", "wait", "undone"),
            targets=(-7003, 9007),
            is_staged=True,
        ),
    )


def _others(direct: Plan, staged: Plan) -> tuple[Design, ...]:
    remapping = PositionField(REMAPPING, RegisterType.INT16, WordOrder.HIGH_FIRST)
    controllers = (
        ControllerPlan("cnc", timeout_ms=float(TICK_MS)),
        ControllerPlan("hmi", timeout_ms=float(TICK_MS), rights=Rights(is_read_only=True)),
        ControllerPlan("log", timeout_ms=float(TICK_MS), serial=True, rights=Rights(unit_ids=frozenset({9}))),
        ControllerPlan("pad", timeout_ms=float(TICK_MS), serial=True, rights=Rights(is_read_only=True)),
    )
    y = replace(direct(), name="y", unit_id=2)
    homes = MotionPlan(
        triggers=(TriggerPlan(TRIGGER, deeds={v: d for v, d in DEEDS.items() if v not in (1, 2)}),)
    )
    streamed = direct(
        motion=homes, setpoints=Setpoints.STREAM, reload_distance=3.0, referenced=Reference.HOMING,
        bits=HOMED_TOO, fresh_ms=1.0,
    )  # fmt: skip
    return (
        Design(
            "beam",
            "two axes that carry one beam, whose drives go as soon as they are told",
            (direct(), y),
            menu=("to", "read"),
            answers=("ack", "refuse"),
            targets=(9007, 9020),
            groups=(("x", "y"),),
            ways=(
                (
                    ("ask", 0, "to", 0, 0),
                    SETTLE,
                    ("ask", 0, "to", 0, 1),
                    ("drive", "ack"),
                    ("drive", "refuse"),
                    *ask("to", 0, axis=1),
                    *ask("to", 0),
                    *ask("to", 0, axis=1),
                    *ask("to", 1, axis=1),
                ),
            ),
        ),
        Design(
            "distances",
            "distances that run, and that do not, and nobody says which",
            (staged(travel=(-30.0, 30.0), commanded=()),),
            menu=("to", "by", "run", "distance", "stop", "read", "status"),
            targets=(9007, -7003),
            distances=(-4003,),
            is_staged=True,
            checks_way_back=False,
            ways=(
                (
                    *go(0),
                    *ask("by", 0),
                    ("ask", 0, "distance", 0),
                    ("drive", "ack"),
                    *WAIT * 4,
                    *ask("read"),
                    *ask("distance"),
                ),
                (
                    *go(0),
                    *ask("by", 0),
                    ("ask", 0, "distance", 0),
                    ("drive", "ack"),
                    *WAIT * 4,
                    *seen(),
                    *WAIT,
                    *ask("to", 1),
                    *ask("run"),
                ),
            ),
        ),
        Design(
            "switched",
            "compensation that is switched off and on between targets",
            (direct(),),
            menu=("to", "read", "status"),
            answers=("ack",),
            happenings=("arrive", "wait", "switch"),
            targets=(-7003, 9007),
            ways=(
                (*go(1, is_staged=False), ("switch",), *go(0, is_staged=False), ("switch",), *ask("to", 1)),
            ),
        ),
        Design(
            "killed-staged",
            "a staged drive whose gateway is killed at any moment, after stops and jogs too",
            (staged(),),
            menu=("to", "run", "stop", "jog-on", "read"),
            answers=("ack", "obey"),
            happenings=("arrive", "wait", "kill"),
            targets=(-7003, 9007),
            is_staged=True,
            has_record=True,
            ways=(
                (
                    *go(1)[:-4],
                    *ask("read"),
                    ("kill",),
                    SETTLE,
                    *ask("read"),
                    *ask("to", 0),
                    *ask("run"),
                    ("kill",),
                ),
                (*go(1)[:-4], ("ask", 0, "jog-on", 0), ("drive", "obey"), ("kill",), SETTLE, *ask("read")),
                (*ask("to", 1), *ask("jog-on"), ("kill",), SETTLE, *ask("to", 0), *ask("run"), *ask("stop")),
            ),
        ),
        Design(
            "staged-back",
            "a staged target that is read back before it runs",
            (staged(),),
            menu=("to", "run", "back"),
            answers=("ack", "refuse"),
            targets=(-7003, 9007),
            is_staged=True,
            is_answered=True,
            ways=((*ask("to", 1), *ask("run"), ("arrive", 0), *ask("to", 0), *ask("back"), *ask("run")),),
        ),
        Design(
            "patient",
            "a drive that may take two ticks to answer",
            (direct(),),
            menu=("to", "read"),
            targets=(-7003, 9007),
            response_ticks=2,
            ways=((("ask", 0, "to", 0, 1), ("wait",), ("drive", "ack"), ("wait",), ("drive", "ack")),),
        ),
        Design(
            "slow-distances",
            "distances of a drive that is slow to begin, and of which nobody knows whether it has",
            (staged(travel=(-30.0, 30.0), commanded=()),),
            menu=("to", "by", "run", "distance", "stop", "read", "status"),
            targets=(9007,),
            distances=(-4003,),
            is_staged=True,
            is_prompt=False,
            checks_way_back=False,
            ways=(
                (
                    *go(0),
                    *ask("by", 0),
                    ("ask", 0, "distance", 0),
                    ("drive", "ack"),
                    ("drive", "obey"),
                    *WAIT * 4,
                    *ask("status"),
                    *ask("read"),
                    *ask("status"),
                ),
            ),
        ),
        Design(
            "jumps",
            "an axis that stands where no motion can have brought it: it counts from another zero",
            (direct(referenced=Reference.DRIVE_BIT, bits=HOMED_TOO, max_speed=1.0),),
            menu=("to", "read", "status"),
            happenings=("arrive", "wait", "jog", "homed"),
            targets=(-7003, 9007),
            horizon_ticks=14,
            jog_is_jump=True,
            judges_blocks=False,
            ways=((*go(1, is_staged=False), ("jog", 0), *ask("read"), *ask("read"), *ask("to", 0)),),
        ),
        Design(
            "strange",
            "values that the register map does not know, stored moves, and a register that moves others",
            (staged(remapping=(remapping,)),),
            menu=("to", "run", "stop", "strange", "jog-on", "stored", "remap", "read", "status"),
            happenings=("arrive", "wait"),
            targets=(9007, 5003),
            is_staged=True,
            judges_blocks=False,
            checks_way_back=False,
            ways=(
                (*go(0), *ask("jog-on"), *ask("to", 1), *ask("run")),
                (*go(0), *ask("stored"), *ask("to", 1), *ask("run")),
                (*ask("to", 1), *ask("run"), ("wait",), *ask("stop"), *ask("to", 0), *ask("run")),
                (*ask("to", 1), *ask("strange"), *ask("strange"), *ask("to", 0), *ask("run"), *ask("stored")),
                (*ask("to", 1), *ask("run"), ("arrive", 0), *ask("remap"), *ask("read"), *ask("to", 0)),
            ),
        ),
        Design(
            "modes",
            "a mode register says what a target means, and falls back after each move",
            (staged(motion=STICKY, travel=(-30.0, 30.0)),),
            menu=("to", "by", "mode-absolute", "mode-distance", "run", "stop"),
            targets=(9007,),
            distances=(-4003,),
            is_staged=True,
            judges_blocks=False,
            checks_way_back=False,
            ways=(
                (
                    *ask("mode-absolute"),
                    *ask("to", 0),
                    *ask("run"),
                    ("arrive", 0),
                    *ask("by", 0),
                    *ask("mode-distance"),
                    *ask("run"),
                    ("arrive", 0),
                    *ask("to", 0),
                    *ask("run"),
                ),
            ),
        ),
        Design(
            "stream",
            "a setpoint each cycle, for a drive that follows; homing, and a reference that is lost",
            (streamed,),
            menu=("to", "home", "stop", "read", "status"),
            happenings=("arrive", "wait", "homed", "declare", "alarm", "calm"),
            targets=(40, 9007),
            is_stream=True,
            judges_blocks=False,
            checks_way_back=False,
            ways=(
                (
                    *ask("to", 0),
                    *ask("home"),
                    ("wait",),
                    ("wait",),
                    ("homed", 0),
                    *seen(),
                    *ask("to", 0),
                    *ask("read"),
                    *ask("to", 1),
                    ("arrive", 0),
                    *ask("read"),
                    *ask("home"),
                    ("wait",),
                    ("wait",),
                    ("homed", 0),
                    *seen(),
                    *ask("to", 0),
                    *ask("to", 1),
                    ("arrive", 0),
                    ("alarm", 0),
                    *seen(),
                    *ask("to", 1),
                    ("calm", 0),
                    ("declare",),
                    *ask("to", 1),
                ),
            ),
        ),
        Design(
            "rights",
            "a controller that may only read, and one that may not reach this drive",
            (staged(),),
            menu=("to", "run"),
            answers=("ack", "refuse"),
            targets=(9007,),
            controllers=controllers,
            is_staged=True,
            judges_blocks=False,
            ways=(
                (
                    *ask("to", 0),
                    *ask("to", 0, port=1),
                    *ask("run"),
                    *ask("to", 0, port=2),
                    *ask("run", port=3),
                ),
            ),
        ),
    )
