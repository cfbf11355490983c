"""What makes a line faster, and by how much: the same arithmetic with one thing changed. Drive side first."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from gateway.budget.line import ControllerBudget, line_budget
from gateway.budget.sequence import AS_MAPPED, Blocks
from gateway.ipc.plan import LinePlan
from gateway.transport.endpoints import SerialEndpoint

FAST_BAUD: Final = 115_200
"""What nearly every drive with RS-485 can do."""
LEAST_GAIN: Final = 0.05
"""Share of the time below which a change is not worth the words."""


@dataclass(frozen=True, slots=True)
class Remedy:
    """One change, and what it does to the slowest exchange and to a round."""

    what: str
    waited_before_ns: int
    waited_ns: int
    round_before_ns: int
    round_ns: int


def remedies(plan: LinePlan, index: int, blocks: Blocks = AS_MAPPED) -> tuple[Remedy, ...]:
    """Return what would help controller ``index`` of a line, each change by itself and then all together."""
    now = line_budget(plan, blocks).controllers[index]
    found = [
        _remedy(what, now, line_budget(changed, changed_blocks).controllers[index])
        for what, changed, changed_blocks in _changes(plan, index, blocks)
    ]
    return tuple(each for each in found if each is not None)


def _remedy(what: str, now: ControllerBudget, then: ControllerBudget) -> Remedy | None:
    if now.slowest is None or then.slowest is None:
        return None
    remedy = Remedy(
        what,
        now.slowest.legs.waited_ns,
        then.slowest.legs.waited_ns,
        now.round.total_ns,
        then.round.total_ns,
    )
    gains = (
        (remedy.waited_before_ns, remedy.waited_ns),
        (remedy.round_before_ns, remedy.round_ns),
    )
    return remedy if any(before - after > LEAST_GAIN * before for before, after in gains) else None


def _changes(plan: LinePlan, index: int, blocks: Blocks) -> Iterator[tuple[str, LinePlan, Blocks]]:
    link = plan.controllers[index]
    all_of_it, changes = plan, 0
    if isinstance(plan.drives, SerialEndpoint) and plan.drives.baudrate < FAST_BAUD:
        drives = replace(plan.drives, baudrate=FAST_BAUD)
        yield f"drives at {FAST_BAUD} Bd", replace(plan, drives=drives), blocks
        all_of_it, changes = replace(all_of_it, drives=drives), changes + 1
    if isinstance(link.endpoint, SerialEndpoint) and link.endpoint.baudrate < FAST_BAUD:
        links = list(plan.controllers)
        links[index] = replace(link, endpoint=replace(link.endpoint, baudrate=FAST_BAUD))
        yield f"{link.plan.name} at {FAST_BAUD} Bd", replace(plan, controllers=tuple(links)), blocks
        all_of_it, changes = replace(all_of_it, controllers=tuple(links)), changes + 1
    if changes > 1:
        yield f"both at {FAST_BAUD} Bd", all_of_it, blocks
    if blocks != AS_MAPPED:
        yield "only the registers of the map", plan, AS_MAPPED
