"""One gateway with many axes on one line, and a drive that answers for all of them."""

import contextlib
import json
import socket
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.processes.bench import Drive, Master, Running, running
from tests.support.commands import typed
from tests.support.ports import free_port

HEAD: Final = """[gateway]
name = "trial"

[http]
listen = ""

[line.all]
drives = {{ tcp = "127.0.0.1:{drives}" }}

[[line.all.controllers]]
name = "cnc"
tcp = "127.0.0.1:{port}"
"""


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
def workshop_in(folder: Path, axes: Sequence[str], tables: Mapping[str, bytes]) -> Iterator[Workshop]:
    """Check and run a configuration of these sections and table files; each axis is on the line ``all``."""
    (folder / "tables").mkdir()
    for name, data in tables.items():
        (folder / "tables" / name).write_bytes(data)
    port = free_port()
    with socket.create_server(("127.0.0.1", 0)) as listening:
        config = folder / "gateway.toml"
        config.write_text(HEAD.format(drives=listening.getsockname()[1], port=port) + "".join(axes))
        checked = typed("check", str(config))
        assert checked.returncode == 0, checked.stdout + checked.stderr
        drive = Drive(listening)
        with running("run", str(config)) as gateway:
            seen: set[str] = set()
            while not {"line-up", "relay-reached"} <= seen:
                line = gateway.line()
                assert line
                if line.startswith("{"):  # before it come the warnings of the configuration
                    seen.add(json.loads(line)["event"])
            yield Workshop(gateway, drive, port, folder / "tables")
            assert gateway.end() == 0
