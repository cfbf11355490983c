"""A configuration out of what was heard: what is known is written, what is not has to be filled in."""

import json
from dataclasses import dataclass
from typing import Final

from gateway.cli.first_configuration import PARITIES
from gateway.cli.listening.ear import Setting
from gateway.cli.listening.recognition import Match, likely, matches
from gateway.cli.listening.tally import PositionGuess, UnitTally
from gateway.drives import library
from gateway.transport.endpoints import TcpEndpoint

AXIS_NAMES: Final = "xyzabcuvw"
SPLICED: Final = "/dev/serial/by-id/THE-ADAPTER-AT-THE-"


@dataclass(frozen=True, slots=True)
class Place:
    """Where was listened: on a serial line, or before a drive at a TCP address."""

    setting: Setting | None = None
    near: TcpEndpoint | None = None
    far: TcpEndpoint | None = None


def proposed(place: Place, units: dict[int, UnitTally]) -> str:
    """Return a configuration, or nothing where no unit id takes targets."""
    axes = [
        (unit_id, likely(matches(unit_id, unit)), unit.positions())
        for unit_id, unit in sorted(units.items())
        if unit_id
    ]
    moving = [axis for axis in axes if axis[2] or any("targets" in match.kinds for match in axis[1])]
    if not moving:
        return ""
    lines = [
        "# Proposed by `pitch-gateway listen`. What stands behind FILL IN nobody can hear; then",
        "# `pitch-gateway check`. The controller's own pitch and backlash compensation have to be off.",
        "",
        "[gateway]",
        'name = "gateway"',
        'tables = "tables"',
        "",
        "[line.main]",
        *_line(place),
        "",
    ]
    for name, (unit_id, found, positions) in zip(AXIS_NAMES, moving, strict=False):
        lines += _axis(name, unit_id, found, positions)
    return "\n".join(lines)


def _line(place: Place) -> list[str]:
    if place.far is not None and place.near is not None:
        key = "rtu_over_tcp" if place.far.rtu else "tcp"
        return [
            f"drives = {{ {key} = {json.dumps(str(place.far))} }}",
            "",
            "[[line.main.controllers]]",
            'name = "controller"',
            f"{key} = {json.dumps(str(place.near))}",
            "# timeout_ms = FILL IN       # after this the controller gives up; take it from its program",
        ]
    assert place.setting is not None
    word = PARITIES[place.setting.parity]
    # The standard gives a character without parity a second stop bit; most devices have one all the same.
    keys = f'baudrate = {place.setting.baudrate}, parity = "{word}", stop_bits = 1'
    return [
        "# Stop bits cannot be heard. Each side of the gateway has an adapter of its own.",
        f"drives = {{ rtu = {json.dumps(SPLICED + 'DRIVES')}, {keys} }}",
        "",
        "[[line.main.controllers]]",
        'name = "controller"',
        f"rtu = {json.dumps(SPLICED + 'CONTROLLER')}",
        *keys.split(", "),
        "# timeout_ms = FILL IN       # after this the controller gives up; take it from its program",
    ]


def _axis(name: str, unit_id: int, found: list[Match], positions: list[PositionGuess]) -> list[str]:
    head = [f"[axis.{name}]", 'line = "main"', f"unit_id = {unit_id}"]
    if found:
        best, *others = (match.drive for match in found)
        either = "".join(f", or {name}" for name in others)
        head += [f"# Guessed: {library.shipped(best).title}{either}.", f'drive = "{best}"']
    tail = [
        'units = "mm"',
        "# counts_per_unit = FILL IN  # counts of the drive in one mm, negative where it counts down",
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
        f"# Guessed: {guess.met} of {guess.targets} targets were reached there. Triggers, modes and bits too",
        "# have to be named: docs/drives.md.",
        f"command = {field(guess.command)}",
        f"actual = {field(guess.actual)}",
        "",
    ]
