"""A mill of three worn axes: simulated drives, the real gateway, and a controller that moves it."""

import contextlib
import itertools
import json
import socket
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from gateway.modbus.mbap import encode_mbap
from tests.support.config import axis, gateway_toml, line, registers, tcp, written
from tests.support.ports import free_port
from tests.support.processes import COMMAND, ROOT, SECONDS, Running, ending, of_checkout, running, started

TABLES: Final = ROOT / "tables" / "demo"
TRAVELS: Final = {"x": (-300.0, 0.0), "y": (0.0, 250.0), "z": (-200.0, 0.0)}


class Mill:
    """A mill that runs: its configuration, its gateway, and where it is served."""

    def __init__(self, folder: Path, budget_us: int = 1_000_000) -> None:
        self.folder = folder
        self.tables = folder / "tables"
        http, drives, self.controller_port, panel = (free_port() for _ in range(4))
        self.address = f"http://127.0.0.1:{http}/"
        controllers = {"cnc": tcp(self.controller_port), "panel": {**tcp(panel), "role": "monitor"}}
        axes = [
            axis(
                name,
                registers(command=100, actual=200),
                unit_id=unit_id,
                travel=travel,
                max_speed=50.0,
                budget_us=budget_us,
                compensation="on",
                table=f"cnc10{name}.tab",
            )
            for unit_id, (name, travel) in enumerate(TRAVELS.items(), start=1)
        ]
        tables = {table.name: table.read_bytes() for table in TABLES.glob("cnc10*.tab")}
        text = gateway_toml(line(drives, controllers), *axes, name="mill-1", http=f"127.0.0.1:{http}")
        self.config = written(folder, text, tables)

    @contextlib.contextmanager
    def running(self) -> Iterator[Running]:
        """Start drives and gateway; yields the gateway once its page is there and its drives are reached.

        They run in the folder of the configuration, as at a desk: the page shows ``tables/cnc10x.tab``.
        """
        simulate = [*COMMAND, "simulate", self.config.name, "--json"]
        with started(
            simulate, cwd=self.folder, env=of_checkout(), stdout=subprocess.PIPE, text=True
        ) as drives:
            assert drives.stdout is not None
            json.loads(drives.stdout.readline())
            with running("run", self.config.name, folder=self.folder) as gateway:
                gateway.until_each("line-up", "http-ready", "relay-reached")
                with ending(gateway):
                    yield gateway


class Controller:
    """Moves all axes to and fro between places, as a program does that is run again and again."""

    def __init__(self, port: int) -> None:
        self._connection = socket.create_connection(("127.0.0.1", port), timeout=SECONDS)
        self._number = 0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def ask(self, unit_id: int, pdu: bytes) -> bytes:
        """Send a request and return the PDU of its reply."""
        self._number = self._number % 60_000 + 1
        self._connection.sendall(encode_mbap(self._number, unit_id, pdu))
        reply = self._connection.recv(300)
        return reply[7:]

    def move(self, unit_id: int, position_mm: float) -> None:
        """Command a position."""
        counts = round(position_mm * 1000.0)
        reply = self.ask(unit_id, bytes.fromhex("10 0064 0002 04") + counts.to_bytes(4, "big", signed=True))
        assert reply == bytes.fromhex("10 0064 0002"), reply.hex()

    def where(self, unit_id: int) -> float:
        """Read where an axis is, in mm."""
        reply = self.ask(unit_id, bytes.fromhex("03 00C8 0002"))
        return int.from_bytes(reply[2:6], "big", signed=True) / 1000.0

    def start(self) -> None:
        """Move on a thread of its own until :meth:`end`."""
        self._thread.start()

    def end(self) -> None:
        """Stop moving."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join(SECONDS)
        self._connection.close()

    def _run(self) -> None:
        shares = {unit_id: itertools.cycle((0.2, 0.9, 0.35, 0.7)) for unit_id in range(1, len(TRAVELS) + 1)}
        targets: dict[int, float] = {}
        for unit_id, (low, high) in enumerate(TRAVELS.values(), start=1):
            targets[unit_id] = low + (high - low) * next(shares[unit_id])
            self.move(unit_id, targets[unit_id])
        while not self._ending.wait(0.02):
            for unit_id, (low, high) in enumerate(TRAVELS.values(), start=1):
                if abs(self.where(unit_id) - targets[unit_id]) < 0.01:
                    targets[unit_id] = low + (high - low) * next(shares[unit_id])
                    self.move(unit_id, targets[unit_id])
