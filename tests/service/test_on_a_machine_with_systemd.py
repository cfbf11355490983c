"""The units as they are shipped, run by systemd itself as process 1.

Under all their restrictions, with its real watchdog, store for descriptors and reload. Root only.
"""

import contextlib
import os
import signal
import socket
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.modbus.rtu import encode_rtu
from tests.service.machine import INSTALLED, Machine, booted, why_not
from tests.service.wire import MOVE, moved_on_wire
from tests.support.config import RAMP, STEEPER, one_axis
from tests.support.gateway import Drive, Master

pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not() or "never")
RELAY, SUPERVISOR, TARGET = (
    f"pitch-gateway{each}" for each in ("-relay.service", "-supervisor.service", ".target")
)
TABLE_PATH = "/etc/pitch-gateway/tables/x.tab"


CAP_SYS_RESOURCE = 24
INSTEAD_OF_LIMITS = """[Service]
CapabilityBoundingSet=CAP_SYS_NICE CAP_IPC_LOCK
AmbientCapabilities=CAP_SYS_NICE CAP_IPC_LOCK
"""
"""Stands in for LimitRTPRIO= and LimitMEMLOCK= where even root may not raise a limit, as in a container."""


def may_raise_limits() -> bool:
    status = Path("/proc/self/status").read_text()
    effective = int(status.partition("CapEff:")[2].split()[0], 16)
    return bool(effective >> CAP_SYS_RESOURCE & 1)


class Mill:
    """A machine on which the gateway is installed and runs, with a drive behind it."""

    def __init__(self, machine: Machine, port: int, drives_at: int, drive: Drive) -> None:
        self.machine = machine
        self.drives_at = drives_at
        self.port = port
        self.drive = drive

    def stop(self) -> None:
        self.machine.run("systemctl", "stop", TARGET)
        for unit in (RELAY, SUPERVISOR):
            self.machine.until(unit, "ActiveState", "inactive")

    def master(self) -> Master:
        return Master(self.port, self.drive)

    def moved(self, counts: int) -> int:
        """What the drive is told when a controller that has just connected commands a position."""
        master = self.master()
        try:
            return master.move(counts)
        finally:
            master.close()


@pytest.fixture(scope="module")
def mill(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mill]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with socket.create_server(("127.0.0.1", 0)) as listening:
        drive = Drive(listening)
        drives_at = listening.getsockname()[1]
        config = one_axis(drives=drives_at, port=port)
        config = config.replace('name = "trial"', 'name = "trial"\nstate = "/var/lib/pitch-gateway"')
        files = {"/etc/pitch-gateway/gateway.toml": config, TABLE_PATH: RAMP}
        with booted(tmp_path_factory.mktemp("machine"), files) as machine:
            machine.run("systemd-sysusers")
            machine.run("systemd-tmpfiles", "--create", "pitch-gateway.conf")
            machine.run("systemctl", "start", TARGET)
            yield Mill(machine, port, drives_at, drive)


@pytest.mark.timeout(180)
def test_it_starts_and_says_so_when_the_ports_are_open(mill: Mill) -> None:
    # `systemctl start` has returned: the relay was ready, so its port is open.
    assert mill.machine.property(RELAY, "ActiveState") == "active"
    mill.machine.until(RELAY, "StatusText", "1 of 1 lines up, 1 axes")
    assert mill.moved(50_000) == 50_050
    mill.machine.until(SUPERVISOR, "StatusText", "the relay is up")
    assert [mill.machine.property(unit, "NRestarts") for unit in (RELAY, SUPERVISOR)] == ["0", "0"]


def test_it_runs_restricted(mill: Mill) -> None:
    for unit in (RELAY, SUPERVISOR):
        status = mill.machine.of_process(unit, "status")
        words = dict(line.split(":\t", 1) for line in status.splitlines() if ":\t" in line)
        assert words["Uid"].split()[0] != "0"
        assert (words["CapEff"], words["CapBnd"]) == ("0" * 16, "0" * 16)
        assert (words["NoNewPrivs"], words["Seccomp"]) == ("1", "2")
        mounts = [line.split() for line in mill.machine.of_process(unit, "mounts").splitlines()]
        assert {"ro" in words[3].split(",") for words in mounts if words[1] == "/"} == {True}
        assert [words[2] for words in mounts if words[1] == "/root"] == ["tmpfs"]


def test_a_reload_takes_a_saved_table_and_fails_where_it_is_bad(mill: Mill) -> None:
    mill.machine.write(TABLE_PATH, STEEPER)
    mill.machine.run("systemctl", "reload", SUPERVISOR)
    assert mill.moved(50_001) == 50_101
    mill.machine.write(TABLE_PATH, "no table")
    said = mill.machine.run("systemctl", "reload", SUPERVISOR, is_checked=False)
    assert "failed" in said
    assert mill.moved(50_000) == 50_100  # the last good one
    assert mill.machine.property(SUPERVISOR, "ActiveState") == "active"
    mill.machine.write(TABLE_PATH, RAMP)
    mill.machine.run("systemctl", "reload", SUPERVISOR)
    assert mill.moved(50_001) == 50_051


def test_the_journal_finds_warnings_and_errors_by_their_priority(mill: Mill) -> None:
    """Bad and good tables, twice: as `check --compile` of the unit says it, and as the supervisor logs it."""
    mill.machine.write(TABLE_PATH, "no table")
    mill.machine.run("systemctl", "reload", SUPERVISOR, is_checked=False)
    mill.machine.run("systemctl", "restart", RELAY)
    mill.machine.write(TABLE_PATH, RAMP)
    mill.machine.run("systemctl", "reload", SUPERVISOR)
    read = ("journalctl", "--no-pager", "--output=cat", f"--unit={RELAY}", f"--unit={SUPERVISOR}")
    errors = mill.machine.run(*read, "--priority=err")
    assert "/etc/pitch-gateway/tables/x.tab" in errors
    assert '"event": "ready"' not in errors
    warnings = mill.machine.run(*read, "--priority=warning..warning")
    assert '"level": "warning"' in warnings
    levels = {"err": "error", "warning": "warning", "info": "info"}
    for priority, level in levels.items():
        said = mill.machine.run(*read, f"--priority={priority}..{priority}").splitlines()
        found = {line.partition('"level": "')[2].partition('"')[0] for line in said if line[:1] == "{"}
        assert found == {level}


@pytest.mark.timeout(180)
def test_a_relay_that_hangs_is_started_again_and_its_port_stays_open(mill: Mill) -> None:
    before = mill.drive.told.copy()
    mill.machine.kill(RELAY, signal.SIGSTOP)
    # It hangs: who connects waits in the queue of a socket that systemd keeps open, with a command.
    hasty = Master(mill.port, mill.drive)
    hasty.send(90_000)
    mill.machine.until(RELAY, "NRestarts", "1")
    mill.machine.until(RELAY, "ActiveState", "active")
    log = mill.machine.log(RELAY)
    assert "Watchdog timeout" in log
    assert "waiting-turned-away" in log
    with pytest.raises(ConnectionError):
        hasty.move(90_000)
    hasty.close()
    mill.machine.until(RELAY, "StatusText", "1 of 1 lines up, 1 axes")
    assert mill.moved(50_000) == 50_050
    assert mill.drive.told == [*before, 50_050]


def test_the_supervisor_ends_and_comes_again_without_the_relay_noticing(mill: Mill) -> None:
    relay = mill.machine.property(RELAY, "MainPID")
    mill.machine.kill(SUPERVISOR, signal.SIGKILL)
    assert mill.moved(50_002) == 50_052
    mill.machine.until(SUPERVISOR, "NRestarts", "1")
    mill.machine.until(SUPERVISOR, "ActiveState", "active")
    assert mill.machine.property(RELAY, "MainPID") == relay


def test_a_restart_by_hand_never_refuses_a_connection(mill: Mill) -> None:
    before = mill.machine.property(RELAY, "MainPID")
    mill.machine.run("systemctl", "restart", "--no-block", RELAY)
    while mill.machine.property(RELAY, "MainPID") in {"0", before} or (
        mill.machine.property(RELAY, "ActiveState") != "active"
    ):
        socket.create_connection(("127.0.0.1", mill.port), timeout=30).close()  # or ConnectionRefusedError
    mill.machine.until(RELAY, "StatusText", "1 of 1 lines up, 1 axes")
    assert mill.moved(50_000) == 50_050


def test_stopped_it_leaves_nothing_open(mill: Mill) -> None:
    mill.stop()
    assert [mill.machine.property(unit, "Result") for unit in (RELAY, SUPERVISOR)] == ["success"] * 2
    with pytest.raises(ConnectionRefusedError):
        mill.master()


@pytest.mark.timeout(180)
def test_what_a_configuration_needs_more_it_gets(mill: Mill) -> None:
    """On port 1023, with a real-time priority and locked memory, and behind an allow list of addresses."""
    mill.stop()
    machine = mill.machine
    config = one_axis(drives=mill.drives_at, port=1023)
    needs = 'name = "trial"\nstate = "/var/lib/pitch-gateway"\n\n[relay]\nfifo = 10\nlock_memory = true'
    machine.write("/etc/pitch-gateway/gateway.toml", config.replace('name = "trial"', needs))
    command = [f"{INSTALLED}/bin/pitch-gateway", "service", "/etc/pitch-gateway/gateway.toml"]
    assert "written" in machine.run(*command, "--systemd", "/etc/systemd/system")
    if not may_raise_limits():
        machine.write(f"/etc/systemd/system/{RELAY}.d/instead.conf", INSTEAD_OF_LIMITS)
    machine.run("systemctl", "daemon-reload")
    assert set(machine.property(RELAY, "IPAddressAllow").split()) == {"127.0.0.0/8", "::1/128"}
    machine.run("systemctl", "start", RELAY)
    machine.until(RELAY, "StatusText", "1 of 1 lines up, 1 axes")
    low = Master(1023, mill.drive)
    assert low.move(50_000) == 50_050
    low.close()
    log = machine.log(RELAY)
    assert '"fifo": 10, ' in log
    assert '"memory_locked": true' in log
    assert "scheduling-refused" not in log
    machine.run("systemctl", "stop", RELAY)


@pytest.mark.timeout(180)
def test_a_serial_line_goes_on_over_a_restart_and_no_other_device_is_opened(mill: Mill) -> None:
    """With a pseudo terminal as the port: systemd always allows those, so the other device is no terminal."""
    mill.stop()
    machine = mill.machine
    machine.run("mknod", "--mode=0666", "/srv/fuse", "c", "10", "229")
    opens = "exec 3< /srv/fuse && echo it was opened"
    assert machine.run(
        "setpriv", "--reuid=pitch-gateway", "--clear-groups", "sh", "-c", f"cd /; {opens}"
    ).endswith("it was opened")
    tries = f"[Service]\nExecStartPre=-/bin/sh -c '{opens}'\n"
    machine.run("rm", "--force", "--recursive", f"/etc/systemd/system/{RELAY}.d")
    machine.run("mkdir", f"/etc/systemd/system/{RELAY}.d")
    machine.write(f"/etc/systemd/system/{RELAY}.d/tries.conf", tries)
    machine.run("systemctl", "daemon-reload")
    wire, far_end = os.openpty()
    with (
        contextlib.closing(os.fdopen(wire, "r+b", buffering=0)),
        contextlib.closing(os.fdopen(far_end, "rb")),
    ):
        tty.setraw(far_end)
        device = Path(os.ttyname(far_end))
        device.chmod(0o666)
        text = one_axis(drives=mill.drives_at, port=mill.port)
        text = text.replace('name = "trial"', 'name = "trial"\nstate = "/var/lib/pitch-gateway"')
        serial = f'drives = {{ rtu = "{device}", baudrate = 115200 }}'
        machine.write(
            "/etc/pitch-gateway/gateway.toml",
            text.replace(f'drives = {{ tcp = "127.0.0.1:{mill.drives_at}" }}', serial),
        )
        machine.run("systemctl", "start", RELAY)
        for _ in range(2):
            machine.until(RELAY, "StatusText", "1 of 1 lines up, 1 axes")
            assert moved_on_wire(mill.port, wire) == encode_rtu(1, MOVE)
            machine.run("systemctl", "restart", RELAY)
        assert machine.property(RELAY, "NFileDescriptorStore") == "2"
        machine.run("systemctl", "stop", RELAY)
    log = machine.log(RELAY)
    assert "/srv/fuse: Operation not permitted" in log
    assert "it was opened" not in log
