"""The contact as a GPIO line: what is asked of libgpiod, and what is said of its errors."""

import errno
import os
import sys
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Self

import gpiod
import pytest
from gpiod.line import Direction, Value

from gateway.config.gateway_model import AlarmOutputSection
from tests.supervisor.test_alarm_output import running, status, until

CHIP = "/dev/gpiochip0"


@dataclass
class Lines:
    """A request of libgpiod for one line of a chip that nobody has here."""

    set: list[tuple[int, Value]] = field(default_factory=list)
    failure: OSError | None = None
    asked: list[tuple[str, str, dict[int, gpiod.LineSettings]]] = field(default_factory=list)
    is_held: bool = False

    def request(self, path: str, consumer: str, config: dict[int, gpiod.LineSettings]) -> Self:
        self.asked.append((path, consumer, config))
        if self.failure is not None:
            raise self.failure
        return self

    def set_value(self, line: int, value: Value) -> None:
        if self.failure is not None:
            raise self.failure
        self.set.append((line, value))

    def __enter__(self) -> Self:
        self.is_held = True
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.is_held = False


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch) -> Lines:
    found = Lines()
    monkeypatch.setattr(gpiod, "request_lines", found.request)
    return found


def section(every_s: float = 0.1, **gpio: Any) -> AlarmOutputSection:
    return AlarmOutputSection.model_validate({"gpio": {"chip": CHIP, "line": 17, **gpio}, "every_s": every_s})


@pytest.mark.parametrize("active_low", [False, True])
async def test_it_is_taken_inactive_closed_while_all_is_well_opened_and_given_back(
    lines: Lines, active_low: bool
) -> None:
    async with running() as supervisor:
        supervisor.output.follow(section(60.0, active_low=active_low))
        await until(lambda: supervisor.output.status.is_closed is True)
        assert (supervisor.output.status.contact, lines.is_held) == (f"{CHIP}, line 17", True)
        supervisor.show(status("error"))
        await until(lambda: supervisor.output.status.is_closed is False)
        supervisor.show(status("warning"))
        await until(lambda: supervisor.output.status.is_closed is True)
    active, inactive = (17, Value.ACTIVE), (17, Value.INACTIVE)
    assert lines.set == [active, inactive, active, inactive]
    assert not lines.is_held
    [(chip, consumer, config)] = lines.asked
    assert (chip, consumer, list(config)) == (CHIP, "pitch-gateway", [17])
    assert config[17].direction is Direction.OUTPUT
    assert (config[17].output_value, config[17].active_low) == (Value.INACTIVE, active_low)
    assert supervisor.said == []


@pytest.mark.parametrize(
    ("code", "remedy"),
    [
        (errno.EBUSY, "another program or the kernel has this line: `gpioinfo` names it; take another line"),
        (errno.EACCES, "let the supervisor use it: docs/install.md has the group and the udev rule"),
        (errno.EIO, "check the chip with `gpioinfo`"),
    ],
)
async def test_an_error_is_said_once_with_its_remedy_and_tried_again(
    lines: Lines, code: int, remedy: str
) -> None:
    lines.failure = OSError(code, os.strerror(code))
    async with running() as supervisor:
        supervisor.output.follow(section())
        await until(lambda: len(lines.asked) >= 3)
        problem = f"{CHIP}: line 17: {os.strerror(code)}; {remedy}"
        assert (supervisor.output.status.problem, supervisor.output.status.is_closed) == (problem, None)
        lines.failure = None
        await until(lambda: supervisor.output.status.is_closed is True)
        assert supervisor.said == [
            ("alarm-output-failed", {"detail": problem}),
            ("alarm-output-works", {}),
        ]


async def test_a_line_that_can_no_longer_be_set_is_requested_anew(lines: Lines) -> None:
    async with running() as supervisor:
        supervisor.output.follow(section())
        await until(lambda: supervisor.output.status.is_closed is True)
        lines.failure = OSError(errno.ENODEV, os.strerror(errno.ENODEV))  # an adapter was pulled out
        await until(lambda: supervisor.output.status.problem is not None)
        assert supervisor.output.status.is_closed is None
        lines.failure = None
        await until(lambda: supervisor.output.status.is_closed is True)
        assert len(lines.asked) > 1


@pytest.mark.parametrize(
    ("chip", "why"),
    [
        ("/dev/gpiochip-none", "No such file or directory"),
        ("/dev/null", "No such device"),
        ("/etc/passwd", "Inappropriate ioctl for device"),
    ],
)
async def test_what_is_no_chip_is_said_by_libgpiod_itself(chip: str, why: str) -> None:
    async with running() as supervisor:
        supervisor.output.follow(section(chip=chip))
        await until(lambda: supervisor.output.status.problem is not None)
        remedy = "name one that `gpiodetect` lists as `chip`"
        assert supervisor.output.status.problem == f"{chip}: line 17: {why}; {remedy}"


async def test_without_the_package_the_status_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gpiod", None)
    async with running() as supervisor:
        supervisor.output.follow(section())
        await until(lambda: supervisor.output.status.problem is not None)
        assert supervisor.output.status.problem == (
            f"{CHIP}: the Python package gpiod is not installed; pip install 'pitch-gateway[gpio]' where "
            "pitch-gateway is installed"
        )
