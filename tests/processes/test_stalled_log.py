"""A log that nobody reads: frames pass, signals are heard, and what is lost is counted."""

import contextlib
import fcntl
import itertools
import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gateway.ipc.client import ask
from gateway.ipc.log_thread import CAPACITY
from gateway.ipc.messages import GetStatus, Status
from tests.support.gateway import Master, Site, site_in
from tests.support.processes import COMMAND, ROOT, SECONDS, children, is_alive, started, wait_until_dead

SMALLEST_PIPE = 4096
MOVES = 1500
MANY_NOTES = ("--status-every", "0.0001")
"""Notes of some 400 bytes: the pipe holds ten of them, the gateway a thousand; the rest is dropped."""
UNREAD_S = 3.0
"""Nobody reads for so long: time for many times the notes that the gateway holds, on a busy machine too."""
TOO_FAR = 200_000
"""Twice as far as the axis goes, in counts of 1/1000 mm; behind the end of the table its last 0.1 mm hold."""
WHY_TOO_FAR = (
    "corrected machine position 200.1 leaves the travel 0 to 100 by more than travel_margin = 0.5 mm"
)


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with site_in(tmp_path) as site:
        # However busy the machine is: no events of the budget among those that are counted.
        site.change("[axis.x]", "[axis.x]\nbudget_us = 1000000")
        yield site


class Unread:
    """A program whose log goes into a small pipe, which is read only when the test says so."""

    def __init__(self, process: "subprocess.Popen[bytes]", log_fd: int) -> None:
        self.process = process
        self.log = os.fdopen(log_fd, "rb")
        self.lines: list[bytes] = []

    def until(self, name: str) -> None:
        for line in self.log:
            self.lines.append(line)
            if name.encode() in line:
                return
        raise AssertionError(f"the log ended without {name}: {self.lines}")

    def rest(self) -> list[dict[str, Any]]:
        """End it, read the log to its end, and return all that was read."""
        self.process.send_signal(signal.SIGTERM)
        self.lines += self.log.readlines()
        assert self.process.wait(SECONDS) == 0
        return [json.loads(line) for line in self.lines]


@contextlib.contextmanager
def unread(command: str, site: Site, *options: str) -> Iterator[Unread]:
    log_fd, end_fd = os.pipe()
    fcntl.fcntl(end_fd, fcntl.F_SETPIPE_SZ, SMALLEST_PIPE)
    site.compile()
    program = [*COMMAND, command, str(site.config), "--log-format", "json", *options]
    with started(program, cwd=ROOT, stderr=end_fd) as process:
        os.close(end_fd)
        running = Unread(process, log_fd)
        with running.log:
            yield running
            process.kill()


def is_line_up(site: Site) -> bool:
    reply = ask(site.socket, GetStatus())
    assert isinstance(reply, Status)
    return bool(reply.status.lines["xyz"].state == "up")


def move(master: Master, number: int) -> None:
    """Command one of two positions in turn; 0.1 % of the position is added: 50 000 becomes 50 050."""
    assert master.move(50_000 + 1000 * (number % 2)) == 50_050 + 1001 * (number % 2)


def all_answered(site: Site, count: int = MOVES) -> None:
    """Command positions that pass, each after one that is refused."""
    passed_before = len(site.drive.told)
    with contextlib.closing(site.master()) as master:
        for number in range(count):
            assert master.is_refused(TOO_FAR)
            move(master, number)
    assert len(site.drive.told) - passed_before == count


def turns() -> Iterator[int]:
    """Numbers, as long as nobody reads the log."""
    numbers, until = itertools.count(), time.monotonic() + UNREAD_S
    while time.monotonic() < until:
        yield next(numbers)


def test_nobody_reads_all_frames_pass_and_what_was_dropped_is_counted_in_its_place(site: Site) -> None:
    with unread("relay", site, *MANY_NOTES) as relay:
        relay.until("line-up")
        with contextlib.closing(site.master()) as master:
            for number in turns():
                move(master, number)
        moves = number + 1
        # Only now somebody reads again.
        relay.until("notes-dropped")
        relay.until(f'"exchanges": {moves}')
        notes = relay.rest()
    events = [note["event"] for note in notes]
    assert events[:4] == ["starting", "line", "axis", "ready"]
    assert events[-1] == "stopped"
    following = dropped = 0
    for note in notes[events.index("line-up") + 1 : events.index("stopping")]:
        if note["event"] == "notes-dropped":
            assert note["count"] > 0
            following, dropped = following + note["count"], dropped + note["count"]
        else:
            # Of the axis and of the line in turn: each hole has as many as it says.
            assert (note["event"], "axis" in note) == ("status", following % 2 == 0)
            following += 1
    assert dropped > 0
    assert following > CAPACITY
    times = [note["timestamp"] for note in notes]
    assert times == sorted(times)


def test_a_flood_of_refused_targets_is_a_few_notes(site: Site) -> None:
    with unread("relay", site) as relay:
        relay.until("line-up")
        with contextlib.closing(site.master()) as master:
            begun_s = time.monotonic()
            assert all(master.is_refused(TOO_FAR) for _ in range(500))
            took_s = time.monotonic() - begun_s
        notes = relay.rest()
    told = [note["detail"] for note in notes if note["event"] == "refused-value"]
    assert told[0] == WHY_TOO_FAR
    assert 10 <= len(told) <= 10 * (took_s + 2)  # ten in a second, and in a part of one


def test_status_lines_that_nobody_reads_keep_no_frame(site: Site) -> None:
    with unread("relay", site, *MANY_NOTES) as relay:
        relay.until("line-up")
        with contextlib.closing(site.master()) as master:
            for number in turns():
                assert master.is_refused(TOO_FAR)
                move(master, number)
        moves = number + 1
        relay.until("notes-dropped")
        relay.until(f'"exchanges": {moves}')
        notes = relay.rest()
    assert notes[-1]["event"] == "stopped"
    [*_, line] = [note for note in notes if note["event"] == "status" and "line" in note]
    assert (line["exchanges"], line["refused"]) == (moves, moves)


@pytest.mark.parametrize("log_format", ["json", "console"])
def test_a_stop_does_not_wait_for_a_reader_that_does_not_come_back(site: Site, log_format: str) -> None:
    with unread("relay", site, "--log-format", log_format) as relay:
        relay.until("line-up")
        all_answered(site)
        relay.process.send_signal(signal.SIGTERM)
        assert relay.process.wait(SECONDS) == 0
        rest = relay.log.readlines()
        assert b"refused-value" in b"".join(rest)
        assert b"Fatal" not in b"".join(rest)  # what the interpreter says of a thread that holds a stream
        assert not site.socket.exists()


def test_a_second_signal_ends_at_once_also_when_nobody_reads(site: Site) -> None:
    site.change("[line.xyz]", "[line.xyz]\nresponse_timeout_ms = 3600000")
    with unread("relay", site) as relay:
        relay.until("line-up")
        all_answered(site)
        site.drive.is_silent = True
        with contextlib.closing(site.master()) as master:
            master.send(70_000)
            while site.drive.told[-1] != 70_070:
                assert relay.process.poll() is None
            relay.process.send_signal(signal.SIGTERM)
            while site.port_is_open():
                assert relay.process.poll() is None  # the exchange is on the wire
            relay.process.send_signal(signal.SIGTERM)
            assert relay.process.wait(SECONDS) == 1


@pytest.mark.parametrize("command", ["relay", "run"])
def test_a_reader_that_has_gone_changes_nothing(site: Site, command: str) -> None:
    with unread(command, site) as gateway:
        gateway.until("line-up")
        gateway.log.close()
        all_answered(site)
        gateway.process.send_signal(signal.SIGTERM)
        assert gateway.process.wait(SECONDS) == 0


def test_a_full_disk_changes_nothing(site: Site) -> None:
    site.compile()
    with (
        Path("/dev/full").open("wb") as full,
        started(
            [*COMMAND, "relay", str(site.config), "--log-format", "json"], cwd=ROOT, stderr=full
        ) as relay,
    ):
        while not site.port_is_open() or not is_line_up(site):
            assert relay.poll() is None
        all_answered(site)
        relay.send_signal(signal.SIGTERM)
        assert relay.wait(SECONDS) == 0


def test_run_starts_its_supervisor_again_and_stops_when_nobody_reads(site: Site) -> None:
    with unread("run", site) as gateway:
        gateway.until("relay-reached")
        all_answered(site)
        before = children(gateway.process)
        for _ in range(2):  # what is said of the first would keep the second waiting
            supervisor = children(gateway.process)["gateway.supervisor"]
            os.kill(supervisor, signal.SIGKILL)
            wait_until_dead(supervisor)
            while children(gateway.process).get("gateway.supervisor", supervisor) == supervisor:
                assert gateway.process.poll() is None
        all_answered(site, 100)
        after = children(gateway.process)
        assert after["gateway.relay"] == before["gateway.relay"]
        gateway.process.send_signal(signal.SIGTERM)
        assert gateway.process.wait(SECONDS) == 0
        assert not any(map(is_alive, after.values()))


def test_run_ends_with_its_relay_when_nobody_reads(site: Site) -> None:
    with unread("run", site) as gateway:
        gateway.until("relay-reached")
        all_answered(site)
        pids = children(gateway.process)
        os.kill(pids["gateway.relay"], signal.SIGKILL)
        assert gateway.process.wait(SECONDS) == 1
        assert not any(map(is_alive, pids.values()))


def starts_although(site: Site, log_fd: int, log_format: str) -> None:
    """Start a gateway that has to warn of its table into a log that takes nothing, and move its axis."""
    site.compile()
    site.table.write_text("no table")  # it starts with the last good one, and says so
    command = [*COMMAND, "run", str(site.config), "--log-format", log_format]
    with started(command, cwd=ROOT, stderr=log_fd) as process:
        latest_s = time.monotonic() + SECONDS
        while not site.port_is_open():
            assert process.poll() is None
            assert time.monotonic() < latest_s, "it waits for its log"
        with contextlib.closing(site.master()) as master:
            assert master.move(50_000) == 50_050
        process.send_signal(signal.SIGTERM)
        assert process.wait(SECONDS) == 0


@pytest.mark.parametrize("log_format", ["json", "console"])
def test_a_warning_that_nobody_reads_keeps_no_gateway_from_starting(site: Site, log_format: str) -> None:
    ours, theirs = os.pipe()
    full = b"x" * fcntl.fcntl(theirs, fcntl.F_SETPIPE_SZ, SMALLEST_PIPE)
    assert os.write(theirs, full) == len(full)
    try:
        starts_although(site, theirs, log_format)
    finally:
        os.close(ours)
        os.close(theirs)


@pytest.mark.parametrize("log_format", ["json", "console"])
def test_a_warning_onto_a_full_disk_keeps_no_gateway_from_starting(site: Site, log_format: str) -> None:
    with Path("/dev/full").open("wb") as full:
        starts_although(site, full.fileno(), log_format)
