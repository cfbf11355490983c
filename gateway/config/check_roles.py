"""Whether the controllers of a line can do what their role lets them do."""

from gateway.config.check_lines import controller_key
from gateway.config.findings import Findings
from gateway.config.sections import Sections
from gateway.drives.meanings import rule_meaning
from gateway.drives.motion import Action
from gateway.exchange.plan import Role


def check_roles(findings: Findings, sections: Sections) -> None:
    """Warn of an operator on a line where nothing tells a stop from another write."""
    with_stops = {
        axis.line
        for axis in (sections.axes | sections.partial_axes).values()
        if axis.registers is not None and rule_meaning(axis.registers, Action.STOP) is not None
    }
    for name, line in sections.lines.items():
        for index, controller in enumerate(line.controllers):
            key = controller_key(findings, name, controller.name, index)
            places = {(*key, "roles", given): each.role for given, each in controller.roles.items()}
            for place, role in (places or {key: controller.role}).items():
                if role is not Role.OPERATOR or name in with_stops:
                    continue
                findings.warn(
                    (*place, "role"),
                    'role = "operator", and the registers of no axis of this line list a stop',
                    "it may only read here; list the values under stop in mode or trigger, or write "
                    '"monitor"',
                )
