"""Asks whether a hole is known in a pinned package (make audit); pip-audit asks the package index.

Exit codes: 0 none is known; 1 some are, each named; 3 the data could not be reached for at least one package,
and no hole is known in the others. (`make audit` itself ends with 2 where this does not end with 0.)
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

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
        return KNOWN, [*said, "make lock takes the newest versions that pyproject.toml allows"]
    return (UNREACHED, said) if unasked else (0, [f"no hole is known in {len(packages)} packages"])


def main() -> int:
    """Ask and say."""
    requirements = [word for file in FILES for word in ("--requirement", file)]
    command = [sys.executable, "-m", "pip_audit", *requirements, "--require-hashes", "--disable-pip"]
    done = subprocess.run(
        [*command, "--progress-spinner", "off", "--format", "json"],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
    )
    try:
        report = json.loads(done.stdout)
    except ValueError:
        reason = (done.stderr.strip().splitlines() or ["pip-audit said nothing"])[-1].partition(
            " (Caused by"
        )[0]
        print(f"not audited: the data of advisories could not be reached; run it with a network ({reason})")
        return UNREACHED
    code, said = judge(report)
    print("\n".join(said))
    return code


if __name__ == "__main__":
    sys.exit(main())
