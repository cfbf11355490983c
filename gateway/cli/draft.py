"""The answers of ``init`` so far, judged by the rules of the configuration that they will make."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from gateway.cli.first_configuration import (
    USUAL,
    Answers,
    Serial,
    configuration_text,
    endpoint,
    serial_format,
    serial_of,
)
from gateway.config.drive_files import read_profile
from gateway.config.load import problems_of_draft
from gateway.config.problems import Problem
from gateway.drives import library
from gateway.drives.profile import Profile

LINE: Final = "main"
CONTROLLER: Final = "controller"
PLACES: Final = {
    "drives_at": f"line.{LINE}.drives",
    "controller_at": f"line.{LINE}.controllers",
    "drives_format": f"line.{LINE}.drives",
    "controller_format": f"line.{LINE}.controllers",
    "name": "gateway.name",
}
"""Answers that are none of the axis: what keys they are about."""
FORMATS: Final = {"drives_format": "drives_at", "controller_format": "controller_at"}
"""How the serial port is set that another answer names."""
PLACE_RULE: Final = (
    'allowed: "HOST:PORT", as in "192.168.0.7:502", or the full path of a serial port, as in "/dev/ttyUSB0"'
)
ANY_PORT: Final = "/dev/ttyUSB0"


class Draft:
    """Takes one answer after the other. An answer is known by the name that it has in ``Answers``."""

    def __init__(self, file: Path, axis: str, drives: Serial, controller: Serial) -> None:
        """``drives`` and ``controller``: how their serial ports are set, as far as the options say so."""
        self.answers: dict[str, Any] = {}
        self.profile: Profile | None = None
        self.notes: list[str] = []
        """What good answers brought to light elsewhere; it can be mended in the file."""
        self._file = file
        self._axis = axis
        self._serial = {"drives_format": drives, "controller_format": controller}
        self._known: set[Problem] = set()

    def wrong_serial(self) -> tuple[str, Problem] | None:
        """Return which option about a serial port is wrong, and why, whatever is asked later."""
        for name in FORMATS:
            tables = {"line": {LINE: {"drives": endpoint(ANY_PORT, self.serial(name))}}}
            for problem in problems_of_draft(self._file, tables):
                if problem.key.startswith(f"{PLACES['drives_at']}."):
                    option = problem.key.rpartition(".")[2].replace("_", "-")
                    return f"--{'' if name == 'drives_format' else 'controller-'}{option}", problem
        return None

    def serial(self, name: str, answers: Mapping[str, Any] | None = None) -> Serial:
        """Return how a port is set; that of the controller is as the drives'. ``name``: of ``FORMATS``."""
        found = (self.answers if answers is None else answers).get(name)
        if isinstance(found, Serial):
            return found
        asked = self._serial[name]
        if name == "controller_format":
            given = {key: value for key, value in asked._asdict().items() if value is not None}
            return self.serial("drives_format", answers)._replace(**given)
        if self.profile is not None:
            return serial_of(asked, self.profile)
        return USUAL._replace(**{key: value for key, value in asked._asdict().items() if value is not None})

    @property
    def read_address(self) -> int:
        """Return a register that the drive can be asked for: that of its position, where that is known."""
        places = () if self.profile is None else self.profile.registers.actual
        return next((place.address for place in places), 0)

    def wants_format(self, name: str) -> bool:
        """Whether how a port is set has to be asked: it is a serial one, and no option said it."""
        is_serial = str(self.answers.get(FORMATS[name], "")).startswith("/")
        return is_serial and None in self._serial[name]

    def take(self, name: str, answer: object) -> None:
        """Take an answer.

        Raises:
            ValueError: the configuration would refuse it; says what was found and what is allowed.
        """
        if name in FORMATS:
            answer = serial_format(str(answer), self.serial(name))
        answers = {**self.answers, name: answer}
        problems = problems_of_draft(self._file, self._tables(answers))
        new = [problem for problem in problems if problem.found != "missing" and problem not in self._known]
        own = [problem for problem in new if self._is_about(problem, name)]
        if own:
            raise ValueError("\n  ".join(_said(problem, name) for problem in own))
        self.answers = answers
        self._known.update(new)
        self.notes += [f"{problem.key}: {problem.found}; {problem.remedy}" for problem in new]
        if name == "drive":
            self.profile = _profile(str(answer), self._file.parent)

    def text(self, table: str | None, state: str | None = None, timing: tuple[str, ...] = ()) -> str:
        """Return the configuration with its comments. Everything has to be answered."""
        assert self.profile is not None
        given = {name: answer for name, answer in self.answers.items() if name not in FORMATS}
        answers = Answers(
            **given,
            axis=self._axis,
            drives_serial=self.serial("drives_format"),
            controller_serial=self.serial("controller_format"),
            table=table,
            timing=timing,
            state=state,
        )
        return configuration_text(answers, self.profile)

    def _is_about(self, problem: Problem, name: str) -> bool:
        if name == "drive":
            keys = [f"axis.{self._axis}.drive", f"axis.{self._axis}.registers"]
            return problem.file != str(self._file) or problem.key.startswith(tuple(keys))
        return problem.key.startswith(PLACES.get(name, f"axis.{self._axis}.{name}"))

    def _tables(self, answers: Mapping[str, Any]) -> dict[str, Any]:
        """Return the configuration as far as it is known."""
        line: dict[str, Any] = {}
        if "drives_at" in answers:
            line["drives"] = endpoint(answers["drives_at"], self.serial("drives_format", answers))
        if "controller_at" in answers:
            serial = self.serial("controller_format", answers)
            line["controllers"] = [{"name": CONTROLLER, **endpoint(answers["controller_at"], serial)}]
        axis = {name: value for name, value in answers.items() if name not in PLACES}
        if "travel" in axis:
            axis["travel"] = list(axis["travel"])
        gateway = {"name": answers["name"]} if "name" in answers else {}
        return {"gateway": gateway, "line": {LINE: line}, "axis": {self._axis: {"line": LINE, **axis}}}


def _profile(name: str, folder: Path) -> Profile:
    return library.shipped(name) if library.is_name(name) else read_profile(folder / name)


def _said(problem: Problem, name: str) -> str:
    if name in PLACES and problem.key.endswith(".tcp") and problem.remedy.startswith('allowed: "HOST:PORT"'):
        return f"{problem.found}; {PLACE_RULE}"
    if name == "drive":
        return str(problem) if problem.line is not None else f"{problem.found}; {problem.remedy}"
    return f"{problem.found}; {problem.remedy}"
