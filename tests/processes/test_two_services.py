"""Relay and supervisor as two services: each lives without the other, also when it is of another version."""

import contextlib
import signal
import socket
import subprocess

import msgspec

from gateway.cli.configuration import compile_for_start_or_exit
from gateway.cli.processes import command_of
from gateway.ipc.client import ask
from gateway.ipc.log import LogFormat
from gateway.ipc.messages import Ping, Pong
from gateway.ipc.supervisor_client import ask_supervisor
from gateway.state.folder import PLAN_NAME
from gateway.state.plan import VERSION, sealed, unsealed
from tests.support.commands import typed
from tests.support.config import RAMP, STEEPER
from tests.support.gateway import Master, Site, gateway_of, relay_of
from tests.support.processes import (
    ROOT,
    SECONDS,
    Running,
    children,
    eventually,
    running,
    started,
    typed_apart,
)


def test_the_relay_runs_alone_and_never_from_an_old_plan(site: Site) -> None:
    config = str(site.config)
    nothing = typed_apart("relay", config, "--log-format", "console")
    assert nothing.returncode == 1
    assert nothing.stderr == (
        f"{config}: it has not been compiled yet: there is no {site.config.parent}/state/plan.msgpack; "
        f"run: pitch-gateway check --compile {config}\n"
    )
    site.compile()
    with relay_of(site) as (relay, master):
        assert master.move(50_000) == 50_050
        assert children(relay.process) == {}
    site.config.write_text(site.config.read_text() + "# a remark\n")
    changed = typed_apart("relay", config, "--log-format", "console")
    assert changed.returncode == 1
    assert changed.stderr == (
        f"{config}: {config} has changed since it was compiled; run: pitch-gateway check --compile {config}\n"
    )


def test_a_configuration_that_is_edited_while_run_starts_its_programs_ends_neither(site: Site) -> None:
    """``run`` has compiled what it read; its two programs start from that, whatever the file says by then."""
    _, state, _ = compile_for_start_or_exit(site.config)
    compiled_into = "--state", str(state)
    site.config.write_text("[gateway\n")  # as a text editor leaves it for a moment
    relay_command = command_of("gateway.relay", site.config, LogFormat.JSON, *compiled_into)
    supervisor_command = command_of("gateway.supervisor", site.config, LogFormat.JSON, *compiled_into)
    with started(relay_command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
        relay = Running(process)
        relay.until("line-up")
        with contextlib.closing(site.master()) as master:
            assert master.move(50_000) == 50_050
        with started(supervisor_command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as other:
            supervisor = Running(other)
            supervisor.until("relay-reached")
            assert supervisor.end() == 0
        assert relay.end() == 0


def test_after_a_bad_table_the_relay_starts_with_the_last_good_one(site: Site) -> None:
    config = str(site.config)
    site.compile()
    site.table.write_text("no table")
    assert typed("check", "--compile", config).returncode == 1
    with relay_of(site) as (_, master):
        assert master.move(50_000) == 50_050


def test_each_starts_and_ends_without_the_other(site: Site) -> None:
    config = str(site.config)
    site.compile()
    with running("supervise", config) as supervisor:
        supervisor.until("supervising")
        for _ in range(2):  # the relay comes and goes twice
            with running("relay", config) as relay:
                relay.until("line-up")
                supervisor.until("relay-reached")
                assert isinstance(ask(site.socket, Ping()), Pong)
                assert relay.end() == 0
            supervisor.until("relay-not-reached", detail="the connection was closed")
        with relay_of(site) as (_, master):
            supervisor.until("relay-reached")
            assert master.move(50_000) == 50_050
            assert supervisor.end() == 0
            assert master.move(60_000) == 60_060
            with running("supervise", config) as again:
                again.until("relay-reached")
                assert master.move(50_000) == 50_050


def test_a_table_that_changed_is_handed_over_on_a_hangup_signal(site: Site) -> None:
    config = str(site.config)
    site.compile()
    with relay_of(site) as (relay, master), running("supervise", config) as supervisor:
        supervisor.until("relay-reached")
        assert master.move(50_000) == 50_050
        supervisor.process.send_signal(signal.SIGHUP)
        assert supervisor.until("nothing-to-reload")["detail"] == "nothing has changed"
        site.table.write_text(RAMP.replace("50.0 0.05 0.05", "50.0 0.9 0.9"))
        supervisor.process.send_signal(signal.SIGHUP)
        rejected = supervisor.until("table-rejected")
        assert rejected["detail"] == "the last good table stays"
        # The second of the three points.
        assert (rejected["axis"], rejected["file"], rejected["line"]) == ("x", str(site.table), 7)
        assert master.move(50_001) == 50_051
        site.table.write_text(STEEPER)
        supervisor.process.send_signal(signal.SIGHUP)
        assert supervisor.until("table-handed-over")["comes"] == "next-target"
        assert master.move(50_000) == 50_100
        assert relay.until("table-activated")["table"] == "x.tab"
        relay.process.kill()
        relay.process.wait(SECONDS)
    # The last good table is what the relay starts with, although nothing was compiled by hand.
    with relay_of(site) as (_, master):
        assert master.move(50_000) == 50_100


def test_whoever_was_told_to_restart_the_relay_and_did_is_told_no_more(site: Site) -> None:
    config = str(site.config)
    site.compile()

    def kinds() -> list[str]:
        status = ask_supervisor(site.socket.parent, "/status")
        return [] if status is None else [trouble["kind"] for trouble in status["troubles"]]

    with running("supervise", config) as supervisor:
        with running("relay", config) as relay:
            supervisor.until("relay-reached")
            assert typed("reload", config).returncode == 0
            site.change("unit_id = 1", "unit_id = 2")
            assert (
                "restart the gateway: these keys changed since its start: axis.x.unit_id"
                in typed("reload", config).stderr
            )
            assert "configuration" in kinds()
            assert relay.end() == 0
        assert "configuration" in kinds()
        site.compile()
        with running("relay", config) as relay:
            supervisor.until("relay-reached")
            eventually(kinds, lambda found: "configuration" not in found)
            assert relay.end() == 0
        assert supervisor.end() == 0


def test_a_configuration_that_was_compiled_for_the_next_start_outlives_a_table_that_is_saved(
    site: Site,
) -> None:
    config = str(site.config)
    site.compile()
    with running("supervise", config) as supervisor:
        with running("relay", config) as relay:
            supervisor.until("relay-reached")
            assert typed("reload", config).stdout == "nothing has changed\n"  # it has read it by now
            site.change("unit_id = 1", "unit_id = 2")
            site.compile()
            site.table.write_text(STEEPER)
            supervisor.until("table-handed-over")
            with contextlib.closing(site.master()) as master:  # of unit 1, which this relay still corrects
                assert master.move(50_000) == 50_100
            assert relay.end() == 0
        with running("relay", config):
            supervisor.until("relay-reached")
            supervisor.until("table-handed-over")
            with contextlib.closing(Master(site.port, site.drive, 2)) as master:
                assert master.move(50_000) == 50_100
        assert supervisor.end() == 0


def answer_the_next_subscriber(relay: socket.socket, answer: bytes) -> None:
    """Give whoever asks this answer, up to one that subscribes, and let each of them read it and go."""
    has_subscribed = False
    while not has_subscribed:  # between them it asks who is there
        connection, _ = relay.accept()
        with connection:
            has_subscribed = b'"subscribe"' in connection.recv(300)
            connection.sendall(answer)
            connection.shutdown(socket.SHUT_WR)
            while connection.recv(300):
                pass


def test_a_supervisor_says_once_that_the_relay_is_of_another_version(site: Site) -> None:
    site.socket.parent.mkdir()
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(site.socket))
        other.listen()
        with running("supervise", str(site.config)) as supervisor:
            for _ in range(3):
                answer_the_next_subscriber(other, b'{"kind":"subscribed","interval_s":0.2,"version":3}\n')
            said = supervisor.until("relay-not-reached")
            assert said["detail"].startswith("a message of version 3, but this side speaks version 2")
            answer_the_next_subscriber(other, b"")
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


def test_a_second_supervisor_on_the_same_folder_is_refused(site: Site) -> None:
    config = str(site.config)
    refusal = (
        f"{config}: gateway.state: {site.config.parent}/state/supervisor.lock belongs to a supervisor that "
        "runs: stop it first (run starts its own), or give this one its own folder with "
        "[gateway] state\n"
    )
    with running("supervise", config) as supervisor:
        supervisor.until("supervising")
        second = typed_apart("supervise", config, "--log-format", "console")
        assert (second.returncode, second.stderr) == (1, refusal)
        supervisor.process.kill()  # the lock goes with its process, whatever way that ends
        supervisor.rest()
    with gateway_of(site) as (_, master):
        beside_run = typed_apart("supervise", config, "--log-format", "console")
        assert (beside_run.returncode, beside_run.stderr) == (1, refusal)
        assert master.move(50_000) == 50_050


def test_on_the_state_of_a_newer_release_neither_service_starts(site: Site) -> None:
    config = str(site.config)
    site.compile()
    plan = site.config.parent / "state" / PLAN_NAME
    later = {"version": VERSION + 1, "gateway_version": "999.0.0"}
    plan.write_bytes(
        sealed(msgspec.msgpack.encode(msgspec.msgpack.decode(unsealed(plan.read_bytes())) | later))
    )
    before = {path: path.read_bytes() for path in plan.parent.iterdir() if path.is_file()}
    for command in ("relay", "supervise"):
        ended = typed_apart(command, config, "--log-format", "console")
        assert ended.returncode == 1
        assert "was written by a newer release, 999.0.0" in ended.stderr
    assert {path: path.read_bytes() for path in plan.parent.iterdir() if path.is_file()} == before
