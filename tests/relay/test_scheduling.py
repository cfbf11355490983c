"""Scheduling of the relay: what is reported is what the kernel says, and what it refuses has a remedy.

Everything happens in a child process, which tells what it asked, what was refused, and what the kernel says.
A machine may allow it or not: the tests hold either way, and where refusal is certain they say so.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from gateway.relay.scheduling import memory_problem, numbers_text
from tests.support.processes import started

ROOT = Path(__file__).parents[2]
CPU = min(os.sched_getaffinity(0))
NO_SUCH_CPU = 8191
CHILD = """
import json, os, re, resource, sys, threading
from pathlib import Path
from gateway.state.plan import RelayOptions
from msgspec import to_builtins

from gateway.relay.scheduling import in_force, schedule

asked = json.loads(sys.argv[1])
before = sorted(os.sched_getaffinity(0))
if asked.get("powerless"):
    resource.setrlimit(14, (0, 0))  # RLIMIT_RTPRIO
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (1 << 20, 1 << 20))
    if os.geteuid() == 0:
        os.setgroups([])
        os.setgid(65534)
        os.setuid(65534)
withdrawn = []
done = threading.Event()
idlers = [threading.Thread(target=done.wait) for _ in range(asked.get("threads", 0))]
for idler in idlers:
    idler.start()
resident = lambda: int(re.search(r"VmRSS:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
resident_before = resident()
options = RelayOptions(asked.get("fifo", 0), tuple(asked.get("cpus", ())), asked.get("lock_memory", False))
refused = schedule(options, withdrawn.append)
first = to_builtins(in_force())
added_kib = resident() - resident_before
done.set()
policy, priority = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
of_threads = []
thread = threading.Thread(target=lambda: of_threads.append(os.sched_getscheduler(0)))
thread.start()
thread.join()
if asked.get("spin"):
    while not withdrawn and in_force().fifo:
        pass
text = Path("/proc/self/status").read_text()
print(json.dumps({
    "refused": {each.key: [each.asked, each.detail, each.remedy] for each in refused},
    "in_force": first,
    "policy": policy & ~os.SCHED_RESET_ON_FORK,
    "priority": priority,
    "is_reset_on_fork": bool(policy & os.SCHED_RESET_ON_FORK),
    "policy_of_threads": of_threads[0] & ~os.SCHED_RESET_ON_FORK,
    "spin_limit_us": resource.getrlimit(15)[0],  # RLIMIT_RTTIME
    "cpus_before": before,
    "cpus": sorted(os.sched_getaffinity(0)),
    "locked_kib": int(re.search(r"VmLck:\\s+(\\d+)", text)[1]),
    "mapped_kib": int(re.search(r"VmSize:\\s+(\\d+)", text)[1]),
    "added_kib": added_kib,
    "withdrawn": withdrawn,
    "policy_at_end": os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK,
}))
"""


def child(**asked: object) -> dict[str, Any]:
    with started(
        [sys.executable, "-c", CHILD, json.dumps(asked)],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as process:
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    answer: dict[str, Any] = json.loads(output)
    return answer


def test_nothing_asked_changes_nothing() -> None:
    told = child()
    assert told["refused"] == {}
    assert told["cpus"] == told["cpus_before"]
    assert told["in_force"] == {
        "fifo": told["priority"] if told["policy"] == os.SCHED_FIFO else 0,
        "cpus": told["cpus"],
        "memory_locked": told["locked_kib"] > 0,
    }


def test_a_priority_is_in_force_or_refused_and_never_inherited() -> None:
    told = child(fifo=50)
    granted = (told["policy"], told["priority"]) == (os.SCHED_FIFO, 50)
    assert told["in_force"]["fifo"] == (50 if granted else 0)
    assert ("relay.fifo" in told["refused"]) is not granted
    if granted:
        assert told["is_reset_on_fork"]
        assert told["policy_of_threads"] == os.SCHED_OTHER
        assert told["spin_limit_us"] == 200_000


def test_a_cpu_that_is_there_is_kept_to() -> None:
    told = child(cpus=[CPU])
    assert told["refused"] == {}
    assert told["cpus"] == [CPU]
    assert told["in_force"]["cpus"] == [CPU]


@pytest.mark.parametrize("cpus", [[NO_SUCH_CPU], [CPU, NO_SUCH_CPU]])
def test_a_cpu_that_is_not_there_is_named_and_all_stay(cpus: list[int]) -> None:
    """The kernel takes the one that is there and drops the other in silence: half a wish is refused whole."""
    told = child(cpus=cpus)
    asked, detail, remedy = told["refused"]["relay.cpus"]
    assert asked == cpus
    assert detail == "no CPU 8191 for this process"
    assert remedy.startswith(f"name some of {numbers_text(told['cpus_before'])}, on which the process runs; ")
    assert told["cpus"] == told["cpus_before"] == told["in_force"]["cpus"]


def test_memory_is_locked_or_refused() -> None:
    told = child(lock_memory=True)
    granted = told["locked_kib"] > 0
    assert told["in_force"]["memory_locked"] is granted
    assert ("relay.lock_memory" in told["refused"]) is not granted
    if granted:
        # All but the few pages that the kernel itself maps into every process.
        assert told["locked_kib"] > 0.9 * told["mapped_kib"]


def test_stacks_of_threads_are_locked_as_they_are_touched_not_whole() -> None:
    """Sixteen threads with 8 MiB of stack each would be 128 MiB; programs and libraries are a few."""
    told = child(lock_memory=True, threads=16)
    assert told["added_kib"] < 64 * 1024


def test_without_rights_each_wish_is_refused_with_its_remedy_and_the_rest_goes_on() -> None:
    told = child(fifo=50, cpus=[CPU], lock_memory=True, powerless=True)
    assert list(told["refused"]) == ["relay.lock_memory", "relay.fifo"]
    asked, detail, remedy = told["refused"]["relay.fifo"]
    assert (asked, detail) == (50, "Operation not permitted; RLIMIT_RTPRIO is 0")
    assert "LimitRTPRIO=50" in remedy
    assert "CAP_SYS_NICE" in remedy
    asked, detail, remedy = told["refused"]["relay.lock_memory"]
    assert asked is True
    assert re.fullmatch(r"RLIMIT_MEMLOCK is 1 MiB; needed: \d+ MiB, 4 times what is mapped now", detail)
    assert "LimitMEMLOCK=infinity" in remedy
    assert told["in_force"] == {"fifo": 0, "cpus": [CPU], "memory_locked": False}
    assert (told["policy"], told["locked_kib"], told["cpus"]) == (os.SCHED_OTHER, 0, [CPU])


def test_a_loop_that_never_waits_loses_its_priority_and_goes_on() -> None:
    told = child(fifo=50, spin=True)
    if "relay.fifo" in told["refused"]:
        assert told["withdrawn"] == []
    else:
        [why] = told["withdrawn"]
        assert why.startswith("computed for 200 ms without waiting")
        assert told["in_force"]["fifo"] == 50
    assert told["policy_at_end"] == os.SCHED_OTHER


def test_a_limit_must_leave_four_times_what_is_mapped() -> None:
    mib = 1 << 20
    assert memory_problem(-1, 100 * mib, is_capable=False) == ""
    assert memory_problem(0, 100 * mib, is_capable=True) == ""
    assert memory_problem(400 * mib, 100 * mib, is_capable=False) == ""
    assert memory_problem(399 * mib, 100 * mib, is_capable=False) == (
        "RLIMIT_MEMLOCK is 399 MiB; needed: 400 MiB, 4 times what is mapped now"
    )
