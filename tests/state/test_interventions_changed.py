"""Any change of the bytes of the journal of interventions is found, and its line named.

The entries are made once for all cases of a property; each case has its own copy.
"""

import hashlib
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.state.interventions import files_in
from tests.support.interventions import only_file, problems, switched, verified, written


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("whole") / "interventions"
    written(folder, *(switched(axis, who={"user": 1}) for axis in "abcdef"))
    return only_file(folder).read_bytes()


def _of(content: bytes, tmp: Path, whole: bytes) -> list[str]:
    """Return the problems of a folder whose file has another content, and whose head is the old one."""
    last = json.loads(whole.splitlines()[-1])
    (tmp / "000001.jsonl").write_bytes(content)
    (tmp / "head.json").write_text(json.dumps({"seq": last["seq"], "digest": last["digest"]}))
    return problems(tmp)


def _line_of(whole: bytes, offset: int) -> int:
    return whole.count(b"\n", 0, offset) + 1


def _names(found: list[str], *lines: int) -> bool:
    return any(found_one.startswith(f"000001.jsonl:{line}:") for line in lines for found_one in found)


@given(data=st.data(), bit=st.integers(0, 7), how=st.sampled_from(("flipped", "removed", "doubled")))
def test_any_one_byte_changed_is_found_and_its_line_named(
    whole: bytes, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, bit: int, how: str
) -> None:
    at = data.draw(st.integers(0, len(whole) - 1))
    byte = whole[at : at + 1]
    new = {"flipped": bytes((byte[0] ^ 1 << bit,)), "removed": b"", "doubled": byte * 2}[how]
    found = _of(whole[:at] + new + whole[at + 1 :], tmp_path_factory.mktemp("one"), whole)
    line = _line_of(whole, at)
    # A doubled end of a line is an empty line behind it.
    assert _names(found, line, line + 1 if byte == b"\n" else line)


@given(data=st.data())
def test_any_two_lines_swapped_are_found_and_named(
    whole: bytes, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    lines = whole.splitlines(keepends=True)
    one, other = data.draw(st.lists(st.integers(0, len(lines) - 1), min_size=2, max_size=2, unique=True))
    lines[one], lines[other] = lines[other], lines[one]
    found = _of(b"".join(lines), tmp_path_factory.mktemp("swapped"), whole)
    first = min(one, other) + 1
    assert _names(found, first, first + 1)


@given(data=st.data(), is_doubled=st.booleans())
def test_any_line_removed_or_doubled_is_found_and_named(
    whole: bytes, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, is_doubled: bool
) -> None:
    lines = whole.splitlines(keepends=True)
    at = data.draw(st.integers(0, len(lines) - 1))
    lines[at : at + 1] = lines[at : at + 1] * 2 if is_doubled else []
    found = _of(b"".join(lines), tmp_path_factory.mktemp("lines"), whole)
    if at == 0 and not is_doubled:
        assert found == ["the beginning is missing: the first entry is 2"]
    else:
        assert _names(found, at + 2 if is_doubled else at + 1, at)


@given(data=st.data())
def test_any_tail_cut_from_what_was_synced_is_found(
    whole: bytes, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    kept = data.draw(st.integers(0, len(whole) - 1))
    found = _of(whole[:kept], tmp_path_factory.mktemp("cut"), whole)
    entries = whole[:kept].count(b"\n")
    place = f"000001.jsonl:{entries}" if entries else "the journal"
    assert f"{place}: cut: entry 6 was behind entry {entries}" in found
    if kept and whole[kept - 1 : kept] != b"\n":
        assert _names(found, entries + 1)


@given(data=st.data())
def test_a_torn_tail_that_was_not_synced_is_said_mended_and_costs_nothing(
    whole: bytes, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """The power goes while entry 6 is being written: the head still names entry 5."""
    folder = tmp_path_factory.mktemp("torn")
    last = whole.rindex(b"\n", 0, -1) + 1
    kept = data.draw(st.integers(last + 1, len(whole) - 1))
    zeros = data.draw(st.sampled_from((b"", b"\0" * 100)))  # ext4 may leave a length without its bytes
    fifth = json.loads(whole[:last].splitlines()[-1])
    (folder / "000001.jsonl").write_bytes(whole[:kept] + zeros)
    (folder / "head.json").write_text(json.dumps({"seq": 5, "digest": fifth["digest"]}))
    found, entries = verified(folder)
    assert found.problems == []
    [note] = found.notes
    assert note.startswith("000001.jsonl:6: torn by a power cut before it was synced")
    written(folder, switched("z"))
    found, after = verified(folder)
    assert (found.problems, found.notes) == ([], [])
    assert after[:5] == entries
    torn = (whole[:kept] + zeros)[last:]
    assert (after[5]["what"], after[5]["file"]) == ("torn", "000001.jsonl")
    assert after[5]["before"] == {"bytes": len(torn), "sha256": hashlib.sha256(torn).hexdigest()}
    assert after[6]["axis"] == "z"


@pytest.mark.parametrize(
    "forged",
    [
        {"time": "2026-11-30T12:00:00"},
        {"monotonic_ns": 10**400},
        {"seq": 10**100},
        {"what": 5},
        {"via": ["http"]},
        {"axis": ["x"]},
        {"who": "anna", "who_digest": hashlib.sha256(b'"anna"').hexdigest()},
    ],
    ids=lambda forged: next(iter(forged)),
)
def test_a_forged_entry_of_other_types_is_none_though_its_digest_is_right(
    tmp_path: Path, forged: dict[str, object]
) -> None:
    folder = written(tmp_path / "interventions", switched("x"))
    _forge(folder, **forged)
    verification, _ = verified(folder)
    assert [verification.entries, verification.problems] == [1, []]
    assert verification.notes[0].startswith("000001.jsonl:2: torn")


@pytest.mark.parametrize(
    ("what", "after"),
    [("erasure", [[-(10**10), 9]]), ("erasure", [[-(10**30), 9]]), ("dropped", {"seq": []})],
)
def test_a_forged_entry_of_the_journal_itself_does_not_stop_who_reads_it(
    tmp_path: Path, what: str, after: object
) -> None:
    folder = written(tmp_path / "interventions", switched("x"))
    _forge(folder, what=what, after=after)
    assert verified(folder)[0].entries == 2


def test_a_copy_of_a_file_beside_it_is_no_part_of_it(tmp_path: Path) -> None:
    folder = written(tmp_path / "interventions", switched("x"))
    (folder / "000001_old.jsonl").write_bytes(only_file(folder).read_bytes())
    written(folder, switched("y"))
    assert [path.name for path in files_in(folder)] == ["000001.jsonl"]
    assert problems(folder) == []


@pytest.mark.parametrize("seq", [10**30, -5, 0])
def test_a_head_with_a_number_that_was_never_written_is_said_once(tmp_path: Path, seq: int) -> None:
    folder = written(tmp_path / "interventions", switched("x"), switched("y"))
    (folder / "head.json").write_text(json.dumps({"seq": seq, "digest": "0" * 64}))
    assert problems(folder) == ["head.json: missing or damaged, so a cut end would not show"]
    for axis in "ab":
        written(folder, switched(axis))
    assert problems(folder) == ["000002.jsonl:1: says that the journal was damaged before"]


def _forge(folder: Path, **changed: object) -> None:
    """Append the last entry once more, as one that follows it, with other values and the right digest."""
    path = only_file(folder)
    last = json.loads(path.read_bytes().splitlines()[-1])
    entry = {**last, "seq": last["seq"] + 1, "previous": last["digest"], **changed}
    covered = {key: value for key, value in entry.items() if key not in ("digest", "who")}
    entry["digest"] = hashlib.sha256(_plain(covered)).hexdigest()
    path.write_bytes(path.read_bytes() + _plain(entry) + b"\n")


def _plain(data: object) -> bytes:
    return json.dumps(data, sort_keys=True, ensure_ascii=False, separators=(",", ":")).encode()
