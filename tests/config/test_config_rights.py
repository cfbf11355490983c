"""What a controller may ask for and how it may connect: what reaches the plan, what is refused."""

from hashlib import sha256
from pathlib import Path

import pytest

from gateway.config.problems import Problem
from gateway.exchange.plan import ControllerPlan, Role
from gateway.exchange.rights import UNLIMITED, RegisterSpan, Rights
from gateway.state.plan import ControllerLink, read_plan, write_plan
from gateway.transport.endpoints import TcpEndpoint
from gateway.transport.limits import ConnectionLimits
from tests.config.config_bench import edited, line_of, loaded, refusal, refused

CNC = 'rtu = "/dev/serial/by-id/usb-A"\nbaudrate = 38400'
HMI = 'tcp = "127.0.0.1:1502"\nrole = "monitor"'
TCP = 'tcp = "127.0.0.1:1502"'


def with_keys(*keys: str, old: str = HMI, new: str = TCP) -> str:
    return edited((old, "\n".join((new, *keys))))


def hmi(folder: Path, *keys: str) -> ControllerLink:
    return loaded(folder, with_keys(*keys)).plan.lines[0].controllers[1]


def warnings(folder: Path, *keys: str) -> tuple[Problem, ...]:
    """Return what is said of the rights, but not that there are two controllers for one axis."""
    found = loaded(folder, with_keys(*keys)).warnings
    return tuple(warning for warning in found if "may each move" not in warning.found)


def test_a_controller_that_says_nothing_may_do_all_that_its_role_allows(tmp_path: Path) -> None:
    link = hmi(tmp_path)
    assert link.plan == ControllerPlan("hmi", Role.MOTION, 1000.0)
    assert link.plan.rights == UNLIMITED
    assert link.limits == ConnectionLimits(max_connections=64, connects_per_s=50.0, idle_timeout_s=0.0)


def test_every_key_reaches_the_plan_and_the_compiled_one(tmp_path: Path) -> None:
    keys = [
        "unit_ids = [1]",
        "function_codes = [3, 16]",
        'readable = [0x0140, "0x0500-0x05FF"]',
        'writable = ["1542-0x0607"]',
        "requests_per_s = 12.5",
        "max_connections = 3",
        "connects_per_s = 0.5",
        "idle_timeout_s = 60",
    ]
    found = loaded(tmp_path, with_keys(*keys))
    link = found.plan.lines[0].controllers[1]
    assert link.plan.rights == Rights(
        is_read_only=False,
        unit_ids=frozenset({1}),
        function_codes=frozenset({3, 16}),
        readable=(RegisterSpan(0x0140, 0x0140), RegisterSpan(0x0500, 0x05FF)),
        writable=(RegisterSpan(0x0606, 0x0607),),
        requests_per_s=12.5,
    )
    assert link.endpoint == TcpEndpoint("127.0.0.1", 1502)
    assert link.limits == ConnectionLimits(3, 0.5, 60.0)
    config = tmp_path / "gateway.toml"
    write_plan(tmp_path / "state", found.plan, {str(config): sha256(config.read_bytes()).hexdigest()}, "")
    again = read_plan(tmp_path / "state", config).plan
    assert again.lines[0].controllers == found.plan.lines[0].controllers


def test_rights_hold_for_serial_controllers_too(tmp_path: Path) -> None:
    found = loaded(tmp_path, with_keys("read_only = true", old=CNC, new=CNC))
    assert found.plan.lines[0].controllers[0].plan.rights == Rights(is_read_only=True)


def test_how_many_controllers_may_move_an_axis(tmp_path: Path) -> None:
    speed = "max_speed = 200.0"
    [axis] = loaded(tmp_path).plan.lines[0].axes
    assert (axis.has_one_writer, axis.writer_hold_s) == (True, 5.0)
    [axis] = loaded(tmp_path, edited((speed, 'writers = "any"\nwriter_hold_s = 0.5'))).plan.lines[0].axes
    assert (axis.has_one_writer, axis.writer_hold_s) == (False, 0.5)
    assert '"one" or "any"' in str(refusal(tmp_path, edited((speed, 'writers = "two"')), "axis.x.writers"))


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("read_only = 1", "true or false"),
        ("unit_ids = [256]", "at most 255"),
        ("function_codes = [0]", "at least 1"),
        ("function_codes = [128]", "at most 127"),
        ("readable = [65536]", "addresses from 0 to 0xFFFF"),
        ('readable = ["0x0607-0x0606"]', "addresses from 0 to 0xFFFF"),
        ('writable = ["0x0606 - 0x0607"]', "addresses from 0 to 0xFFFF"),
        ("requests_per_s = 0", "greater than 0"),
        ("max_connections = 0", "at least 1"),
        ("max_connections = 1025", "at most 1024"),
        ("connects_per_s = -1", "greater than 0"),
        ("idle_timeout_s = inf", "a finite number"),
    ],
)
def test_values_that_cannot_be(tmp_path: Path, key: str, said: str) -> None:
    text = with_keys(key)
    [problem] = refused(tmp_path, text)
    assert problem.key.startswith(f"line.xyz.controllers[2].{key.split(maxsplit=1)[0]}")
    assert problem.line == line_of(text, key)
    assert said in str(problem)


@pytest.mark.parametrize("key", ["max_connections = 1", "connects_per_s = 1", "idle_timeout_s = 1"])
def test_keys_of_tcp_beside_a_serial_port(tmp_path: Path, key: str) -> None:
    problem = refusal(tmp_path, with_keys(key, old=CNC, new=CNC), "line.xyz.controllers[1]")
    assert f"{key.split(maxsplit=1)[0]} belongs to tcp: leave out beside rtu" in str(problem)


@pytest.mark.parametrize("name", ["unit_ids", "function_codes", "readable", "writable"])
def test_an_empty_list_would_allow_everything(tmp_path: Path, name: str) -> None:
    problem = refusal(tmp_path, with_keys(f"{name} = []"), f"line.xyz.controllers[2].{name}")
    assert "remove it if all are allowed" in str(problem)


@pytest.mark.parametrize("key", ['role = "monitor"', "read_only = true"])
def test_what_may_be_written_beside_nothing_may_be_written(tmp_path: Path, key: str) -> None:
    text = with_keys(key, 'writable = ["0x0606-0x0607"]')
    problem = refusal(tmp_path, text, "line.xyz.controllers[2].writable")
    assert key in str(problem)
    text = with_keys(key, "function_codes = [6, 16]")
    problem = refusal(tmp_path, text, "line.xyz.controllers[2].function_codes")
    assert "but the controller may only read" in str(problem)


@pytest.mark.parametrize("span", ['"0x0600-0x0606"', "0x0607", '"0x0607-0x0700"'])
def test_half_a_position_is_never_writable(tmp_path: Path, span: str) -> None:
    text = with_keys(f'writable = ["0x0100-0x0200", {span}]')
    problem = refusal(tmp_path, text, "line.xyz.controllers[2].writable[2]")
    assert "a part of a command position of axis x, which is 0x0606-0x0607" in str(problem)
    assert problem.line == line_of(text, "writable")


def test_half_a_position_of_a_drive_that_it_may_not_speak_to_is_no_matter(tmp_path: Path) -> None:
    keys = ("unit_ids = [7]", "writable = [0x0607]")
    assert [problem.key for problem in warnings(tmp_path, *keys)] == [
        "line.xyz.controllers[2].role",
        "line.xyz.controllers[2].unit_ids[1]",
    ]


@pytest.mark.parametrize(
    "keys", [("read_only = true",), ("function_codes = [3, 4]",), ('writable = ["0x0100-0x0200"]',)]
)
def test_a_motion_controller_that_may_move_nothing_is_warned_of(
    tmp_path: Path, keys: tuple[str, ...]
) -> None:
    [problem] = warnings(tmp_path, *keys)
    assert problem.key == "line.xyz.controllers[2].role"
    assert "allow it to move no axis of this line" in str(problem)


@pytest.mark.parametrize(
    "keys",
    [
        ("unit_ids = [1]",),
        ("unit_ids = [0, 1]",),
        ('writable = ["0x0606-0x0607"]', "function_codes = [3, 16]"),
        ('writable = ["0x0600-0x060F"]',),
        ("readable = [1]",),
        ('role = "monitor"', "read_only = true"),
    ],
)
def test_rights_that_make_sense_are_not_warned_of(tmp_path: Path, keys: tuple[str, ...]) -> None:
    assert warnings(tmp_path, *keys) == ()


def test_a_broadcast_that_leaves_an_axis_out_is_warned_of(tmp_path: Path) -> None:
    found = [str(problem) for problem in warnings(tmp_path, "unit_ids = [0, 5]", 'role = "monitor"')]
    assert len(found) == 2
    assert "broadcasts are refused" in found[0] + found[1]
    assert "no axis of this line has unit id 5" in found[0] + found[1]
