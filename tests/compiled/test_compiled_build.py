"""The sources can be compiled, and an installation says whether they were (docs/decisions/0028)."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
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


def test_the_hot_path_becomes_c_and_the_checkout_stays_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")  # which is not needed so far
    before = sorted(ROOT.joinpath("gateway").rglob("*.so"))
    done = run(TOOL, "--only-c", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "error" not in done.stdout
    assert (tmp_path / "gateway" / "exchange" / "line.py").read_bytes() == (
        ROOT / "gateway" / "exchange" / "line.py"
    ).read_bytes()
    assert sorted(ROOT.joinpath("gateway").rglob("*.so")) == before


def copied(to: Path) -> Path:
    """A copy of what a wheel is built from, to spoil."""
    for folder in ("gateway", "tools"):
        shutil.copytree(ROOT / folder, to / folder, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, to)
    return to


def test_what_the_compiling_needs_is_what_pyproject_declares_of_what_is_imported() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    declared = [*project["dependencies"], *project["optional-dependencies"]["dev"]]
    done = run(TOOL, "--needs")
    assert (done.returncode, done.stderr) == (0, "")
    needs = done.stdout.splitlines()
    assert [re.split("[<>=]", need)[0] for need in needs] == [
        "fastcrc",
        "librt",
        "msgspec",
        "mypy",
        "setuptools",
    ]
    assert set(needs) <= set(declared)


def test_an_import_that_no_dependency_covers_is_named(tmp_path: Path) -> None:
    copy = copied(tmp_path)
    # Not compiled itself: a compiled module imports it.
    module = copy / "gateway" / "recording" / "traffic.py"
    module.write_text("import some_package.of_others\n" + module.read_text())
    done = run(copy / "tools" / "compiled.py", "--needs")
    assert done.returncode == 1
    assert done.stderr.startswith("pyproject.toml: no dependency is called some_package, which ")


def test_a_machine_without_a_compiler_or_without_headers_is_told_which(tmp_path: Path) -> None:
    assert run(TOOL, "--missing").stdout == "\n"
    without = {**os.environ, "CC": "no-such-compiler -O2"}
    done = subprocess.run(
        [sys.executable, TOOL, "--missing"], capture_output=True, text=True, check=True, env=without
    )
    assert done.stdout == "there is no C compiler (no-such-compiler; Debian: apt install gcc python3-dev)\n"
    elsewhere = f"import sysconfig; sysconfig.get_path = lambda name: {str(tmp_path)!r}; import compiled"
    done = run("-c", f"{elsewhere}; print(compiled.missing())", folder=ROOT / "tools")
    assert done.stdout == f"there is no {tmp_path}/Python.h (Debian: apt install python3-dev)\n"
    (tmp_path / "Python.h").write_text("#include <no_such_header_of_the_c_library.h>\n")
    done = run("-c", f"{elsewhere}; print(compiled.missing())", folder=ROOT / "tools")
    assert done.stdout.startswith("the C compiler cannot read Python.h: ")
    assert "no_such_header_of_the_c_library.h: No such file" in done.stdout
    # What cannot be compiled is not begun.
    target = tmp_path / "made"
    done = subprocess.run(
        [sys.executable, TOOL, target], capture_output=True, text=True, check=False, env=without
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("there is no C compiler (no-such-compiler;")
    assert not target.exists()


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


# What mypy 2.4, gcc 12 and Python 3.11 said, shortened; the sentence is what a person is told of it.
MYPY = """gateway/exchange/line.py:87: warning: Treating generator comprehension as list
gateway/ipc/log.py:17: error: Unexpected keyword argument "frozen" for "__init_subclass__"  [call-arg]
gateway/ipc/log.py:21: error: Class cannot subclass "Struct" (has type "Any")  [misc]
"""
GCC = """build/__native_line.c: In function 'CPyDef_line':
build/__native_line.c:12:5: error: 'x' undeclared (first use in this function)
build/__native_line.c:19:5: error: 'y' undeclared (first use in this function)
error: command '/usr/bin/x86_64-linux-gnu-gcc' failed with exit code 1
"""
KILLED = """x86_64-linux-gnu-gcc: fatal error: Killed signal terminated program cc1
compilation terminated.
error: command '/usr/bin/x86_64-linux-gnu-gcc' failed with exit code 1
"""
FULL = """Traceback (most recent call last):
  File "tools/compiled.py", line 196, in <module>
OSError: [Errno 28] No space left on device
"""


@pytest.mark.parametrize(
    ("output", "told"),
    [
        (
            MYPY,
            'mypy refuses gateway/ipc/log.py:17: error: Unexpected keyword argument "frozen" for',
        ),
        (GCC, "build/__native_line.c:12:5: error: 'x' undeclared (first use in this function)"),
        (KILLED, "x86_64-linux-gnu-gcc: fatal error: Killed signal terminated program cc1"),
        (FULL, "the disk is full: free 150 MB in the folder of temporary files"),
        ("there is no C compiler (cc; Debian: apt install gcc)\n", "there is no C compiler (cc;"),
        ("", "it ended without a word"),
    ],
)
def test_the_first_real_error_is_told(output: str, told: str) -> None:
    done = run("-c", f"import compile_hook; print(compile_hook.reason({output!r}))", folder=ROOT / "tools")
    assert done.stdout.startswith(told)
    assert done.stdout.count("\n") == 1
    assert "compiler" not in done.stdout or "compiler" in output  # it is not blamed where it was there


def hatch(sources: Path, temporary: Path, *before: str) -> list[str]:
    """Try to build a compiled wheel in the environment that the tests run in; returns what was said."""
    out = sources / "out"
    for folder in (temporary, out):
        folder.mkdir()
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(out)]
    done = subprocess.run(
        [*before, *command],
        capture_output=True,
        text=True,
        check=False,
        cwd=sources,
        env={**os.environ, "PITCH_GATEWAY_COMPILED": "1", "TMPDIR": str(temporary)},
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert list(temporary.iterdir()) == list(out.iterdir()) == []
    return done.stderr.splitlines()


def compile_only(copy: Path, module: str) -> None:
    """Have a copy compile one module: mypy reads what that imports, and not all of the hot path."""
    tool = copy / "tools" / "compiled.py"
    text, count = re.subn(
        r"^(PATTERNS|PLAIN) = \([^)]*\)$",
        lambda found: f'{found[1]} = ("{module}",)' if found[1] == "PATTERNS" else f"{found[1]} = ()",
        tool.read_text(),
        flags=re.MULTILINE,
    )
    assert count == 2
    tool.write_text(text)


def test_a_construct_that_cannot_be_compiled_is_named_in_two_lines(tmp_path: Path) -> None:
    copy = copied(tmp_path / "copy")
    compile_only(copy, "exchange/counters.py")
    module = copy / "gateway" / "exchange" / "counters.py"
    line = module.read_text().count("\n") + 4
    module.write_text(
        module.read_text() + "\n\ndef late() -> type:\n    class Late:\n        pass\n    return Late\n"
    )
    first, second = hatch(copy, tmp_path / "temporary")
    assert first.startswith(
        f"pitch-gateway could not be compiled: mypy refuses gateway/exchange/counters.py:{line}: error: "
    )
    assert first.endswith(
        "(a mistake of this release, or a version of mypy or of a package that it was not made for)"
    )
    assert second == "without PITCH_GATEWAY_COMPILED=1 (install.sh: with --pure) it is installed as Python"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can mount a small disk")
def test_a_full_disk_is_told_as_one(tmp_path: Path) -> None:
    disk = tmp_path / "small"
    mount = f"mount -t tmpfs -o size=8m tmpfs '{disk}' && exec \"$@\""
    mounted = ["unshare", "--mount", "sh", "-c", mount, "-"]
    tried = ["unshare", "--mount", "mount", "-t", "tmpfs", "tmpfs", str(tmp_path)]
    if subprocess.run(tried, capture_output=True, check=False).returncode:
        pytest.skip("this root may not mount, as in most containers")
    copy = copied(tmp_path / "copy")
    compile_only(copy, "exchange/counters.py")
    said = hatch(copy, disk, *mounted)
    assert said[0].startswith("pitch-gateway could not be compiled: the disk is full: free 150 MB")
