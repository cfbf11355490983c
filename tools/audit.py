"""Asks whether a hole is known in a package that we name (make audit); pip-audit asks the package index.

Asked are those that are pinned, and the lowest versions that pyproject.toml allows: a plain `pip install`
keeps such a one where it finds it.

Exit codes: 0 none is known; 1 some are, each named; 3 the data could not be reached for at least one package,
and no hole is known in the others. (`make audit` itself ends with 2 where this does not end with 0.)
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from tools import lowest

ROOT = Path(__file__).resolve().parent.parent
FILES = ("deploy/requirements.txt", "deploy/build-requirements.txt", "tools/release-requirements.txt")
KNOWN, UNREACHED = 1, 3


def judge(report: dict[str, Any]) -> tuple[int, list[str]]:
    """Return the exit code and what to say for what pip-audit found."""
    packages = report["dependencies"]
    unasked = [package["name"] for package in packages if "skip_reason" in package]
    holes = [
        f"{package['name']} {package['version']}: {hole['id']}, mended in "
        + (", ".join(hole["fix_versions"]) or "no release yet")
        for package in packages
        for hole in package.get("vulns", ())
    ]
    said = list(holes)
    if unasked:
        said.append(
            f"not audited: the index has no data of advisories on {len(unasked)} of {len(packages)} packages "
            "(a mirror has none as a rule); run it where the index itself is reached"
        )
    if holes:
        remedy = "make lock pins the newest versions that pyproject.toml allows; a lowest one is raised there"
        return KNOWN, [*said, remedy]
    return (UNREACHED, said) if unasked else (0, [f"no hole is known in {len(packages)} packages"])


def main() -> int:
    """Ask and say."""
    pinned = [word for file in FILES for word in ("--requirement", file)]
    with tempfile.TemporaryDirectory() as folder:
        floors = Path(folder, "lowest.txt")
        floors.write_text("\n".join(lowest.of_project()))
        reports = [ask(*pinned, "--require-hashes"), ask("--requirement", str(floors), "--no-deps")]
    packages = []
    for report in reports:
        if isinstance(report, str):
            print(
                f"not audited: the data of advisories could not be reached; run it with a network ({report})"
            )
            return UNREACHED
        packages += report["dependencies"]
    code, said = judge({"dependencies": packages})
    print("\n".join(said))
    return code


def ask(*options: str) -> dict[str, Any] | str:
    """Return what pip-audit reports of some requirements; a text: why it could not."""
    command = [sys.executable, "-m", "pip_audit", *options, "--disable-pip"]
    done = subprocess.run(
        [*command, "--progress-spinner", "off", "--format", "json"],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
    )
    try:
        report: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        said = (done.stderr.strip().splitlines() or ["pip-audit said nothing"])[-1]
        return said.partition(" (Caused by")[0]
    return report


if __name__ == "__main__":
    sys.exit(main())
