"""``pitch-gateway budget CONFIG``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.arguments import AsJson, Config
from gateway.cli.configuration import load_or_exit
from gateway.cli.output import print_json

if TYPE_CHECKING:
    from gateway.budget.sequence import Blocks
    from gateway.config.findings import Findings
    from gateway.state.plan import GatewayPlan

MOST_READ = 125
MOST_WRITTEN = 123


def budget(
    config: Config,
    *,
    registers: Annotated[
        int,
        typer.Option(
            min=0,
            max=MOST_READ,
            show_default=False,
            help="Registers of a block that the controller also reads from each drive in each round.",
        ),
    ] = 0,
    target_registers: Annotated[
        int,
        typer.Option(
            min=0,
            max=MOST_WRITTEN,
            show_default="as many as the position has",
            help="Registers of the block in which the controller writes a target.",
        ),
    ] = 0,
    as_json: AsJson = False,
) -> None:
    """Work out what cycle time each line can hold, before anything is wired.

    From baud rates, frames, silences and the gateway's own share (budget_us): each exchange leg by leg in
    milliseconds, a round over all axes, and the same without the gateway. What a drive takes itself is its
    response_ms; where that is not known, and for programs, 0 is reckoned with. docs/latency.md explains the
    columns.

    Exit code 1 when a timeout_ms or deadline_ms cannot be met.

    Examples:
        pitch-gateway budget gateway.toml

        pitch-gateway budget gateway.toml --registers 16

        pitch-gateway budget gateway.toml --json | jq '.lines[].controllers[].round.total_ms'
    """
    from gateway.budget.sequence import Blocks
    from gateway.budget.verdict import judge
    from gateway.config.checks.lines import findings_of

    plan = load_or_exit(config, checks_times=False).plan
    blocks = Blocks(registers, target_registers)
    _fit_or_exit(plan, blocks, config)
    findings = findings_of(config, [each for line in plan.lines for each in judge(line, blocks)])
    if as_json:
        _say_json(plan, blocks, findings)
    else:
        _say(plan, blocks, findings)
    if findings.problems:
        raise typer.Exit(1)


def _fit_or_exit(plan: "GatewayPlan", blocks: "Blocks", config: Path) -> None:
    """A block that a drive does not take would give figures for nothing."""
    from gateway.budget.sequence import misfits

    wrong = [said for line in plan.lines for axis in line.axes for said in misfits(axis, blocks)]
    for said in wrong:
        typer.echo(f"{config}: {said}", err=True)
    if wrong:
        raise typer.Exit(1)


def _say_json(plan: "GatewayPlan", blocks: "Blocks", findings: "Findings") -> None:
    from gateway.budget.as_data import line_data, remedy_data
    from gateway.budget.line import line_budget
    from gateway.budget.verdict import remedies

    lines = {
        line.name: {
            **line_data(line_budget(line, blocks)),
            "remedies": {
                link.plan.name: [remedy_data(each) for each in remedies(line, index, blocks)]
                for index, link in enumerate(line.controllers)
            },
        }
        for line in plan.lines
    }
    result = {
        "ok": not findings.problems,
        "gateway": plan.name,
        "lines": lines,
        "problems": [problem.as_dict() for problem in findings.problems],
        "warnings": [warning.as_dict() for warning in findings.warnings],
    }
    print_json(result)


def _say(plan: "GatewayPlan", blocks: "Blocks", findings: "Findings") -> None:
    from rich.console import Console

    from gateway.cli.budget_output import show_line

    console = Console(highlight=False)
    for line in plan.lines:
        show_line(console, line, blocks)
    for problem in findings.problems:
        typer.echo(problem, err=True)
    for warning in findings.warnings:
        typer.echo(f"warning: {warning}", err=True)
