"""The list of what is installed, and the judged holes in it."""

import base64
import hashlib
import re
import tomllib
from importlib.metadata import distributions
from pathlib import Path

from gateway.commissioning.evidence.inventory import Packages, add_records, by_name, judged_holes, sbom, vex

PYPROJECT = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
CODE = b"print()\n"


def installed(folder: Path, name: str, version: str, *about: str) -> Path:
    """Install a package with one module and its RECORD; return the module."""
    module = folder / f"{name.lower()}.py"
    module.write_bytes(CODE)
    info = folder / f"{name}-{version}.dist-info"
    info.mkdir()
    lines = ("Metadata-Version: 2.4", f"Name: {name}", f"Version: {version}", *about)
    (info / "METADATA").write_text("\n".join(lines) + "\n")
    digest = base64.urlsafe_b64encode(hashlib.sha256(CODE).digest()).rstrip(b"=").decode()
    (info / "RECORD").write_text(f"{module.name},sha256={digest},{len(CODE)}\n{info.name}/RECORD,,\n")
    return module


def packages(folder: Path) -> Packages:
    return by_name(distributions(path=[str(folder)]))


def test_every_package_has_its_version_its_licence_and_what_it_needs(tmp_path: Path) -> None:
    installed(
        tmp_path,
        "Foo_Bar",
        "1.2",
        "License-Expression: MIT",
        "Requires-Dist: baz>=1",
        'Requires-Dist: quux; python_version < "3"',
        'Requires-Dist: quux; extra == "more"',
        "Requires-Dist: absent",
    )
    installed(
        tmp_path, "baz", "2+local", "Classifier: License :: OSI Approved :: BSD License", "License: long"
    )
    installed(tmp_path, "quux", "3", "License: One line")
    installed(tmp_path, "pitch-gateway", "1.0.0", "License-Expression: MIT", "Requires-Dist: Foo.Bar")
    bom = sbom(packages(tmp_path), "1.0.0")
    assert (bom["bomFormat"], bom["specVersion"]) == ("CycloneDX", "1.6")
    assert bom["metadata"]["component"]["purl"] == "pkg:pypi/pitch-gateway@1.0.0"
    found = {each["name"]: (each["version"], each["purl"], each["licenses"]) for each in bom["components"]}
    assert found == {
        "foo-bar": ("1.2", "pkg:pypi/foo-bar@1.2", [{"expression": "MIT"}]),
        "baz": ("2+local", "pkg:pypi/baz@2%2Blocal", [{"license": {"name": "BSD License"}}]),
        "quux": ("3", "pkg:pypi/quux@3", [{"license": {"name": "One line"}}]),
    }
    assert {each["ref"]: each["dependsOn"] for each in bom["dependencies"]} == {
        "pkg:pypi/pitch-gateway@1.0.0": ["pkg:pypi/foo-bar@1.2"],
        "pkg:pypi/foo-bar@1.2": ["pkg:pypi/baz@2%2Blocal"],
        "pkg:pypi/baz@2%2Blocal": [],
        "pkg:pypi/quux@3": [],
    }


def test_a_file_that_was_changed_or_removed_since_it_was_installed_is_named(tmp_path: Path) -> None:
    installed(tmp_path, "good", "1")
    installed(tmp_path, "changed", "2").write_bytes(CODE + b"\n")
    installed(tmp_path, "removed", "3").unlink()
    installed(tmp_path, "unrecorded", "4")
    (tmp_path / "unrecorded-4.dist-info" / "RECORD").unlink()
    found = packages(tmp_path)
    bom = sbom(found, "1.0.0")
    assert sorted(add_records(bom, found)) == [
        "changed 2: changed.py was changed since it was installed",
        "pitch-gateway 1.0.0 has no RECORD: its files cannot be checked",
        "removed 3: removed.py: No such file or directory",
        "unrecorded 4 has no RECORD: its files cannot be checked",
    ]
    good = next(each for each in bom["components"] if each["name"] == "good")
    record = (tmp_path / "good-1.dist-info" / "RECORD").read_bytes()
    [file] = good["components"]
    assert file["hashes"] == [{"alg": "SHA-256", "content": hashlib.sha256(record).hexdigest()}]


def test_a_judged_hole_is_resolved_from_the_version_on_that_mends_it(tmp_path: Path) -> None:
    installed(tmp_path, "h11", "0.16.0")  # GHSA-vqfr-h8mv-ghfj is mended in 0.16.0
    installed(tmp_path, "starlette", "1.2.9")  # GHSA-86qp-5c8j-p5mr in 1.0.1, CVE-2026-54283 in 1.3.1
    found = packages(tmp_path)
    bom = {**sbom(found, "1.0.0"), "serialNumber": "urn:uuid:0"}
    said = vex(bom, found)
    assert {each["id"]: each["analysis"]["state"] for each in said["vulnerabilities"]} == {
        "GHSA-vqfr-h8mv-ghfj": "resolved",
        "GHSA-86qp-5c8j-p5mr": "resolved",
        "CVE-2026-54283": "in_triage",
    }
    last = said["vulnerabilities"][-1]
    assert last["recommendation"] == "Install starlette 1.3.1 or newer."
    assert last["affects"] == [
        {
            "ref": "urn:cdx:0/1#pkg%3Apypi%2Fstarlette%401.2.9",
            "versions": [{"version": "1.2.9", "status": "affected"}],
        }
    ]


def test_without_a_judged_hole_the_list_is_empty_and_says_what_it_is(tmp_path: Path) -> None:
    said = vex({**sbom({}, "1.0.0"), "serialNumber": "urn:uuid:0"}, {})
    assert said["vulnerabilities"] == []
    [scope] = said["metadata"]["properties"]
    assert scope["value"].startswith("Only holes that the project has judged.")


def test_the_judged_holes_are_those_that_pyproject_names_and_lets_in_no_version_of() -> None:
    dependencies = PYPROJECT.partition("\ndependencies = [")[2].partition("\n]")[0]
    named = set(re.findall(r"GHSA(?:-\w{4}){3}|CVE-\d+-\d+", dependencies))
    assert {hole["id"] for hole in judged_holes()} == named
    lowest = dict(
        each.split(">=") for each in tomllib.loads(PYPROJECT)["project"]["dependencies"] if ">=" in each
    )
    for hole in judged_holes():
        numbers = [tuple(map(int, text.split("."))) for text in (hole["fixed"], lowest[hole["package"]])]
        assert numbers == sorted(numbers), hole
