"""Whether somebody else may change what decides where axes go: the configuration, its tables and profiles."""

import stat
from collections.abc import Iterator, Mapping
from pathlib import Path

from gateway.config.crosses import Crosses
from gateway.config.drive_files import NamedProfile
from gateway.config.findings import Findings
from gateway.config.readings import TableReading
from gateway.config.toml_lines import KeyPath
from gateway.state.folder import why_open_to_others


def check_open_files(
    findings: Findings,
    tables_folder: Path,
    readings: Mapping[str, TableReading],
    drives: Mapping[str, NamedProfile],
    crosses: Crosses,
) -> None:
    """Warn of each file that every user may write to, and of each folder in which he may replace one."""
    config = findings.document.path
    found: dict[Path, KeyPath] = {config.parent: (), config: (), tables_folder: ("gateway", "tables")}
    for path, key in _named(config, readings, drives, crosses):
        found.setdefault(path, key)
    for path, key in found.items():
        warning = None if _is_kept_apart(path) else why_open_to_others(path, None)
        if warning is not None:
            findings.warn(key, warning.found, warning.remedy)


def _named(
    config: Path,
    readings: Mapping[str, TableReading],
    drives: Mapping[str, NamedProfile],
    crosses: Crosses,
) -> Iterator[tuple[Path, KeyPath]]:
    for axis, reading in readings.items():
        yield reading.path, ("axis", axis, "table")
    for axis, each in crosses.items():
        for index, cross in enumerate(each):
            yield cross.path, ("axis", axis, "cross", index, "table")
    for axis, drive in drives.items():
        if not drive.is_shipped:
            yield config.parent / drive.name, ("axis", axis, "drive")


def _is_kept_apart(path: Path) -> bool:
    """Whether it is a folder as /tmp, in which nobody may replace or remove what belongs to another user."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return True
    return stat.S_ISDIR(mode) and bool(mode & stat.S_ISVTX)
