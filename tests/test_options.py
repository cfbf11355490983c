"""The limits of options: declared once, and the same for a program and for the command line."""

import math
from collections.abc import Callable

import pytest

from gateway.budget.sequence import Blocks
from gateway.commissioning.building import BuildOptions
from gateway.commissioning.listen.options import ListenOptions
from gateway.commissioning.measure.options import Grid, InstrumentOptions, Pace
from gateway.commissioning.table_options import ReadOptions, ScrewOptions
from gateway.options import OptionError, Options
from gateway.simulator.clock import scaled_clock
from gateway.simulator.wire import Adapter, WireFaults
from tests.support.commands import typed


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Grid(runs=0), "runs: found 0; allowed: at least 1, at most 1000"),
        (lambda: Grid(runs=-3), "runs: found -3; allowed: at least 1, at most 1000"),
        (lambda: Grid(runs=1001), "runs: found 1001; allowed: at least 1, at most 1000"),
        (lambda: Grid(targets=1), "targets: found 1; allowed: at least 2"),
        (lambda: Grid(step=math.inf), "step: found inf; allowed: a finite number"),
        (lambda: Pace(dwell_s=-1.0), "dwell_s: found -1.0; allowed: at least 0"),
        (lambda: Pace(dwell_s=math.nan), "dwell_s: found nan; allowed: a finite number, at least 0"),
        (lambda: Pace(move_timeout_s=-1.0), "move_timeout_s: found -1.0; allowed: at least 0.1"),
        (lambda: InstrumentOptions(timeout_s=0.0), "timeout_s: found 0.0; allowed: at least 0.1"),
        (lambda: InstrumentOptions(baudrate=0), "baudrate: found 0; allowed: at least 1"),
        (lambda: ListenOptions(parity="x"), "parity: found 'x'; allowed: none, even, odd"),
        (lambda: ListenOptions(seconds=0.0), "seconds: found 0.0; allowed: at least 0.1"),
        (lambda: Blocks(read_registers=-1), "read_registers: found -1; allowed: at least 0, at most 125"),
        (lambda: Blocks(0, 124), "target_registers: found 124; allowed: at least 0, at most 123"),
        (lambda: ScrewOptions(period=[5.0, math.nan]), "period: found nan; allowed: a finite number"),
        (lambda: ReadOptions(travel=(0.0, math.inf)), "travel: found inf; allowed: a finite number"),
        (lambda: WireFaults(noise=1.5), "noise: found 1.5; allowed: at least 0, at most 1"),
        (lambda: Adapter(burst_bytes=0), "burst_bytes: found 0; allowed: at least 1"),
        (lambda: scaled_clock(math.nan), "speed_up: found nan; allowed: a finite number, at least 0.001"),
    ],
)
def test_a_value_outside_its_limits_is_refused_with_its_name_and_the_limits(
    make: Callable[[], Options], said: str
) -> None:
    with pytest.raises(OptionError) as caught:
        make()
    assert str(caught.value) == said


def test_an_integer_that_no_float_holds_is_within_its_limits_or_refused() -> None:
    assert Grid(seed=10**400).seed == 10**400
    with pytest.raises(OptionError, match="allowed: at least 1, at most 1000"):
        Grid(runs=10**400)


def test_a_baud_rate_that_no_port_can_be_set_to_is_refused() -> None:
    with pytest.raises(OptionError, match=r"^baudrate: found 5; allowed: 50, 75, .*9600, 19200, "):
        ListenOptions(baudrate=5)
    assert ListenOptions(baudrate=9600).baudrate == 9600


def test_a_format_that_cannot_be_written_is_refused() -> None:
    with pytest.raises(OptionError, match=r"^to: found 'excel'; allowed: .*centroid-3, csv, "):
        BuildOptions(to="excel")


@pytest.mark.parametrize(
    "arguments",
    [
        ("measure", "none.toml", "--axis", "x", "--runs", "0"),
        ("measure", "none.toml", "--axis", "x", "--dwell", "nan"),
        ("measure", "none.toml", "--axis", "x", "--speed", "inf"),
        ("budget", "none.toml", "--registers", "126"),
        ("listen", "none", "--for", "0"),
        ("simulate", "none.toml", "--noise", "2"),
        ("simulate", "none.toml", "--jitter", "inf"),
        ("table", "build", "none.csv", "out.csv", "--to", "excel"),
    ],
)
def test_the_command_line_has_the_same_limits_and_names_its_option(arguments: tuple[str, ...]) -> None:
    done = typed(*arguments)
    assert done.returncode == 2
    assert f"Invalid value for {arguments[-2]}:" in done.stderr.replace("'", "")
