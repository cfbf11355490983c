"""Whether the drives that the profiles describe can be what the lines lead to."""

from collections.abc import Mapping

from gateway.config.drive_files import NamedProfile
from gateway.config.findings import Findings
from gateway.config.line_model import LineSection
from gateway.config.sections import Sections
from gateway.drives.profile import Transport


def check_drives(findings: Findings, sections: Sections, drives: Mapping[str, NamedProfile]) -> None:
    """Warn where a line is of a kind that its drive does not have, and of unit ids that it cannot have."""
    for name, drive in drives.items():
        axis = (sections.axes | sections.partial_axes)[name]
        taken = drive.profile.unit_id_range
        if taken is not None and not taken[0] <= axis.unit_id <= taken[1]:
            only = f"{taken[0]} to {taken[1]}" if taken[0] < taken[1] else f"{taken[0]} only"
            findings.warn(
                ("axis", name, "unit_id"),
                f"{drive.name} takes unit ids {only}, not {axis.unit_id}",
                "set it to what stands in the drive",
            )
        line = sections.lines.get(axis.line)
        if line is None or not drive.profile.transports or _transport(line) in drive.profile.transports:
            continue
        findings.warn(
            ("axis", name, "drive"),
            f"{drive.name} speaks {_spoken(drive.profile.transports)}, "
            f"and the drives of line {axis.line} are on {_spoken((_transport(line),))}",
            "check the line; a converter between the two in front of the drive is fine",
        )


def _transport(line: LineSection) -> Transport:
    return Transport.RTU if line.drives.tcp is None else Transport.TCP


def _spoken(transports: tuple[Transport, ...]) -> str:
    return " and ".join(f"Modbus {transport.value.upper()}" for transport in transports)
