"""The configurations that the bench writes are taken by the gateway, with their tables."""

from pathlib import Path

import pytest

from bench.gateway_setup import Controller, GatewaySetup, LineSetup, write_setup
from gateway.config.load import load


def test_a_line_with_a_table(tmp_path: Path) -> None:
    setup = GatewaySetup((LineSetup((Controller(tcp_port=15020),), drive_port=15021),), points=201)
    (line,) = load(write_setup(tmp_path, setup)).plan.lines
    (axis,) = line.axes
    assert axis.table is not None
    assert len(axis.table.positions) == 201
    assert (axis.table.first, axis.table.last) == pytest.approx((0.0, 100.0))
    # the drive is told something else than the controller says, and another thing in each direction
    assert axis.table.forward[100] == pytest.approx(0.02 * 0.20046 + 0.015, abs=1e-4)
    assert axis.table.forward[100] - axis.table.backward[100] == pytest.approx(0.008)


def test_32_axes_on_8_lines_for_64_controllers(tmp_path: Path) -> None:
    lines = tuple(
        LineSetup(
            tuple(Controller(tcp_port=20000 + 10 * n + i) for i in range(8)), drive_port=21000 + n, axes=4
        )
        for n in range(8)
    )
    plan = load(write_setup(tmp_path, GatewaySetup(lines))).plan
    assert sum(len(line.axes) for line in plan.lines) == 32
    assert sum(len(line.controllers) for line in plan.lines) == 64


def test_serial_ports(tmp_path: Path) -> None:
    line = LineSetup((Controller(tty="/dev/near"),), drive_tty="/dev/far", baudrate=9600)
    (planned,) = load(write_setup(tmp_path, GatewaySetup((line,), points=0))).plan.lines
    assert str(planned.drives) == "/dev/far"
    assert planned.axes[0].table is None


def test_a_line_that_cuts_through(tmp_path: Path) -> None:
    ports = Controller(tty="/dev/near")
    for wanted in (False, True):
        line = LineSetup((ports,), drive_tty="/dev/far", baudrate=9600, cuts_through=wanted)
        (planned,) = load(write_setup(tmp_path, GatewaySetup((line,)))).plan.lines
        assert planned.cut_through == wanted
