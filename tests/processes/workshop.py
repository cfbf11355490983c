"""One gateway with many axes on one line, and a drive that answers for all of them."""

import contextlib
import socket
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.support.commands import typed
from tests.support.config import gateway_toml, line, written
from tests.support.gateway import Drive, Master
from tests.support.ports import free_port
from tests.support.processes import Running, running


@dataclass(frozen=True, slots=True)
class Workshop:
    """A gateway that runs, its drives, and where its tables are; axes have the unit ids 1, 2, 3 ..."""

    gateway: Running
    drive: Drive
    port: int
    tables: Path

    @contextlib.contextmanager
    def master(self, unit_id: int) -> Iterator[Master]:
        """Yield who moves an axis; targets in counts."""
        master = Master(self.port, self.drive, unit_id)
        try:
            yield master
        finally:
            master.close()


@contextlib.contextmanager
def workshop_in(folder: Path, axes: Sequence[str], tables: Mapping[str, str | bytes]) -> Iterator[Workshop]:
    """Check and run a configuration of these sections and table files; each axis is on the line ``xyz``."""
    port = free_port()
    with socket.create_server(("127.0.0.1", 0)) as listening:
        text = gateway_toml(line(listening.getsockname()[1], {"cnc": port}), *axes)
        config = written(folder, text, tables)
        checked = typed("check", str(config))
        assert checked.returncode == 0, checked.stdout + checked.stderr
        drive = Drive(listening)
        with running("run", str(config)) as gateway:
            gateway.until_each("line-up", "relay-reached")
            yield Workshop(gateway, drive, port, folder / "tables")
            assert gateway.end() == 0
