"""The man pages are whole and well formed; a shell completes the command for real."""

import os
import pty
import re
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
import typer.main

from gateway.cli.main import app
from tests.child import started

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def man(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("man")
    subprocess.run([sys.executable, ROOT / "tools" / "man_pages.py", folder], check=True)
    return folder


def test_every_command_has_a_page_with_its_options(man: Path) -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    for name, command in commands.items():
        page = (man / f"pitch-gateway-{name}.1").read_text()
        assert f"pitch\\-gateway {name}".replace("-", "-") in page
        for parameter in command.params:
            if parameter.param_type_name == "option":
                for option in parameter.opts:
                    assert option.replace("-", "\\-") in page, (name, option)
        for sub in getattr(command, "commands", {}):
            assert (man / f"pitch-gateway-{name}-{sub}.1").exists()
            assert f"pitch\\-gateway\\-{name}\\-{sub} (1)" in page


def test_signs_of_roff_in_a_text_stay_text(man: Path) -> None:
    page = (man / "pitch-gateway-table.1").read_text()
    assert "Centroid .tab" in page  # a line that begins with a point would be a command that does not exist
    for path in man.iterdir():
        commands = {line.split()[0] for line in path.read_text().splitlines() if line.startswith((".", "'"))}
        assert commands <= {".TH", ".SH", ".TP", ".PP", ".B", ".I", ".BR", ".nf", ".fi"}, path


@pytest.mark.skipif(shutil.which("mandoc") is None, reason="mandoc is not there (Debian: mandoc)")
def test_mandoc_finds_nothing(man: Path) -> None:
    done = subprocess.run(
        ["mandoc", "-T", "lint", "-W", "warning", *map(str, sorted(man.iterdir()))],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("", "")


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("completions")
    subprocess.run([sys.executable, ROOT / "tools" / "completions.py", folder], check=True)
    command = folder / "bin" / "pitch-gateway"
    command.parent.mkdir()
    command.write_text(f"#!{sys.executable}\nfrom gateway.cli.main import main\nmain()\n")
    command.chmod(0o755)
    return folder


def typed_into(shell: list[str], lines: list[str], scripts: Path, wanted: str) -> str:
    """Type into an interactive shell on a terminal until it shows what is wanted, or patience ends."""
    ours, theirs = pty.openpty()
    environment = {
        "PATH": f"{scripts / 'bin'}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "TERM": "dumb",
        "HOME": str(scripts),
        "PS1": "ready> ",
    }
    options = {"stdin": theirs, "stdout": theirs, "stderr": theirs, "env": environment}
    with started(shell, start_new_session=True, **options):
        os.close(theirs)
        for line in lines:
            os.write(ours, line.encode())
        shown = ""
        deadline = time.monotonic() + PATIENCE_S
        while not re.search(wanted, shown) and time.monotonic() < deadline:
            if select.select([ours], [], [], 0.1)[0]:
                shown += os.read(ours, 4096).decode(errors="replace")
    os.close(ours)
    return shown


def test_bash_completes_a_command(scripts: Path) -> None:
    source = f"source {scripts}/bash/pitch-gateway\n"
    # `ta` and TAB make `table `; what was typed itself shows `ta` only.
    shown = typed_into(
        ["bash", "--norc", "-i"], [source, "echo : pitch-gateway\n", "pitch-gateway ta\t"], scripts, "table "
    )
    assert re.search(r"pitch-gateway table $", shown), shown


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not there")
def test_zsh_completes_with_the_first_tab(scripts: Path) -> None:
    start = f"fpath=({scripts}/zsh $fpath); autoload -U compinit; compinit -u -D\n"
    shown = typed_into(["zsh", "-f", "-i"], [start, "pitch-gateway ta\t"], scripts, "table")
    assert re.search(r"pitch-gateway ta.*table", shown, re.DOTALL), shown


@pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not there")
def test_fish_completes_a_command(scripts: Path) -> None:
    command = f"source {scripts}/fish/pitch-gateway.fish; complete --do-complete 'pitch-gateway ta'"
    environment = {
        "PATH": f"{scripts / 'bin'}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "HOME": str(scripts),
    }
    done = subprocess.run(
        ["fish", "-c", command], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.split()[0] == "table"
