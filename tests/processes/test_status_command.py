"""``status``: one look at a gateway that runs."""

import contextlib
import json
import re
import socket
from collections.abc import Callable
from typing import Any

import pytest

from gateway import __version__
from tests.support.commands import typed
from tests.support.gateway import Site, gateway_of
from tests.support.processes import eventually


def until(config: str, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Look until the status, which the supervisor has five times a second, says so."""

    def look() -> dict[str, Any]:
        looked = typed("status", config, "--json")
        assert (looked.returncode, looked.stderr) == (0, "")
        model: dict[str, Any] = json.loads(looked.stdout)
        return model

    return eventually(look, condition)


def test_the_status_of_a_gateway_that_runs(site: Site) -> None:
    config = str(site.config)
    # However slow the machine is: no trouble with the budget, and who writes still writes while it is asked.
    site.change("[axis.x]", "[axis.x]\nbudget_us = 1000000\nwriter_hold_s = 600")
    with gateway_of(site) as (_, master):
        assert master.move(50_000) == 50_050
        assert master.move(60_000) == 60_060
        model = until(config, lambda model: model["lines"]["xyz"]["exchanges"] == 2)
        assert set(model) == {"gateway", "lines", "axes", "supervisor", "verdict", "troubles"}
        assert model["gateway"]["name"] == "trial"
        assert model["axes"]["x"]["nominal_setpoint"] == 60.0
        plain = typed("status", config)
        assert (plain.returncode, plain.stderr) == (0, "")
        lines = [" ".join(line.split()) for line in plain.stdout.splitlines()]
        assert lines[0].startswith("HEALTHY since ")
        assert lines[2].startswith(f"gateway trial {__version__}")
        assert f"line xyz: up, drives {model['lines']['xyz']['drives']['address']}" in lines
        assert "exchanges 2, time-outs 0" in lines
        # 60 mm and 0.1 % of it; nothing is mapped that says where the axis stands.
        assert "x active forward 60.0000 60.0600 – – mm" in lines
        age = re.compile(
            "x: its position was not read since its target was written "
            "(more than [0-9]+ s|less than 1 s|[0-9]+ s) ago"
        )
        assert any(map(age.fullmatch, lines)), lines
        assert "x x.tab 3 active cnc (127.0.0.1)" in lines
        assert typed("disable", config).returncode == 0
        until(config, lambda model: model["axes"]["x"]["compensation"] == "off")
        assert "x off forward 60.0000 60.0600 – – mm" in [
            " ".join(line.split()) for line in typed("status", config).stdout.splitlines()
        ]


@pytest.mark.parametrize("options", [(), ("--json",)])
def test_without_a_gateway_the_remedy_is_said(site: Site, options: tuple[str, ...]) -> None:
    none = typed("status", str(site.config), *options)
    assert (none.returncode, none.stdout) == (1, "")
    assert none.stderr == (
        f"{site.config}: no gateway runs: nothing listens at {site.socket}; "
        f"start it with: pitch-gateway run {site.config}\n"
    )


def test_a_command_gets_in_past_connections_that_do_nothing(site: Site) -> None:
    with gateway_of(site) as (gateway, master), contextlib.ExitStack() as stack:
        assert master.move(50_000) == 50_050
        for _ in range(10):
            idle = stack.enter_context(socket.socket(socket.AF_UNIX))
            idle.connect(str(site.socket))
        off = typed("disable", str(site.config))
        assert (off.returncode, off.stderr) == (0, "")
        assert master.move(60_000) == 60_000
        assert typed("status", str(site.config)).returncode == 0
    # Its listener is not among those that had to go.
    assert "relay-not-reached" not in [
        note["event"] for note in gateway.notes if note["timestamp"] < _stopping(gateway.notes)
    ]


def _stopping(notes: list[dict[str, Any]]) -> str:
    return next(str(note["timestamp"]) for note in notes if note["event"] == "stopping")
