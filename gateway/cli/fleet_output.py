"""Terminal output of ``pitch-gateway status URL…``: one row for each gateway."""

from collections.abc import Iterator
from typing import Final

from rich.console import RenderableType
from rich.markup import escape

from gateway.cli.status_output import OF_VERDICT, UNKNOWN, new_table, time_of
from gateway.commissioning.fleet import UNREACHABLE, Fleet
from gateway.report.words import clean, truncated

LONGEST: Final = 300
"""Characters of a text from a gateway."""
COLOURS: Final = OF_VERDICT | {UNREACHABLE: "red"}


def fleet_parts(fleet: Fleet) -> Iterator[RenderableType]:
    """Yield the gateways, the worst first, and their number in each state."""
    table = new_table("gateway", "address", "state", "since", "corrected", "what is wrong")
    for each in fleet.gateways:
        table.add_row(
            _shown(each.name or UNKNOWN),
            _shown(each.address),
            f"[{COLOURS[each.state]}]{each.state}[/]",
            time_of(each.since) if each.since else UNKNOWN,
            f"{each.compensated} of {each.axes}" if each.axes else UNKNOWN,
            _shown(each.problem or each.worst),
        )
    yield table
    yield ""
    counted = ", ".join(f"{count} {state}" for state, count in fleet.states.items())
    yield f"{len(fleet.gateways)} gateway{'s' * (len(fleet.gateways) != 1)}: {counted}"


def _shown(text: str) -> str:
    """Return a text that may come from anything: it could control the terminal."""
    return escape(truncated(clean(text), LONGEST))
