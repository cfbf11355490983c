"""The rights of a role of certificates: checked as those of a controller are."""

from pathlib import Path

import pytest

from tests.config.config_bench import edited, loaded, refusal
from tests.support.certificates import Shop

LISTENER = """tcp = "127.0.0.1:1502"

[line.xyz.controllers.tls]
certificate = "server.pem"
key = "server.key"
clients = "ca.pem"

[line.xyz.controllers.roles.Panel]
"""
ROLE = "line.xyz.controllers[2].roles.Panel"


def with_role(*keys: str) -> str:
    if not any(key.startswith("role =") for key in keys):
        keys = ('role = "motion"', *keys)
    return edited(('tcp = "127.0.0.1:1502"\nrole = "monitor"\n', LISTENER + "\n".join(keys) + "\n"))


@pytest.fixture(autouse=True)
def certificates(tmp_path: Path) -> None:
    Shop(tmp_path).server()


@pytest.mark.parametrize(
    ("keys", "key", "found"),
    [
        *(
            ((f"{name} = []",), name, "an empty list, which would allow everything")
            for name in ("unit_ids", "function_codes", "readable", "writable")
        ),
        (('role = "monitor"', "writable = [1]"), "writable", "addresses that may be written, but role"),
        (('writable = ["0x0606"]',), "writable[1]", "0x0606-0x0606 holds a part of a command position"),
        (("read_only = true", "function_codes = [6]"), "function_codes", "only function codes that write"),
    ],
)
def test_rights_of_a_role_that_cannot_be_meant_are_refused(
    tmp_path: Path, keys: tuple[str, ...], key: str, found: str
) -> None:
    assert found in refusal(tmp_path, with_role(*keys), f"{ROLE}.{key}").found


@pytest.mark.parametrize(
    ("keys", "remedy"),
    [
        (
            ('role = "monitor"', "writable = [1]"),
            "remove writable, or give it another role if it may write them",
        ),
        (
            ("read_only = true", "writable = [1]"),
            "remove writable, or write read_only = false if it may write them",
        ),
    ],
)
def test_who_may_write_nothing_names_no_addresses_to_write(
    tmp_path: Path, keys: tuple[str, ...], remedy: str
) -> None:
    assert refusal(tmp_path, with_role(*keys), f"{ROLE}.writable").remedy == remedy


def test_a_role_that_does_not_say_what_it_is_gives_nothing(tmp_path: Path) -> None:
    problem = refusal(
        tmp_path, edited(('tcp = "127.0.0.1:1502"\nrole = "monitor"\n', LISTENER)), f"{ROLE}.role"
    )
    assert (problem.found, problem.remedy) == ("missing", "needed: what a controller with this role may do")


def test_a_role_that_may_move_nothing_is_warned_of(tmp_path: Path) -> None:
    [warning] = loaded(tmp_path, with_role("function_codes = [3]")).warnings
    assert (warning.key, warning.found) == (
        f"{ROLE}.role",
        'role = "motion", but its rights allow it to move no axis of this line',
    )
