"""``run``: it looks after both processes, hears signals, and ends with its relay."""

import fcntl
import os
import pty
import signal
import subprocess
import sys
import time

import pytest

from gateway.ipc.client import ask
from gateway.ipc.messages import Ping, Pong
from tests.support.commands import typed
from tests.support.config import STEEPER
from tests.support.gateway import Site, gateway_of, relay_of
from tests.support.processes import (
    COMMAND,
    ROOT,
    SECONDS,
    Running,
    children,
    is_alive,
    started,
    wait_until_dead,
)


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
            assert (
                ended["detail"] == f"the relay goes on; the supervisor is restarted in {0.2 * 2**round_:g} s"
            )
            gateway.until("supervisor-started")
            gateway.until("relay-reached")
        again = children(gateway.process)
        assert again["gateway.relay"] == first["gateway.relay"]
        assert again["gateway.supervisor"] != first["gateway.supervisor"]
        assert len(site.drive.told) == 600


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
        assert gateway.process.wait(SECONDS) == -signal.SIGKILL
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


# SIGHUP, as a terminal sends it that is closed: tables are read anew, and no axis stops for it.


def test_a_relay_goes_on_with_its_exchange_after_a_hangup_and_says_so_once(site: Site) -> None:
    site.compile()
    with relay_of(site) as (relay, master):
        assert master.move(50_000) == 50_050
        site.drive.is_silent = True
        master.send(60_000)
        latest_s = time.monotonic() + SECONDS
        while len(site.drive.told) < 2:  # then it is on the wire
            assert time.monotonic() < latest_s
        relay.process.send_signal(signal.SIGHUP)
        assert relay.until("hangup-ignored")["detail"] == (
            "SIGHUP changes nothing here: the supervisor reads the tables anew, and SIGTERM stops"
        )
        assert master.is_answered_with_an_exception()  # the drive said nothing, and the relay was there
        site.drive.is_silent = False
        assert master.move(50_001) == 50_051
        pong = ask(site.socket, Ping())
        assert isinstance(pong, Pong)
        assert pong.pid == relay.process.pid
    events = [note["event"] for note in relay.notes]
    assert events.count("hangup-ignored") == 1
    assert not site.socket.exists()


def test_run_passes_a_hangup_on_as_a_reload_and_moves_go_on(site: Site) -> None:
    with gateway_of(site) as (gateway, master):
        before = children(gateway.process)
        assert master.move(50_000) == 50_050
        site.table.write_text(STEEPER)
        gateway.process.send_signal(signal.SIGHUP)
        assert gateway.until("table-handed-over")["comes"] == "next-target"
        assert master.move(50_001) == 50_101
        assert children(gateway.process) == before


def test_a_hangup_right_at_the_start_or_between_two_supervisors_ends_nobody(site: Site) -> None:
    with gateway_of(site) as (gateway, master):
        os.kill(children(gateway.process)["gateway.supervisor"], signal.SIGKILL)
        gateway.until("supervisor-ended")
        for _ in range(3):
            gateway.process.send_signal(signal.SIGHUP)
        gateway.until("supervisor-started")
        gateway.process.send_signal(signal.SIGHUP)  # before it has said what a hangup means
        gateway.until("relay-reached")
        assert master.move(50_000) == 50_050
    assert [note["event"] for note in gateway.notes].count("supervisor-ended") == 1


def test_a_terminal_that_is_closed_does_not_stop_the_gateway(site: Site) -> None:
    ours, theirs = pty.openpty()
    # In a session of its own, with the terminal as its controlling one, as a shell would be.
    command = ["setsid", "--ctty", *COMMAND, "run", str(site.config), "--log-format", "json"]
    with started(command, cwd=ROOT, stdin=theirs, stdout=theirs, stderr=theirs) as process:
        os.close(theirs)
        try:
            log = b""
            while not (b'"line-up"' in log and b'"relay-reached"' in log):
                log += os.read(ours, 4096)
            master = site.master()
            pids = children(process)
            assert master.move(50_000) == 50_050
        finally:
            os.close(ours)
        assert master.move(50_001) == 50_051
        assert typed("reload", str(site.config)).returncode == 0
        assert children(process) == pids
        master.close()
        process.send_signal(signal.SIGTERM)
        assert process.wait(SECONDS) == 0
    assert not site.socket.exists()


# A file system that never answers: the supervisor can be stopped all the same.


def test_a_supervisor_whose_thread_hangs_ends_when_it_is_told_to(site: Site) -> None:
    site.compile()
    # Whoever writes into the state waits for this lock: a call that does not return, as of a dead server.
    lock = os.open(site.config.parent / "state" / "tables", os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        command = [sys.executable, "-P", "-m", "gateway.supervisor", str(site.config), "--log-format", "json"]
        with started(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
            gateway = Running(process)
            gateway.until("supervising")
            _wait_until_locked_out(process.pid)
            process.terminate()
            assert process.wait(SECONDS) == 0
    finally:
        os.close(lock)


def _wait_until_locked_out(pid: int) -> None:
    """Wait until a thread of a process waits for a lock of a file."""
    while True:
        with open("/proc/locks") as file:  # noqa: PTH123 - it has no size
            waiting = [line.split() for line in file if " -> " in line]
        if any(int(words[5]) == pid for words in waiting):
            return
