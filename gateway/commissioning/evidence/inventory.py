"""What is installed, as CycloneDX 1.6 (SBOM), and what the project says of known holes in it (VEX).

Format: https://cyclonedx.org/docs/1.6/json/. `make release` uses the same list (tools/sbom.py).
"""

import base64
import hashlib
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageMetadata, PackagePath
from importlib.resources import files
from typing import Any, Final
from urllib.parse import quote
from uuid import NAMESPACE_URL, uuid5

from packaging.requirements import Requirement
from packaging.version import Version

OURS: Final = "pitch-gateway"
JUDGED: Final = "judged_holes.toml"
SCOPE: Final = "Only holes that the project has judged. For all others give sbom.cdx.json to a scanner."
_SPEC: Final = {"bomFormat": "CycloneDX", "specVersion": "1.6", "version": 1}


def normal(name: str) -> str:
    """Return a name as the index of packages spells it.

    >>> normal("Foo._Bar")
    'foo-bar'
    """
    return re.sub(r"[-_.]+", "-", name).lower()


@dataclass(frozen=True, slots=True)
class Package:
    """An installed package. ``about`` is parsed once: a Distribution parses it each time."""

    name: str
    """As :func:`normal` spells it."""
    version: str
    about: PackageMetadata
    found: Distribution


Packages = Mapping[str, Package]
"""By name."""


def by_name(found: Iterable[Distribution]) -> Packages:
    """Return packages by name; the first one of a name is the one that Python imports."""
    packages: dict[str, Package] = {}
    for each in found:
        about = each.metadata
        name = normal(about["Name"])
        packages.setdefault(name, Package(name, about["Version"], about, each))
    return dict(sorted(packages.items()))


def sbom(packages: Packages, version: str) -> dict[str, Any]:
    """Return the list of packages below this release of pitch-gateway, without times and random numbers."""
    refs = {name: _purl(name, each.version) for name, each in packages.items() if name != OURS}
    refs[OURS] = _purl(OURS, version)
    return {
        **_SPEC,
        "metadata": {
            "component": {"type": "application", **_described(OURS, version, packages.get(OURS))},
        },
        "components": [
            {"type": "library", **_described(name, each.version, each)}
            for name, each in packages.items()
            if name != OURS
        ],
        "dependencies": [
            {
                "ref": ref,
                "dependsOn": sorted({refs[each] for each in _needs(packages.get(name)) & refs.keys()}),
            }
            for name, ref in refs.items()
        ],
    }


def add_records(bom: dict[str, Any], packages: Packages) -> Iterator[str]:
    """Give each package the digest of its RECORD; yield each file that differs from what RECORD says."""
    for component in (bom["metadata"]["component"], *bom["components"]):
        name = f"{component['name']} {component['version']}"
        package = packages.get(component["name"])
        files = (package and package.found.files) or ()
        record = next((each for each in files if each.name == "RECORD"), None)
        if record is None:
            yield f"{name} has no RECORD: its files cannot be checked"
            continue
        hashes = [{"alg": "SHA-256", "content": hashlib.sha256(record.read_binary()).hexdigest()}]
        component["components"] = [{"type": "file", "name": f"{name}: RECORD", "hashes": hashes}]
        yield from (f"{name}: {change}" for change in _changes(files))


def vex(bom: Mapping[str, Any], packages: Packages) -> dict[str, Any]:
    """Return the judged holes of the packages in a list that has a serial number."""
    serial = bom["serialNumber"].removeprefix("urn:uuid:")
    holes = []
    for hole in judged_holes():
        package = packages.get(hole["package"])
        if package is None:
            continue
        fixed, here = hole["fixed"], package.version
        is_good = Version(here) >= Version(fixed)
        ref = f"urn:cdx:{serial}/1#{quote(_purl(hole['package'], here), safe='')}"
        status = "unaffected" if is_good else "affected"
        holes.append(
            {
                "id": hole["id"],
                "description": hole["what"],
                "recommendation": f"Install {hole['package']} {fixed} or newer.",
                "analysis": {
                    "state": "resolved" if is_good else "in_triage",
                    "detail": f"{hole['package']} before {fixed} has it; {here} is installed.",
                },
                "affects": [{"ref": ref, "versions": [{"version": here, "status": status}]}],
            }
        )
    about = {"properties": [{"name": "pitch-gateway:scope", "value": SCOPE}]}
    return {**_SPEC, "metadata": {**bom["metadata"], **about}, "vulnerabilities": holes}


def judged_holes() -> list[dict[str, str]]:
    """Return the holes that the project has judged: ``id``, ``package``, first ``fixed`` version, ``what``.

    Source: the comments in pyproject.toml.
    """
    text = (files(__package__) / JUDGED).read_text(encoding="utf-8")
    found: list[dict[str, str]] = tomllib.loads(text)["hole"]
    return found


def serial_number(content: str) -> str:
    """Return a serial number for a list: the same content has the same."""
    return f"urn:uuid:{uuid5(NAMESPACE_URL, content)}"


def _purl(name: str, version: str) -> str:
    return f"pkg:pypi/{name}@{quote(version, safe='')}"


def _described(name: str, version: str, package: Package | None) -> dict[str, Any]:
    purl = _purl(name, version)
    described = {"bom-ref": purl, "name": name, "version": version, "purl": purl}
    return described if package is None else {**described, "licenses": _licences(package.about)}


def _licences(about: PackageMetadata) -> list[dict[str, Any]]:
    """Return what a package says of its licence; classifiers before the text, which may be all of it."""
    if "License-Expression" in about:
        return [{"expression": about["License-Expression"]}]
    classifiers = about.get_all("Classifier") or []
    names = [each.rpartition(" :: ")[2] for each in classifiers if each.startswith("License ::")]
    if not names and "License" in about:
        names = about["License"].strip().splitlines()[:1]
    return [{"license": {"name": name}} for name in names]


def _needs(package: Package | None) -> set[str]:
    """Return the names of the packages that one needs here, without its extras."""
    needed = (package.about.get_all("Requires-Dist") or ()) if package is not None else ()
    return {
        normal(each.name)
        for each in map(Requirement, needed)
        if each.marker is None or each.marker.evaluate({"extra": ""})
    }


def _changes(files: Iterable[PackagePath]) -> Iterator[str]:
    """Yield each file that is missing, or has another digest than in RECORD."""
    for file in files:
        if file.hash is None or file.hash.mode != "sha256":
            continue  # RECORD itself, and what Python compiled
        try:
            digest = hashlib.sha256(file.read_binary()).digest()
        except OSError as error:
            yield f"{file}: {error.strerror or error}"
            continue
        if base64.urlsafe_b64encode(digest).rstrip(b"=").decode() != file.hash.value:
            yield f"{file} was changed since it was installed"
