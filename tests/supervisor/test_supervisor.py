"""The supervisor as a whole, where something goes wrong that nobody thought of."""

import asyncio
from pathlib import Path

from gateway.config.load import load
from gateway.ipc.address import socket_path
from gateway.ipc.log import LogEntry
from gateway.ipc.messages import Ping, Pong, Status, decode_request, encode
from gateway.state.plan import shape_of
from gateway.status.model import RelayModel
from gateway.supervisor.interventions import Cause
from gateway.supervisor.supervisor import Supervisor
from tests.support.config import RAMP, one_axis


async def test_a_mistake_of_ours_is_told_and_ends_nothing(tmp_path: Path) -> None:
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "x.tab").write_text(RAMP)
    (tmp_path / "state").mkdir(mode=0o700)
    config = tmp_path / "gateway.toml"
    config.write_text(one_axis(drives=1, port=2))
    pong = Pong(name="trial", gateway_version="0", pid=1, shape=shape_of(load(config).plan))

    async def relay_of_nobodys(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer as a relay of this shape whose status has no axes at all."""
        request = decode_request(await reader.readline())
        writer.write(encode(pong if isinstance(request, Ping) else Status(status=RelayModel())))
        writer.close()

    notes: list[LogEntry] = []
    supervisor = Supervisor(config, tmp_path / "state", notes.append)
    listening = await asyncio.start_unix_server(relay_of_nobodys, socket_path(tmp_path / "state"))
    async with listening:
        running = asyncio.create_task(supervisor.run())
        for _ in range(2):  # the second time it is there as before
            outcome = await asyncio.wait_for(supervisor.reload(Cause("http")), 30.0)
            assert "an error in the supervisor: KeyError: 'x' (tables.py:" in outcome.problems[0]
        assert not running.done()
        model = supervisor.broadcast.model
        assert model is not None
        assert model.supervisor is not None
        assert "an error in the supervisor" in str(model.supervisor.tables_folder.problem)
        assert model.axes == {}
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
    assert "reload-refused" in [note.event for note in notes]
