"""A controller's session as a list of requests, and what becomes of it on a wire.

``sessions/README.md`` says how a session is written.
"""

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.simulator.ledger import MoveKind
from gateway.transport.master import ModbusMaster

AGAIN: Final = re.compile(r"(\w{4})\*(\d+)")
"""A word that stands there as often as it says."""
REQUEST_S: Final = 0.010
PATIENCE: Final = 2_000
"""Questions that are asked before a condition counts as never met."""
MEI: Final = 43
Transcript = list[tuple[str, str]]
"""Requests and replies."""


class MachineClock:
    """Time on the machine, which only the script moves on."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@dataclass(frozen=True)
class Step:
    """One line: a request that is repeated until its condition is met, or a wait."""

    request: bytes = b""
    mask: int | None = None
    wanted: bytes | None = None
    wait_s: float = 0.0

    @classmethod
    def of(cls, line: str) -> "Step":
        """Read one line without its comment."""
        if line.startswith("wait"):
            return cls(wait_s=float(line.removeprefix("wait")) / 1000)
        request, _, condition = line.partition("|")
        mask, _, wanted = condition.partition("=")
        return cls(
            bytes.fromhex(AGAIN.sub(lambda word: word[1] * int(word[2]), request)),
            int(mask, 16) if mask.strip() else None,
            bytes.fromhex(wanted) if condition else None,
        )

    def is_met_by(self, reply: bytes) -> bool:
        """Whether the reply ends the repetition."""
        if self.wanted is None:
            return True
        data = reply[12:] if reply[0] == MEI else reply[2:]
        if self.mask is None:
            return data == self.wanted
        return int.from_bytes(data[:2]) & self.mask == int.from_bytes(self.wanted)


@dataclass(frozen=True)
class Session:
    """What a controller says to one drive, and what that drive must make of it."""

    drive: str
    kind: str
    """``rtu`` or ``tcp``, as the drive is connected."""
    unit_id: int
    text: str
    moves: tuple[tuple[MoveKind, int | None], ...]
    """In counts of the drive. Homing, zero and stop stand among them."""

    @classmethod
    def read(cls, path: Path) -> "Session":
        """Read a file of ``sessions``."""
        told = tomllib.loads(path.read_text(encoding="utf-8"))
        moves = (line.split() for line in told["moves"].splitlines())
        return cls(
            path.stem,
            told["cable"],
            told["unit_id"],
            told["requests"],
            tuple((MoveKind(kind), int(counts[0]) if counts else None) for kind, *counts in moves),
        )

    @property
    def steps(self) -> list[Step]:
        """The lines of the text."""
        lines = (line.partition("#")[0].strip() for line in self.text.splitlines())
        return [Step.of(line) for line in lines if line]


async def run(session: Session, master: ModbusMaster, clock: MachineClock) -> Transcript:
    """Say everything; return what was said and answered."""
    transcript: Transcript = []
    for step in session.steps:
        clock.now_s += step.wait_s
        if not step.request:
            continue
        for _ in range(PATIENCE):
            clock.now_s += REQUEST_S
            reply = await master.exchange(session.unit_id, step.request)
            transcript.append((step.request.hex(" "), reply.hex(" ")))
            if step.is_met_by(reply):
                break
        else:
            raise AssertionError(f"never so: {step}, last {transcript[-1]}")
    return transcript
