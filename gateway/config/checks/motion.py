"""Motion: what registers mean, how an axis is referenced, which deadlines apply."""

from typing import Final

from gateway.compensation.settings import Setpoints
from gateway.config.axis_model import AddedFrames, AxisSection, Unmapped
from gateway.config.checks.lines import controller_key
from gateway.config.findings import Findings
from gateway.config.line_model import Connect, LineSection
from gateway.config.sections import Sections
from gateway.config.toml import KeyPath
from gateway.drives.motion import Action
from gateway.drives.profile import motion_faults
from gateway.drives.registers import DoneMeans, RegisterMap
from gateway.drives.rule_keys import rule_key
from gateway.exchange.plan import Reference, Role

# --- Whether an axis can be moved as its registers and other keys say, profiles included

RELATIVE: Final = (Action.RELATIVE, Action.RELATIVE_TO_COMMANDED, Action.RELATIVE_TO_ACTUAL)


def check_motion(findings: Findings, sections: Sections) -> None:
    """Check every axis whose registers are known.

    An axis without a table and without a backlash passes 1:1. It gets no warnings about corrections.
    """
    for name, axis in (sections.axes | sections.partial_axes).items():
        registers = axis.registers
        if registers is None:
            continue
        path = ("axis", name)
        for fault in motion_faults(registers):
            findings.refuse((*path, "registers", *fault.path), fault.found, fault.remedy)
        _check_stops(findings, path, registers)
        if axis.is_corrected:
            _check_relative(findings, path, axis, registers)
            _check_rewriting(findings, path, axis, registers)
            _check_stream(findings, path, axis, registers)
            _check_arrival(findings, path, axis, registers)


def _check_arrival(findings: Findings, path: KeyPath, axis: AxisSection, registers: RegisterMap) -> None:
    """Warn if nothing reports the arrival of an axis."""
    is_near_only = registers.done_means is DoneMeans.IN_POSITION and registers.bits.done is not None
    if axis.setpoints is Setpoints.TARGETS and is_near_only and not registers.actual:
        findings.warn(
            (*path, "registers", "done_means"),
            'done_means = "in-position", but no actual position is mapped',
            "map actual: otherwise the gateway cannot see that the axis has arrived, and assumes the "
            "direction of its moves",
        )


def _check_stops(findings: Findings, path: KeyPath, registers: RegisterMap) -> None:
    if registers.trigger and rule_key(registers, Action.STOP) is None:
        findings.warn(
            (*path, "registers", "trigger"),
            "no value is listed that stops the axis",
            "list its value under stop: otherwise a stop cannot go before other requests, and withdraws "
            "none of them",
        )


def _check_relative(findings: Findings, path: KeyPath, axis: AxisSection, registers: RegisterMap) -> None:
    """Warn if the start of a relative move is unknown after anything but a target."""
    key = rule_key(registers, *RELATIVE)
    if key is None or axis.relative_unknown is Unmapped.PASS:
        return
    lack, do = _lack_of_base(axis, registers)
    if lack:
        findings.warn(
            (*path, "registers", *key),
            f"relative moves, but {lack}",
            f"after a stop, a jog or homing they are refused until an absolute move is accepted; {do}",
        )


def _lack_of_base(axis: AxisSection, registers: RegisterMap) -> tuple[str, str]:
    """Return what is missing to read the position of an axis, and what to do; empty if nothing is missing."""
    if axis.added_frames is AddedFrames.NEVER:
        return (
            'added_frames = "never" does not allow the gateway to read the position at standstill',
            'allowed for it: "auto"',
        )
    if not registers.safe_read:
        return (
            "safe_read = false does not allow the gateway to read the position at standstill",
            "allow safe_read if the drive does",
        )
    reported = (*registers.commanded, *registers.actual)
    if not reported:
        return "neither commanded nor actual is mapped", "map one of them"
    if not any(
        fields and fields[0].field().is_readable for fields in (registers.commanded, registers.actual)
    ):
        return (
            "commanded and actual cannot be read with a request of their own",
            'map one of them without access = "write", and without block or with its own address there',
        )
    if registers.bits.done is None and registers.bits.moving is None:
        return (
            "neither bits.done nor bits.moving is mapped: the gateway cannot see that the axis is at "
            "standstill"
        ), "map one"
    return "", ""


def _check_rewriting(findings: Findings, path: KeyPath, axis: AxisSection, registers: RegisterMap) -> None:
    if registers.staged and axis.added_frames is AddedFrames.NEVER:
        findings.warn(
            (*path, "added_frames"),
            'added_frames = "never" with targets that wait for a trigger',
            'allow "auto": otherwise a trigger is refused if the correction has changed since its target '
            "was written",
        )


def _check_stream(findings: Findings, path: KeyPath, axis: AxisSection, registers: RegisterMap) -> None:
    if axis.setpoints is not Setpoints.STREAM or not registers.staged:
        return
    if rule_key(registers, Action.FOLLOW, Action.FOLLOW_NEXT) is None:
        findings.warn(
            (*path, "setpoints"),
            'setpoints = "stream", but the drive waits for a trigger after each target',
            "list under follow the value that makes the drive go to each target when it is written, or use "
            '"targets"; now every setpoint needs its own trigger',
        )


# --- Whether the registers of an axis can show what ``referenced`` claims

_WORDS: Final = {
    Reference.ABSOLUTE: '"absolute" (an absolute encoder)',
    Reference.DRIVE_BIT: '"drive-bit"',
    Reference.HOMING: '"homing"',
    Reference.SET_POSITION: '"set-position"',
}


def check_references(findings: Findings, sections: Sections) -> None:
    """Check how each axis reports that it is referenced."""
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
    """A reference that only the gateway observed is lost while the gateway is disconnected."""
    line = sections.lines.get(axis.line)
    is_on_demand = line is not None and line.connect is Connect.ON_DEMAND
    if is_on_demand and axis.referenced in (Reference.HOMING, Reference.SET_POSITION):
        found = (
            f'connect = "on-demand" with axis {name}, which has referenced = "{axis.referenced.value}": '
            "the gateway would not notice that its drive was switched off"
        )
        findings.refuse(
            ("line", axis.line, "connect"),
            found,
            'remove it, or use a bit of the drive that says that it is homed (referenced = "drive-bit")',
        )


def _lacks(way: Reference, registers: RegisterMap) -> list[tuple[str, str]]:
    """Return what a method needs and these registers do not have, each with what to do."""
    bits = registers.bits
    lacks = []
    if way is Reference.DRIVE_BIT and bits.homed is None:
        lacks.append(("without registers.bits.homed", "name the bit that says that the drive is homed"))
    if way is Reference.HOMING:
        if rule_key(registers, Action.HOME) is None:
            what = "and no value of registers.mode or registers.trigger homes"
            lacks.append((what, "list the value that homes the axis under home"))
        if bits.homed is None and bits.homing_done is None and bits.done is None:
            what = "without registers.bits.homed, registers.bits.homing_done or registers.bits.done"
            lacks.append((what, "name the bit that says that homing has ended"))
    if way is Reference.SET_POSITION and not _sets_position(registers):
        what = "and nothing in registers sets a position"
        do = "list the value that does under set_position of a trigger, or mark an actual with set_position"
        lacks.append((what, do))
    return lacks


def _sets_position(registers: RegisterMap) -> bool:
    by_value = rule_key(registers, Action.SET_POSITION) is not None
    return by_value or any(position.set_position for position in registers.actual)


def _others(way: Reference, registers: RegisterMap) -> str:
    can = [_WORDS[other] for other in Reference if other is not way and not _lacks(other, registers)]
    return f"with these registers it may be {' or '.join(can)}"


def _check_reading(findings: Findings, path: KeyPath, axis: AxisSection, registers: RegisterMap) -> None:
    if not registers.safe_read or axis.added_frames is AddedFrames.NEVER:
        findings.warn(
            path,
            "the gateway may not read the homed bit itself",
            "allow safe_read and added_frames: otherwise the axis stays uncorrected until a controller "
            "reads that register",
        )


# --- Deadlines and waiting times: keys that only have a meaning together with others


def check_late(findings: Findings, sections: Sections) -> None:
    """Check the deadlines of all axes and the waiting times of all monitors."""
    for name, axis in (sections.axes | sections.partial_axes).items():
        path = ("axis", name)
        if axis.late is None or axis.deadline_ms is not None or findings.is_refused((*path, "deadline_ms")):
            continue
        findings.refuse(
            (*path, "late"),
            f'late = "{axis.late.value}" without deadline_ms',
            "give deadline_ms, the age in milliseconds at which a target is late, or remove late",
        )
    for name, line in sections.lines.items():
        _check_monitors(findings, name, line)


def _check_monitors(findings: Findings, name: str, line: LineSection) -> None:
    """Warn if a request of a monitor can wait longer than the monitor's timeout."""
    if all(Role.MOTION not in controller.roles_in_use for controller in line.controllers):
        return  # no motion controller to wait for
    for index, controller in enumerate(line.controllers):
        least = controller.roles_in_use[-1]
        if least is Role.MOTION or line.monitor_max_wait_ms < controller.timeout_ms:
            continue
        findings.warn(
            (*controller_key(findings, name, controller.name, index), "timeout_ms"),
            f"timeout_ms = {controller.timeout_ms:g} of a {least.value} that may have to wait "
            f"monitor_max_wait_ms = {line.monitor_max_wait_ms:g} for motion",
            f"set line.{name}.monitor_max_wait_ms well below {controller.timeout_ms:g}, or let the "
            "controller wait longer: on a busy line it would give up",
        )
