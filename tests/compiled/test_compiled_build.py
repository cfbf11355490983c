"""The sources can be compiled, and an installation says whether they were (docs/decisions/0014)."""

import subprocess
import sys
from pathlib import Path

import pytest

from gateway import __version__
from gateway.compiled import HOT_MODULE, is_compiled

ROOT = Path(__file__).resolve().parent.parent.parent
TOOL = ROOT / "tools" / "compiled.py"


def run(*words: str | Path, folder: Path = ROOT) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, *map(str, words)], capture_output=True, text=True, check=False, cwd=folder
    )


def test_the_hot_path_becomes_c_and_the_checkout_stays_as_it_is(tmp_path: Path) -> None:
    before = sorted(ROOT.joinpath("gateway").rglob("*.so"))
    done = run(TOOL, "--only-c", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "error" not in done.stdout
    assert (tmp_path / "gateway" / "exchange" / "line.py").read_bytes() == (
        ROOT / "gateway" / "exchange" / "line.py"
    ).read_bytes()
    assert sorted(ROOT.joinpath("gateway").rglob("*.so")) == before


def test_a_construct_that_cannot_be_compiled_is_named(tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    for folder in ("gateway", "tools"):
        copied = run("-c", f"import shutil; shutil.copytree({str(ROOT / folder)!r}, {str(copy / folder)!r})")
        assert copied.returncode == 0
    module = copy / "gateway" / "exchange" / "counters.py"
    module.write_text(
        module.read_text() + "\n\ndef late() -> type:\n    class Late:\n        pass\n    return Late\n"
    )
    done = run(copy / "tools" / "compiled.py", "--only-c", tmp_path / "out", folder=copy)
    assert done.returncode != 0
    assert "gateway/exchange/counters.py" in done.stdout + done.stderr


def test_a_folder_that_holds_a_package_is_not_written_over(tmp_path: Path) -> None:
    (tmp_path / "gateway").mkdir()
    done = run(TOOL, tmp_path)
    assert done.returncode == 1
    assert done.stderr == f"{tmp_path / 'gateway'} exists; remove it or name another folder\n"


def test_the_version_says_whether_it_is_compiled() -> None:
    done = run("-c", "from gateway.cli.main import main; main()", "--version")
    assert done.stdout == f"pitch-gateway {__version__}{' (compiled)' if is_compiled() else ''}\n"
    loaded = sys.modules.get(HOT_MODULE) or __import__(HOT_MODULE, fromlist=["LineExchange"])
    assert is_compiled() is not str(loaded.__file__).endswith(".py")


@pytest.mark.parametrize("value", ["yes", "2", " 1"])
def test_an_answer_that_is_none_is_refused(value: str) -> None:
    setting = f"import os; os.environ['PITCH_GATEWAY_COMPILED'] = {value!r}"
    code = f"{setting}; import compile_hook; compile_hook.is_wanted()"
    done = run("-c", code, folder=ROOT / "tools")
    assert done.returncode == 1
    assert done.stderr == f"PITCH_GATEWAY_COMPILED = {value!r}: 1 compiles, 0 or nothing does not\n"
