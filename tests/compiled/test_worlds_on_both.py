"""Small worlds around the compiled gateway, and around its sources: the same states, and the same passes."""

import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from gateway.compiled import is_compiled
from tests.compiled.conftest import ROOT

pytestmark = pytest.mark.skipif(not is_compiled(), reason="make test-compiled: there is nothing to compare")

CLOSING = ("s-two-units", "s-starts", "b-rtu", "b-rtu-pairs", "b-rtu-replies", "b-rtu-cut")
"""Walked until nothing is new."""
LONGER = ("direct", "staged", "two-ways", "killed", "homed", "changes", "b-replies", "b-rtu-cut-stuck")
"""Walked to a depth."""
ROW = re.compile(r"^\| `(.*?)` \| ([\d,]+) \| ([\d,]+) \| (\d+) \| \d+ s \| (.*) \|$", re.MULTILINE)
SUMMARY = re.compile(r"^(?:longest wait|of all that left).*$", re.MULTILINE)


def begun(folder: Path, words: Sequence[str]) -> "subprocess.Popen[str]":
    """Begin to walk worlds around the gateway of a folder, one at a time, for as long as it takes."""
    options = ("--random", "0", "--jobs", "1", "--seconds", "3600")
    return subprocess.Popen(
        [sys.executable, "-m", "tests.verify", *words, *options],
        cwd=folder,
        stdout=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize("words", [CLOSING, (*LONGER, "--depth", "5")], ids=["closing", "longer"])
def test_both_go_the_same_ways(sources: Path, words: Sequence[str]) -> None:
    walks = [begun(folder, words) for folder in (ROOT, sources)]
    compiled, plain = (walk.communicate()[0] for walk in walks)
    assert "the gateway is compiled\n" in compiled
    assert "the gateway is not compiled\n" in plain
    assert ROW.findall(compiled) == ROW.findall(plain)
    assert SUMMARY.findall(compiled) == SUMMARY.findall(plain)
    assert [walk.returncode for walk in walks] == [0, 0]
    rows = ROW.findall(compiled)
    assert sorted(name for name, *_ in rows) == sorted(word for word in words if word in (*CLOSING, *LONGER))
    assert all(how == ("closed" if words is CLOSING else "0 random steps") for *_, how in rows)
