"""What is wrong with a table file: where, what was found, what is allowed."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FileProblem:
    """One thing that keeps a file from being used.

    ``line`` counts from 1; ``code`` is the lint's where one stands behind it; ``readings`` holds every
    meaning that the file could have when it does not prove which one is right. ``allowed`` may be empty if
    ``found`` says what to do.
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
    """A table file that must not be used: it is refused whole.

    Everything that this layer raises because of a file's content is one of these; anything else is a bug of
    ours. ``str()`` has one line for each problem; the attributes named like those of :class:`FileProblem` are
    the first problem's.
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
    """Facts about the axis or the old control, told to a reader, that cannot be true."""
