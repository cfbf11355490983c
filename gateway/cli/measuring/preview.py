"""What a person is told before the axis moves."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Final

from gateway.cli.measuring.session import Place, Seen
from gateway.exchange.plan import AxisPlan, Reference
from gateway.metrology.cycle import Stop

MINUTE_S: Final = 60.0
SETTLE_S: Final = 0.3
"""Looks at an axis that has arrived, and the exchanges of one stop."""


@dataclass(frozen=True, slots=True)
class Pace:
    """What the estimate of the time needs; ``speed`` in units of the axis per second."""

    dwell_s: float
    speed: float | None


def preview(place: Place, seen: Seen, stops: Sequence[Stop], instrument: str, pace: Pace) -> Iterator[str]:
    """Yield which axis moves, how far, how often, with what correction, and how it is stopped."""
    recipe, axis = place.recipe, place.recipe.plan
    units, state = axis.settings.units.value, seen.compensation.state
    low, high = min(stop.nominal for stop in stops), max(stop.nominal for stop in stops)
    use = f"{axis.table_name} is refined" if seen.compensation.is_active else "the readings make a new table"
    readings = sum(stop.measure for stop in stops)
    here = f"{seen.position:.6g} {units}"
    yield f"Axis {axis.name} stands at {here} and WILL MOVE between {low:.9g} and {high:.9g} {units}."
    yield f"  stops         {len(stops)}, with a reading at {readings} of them"
    yield f"  compensation  {state}: {use}"
    yield f"  instrument    {instrument}"
    yield f"  connection    controller {place.controller.plan.name} at {place.endpoint}"
    yield f"  each move     begins with {recipe.start or 'the writing of its target'}"
    yield f"  Ctrl-C        {recipe.stop or 'commands it back to where it is then: its map names no stop'}"
    yield "  speed         the drive's own, for no register map names a speed: make it slow at the drive"
    yield f"  time          {_time(place, stops, seen.position, pace)}"
    if seen.needed_mode is not None and recipe.mode is not None:
        before, after = seen.needed_mode
        yield f"  mode          register {recipe.mode.address:#06x} is set from {before:#06x} to {after:#06x}"
    if axis.referenced in (Reference.HOMING, Reference.SET_POSITION) and not seen.compensation.is_active:
        yield "  homed?        nobody can tell while nothing is corrected: home it before"
    yield from _terms(axis, is_active=seen.compensation.is_active)
    if axis.settings.machine_offset:
        off = -axis.settings.machine_offset
        yield f"  positions     machine positions, as in travel and the table; the controller's: {off:+.9g}"


def _terms(axis: AxisPlan, *, is_active: bool) -> Iterator[str]:
    """Yield what is added beside the table, or will be: it must not be measured into the table too."""
    if axis.thermal is not None and is_active:
        yield "  thermal       in force: the table is refined as if the screw were at its reference"
    elif axis.thermal is not None:
        at = axis.thermal.reference
        yield f"  thermal       not in force now, but on the new table: it is to hold at {at:g} °C"
    for cross in axis.cross:
        if is_active:
            yield f"  cross {cross.axis:7} in force: the table is refined without what {cross.axis} does"
        else:
            yield (
                f"  cross {cross.axis:7} not in force now, but on the new table: let it stand where "
                f"{cross.table_name} is 0"
            )


def _time(place: Place, stops: Sequence[Stop], position: float, pace: Pace) -> str:
    ways = [position, *(stop.nominal for stop in stops)]
    distance = sum(abs(after - before) for before, after in pairwise(ways))
    waits_s = len(stops) * SETTLE_S + sum(stop.measure for stop in stops) * pace.dwell_s
    settings = place.recipe.plan.settings
    speed = pace.speed or settings.max_speed
    units = settings.units.value
    if not 0.0 < speed < inf:
        return f"{waits_s / MINUTE_S:.1f} min of waiting, and {distance:.6g} {units} of moves (give --speed)"
    whole_s = waits_s + distance / speed
    return f"about {whole_s / MINUTE_S:.1f} min, where it moves with {speed:g} {units}/s"
