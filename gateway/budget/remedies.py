"""What makes a line faster, and by how much: the same arithmetic with one thing changed. Drive side first."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import msgspec

from gateway.budget.line import ControllerBudget, ExchangeBudget, line_budget
from gateway.budget.sequence import AS_MAPPED, Blocks
from gateway.state.plan import LinePlan
from gateway.transport.endpoints import SerialEndpoint

FAST_BAUD: Final = 115_200
"""What nearly every drive with RS-485 can do."""
LEAST_GAIN: Final = 0.05
"""Share of the time below which a change is not worth the words."""


@dataclass(frozen=True, slots=True)
class Remedy:
    """One change, and what it does to the slowest exchange and to a round."""

    what: str
    now: ControllerBudget
    then: ControllerBudget

    @property
    def waited_before_ns(self) -> int:
        """What the controller waits for the slowest exchange as it is."""
        return self.now.longest_ns(waited)

    @property
    def waited_ns(self) -> int:
        """What it waits for it with the change."""
        return self.then.longest_ns(waited)

    @property
    def round_before_ns(self) -> int:
        """A round as it is."""
        return self.now.round.total_ns

    @property
    def round_ns(self) -> int:
        """A round with the change."""
        return self.then.round.total_ns

    def is_worth_it(self, counted: Callable[[ExchangeBudget], int]) -> bool:
        """Whether it is enough for the words, by what is counted of an exchange or by a round.

        A faster controller may have to wait longer: its next request is there before the drives' wire has
        been silent. What makes anything slower is no remedy.
        """
        if self.waited_ns > self.waited_before_ns or self.round_ns > self.round_before_ns:
            return False
        gains = (
            (self.now.longest_ns(counted), self.then.longest_ns(counted)),
            (self.round_before_ns, self.round_ns),
        )
        return any(before - after > LEAST_GAIN * before for before, after in gains)


def waited(exchange: ExchangeBudget) -> int:
    """Count what the controller waits for an exchange, in ns."""
    return exchange.legs.waited_ns


def remedies(
    plan: LinePlan,
    index: int,
    blocks: Blocks = AS_MAPPED,
    counted: Callable[[ExchangeBudget], int] = waited,
) -> tuple[Remedy, ...]:
    """Return what would help controller ``index`` of a line, each change by itself and then all together."""
    now = line_budget(plan, blocks).controllers[index]
    found = [
        Remedy(what, now, line_budget(changed, changed_blocks).controllers[index])
        for what, changed, changed_blocks in _changes(plan, index, blocks)
    ]
    return tuple(each for each in found if each.is_worth_it(counted))


def _changes(plan: LinePlan, index: int, blocks: Blocks) -> Iterator[tuple[str, LinePlan, Blocks]]:
    link = plan.controllers[index]
    all_of_it, changes = plan, 0
    if isinstance(plan.drives, SerialEndpoint) and plan.drives.baudrate < FAST_BAUD:
        drives = msgspec.structs.replace(plan.drives, baudrate=FAST_BAUD)
        yield f"drives at {FAST_BAUD} Bd", replace(plan, drives=drives), blocks
        all_of_it, changes = replace(all_of_it, drives=drives), changes + 1
    if isinstance(link.endpoint, SerialEndpoint) and link.endpoint.baudrate < FAST_BAUD:
        links = list(plan.controllers)
        links[index] = replace(link, endpoint=msgspec.structs.replace(link.endpoint, baudrate=FAST_BAUD))
        yield f"{link.plan.name} at {FAST_BAUD} Bd", replace(plan, controllers=tuple(links)), blocks
        all_of_it, changes = replace(all_of_it, controllers=tuple(links)), changes + 1
    if changes > 1:
        yield f"both at {FAST_BAUD} Bd", all_of_it, blocks
    if blocks != AS_MAPPED:
        yield "only the registers of the map", plan, AS_MAPPED
