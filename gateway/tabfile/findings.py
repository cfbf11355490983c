"""A remark about a table: a lint, or what a reader had to take on trust."""

from dataclasses import dataclass
from enum import Enum


class Severity(Enum):
    """``error``: the gateway does not load the table. ``info``: nothing is to be done."""

    ERROR = "error"
    WARNING = "warning"
    INFO = "info"


@dataclass(frozen=True, slots=True)
class Lint:
    """One remark. ``code`` never changes its meaning; ``message`` says what to do."""

    code: str
    severity: Severity
    message: str
    line: int | None = None

    def to_json(self) -> dict[str, object]:
        """Return the remark as plain data."""
        return {
            "code": self.code,
            "severity": self.severity.value,
            "message": self.message,
            "line": self.line,
        }
