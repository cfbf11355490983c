"""The service over a real relay and a real supervisor; the commands that use its socket."""

import asyncio
import contextlib
import hashlib
import json
import os
import pty
import re
import signal
import socket
import subprocess
import time
import tomllib
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from gateway.ipc.address import SUPERVISOR_SOCKET_NAME
from gateway.ipc.log import LogEntry
from gateway.supervisor.supervisor import Supervisor
from tests.supervisor.http.exposition import samples
from tests.supervisor.http.http_bench import Served, until
from tests.support.commands import typed
from tests.support.config import RAMP, STEEPER
from tests.support.gateway import Site, site_in
from tests.support.processes import COMMAND, ROOT, running, started, typed_apart
from tests.support.status_models import plain


@pytest.fixture
def site(tmp_path: Path) -> Any:
    with site_in(tmp_path) as site:
        site.serve_page()
        yield site


@contextlib.asynccontextmanager
async def supervised(site: Site) -> AsyncIterator[Served]:
    """The supervisor of a site with its HTTP service, in this process."""
    state = site.config.parent / "state"
    notes: list[LogEntry] = []
    supervisor = Supervisor(site.config, state, notes.append)
    service = supervisor._http
    port = int(tomllib.loads(site.config.read_text())["http"]["listen"].rpartition(":")[2])
    served = Served(service, supervisor.broadcast, port, state)
    task = asyncio.create_task(supervisor.run())
    try:
        await until(lambda: service.status.address is not None and served.local.exists())
        yield served
    finally:
        for line in served.lines:
            line.close()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


@contextlib.asynccontextmanager
async def gateway(site: Site) -> AsyncIterator[Served]:
    """A relay of its own beside the supervisor; both have found each other, and the table is in force."""
    assert typed("check", "--compile", str(site.config)).returncode == 0
    with running("relay", str(site.config)) as relay:
        await asyncio.to_thread(relay.until, "line-up")
        async with supervised(site) as served:
            await until(lambda: _table(served).get("status") == "active" and _line(served) == "up")
            yield served
        await asyncio.to_thread(relay.end)


def _table(served: Served) -> dict[str, Any]:
    model = served.broadcast.model
    table: dict[str, Any] = {} if model is None or "x" not in model.axes else plain(model.axes["x"].table)
    return table


def _latency(served: Served) -> dict[str, Any]:
    assert served.broadcast.model is not None
    took_us: dict[str, Any] = plain(served.broadcast.model.axes["x"].latency.gateway_us)
    return took_us


def _line(served: Served) -> str:
    assert served.broadcast.model is not None
    return str(served.broadcast.model.lines["xyz"].state)


PARTS = {"gateway", "lines", "axes", "supervisor", "verdict", "troubles"}


async def said(*arguments: str) -> "subprocess.CompletedProcess[str]":
    return await asyncio.to_thread(typed_apart, *arguments)


async def test_what_a_real_relay_does_is_served(site: Site) -> None:
    text = site.config.read_text()  # how long a busy machine takes is no question here
    site.config.write_text(text.replace("[axis.x]", "[axis.x]\nbudget_us = 1000000"))
    async with gateway(site) as served:
        master = site.master()
        assert master.move(50_000) == 50_050
        await until(lambda: bool(served.broadcast.model) and _exchanges(served) == 1)
        # Histograms are worked out a few at each look.
        await until(lambda: "below" in _latency(served))
        status = (await served.ask("/status")).data
        assert status["axes"]["x"]["nominal_setpoint"] == 50.0
        assert status["axes"]["x"]["table"]["status"] == "active"
        assert (await served.ask("/healthz")).body == b"ok\n"
        curve = (await served.ask("/tables/x")).data
        assert (curve["positions"], curve["forward"]) == ([0.0, 50.0, 100.0], [0.0, 0.05, 0.1])
        assert curve["digest"] == status["axes"]["x"]["table"]["compiled"]
        assert (await served.ask("/tables/x.svg")).status == 200
        found = samples(status)
        assert found["pitch_gateway_line_exchanges_total", (("line", "xyz"),)] == 1
        bounds = {
            dict(labels)["le"]
            for name, labels in found
            if name == "pitch_gateway_axis_latency_seconds_bucket"
        }
        # The relay's own: 5 µs to 100 ms.
        assert {"5e-06", "0.001", "0.1", "+Inf"} <= bounds
        assert len(bounds) == 15
        master.close()


def _exchanges(served: Served) -> int:
    assert served.broadcast.model is not None
    return int(served.broadcast.model.lines["xyz"].exchanges)


async def test_a_rejected_table_is_told_to_every_reader_and_to_the_commands(site: Site) -> None:
    config = str(site.config)
    async with gateway(site) as served:
        well = await said("status", config)
        assert (well.returncode, well.stderr) == (0, "")
        # No controller has asked yet: nothing is wrong, and nothing is healthy.
        first, _, gateway_line, *_ = well.stdout.splitlines()
        assert first.startswith("WAITING since ")
        assert gateway_line.startswith("gateway trial ")
        reader = await served.says("GET /events?events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        site.table.write_text("no table")
        reloaded = await said("reload", config, "--json")
        assert reloaded.returncode == 1
        problem = json.loads(reloaded.stdout)["problems"][0]
        assert problem.startswith(str(site.table))
        await reader.until(b"table-rejected")
        ill = await said("status", config)
        assert ill.returncode == 0
        assert ill.stdout.startswith("ERROR since ")
        assert f"erroraxisx:{site.table}:1:" in "".join(ill.stdout.split())
        assert (await served.ask("/healthz")).status == 200  # positions pass, corrected as before
        kinds = {one["kind"] for one in (await served.ask("/status")).data["troubles"]}
        # On a busy machine it is long enough that no controller came to be a trouble of its own.
        assert kinds - {"controller-absent"} == {"table-rejected"}
        site.table.write_text(STEEPER)
        mended = await said("reload", config)
        assert (mended.returncode, mended.stderr) == (0, "")
        # The supervisor watches the file too, and may have been quicker.
        comes = "x: its new correction is applied at the next different target\n"
        assert mended.stdout in {comes, "nothing has changed\n"}
        await reader.until(b"table-mended")
        steeper = hashlib.sha256(STEEPER.encode()).hexdigest()
        await until(lambda: (_table(served)["status"], _table(served)["sha256"]) == ("active", steeper))
        assert (await served.ask("/tables/x")).data["forward"] == [0.0, 0.1, 0.2]
        site.table.write_text(RAMP)
        as_json = await said("status", config, "--json")
        assert set(json.loads(as_json.stdout)) == PARTS


async def test_the_status_of_a_supervisor_without_a_relay(site: Site) -> None:
    async with supervised(site) as served:
        await until(lambda: served.broadcast.model is not None)
        alone = await said("status", str(site.config))
        assert alone.returncode == 1
        first, second, *_ = alone.stdout.splitlines()
        assert re.fullmatch(r"ERROR since [0-9:]{8}: 1 error", first)
        assert second == "error gateway: the relay is not running: no command reaches a drive"
        assert (await served.ask("/healthz")).status == 503


def test_the_status_comes_from_the_relay_where_the_supervisor_is_hung(site: Site) -> None:
    assert typed("check", "--compile", str(site.config)).returncode == 0
    with running("relay", str(site.config)) as relay, socket.socket(socket.AF_UNIX) as deaf:
        relay.until("line-up")
        deaf.bind(str(site.config.parent / "state" / SUPERVISOR_SOCKET_NAME))
        deaf.listen()
        status = typed("status", str(site.config), "--json")
        assert status.returncode == 0
        found = json.loads(status.stdout)
        assert set(found) == PARTS
        assert [(each["kind"], each["axes"]) for each in found["troubles"]] == [("supervisor-down", ["x"])]
        assert (found["verdict"]["state"], found["axes"]["x"]["verdict"]["state"]) == ("warning", "warning")
        relay.end()


def test_without_a_supervisor_the_silence_of_a_controller_is_judged_as_the_file_says(site: Site) -> None:
    key = "[[line.xyz.controllers]]\n"
    text = site.config.read_text()
    assert text.count(key) == 1
    site.config.write_text(text.replace(key, f"{key}silent_after_s = 0.001\n"))
    assert typed("check", "--compile", str(site.config)).returncode == 0
    with running("relay", str(site.config)) as relay:
        relay.until("line-up")
        found = json.loads(typed("status", str(site.config), "--json").stdout)
        controller = found["lines"]["xyz"]["controllers"][0]
        assert controller["silent_after_s"] == 0.001
        assert {each["kind"] for each in found["troubles"]} == {"supervisor-down", "controller-absent"}
        relay.end()


async def test_watching_over_a_pipe_is_a_line_for_each_change(site: Site) -> None:
    async with gateway(site) as served:
        command = [*COMMAND, "status", str(site.config), "--watch", "--json"]
        with started(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as watching:
            assert watching.stdout is not None
            first = json.loads(await asyncio.to_thread(watching.stdout.readline))
            assert first["axes"]["x"]["compensation"] == "active"
            assert (await said("disable", str(site.config))).returncode == 0
            while True:
                changed = json.loads(await asyncio.to_thread(watching.stdout.readline))
                if changed["axes"]["x"]["compensation"] == "off":
                    break
            assert changed["troubles"][0]["kind"] == "off"
            watching.send_signal(signal.SIGINT)
            assert await asyncio.to_thread(watching.wait, 30) == 0
        assert served.broadcast.model is not None


async def test_watching_on_a_terminal_is_drawn_in_place_until_ctrl_c(site: Site) -> None:
    async with gateway(site):
        ours, theirs = pty.openpty()
        command = [*COMMAND, "status", str(site.config), "--watch"]
        environment = {**os.environ, "TERM": "xterm", "COLUMNS": "120", "LINES": "60"}
        with started(
            command, cwd=ROOT, stdin=theirs, stdout=theirs, stderr=theirs, env=environment
        ) as watching:
            os.close(theirs)
            seen = b""
            deadline_s = time.monotonic() + 30
            while seen.count(b"Ctrl-C ends it") < 3 and time.monotonic() < deadline_s:
                seen += await asyncio.to_thread(os.read, ours, 65536)
            assert seen.count(b"gateway trial") >= 3
            assert b"\x1b[?1049h" not in seen  # what was on the screen stays
            watching.send_signal(signal.SIGINT)
            with contextlib.suppress(OSError):  # the terminal of a program that has ended
                while await asyncio.to_thread(os.read, ours, 65536):
                    pass
            assert await asyncio.to_thread(watching.wait, 30) == 0
        os.close(ours)


def test_watching_needs_a_gateway_to_begin_with(site: Site) -> None:
    none = typed("status", str(site.config), "--watch")
    assert (none.returncode, none.stdout) == (1, "")
    assert "no gateway runs" in none.stderr
