"""A state folder on a full disk: the relay notices nothing of it, the status says it, and it passes."""

import json
import os
import signal
import subprocess
import urllib.request
from pathlib import Path
from typing import Any

import pytest

from tests.support.config import RAMP
from tests.support.gateway import Site
from tests.support.processes import COMMAND, ROOT, SECONDS, Running, eventually, started

DISK_BYTES = 200 * 1024
POINTS = 20_001
"""480 KB compiled: more than the disk has."""


def large(points: int) -> str:
    """Return a table of many points that corrects as the small one does."""
    step = 100 / (points - 1)
    rows = "\n".join(f"{n * step:.4f} {n * step / 1000:.7f} {n * step / 1000:.7f}" for n in range(points))
    head = f"CNC10 TAB FILE VERSION 3\nAXIS X\nUNITS MILLIMETER\nINTERVAL {step:.4f}\nENTRIES {points}\n"
    return f"{head}{rows}\n"


def small_disk(folder: Path) -> list[str]:
    """Return what starts a program that sees a small disk in the place of a folder, and only it."""
    who = [] if os.geteuid() == 0 else ["--map-root-user"]
    mount = f"mount -t tmpfs -o size={DISK_BYTES},mode=0700 tmpfs '{folder}' && exec \"$@\""
    return ["unshare", *who, "--mount", "sh", "-c", mount, "sh"]


def may_mount(folder: Path) -> bool:
    done = subprocess.run([*small_disk(folder), "true"], capture_output=True, check=False)
    return done.returncode == 0


class Status:
    """The status over HTTP: the socket in the state folder is behind the mount."""

    def __init__(self, address: str) -> None:
        self._url = f"{address}/status"

    def until(self, problem: str | None, of: str = "tables_folder") -> dict[str, Any]:
        """Look until the tables, or something else, have this problem, or none."""

        def look() -> dict[str, Any]:
            with urllib.request.urlopen(self._url, timeout=SECONDS) as answer:
                model: dict[str, Any] = json.load(answer)
            return model

        def is_so(model: dict[str, Any]) -> bool:
            found = model["supervisor"][of]["problem"]
            return bool(found == problem or (problem and found and problem in found))

        return eventually(look, is_so)


def test_a_full_disk_costs_no_move_is_told_and_is_overcome(site: Site) -> None:
    state = site.config.parent / "state"
    state.mkdir(mode=0o700)
    if not may_mount(state):
        pytest.skip("this system does not let a test mount a disk of its own")
    address = site.serve_page()
    command = [*small_disk(state), *COMMAND, "run", str(site.config), "--log-format", "json"]
    with started(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
        gateway = Running(process)
        gateway.until_each("line-up", "relay-reached", "http-ready")
        master, status = site.master(), Status(address)
        assert master.move(50_000) == 50_050
        site.table.write_text(large(POINTS))
        refused = gateway.until("reload-refused")
        assert "No space left on device" in refused["problems"][0]
        model = status.until("No space left on device")
        assert model["axes"]["x"]["table"]["points"] == 3
        assert model["axes"]["x"]["table"]["status"] == "waiting"
        assert "tables folder" in [trouble["where"] for trouble in model["troubles"]]
        assert master.move(50_001) == 50_051
        gateway.process.send_signal(signal.SIGHUP)  # a reload that finds the disk full is tried again too
        gateway.until("reload-refused")
        site.table.write_text(RAMP.replace("0.05 0.05", "0.06 0.06"))
        gateway.until("table-handed-over")
        status.until(None)
        status.until(None, of="configuration")
        assert master.move(50_000) == 50_060
        master.close()
        assert gateway.end() == 0
