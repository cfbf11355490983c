"""What became of the table that an axis names: read and checked, refused, switched off, or not there."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gateway.config.axis_model import AxisSection
from gateway.config.check_tables import check_table
from gateway.config.findings import Findings
from gateway.config.problems import Problem, in_file_order
from gateway.config.sections import Sections
from gateway.config.tables import AxisTable, find_file, read_file
from gateway.tabfile import TableState


@dataclass(frozen=True, slots=True)
class TableReading:
    """The table of one axis, as far as it could be had, with everything that was found on the way."""

    axis: str
    name: str
    """Of the file, as the configuration has it."""
    path: Path
    """Where the file is, or would be."""
    state: TableState | None
    """Whether it is there; None where that cannot be told, as in a folder that cannot be read."""
    table: AxisTable | None
    """None where it is not there, or anything is wrong with it."""
    findings: Findings

    @property
    def problems(self) -> Sequence[Problem]:
        """What is wrong with it."""
        return in_file_order(self.findings.problems, str(self.findings.document.path))

    @property
    def is_absent(self) -> bool:
        """Whether there is certainly no such file: taken away, or switched off by its name."""
        return self.state in {TableState.MISSING, TableState.OFF}


def read_tables(findings: Findings, sections: Sections, folder: Path) -> dict[str, TableReading]:
    """Read and check the table of every axis that names one.

    What is found stays with each reading (``Findings.include`` takes it over), so that a bad file of one axis
    need not keep the others from theirs.
    """
    return {
        name: _reading(findings.part(), sections, folder, name, axis)
        for name, axis in (sections.axes | sections.partial_axes).items()
        if axis.table is not None
    }


def _reading(part: Findings, sections: Sections, folder: Path, name: str, axis: AxisSection) -> TableReading:
    assert axis.table is not None, "only axes that name a table have a reading"
    key = ("axis", name, "table")
    found = find_file(part, key, folder, axis.table)
    path = folder / axis.table if found is None else found.path
    table: AxisTable | None = None
    # Without its scale and units an axis cannot say what a table means; that it is there can be said.
    if found is not None and found.state is TableState.PRESENT and name not in sections.partial_axes:
        table = read_file(part, key, path, axis, name)
    if table is not None:
        check_table(part, name, axis, table)
    is_good = not part.problems
    return TableReading(
        name, axis.table, path, None if found is None else found.state, table if is_good else None, part
    )
