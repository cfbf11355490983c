"""Runs ``make test-anywhere`` on every Python that pyproject.toml claims and this machine has.

    make test-pythons
    make test-pythons PYTHONS="/opt/python3.13/bin/python3 ~/python3.14/bin/python3"

Interpreters are those that PYTHONS names, then python3.X on the PATH, then python3. Each has an environment
of its own in build/pythons. The exit code is 1 where one failed or none was found.
"""

import os
import re
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple
from xml.etree import ElementTree as ET

ROOT: Final = Path(__file__).parents[1]
ENVIRONMENTS: Final = ROOT / "build" / "pythons"
CLASSIFIER: Final = re.compile(r"Programming Language :: Python :: (3\.\d+)")
ASKED: Final = "import platform, sys; print('%d.%d' % sys.version_info[:2], platform.python_version())"


class Result(NamedTuple):
    """What one Python did: numbers of tests, and seconds with the making of its environment."""

    passed: int
    failed: int
    skipped: int
    seconds: float


def claimed() -> list[str]:
    """Return the versions that pyproject.toml claims, as "3.11"."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return [found[1] for each in project["classifiers"] if (found := CLASSIFIER.fullmatch(each))]


def candidates(version: str) -> Iterator[str]:
    """Give what may be this Python, what the caller named first."""
    yield from os.environ.get("PYTHONS", "").split()
    for name in (f"python{version}", "python3"):
        for folder in os.get_exec_path():
            if (path := Path(folder, name)).is_file():
                yield str(path)


def find(version: str) -> tuple[str, str]:
    """Return the interpreter and its full version, ("", "") where there is none that runs."""
    for candidate in candidates(version):
        path = str(Path(candidate).expanduser())
        try:
            done = subprocess.run([path, "-c", ASKED], capture_output=True, text=True, check=False)
        except OSError:
            continue
        found, _, full = done.stdout.strip().partition(" ")
        if done.returncode == 0 and found == version:
            return path, full
    return "", ""


def run(version: str, python: str) -> Result:
    """Run the tests on one Python."""
    folder, report = ENVIRONMENTS / version, ENVIRONMENTS / f"{version}.xml"
    report.unlink(missing_ok=True)
    begun = time.monotonic()
    command = [
        "make",
        "--no-print-directory",
        "test-anywhere",
        f"VENV={folder.relative_to(ROOT)}",
        f"PYTHON={python}",
    ]
    # From the checkout on: pytest splits this at blanks, of which the path of the checkout may have some.
    options = f"--junitxml={report.relative_to(ROOT)}"
    done = subprocess.run(command, cwd=ROOT, env={**os.environ, "PYTEST_ADDOPTS": options}, check=False)
    seconds = time.monotonic() - begun
    if not report.exists():  # it did not come to a test; what was said is above
        return Result(0, 1, 0, seconds)
    suites = list(ET.parse(report).getroot().iter("testsuite"))  # noqa: S314 - pytest wrote it
    tests, failures, errors, skipped = (
        sum(int(suite.get(name, 0)) for suite in suites)
        for name in ("tests", "failures", "errors", "skipped")
    )
    failed = failures + errors
    return Result(tests - failed - skipped, failed or int(done.returncode != 0), skipped, seconds)


def main() -> int:
    """Run them all; returns the exit code."""
    lines, results = [], []
    ENVIRONMENTS.mkdir(parents=True, exist_ok=True)
    for version in claimed():
        python, full = find(version)
        if not python:
            lines.append(
                f"{version:8} not found: name one, make test-pythons PYTHONS=/path/to/python{version}"
            )
            continue
        print(f"== Python {full}: {python}", flush=True)
        result = run(version, python)
        results.append(result)
        minutes, seconds = divmod(round(result.seconds), 60)
        lines.append(
            f"{full:8} {result.passed:6} passed {result.failed:4} failed {result.skipped:4} skipped"
            f" {minutes:3} min {seconds:02} s"
        )
    print("\nPython", *lines, sep="\n")
    return 0 if results and not any(result.failed or not result.passed for result in results) else 1


if __name__ == "__main__":
    sys.exit(main())
