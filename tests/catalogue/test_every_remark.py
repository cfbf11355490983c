"""Every remark that a table can get is explained."""

import re
from pathlib import Path

import pytest

from gateway.catalogue.remarks import REMARKS
from tests.support.commands import typed

TABFILE = Path(__file__).parents[2] / "gateway" / "tabfile"


def test_every_code_that_a_reader_gives_is_in_the_catalogue_and_no_other() -> None:
    given = {
        code for file in TABFILE.glob("*.py") for code in re.findall(r'"([LR]\d{1,2})"', file.read_text())
    }
    assert given == {remark.code for remark in REMARKS}


@pytest.mark.parametrize("asked", ["L8", "l8"])
def test_a_remark_of_check_is_explained(asked: str) -> None:
    said = typed("explain", asked)
    assert (said.returncode, said.stdout.splitlines()[0]) == (0, "L8 (remark, warning)")
    assert "travel that the table does not cover" in said.stdout
    assert "remedy: measure the missing stretch" in said.stdout
