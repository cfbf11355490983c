"""Writes the list of what is installed, as CycloneDX: ``python -m tools.sbom PYTHON SOURCES VERSION FILE``.

PYTHON is that of an environment with nothing in it but pitch-gateway and what it runs on, SOURCES the sources
that it was made from. Runs where cyclonedx-bom is installed (tools/release-requirements.txt), whose library
checks the result. The hashes are those of deploy/requirements.txt: of each package all files that an
installation takes, for the Python and the machine decide which one it is.
"""

import argparse
import datetime as dt
import json
import os
import re
import subprocess
import sys
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

from gateway.commissioning.evidence.inventory import by_name, normal, sbom

SCHEMA = SchemaVersion.V1_6


def found(python: Path, version: str) -> dict[str, Any]:
    """Return what is installed in an environment, with the time of the commit."""
    command = [str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
    folder = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True).stdout.strip()
    bom = sbom(by_name(distributions(path=[folder])), version)
    if epoch := os.environ.get("SOURCE_DATE_EPOCH"):
        bom["metadata"]["timestamp"] = dt.datetime.fromtimestamp(int(epoch), dt.UTC).isoformat()
    return bom


def hashes(requirements: str) -> dict[tuple[str, str], list[str]]:
    """Return the SHA-256 of each file that a package and version may be."""
    pinned: dict[tuple[str, str], list[str]] = {}
    for entry in requirements.replace("\\\n", " ").splitlines():
        if match := re.match(r"([\w.-]+)==(\S+)", entry):
            pinned[normal(match[1]), match[2]] = re.findall(r"--hash=sha256:(\w+)", entry)
    return pinned


def completed(bom: dict[str, Any], pinned: dict[tuple[str, str], list[str]]) -> dict[str, Any]:
    """Return the list with hashes; what is not pinned is refused."""
    for component in bom["components"]:
        key = component["name"], component["version"]
        if key not in pinned:
            sys.exit(f"{'=='.join(key)} is installed, but deploy/requirements.txt does not pin it")
        # Of each file of this version that deploy/requirements.txt lets in.
        component["hashes"] = [{"alg": "SHA-256", "content": each} for each in pinned[key]]
    return bom


def main() -> None:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("python", type=Path)
    parser.add_argument("sources", type=Path)
    parser.add_argument("version")
    parser.add_argument("file", type=Path)
    options = parser.parse_args()
    pinned = hashes((options.sources / "deploy" / "requirements.txt").read_text())
    bom = completed(found(options.python, options.version), pinned)
    text = json.dumps(bom, indent=2, ensure_ascii=False) + "\n"
    if error := JsonStrictValidator(SCHEMA).validate_str(text):
        sys.exit(f"what was made is no CycloneDX {SCHEMA.to_version()}: {str(error).splitlines()[0]}")
    options.file.write_text(text)


if __name__ == "__main__":
    main()
