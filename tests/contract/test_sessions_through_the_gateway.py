"""The gateway between a controller and each drive: the one cannot tell, the other is where it should be.

Where the correction is the same for every place, a session with the gateway has the transcript of the one
without, request by request, also while the axis moves. Where it is not, what the drive was told is what
counts.
"""

from contextlib import AsyncExitStack
from typing import Final

import pytest

from gateway.drives.library import names
from gateway.simulator.ledger import MoveKind
from tests.contract.bench import SESSIONS, DriveBench
from tests.contract.script import Session, Transcript, run
from tests.contract.through import master_through_gateway, table_of

SHIPPED: Final = [session for session in SESSIONS if session.drive in names()]
CORRECTION_MM: Final = 0.05
CORRECTION_COUNTS: Final = 50
Moves = tuple[tuple[MoveKind, int | None], ...]


def test_every_shipped_profile_has_a_session() -> None:
    assert sorted(session.drive for session in SHIPPED) == sorted(names())


async def _without_gateway(session: Session) -> Transcript:
    async with AsyncExitStack() as exits:
        bench = DriveBench(session, exits)
        return await run(session, await bench.master(await bench.serve()), bench.clock)


def _moved_on(moves: Moves) -> Moves:
    """Return the same moves on the drive's scale: corrected until the controller renames the place."""
    kinds = [kind for kind, _ in moves]
    renamed_at = kinds.index(MoveKind.SET_POSITION) if MoveKind.SET_POSITION in kinds else len(kinds)
    return tuple(
        (kind, target if target is None or at >= renamed_at else target + CORRECTION_COUNTS)
        for at, (kind, target) in enumerate(moves)
    )


@pytest.mark.parametrize("session", SHIPPED, ids=lambda session: session.drive)
async def test_a_table_of_zeros_changes_nothing(session: Session) -> None:
    async with AsyncExitStack() as exits:
        bench = DriveBench(session, exits)
        master = await master_through_gateway(bench, exits, table_of(0.0, 0.0))
        assert await run(session, master, bench.clock) == await _without_gateway(session)
        assert bench.moves == session.moves


@pytest.mark.parametrize("session", SHIPPED, ids=lambda session: session.drive)
async def test_a_correction_is_seen_by_the_drive_and_by_nobody_else(session: Session) -> None:
    async with AsyncExitStack() as exits:
        bench = DriveBench(session, exits, start_mm=CORRECTION_MM)
        master = await master_through_gateway(bench, exits, table_of(CORRECTION_MM, CORRECTION_MM))
        assert await run(session, master, bench.clock) == await _without_gateway(session)
        assert bench.moves == _moved_on(session.moves)


SLOPE_MM: Final = 0.002
"""Correction for each millimetre; 50 counts more going forward, 50 fewer going backward."""


def _corrected(moves: Moves) -> list[int | None]:
    """Return the targets that the drive must be told, worked out from the nominal ones and from nothing else.

    None stands for a stop: it leaves the axis where it happens to be.
    """
    targets: list[int | None] = []
    nominal_counts, is_referenced = 0, True
    for kind, target_counts in moves:
        is_referenced = is_referenced and kind is not MoveKind.SET_POSITION
        told = target_counts
        if kind in (MoveKind.ABSOLUTE, MoveKind.RELATIVE) and target_counts is not None and is_referenced:
            sign = 1 if target_counts > nominal_counts else -1
            told = round(target_counts * (1 + SLOPE_MM) + sign * CORRECTION_COUNTS)
        targets.append(None if kind is MoveKind.STOP else told)
        nominal_counts = target_counts or 0
    return targets


@pytest.mark.parametrize("session", SHIPPED, ids=lambda session: session.drive)
async def test_every_move_is_corrected_for_its_end_and_its_direction(session: Session) -> None:
    async with AsyncExitStack() as exits:
        bench = DriveBench(session, exits)
        table = table_of(CORRECTION_MM, -CORRECTION_MM, SLOPE_MM)
        await run(session, await master_through_gateway(bench, exits, table), bench.clock)
        assert [kind for kind, _ in bench.moves] == [kind for kind, _ in session.moves]
        told = [None if kind is MoveKind.STOP else target for kind, target in bench.moves]
        assert told == _corrected(session.moves)
