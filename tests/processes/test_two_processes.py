"""Relay and supervisor as real programs: each lives without the other, and ``run`` looks after both."""

import contextlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gateway.ipc.client import ask
from gateway.ipc.messages import Ping, Pong
from gateway.ipc.place import socket_path
from gateway.modbus.mbap import encode_mbap
from tests.child import started

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-c", "from gateway.cli.main import main; main()"]
SECONDS = 30.0
CONFIG = """
[gateway]
name = "trial"

[line.xyz]
drives = {{ tcp = "127.0.0.1:{drives}" }}

[[line.xyz.controllers]]
name = "cnc"
tcp = "127.0.0.1:{port}"

[axis.x]
line = "xyz"
unit_id = 1
units = "mm"
counts_per_unit = 1000.0
travel = [0.0, 100.0]
referenced = "absolute"
table = "x.tab"
registers.command = [{{ address = 100, type = "int32" }}]
"""
TABLE = """CNC10 TAB FILE VERSION 3
AXIS X
UNITS MILLIMETER
INTERVAL 50.0
ENTRIES 3
0.0 0.0 0.0
50.0 0.05 0.05
100.0 0.1 0.1
"""
STEEPER = TABLE.replace("0.1 0.1", "0.2 0.2").replace("0.05 0.05", "0.1 0.1")


def typed(*arguments: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [*COMMAND, *arguments], capture_output=True, text=True, timeout=SECONDS, check=False, cwd=ROOT
    )


class Drive:
    """Acknowledges FC16; keeps what it was told, in counts."""

    def __init__(self, listening: socket.socket) -> None:
        self.told: list[int] = []
        self._listening = listening
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._listening.accept()
            except OSError:
                return
            with connection, contextlib.suppress(OSError):
                while data := connection.recv(300):
                    self.told.append(int.from_bytes(data[13:17], "big", signed=True))
                    connection.sendall(data[:4] + bytes((0, 6)) + data[6:12])


class Master:
    """Commands positions, and sees every answer."""

    def __init__(self, port: int, drive: Drive) -> None:
        self._connection = socket.create_connection(("127.0.0.1", port), timeout=SECONDS)
        self._drive = drive
        self._number = 0

    def move(self, counts: int) -> int:
        """Command a position; returns what the drive was told."""
        self._number = self._number % 60_000 + 1
        pdu = bytes.fromhex("10 0064 0002 04") + counts.to_bytes(4, "big")
        self._connection.sendall(encode_mbap(self._number, 1, pdu))
        assert self._connection.recv(300) == encode_mbap(self._number, 1, pdu[:5])
        return self._drive.told[-1]

    def close(self) -> None:
        self._connection.close()


class Site:
    """A configuration with a drive behind it."""

    def __init__(self, folder: Path, drives: int, port: int, drive: Drive) -> None:
        self.config = folder / "gateway.toml"
        self.config.write_text(CONFIG.format(drives=drives, port=port))
        self.table = folder / "tables" / "x.tab"
        self.table.parent.mkdir()
        self.table.write_text(TABLE)
        self.socket = socket_path(folder / "state")
        self.port = port
        self.drive = drive

    def master(self) -> Master:
        return Master(self.port, self.drive)


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield Site(tmp_path, listening.getsockname()[1], port, Drive(listening))


class Running:
    """A program of ours with its log."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self.process = process
        self.notes: list[dict[str, Any]] = []

    def until(self, name: str, **fields: object) -> dict[str, Any]:
        """Read the log up to an event."""
        assert self.process.stderr is not None
        for line in self.process.stderr:
            note: dict[str, Any] = json.loads(line)
            self.notes.append(note)
            if note["event"] == name and all(note.get(key) == value for key, value in fields.items()):
                return note
        raise AssertionError(f"the log ended without {name}: {self.notes}")

    def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        self.rest()
        return self.process.wait(SECONDS)

    def rest(self) -> list[dict[str, Any]]:
        """Read the log to its end: every program that writes into it has ended then."""
        assert self.process.stderr is not None
        rest = [json.loads(line) for line in self.process.stderr]
        self.notes += rest
        return rest


@contextlib.contextmanager
def running(*arguments: str) -> Iterator[Running]:
    command = [*COMMAND, *arguments, "--log-format", "json"]
    with started(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
        yield Running(process)
        process.kill()


def children(process: "subprocess.Popen[str]") -> dict[str, int]:
    """Return the programs that a process has started, by module."""
    found = {}
    for pid in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split():
        words = Path(f"/proc/{pid}/cmdline").read_text().split("\0")
        found[words[words.index("-m") + 1]] = int(pid)
    return found


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return False


def wait_until_dead(pid: int) -> None:
    """Wait for the end of a process that is not ours to wait for."""
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return
    try:
        ready, _, _ = select.select([descriptor], [], [], SECONDS)
        assert ready, f"{pid} still runs"
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def gateway_of(site: Site) -> Iterator[tuple[Running, Master]]:
    """``run`` with both processes, which have found each other."""
    with running("run", str(site.config)) as gateway:
        seen: set[str] = set()
        while not {"line-up", "relay-reached"} <= seen:
            seen.add(_next(gateway))
        master = site.master()
        try:
            yield gateway, master
        finally:
            master.close()


def _next(gateway: Running) -> str:
    assert gateway.process.stderr is not None
    line = gateway.process.stderr.readline()
    assert line, f"the log ended: {gateway.notes}"
    gateway.notes.append(json.loads(line))
    return str(gateway.notes[-1]["event"])


# --- run ---------------------------------------------------------------------------------------------------


def test_a_supervisor_that_is_killed_costs_no_exchange_and_is_started_again(site: Site) -> None:
    with gateway_of(site) as (gateway, master):
        first = children(gateway.process)
        for round_ in range(2):
            os.kill(children(gateway.process)["gateway.supervisor"], signal.SIGKILL)
            for number in range(300):
                # 0.1 % of the position: 50 000 becomes 50 050.
                assert master.move(50_000 + 1000 * (number % 2)) == 50_050 + 1001 * (number % 2)
            ended = gateway.until("supervisor-ended")
            assert ended["status"] == "SIGKILL"
            assert ended["detail"] == f"the relay goes on; it is started again in {0.2 * 2**round_:g} s"
            gateway.until("supervisor-started")
            gateway.until("relay-reached")
        again = children(gateway.process)
        assert again["gateway.relay"] == first["gateway.relay"]
        assert again["gateway.supervisor"] != first["gateway.supervisor"]
        assert len(site.drive.told) == 600
        assert gateway.end() == 0


def test_a_supervisor_that_hangs_costs_no_exchange(site: Site) -> None:
    with gateway_of(site) as (gateway, master):
        supervisor = children(gateway.process)["gateway.supervisor"]
        os.kill(supervisor, signal.SIGSTOP)
        for number in range(2000):
            assert master.move(50_000 + 1000 * (number % 2)) == 50_050 + 1001 * (number % 2)
        assert typed("disable", str(site.config)).returncode == 0  # and commands get through
        os.kill(supervisor, signal.SIGCONT)
        assert master.move(60_000) == 60_000
        assert len(site.drive.told) == 2001
        assert gateway.end() == 0


def test_a_hung_supervisor_does_not_keep_the_gateway_from_stopping(site: Site) -> None:
    with gateway_of(site) as (gateway, _):
        supervisor = children(gateway.process)["gateway.supervisor"]
        os.kill(supervisor, signal.SIGSTOP)
        assert gateway.end() == 0
        assert not is_alive(supervisor)


def test_without_its_relay_the_gateway_ends_with_an_error_and_leaves_nobody(site: Site) -> None:
    with gateway_of(site) as (gateway, _):
        pids = children(gateway.process)
        os.kill(pids["gateway.relay"], signal.SIGKILL)
        assert gateway.until("relay-ended")["status"] == "SIGKILL"
        gateway.rest()
        assert gateway.process.wait(SECONDS) == 1
        assert not any(map(is_alive, pids.values()))


def test_a_gateway_that_is_killed_leaves_nobody(site: Site) -> None:
    with gateway_of(site) as (gateway, _):
        pids = children(gateway.process)
        gateway.process.kill()
        for pid in pids.values():
            wait_until_dead(pid)
        # The relay stopped as it does on SIGTERM: its socket is gone.
        gateway.rest()
        assert gateway.notes[-1]["event"] == "stopped"
        assert not site.socket.exists()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_stop_stops_both(site: Site, number: signal.Signals) -> None:
    with gateway_of(site) as (gateway, _):
        pids = children(gateway.process)
        assert set(pids) == {"gateway.relay", "gateway.supervisor"}
        assert gateway.end(number) == 0
        assert not any(map(is_alive, pids.values()))
        assert [note["event"] for note in gateway.notes].count("stopped") == 1
        assert not {"relay-ended", "supervisor-ended"} & {note["event"] for note in gateway.notes}


# --- the two services --------------------------------------------------------------------------------------


def test_the_relay_runs_alone_and_never_from_an_old_plan(site: Site) -> None:
    config = str(site.config)
    nothing = typed("relay", config)
    assert nothing.returncode == 1
    assert nothing.stderr == (
        f"{config}: it has not been compiled yet: there is no {site.config.parent}/state/plan.msgpack; "
        f"run: pitch-gateway check --compile {config}\n"
    )
    assert typed("check", "--compile", config).returncode == 0
    with running("relay", config) as relay:
        relay.until("line-up")
        master = site.master()
        assert master.move(50_000) == 50_050
        master.close()
        assert children(relay.process) == {}
        assert relay.end() == 0
    site.config.write_text(site.config.read_text() + "# a remark\n")
    changed = typed("relay", config)
    assert changed.returncode == 1
    assert changed.stderr == (
        f"{config}: {config} has changed since it was compiled; run: pitch-gateway check --compile {config}\n"
    )


def test_each_starts_and_ends_without_the_other(site: Site) -> None:
    config = str(site.config)
    assert typed("check", "--compile", config).returncode == 0
    with running("supervise", config) as supervisor:
        supervisor.until("supervising")
        for _ in range(2):  # the relay comes and goes twice
            with running("relay", config) as relay:
                relay.until("line-up")
                supervisor.until("relay-reached")
                assert isinstance(ask(site.socket, Ping()), Pong)
                assert relay.end() == 0
            supervisor.until("relay-not-reached", detail="the connection was closed")
        with running("relay", config) as relay:
            relay.until("line-up")
            supervisor.until("relay-reached")
            master = site.master()
            assert master.move(50_000) == 50_050
            assert supervisor.end() == 0
            assert master.move(60_000) == 60_060
            with running("supervise", config) as again:
                again.until("relay-reached")
                assert master.move(50_000) == 50_050
            master.close()
            assert relay.end() == 0


def test_a_table_that_changed_is_handed_over_on_a_hangup_signal(site: Site) -> None:
    config = str(site.config)
    assert typed("check", "--compile", config).returncode == 0
    with running("relay", config) as relay, running("supervise", config) as supervisor:
        relay.until("line-up")
        supervisor.until("relay-reached")
        master = site.master()
        assert master.move(50_000) == 50_050
        supervisor.process.send_signal(signal.SIGHUP)
        assert supervisor.until("nothing-to-reload")["detail"] == "all tables are in force already"
        site.table.write_text(TABLE.replace("50.0 0.05 0.05", "50.0 0.9 0.9"))
        supervisor.process.send_signal(signal.SIGHUP)
        refused = supervisor.until("reload-refused")
        assert refused["detail"] == "the tables in force stay"
        # File and line: the second of the three points.
        assert refused["problems"][0].startswith(f"{site.table}:7: ")
        assert master.move(50_001) == 50_051
        site.table.write_text(STEEPER)
        supervisor.process.send_signal(signal.SIGHUP)
        assert supervisor.until("table-handed-over")["comes"] == "next-target"
        assert master.move(50_000) == 50_100
        assert relay.until("table-activated")["table"] == "x.tab"
        master.close()
        relay.process.kill()
    # The last good table is what the relay starts with, although nothing was compiled by hand.
    with running("relay", config) as relay:
        relay.until("line-up")
        master = site.master()
        assert master.move(50_000) == 50_100
        master.close()


# --- reload ------------------------------------------------------------------------------------------------


def test_reload_hands_over_what_changed_and_says_what_is_wrong(site: Site) -> None:
    config = str(site.config)
    with gateway_of(site) as (gateway, master):
        assert master.move(50_000) == 50_050
        same = typed("reload", config)
        assert (same.returncode, same.stdout) == (0, "nothing to change: all tables are in force already\n")
        site.table.write_text(STEEPER)
        new = typed("reload", config)
        assert (new.returncode, new.stderr) == (0, "")
        assert new.stdout == "x: its new table comes into force with the next different target\n"
        assert master.move(50_001) == 50_101
        text = site.config.read_text()
        site.config.write_text(text.replace('table = "x.tab"', ""))
        gone = typed("reload", config)
        assert (gone.returncode, gone.stderr) == (0, "")
        assert gone.stdout == (
            "x: it has no table any more; the old correction goes with the next different target\n"
        )
        assert master.move(50_000) == 50_000
        site.config.write_text(text)
        assert typed("reload", config).returncode == 0
        assert master.move(50_001) == 50_101
        site.table.write_text("no table")
        bad = typed("reload", config, "--json")
        assert bad.returncode == 1
        assert bad.stderr.startswith(f"{site.table}")
        result = json.loads(bad.stdout)
        assert (result["changed"], result["running"]) == ([], True)
        assert result["problems"] == bad.stderr.splitlines()
        assert master.move(50_000) == 50_100
        site.table.write_text(TABLE)
        site.config.write_text(site.config.read_text().replace("= 1000.0", "= 2000.0"))
        other = typed("reload", config)
        assert other.returncode == 1
        assert other.stderr == (
            f"{config}: it has changed in more than its tables since the gateway was started, and only "
            "tables are taken while it runs; restart the gateway\n"
        )
        assert master.move(50_001) == 50_101
        assert gateway.end() == 0


def test_without_a_gateway_reload_compiles_for_its_start(site: Site) -> None:
    done = typed("reload", str(site.config))
    assert (done.returncode, done.stdout) == (0, "no gateway runs: the tables are compiled for its start\n")
    assert (site.config.parent / "state" / "plan.msgpack").exists()


# --- versions ----------------------------------------------------------------------------------------------


def test_a_supervisor_says_once_that_the_relay_is_of_another_version(site: Site) -> None:
    site.socket.parent.mkdir()
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(site.socket))
        other.listen()
        with running("supervise", str(site.config)) as supervisor:
            for _ in range(3):
                connection, _ = other.accept()
                with connection:
                    assert b'"subscribe"' in connection.recv(300)
                    connection.sendall(b'{"kind":"subscribed","interval_s":0.2,"version":3}\n')
            said = supervisor.until("relay-not-reached")
            assert said["detail"].startswith("a message of version 3, but this side speaks version 2")
            connection, _ = other.accept()
            with connection:
                connection.recv(300)
            assert supervisor.until("relay-not-reached")["detail"] == "the connection was closed"
            assert supervisor.end() == 0
    assert [note["event"] for note in supervisor.notes].count("relay-not-reached") == 2


def test_a_supervisor_of_another_version_is_refused_and_the_relay_goes_on(site: Site) -> None:
    with gateway_of(site) as (gateway, master):
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(SECONDS)
            connection.connect(str(site.socket))
            connection.sendall(b'{"kind":"subscribe","interval_s":0.2,"version":3}\n')
            assert b"a message of version 3, but this side speaks version 2" in connection.recv(1000)
        refused = gateway.until("socket-refused")
        assert "a message of version 3" in refused["detail"]
        assert master.move(50_000) == 50_050
        assert gateway.end() == 0
