"""How many instructions of user mode something takes: by a counter of the processor, else by callgrind.

A busy machine, a cold cache and a slow system call leave this figure alone.
"""

import re
import shutil
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from bench.candidates import Tools, free_port
from bench.errors import BenchError
from bench.gateway_process import Gateway, start_gateway
from bench.gateway_setup import Controller, GatewaySetup, LineSetup
from bench.measuring import Load, Meter, Way, start_drive
from bench.places import BUILD
from bench.processes import Processes, line_from

PROFILES: Final = BUILD / "callgrind"
TOTALS: Final = re.compile(r"^totals: (\d+)", re.MULTILINE)
WARMUP, FEW, MANY = 2_000, 200, 1_200
"""Exchanges under callgrind: what a connection costs is in both counts, and falls out of their difference."""
REST_S: Final = 2.0
PATIENCE_S: Final = 120.0
"""For a gateway under callgrind to serve: it starts fifty times as slowly."""


def counter_refusal(program: Path) -> str:
    """Return why this machine's processor counts no instructions for us; empty where it does."""
    try:
        counted(program, (), lambda: None)
    except BenchError as error:
        return str(error)
    return ""


def counted(
    program: Path, pids: Sequence[int], act: Callable[[], object], event: str = "instructions"
) -> int:
    """Return how many instructions these processes take meanwhile, with all their threads.

    Raises:
        BenchError: the machine has no such counter, or does not allow it.
    """
    threads = [path.name for pid in pids for path in Path(f"/proc/{pid}/task").iterdir()]
    with Processes() as processes:
        # Without any it counts itself.
        counter = processes.start("counter", [program, event, *(threads or ["0"])], is_talking=True)
        try:
            line_from(counter)
        except BenchError:
            raise BenchError((processes.logs / "counter.log").read_text().strip()) from None
        act()
        return int(processes.stop(counter))


def callgrind_refusal() -> str:
    """Return why nothing can be counted by callgrind; empty where it can."""
    return "" if shutil.which("valgrind") else "valgrind is not installed"


def by_callgrind(meter: Meter, tools: Tools, *, is_compiled: bool) -> float:
    """Return what an exchange takes in the relay, in a closed loop; what it does for itself is taken off."""
    shutil.rmtree(PROFILES, ignore_errors=True)
    PROFILES.mkdir(parents=True)
    with Processes() as processes:
        drive = start_drive(processes, tools.programs, cpus=tools.relay_cpus)
        port = free_port()
        gateway = start_gateway(
            processes,
            "gateway-callgrind",
            GatewaySetup((LineSetup((Controller(tcp_port=port),), drive_port=drive.ports[0]),)),
            cpus=tools.relay_cpus,
            packages=tools.packages(is_compiled=is_compiled),
            under=[
                *("valgrind", "--tool=callgrind", "--trace-children=yes", "--instr-atstart=no"),
                f"--callgrind-out-file={PROFILES}/%p",
            ],
        )
        way = Way.tcp(port)
        meter.wait_until_serving(way, patience_s=PATIENCE_S)
        meter.run(way, Load(WARMUP, warmup=0))
        _control(gateway, "--instr=on")
        profile = _Profile(gateway)
        rest, rest_s = profile.totals(lambda: _rest(REST_S))
        few, few_s = profile.totals(lambda: meter.run(way, Load(FEW, warmup=0)).seconds)
        many, many_s = profile.totals(lambda: meter.run(way, Load(MANY, warmup=0)).seconds)
    return (many - few - rest / rest_s * (many_s - few_s)) / (MANY - FEW)


class _Profile:
    """What callgrind has counted, part by part."""

    def __init__(self, gateway: Gateway) -> None:
        self._gateway = gateway
        self._parts = 0

    def totals(self, act: Callable[[], float]) -> tuple[int, float]:
        """Return the instructions that were taken meanwhile, and the seconds that it says it took."""
        _control(self._gateway, "--zero")
        seconds = act()
        _control(self._gateway, "--dump")
        self._parts += 1
        text = (PROFILES / f"{self._gateway.process.pid}.{self._parts}").read_text()
        found = TOTALS.search(text)
        if found is None:
            raise BenchError("callgrind says no totals")
        return int(found[1]), seconds


def _rest(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def _control(gateway: Gateway, what: str) -> None:
    command = ["callgrind_control", what, str(gateway.process.pid)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise BenchError(f"{' '.join(command)}: {done.stderr.strip()}")
