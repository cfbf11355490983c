"""Pins what is installed into deploy/requirements.txt (make lock): the newest that pyproject.toml allows.

What builds the wheel of a checkout, compiled or not, goes into deploy/build-requirements.txt, and what a
release takes beside it into tools/release-requirements.txt. The files hold for every Python and every Linux
that the packages have wheels for. Each package is named with its hashes, and without the place that it comes
from.
"""

import itertools
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RUN = "deploy/requirements.txt"
BUILD = "deploy/build-requirements.txt"
RELEASE = "tools/release-requirements.txt"
# --no-config: what this machine says about indexes has no place in the files.
COMPILE = (
    *(
        "uv",
        "pip",
        "compile",
        "--quiet",
        "--no-config",
        "--universal",
        "--fork-strategy",
        "fewest",
        "--upgrade",
    ),
    *("--generate-hashes", "--annotation-style", "line", "--custom-compile-command", "make lock"),
)

HAS_WHEELS = ("uv", "pip", "compile", "--quiet", "--no-config", "--no-deps", "--only-binary", ":all:")
"""Fails where a package would have to be built on the machine that it is installed on."""
MACHINES = ("x86_64", "aarch64")
OLDEST = "manylinux_2_28"
"""The oldest C library that all packages have wheels for; Debian 12 has 2.36."""


def main() -> None:
    """Write the files."""
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text())
    python = ("--python-version", pyproject["project"]["requires-python"].removeprefix(">="))
    run(*COMPILE, *python, "--output-file", RUN, "--extra", "uvloop", "pyproject.toml")
    needs = subprocess.run(
        [sys.executable, "tools/compiled.py", "--needs"], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout
    requirements = "\n".join([*pyproject["build-system"]["requires"], needs])
    run(*COMPILE, *python, "--output-file", BUILD, "--constraint", RUN, "-", given=requirements)
    tools = "\n".join(pyproject["project"]["optional-dependencies"]["release"])
    constraints = ("--constraint", RUN, "--constraint", BUILD)
    run(*COMPILE, *python, "--output-file", RELEASE, *constraints, "-", given=tools)
    claimed = re.findall(r"Python :: (3\.\d+)", " ".join(pyproject["project"]["classifiers"]))
    for version, machine, file in itertools.product(claimed, MACHINES, (RUN, BUILD)):
        run(*HAS_WHEELS, "--python-version", version, "--python-platform", f"{machine}-{OLDEST}", file)


def run(*module: str, given: str = "") -> None:
    """Run a module of Python, which reads what it is given."""
    command = [sys.executable, "-m", *module]
    done = subprocess.run(command, input=given, text=True, check=False, cwd=ROOT, stdout=subprocess.DEVNULL)
    if done.returncode:
        sys.exit("not every file could be written anew; what is said above is the reason")


if __name__ == "__main__":
    main()
