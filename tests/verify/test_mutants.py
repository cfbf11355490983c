"""The mutants: each is broken in one place, and what is left of it is Python."""

import ast
from itertools import chain

from tests.verify.mutants import ROOT, mutants_of

REGISTERS = ROOT / "gateway" / "exchange" / "axis" / "registers.py"
FILES = (REGISTERS.with_name("axis.py"), REGISTERS.with_name("motion.py"))


def test_each_mutant_of_a_file_is_another_one_and_says_where_it_is_broken() -> None:
    mutants = list(mutants_of(REGISTERS))
    whole = ast.unparse(ast.parse(REGISTERS.read_text()))
    assert len(mutants) >= 60
    assert len({mutant.source for mutant in mutants}) == len(mutants)
    assert all(mutant.source != whole for mutant in mutants)
    assert all(mutant.line and mutant.what for mutant in mutants)


def test_a_row_a_condition_and_an_assignment_are_among_what_is_broken() -> None:
    missing = {"row dropped", "negated", "dropped", "other comparison", "other member", "guard dropped"}
    for mutant in chain.from_iterable(map(mutants_of, FILES)):
        missing.discard(mutant.what.split(":")[0])
        if not missing:
            break
    assert not missing
