"""What was heard, for people and for scripts."""

from collections.abc import Iterator
from typing import Any

from gateway.cli.listening.proposal import Place, proposed
from gateway.cli.listening.recognition import likely, matches
from gateway.cli.listening.tally import Tally, UnitTally, Use, function_name
from gateway.drives import library

SHOWN_USES = 12
SHOWN_DRIVES = 3


def as_data(tally: Tally, place: Place) -> dict[str, Any]:
    """Return everything, for scripts."""
    return {
        "units": {str(unit_id): _unit_data(unit_id, unit) for unit_id, unit in sorted(tally.units.items())},
        "configuration": proposed(place, tally.units),
    }


def _unit_data(unit_id: int, unit: UnitTally) -> dict[str, Any]:
    found = matches(unit_id, unit)
    return {
        "requests": unit.requests,
        "answered": unit.answered,
        "replies_alone": unit.replies_alone,
        "exceptions": {str(code): count for code, count in sorted(unit.exceptions.items())},
        "uses": [{**use._asdict(), "count": count} for use, count in unit.uses.most_common()],
        "other_functions": {str(function): count for function, count in sorted(unit.unplaced.items())},
        "sounds_like": [match.drive for match in likely(found)],
        "drives": [
            {"drive": match.drive, "points": round(match.points, 2), "heard": list(match.kinds)}
            for match in found[:SHOWN_DRIVES]
        ],
        "positions": [
            {
                "command": guess.command,
                "actual": guess.actual,
                "words": guess.words.value,
                "met": guess.met,
                "targets": guess.targets,
            }
            for guess in unit.positions()[:SHOWN_DRIVES]
        ],
    }


def as_text(tally: Tally) -> Iterator[str]:
    """Yield lines for people, without the configuration."""
    for unit_id, unit in sorted(tally.units.items()):
        yield from _unit_text(unit_id, unit)


def _unit_text(unit_id: int, unit: UnitTally) -> Iterator[str]:
    name = f"unit {unit_id}" if unit_id else "unit 0 (everybody; nobody answers)"
    refused = ", ".join(f"{count} × exception {code}" for code, count in sorted(unit.exceptions.items()))
    alone = f", {unit.replies_alone} replies without a request" if unit.replies_alone else ""
    yield f"{name}: {unit.requests} requests, {unit.answered} answered{alone}" + (
        f" ({refused})" if refused else ""
    )
    for use, count in unit.uses.most_common(SHOWN_USES):
        yield f"  {count:6} × {_use_text(use)}"
    if (more := len(unit.uses) - SHOWN_USES) > 0:
        yield f"  and {more} others (--json has all)"
    for function, count in unit.unplaced.most_common():
        yield f"  {count:6} × {function_name(function)}"
    yield from _drive_text(unit_id, unit)
    for guess in unit.positions()[:1]:
        yield (
            f"  {guess.actual:#06x} goes where {guess.command:#06x} is told to: int32, {guess.words.value}, "
            f"{guess.met} of {guess.targets} targets reached"
        )


def _use_text(use: Use) -> str:
    verb = "writes" if use.is_write else "reads"
    end = f" to {use.last:#06x}" if use.quantity > 1 else ""
    return f"{function_name(use.function)}: {verb} {use.address:#06x}{end}"


def _drive_text(unit_id: int, unit: UnitTally) -> Iterator[str]:
    found = likely(matches(unit_id, unit))
    if found:
        names = " or ".join(f"{match.drive} ({library.shipped(match.drive).title})" for match in found)
        yield f"  sounds like {names}: {', '.join(found[0].kinds)}"
