"""Programs that the bench starts end with it."""

import os
import signal
import sys
from pathlib import Path

import pytest

from bench.errors import BenchError
from bench.processes import Process, Processes, children, command_line, cpu_ns, line_from, resident_bytes

WAITING = "import sys, time; print('here', flush=True); time.sleep(600)"
IN_PARTS = (
    f"import subprocess, sys, time; subprocess.Popen([sys.executable, '-c', {WAITING!r}]); time.sleep(600)"
)


def _failing(logs: Path, seen: list[Process]) -> None:
    with Processes(logs) as started:
        for i in range(2):
            seen.append(started.start(f"program{i}", [sys.executable, "-c", WAITING], is_talking=True))
            assert line_from(seen[-1]) == "here"
        raise RuntimeError


def test_everything_is_stopped_when_the_bench_fails(tmp_path: Path) -> None:
    seen: list[Process] = []
    with pytest.raises(RuntimeError):
        _failing(tmp_path, seen)
    assert [process.returncode for process in seen] == [-signal.SIGTERM, -signal.SIGTERM]


def test_a_stopped_program_is_ended_too(tmp_path: Path) -> None:
    with Processes(tmp_path) as started:
        process = started.start("hung", [sys.executable, "-c", WAITING], is_talking=True)
        line_from(process)
        process.send_signal(signal.SIGSTOP)
    assert process.returncode == -signal.SIGTERM


def test_a_program_that_ends_before_it_says_anything(tmp_path: Path) -> None:
    with Processes(tmp_path) as started, pytest.raises(BenchError, match="ended"):
        line_from(started.start("silent", [sys.executable, "-c", ""], is_talking=True))


def test_what_is_known_of_a_process(tmp_path: Path) -> None:
    own = os.getpid()
    with Processes(tmp_path) as started:
        process = started.start("parent", [sys.executable, "-c", IN_PARTS], is_talking=True)
        line_from(process)  # of the child, which has the same pipe
        (child,) = children(process.pid)
        assert process.pid in children(own)
        assert "time.sleep(600)" in command_line(child)
        os.kill(child, signal.SIGKILL)
    assert resident_bytes(own) > 2**20
    before = cpu_ns(own)
    assert sum(range(2_000_000)) > 0
    assert cpu_ns(own) > before
