"""How long an exchange is on serial wires, by arithmetic of the bench's own; and what ``budget`` says."""

import json
import subprocess
from pathlib import Path
from typing import Final

from bench.gateway_process import gateway_command, has_command
from bench.places import ROOT
from bench.processes import environment

BITS_PER_CHARACTER: Final = 10
"""A start bit, eight data bits, no parity, one stop bit: what a configuration without ``parity`` means."""
WRITE_REQUEST: Final = 13
"""Unit, function, address (2), number (2), count of bytes, four bytes of a position, CRC (2)."""
WRITE_REPLY: Final = 8
"""Unit, function, address (2), number (2), CRC (2)."""


def wire_ns(characters: int, baudrate: int, wires: int = 1) -> float:
    """Return how long so many characters take, handed on from wire to wire as whole frames.

    >>> wire_ns(WRITE_REQUEST + WRITE_REPLY, 9600)
    21875000.0
    """
    return wires * characters * BITS_PER_CHARACTER * 1e9 / baudrate


def round_trip_ns(baudrate: int, wires: int) -> float:
    """Return the wire time of one written position and its reply. No silence falls into it.

    The 3.5 characters before a frame pass while the other wire is still busy: on each wire the last byte was
    at least one frame of the other wire ago.
    """
    return wire_ns(WRITE_REQUEST + WRITE_REPLY, baudrate, wires)


def budget_of(config: Path) -> str:
    """Return what ``pitch-gateway budget`` computes for the line of a configuration; empty without it."""
    if not has_command("budget"):
        return ""
    done = subprocess.run(
        gateway_command("budget", config, "--json"),
        capture_output=True, text=True, check=False, cwd=ROOT, env=environment(), timeout=60,
    )  # fmt: skip
    try:
        said = json.loads(done.stdout)
    except ValueError:
        return f"no JSON: {(done.stderr or done.stdout).strip()}"
    return ", ".join(f"{name} {value:g}" for name, value in _numbers(said))


def _numbers(said: object, name: str = "") -> list[tuple[str, float]]:
    """Every number with a time in its name, wherever it stands."""
    if isinstance(said, dict):
        return [pair for key, value in said.items() for pair in _numbers(value, str(key))]
    if isinstance(said, list):
        return [pair for value in said for pair in _numbers(value, name)]
    is_time = name.endswith(("_ms", "_us", "_ns"))
    return [(name, float(said))] if is_time and isinstance(said, int | float) else []
