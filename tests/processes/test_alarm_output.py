"""A whole gateway with a contact that means trouble: a coil of pymodbus's servers."""

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.processes.remote_module import RemoteModule, module_in
from tests.support.commands import typed
from tests.support.config import toml_of
from tests.support.gateway import Site, gateway_of, relay_of
from tests.support.processes import children, ending, eventually, running

COIL = 5
EVERY_WAY = pytest.mark.parametrize("way", ["tcp", "rtu"])


@pytest.fixture(name="module")
def _module(tmp_path: Path) -> Iterator[RemoteModule]:
    with module_in(tmp_path) as module:
        yield module


def connect(site: Site, module: RemoteModule, way: str) -> None:
    """Name the module in the configuration."""
    if way == "tcp":
        device: dict[str, object] = {"tcp": f"127.0.0.1:{module.port}"}
    else:
        device = {"rtu": str(module.link), "baudrate": 115200}
    keys = f"[alarm_output]\ndevice = {toml_of(device)}\ncoil = {COIL}\nevery_s = 0.2\n"
    site.config.write_text(keys + site.config.read_text())


@EVERY_WAY
def test_it_opens_with_a_relay_that_hangs_and_with_the_end_and_closes_when_the_module_is_back(
    site: Site, module: RemoteModule, way: str
) -> None:
    connect(site, module, way)
    with gateway_of(site) as (gateway, master):
        assert master.move(50_000) == 50_050
        module.wait_for(COIL, is_closed=True)
        eventually(
            lambda: typed("status", str(site.config)).stdout,
            lambda shown: "alarm contact: closed, " in shown,
        )
        relay = children(gateway.process)["gateway.relay"]
        os.kill(relay, signal.SIGSTOP)
        try:
            module.wait_for(COIL, is_closed=False)
        finally:
            os.kill(relay, signal.SIGCONT)
        module.wait_for(COIL, is_closed=True)

        module.stop()
        gateway.until("alarm-output-failed")
        shown = json.loads(typed("status", str(site.config), "--json").stdout)
        assert shown["supervisor"]["alarm_output"]["is_closed"] is None
        assert "alarm_output" in [trouble["kind"] for trouble in shown["troubles"]]
        assert master.move(60_000) == 60_060  # the relay has nothing to do with it
        module.start()
        gateway.until("alarm-output-works")
        module.wait_for(COIL, is_closed=True)
    assert not module.is_closed(COIL)


@EVERY_WAY
def test_it_opens_with_a_silent_drive_a_killed_relay_and_a_stopped_supervisor(
    site: Site, module: RemoteModule, way: str
) -> None:
    connect(site, module, way)
    site.compile()
    with running("supervise", str(site.config)) as supervisor:
        with relay_of(site) as (relay, master):
            assert master.move(50_000) == 50_050
            module.wait_for(COIL, is_closed=True)
            site.drive.is_silent = True
            while module.is_closed(COIL):
                master.send(60_000)
                assert master.is_answered_with_an_exception()
            relay.until("drive-silent")
            site.drive.is_silent = False
            while not module.is_closed(COIL):
                master.send(60_000)
                master.is_answered_with_an_exception()
            relay.process.kill()
            module.wait_for(COIL, is_closed=False)
            relay.rest()
            assert relay.process.wait() == -signal.SIGKILL
        with relay_of(site), ending(supervisor):
            module.wait_for(COIL, is_closed=True)
        assert not module.is_closed(COIL)


def test_if_the_supervisor_hangs_the_watchdog_of_the_module_opens_it(site: Site, tmp_path: Path) -> None:
    with module_in(tmp_path, watchdog_s=3.0) as module:
        connect(site, module, "tcp")
        with gateway_of(site) as (gateway, master):
            assert master.move(50_000) == 50_050
            module.wait_for(COIL, is_closed=True)
            supervisor = children(gateway.process)["gateway.supervisor"]
            os.kill(supervisor, signal.SIGSTOP)
            try:
                module.wait_for(COIL, is_closed=False)
            finally:
                os.kill(supervisor, signal.SIGCONT)
            module.wait_for(COIL, is_closed=True)
