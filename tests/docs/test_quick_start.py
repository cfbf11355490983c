"""The first hour in five commands: pasted as they stand, with the two lines that it promises."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

from tests.docs.pages import blocks
from tests.support.ports import free_port

ROOT = Path(__file__).parents[2]
PASTED, SAID, LOOKED, *_ = blocks("first-hour.md")


def test_from_an_empty_clone_to_the_first_corrected_move_it_is_five_commands(tmp_path: Path) -> None:
    """What ``make program`` installs is there. The ports are this test's own: the page's may be taken."""
    commands = PASTED.text.splitlines()
    assert len(commands) <= 5
    for folder in ("desk", "tables"):
        shutil.copytree(ROOT / "deploy" / folder, tmp_path / "deploy" / folder)
    # The status is a second old at most; a person needs longer to read the line and to paste the next one.
    shown = "until pitch-gateway status gateway.toml | grep -q -e ' -150[.]0120 '; do :; done"
    script = "\n".join(["make() { :; }", *commands, shown, LOOKED.text, "kill %1 %2; wait"])
    configuration = tmp_path / "deploy" / "desk" / "gateway.toml"
    for port in ("5020", "1502", "8480"):
        own = str(free_port())
        script = script.replace(f"controller.py {port}", f"controller.py {own}")
        configuration.write_text(configuration.read_text().replace(f":{port}", f":{own}"))
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", script],
        cwd=tmp_path,
        env=os.environ | {"HOME": str(tmp_path / "home"), "PATH": path},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.stdout.startswith(SAID.text), done.stdout + done.stderr
    assert re.search(r"x +active +backward +-150\.0000 +-150\.0120", done.stdout)
    assert re.search(r"added +│ -0\.0029 mm +│ -0\.0121 mm", done.stdout)


def test_nobody_misses_the_controller_of_the_desk_once_it_has_ended() -> None:
    """It ends with the fifth command; the page that is looked at then shall not warn of it."""
    desk = tomllib.loads((ROOT / "deploy" / "desk" / "gateway.toml").read_text())
    assert [each["silent_after_s"] for each in desk["line"]["main"]["controllers"]] == [0]


def test_it_is_read_in_a_few_minutes() -> None:
    text = (ROOT / "docs" / "first-hour.md").read_text().split("## Step by step")[0]
    assert len(text.split()) <= 400
