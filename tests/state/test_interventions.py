"""The journal of interventions: what an entry is, what a writer finds, and how ``who`` is taken out."""

import hashlib
import json
from pathlib import Path

import pytest

from gateway.state.folder import problem_of
from gateway.state.interventions import Intervention, Writer, files_in, read_journal
from tests.support.interventions import only_file, problems, switched, verified, written

DAY_S = 86_400.0
NOON_S = 1_796_040_000.0
"""2026-11-30 12:00:00 UTC: 20 787 days of 86 400 s since 1970, and twelve hours."""


def test_an_entry_is_a_line_whose_digest_anyone_can_work_out(tmp_path: Path) -> None:
    who = {"user": 1000, "pid": 77}
    one = switched("x", who=who, wall_s=NOON_S + 0.25, monotonic_ns=5)
    folder = written(tmp_path / "interventions", one, switched("ä", wall_s=NOON_S, monotonic_ns=6))
    lines = only_file(folder).read_text().splitlines()
    first, second = map(json.loads, lines)
    assert lines[0] == json.dumps(first, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    assert first["time"] == "2026-11-30T12:00:00.250+00:00"
    assert (first["seq"], first["monotonic_ns"]) == (1, 5)
    assert (first["what"], first["axis"]) == ("compensation", "x")
    assert (first["before"], first["after"], first["via"]) == ("off", "on", "socket")
    assert first["previous"] == "0" * 64
    for entry in (first, second):
        digest, personal = entry.pop("digest"), entry.pop("who")
        text = json.dumps(entry, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
        assert digest == hashlib.sha256(text.encode()).hexdigest()
        if entry is first:
            assert {key: personal[key] for key in who} == who
            text = json.dumps(personal, sort_keys=True, separators=(",", ":"))
            assert entry["who_digest"] == hashlib.sha256(text.encode()).hexdigest()
            assert second["previous"] == digest
    assert (personal, second["who_digest"]) == (None, None)
    assert (only_file(folder).stat().st_mode & 0o777, folder.stat().st_mode & 0o777) == (0o600, 0o700)


def test_what_is_whole_verifies_also_over_several_writers_and_files(tmp_path: Path) -> None:
    folder = tmp_path / "interventions"
    for number in range(12):
        written(folder, switched(f"axis{number}", who={"user": number}), file_bytes=2500)
    found, entries = verified(folder)
    assert len(files_in(folder)) > 3
    assert (found.problems, found.notes, found.entries) == ([], [], 12)
    assert [entry["seq"] for entry in entries] == list(range(1, 13))


# --- What a power cut leaves


def test_a_power_cut_at_the_very_first_entry_is_mended_too(tmp_path: Path) -> None:
    folder = tmp_path / "interventions"
    folder.mkdir()
    (folder / "000001.jsonl").write_bytes(b'{"after":')
    written(folder, switched("x"))
    found, entries = verified(folder)
    assert found.problems == []
    assert [entry["what"] for entry in entries] == ["torn", "compensation"]


def test_an_entry_that_was_synced_before_its_head_stays(tmp_path: Path) -> None:
    """The power goes between an entry, the first of a new file, and the head that names it."""
    folder = written(tmp_path / "interventions", switched("a"), switched("b"))
    old = (folder / "head.json").read_bytes()
    first = only_file(folder)
    written(folder, switched("c"), file_bytes=first.stat().st_size)
    assert len(files_in(folder)) == 2
    (folder / "head.json").write_bytes(old)
    assert problems(folder) == []
    written(folder, switched("d"))
    found, entries = verified(folder)
    assert (found.problems, [entry["axis"] for entry in entries]) == ([], ["a", "b", "c", "d"])


def test_what_no_power_cut_leaves_behind_the_last_entry_is_a_problem(tmp_path: Path) -> None:
    folder = written(tmp_path / "interventions", switched("a"))
    path = only_file(folder)
    path.write_bytes(path.read_bytes() + b"\n")
    assert problems(folder) == ["000001.jsonl:2: is no entry of the journal, or was rewritten"]


# --- Damage that a supervisor finds: it goes on, and the evidence stays


def test_a_journal_that_was_cut_goes_on_and_says_so_for_ever(tmp_path: Path) -> None:
    folder = written(tmp_path / "interventions", *(switched(axis) for axis in "abc"))
    path = only_file(folder)
    lines = path.read_bytes().splitlines(keepends=True)
    third = json.loads(lines[2])["digest"]
    path.write_bytes(b"".join(lines[:2]))
    written(folder, switched("d"))
    found, entries = verified(folder)
    assert found.problems == [
        "000002.jsonl:1: entry 4 does not follow entry 2",
        "000002.jsonl:1: says that the journal was damaged before",
    ]
    assert entries[2]["before"] == {"seq": 3, "digest": third}
    assert entries[2]["after"]["seq"] == 2
    assert path.read_bytes() == b"".join(lines[:2])  # nothing was mended away


def test_a_last_entry_that_was_changed_is_not_taken_for_a_torn_one(tmp_path: Path) -> None:
    folder = written(tmp_path / "interventions", switched("a"), switched("b"))
    path = only_file(folder)
    changed = path.read_bytes().replace(b'"axis":"b"', b'"axis":"c"')
    path.write_bytes(changed)
    written(folder, switched("d"))
    assert problems(folder)[0] == "000001.jsonl:2: entry 2 was changed: it has another digest"
    assert path.read_bytes() == changed


@pytest.mark.parametrize("content", [None, b"", b"[]", b'{"seq": "1", "digest": 2}'])
def test_a_head_that_is_missing_or_damaged_is_said(tmp_path: Path, content: bytes | None) -> None:
    folder = written(tmp_path / "interventions", switched("a"), switched("b"))
    if content is None:
        (folder / "head.json").unlink()
    else:
        (folder / "head.json").write_bytes(content)
    assert problems(folder) == ["head.json: missing or damaged, so a cut end would not show"]
    written(folder, switched("c"))
    assert problems(folder) == ["000002.jsonl:1: says that the journal was damaged before"]


def test_a_journal_written_anew_shows_only_against_a_digest_that_was_kept(tmp_path: Path) -> None:
    """What root can do: another journal, whole in itself."""
    kept = verified(written(tmp_path / "true", switched("a"), switched("b")))[1][0]["digest"]
    false = written(tmp_path / "false", switched("a"), switched("b"))
    assert problems(false) == []
    found, _ = verified(false, since=kept)
    assert found.problems == [f"no entry has the digest {kept}: cut, or another journal"]
    found, _ = verified(tmp_path / "true", since=kept)
    assert (found.problems, found.entries) == ([], 2)


def test_since_a_kept_digest_older_damage_does_not_count(tmp_path: Path) -> None:
    folder = written(tmp_path / "interventions", *(switched(axis) for axis in "abc"))
    path = only_file(folder)
    path.write_bytes(path.read_bytes().replace(b'"axis":"a"', b'"axis":"A"'))
    assert problems(folder)[0].startswith("000001.jsonl:1:")
    third = json.loads(path.read_bytes().splitlines()[2])["digest"]
    found, _ = verified(folder, since=third)
    assert (found.problems, found.entries) == ([], 1)


# --- What is no file

FOLDER_THERE = "is named as a file of the journal and is none; move it away"


@pytest.mark.parametrize("kind", ["folder", "link"])
def test_what_has_the_name_of_the_next_file_is_passed_over_and_said(tmp_path: Path, kind: str) -> None:
    folder = written(tmp_path / "interventions", switched("a"))
    if kind == "folder":
        (folder / "000002.jsonl").mkdir()
    else:
        (folder / "000002.jsonl").symlink_to(tmp_path / "elsewhere")
    written(folder, switched("b"), file_bytes=only_file(folder).stat().st_size)
    found, entries, _ = read_journal(folder)
    assert [path.name for path in files_in(folder)] == ["000001.jsonl", "000003.jsonl"]
    assert ([entry["axis"] for entry in entries], found.problems) == (["a", "b"], [])
    assert found.notes == [f"000002.jsonl: {FOLDER_THERE}"]
    assert not (tmp_path / "elsewhere").exists()


def test_a_folder_in_place_of_a_file_does_not_hide_that_the_file_is_gone(tmp_path: Path) -> None:
    folder = written(tmp_path / "interventions", switched("a"), switched("b"))
    only_file(folder).unlink()
    (folder / "000001.jsonl").mkdir()
    written(folder, switched("c"))
    found, entries, _ = read_journal(folder)
    assert [(entry["seq"], entry["what"]) for entry in entries] == [(3, "damaged"), (4, "compensation")]
    assert found.problems == [
        "000002.jsonl:1: says that the journal was damaged before",
        "the beginning is missing: the first entry is 3",
    ]
    assert found.notes == [f"000001.jsonl: {FOLDER_THERE}"]


def test_a_folder_in_place_of_the_head_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    folder = written(tmp_path / "interventions", switched("a"), switched("b"))
    (folder / "head.json").unlink()
    (folder / "head.json").mkdir()
    before = only_file(folder).read_bytes()
    for _ in range(2):
        with pytest.raises(IsADirectoryError) as caught:
            written(folder, switched("c"))
        remedy = "a folder is where a file should be: move it away, or choose another folder with"
        found = f"{folder / 'head.json'}: Is a directory; {remedy} [gateway] state"
        assert str(problem_of(caught.value, folder)) == found
    assert only_file(folder).read_bytes() == before


# --- Size and clocks


def test_the_oldest_files_go_by_size_and_an_entry_says_up_to_where(tmp_path: Path) -> None:
    folder = tmp_path / "interventions"
    for number in range(40):
        written(folder, switched(f"axis{number}"), file_bytes=2500, most_bytes=10_000)
    found, entries = verified(folder)
    assert found.problems == []
    assert sum(path.stat().st_size for path in files_in(folder)) <= 10_000
    first = entries[0]
    dropped = [entry for entry in entries if entry["what"] == "dropped"]
    assert dropped[-1]["after"]["seq"] == first["seq"] - 1
    assert dropped[-1]["after"]["digest"] == first["previous"]
    files_in(folder)[0].unlink()  # one more by hand: nothing says so
    assert problems(folder)[0].startswith("the beginning is missing: the first entry is ")


def test_a_clock_that_was_set_is_noted_and_breaks_nothing(tmp_path: Path) -> None:
    second_ns = 1_000_000_000
    folder = written(
        tmp_path / "interventions",
        switched("a", wall_s=NOON_S, monotonic_ns=100 * second_ns),
        switched("b", wall_s=NOON_S - DAY_S + 10.0, monotonic_ns=110 * second_ns),
        switched("c", wall_s=NOON_S - DAY_S + 20.0, monotonic_ns=120 * second_ns),
    )
    found, _ = verified(folder)
    assert found.problems == []
    assert found.notes == ["000001.jsonl:2: the clock was set by -86400 s before this entry"]


# --- Who


def test_who_is_taken_out_on_request_and_the_chain_holds(tmp_path: Path) -> None:
    folder = tmp_path / "interventions"
    names = ("anna", "bert", "anna", "anna", "bert")
    for number, name in enumerate(names):
        written(folder, switched(f"axis{number}", who={"name": name}), file_bytes=2500)
    digests = [entry["digest"] for entry in verified(folder)[1]]
    by = Intervention("erasure", "http", who={"user": 0})
    # As a killed erasure leaves it:
    (folder / ".000001.jsonl.abcdefgh").write_bytes(files_in(folder)[0].read_bytes())
    assert Writer(folder).erase(lambda entry: entry["who"]["name"] == "anna", by) == 3
    found, entries = verified(folder)
    assert found.problems == []
    assert [entry["digest"] for entry in entries[:5]] == digests
    assert [entry["who"] and entry["who"]["name"] for entry in entries[:5]] == [
        None,
        "bert",
        None,
        None,
        "bert",
    ]
    assert b"anna" not in b"".join(path.read_bytes() for path in folder.iterdir())
    assert (entries[5]["what"], entries[5]["after"], entries[5]["via"]) == (
        "erasure",
        [[1, 1], [3, 4]],
        "http",
    )
    assert entries[5]["who"]["user"] == 0
    assert (
        Writer(folder).erase(lambda entry: "name" in entry["who"] and entry["who"]["name"] == "anna", by) == 0
    )


def test_who_taken_out_by_hand_is_found(tmp_path: Path) -> None:
    folder = written(tmp_path / "interventions", switched("a", who={"name": "anna"}), switched("b"))
    path = only_file(folder)
    lines = [json.loads(line) for line in path.read_bytes().splitlines()]
    lines[0]["who"] = None
    path.write_text("".join(json.dumps(line, sort_keys=True, separators=(",", ":")) + "\n" for line in lines))
    assert problems(folder) == ["000001.jsonl:1: `who` was taken out, and no entry says so"]
