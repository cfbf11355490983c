"""The problems of one configuration, as they are collected."""

from dataclasses import dataclass, field

from gateway.config.document import Document
from gateway.config.problems import ConfigErrors, Problem, in_file_order, key_text
from gateway.config.toml_lines import KeyPath


@dataclass(slots=True)
class Findings:
    """Collects everything that is wrong with one document, or worth a warning."""

    document: Document
    problems: list[Problem] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)
    refused: set[KeyPath] = field(default_factory=set)
    """Keys that something was wrong with."""
    _lines_of: dict[KeyPath, KeyPath] = field(default_factory=dict)

    def refuse(self, path: KeyPath, found: str, remedy: str) -> None:
        """Note a problem of the key at ``path``."""
        self.refused.add(path)
        self.problems.append(self._problem(path, found, remedy))

    def refuse_elsewhere(self, path: KeyPath, problem: Problem) -> None:
        """Note a problem in another file, which the key at ``path`` names."""
        self.refused.add(path)
        self.problems.append(problem)

    def warn(self, path: KeyPath, found: str, remedy: str) -> None:
        """Note a warning of the key at ``path``."""
        self.warnings.append(self._problem(path, found, remedy))

    def is_refused(self, path: KeyPath) -> bool:
        """Whether this key, something in it or a table around it was refused already."""
        return any(path[: len(other)] == other or other[: len(path)] == path for other in self.refused)

    def part(self) -> "Findings":
        """Return findings of the same document for a part of it, to be looked at by themselves.

        What has been refused so far counts there too; :meth:`include` brings the part's own back.
        """
        return Findings(self.document, refused=set(self.refused), _lines_of=self._lines_of)

    def include(self, part: "Findings") -> None:
        """Take over what was found in a part."""
        self.problems += part.problems
        self.warnings += part.warnings
        self.refused |= part.refused

    def raise_if_any(self) -> None:
        """Raise everything at once, in the order of the file.

        Raises:
            ConfigErrors: there are problems.
        """
        if self.problems:
            file = str(self.document.path)
            raise ConfigErrors(in_file_order(self.problems, file), in_file_order(self.warnings, file))

    def stand_on_line_of(self, path: KeyPath, other: KeyPath) -> None:
        """Show problems of keys below ``path``, which is not in the file, on the line of ``other``."""
        self._lines_of[path] = other

    def _problem(self, path: KeyPath, found: str, remedy: str) -> Problem:
        shown = next((other for key, other in self._lines_of.items() if path[: len(key)] == key), path)
        line = self.document.lines.of(shown)
        return Problem(str(self.document.path), key_text(path), found, remedy, line)
