"""What a retrofitter would write for this machine: gateway.toml and one .tab file for each axis."""

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from gateway.cli.demonstration.rig import PATIENCE_MS, RigAxis
from gateway.cli.demonstration.spec import AxisSpec, Cable
from gateway.compensation.table import CorrectionTable
from gateway.modbus.registers import BitField, PositionField
from gateway.tabfile import WriteOptions, dialect_named

CONFIGURATION_NAME: Final = "gateway.toml"
TABLES_FOLDER: Final = "tables"
TABLE_FORMAT: Final = "centroid-3"

_HEAD: Final = """\
# Written by pitch-gateway demo. Ports and device paths belong to that one run.
[gateway]
name = "demo"
tables = "{tables}"

[http]
listen = ""
"""
_LINE: Final = """
[line.{name}]
drives = {{ {drive} = "{drive_address}" }}
response_timeout_ms = {patience_ms}

[[line.{name}.controllers]]
name = "controller-{name}"
{controller} = "{controller_address}"
timeout_ms = {patience_ms}
"""
_AXIS: Final = """
[axis.{name}]
line = "{name}"
unit_id = {unit_id}
units = "{units}"
counts_per_unit = {counts_per_unit}
zero_counts = {zero_counts}
travel = [{low}, {high}]
referenced = "drive-bit"
home_approach = "{home_approach}"
"""
_REGISTERS: Final = """
[axis.{name}.registers]
command = [{command}]
actual = [{actual}]
bits = {{ {bits} }}
"""


def table_name(spec: AxisSpec) -> str:
    """File name of an axis's table, as the old control would look for it."""
    return f"cnc10{spec.name}.tab"


def write_table(folder: Path, axis: RigAxis, table: CorrectionTable) -> Path:
    """Write a table as a Centroid version 3 file and return its path."""
    path = folder / TABLES_FOLDER / table_name(axis.spec)
    path.parent.mkdir(parents=True, exist_ok=True)
    text = dialect_named(TABLE_FORMAT).write(table, WriteOptions(axis=axis.spec.name)).text
    path.write_text(text, encoding="ascii")
    return path


def write_configuration(folder: Path, axes: Iterable[RigAxis], *, corrected: bool) -> Path:
    """Write gateway.toml, with the tables in use or without, and return its path."""
    text = _HEAD.format(tables=TABLES_FOLDER)
    for axis in axes:
        text += _line(axis) + _axis(axis, corrected=corrected) + _registers(axis)
    path = folder / CONFIGURATION_NAME
    path.write_text(text, encoding="utf-8")
    return path


def _line(axis: RigAxis) -> str:
    spec = axis.spec
    rtu = '", baudrate = 115200, parity = "even'
    drive_address = axis.drive_address + (rtu if spec.drive is Cable.RTU else "")
    line = _LINE.format(
        name=spec.name,
        drive=spec.drive.value,
        drive_address=drive_address,
        controller=spec.controller.value,
        controller_address=axis.controller_address,
        patience_ms=PATIENCE_MS,
    )
    return line + ('baudrate = 38400\nparity = "even"\n' if spec.controller is Cable.RTU else "")


def _axis(axis: RigAxis, *, corrected: bool) -> str:
    spec = axis.spec
    margin = 2 * spec.overrun
    text = _AXIS.format(
        name=spec.name,
        unit_id=spec.unit_id,
        units=spec.units.value,
        counts_per_unit=spec.counts_per_unit,
        zero_counts=spec.zero_counts,
        low=spec.low - margin,
        high=spec.high + margin,
        home_approach=spec.home_direction.name.lower(),
    )
    if corrected:
        return text + f'table = "{table_name(axis.spec)}"\ncompensation = "on"\n'
    return text + 'compensation = "off"\n'


def _registers(axis: RigAxis) -> str:
    registers = axis.spec.registers
    return _REGISTERS.format(
        name=axis.spec.name,
        command=_position(registers.command[0]),
        actual=_position(registers.actual[0]),
        bits=", ".join(f"{name} = {_bit(bit)}" for name, bit in registers.bits.items()),
    )


def _position(field: PositionField) -> str:
    return f'{{ address = {field.address:#06x}, type = "{field.type.value}", words = "{field.order.value}" }}'


def _bit(bit: BitField) -> str:
    return f"{{ address = {bit.address:#06x}, bit = {bit.bit} }}"
