"""Configurations of the gateway, as the bench needs them, with their tables."""

from dataclasses import dataclass
from math import sin
from pathlib import Path
from typing import Final

COUNTS_PER_MM: Final = 1000
TRAVEL_MM: Final = 100.0
COMMAND: Final = 100
"""Address of the position that ``load`` writes: 32 bits, high word first; 0 to 100 000 counts."""


@dataclass(frozen=True, slots=True)
class Controller:
    """Where a controller comes in: a TCP port, or the path of a serial port."""

    tcp_port: int | None = None
    tty: str | None = None


@dataclass(frozen=True, slots=True)
class LineSetup:
    """One line: its controllers, and its drives at a TCP port or on a serial port."""

    controllers: tuple[Controller, ...]
    drive_port: int | None = None
    drive_tty: str | None = None
    axes: int = 1
    baudrate: int = 115200
    cuts_through: bool = False


@dataclass(frozen=True, slots=True)
class GatewaySetup:
    """A whole gateway. ``points``: of the table of every axis, 0: no table."""

    lines: tuple[LineSetup, ...]
    points: int = 201
    fifo: int | None = None
    cpus: tuple[int, ...] = ()
    http_port: int | None = None
    mqtt_port: int | None = None
    name: str = "bench"
    mqtt: str = ""
    """Further lines of ``[mqtt]``."""


TABLE: Final = "bench.tab"


def write_setup(folder: Path, setup: GatewaySetup) -> Path:
    """Write configuration and table into a folder; returns the path of the configuration."""
    (folder / "tables").mkdir(parents=True, exist_ok=True)
    if setup.points:
        (folder / "tables" / TABLE).write_text(table_text(setup.points))
    config = folder / "gateway.toml"
    config.write_text(config_text(setup))
    return config


def forward_mm(x_mm: float) -> float:
    """Return what the table adds to a position while the axis goes forward: a worn screw, 0.05 mm at most."""
    return 0.02 * sin(x_mm / 17) + 0.0003 * x_mm


def table_text(points: int, scale: float = 1.0) -> str:
    """Return a table over the whole travel, in the dialect ``centroid-3``.

    ``scale`` makes another table of the same kind.
    """
    step = TRAVEL_MM / (points - 1)
    lines = [
        "CNC10 TAB FILE VERSION 3",
        "AXIS X",
        "UNITS MILLIMETER",
        f"INTERVAL {step:.9g}",
        f"ENTRIES {points}",
    ]
    for i in range(points):
        x = i * step
        forward = scale * forward_mm(x)
        lines.append(f"\t{x:+.8f}\t{forward:+.8f}\t{forward - 0.008 * scale:+.8f}")
    return "\n".join(lines) + "\n"


def config_text(setup: GatewaySetup) -> str:
    """Return the configuration as TOML."""
    parts = [f'[gateway]\nname = "{setup.name}"\n']
    if setup.fifo is not None:
        cpus = list(setup.cpus)
        parts.append(f"[relay]\nfifo = {setup.fifo}\ncpus = {cpus}\nlock_memory = true\n")
    page = "" if setup.http_port is None else f"127.0.0.1:{setup.http_port}"
    parts.append(f'[http]\nlisten = "{page}"\n')
    if setup.mqtt_port is not None:
        parts.append(f'[mqtt]\nhost = "127.0.0.1"\nport = {setup.mqtt_port}\n{setup.mqtt}')
    for number, line in enumerate(setup.lines, start=1):
        parts.append(_line_text(f"line{number}", line))
        parts += [_axis_text(number, unit, bool(setup.points)) for unit in range(1, line.axes + 1)]
    return "\n".join(parts)


def _line_text(name: str, line: LineSetup) -> str:
    serial = f"baudrate = {line.baudrate}"
    drives = (
        f'{{ rtu = "{line.drive_tty}", {serial} }}'
        if line.drive_tty
        else f'{{ tcp = "127.0.0.1:{line.drive_port}" }}'
    )
    text = [f"[line.{name}]", f"drives = {drives}"]
    text += ["cut_through = true", ""] if line.cuts_through else [""]
    for number, controller in enumerate(line.controllers, start=1):
        text += [f"[[line.{name}.controllers]]", f'name = "cnc{number}"']
        text += [f'rtu = "{controller.tty}"', serial] if controller.tty else []
        if controller.tcp_port:
            text += [f'tcp = "127.0.0.1:{controller.tcp_port}"', "connects_per_s = 1000000"]
        text.append("")
    return "\n".join(text)


def _axis_text(line: int, unit: int, has_table: bool) -> str:
    name = f"a{line}-{unit}"
    table = [f'table = "{TABLE}"'] if has_table else []
    return "\n".join([
        f"[axis.{name}]",
        f'line = "line{line}"',
        f"unit_id = {unit}",
        'units = "mm"',
        f"counts_per_unit = {COUNTS_PER_MM}.0",
        f"travel = [0.0, {TRAVEL_MM}]",
        'referenced = "absolute"',
        'compensation = "on"',
        'setpoints = "stream"',
        'writers = "any"',
        *table,
        "",
        f"[axis.{name}.registers]",
        f'command = [{{ address = {COMMAND}, type = "int32" }}]',
        "",
    ])  # fmt: skip
