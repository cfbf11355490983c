"""The text of the report: Markdown for ``results.md``, plain lines for the terminal."""

from collections.abc import Sequence
from typing import Final

from bench.figures import Interval, Judged
from bench.machine import Facts
from bench.results import Goal, Section, Table

MADE: Final = (
    "<!-- Made by bench/run.py: change nothing here. What people have to say stands in bench/notes.md. -->"
)
GOAL_COLUMNS: Final = ("what", "reach", "found", "judged by", "verdict", "remark")
INTERVALS: Final = (
    "Found: estimate [95 % interval, from resampling whole rounds]. Each estimate is a median over rounds; "
    "rounds of all candidates lie between each other. *Reached within noise*: the number that counts keeps "
    "the limit, the upper end of its interval does not."
)


def markdown(sections: Sequence[Section], facts: Facts, notes: str, chart: str) -> str:
    """Return the whole report. ``chart``: file name of the picture, empty where there is none."""
    goals = [goal for section in sections for goal in section.goals]
    parts = [
        MADE,
        "# Results of the bench",
        _facts(facts),
        "## Numbers to reach",
        INTERVALS,
        _table(_goals(goals)),
    ]
    parts.append(summary(goals))
    if notes:
        parts += ["## Notes", notes.strip()]
    if chart:
        parts += ["## What each candidate adds", f"![Added median round trip]({chart})"]
    for section in sections:
        parts += [f"## {section.title}", *section.text]
        for table in section.tables:
            parts += [table.caption] if table.caption else []
            parts.append(_table(table))
    return "\n\n".join(parts) + "\n"


def terminal(sections: Sequence[Section]) -> str:
    """Return the rows of the contract, and a table of ratios for each section."""
    goals = [goal for section in sections for goal in section.goals]
    parts: list[str] = []
    for section in sections:
        for table in section.tables:
            parts.append(f"{section.title}. {table.caption}".rstrip())
            parts.append(_columns(table))
    parts.append("Numbers to reach")
    parts.append(_columns(_goals(goals)))
    return "\n\n".join(parts).replace("**", "") + f"\n\n{summary(goals)}\n"


def summary(goals: Sequence[Goal]) -> str:
    """Count the verdicts.

    >>> summary([Goal("a", 1.0, Interval(0.5, 0.4, 0.6)), Goal("b", 1.0, None)])
    '1 reached, 1 not measured.'
    """
    verdicts = [goal.verdict.value.strip("*") for goal in goals]
    return ", ".join(f"{verdicts.count(kind)} {kind}" for kind in dict.fromkeys(verdicts)) + "."


def _goals(goals: Sequence[Goal]) -> Table:
    rows = [
        (
            goal.what,
            f"≤ {goal.limit:g}",
            _found(goal.found),
            goal.judged.value if goal.judged is Judged.LOW else "",
            goal.verdict.value,
            goal.remark,
        )
        for goal in goals
    ]
    return Table(GOAL_COLUMNS, tuple(rows))


def _found(found: Interval | None) -> str:
    if found is None:
        return ""
    if found.low == found.high:
        return f"{found.estimate:.2f}"
    return str(found)


def _facts(facts: Facts) -> str:
    return "\n".join(f"- {name}: {value}" for name, value in facts)


def _table(table: Table) -> str:
    """As Markdown; numbers stand to the right."""
    rule = ["---"] + ["---:" if _is_number(table, i) else "---" for i in range(1, len(table.columns))]
    lines = [table.columns, tuple(rule), *table.rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _columns(table: Table) -> str:
    """As columns of plain text."""
    lines = [table.columns, *table.rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(table.columns))]
    numbers = [i > 0 and _is_number(table, i) for i in range(len(table.columns))]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if is_number else cell.ljust(width)
            for cell, width, is_number in zip(line, widths, numbers, strict=True)
        ).rstrip()
        for line in lines
    )


def _is_number(table: Table, column: int) -> bool:
    cells = [row[column] for row in table.rows if row[column]]
    return bool(cells) and all(cell[0].isdigit() or cell[0] in "-≤" for cell in cells)
