"""Where the status page may be, and what is said about who sees it there."""

from pathlib import Path

import pytest

from gateway.config.load import load
from gateway.config.problems import ConfigErrors, Problem
from gateway.transport.endpoints import TcpEndpoint
from tests.config.config_bench import GOOD, edited, line_of, loaded, refusal, refused, written


def listening(address: str) -> str:
    return f'{GOOD}\n[http]\nlisten = "{address}"\n'


@pytest.mark.parametrize(
    ("text", "endpoint"),
    [
        (GOOD, TcpEndpoint("127.0.0.1", 8480)),
        (f"{GOOD}\n[http]\n", TcpEndpoint("127.0.0.1", 8480)),
        (listening(""), None),
        (listening("localhost:8080"), TcpEndpoint("localhost", 8080)),
        (listening("[::1]:8481"), TcpEndpoint("::1", 8481)),
    ],
)
def test_the_page_is_on_this_machine_or_off(tmp_path: Path, text: str, endpoint: TcpEndpoint | None) -> None:
    taken = loaded(tmp_path, text)
    assert taken.sections.http.endpoint == endpoint
    assert [warning for warning in taken.warnings if warning.key == "http.listen"] == []


@pytest.mark.parametrize("address", ["0.0.0.0:8480", "[::]:8480", "192.168.0.7:8480", "mill.local:8480"])
def test_nobody_looks_from_elsewhere_without_saying_who_he_is(tmp_path: Path, address: str) -> None:
    problem = refusal(tmp_path, listening(address), "http.listen")
    assert problem.line == line_of(listening(address), "listen")
    assert problem.found == f"anyone who reaches {address} could read the status of the gateway"
    assert all(words in problem.remedy for words in ("tokens", "clients", "[http.tls]", "127.0.0.1"))


@pytest.mark.parametrize(
    "address", ["8480", "127.0.0.1", "127.0.0.1:0", "127.0.0.1:65536", "::1:8480", "1.2.3:80"]
)
def test_what_is_no_address_is_refused(tmp_path: Path, address: str) -> None:
    problem = refusal(tmp_path, listening(address), "http.listen")
    assert problem.line == line_of(listening(address), "listen")
    assert problem.remedy.startswith("allowed: ") or "allowed: " in f"{problem.found} {problem.remedy}"
    assert '"" for none' in f"{problem.found} {problem.remedy}"


@pytest.mark.parametrize("address", ["127.0.0.1:1502", "localhost:1502", "0.0.0.0:1502"])
def test_a_controller_and_the_page_do_not_share_an_address(tmp_path: Path, address: str) -> None:
    problem, *_ = refused(tmp_path, listening(address))
    assert problem.key == "http.listen"
    assert problem.found == f"{address} is already the listener of line.xyz.controllers[2].tcp"
    assert '"" for none' in problem.remedy


def test_a_controller_at_the_address_that_the_page_has_by_itself(tmp_path: Path) -> None:
    problem = refusal(tmp_path, edited(("127.0.0.1:1502", "127.0.0.1:8480")), "http.listen")
    assert problem.found == "127.0.0.1:8480 is already the listener of line.xyz.controllers[2].tcp"


def test_a_page_on_all_ipv6_addresses_is_on_no_ipv4_address(tmp_path: Path) -> None:
    found = [warning for warning in _warnings_of(tmp_path, listening("[::]:8480")) if "IPv6" in warning.found]
    assert [warning.key for warning in found] == ["http.listen"]
    assert 'listen = "0.0.0.0:8480"' in found[0].remedy


def _warnings_of(folder: Path, text: str) -> tuple[Problem, ...]:
    """Return the warnings of a configuration that is refused for having neither TLS nor tokens."""
    with pytest.raises(ConfigErrors) as caught:
        load(written(folder, text))
    return caught.value.warnings
