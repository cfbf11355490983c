"""``pitch-gateway simulate`` as a process: what a person types, sees and interrupts."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path
from struct import pack

import pytest
from typer.testing import CliRunner

from gateway.cli.app import app
from gateway.commissioning.measure.instruments import SerialGauge
from gateway.metrology.gauge_kinds import GaugeKind
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.master import ModbusMaster
from tests.support.config import axis, gateway_toml, line, registers, written
from tests.support.processes import COMMAND, ROOT, started

COMMAND_LINE = [*COMMAND, "simulate"]


@pytest.fixture
def configuration(tmp_path: Path, unused_tcp_port_factory: object) -> Path:
    assert callable(unused_tcp_port_factory)
    serial = {"rtu": str(tmp_path / "ttyDrives"), "baudrate": 115200}
    mapped = registers(command=0x40, actual=0x50)
    text = gateway_toml(
        line(serial, {"cnc": {"rtu": str(tmp_path / "ttyCnc")}}, name="l"),
        line(unused_tcp_port_factory(), {"hmi": unused_tcp_port_factory()}, name="m"),
        axis(registers=mapped, line="l", unit_id=4, travel=[-300.0, 0.0], compensation="off"),
        axis("y", mapped, line="m", counts_per_unit=500.0, compensation="off"),
    )
    return written(tmp_path, text, {})


async def test_every_drive_of_a_configuration_can_be_talked_to(configuration: Path) -> None:
    arguments = [*COMMAND_LINE, str(configuration), "--json", "--speed-up", "1000", "--seed", "5"]
    with started(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        start = json.loads(process.stdout.readline())
        assert (start["event"], start["speed_up"], start["seed"]) == ("serving", 1000, 5)
        serial, tcp = start["lines"]
        assert serial["axes"][0]["unit_id"] == 4
        assert serial["controllers"][0]["controller_opens"].endswith("ttyCnc.controller")

        async with ModbusMaster(SerialEndpoint(serial["address"]), 5000.0) as master:
            reply = await master.exchange(4, pack(">BHHBi", 16, 0x40, 2, 4, -5000))
            assert reply == pack(">BHH", 16, 0x40, 2)
        host, _, port = tcp["address"].rpartition(":")
        async with ModbusMaster(TcpEndpoint(host, int(port)), 5000.0) as master:
            assert await master.exchange(1, pack(">BHH", 3, 0x50, 2)) == b"\x03\x04\x00\x00\x00\x00"

        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=20)
        assert (process.returncode, errors) == (0, "")
    assert sorted(p.name for p in configuration.parent.iterdir()) == ["gateway.toml"]


async def test_a_laser_at_each_axis_is_asked_like_a_gauge_and_shown_to_who_types(configuration: Path) -> None:
    """It sees the nut: a worn screw does not take it to exactly the -5 mm that the encoder says."""
    folder = configuration.parent
    with started(
        [*COMMAND_LINE, str(configuration), "--gauge", "--seed", "5"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        said = [process.stdout.readline().strip() for _ in range(9)]
        assert said[6:] == [
            "axis x: a laser on gauge-x; read it with: measure --gauge gauge-x",
            "axis y: a laser on gauge-y; read it with: measure --gauge gauge-y",
            "Ctrl-C ends it.",
        ]
        gauge = SerialGauge(
            GaugeKind.SYLVAC, SerialEndpoint(str(folder / "gauge-x"), 4800, "E", 7, 2), "?\r", 5.0
        )
        await gauge.open()
        assert await gauge.read("home") == pytest.approx(0.0, abs=0.001)  # where it was set: 0, but for noise
        async with ModbusMaster(SerialEndpoint(str(folder / "ttyDrives"), 115200), 5000.0) as master:
            await master.exchange(4, pack(">BHHBi", 16, 0x40, 2, 4, -5000))
        shown = process.stdout.readline()
        assert (shown.split()[:6], shown.split()[7]) == (
            ["axis", "x", "stopped;", "its", "laser", "shows"],
            "mm",
        )
        assert 0.0 < abs(float(shown.split()[6]) + 5.0) < 1.0
        assert await gauge.read("-5 mm") == pytest.approx(float(shown.split()[6]), abs=0.001)
        gauge.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0
    assert sorted(p.name for p in folder.iterdir()) == ["gateway.toml"]


async def test_a_line_may_be_as_bad_as_its_adapter_and_its_drives_are(configuration: Path) -> None:
    options = ["--latency-timer", "16", "--lump", "14", "--jitter", "1", "--hearing", "standard", "--json"]
    with started([*COMMAND_LINE, str(configuration), *options], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = json.loads(process.stdout.readline())["lines"][0]["address"]
        async with ModbusMaster(SerialEndpoint(address), 5000.0) as master:
            begun_s = time.monotonic()
            assert await master.exchange(4, pack(">BHH", 3, 0x50, 2)) == b"\x03\x04\x00\x00\x00\x00"
            assert time.monotonic() - begun_s >= 0.016  # nine bytes wait for the timer
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0


def test_a_hearing_that_there_is_not_is_refused(configuration: Path) -> None:
    result = CliRunner().invoke(app, ["simulate", str(configuration), "--hearing", "well"])
    assert result.exit_code == 1
    assert "--hearing well: it must be one of standard, any-length, merging, no-check" in result.stderr


def test_what_is_served_is_said_for_people_too(configuration: Path) -> None:
    with started([*COMMAND_LINE, str(configuration)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline().strip() for _ in range(6)]
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0
    folder = configuration.parent
    assert lines[0] == f"line l: drives on {folder}/ttyDrives (rtu)"
    assert lines[1].startswith("axis x: unit 4, a worn screw, ")
    assert lines[2] == (
        f"controller cnc: connect it to {folder}/ttyCnc.controller (the gateway opens {folder}/ttyCnc)"
    )
    assert lines[3].startswith("line m: drives on 127.0.0.1:")
    assert lines[5].endswith("(the gateway listens there)")


@pytest.mark.parametrize(
    ("map_of_y", "warned"),
    [("", False), ("registers.trigger = [{ address = 0x60, start = [1], stop = [2] }]", True)],
)
def test_a_map_that_cannot_be_played_is_warned_of(configuration: Path, map_of_y: str, warned: bool) -> None:
    staged = "registers.staged = true\n" if map_of_y else ""
    configuration.write_text(f"{configuration.read_text()}{map_of_y}\n{staged}")
    arguments = [*COMMAND_LINE, str(configuration), "--json"]
    with started(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30)
    assert ("axis.y: simulated by a plain drive that moves as soon as" in said) is warned
    assert "axis.x" not in said


def test_a_port_that_cannot_be_made_ends_it_with_one_line(configuration: Path) -> None:
    (configuration.parent / "ttyDrives").touch()
    result = CliRunner().invoke(app, ["simulate", str(configuration)])
    assert result.exit_code == 1
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"{configuration}: {configuration.parent}/ttyDrives exists")


def test_a_configuration_with_errors_ends_it_with_a_line_for_each(tmp_path: Path) -> None:
    path = tmp_path / "gateway.toml"
    path.write_text("[gateway]\nnmae = 'x'\n", encoding="utf-8")
    result = CliRunner().invoke(app, ["simulate", str(path)])
    assert result.exit_code == 1
    assert "nmae" in result.stderr


def test_a_configuration_that_is_not_there_is_named(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["simulate", str(tmp_path / "none.toml")])
    assert result.exit_code == 1
    assert "none.toml" in result.stderr


async def test_an_axis_with_a_profile_is_played_by_that_drive(tmp_path: Path, unused_tcp_port: int) -> None:
    text = gateway_toml(
        line(unused_tcp_port, {"plc": 1}),
        axis(registers=None, unit_id=255, travel=None, drive="mitsubishi-mr-je-c", compensation="off"),
    )
    path = written(tmp_path, text, {})
    with started([*COMMAND_LINE, str(path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline().strip() for _ in range(4)]
        assert lines[1].endswith(", behaves as mitsubishi-mr-je-c")
        async with ModbusMaster(TcpEndpoint("127.0.0.1", unused_tcp_port), 5000.0) as master:
            # Half of an object of two words, at its one address.
            assert await master.exchange(255, pack(">BHH", 3, 0x6064, 1)) == b"\x83\x03"
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0
