"""Worlds for two things at once, each as small as two things can be, so that it closes in seconds.

What a large world has, its menu, its answers, what else happens and whether its drive may be silent, comes in
pairs: each two of them are together in a world that is walked until nothing is new. Most of these pairs are
in worlds that are about something; for the rest :func:`pair_world` makes the smallest world that has both.
"""

from collections.abc import Callable, Sequence
from typing import Any, Final

from gateway.exchange.plan import AxisPlan, ControllerPlan, Reference
from tests.verify.world import TICK_MS, Design

MENU: Final = (
    "to", "low", "high", "by", "run", "stop", "distance", "home", "zero", "back", "read", "status",
)  # fmt: skip
ANSWERS: Final = ("ack", "refuse", "obey", "garble", "obey-refuse")
HAPPENINGS: Final = (
    "arrive", "arrive_undone", "done", "undone", "blink", "creep", "jog", "late", "disconnect",
    "unplug", "plug", "homed", "kill", "kill_bare", "table", "gain", "switch", "wait",
)  # fmt: skip
SILENCE: Final = "silence"
COMPANIONS: Final[dict[str, tuple[str, ...]]] = {
    "stop": ("run",),
    "by": ("distance",),
    "distance": ("by",),
    "low": ("high",),
    "high": ("low",),
    "zero": ("home",),
    "home": ("homed",),
    "homed": ("home",),
    "done": ("arrive_undone", "status"),
    "arrive_undone": ("status",),
    "undone": ("arrive", "status"),
    "blink": ("arrive", "status"),
    "creep": ("blink",),
    "jog": ("arrive",),
    "unplug": ("plug",),
    "plug": ("unplug",),
    "late": (SILENCE,),
}
"""Without these nothing would come of the one."""
MOVING: Final = frozenset(("arrive", "arrive_undone"))
"""What happens to an axis that was sent somewhere."""
STAGED: Final = frozenset(("run", "stop", "by", "distance", "low", "high", "home", "zero"))


TWO_AT_ONCE: Final = (
    ("ack", "blink"),
    ("ack", "distance"),
    ("ack", "garble"),
    ("ack", "kill_bare"),
    ("ack", "plug"),
    ("ack", "stop"),
    ("ack", "unplug"),
    ("ack", "zero"),
    ("arrive", "blink"),
    ("arrive", "creep"),
    ("arrive", "disconnect"),
    ("arrive", "garble"),
    ("arrive", "kill_bare"),
    ("arrive", "plug"),
    ("arrive", "silence"),
    ("arrive", "stop"),
    ("arrive", "zero"),
    ("arrive_undone", "refuse"),
    ("back", "obey"),
    ("back", "silence"),
    ("creep", "done"),
    ("creep", "jog"),
    ("creep", "read"),
    ("disconnect", "refuse"),
    ("distance", "obey"),
    ("done", "jog"),
    ("gain", "obey"),
    ("gain", "switch"),
    ("gain", "table"),
    ("garble", "obey"),
    ("garble", "obey-refuse"),
    ("garble", "read"),
    ("garble", "refuse"),
    ("garble", "silence"),
    ("high", "obey"),
    ("high", "read"),
    ("homed", "run"),
    ("jog", "obey"),
    ("kill", "kill_bare"),
    ("kill_bare", "obey"),
    ("kill_bare", "read"),
    ("kill_bare", "silence"),
    ("low", "silence"),
    ("obey", "obey-refuse"),
    ("obey", "read"),
    ("obey", "refuse"),
    ("obey", "table"),
    ("obey", "undone"),
    ("obey", "unplug"),
    ("obey", "zero"),
    ("obey-refuse", "refuse"),
    ("obey-refuse", "silence"),
    ("plug", "read"),
    ("read", "zero"),
    ("refuse", "run"),
    ("refuse", "silence"),
    ("refuse", "undone"),
    ("silence", "zero"),
    ("stop", "undone"),
    ("switch", "table"),
)
"""Pairs that are in no other world that closes."""
LARGER: Final = (
    ("arrive", "by"),
    ("arrive", "distance"),
    ("arrive", "late"),
    ("arrive_undone", "silence"),
    ("blink", "silence"),
    ("by", "run"),
    ("by", "silence"),
    ("by", "stop"),
    ("by", "to"),
    ("creep", "obey"),
    ("creep", "silence"),
    ("disconnect", "run"),
    ("disconnect", "silence"),
    ("disconnect", "stop"),
    ("distance", "run"),
    ("distance", "silence"),
    ("distance", "stop"),
    ("distance", "to"),
    ("done", "obey"),
    ("done", "refuse"),
    ("done", "silence"),
    ("gain", "silence"),
    ("garble", "late"),
    ("jog", "silence"),
    ("kill", "silence"),
    ("late", "obey"),
    ("late", "obey-refuse"),
    ("late", "refuse"),
    ("late", "to"),
    ("obey", "stop"),
    ("obey", "switch"),
    ("plug", "run"),
    ("plug", "silence"),
    ("read", "stop"),
    ("refuse", "stop"),
    ("run", "silence"),
    ("run", "unplug"),
    ("run", "zero"),
    ("silence", "stop"),
    ("silence", "switch"),
    ("silence", "table"),
    ("silence", "undone"),
    ("silence", "unplug"),
)
"""The same, and the smallest world that has both takes longer than a minute to close."""


def pair_world(
    one: str, other: str, plan: Callable[..., AxisPlan], staged: Callable[..., AxisPlan], bits: dict[str, Any]
) -> Design:
    """Return the smallest world that has two things; ``bits``: status bits with one that says homed."""
    names: set[str] = set()
    waiting = [one, other]
    while waiting:
        name = waiting.pop()
        if name not in names:
            names.add(name)
            waiting += COMPANIONS.get(name, ())
    if not names.intersection(("to", "by", "low")):
        names.add("to")
    is_staged = not names.isdisjoint(STAGED)
    if is_staged and names & MOVING and not names & {"run", "distance"}:
        names.add("run")  # without it such a drive goes nowhere
    changes: dict[str, Any] = {}  # of the axis
    options: dict[str, Any] = {}  # of the world
    if names & {"home", "zero"}:
        changes |= {"referenced": Reference.HOMING, "bits": bits}
    if "by" in names:
        changes["travel"] = (-12.0, 12.0)
    if "undone" in names:
        changes["done_drop_ms"] = 2.0 * TICK_MS
        options["drop_ticks"] = 2  # a tick of it is over when the answer is heard
    if "disconnect" in names:
        options |= {"is_serial": False, "most_asked": 2}
    if "late" in names:
        options["controllers"] = (ControllerPlan("cnc", timeout_ms=float(TICK_MS), serial=True),)
    return Design(
        f"p-{one}-{other}",
        f"{one} and {other}, and nothing else",
        ((staged if is_staged else plan)(**changes),),
        menu=_those(MENU, names),
        answers=_those(ANSWERS, names | {"ack"}),
        happenings=_those(HAPPENINGS, names | {"wait"}),
        targets=(9007,),
        distances=(-4003,),
        is_answered=SILENCE not in names,
        is_staged=is_staged,
        has_record=not names.isdisjoint(("kill", "kill_bare")),
        checks_way_back=False,
        **options,
    )


def _those(order: Sequence[str], names: set[str]) -> tuple[str, ...]:
    return tuple(name for name in order if name in names)
