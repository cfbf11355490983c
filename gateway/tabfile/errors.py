"""Errors of table files: where, what was found, what is allowed."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FileProblem:
    """One reason why a file cannot be used.

    ``line`` counts from 1; ``code`` is that of the lint behind it, if any. ``readings`` holds all possible
    meanings of a file that does not prove one. ``allowed`` may be empty if ``found`` says what to do.
    """

    file: str
    found: str
    allowed: str
    line: int | None = None
    code: str | None = None
    readings: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Render as one line."""
        location = self.file if self.line is None else f"{self.file}:{self.line}"
        code = f"{self.code} " if self.code else ""
        readings = "".join(
            f"; reading {number}: {text}" for number, text in enumerate(self.readings, start=1)
        )
        allowed = f"; allowed: {self.allowed}" if self.allowed else ""
        return f"{location}: {code}{self.found}{readings}{allowed}"


class TabFileError(Exception):
    """A table file that cannot be used; it is refused as a whole.

    Every error that this layer raises because of a file's content is of this class; any other is a bug.
    ``str()`` has one line for each problem. The attributes named like those of :class:`FileProblem` belong to
    the first problem.
    """

    def __init__(self, *problems: FileProblem) -> None:
        super().__init__("\n".join(map(str, problems)))
        self.problems = problems
        self.file = problems[0].file
        self.line = problems[0].line
        self.found = problems[0].found
        self.allowed = problems[0].allowed
        self.readings = problems[0].readings


class ContextError(ValueError):
    """Impossible facts about the axis or the old control, given to a reader."""
