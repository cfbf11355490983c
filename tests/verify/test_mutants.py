"""The mutants: each is broken in one place, and what is left of it is Python."""

import ast
from dataclasses import replace
from itertools import chain
from pathlib import Path

import pytest

from gateway.compiled import is_compiled
from tests.verify.breaking import ROOT, mutants_of
from tests.verify.mutants import FILES, Reasons, Verdict, by_lot
from tests.verify.mutants_by_tests import Asker, Ran

REGISTERS = ROOT / "gateway" / "exchange" / "axis" / "registers.py"
KINDS = {"equivalent", "left out", "open"}


def test_each_mutant_of_a_file_is_another_one_and_says_where_it_is_broken() -> None:
    mutants = list(mutants_of(REGISTERS))
    whole = ast.unparse(ast.parse(REGISTERS.read_text()))
    assert len(mutants) >= 60
    sources = {mutant.source for mutant in mutants}  # each is written anew when it is asked for
    assert len(sources) == len(mutants)
    assert whole not in sources
    assert all(mutant.line and mutant.what for mutant in mutants)


def test_a_row_a_condition_and_an_assignment_are_among_what_is_broken() -> None:
    missing = {"row dropped", "negated", "dropped", "other comparison", "other member", "guard dropped"}
    for mutant in chain.from_iterable(map(mutants_of, FILES)):
        missing.discard(mutant.what.split(":")[0])
        if not missing:
            break
    assert not missing


def test_no_two_mutants_have_a_name_or_a_digest_in_common() -> None:
    mutants = list(chain.from_iterable(map(mutants_of, FILES)))
    assert len({mutant.name for mutant in mutants}) == len(mutants)
    assert len({mutant.digest for mutant in mutants}) == len(mutants)


def test_the_order_that_is_drawn_is_of_all_mutants() -> None:
    mutants = mutants_of(REGISTERS)
    drawn = by_lot(mutants)
    assert drawn != mutants
    assert {each.name for each in drawn} == {each.name for each in mutants}
    assert by_lot(reversed(mutants)) == drawn


def test_each_survivor_that_is_explained_is_a_mutant_with_a_kind_and_a_reason() -> None:
    mutants = list(chain.from_iterable(map(mutants_of, FILES)))
    reasons = Reasons()
    assert sorted(set(reasons.mutants) - {mutant.name for mutant in mutants}) == []
    units = {f"{Path(mutant.file).stem}:{mutant.unit}" for mutant in mutants}
    assert sorted(set(reasons.units) - units) == []
    assert {kind for kind, _ in reasons.mutants.values()} <= KINDS
    assert all(why for _, why in reasons.mutants.values())
    assert all(reasons.units.values())


def test_a_method_is_explained_as_a_whole_only_where_no_world_runs_through_it(tmp_path: Path) -> None:
    path = tmp_path / "explained.toml"
    path.write_text(
        '[[unit]]\nunit = "axis:Axis.end"\nwhy = "left"\n'
        '[[mutant]]\nnames = ["axis:Axis.end:dropped: x"]\nkind = "equivalent"\nwhy = "same"\n'
    )
    reasons = Reasons(path)
    assert reasons.kind(Verdict("1", "axis:Axis.end:negated: y", 1)) == "left out"
    assert reasons.kind(Verdict("1", "axis:Axis.end:negated: y", 1, worlds=2)) == ""
    assert reasons.kind(Verdict("1", "axis:Axis.end:dropped: x", 1, worlds=2)) == "equivalent"


def test_what_is_kept_of_a_verdict_is_the_verdict() -> None:
    killed = Verdict("1", "axis:Axis.end:negated: y", 7, is_killed=True, world="s-silent")
    survived = Verdict("1", "axis:Axis.end:negated: y", 7, worlds=9, asked=8, walked_s=0.5)
    noticed_by_a_test = replace(survived, test="tests/exchange/test_rest.py::test_x")
    noticed_by_none = replace(survived, test="")
    for verdict in (killed, survived, noticed_by_a_test, noticed_by_none):
        assert Verdict.of_row(verdict.row, verdict.name, verdict.line) == verdict
    assert Reasons().kind(noticed_by_a_test) == "by a test"
    assert Reasons().kind(noticed_by_none) == ""


@pytest.mark.skipif(is_compiled(), reason="a mutant is a source, and compiled modules are imported here")
def test_a_mutant_in_no_world_is_noticed_by_the_tests_that_run_through_it() -> None:
    """Writes that a new connection holds back are in no world: no world has a connection."""
    file = ROOT / "gateway" / "exchange" / "scheduler.py"
    name = "scheduler:Scheduler.held_read:negated: if read is None:"
    [mutant] = [each for each in mutants_of(file) if each.name == name]
    held_read = "test_w5_after_a_write_without_an_answer_only_added_reads_are_sent_until_one_is_answered"
    ran = [
        Ran("tests/exchange/test_rest.py", 0.1, {mutant.file: {1}}),
        Ran(f"tests/exchange/test_renewal.py::{held_read}", 2.0, {mutant.file: {mutant.line}}),
    ]
    asker = Asker(ran, 0.0, [])
    test = asker(mutant)
    asker.end()
    assert test == ran[1].test
    assert Asker(ran[:1], 0.0, [])(mutant) == ""  # none runs through it
    assert Asker(ran, 1.0, [])(mutant) is None  # there was no time for the only one
