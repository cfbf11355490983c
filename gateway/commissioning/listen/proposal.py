"""The results of listening, for people and for programs, and a configuration from them.

The configuration has the known values; the user fills in the others.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from gateway.commissioning.listen.recognition import Match, likely, matches
from gateway.commissioning.listen.serial_line import PortSettings
from gateway.commissioning.listen.traffic import PositionGuess, RegisterUse, UnitStatistics, function_name
from gateway.drives import library
from gateway.plain import JsonObject
from gateway.transport.endpoints import PARITIES, TcpEndpoint

AXIS_NAMES: Final = "xyzabcuvw"
SPLICED: Final = "/dev/serial/by-id/THE-ADAPTER-AT-THE-"


@dataclass(frozen=True, slots=True)
class ListenPoint:
    """Where it listened: on a serial line, or before a drive at a TCP address."""

    setting: PortSettings | None = None
    near: TcpEndpoint | None = None
    far: TcpEndpoint | None = None


def proposed(listen_point: ListenPoint, units: dict[int, UnitStatistics]) -> str:
    """Return a configuration, or nothing if no unit id receives targets."""
    axes = [
        (unit_id, likely(matches(unit_id, unit)), unit.positions())
        for unit_id, unit in sorted(units.items())
        if unit_id
    ]
    moving = [axis for axis in axes if axis[2] or any("targets" in match.kinds for match in axis[1])]
    if not moving:
        return ""
    lines = [
        "# Proposed by `pitch-gateway listen`. Replace each FILL IN, which listening cannot find. Then run",
        "# `pitch-gateway check`. The controller's own pitch and backlash compensation must be off.",
        "",
        "[gateway]",
        'name = "gateway"',
        'tables = "tables"',
        "",
        "[line.main]",
        *_line(listen_point),
        "",
    ]
    for name, (unit_id, found, positions) in zip(AXIS_NAMES, moving, strict=False):
        lines += _axis(name, unit_id, found, positions)
    return "\n".join(lines)


def _line(listen_point: ListenPoint) -> list[str]:
    if listen_point.far is not None and listen_point.near is not None:
        key = "rtu_over_tcp" if listen_point.far.rtu else "tcp"
        return [
            f"drives = {{ {key} = {json.dumps(str(listen_point.far))} }}",
            "",
            "[[line.main.controllers]]",
            'name = "controller"',
            f"{key} = {json.dumps(str(listen_point.near))}",
            "# timeout_ms = FILL IN       # how long the controller waits; take it from its program",
        ]
    assert listen_point.setting is not None
    word = PARITIES[listen_point.setting.parity]
    # The standard gives a character without parity a second stop bit; most devices still have one.
    keys = f'baudrate = {listen_point.setting.baudrate}, parity = "{word}", stop_bits = 1'
    return [
        "# Stop bits cannot be found by listening. Each side of the gateway has its own adapter.",
        f"drives = {{ rtu = {json.dumps(SPLICED + 'DRIVES')}, {keys} }}",
        "",
        "[[line.main.controllers]]",
        'name = "controller"',
        f"rtu = {json.dumps(SPLICED + 'CONTROLLER')}",
        *keys.split(", "),
        "# timeout_ms = FILL IN       # how long the controller waits; take it from its program",
    ]


def _axis(name: str, unit_id: int, found: list[Match], positions: list[PositionGuess]) -> list[str]:
    head = [f"[axis.{name}]", 'line = "main"', f"unit_id = {unit_id}"]
    if found:
        best, *others = (match.drive for match in found)
        either = "".join(f", or {name}" for name in others)
        head += [f"# Guessed: {library.shipped(best).title}{either}.", f'drive = "{best}"']
    tail = [
        'units = "mm"',
        "# counts_per_unit = FILL IN  # counts of the drive in one mm, negative if it counts down",
        "# travel = [FILL IN, FILL IN]",
        '# referenced = "FILL IN"     # absolute, drive-bit, homing or set-position',
        'compensation = "shadow"',
        "",
    ]
    if not found:
        tail += _registers(name, positions[0])
    return head + tail


def _registers(name: str, guess: PositionGuess) -> list[str]:
    def field(address: int) -> str:
        return f'[{{ address = {address:#06x}, type = "int32", words = "{guess.words.value}" }}]'

    return [
        f"[axis.{name}.registers]",
        f"# Guessed: {guess.met} of {guess.targets} targets were reached there. Name triggers, modes",
        "# and bits: docs/drives.md.",
        f"command = {field(guess.command)}",
        f"actual = {field(guess.actual)}",
        "",
    ]


SHOWN_USES = 12
SHOWN_DRIVES = 3


def unit_data(unit_id: int, unit: UnitStatistics) -> JsonObject:
    """Return the traffic of a unit id as plain data."""
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


def unit_lines(unit_id: int, unit: UnitStatistics) -> Iterator[str]:
    """Yield the traffic of a unit id in words."""
    name = f"unit {unit_id}" if unit_id else "unit 0 (broadcast, without replies)"
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
            f"  {guess.actual:#06x} follows {guess.command:#06x}: int32, {guess.words.value}, "
            f"{guess.met} of {guess.targets} targets reached"
        )


def _use_text(use: RegisterUse) -> str:
    verb = "writes" if use.is_write else "reads"
    end = f" to {use.last:#06x}" if use.quantity > 1 else ""
    return f"{function_name(use.function)}: {verb} {use.address:#06x}{end}"


def _drive_text(unit_id: int, unit: UnitStatistics) -> Iterator[str]:
    found = likely(matches(unit_id, unit))
    if found:
        names = " or ".join(f"{match.drive} ({library.shipped(match.drive).title})" for match in found)
        yield f"  similar to {names}: {', '.join(found[0].kinds)}"
