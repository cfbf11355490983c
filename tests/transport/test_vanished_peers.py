"""A controller that lost its power comes again, and its old connection has the only place."""

import json
import os
import subprocess
import sys
from typing import Any

import pytest

from tests.needs import ROOT


def vanishes(how: str) -> dict[str, Any]:
    """Play it in a network of its own."""
    who = [] if os.geteuid() == 0 else ["--map-root-user"]
    program = ["unshare", *who, "--net", sys.executable, "-m", "tests.transport.vanishing", how]
    done = subprocess.run(program, capture_output=True, text=True, check=False, cwd=ROOT, timeout=60)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("how", ["quiet", "owed"])
def test_a_peer_that_acknowledges_nothing_for_timeout_ms_is_gone(how: str) -> None:
    """``owed``: a reply was sent to it that it never acknowledged, and no probe leaves then."""
    found = vanishes(how)
    assert (found["served"], found["closed"], found["refused"]) == (True, ["VANISHED"], ["TOO_MANY"])
    assert found["reason"] == "broken off"
    assert found["took_s"] < 7.0  # before: 30 s


def test_a_peer_that_has_started_again_resets_what_it_is_asked() -> None:
    found = vanishes("restarted")
    assert (found["served"], found["closed"]) == (True, [])
    assert found["reason"] == "[Errno 104] Connection reset by peer"
    assert found["took_s"] < 3.0


def test_one_that_is_there_and_says_nothing_stays_however_often_its_host_comes_again() -> None:
    found = vanishes("there")
    assert (found["served"], found["closed"], found["refused"]) == (False, [], ["TOO_MANY"])
