"""Recordings of a relay on the bench, read and replayed."""

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from gateway.recording import traffic
from gateway.recording.replay import Replay, ReplayResult, paced_first
from gateway.state.plan import GatewayPlan

HEADER: Final = traffic.Header(traffic.FORMAT, "0", "2026-01-01T00:00:00+00:00", "gateway.toml", "")


def entries_of(path: Path) -> list[traffic.Entry]:
    return [traffic.decode(line) for line in path.read_bytes().splitlines(keepends=True)]


def replayed(
    plan: GatewayPlan, recorded: Path | Iterable[traffic.Entry], only: str | None = None
) -> ReplayResult:
    """Replay a file or entries, all lines or one; return the result."""
    replay = Replay(plan, only)
    entries = entries_of(recorded) if isinstance(recorded, Path) else recorded
    for number, entry in paced_first(enumerate(entries, start=1)):
        replay.feed(number, entry)
    return replay.result
