"""Relay and supervisor under a manager that watches them, kills them, and keeps what they had open."""

import contextlib
import os
import pty
import signal
import socket
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.ipc.client import ask
from gateway.ipc.messages import GetStatus, Ping, Pong, Status
from gateway.modbus.rtu import encode_rtu
from tests.service.manager import Manager, managing
from tests.service.wire import MOVE, moved_on_wire
from tests.support.commands import typed
from tests.support.gateway import Master, Site, site_in

WATCHDOG_US = 2_000_000
SILENT_S = 2.5
"""Longer than a manager with this watchdog waits before it kills."""
STUCK = """
import os
from gateway.transport.timer import Timer
woke = Timer._woke
def forgets(timer):
    if "WatchdogFeeder." in repr(timer._callback):
        woke(timer)
    else:
        os.read(timer._fd, 8)
Timer._woke = forgets
import sys
from gateway.relay.__main__ import main
sys.exit(main())
"""
"""The relay with a bug: its loop turns, and no deadline of an exchange is ever seen to."""


def relay_of(site: Site) -> list[str]:
    return ["-m", "gateway.relay", str(site.config), "--log-format", "json"]


@pytest.fixture
def compiled(tmp_path: Path) -> "contextlib.AbstractContextManager[Site]":
    return site_in(tmp_path)


def up(manager: Manager) -> None:
    manager.until(READY="1")
    while "1 of 1 lines up" not in manager.told[-1].get("STATUS", ""):
        manager.next()


def test_ready_when_the_port_is_open_then_fed_then_stopping(
    tmp_path: Path, compiled: "contextlib.AbstractContextManager[Site]"
) -> None:
    with compiled as site, managing(tmp_path, WATCHDOG_US) as manager:
        assert typed("check", "--compile", str(site.config)).returncode == 0
        with manager.service(*relay_of(site)) as relay:
            manager.until(READY="1")
            [(name, _)] = manager.kept
            assert name.startswith("tcp-")
            assert site.port_is_open()
            for _ in range(3):  # an idle line gets on
                manager.until(WATCHDOG="1")
            relay.send_signal(signal.SIGTERM)
            manager.until(STOPPING="1")
            assert relay.wait(10) == 0


def test_the_supervisor_tells_too(
    tmp_path: Path, compiled: "contextlib.AbstractContextManager[Site]"
) -> None:
    with compiled as site, managing(tmp_path, WATCHDOG_US) as manager:
        command = ["-m", "gateway.supervisor", str(site.config), "--log-format", "json"]
        with manager.service(*command) as supervisor:
            assert manager.until(READY="1")["STATUS"].startswith("the relay is down")
            for _ in range(3):
                manager.until(WATCHDOG="1")
            supervisor.send_signal(signal.SIGTERM)
            manager.until(STOPPING="1")
            assert supervisor.wait(10) == 0
        assert manager.kept == []


def test_a_relay_that_hangs_is_killed_and_what_came_meanwhile_never_reaches_the_drive(
    tmp_path: Path, compiled: "contextlib.AbstractContextManager[Site]"
) -> None:
    with compiled as site, managing(tmp_path, WATCHDOG_US) as manager:
        assert typed("check", "--compile", str(site.config)).returncode == 0
        with manager.service(*relay_of(site)) as relay:
            up(manager)
            master = site.master()
            assert master.move(50_000) == 50_050
            relay.send_signal(signal.SIGSTOP)
            assert manager.falls_silent(SILENT_S)
            relay.kill()
            relay.wait()
            master.close()
            hasty = [site.master() for _ in range(3)]  # nobody runs, and nobody is refused
            for each in hasty:
                each.send(90_000)
        with manager.service(*relay_of(site)):
            up(manager)
            for each in hasty:
                with pytest.raises(ConnectionError):
                    each.move(90_000)
                each.close()
            master = site.master()
            assert master.move(60_000) == 60_060
            master.close()
        assert site.drive.told == [50_050, 60_060]


def test_a_line_that_is_stuck_is_not_fed_for_although_the_loop_turns(
    tmp_path: Path, compiled: "contextlib.AbstractContextManager[Site]"
) -> None:
    with compiled as site, managing(tmp_path, WATCHDOG_US) as manager:
        assert typed("check", "--compile", str(site.config)).returncode == 0
        with manager.service("-c", STUCK, str(site.config), "--log-format", "json"):
            up(manager)
            manager.until(WATCHDOG="1")
            site.drive.is_silent = True
            master = site.master()
            master.send(50_000)  # nobody will ever see that its time is over
            assert manager.falls_silent(SILENT_S)
            assert "line xyz: what was due" in manager.told[-1]["STATUS"]
            assert isinstance(ask(site.socket, Ping()), Pong)  # it turns
            master.close()


def test_another_address_is_not_taken_for_the_kept_one(
    tmp_path: Path, compiled: "contextlib.AbstractContextManager[Site]"
) -> None:
    with compiled as site, managing(tmp_path) as manager:
        assert typed("check", "--compile", str(site.config)).returncode == 0
        with manager.service(*relay_of(site)):
            up(manager)
            [(before, _)] = manager.kept
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        text = site.config.read_text()
        site.config.write_text(text.replace(f'tcp = "127.0.0.1:{site.port}"', f'tcp = "127.0.0.1:{port}"'))
        assert typed("check", "--compile", str(site.config)).returncode == 0
        with manager.service(*relay_of(site)):
            up(manager)
            [(after, _)] = manager.kept
            assert after != before
            with pytest.raises(ConnectionRefusedError):
                site.master()
            master = Master(port, site.drive)
            assert master.move(50_000) == 50_050
            master.close()


def test_a_serial_port_is_kept_and_what_it_heard_meanwhile_is_thrown_away(
    tmp_path: Path, compiled: "contextlib.AbstractContextManager[Site]"
) -> None:
    with compiled as site, managing(tmp_path) as manager, _line() as (wire, device):
        text = site.config.read_text()
        start = text.index("drives = ")
        drives = f'drives = {{ rtu = "{device}", baudrate = 115200 }}\nresponse_timeout_ms = 100\n'
        site.config.write_text(text[:start] + drives + text[text.index("\n", start) :])
        checked = typed("check", "--compile", str(site.config))
        assert checked.returncode == 0, checked.stderr
        with manager.service(*relay_of(site)) as relay:
            up(manager)
            assert moved_on_wire(site.port, wire) == encode_rtu(1, MOVE)
            relay.kill()
            relay.wait()
        assert sorted(name.partition("-")[0] for name, _ in manager.kept) == ["tcp", "tty"]
        os.write(wire, b"\x01\x10 half a reply to what the relay before asked")
        with manager.service(*relay_of(site)) as relay:
            up(manager)
            assert moved_on_wire(site.port, wire) == encode_rtu(1, MOVE)
            status = ask(site.socket, GetStatus())
            assert isinstance(status, Status)
            line = status.status.lines["xyz"]
            assert (line.stray_bytes, line.dropped_bytes, line.late) == (0, 0, 0)
            relay.send_signal(signal.SIGTERM)
            assert relay.wait(10) == 0


@contextlib.contextmanager
def _line() -> Iterator[tuple[int, str]]:
    master, slave = pty.openpty()
    tty.setraw(slave)
    try:
        yield master, os.ttyname(slave)
    finally:
        os.close(master)
        os.close(slave)
