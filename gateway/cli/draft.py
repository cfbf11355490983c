"""The answers of ``init`` so far, judged by the rules of the configuration that they will make."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from gateway.cli.first_configuration import (
    USUAL,
    Answers,
    AxisAnswers,
    Serial,
    configuration_text,
    endpoint,
    serial_format,
    serial_of,
)
from gateway.config.drive_files import read_profile
from gateway.config.load import problems_of_draft
from gateway.config.problems import Problem
from gateway.config.values import read_name
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
    """Takes one answer after the other, those of an axis behind its name.

    An answer is known by the name that it has in ``Answers`` or ``AxisAnswers``.
    """

    def __init__(self, file: Path, drives: Serial, controller: Serial) -> None:
        """``drives`` and ``controller``: how their serial ports are set, as far as the options say so."""
        self.answers: dict[str, Any] = {}
        """Those that are none of an axis."""
        self.axes: dict[str, dict[str, Any]] = {}
        """Those of each axis, in the order in which they were named."""
        self.tables: dict[str, str | None] = {}
        """The table file of each axis; looked at only in the file that is written."""
        self.notes: list[str] = []
        """What good answers brought to light elsewhere; it can be mended in the file."""
        self._file = file
        self._axis = ""
        self._profiles: dict[str, Profile] = {}
        self._serial = {"drives_format": drives, "controller_format": controller}
        self._known: set[Problem] = set()

    @property
    def profile(self) -> Profile | None:
        """Return the profile of the axis that was named last."""
        return self._profiles.get(self._axis)

    def begin_axis(self, name: str) -> None:
        """Take the name of an axis: the answers about axes that come now are about this one.

        Raises:
            ValueError: it is no name, or the name of another axis.
        """
        try:
            read_name(name)
        except ValueError as error:
            raise ValueError(f'found "{name}"; {error}') from None
        if name in self.axes:
            raise ValueError(f'found "{name}"; there is an axis {name} already: give this one another name')
        self._axis = name
        self.axes[name] = {}

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
        for profile in self._profiles.values():  # the first drive decides: all hang on one cable
            return serial_of(asked, profile)
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
        if name == "unit_id":
            self._refuse_same_unit(answer)
        answers, axes = self.answers, self.axes
        if name in PLACES:
            answers = {**answers, name: answer}
        else:
            axes = {**axes, self._axis: {**axes[self._axis], name: answer}}
        problems = problems_of_draft(self._file, self._tables(answers, axes))
        new = [problem for problem in problems if problem.found != "missing" and problem not in self._known]
        own = [problem for problem in new if self._is_about(problem, name)]
        if own:
            raise ValueError("\n  ".join(_said(problem, name) for problem in own))
        self.answers, self.axes = answers, axes
        self._known.update(new)
        self.notes += [f"{problem.key}: {problem.found}; {problem.remedy}" for problem in new]
        if name == "drive":
            self._profiles[self._axis] = _profile(str(answer), self._file.parent)

    def note_table(self, file: str | None) -> None:
        """Take the table file of the axis that was named last, None for none."""
        self.tables[self._axis] = file

    def _refuse_same_unit(self, unit_id: object) -> None:
        """A drive of several axes has registers for each: that is written by hand."""
        for name, answers in self.axes.items():
            if name != self._axis and answers.get("unit_id") == unit_id:
                raise ValueError(f"found {unit_id}; axis {name} has this unit id: each drive has its own")

    def text(self, state: str | None = None, timing: tuple[str, ...] = ()) -> str:
        """Return the configuration with its comments. Everything has to be answered."""
        given = {name: answer for name, answer in self.answers.items() if name not in FORMATS}
        answers = Answers(
            **given,
            axes=tuple(
                AxisAnswers(name=name, profile=self._profiles[name], table=self.tables.get(name), **its)
                for name, its in self.axes.items()
            ),
            drives_serial=self.serial("drives_format"),
            controller_serial=self.serial("controller_format"),
            timing=timing,
            state=state,
        )
        return configuration_text(answers)

    def _is_about(self, problem: Problem, name: str) -> bool:
        if name == "drive":
            keys = [f"axis.{self._axis}.drive", f"axis.{self._axis}.registers"]
            return problem.file != str(self._file) or problem.key.startswith(tuple(keys))
        return problem.key.startswith(PLACES.get(name, f"axis.{self._axis}.{name}"))

    def _tables(self, answers: Mapping[str, Any], axes: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
        """Return the configuration as far as it is known."""
        line: dict[str, Any] = {}
        if "drives_at" in answers:
            line["drives"] = endpoint(answers["drives_at"], self.serial("drives_format", answers))
        if "controller_at" in answers:
            serial = self.serial("controller_format", answers)
            line["controllers"] = [{"name": CONTROLLER, **endpoint(answers["controller_at"], serial)}]
        gateway = {"name": answers["name"]} if "name" in answers else {}
        return {
            "gateway": gateway,
            "line": {LINE: line},
            "axis": {name: {"line": LINE, **_as_toml(its)} for name, its in axes.items()},
        }


def _as_toml(answers: Mapping[str, Any]) -> dict[str, Any]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in answers.items()}


def _profile(name: str, folder: Path) -> Profile:
    return library.shipped(name) if library.is_name(name) else read_profile(folder / name)


def _said(problem: Problem, name: str) -> str:
    if name in PLACES and problem.key.endswith(".tcp") and problem.remedy.startswith('allowed: "HOST:PORT"'):
        return f"{problem.found}; {PLACE_RULE}"
    if name == "drive":
        return str(problem) if problem.line is not None else f"{problem.found}; {problem.remedy}"
    return f"{problem.found}; {problem.remedy}"
