"""``journal``: shown, verified and exported, also where there is none or it was changed."""

import json
from pathlib import Path

import pytest

from gateway.state.interventions import Intervention, files_in
from tests.support.commands import typed
from tests.support.config import one_axis
from tests.support.config import written as written_config
from tests.support.interventions import written

NOON_S = 1_796_040_000.0
"""2026-11-30 12:00:00 UTC: 20 787 days of 86 400 s since 1970, and twelve hours."""
BEFORE, AFTER = "1" * 64, "2" * 64


@pytest.fixture
def config(tmp_path: Path) -> Path:
    return written_config(tmp_path, one_axis(1, 2))


@pytest.fixture
def folder(config: Path) -> Path:
    (config.parent / "state").mkdir()
    who = {"name": "anna", "address": "::1"}
    return written(
        config.parent / "state" / "interventions",
        Intervention("table", "file", "x", "x.tab", BEFORE, AFTER, {}, NOON_S, 1),
        Intervention(
            "acknowledged", "http", None, None, None, {"kind": "off"}, who, NOON_S + 1, 2_000_000_000
        ),
    )


def test_it_is_shown_in_lines_and_as_json(config: Path, folder: Path) -> None:
    shown = typed("journal", "show", str(config))
    assert (shown.returncode, shown.stderr) == (0, "")
    assert shown.stdout.splitlines() == [
        "1  2026-11-30T12:00:00.000+00:00  table x x.tab: 111111111111 → 222222222222  file",
        '2  2026-11-30T12:00:01.000+00:00  acknowledged: – → {"kind": "off"}  http  address=::1 name=anna',
    ]
    assert typed("journal", "show", str(config), "--last", "1").stdout == shown.stdout.splitlines()[1] + "\n"
    lines = files_in(folder)[0].read_text().splitlines()
    found = json.loads(typed("journal", "show", str(config), "--json").stdout)
    assert found == [json.loads(line) for line in lines]


def test_a_name_in_an_entry_does_not_control_the_terminal(config: Path) -> None:
    (config.parent / "state").mkdir()
    who = {"program": "a\x1b]0;b\x07\nc\udcff"}
    written(
        config.parent / "state" / "interventions",
        Intervention("gain", "socket", "x", None, 1, 2, who, NOON_S, 1),
    )
    shown = typed("journal", "show", str(config)).stdout
    assert (
        shown
        == "1  2026-11-30T12:00:00.000+00:00  gain x: 1 → 2  socket  program=a\ufffd]0;b\ufffd c\ufffd\n"
    )


def test_a_whole_one_is_exported_and_verified_anywhere_against_the_printed_digest(
    config: Path, folder: Path, tmp_path: Path
) -> None:
    first, last = (json.loads(line)["digest"] for line in files_in(folder)[0].read_text().splitlines())
    said = (
        "2 entries, from 2026-11-30T12:00:00.000+00:00 to 2026-11-30T12:00:01.000+00:00\n"
        f"newest entry: 2, digest {last}\n"
        "whole: nothing was changed, cut, doubled or reordered\n"
    )
    exported = tmp_path / "journal.jsonl"
    assert typed("journal", "export", str(config), str(exported)) == (0, said, "")
    assert exported.read_bytes() == files_in(folder)[0].read_bytes()
    assert exported.stat().st_mode & 0o777 == 0o600
    again = typed("journal", "export", str(config), str(exported))
    assert (again.returncode, again.stderr) == (1, f"{exported}: exists already; --force replaces it\n")
    for source in (config, exported):
        assert typed("journal", "verify", str(source)) == (0, said, "")
        assert typed("journal", "verify", str(source), "--head", last).returncode == 0
        assert typed("journal", "verify", str(source), "--since", first).returncode == 0
        wrong = typed("journal", "verify", str(source), "--head", first)
        assert (wrong.returncode, wrong.stderr) == (1, f"{source}: the newest entry is not {first}\n")
        wrong = typed("journal", "verify", str(source), "--since", "0" * 64)
        assert wrong.returncode == 1
        assert f"no entry has the digest {'0' * 64}: cut, or another journal" in wrong.stderr
    found = json.loads(typed("journal", "verify", str(config), "--since", last, "--json").stdout)
    assert (found["whole"], found["entries"], found["last"]["digest"]) == (True, 1, last)


def test_a_changed_one_names_the_line_and_is_exported_all_the_same(
    config: Path, folder: Path, tmp_path: Path
) -> None:
    [path] = files_in(folder)
    path.write_bytes(path.read_bytes().replace(b'"axis":"x"', b'"axis":"y"'))
    problem = f"{config}: 000001.jsonl:1: entry 1 was changed: it has another digest\n"
    verified = typed("journal", "verify", str(config))
    assert (verified.returncode, verified.stderr) == (1, problem)
    assert "whole" not in verified.stdout
    found = json.loads(typed("journal", "verify", str(config), "--json").stdout)
    assert (found["whole"], len(found["problems"])) == (False, 1)
    exported = tmp_path / "journal.jsonl"
    assert typed("journal", "export", str(config), str(exported)).returncode == 1
    assert exported.read_bytes() == path.read_bytes()


def test_a_torn_one_is_whole_with_a_note(config: Path, folder: Path) -> None:
    [path] = files_in(folder)
    path.write_bytes(path.read_bytes() + b'{"after":')
    verified = typed("journal", "verify", str(config))
    assert verified.returncode == 0
    assert verified.stderr.startswith("note: 000001.jsonl:3: torn by a power cut before it was synced")


@pytest.mark.parametrize("command", ["show", "verify", "export"])
def test_without_one_it_is_said(config: Path, tmp_path: Path, command: str) -> None:
    more = [str(tmp_path / "journal.jsonl")] if command == "export" else []
    found = typed("journal", command, str(config), *more)
    folder = config.parent / "state" / "interventions"
    why = f"{folder}: there is no journal; the supervisor begins one when it first runs\n"
    assert found == (1, "", why)


def test_to_erase_needs_the_supervisor_and_one_reason(config: Path, folder: Path) -> None:
    before = files_in(folder)[0].read_bytes()
    found = typed("journal", "erase", str(config), "--person", "anna")
    assert found.returncode == 1
    assert found.stderr.endswith("the supervisor has to run: it alone writes the journal\n")
    for more in ((), ("--person", "anna", "--before", "2026-01-01"), ("--before", "yesterday")):
        assert typed("journal", "erase", str(config), *more).returncode == 2
    assert files_in(folder)[0].read_bytes() == before
