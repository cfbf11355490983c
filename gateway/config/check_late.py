"""What is late, and who may wait how long: keys that mean something only beside others."""

from gateway.config.check_lines import controller_key
from gateway.config.findings import Findings
from gateway.config.line_model import LineSection
from gateway.config.sections import Sections
from gateway.exchange.plan import Role


def check_late(findings: Findings, sections: Sections) -> None:
    """Check the deadlines of all axes and the waiting of all monitors."""
    for name, axis in (sections.axes | sections.partial_axes).items():
        path = ("axis", name)
        if axis.late is None or axis.deadline_ms is not None or findings.is_refused((*path, "deadline_ms")):
            continue
        findings.refuse(
            (*path, "late"),
            f'late = "{axis.late.value}" without deadline_ms',
            "give deadline_ms, the age in milliseconds at which a target is late, or leave late out",
        )
    for name, line in sections.lines.items():
        _check_monitors(findings, name, line)


def _check_monitors(findings: Findings, name: str, line: LineSection) -> None:
    """Warn where a request of a monitor can wait until the monitor has given up on it."""
    if all(Role.MOTION not in controller.roles_in_use for controller in line.controllers):
        return  # nobody to wait for
    for index, controller in enumerate(line.controllers):
        least = controller.roles_in_use[-1]
        if least is Role.MOTION or line.monitor_max_wait_ms < controller.timeout_ms:
            continue
        findings.warn(
            (*controller_key(findings, name, controller.name, index), "timeout_ms"),
            f"timeout_ms = {controller.timeout_ms:g} of a {least.value} that may have to wait "
            f"monitor_max_wait_ms = {line.monitor_max_wait_ms:g} for motion",
            f"it would give up on a busy line: set line.{name}.monitor_max_wait_ms well below "
            f"{controller.timeout_ms:g}, or let it wait longer",
        )
