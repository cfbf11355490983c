"""How long an exchange is on serial wires, by arithmetic of the bench's own; and what ``budget`` says."""

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from bench.errors import BenchError
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


@dataclass(frozen=True, slots=True)
class Budget:
    """What ``pitch-gateway budget`` computes for a written position and its reply, in milliseconds."""

    direct_ms: float
    through_ms: float


def budget_of(config: Path) -> Budget | None:
    """Ask ``pitch-gateway budget`` about a configuration with one line; None where there is no such command.

    Raises:
        BenchError: it answers something else than it did when this was written.
    """
    if not has_command("budget"):
        return None
    done = subprocess.run(
        gateway_command("budget", config, "--json"),
        capture_output=True, text=True, check=False, cwd=ROOT, env=environment(), timeout=60,
    )  # fmt: skip
    try:
        (line,) = json.loads(done.stdout)["lines"].values()
        (controller,) = line["controllers"].values()
        (written,) = (each for each in controller["exchanges"] if each["what"] == "write target")
        return Budget(written["direct_ms"], written["total_ms"])
    except (ValueError, KeyError) as error:
        raise BenchError(
            f"budget --json is not understood ({error!r}): {done.stderr or done.stdout}"
        ) from error
