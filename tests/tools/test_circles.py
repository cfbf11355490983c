"""tools/circles.py on made-up packages: every circle is named, with the lines that make it."""

from pathlib import Path

import pytest

from tools import circles

UNDER_TYPE_CHECKING = """\
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mill.axis import Axis
"""


@pytest.fixture
def mill(tmp_path: Path) -> Path:
    """A package without a circle: line imports axis, axis imports table."""
    package = tmp_path / "mill"
    (package / "tables").mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "line.py").write_text("import os\n\nimport mill.axis\n")
    (package / "axis.py").write_text("from mill.tables import table\n\nAxis = table.Table\n")
    (package / "tables" / "__init__.py").write_text("")
    (package / "tables" / "table.py").write_text("Table = int\n")
    return package


def test_where_no_module_leads_back_nothing_is_said(mill: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert circles.main(mill) == 0
    assert capsys.readouterr().out == ""


def test_a_circle_under_type_checking_is_named_with_its_lines(
    mill: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (mill / "tables" / "table.py").write_text(UNDER_TYPE_CHECKING)
    assert circles.main(mill) == 1
    assert capsys.readouterr().out == (
        "mill.axis -> mill.tables.table -> mill.axis\n"
        "  mill/axis.py:1 imports mill.tables.table\n"
        "  mill/tables/table.py:4 imports mill.axis\n"
    )


def test_a_circle_inside_a_function_and_through_a_package_itself_is_named(
    mill: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (mill / "tables" / "__init__.py").write_text("from mill.tables.table import Table\n")
    (mill / "tables" / "table.py").write_text("def of() -> None:\n    from mill.tables import Table\n")
    assert circles.main(mill) == 1
    assert capsys.readouterr().out == (
        "mill.tables -> mill.tables.table -> mill.tables\n"
        "  mill/tables/__init__.py:1 imports mill.tables.table\n"
        "  mill/tables/table.py:2 imports mill.tables\n"
    )


def test_of_two_circles_each_is_named_once_by_its_shortest_chain(mill: Path) -> None:
    (mill / "tables" / "table.py").write_text("import mill.line\nimport mill.axis\n")
    (mill / "one.py").write_text("import mill.two\n")
    (mill / "two.py").write_text("import mill.one\n")
    assert circles.circles(circles.read_imports(mill)) == [
        ["mill.axis", "mill.tables.table", "mill.axis"],
        ["mill.one", "mill.two", "mill.one"],
    ]
