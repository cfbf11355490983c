"""The journal of interventions and its processes: two at once, one that is killed, a full disk."""

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.interventions import only_file, switched, verified, written
from tests.support.processes import SECONDS
from tests.support.programs import ran


def test_a_full_disk_keeps_what_is_written_whole_and_the_rest_waiting(tmp_path: Path) -> None:
    """A limit of the size of files in another process stands for the full disk: a part of the line fits."""
    folder = written(tmp_path / "interventions", switched("a"))
    size = only_file(folder).stat().st_size
    program = (
        "import resource, signal, sys\n"
        "from collections import deque\n"
        "from pathlib import Path\n"
        "from gateway.state.interventions import Intervention, Writer\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({size + 100}, resource.RLIM_INFINITY))\n"
        "writer = Writer(Path(sys.argv[1]))\n"
        "waiting = deque([Intervention('reference', 'socket', 'x', wall_s=1.0, monotonic_ns=2)])\n"
        "try:\n"
        "    writer.write(waiting)\n"
        "except OSError as error:\n"
        "    print(error.errno, len(waiting), flush=True)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))\n"
        "writer.write(waiting)\n"
        "print(len(waiting))\n"
    )
    done = ran(sys.executable, "-c", program, folder, timeout=SECONDS)
    assert done.stderr == ""
    assert done.stdout.splitlines() == [f"{errno.ENOSPC} 1", "0"]
    found, entries = verified(folder)
    assert (found.problems, [entry["what"] for entry in entries]) == ([], ["compensation", "reference"])
    assert (entries[1]["time"], entries[1]["monotonic_ns"]) == ("1970-01-01T00:00:01.000+00:00", 2)


WRITES: str = (
    "import sys\n"
    "from collections import deque\n"
    "from pathlib import Path\n"
    "from gateway.state.interventions import Intervention, Writer\n"
    "writer, number = Writer(Path(sys.argv[1]), file_bytes=20_000), 0\n"
    "print('ready', flush=True)\n"
    "sys.stdin.readline()\n"
    "while number < int(sys.argv[3]):\n"
    "    number += 1\n"
    "    writer.write(deque([Intervention('reference', 'socket', sys.argv[2], after=number)]))\n"
    "    print(number, flush=True)\n"
)


def _writer(folder: Path, axis: str, most: int) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", WRITES, str(folder), axis, str(most)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def _go(*processes: "subprocess.Popen[str]") -> Iterator[int]:
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
        yield process.pid


def test_two_writers_at_once_take_turns(tmp_path: Path) -> None:
    folder = tmp_path / "interventions"
    processes = [_writer(folder, axis, 60) for axis in "xy"]
    list(_go(*processes))
    for process in processes:
        process.communicate(timeout=SECONDS)
        assert process.returncode == 0
    found, entries = verified(folder)
    assert (found.problems, found.entries) == ([], 120)
    for axis in "xy":
        assert [entry["after"] for entry in entries if entry["axis"] == axis] == list(range(1, 61))


@pytest.mark.parametrize("after", [1, 7, 40])
def test_a_kill_at_a_write_loses_nothing_that_was_written(tmp_path: Path, after: int) -> None:
    folder = tmp_path / "interventions"
    with _writer(folder, "x", 1_000_000) as process:
        list(_go(process))
        assert process.stdout is not None
        for _ in range(after):
            said = int(process.stdout.readline())
        os.kill(process.pid, signal.SIGKILL)
        said = max([said, *(int(line) for line in process.stdout if line.endswith("\n"))])
    found, entries = verified(folder)
    assert found.problems == []
    assert len(entries) >= said
    written(folder, switched("y"))
    found, entries = verified(folder)
    assert (found.problems, found.notes) == ([], [])
    assert entries[-1]["axis"] == "y"
