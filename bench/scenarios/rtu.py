"""RTU on bare pseudo terminals: no baud rate, so that only the programs count."""

from contextlib import ExitStack, closing
from functools import partial
from typing import Final

from bench.candidates import (
    C_RELAY,
    COMPILED,
    DIRECT,
    GATEWAY,
    PTY_CANDIDATES,
    SOCAT,
    Cable,
    free_port,
    socat_program,
)
from bench.context import ANYWHERE, ON_ONE, Bench, Cpus
from bench.figures import Round, Series, ratio
from bench.gateway_process import start_gateway
from bench.gateway_setup import Controller, GatewaySetup, LineSetup
from bench.measuring import Load, Way, start_drive
from bench.processes import Command, Processes
from bench.results import Goal, Section, latency_table
from gateway.simulator.pty import Pty

RTU_TITLE: Final = "RTU to RTU over pseudo terminals"
MIXED_TITLE: Final = "TCP to RTU over a pseudo terminal"


def run_rtu(bench: Bench) -> Section:
    """Measure writes of a position from one pseudo terminal to another."""
    section = Section.of(
        RTU_TITLE,
        "Writes of one position, RTU on both sides, on pseudo terminals without a baud rate. Direct is one "
        "pseudo terminal between controller and drive, all others stand between two.",
    )
    by_placement = {
        placement: _rtu_series(bench, placement, cpus)
        for placement, cpus in bench.processors.placements.items()
    }
    for placement, series in by_placement.items():
        column = [str(ratio(series, name, SOCAT)) for name in series]
        section.tables.append(latency_table(series, [("p50 ÷ socat's", column)], f"Writes, {placement}."))
    section.goals += _goals(
        "RTU→RTU over ptys, round trip median ÷ socat's", by_placement, SOCAT, plain_limit=1.6
    )
    return section


def run_mixed(bench: Bench) -> Section:
    """Measure writes of a position from Modbus/TCP to RTU."""
    section = Section.of(
        MIXED_TITLE,
        "Writes of one position, Modbus/TCP towards the controller, RTU on a pseudo terminal towards the "
        "drive. The relay in C converts the frames and does nothing else: it stands for the limit, and for "
        "gateways such as mbusd that are not packaged.",
    )
    by_placement = {
        placement: _mixed_series(bench, placement, cpus)
        for placement, cpus in bench.processors.placements.items()
    }
    for placement, series in by_placement.items():
        column = [str(ratio(series, name, C_RELAY)) for name in series]
        section.tables.append(latency_table(series, [("p50 ÷ C's", column)], f"Writes, {placement}."))
    section.goals += _goals(
        "TCP→RTU over a pty, round trip median ÷ a relay's in C", by_placement, C_RELAY, plain_limit=1.5
    )
    return section


def _goals(what: str, by_placement: dict[str, Series], to: str, *, plain_limit: float) -> list[Goal]:
    def goal(name: str, of: str, limit: float) -> Goal:
        remark = f"{ANYWHERE}: {ratio(by_placement[ANYWHERE], of, to)}"
        return Goal(name, limit, ratio(by_placement[ON_ONE], of, to), remark=remark)

    return [goal(f"{what}, compiled", COMPILED, 1.1), goal("… not compiled", GATEWAY, plain_limit)]


def _rtu_series(bench: Bench, placement: str, cpus: Cpus) -> Series:
    socat_program()
    with ExitStack() as stack:
        processes = stack.enter_context(Processes())
        ways: dict[str, Way] = {}
        direct = stack.enter_context(closing(Pty()))
        far_fds = [direct.master_fd]
        ways[DIRECT] = Way.tty(direct.path)
        for name, start in PTY_CANDIDATES.items():
            cable = Cable(stack.enter_context(closing(Pty())), stack.enter_context(closing(Pty())))
            start(processes, bench.tools(cpus), cable)
            far_fds.append(cable.far.master_fd)
            ways[name] = Way.fd(cable.near.master_fd)
        start_drive(processes, bench.programs, [f"fd:{fd}" for fd in far_fds], fds=far_fds, cpus=cpus)
        return _measured(bench, f"{RTU_TITLE}, {placement}", ways, cpus)


def _mixed_series(bench: Bench, placement: str, cpus: Cpus) -> Series:
    with ExitStack() as stack:
        processes = stack.enter_context(Processes())
        ways: dict[str, Way] = {}
        fds: list[int] = []
        for name in (C_RELAY, GATEWAY, COMPILED):
            far, port = stack.enter_context(closing(Pty())), free_port()
            fds.append(far.master_fd)
            ways[name] = Way.tcp(port)
            if name == C_RELAY:
                command: Command = [bench.programs.relay, "--convert", f"listen:{port}", f"tty:{far.path}"]
                processes.start("converting-relay-in-c", command, cpus=cpus)
                continue
            setup = GatewaySetup((LineSetup((Controller(tcp_port=port),), drive_tty=far.path),))
            label = f"{name.replace(' ', '-')}-tcp-to-rtu"
            packages = bench.tools(cpus).packages(is_compiled=name == COMPILED)
            start_gateway(processes, label, setup, cpus=cpus, packages=packages)
        start_drive(processes, bench.programs, [f"fd:{fd}" for fd in fds], fds=fds, cpus=cpus)
        return _measured(bench, f"{MIXED_TITLE}, {placement}", ways, cpus)


def _measured(bench: Bench, what: str, ways: dict[str, Way], cpus: Cpus) -> Series:
    load = Load(bench.effort.count // 2, cpus=cpus)

    def measure(way: Way) -> Round:
        return bench.meter.run(way, load).from_sent

    for name, way in ways.items():
        bench.say(f"{what}: waiting for {name}")
        bench.meter.wait_until_serving(way)
    return bench.interleaved(what, {name: partial(measure, way) for name, way in ways.items()})
