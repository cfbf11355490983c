"""Whether the registers of an axis can show what ``referenced`` says they show."""

from typing import Final

from gateway.config.axis_model import AddedFrames, AxisSection
from gateway.config.findings import Findings
from gateway.config.line_model import Connect
from gateway.config.sections import Sections
from gateway.config.toml_lines import KeyPath
from gateway.drives.meanings import rule_meaning
from gateway.drives.motion import Action
from gateway.drives.registers import RegisterMap
from gateway.exchange.plan import Reference

_WORDS: Final = {
    Reference.ABSOLUTE: '"absolute" (an absolute encoder)',
    Reference.DRIVE_BIT: '"drive-bit"',
    Reference.HOMING: '"homing"',
    Reference.SET_POSITION: '"set-position"',
}


def check_references(findings: Findings, sections: Sections) -> None:
    """Check of every axis how it is known that it knows where it is."""
    for name, axis in (sections.axes | sections.partial_axes).items():
        if axis.registers is None:
            continue
        _check_connection(findings, sections, name, axis)
        path = ("axis", name, "referenced")
        for lack, remedy in _lacks(axis.referenced, axis.registers):
            found = f'referenced = "{axis.referenced.value}" {lack}'
            findings.refuse(path, found, f"{remedy}; {_others(axis.referenced, axis.registers)}")
        if axis.referenced is Reference.DRIVE_BIT and axis.registers.bits.homed is not None:
            _check_reading(findings, path, axis, axis.registers)


def _check_connection(findings: Findings, sections: Sections, name: str, axis: AxisSection) -> None:
    """What only the gateway has seen counts no more where it does not look."""
    line = sections.lines.get(axis.line)
    is_on_demand = line is not None and line.connect is Connect.ON_DEMAND
    if is_on_demand and axis.referenced in (Reference.HOMING, Reference.SET_POSITION):
        found = (
            f'connect = "on-demand" with axis {name}, which has referenced = "{axis.referenced.value}": '
            "nobody would see that its drive was switched off"
        )
        findings.refuse(
            ("line", axis.line, "connect"),
            found,
            'leave it out, or let a bit of the drive say that it is homed (referenced = "drive-bit")',
        )


def _lacks(way: Reference, registers: RegisterMap) -> list[tuple[str, str]]:
    """Return what a way needs and these registers do not say, each with what to do."""
    bits = registers.bits
    lacks = []
    if way is Reference.DRIVE_BIT and bits.homed is None:
        lacks.append(("without registers.bits.homed", "name the bit that says that the drive is homed"))
    if way is Reference.HOMING:
        if rule_meaning(registers, Action.HOME) is None:
            what = "and no value of registers.mode or registers.trigger homes"
            lacks.append((what, "list the value that homes the axis under home"))
        if bits.homed is None and bits.done is None:
            what = "without registers.bits.homed or registers.bits.done"
            lacks.append((what, "name the bit that tells that homing has ended"))
    if way is Reference.SET_POSITION and not _sets_position(registers):
        what = "and nothing in registers sets a position"
        do = "list the value that does under set_position of a trigger, or mark an actual with set_position"
        lacks.append((what, do))
    return lacks


def _sets_position(registers: RegisterMap) -> bool:
    by_value = rule_meaning(registers, Action.SET_POSITION) is not None
    return by_value or any(position.set_position for position in registers.actual)


def _others(way: Reference, registers: RegisterMap) -> str:
    can = [_WORDS[other] for other in Reference if other is not way and not _lacks(other, registers)]
    return f"with these registers it may be {' or '.join(can)}"


def _check_reading(findings: Findings, path: KeyPath, axis: AxisSection, registers: RegisterMap) -> None:
    if not registers.safe_read or axis.added_frames is AddedFrames.NEVER:
        findings.warn(
            path,
            "the gateway may not read the homed bit itself",
            "the axis stays uncorrected until a controller reads that register; "
            "allow safe_read and added_frames",
        )
