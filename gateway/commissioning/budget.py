"""The shortest cycle time of a gateway's lines, calculated before any wiring."""

from collections.abc import Mapping
from dataclasses import dataclass

from gateway.budget.as_data import line_data, remedy_data
from gateway.budget.line import LineBudget, line_budget
from gateway.budget.sequence import AS_MAPPED, Blocks, misfits
from gateway.budget.verdict import Grade, Remedy, judge, remedies
from gateway.config.findings import Findings
from gateway.config.load import Loaded
from gateway.config.problems import Problem
from gateway.plain import JsonObject
from gateway.state.plan import LinePlan


class MisfitError(Exception):
    """A drive does not accept such a block, so figures would be useless. ``problems``: the reason of each."""

    def __init__(self, problems: tuple[str, ...]) -> None:
        super().__init__("\n".join(problems))
        self.problems = problems


@dataclass(frozen=True, slots=True)
class LineFigures:
    """The figures of one line."""

    plan: LinePlan
    budget: LineBudget
    remedies: Mapping[str, tuple[Remedy, ...]]
    """Changes that would make it faster, by controller."""

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        of_controllers = {
            name: [remedy_data(each) for each in found] for name, found in self.remedies.items()
        }
        return {**line_data(self.budget), "remedies": of_controllers}


@dataclass(frozen=True, slots=True)
class Budget:
    """The figures of all lines."""

    gateway: str
    lines: tuple[LineFigures, ...]
    problems: tuple[Problem, ...]
    """Requirements that cannot be met."""
    warnings: tuple[Problem, ...]

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        return {
            "ok": not self.problems,
            "gateway": self.gateway,
            "lines": {line.plan.name: line.as_data() for line in self.lines},
            "problems": [problem.as_dict() for problem in self.problems],
            "warnings": [warning.as_dict() for warning in self.warnings],
        }


def work_out(loaded: Loaded, blocks: Blocks = AS_MAPPED) -> Budget:
    """Calculate the cycle times of the lines of a configuration.

    ``blocks``: registers that controllers read, and write targets to, beyond the mapped ones.

    Raises:
        MisfitError: a drive does not accept such a block.
    """
    plan = loaded.plan
    wrong = tuple(misfit for line in plan.lines for axis in line.axes for misfit in misfits(axis, blocks))
    if wrong:
        raise MisfitError(wrong)
    findings = Findings(loaded.document)
    for line in plan.lines:
        for judgement in judge(line, blocks):
            report = findings.refuse if judgement.grade is Grade.IMPOSSIBLE else findings.warn
            report(judgement.key, judgement.found, judgement.remedy)
    return Budget(
        plan.name,
        tuple(_figures(line, blocks) for line in plan.lines),
        tuple(findings.problems),
        tuple(findings.warnings),
    )


def _figures(plan: LinePlan, blocks: Blocks) -> LineFigures:
    found = {link.plan.name: remedies(plan, index, blocks) for index, link in enumerate(plan.controllers)}
    return LineFigures(plan, line_budget(plan, blocks), found)
