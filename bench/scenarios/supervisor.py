"""A supervisor that hangs or dies: what the relay's traffic notices of it."""

import os
import signal
import time
from typing import Final

from bench.candidates import free_port
from bench.context import Bench
from bench.errors import BenchError
from bench.features import with_outputs
from bench.figures import Interval, Round, ratio
from bench.gateway_process import Gateway, start_gateway
from bench.gateway_setup import Controller, GatewaySetup, LineSetup
from bench.measuring import Load, Way, start_drive
from bench.processes import Processes
from bench.results import Goal, Section, latency_table
from bench.scenarios.load import move_aside

TITLE: Final = "Supervisor stopped and killed"
ROUNDS: Final = 5
STALL_S: Final = 10.0
BACK_S: Final = 10.0
"""How long a new supervisor is waited for before the whole gateway is started anew."""
IDLE, STOPPED, KILLED = "idle", "supervisor stopped", "supervisor killed"
RATIOS: Final = {name: f"p99.9 with the {name} ÷ idle" for name in (STOPPED, KILLED)}
LOST: Final = "exchanges lost meanwhile"
LIMIT: Final = 1.3


class _Rig:
    """A whole gateway, its drive, and the way in."""

    def __init__(self, bench: Bench, processes: Processes) -> None:
        self._bench = bench
        self._processes = processes
        cpus = bench.processors.one
        drive = start_drive(processes, bench.programs, cpus=cpus)
        port = free_port()
        line = LineSetup((Controller(tcp_port=port),), drive_port=drive.ports[0])
        self._setup = with_outputs(GatewaySetup((line,))).setup
        self._way = Way.tcp(port)
        self._load = self._stall_load = Load(2000, cpus=cpus)
        self._gateway = self._start()
        if self.supervisor is not None:
            # As many exchanges as fill the time for which the supervisor hangs; else half as many.
            first = bench.meter.run(self._way, self._load)
            each_s = first.seconds / (self._load.count + self._load.warmup)
            stall_s = 2.0 if bench.effort.is_quick else STALL_S
            self._stall_load = Load(int(stall_s / each_s), cpus=cpus)
            self._load = Load(int(stall_s / each_s / 2), cpus=cpus)

    @property
    def supervisor(self) -> int | None:
        return self._gateway.supervisor_pid

    def idle(self) -> Round:
        return self._bench.meter.run(self._way, self._load).from_sent

    def stopped(self) -> Round:
        pid = self._supervisor()
        os.kill(pid, signal.SIGSTOP)
        try:
            return self._bench.meter.run(self._way, self._stall_load).from_sent
        finally:
            os.kill(pid, signal.SIGCONT)

    def killed(self) -> Round:
        os.kill(self._supervisor(), signal.SIGKILL)
        return self.idle()

    def _supervisor(self) -> int:
        """Return the supervisor, waiting for a new one, with a new gateway where none comes."""
        until = time.monotonic() + BACK_S
        while (pid := self.supervisor) is None:
            if time.monotonic() > until:
                self._processes.stop(self._gateway.process)
                self._gateway = self._start()
                until = time.monotonic() + BACK_S
            time.sleep(0.1)
        move_aside(self._bench, self._gateway)
        return pid

    def _start(self) -> Gateway:
        gateway = start_gateway(
            self._processes, "gateway-stall", self._setup, is_whole=True, cpus=self._bench.processors.one
        )
        self._bench.meter.wait_until_serving(self._way)
        move_aside(self._bench, gateway)
        return gateway


def run(bench: Bench) -> Section:
    """Measure idle, stopped and killed in turn."""
    section = Section.of(
        TITLE,
        f"The supervisor gets SIGSTOP for a whole round (about {STALL_S:.0f} s), or SIGKILL at the beginning "
        "of one; rounds without either lie between them. Every reply is checked; one that is missing counts.",
    )
    with Processes() as processes:
        rig = _Rig(bench, processes)
        if rig.supervisor is None:
            section.text.append("This version of the gateway has no supervisor yet: nothing to stop or kill.")
            section.goals += [Goal(what, LIMIT, None, remark="no supervisor yet") for what in RATIOS.values()]
            section.goals.append(Goal(LOST, 0.0, None, remark="no supervisor yet"))
            return section
        measures = {IDLE: rig.idle, STOPPED: rig.stopped, KILLED: rig.killed}
        try:
            series = bench.interleaved(TITLE, measures, bench.effort.of(ROUNDS, 2))
        except BenchError as error:
            section.goals += [
                Goal(what, LIMIT, None, remark="an exchange was lost") for what in RATIOS.values()
            ]
            section.goals.append(Goal(LOST, 0.0, Interval(1.0, 1.0, 1.0), remark=str(error)))
            return section
    section.tables.append(latency_table(series))
    section.goals += [Goal(what, LIMIT, ratio(series, name, IDLE, "p999")) for name, what in RATIOS.items()]
    section.goals.append(Goal(LOST, 0.0, Interval(0.0, 0.0, 0.0)))
    return section
