"""A whole gateway with a contact that means trouble: a coil of pymodbus's server, which nobody here wrote."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymodbus.client import ModbusTcpClient

from tests.support.gateway import Site, gateway_of
from tests.support.ports import free_port
from tests.support.processes import children, eventually, started

SERVER = """
import sys
from pymodbus.server import StartTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice
coils = [SimData(0, count=16, values=False, datatype=DataType.BITS)]
device = SimDevice(1, simdata=(coils, coils, [SimData(0)], [SimData(0)]))
StartTcpServer(device, address=("127.0.0.1", int(sys.argv[1])))
"""
COIL = 5


@pytest.fixture(name="module")
def _module(tmp_path: Path) -> Iterator[ModbusTcpClient]:
    """A remote I/O module, and somebody who reads its coils."""
    port = free_port()
    script = tmp_path / "module.py"
    script.write_text(SERVER)
    with started([sys.executable, "-P", str(script), str(port)], stderr=subprocess.DEVNULL):
        client = ModbusTcpClient("127.0.0.1", port=port)
        eventually(client.connect, bool)
        yield client
        client.close()  # type: ignore[no-untyped-call]


def wait_for(module: ModbusTcpClient, *, is_closed: bool) -> None:
    eventually(lambda: module.read_coils(COIL, count=1).bits[0], lambda closed: closed is is_closed)


def test_it_opens_with_a_relay_that_hangs_and_with_the_end_of_the_gateway(
    site: Site, module: ModbusTcpClient
) -> None:
    port = module.comm_params.port
    keys = f'[alarm_output]\nmodbus = "127.0.0.1:{port}"\ncoil = {COIL}\nevery_s = 0.2\n'
    site.config.write_text(keys + site.config.read_text())
    with gateway_of(site) as (gateway, master):
        assert master.move(50_000) == 50_050
        wait_for(module, is_closed=True)
        relay = children(gateway.process)["gateway.relay"]
        os.kill(relay, signal.SIGSTOP)
        try:
            wait_for(module, is_closed=False)
        finally:
            os.kill(relay, signal.SIGCONT)
        wait_for(module, is_closed=True)
    assert module.read_coils(COIL, count=1).bits[0] is False
