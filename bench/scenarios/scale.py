"""Many axes, lines and controllers: what an exchange costs there, compared with one of each."""

from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Final

from bench.candidates import free_port
from bench.context import Bench, Cpus
from bench.figures import Interval, Series, over_rounds, ratio
from bench.gateway_process import start_gateway
from bench.gateway_setup import Controller, GatewaySetup, LineSetup
from bench.measuring import Found, Load, Way, start_drive
from bench.processes import Processes
from bench.results import Goal, Section, in_us, latency_table

TITLE: Final = "32 axes, 8 lines, 64 controllers"
ONE: Final = "1 axis, 1 line, 1 controller"
MANY: Final = TITLE
TOGETHER: Final = "all 64 at once"
DIRECT_ONE, DIRECT_MANY = "direct, 1 connection", "direct, 64 connections"
LINES, AXES_PER_LINE, CONTROLLERS_PER_LINE = 8, 4, 8
LIMIT: Final = 1.2


class _Rig:
    """A gateway with its drives, and the load that all of its controllers make in turn."""

    def __init__(
        self, bench: Bench, processes: Processes, name: str, size: tuple[int, int, int], cpus: Cpus
    ) -> None:
        lines, axes, controllers = size
        self._bench = bench
        self._units = tuple(range(1, axes + 1))
        self._lines = lines
        drive = start_drive(processes, bench.programs, ["listen:0"] * lines, cpus=cpus)
        ports = [[free_port() for _ in range(controllers)] for _ in range(lines)]
        setup = GatewaySetup(tuple(
            LineSetup(tuple(Controller(tcp_port=port) for port in own), drive_port=at, axes=axes)
            for own, at in zip(ports, drive.ports, strict=True)
        ))  # fmt: skip
        gateway = start_gateway(processes, name, setup, cpus=cpus)
        self._direct = Way.tcp(*(drive.ports * controllers))
        self._cpus = cpus
        for own in ports:
            bench.meter.wait_until_serving(Way.tcp(own[0]), self._units)
        # Line by line within each turn, so that neighbouring requests are on different lines.
        in_turn = (own[i] for i in range(controllers) for own in ports)
        self._way = Way.tcp(*in_turn, pids=(gateway.relay_pid,))

    def measure(self, *, is_concurrent: bool = False) -> Found:
        """Measure one round through the gateway."""
        return self._bench.meter.run(self._way, self._load(is_concurrent=is_concurrent))

    def measure_direct(self) -> Found:
        """Measure one over as many connections and nothing in between."""
        return self._bench.meter.run(self._direct, self._load())

    def _load(self, *, is_concurrent: bool = False) -> Load:
        count = self._bench.effort.count
        return Load(count, units=self._units, lines=self._lines, is_concurrent=is_concurrent, cpus=self._cpus)


def run(bench: Bench) -> Section:
    """Measure one axis and the large gateway in turn."""
    section = Section.of(
        TITLE,
        f"{MANY} ({AXES_PER_LINE} axes and {CONTROLLERS_PER_LINE} controllers on each line, each controller "
        f"behind a port of its own) beside {ONE}; writes of positions, all on one processor. One request at "
        "a time in all, controller after controller: what an exchange costs because there is so much else. "
        "So many connections cost controller and drive more as well, also with nothing in between: *direct* "
        "is that, over as many connections, and *added* is what the gateway adds to it. "
        "Then every controller at once, each with a request of its own under way: its round trips contain "
        "the wait for the others.",
    )
    cpus = bench.processors.one
    with Processes() as processes:
        one = _Rig(bench, processes, "gateway-one", (1, 1, 1), cpus)
        many = _Rig(bench, processes, "gateway-many", (LINES, AXES_PER_LINE, CONTROLLERS_PER_LINE), cpus)
        measures: dict[str, Callable[[], Found]] = {
            DIRECT_ONE: one.measure_direct,
            ONE: one.measure,
            DIRECT_MANY: many.measure_direct,
            MANY: many.measure,
            TOGETHER: partial(many.measure, is_concurrent=True),
        }
        rounds = bench.interleaved(TITLE, measures)
    trips: Series = {name: [one.from_sent for one in found] for name, found in rounds.items()}
    costs: Series = {name: [one.used for one in found] for name, found in rounds.items()}
    is_direct = [name in {DIRECT_ONE, DIRECT_MANY} for name in costs]
    used = [in_us(median([cost.p50 for cost in rounds])) for rounds in costs.values()]
    times = ["" if direct else text for direct, text in zip(is_direct, used, strict=True)]
    ratios = [
        "" if direct else str(ratio(costs, name, ONE)) for direct, name in zip(is_direct, costs, strict=True)
    ]
    section.tables.append(
        latency_table(trips, [("relay's processor time µs", times), ("÷ one axis", ratios)])
    )
    section.goals += [
        Goal(f"{MANY}: added median ÷ one axis", LIMIT, _added_ratio(trips)),
        Goal("… relay's processor time per exchange ÷ one axis", LIMIT, ratio(costs, MANY, ONE)),
        Goal("… median round trip ÷ one axis", LIMIT, ratio(trips, MANY, ONE)),
    ]
    return section


def _added_ratio(trips: Series) -> Interval:
    """Return what the large gateway adds to as many direct connections ÷ what the small one adds to one."""
    return over_rounds(
        trips,
        lambda pick: (
            (pick(MANY, "p50") - pick(DIRECT_MANY, "p50")) / (pick(ONE, "p50") - pick(DIRECT_ONE, "p50"))
        ),
    )
