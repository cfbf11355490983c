"""What a host of repositories and an index of packages read: workflows, forms, claims."""

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.support.commands import typed
from tools import pythons

ROOT = Path(__file__).parents[2]
GITHUB = ROOT / ".github"
WORKFLOWS = sorted((GITHUB / "workflows").glob("*.yml"))
FORMS = sorted(path for path in (GITHUB / "ISSUE_TEMPLATE").glob("*.yml") if path.name != "config.yml")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PINNED = re.compile(r"[\w.-]+/[\w./-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+")


def jobs(name: str) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((GITHUB / "workflows" / name).read_text())["jobs"]
    return found


def test_the_pythons_that_are_claimed_are_those_that_are_tried() -> None:
    claimed = pythons.claimed()
    assert claimed == jobs("checks.yml")["quick"]["strategy"]["matrix"]["python"]
    assert PROJECT["project"]["requires-python"] == f">={claimed[0]}"
    assert PROJECT["tool"]["mypy"]["python_version"] == claimed[0]
    assert PROJECT["tool"]["ruff"]["target-version"] == f"py{claimed[0].replace('.', '')}"


def test_scripts_and_documents_name_the_oldest_python_that_is_claimed() -> None:
    oldest = pythons.claimed()[0]
    for path in ("README.md", "deploy/install.sh", "deploy/environment.sh"):
        named = set(re.findall(r"Python (3\.\d+) or newer", (ROOT / path).read_text()))
        assert named == {oldest}, path


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_pins_its_actions_by_commit_and_says_their_release(workflow: Path) -> None:
    used = re.findall(r"uses: (.+)", workflow.read_text())
    assert [action for action in used if not PINNED.fullmatch(action)] == []


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_has_no_secret_and_no_right_that_a_job_does_not_ask_for(workflow: Path) -> None:
    text = workflow.read_text()
    document = yaml.safe_load(text)
    assert document["permissions"] == {}
    assert all("permissions" in job for job in document["jobs"].values())
    assert "secrets." not in text
    assert "pull_request_target" not in text


def test_a_release_gives_each_job_the_rights_that_its_work_needs() -> None:
    assert {name: job["permissions"] for name, job in jobs("release.yml").items()} == {
        "build": {"contents": "read"},
        "attest": {"id-token": "write", "attestations": "write"},
        "pypi": {"id-token": "write"},
        "host": {"contents": "write"},
    }


def test_what_the_workflows_make_is_a_target_of_the_makefile() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = re.compile(r"\bmake ([a-z-]+)$", re.MULTILINE)
    made = {target for path in WORKFLOWS for target in named.findall(path.read_text())}
    assert len(made) >= 4
    assert made <= targets


@pytest.mark.parametrize("form", FORMS, ids=lambda path: path.name)
def test_a_form_for_issues_asks_for_what_it_needs_under_names_of_its_own(form: Path) -> None:
    document = yaml.safe_load(form.read_text())
    assert {"name", "description", "body"} <= set(document)
    asked = [item for item in document["body"] if item["type"] != "markdown"]
    assert {item["type"] for item in asked} <= {"input", "textarea", "dropdown"}
    assert all(item["attributes"]["label"] for item in asked)
    assert all(item["attributes"]["options"] for item in asked if item["type"] == "dropdown")
    assert len({item["id"] for item in asked}) == len(asked)
    assert any(item.get("validations", {}).get("required") for item in asked)


def test_there_is_a_form_for_each_kind_of_issue_and_holes_in_security_are_not_told_in_public() -> None:
    assert [path.stem for path in FORMS] == ["1-wrong-move", "2-bug", "3-drive-profile", "4-table-format"]
    chooser = yaml.safe_load((GITHUB / "ISSUE_TEMPLATE" / "config.yml").read_text())
    assert chooser["blank_issues_enabled"] is False
    assert [link["url"].rsplit("/", 3)[1:] for link in chooser["contact_links"]] == [
        ["security", "advisories", "new"]
    ]


def test_commands_that_the_forms_name_exist() -> None:
    named = {
        command
        for form in (*FORMS, ROOT / "SECURITY.md")
        for command in re.findall(r"`pitch-gateway ([a-z][a-z ]*[a-z])", form.read_text())
    }
    assert {"table show", "probe", "record", "status"} <= named
    for command in sorted(named):
        assert typed(*command.split(), "--help").returncode == 0, command


def test_the_citation_names_the_project_as_its_package_does() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    project = PROJECT["project"]
    assert citation["cff-version"] == "1.2.0"
    assert citation["title"] == project["name"]
    assert citation["license"] == project["license"]
    assert citation["repository-code"] == project["urls"]["Source"]
    assert citation["authors"] == [{"name": "The pitch-gateway authors"}]
    assert "The pitch-gateway authors" in (ROOT / "LICENSE").read_text()


def test_the_wheel_tells_type_checkers_that_it_has_types(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as opened:
        assert "gateway/py.typed" in opened.namelist()
        metadata = opened.read(f"{wheel.name.rsplit('-py3', 1)[0]}.dist-info/METADATA").decode()
    assert "Classifier: Typing :: Typed" in metadata
