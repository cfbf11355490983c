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
UV = ("uv", "pip", "compile", "--quiet", "--no-config")
LOCK = (
    *(*UV, "--universal", "--fork-strategy", "fewest", "--upgrade", "--generate-hashes"),
    *("--annotation-style", "line", "--custom-compile-command", "make lock", "--output-file"),
)
HAS_WHEELS = (*UV, "--no-deps", "--only-binary", ":all:")
"""Fails where a package would have to be built on the machine that it is installed on."""
MACHINES = ("x86_64", "aarch64")
OLDEST = "manylinux_2_28"
"""The oldest C library that all packages have wheels for; Debian 12 has 2.36."""


def main() -> None:
    """Write the files."""
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text())
    project = pyproject["project"]
    python = ("--python-version", project["requires-python"].removeprefix(">="))
    run(*LOCK, RUN, *python, "pyproject.toml")
    needs = subprocess.run(
        [sys.executable, "tools/compiled.py", "--needs"], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout.splitlines()
    build = [*pyproject["build-system"]["requires"], *needs]
    run(*LOCK, BUILD, *python, "--constraint", RUN, "-", given="\n".join(build))
    release = project["optional-dependencies"]["release"]
    run(*LOCK, RELEASE, *python, "--constraint", RUN, "--constraint", BUILD, "-", given="\n".join(release))
    claimed = re.findall(r"Python :: (3\.\d+)", " ".join(project["classifiers"]))
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
