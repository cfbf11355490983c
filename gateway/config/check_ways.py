"""Tables that must say exactly one way, looked at as they stand in the file.

The schema comes to such a rule only where every value of the table is good; here it is found beside them.
"""

from gateway.config.findings import Findings
from gateway.config.line_model import ControllerSection, DrivesEndpoint, broken_rule
from gateway.config.problems import shown
from gateway.config.toml_lines import KeyPath


def check_ways(findings: Findings) -> None:
    """Check the drives and the controllers of every line. What the schema reported too is one problem."""
    lines = findings.document.tables.get("line")
    for name, line in lines.items() if isinstance(lines, dict) else ():
        if not isinstance(line, dict):
            continue
        _check(findings, DrivesEndpoint, line.get("drives"), ("line", name, "drives"))
        controllers = line.get("controllers")
        for index, controller in enumerate(controllers if isinstance(controllers, list) else ()):
            _check(findings, ControllerSection, controller, ("line", name, "controllers", index))


def _check(
    findings: Findings, model: type[DrivesEndpoint | ControllerSection], raw: object, path: KeyPath
) -> None:
    rule = broken_rule(model, raw) if isinstance(raw, dict) else ""
    if rule:
        findings.refuse(path, f"found {shown(raw)}", rule)
