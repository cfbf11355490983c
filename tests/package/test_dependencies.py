"""What the program depends on, and the licences of what it brings along."""

import re
import sys
import sysconfig
import tomllib
from importlib.metadata import PathDistribution, version
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.support.programs import ran
from tools import audit, bundled_licences, lock, lowest

ROOT = Path(__file__).parents[2]
PYPROJECT = (ROOT / "pyproject.toml").read_text()
RUN, BUILD, RELEASE = ROOT / lock.RUN, ROOT / lock.BUILD, ROOT / lock.RELEASE
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
MACHINES = ("x86_64", "aarch64")


def declared(text: str) -> list[str]:
    """Every requirement of a pyproject.toml."""
    parsed = tomllib.loads(text)
    extras = parsed["project"].get("optional-dependencies", {}).values()
    build = parsed.get("build-system", {}).get("requires", [])
    return [*build, *parsed["project"]["dependencies"], *(each for extra in extras for each in extra)]


def caps_without_reason(text: str) -> list[str]:
    """The requirements that keep newer versions out, and have no comment in their line or the one above."""
    lines = text.splitlines()
    found = []
    for requirement in declared(text):
        operators = {each.operator for each in Requirement(requirement).specifier}
        if operators <= {">=", ">", "!="}:
            continue
        at = next(number for number, line in enumerate(lines) if f'"{requirement}"' in line)
        if "#" not in lines[at] and not lines[at - 1].lstrip().startswith("#"):
            found.append(requirement)
    return found


def test_every_upper_bound_has_its_reason_beside_it() -> None:
    assert caps_without_reason(PYPROJECT) == []


@pytest.mark.parametrize(
    ("lines", "found"),
    [
        ('"a>=1",', []),
        ('"a>=1,<2",', ["a>=1,<2"]),
        ('# a 2 renames b\n"a>=1,<2",', []),
        ('"a>=1,<2", # a 2 renames b', []),
        ('"a==1.5",', ["a==1.5"]),
        ('"a~=1.5",', ["a~=1.5"]),
        ('# a 2 renames b\n"a>=1,<2",\n"c<3",', ["c<3"]),
    ],
)
def test_a_bound_without_a_reason_is_found(lines: str, found: list[str]) -> None:
    assert caps_without_reason(f"[project]\ndependencies = [\n{lines}\n]\n") == found


@pytest.mark.parametrize(
    ("name", "hole", "mended"),
    [
        ("cryptography", "49.0.0", "50.0.0"),  # GHSA-g6cj-pr64-35w5
        ("h11", "0.14.0", "0.16.0"),  # GHSA-vqfr-h8mv-ghfj
        ("starlette", "1.3.0", "1.3.1"),  # CVE-2026-54283; GHSA-86qp-5c8j-p5mr was mended in 1.0.1
        ("pytest", "9.0.2", "9.0.3"),  # GHSA-6w46-j5rx-g56g
        ("setuptools", "78.1.0", "78.1.1"),  # GHSA-5rjg-fvgr-3xxf
    ],
)
def test_no_version_with_a_known_hole_is_let_in(name: str, hole: str, mended: str) -> None:
    (package,) = (each for each in map(Requirement, declared(PYPROJECT)) if each.name == name)
    assert not package.specifier.contains(hole)
    assert package.specifier.contains(mended)


TWO_NUMBERS = ("packaging", "pyserial")
"""What their releases have."""


def test_the_lowest_version_of_each_package_that_runs_is_named_in_full() -> None:
    """An index is asked for a release by its name: 2.0.0 is one, 2 is none."""
    packages = list(map(Requirement, tomllib.loads(PYPROJECT)["project"]["dependencies"]))
    pins = lowest.of_project()
    assert len(pins) == len(packages)
    for pin, package in zip(map(Requirement, pins), packages, strict=True):
        (version,) = (each.version for each in pin.specifier)
        assert (pin.name, package.specifier.contains(version)) == (package.name, True)
        assert version.count(".") == 2 or package.name in TWO_NUMBERS, pin


def pins(path: Path) -> dict[str, tuple[Requirement, list[str]]]:
    """Each pinned package with its hashes."""
    text = re.sub(r"^ *#.*\n", "", path.read_text(), flags=re.MULTILINE).replace("\\\n", " ")
    found: dict[str, tuple[Requirement, list[str]]] = {}
    for line in filter(str.strip, text.splitlines()):
        words, *hashes = re.split(r" +--hash=", line.strip())
        requirement = Requirement(words)
        found[canonicalize_name(requirement.name)] = (requirement, [each.strip() for each in hashes])
    return found


@pytest.mark.parametrize("path", [RUN, BUILD, RELEASE], ids=lambda path: path.name)
def test_each_package_is_pinned_with_hashes_and_without_an_address(path: Path) -> None:
    text = path.read_text()
    for word in (
        "://",
        "--index",
        "--extra-index",
        "--find-links",
        "--trusted",
        " @ ",
        "-e ",
        "/home",
        "/tmp",
    ):
        assert word not in text, word
    packages = pins(path)
    assert len(packages) >= 10
    for name, (requirement, hashes) in packages.items():
        assert [each.operator for each in requirement.specifier] == ["=="], name
        assert "*" not in str(requirement.specifier), name
        assert hashes, name
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", each) for each in hashes), name


def wanted(path: Path) -> list[str]:
    parsed = tomllib.loads(PYPROJECT)
    project: dict[str, Any] = parsed["project"]
    if path == RUN:
        return list(project["dependencies"])
    if path == RELEASE:
        return list(project["optional-dependencies"]["release"])
    needs = ran(sys.executable, ROOT / "tools" / "compiled.py", "--needs", check=True)
    return [*parsed["build-system"]["requires"], *needs.stdout.splitlines()]


@pytest.mark.parametrize("path", [RUN, BUILD, RELEASE], ids=lambda path: path.name)
def test_what_is_declared_is_pinned_within_its_bounds_on_every_python(path: Path) -> None:
    packages = pins(path)
    for each in map(Requirement, wanted(path)):
        pin, _ = packages[canonicalize_name(each.name)]
        (version,) = (specifier.version for specifier in pin.specifier)
        assert each.specifier.contains(version), f"{each}: {version} is pinned; make lock"
        for python in PYTHONS:
            for machine in MACHINES:
                place = {
                    "python_version": python,
                    "python_full_version": f"{python}.0",
                    "platform_machine": machine,
                }
                assert pin.marker is None or pin.marker.evaluate(place), (pin, place)


def test_what_builds_and_what_runs_pin_the_same_versions() -> None:
    run, build, release = pins(RUN), pins(BUILD), pins(RELEASE)
    assert {"msgspec", "fastcrc"} <= build.keys() & run.keys()
    for one, other in ((run, build), (run, release), (build, release)):
        for name in one.keys() & other.keys():
            assert one[name][0].specifier == other[name][0].specifier, name
            assert one[name][1] == other[name][1], name


# As pip-audit writes its reports (--format json).
FINE = {"name": "msgspec", "version": "0.22.0", "vulns": []}
UNASKED = {
    "name": "idna",
    "skip_reason": "Dependency not found on PyPI and could not be audited: idna (3.20)",
}
HOLE = {
    "name": "cryptography",
    "version": "48.0.0",
    "vulns": [{"id": "GHSA-537c-gmf6-5ccf", "fix_versions": ["48.0.1"], "aliases": [], "description": "x"}],
}


def test_an_audit_names_each_hole_and_says_where_nobody_could_be_asked() -> None:
    assert audit.judge({"dependencies": [FINE]}) == (0, ["no hole is known in 1 packages"])
    code, said = audit.judge({"dependencies": [FINE, HOLE]})
    assert code == 1
    assert said[0] == "cryptography 48.0.0: GHSA-537c-gmf6-5ccf, mended in 48.0.1"
    code, said = audit.judge({"dependencies": [FINE, UNASKED]})
    assert code == 3
    assert "on 1 of 2 packages" in said[0]
    code, said = audit.judge({"dependencies": [UNASKED, HOLE]})
    assert code == 1  # a hole that is known weighs more than one that is not


def test_an_audit_that_cannot_ask_says_so_in_one_line() -> None:
    # An interpreter without pip-audit asks as little as one without a network.
    done = ran(sys.executable, "-m", "tools.audit", cwd=ROOT)
    assert (done.returncode, done.stderr) == (3, "")
    assert done.stdout.startswith("not audited: ")
    assert done.stdout.count("\n") == 1


# debian/copyright has a paragraph for each package that the Debian package brings.


def test_every_package_that_is_installed_has_its_files_its_holders_and_its_licence() -> None:
    tool = ROOT / "tools" / "bundled_licences.py"
    done = ran(sys.executable, tool, sysconfig.get_path("purelib"), check=True)
    paragraphs = done.stdout.strip().split("\n\nFiles: ")
    assert all(re.search(r"^Copyright: .", each, re.MULTILINE) for each in paragraphs)
    licences = re.findall(r"^License: (.*)$", done.stdout, re.MULTILINE)
    assert len(licences) == len(paragraphs)
    for name in ("numpy", "cryptography", "h11", "pyserial"):
        assert f"{name}-{version(name)}" in licences
    (h11,) = (each for each in paragraphs if f"License: h11-{version('h11')}\n" in each)
    assert "site-packages/h11/*\n" in h11
    assert "Nathaniel J. Smith" in h11
    assert "\n Permission is hereby granted, free of charge" in h11
    # A line without a blank in front would begin another field.
    assert {line.split(" ")[0] for line in h11.splitlines()[1:]} <= {"", "Copyright:", "License:"}


def test_a_package_that_says_nowhere_what_its_licence_is_ends_the_build(tmp_path: Path) -> None:
    folder = tmp_path / "nameless-1.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: nameless\nVersion: 1\n")
    with pytest.raises(ValueError, match="nameless 1 says nowhere what its licence is"):
        bundled_licences.paragraph(PathDistribution(folder))
