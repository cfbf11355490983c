"""The udev rules: read by udev itself where that is possible, and by their grammar everywhere."""

import os
import re
import shutil
from pathlib import Path

import pytest

from tests.support.programs import ran

RULES = Path(__file__).parents[2] / "deploy" / "udev" / "60-pitch-gateway.rules"
PART = re.compile(r'(?P<key>[A-Z_]+(?:\{[^}]+\})?)(?P<operator>==|!=|\+=|:=|=)"(?P<value>[^"]*)"')
MATCHES = {"ACTION", "SUBSYSTEM", "SUBSYSTEMS", "DRIVERS"}
SETS = {"GROUP", "MODE", "SYMLINK", "GOTO", "LABEL"}


def lines() -> list[str]:
    return [line for line in RULES.read_text().splitlines() if line and not line.startswith("#")]


def test_every_line_is_a_rule() -> None:
    for line in lines():
        parts = [PART.fullmatch(part.strip()) for part in line.split(",")]
        assert all(parts), line
        for part in parts:
            assert part is not None
            key, operator = part["key"], part["operator"]
            name = key.partition("{")[0]
            assert name in MATCHES | SETS | {"ENV", "ATTR", "IMPORT"}, line
            assert (operator in ("==", "!=")) or name not in MATCHES, line
    labels = [line for line in lines() if line.startswith("LABEL")]
    assert labels == ['LABEL="pitch_gateway_end"']
    assert all('GOTO="pitch_gateway_end"' in line for line in lines() if "GOTO" in line)


def test_the_port_is_safe_fast_and_has_names_that_stay() -> None:
    text = "\n".join(lines())
    assert 'GROUP="dialout", MODE="0660"' in text
    assert 'ENV{ID_MM_PORT_IGNORE}="1"' in text
    assert 'ATTR{device/latency_timer}="1"' in text
    assert 'SYMLINK+="pitch-gateway/by-serial/$env{ID_SERIAL_SHORT}-port$env{.PITCH_GATEWAY_PORT}"' in text
    assert 'SYMLINK+="pitch-gateway/by-socket/$env{ID_PATH}"' in text


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can show the rules to udev without installing them")
@pytest.mark.skipif(shutil.which("udevadm") is None, reason="there is no udevadm (Debian: udev)")
def test_udev_takes_them(tmp_path: Path) -> None:
    # In a mount namespace of its own; a line that is wrong is named with the file and its number.
    command = (
        'mount -t tmpfs tmpfs /run && mkdir -p /run/udev/rules.d && cp "$0" /run/udev/rules.d/ && '
        "udevadm test --action=add /sys/class/tty/tty0 2>&1"
    )
    wrong = tmp_path / "61-wrong.rules"
    wrong.write_text('SUBSYSTEM=="tty", NONSENSE=="1"\n')
    done = [
        ran("unshare", "--mount", "sh", "-c", command, path, env=os.environ | {"SYSTEMD_LOG_LEVEL": "debug"})
        for path in (RULES, wrong)
    ]
    if "rules.d/61-wrong.rules:1" not in done[1].stdout:
        pytest.skip(f"udev does not read rules here: {done[1].stdout[-200:]}")
    assert f"{RULES.name}:" not in done[0].stdout.replace(f"{RULES.name}:1 ", "")
    assert RULES.name in done[0].stdout
