"""Every drive of a known make goes through a controller's session, on its own kind of cable."""

from contextlib import AsyncExitStack

import pytest

from gateway.simulator.drives.catalogue import DRIVES
from tests.contract.bench import SESSIONS, DriveBench
from tests.contract.script import Session, run


def test_every_drive_has_a_session() -> None:
    assert sorted(session.drive for session in SESSIONS) == sorted(DRIVES)


@pytest.mark.parametrize("session", SESSIONS, ids=lambda session: session.drive)
async def test_a_drive_does_what_it_is_told(session: Session) -> None:
    async with AsyncExitStack() as exits:
        bench = DriveBench(session, exits)
        master = await bench.master(await bench.serve())
        transcript = await run(session, master, bench.clock)
        assert bench.moves == session.moves
        assert len(transcript) >= len([step for step in session.steps if step.request])
