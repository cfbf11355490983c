"""Whether an axis can be moved the way its registers and its other keys say; profiles are looked at too."""

from typing import Final

from gateway.compensation.settings import Setpoints
from gateway.config.axis_model import AddedFrames, AxisSection, Unmapped
from gateway.config.findings import Findings
from gateway.config.sections import Sections
from gateway.config.toml_lines import KeyPath
from gateway.drives.meanings import rule_meaning
from gateway.drives.motion import Action
from gateway.drives.profile import motion_faults
from gateway.drives.registers import DoneMeans, RegisterMap

RELATIVE: Final = (Action.RELATIVE, Action.RELATIVE_TO_COMMANDED, Action.RELATIVE_TO_ACTUAL)


def check_motion(findings: Findings, sections: Sections) -> None:
    """Check every axis whose registers are known.

    An axis without a table and a backlash passes 1:1: of what concerns corrections it is not warned.
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
            _check_restaging(findings, path, axis, registers)
            _check_stream(findings, path, axis, registers)
            _check_arrival(findings, path, axis, registers)


def _check_arrival(findings: Findings, path: KeyPath, axis: AxisSection, registers: RegisterMap) -> None:
    """Warn where nothing ever tells that an axis has arrived."""
    is_near_only = registers.done_means is DoneMeans.IN_POSITION and registers.bits.done is not None
    if axis.setpoints is Setpoints.TARGETS and is_near_only and not registers.actual:
        findings.warn(
            (*path, "registers", "done_means"),
            'done_means = "in-position", and no actual position is mapped',
            "nothing tells that the axis has arrived: the direction of its moves is assumed; map actual",
        )


def _check_stops(findings: Findings, path: KeyPath, registers: RegisterMap) -> None:
    if registers.trigger and rule_meaning(registers, Action.STOP) is None:
        findings.warn(
            (*path, "registers", "trigger"),
            "no value is listed that stops the axis",
            "a stop cannot go before other requests, and withdraws none of them; list its value under stop",
        )


def _check_relative(findings: Findings, path: KeyPath, axis: AxisSection, registers: RegisterMap) -> None:
    """Warn where nothing tells where a relative move starts after something else than a target."""
    key = rule_meaning(registers, *RELATIVE)
    if key is None or axis.relative_unknown is Unmapped.PASS:
        return
    lack, do = _lack_of_base(axis, registers)
    if lack:
        findings.warn(
            (*path, "registers", *key),
            f"relative moves, and {lack}",
            f"after a stop, a jog or homing they are refused until an absolute move was accepted; {do}",
        )


def _lack_of_base(axis: AxisSection, registers: RegisterMap) -> tuple[str, str]:
    """Return what is missing to read where an axis stands, and what to do; empty when nothing is."""
    if axis.added_frames is AddedFrames.NEVER:
        return 'added_frames = "never" forbids to read where the axis stands', 'allowed for it: "auto"'
    if not registers.safe_read:
        return "safe_read = false forbids to read where the axis stands", "allow safe_read if the drive does"
    reported = (*registers.commanded, *registers.actual)
    if not reported:
        return "neither commanded nor actual is mapped", "map one of them"
    if not any(
        fields and fields[0].field().is_readable for fields in (registers.commanded, registers.actual)
    ):
        return (
            "no read of its own registers brings commanded or actual",
            'map one of them without access = "write", and without block or with its own address there',
        )
    if registers.bits.done is None and registers.bits.moving is None:
        return "neither bits.done nor bits.moving is mapped: nothing tells that the axis stands", "map one"
    return "", ""


def _check_restaging(findings: Findings, path: KeyPath, axis: AxisSection, registers: RegisterMap) -> None:
    if registers.staged and axis.added_frames is AddedFrames.NEVER:
        findings.warn(
            (*path, "added_frames"),
            'added_frames = "never" with targets that wait for a trigger',
            "a trigger is refused whenever the correction has changed since its target was written; "
            'allow "auto"',
        )


def _check_stream(findings: Findings, path: KeyPath, axis: AxisSection, registers: RegisterMap) -> None:
    if axis.setpoints is not Setpoints.STREAM or not registers.staged:
        return
    if rule_meaning(registers, Action.FOLLOW, Action.FOLLOW_NEXT) is None:
        findings.warn(
            (*path, "setpoints"),
            'setpoints = "stream", and the drive waits for a trigger after each target',
            "every setpoint needs a trigger of its own; list under follow the value that makes the drive go "
            'to each target as it is written, or use "targets"',
        )
