"""What the arithmetic of time says about a configuration: a limit that no line can meet is wrong."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from gateway.budget.verdict import Grade, Judgement, judge
from gateway.config.build import line_plan
from gateway.config.check_lines import controller_key
from gateway.config.document import read_document
from gateway.config.drive_files import NamedProfile
from gateway.config.findings import Findings
from gateway.config.sections import Sections
from gateway.config.tables import AxisTable
from gateway.config.toml_lines import KeyPath


def check_budget(
    findings: Findings,
    sections: Sections,
    tables: Mapping[str, AxisTable],
    drives: Mapping[str, NamedProfile],
) -> None:
    """Check the times of every line of which everything else is good; a wrong one has no times yet."""
    for name in sections.lines:
        axes = {axis_name: axis for axis_name, axis in sections.axes.items() if axis.line == name}
        keys: list[KeyPath] = [("line", name), *(("axis", axis_name) for axis_name in axes)]
        if any(map(findings.is_refused, keys)) or any(axis.registers is None for axis in axes.values()):
            continue
        for judgement in judge(line_plan(name, sections, tables, drives)):
            _note(findings, sections, judgement)


def _note(findings: Findings, sections: Sections, judgement: Judgement) -> None:
    key = judgement.key
    if key[0] == "line" and key[2] == "controllers":
        _, line, _, index, *rest = key
        assert isinstance(line, str)
        assert isinstance(index, int)
        controller = sections.lines[line].controllers[index]
        key = (*controller_key(findings, line, controller.name, index), *rest)
    if judgement.grade is Grade.IMPOSSIBLE:
        findings.refuse(key, judgement.found, judgement.remedy)
    elif judgement.grade is Grade.CLOSE:
        findings.warn(key, judgement.found, judgement.remedy)


def findings_of(path: Path, judgements: Iterable[Judgement]) -> Findings:
    """Return what was judged with its place in a configuration that could be loaded; notes are warnings.

    Raises:
        ConfigErrors: the file can no longer be read.
    """
    findings = Findings(read_document(path))
    for judgement in judgements:
        note = findings.refuse if judgement.grade is Grade.IMPOSSIBLE else findings.warn
        note(judgement.key, judgement.found, judgement.remedy)
    return findings
