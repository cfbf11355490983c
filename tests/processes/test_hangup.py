"""SIGHUP, as a terminal sends it that is closed: tables are read anew, and no axis stops for it."""

import os
import pty
import signal
import time

from gateway.ipc.client import ask
from gateway.ipc.messages import Ping, Pong
from tests.support.commands import typed
from tests.support.config import STEEPER
from tests.support.gateway import Site, gateway_of
from tests.support.processes import COMMAND, ROOT, SECONDS, children, running, started


def test_a_relay_goes_on_with_its_exchange_after_a_hangup_and_says_so_once(site: Site) -> None:
    assert typed("check", "--compile", str(site.config)).returncode == 0
    with running("relay", str(site.config)) as relay:
        relay.until("line-up")
        master = site.master()
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
        master.close()
        assert relay.end() == 0
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
        assert gateway.end() == 0


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
        assert gateway.end() == 0
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
