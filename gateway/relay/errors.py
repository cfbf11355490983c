"""Why the relay does not start."""

from collections.abc import Sequence


class StartError(Exception):
    """Listeners or ports cannot be opened; ``problems`` has a line for each, which begins with its key."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = tuple(problems)
