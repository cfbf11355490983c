"""Which table each axis has where files are good, bad, gone or switched off."""

from collections.abc import Collection
from pathlib import Path

import pytest

from gateway.config.compile import compile_into_state
from gateway.config.last_good import Settled, TableSource, settle
from gateway.config.load import load
from gateway.state.last_good import last_plan
from gateway.state.plan import CompiledPlan, in_force
from tests.config.config_bench import GOOD, ONE_WAY, TWO_WAYS, edited, written

NAME = "cnc10x.tab"
BAD = TWO_WAYS.replace("-0.0030", "-0.0O30")
SECOND_AXIS = (
    GOOD[GOOD.index("[axis.x]") :]
    .replace("axis.x", "axis.y")
    .replace("unit_id = 1", "unit_id = 2")
    .replace(NAME, "cnc10y.tab")
)
Y = TWO_WAYS.replace("AXIS X", "AXIS Y")
PAIR = f'{GOOD}\n{SECOND_AXIS}\n[group.beam]\naxes = ["x", "y"]\n'


def settled(path: Path, before: CompiledPlan | None = None, *, waiting: Collection[str] = ()) -> Settled:
    return settle(load(path, forgives_tables=True), before, waiting=waiting)


def forward_end(found: Settled, axis: int = 0) -> float | None:
    """Return what the table of an axis adds at its lowest point moving forward, None without a table."""
    table = found.plan.lines[0].axes[axis].table
    return None if table is None else table.forward[0]


def save(path: Path, content: str, name: str = NAME) -> None:
    (path.parent / "tables" / name).write_text(content)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return written(tmp_path)


@pytest.fixture
def before(path: Path) -> CompiledPlan:
    compile_into_state(load(path))
    last = last_plan(path.parent / "state")
    assert last is not None
    assert last.plan == in_force(load(path).plan)
    return last


def test_a_good_file_counts(path: Path, before: CompiledPlan) -> None:
    save(path, TWO_WAYS.replace("-0.0120", "-0.0130"))
    found = settled(path, before)
    assert (found.sources, forward_end(found)) == ({"x": TableSource.FILE}, -0.013)


def test_a_bad_file_changes_nothing(path: Path, before: CompiledPlan) -> None:
    save(path, BAD)
    found = settled(path, before)
    assert (found.sources, forward_end(found)) == ({"x": TableSource.KEPT}, -0.012)
    assert found.plan == before.plan


def test_a_file_that_does_not_go_with_the_axis_is_bad(path: Path, before: CompiledPlan) -> None:
    path.write_text(edited(("max_speed = 200.0", "max_speed = 200.0\nmax_correction = 0.02")))
    save(path, TWO_WAYS.replace("-0.0120", "-0.0210"))
    assert settled(path, before).sources == {"x": TableSource.KEPT}


def test_a_bad_file_at_the_first_start_is_refused(path: Path) -> None:
    save(path, BAD)
    assert settled(path, None).refused == ("x",)


def test_a_bad_file_of_another_name_is_refused(path: Path, before: CompiledPlan) -> None:
    path.write_text(edited((NAME, "new.tab")))
    save(path, BAD, "new.tab")
    assert settled(path, before).refused == ("x",)
    assert settled(path, before, waiting={"x"}).refused == ("x",)


def test_a_bad_file_of_another_folder_is_refused(path: Path, before: CompiledPlan) -> None:
    (path.parent / "others").mkdir()
    (path.parent / "others" / NAME).write_text(BAD)
    path.write_text(edited(('name = "mill-1"', 'name = "mill-1"\ntables = "others"')))
    assert settled(path, before).refused == ("x",)
    path.write_text(edited(('name = "mill-1"', 'name = "mill-1"\ntables = "none"')))
    assert settled(path, before).refused == ("x",)


def test_the_last_good_table_does_not_outlive_the_settings_it_was_good_for(
    path: Path, before: CompiledPlan
) -> None:
    save(path, BAD)
    path.write_text(edited(("max_speed = 200.0", "max_speed = 200.0\nmax_correction = 0.015")))
    assert settled(path, before).refused == ("x",)  # it corrects by 0.02
    path.write_text(edited(("counts_per_unit = 1000.0", "counts_per_unit = 2000.0")))
    assert settled(path, before).refused == ("x",)
    path.write_text(edited(("max_speed = 200.0", "max_speed = 200.0\ngain = 0.5")))
    assert settled(path, before).sources == {"x": TableSource.KEPT}


def test_a_file_that_is_gone_takes_the_correction_with_it(path: Path, before: CompiledPlan) -> None:
    (path.parent / "tables" / NAME).unlink()
    found = settled(path, before)
    assert (found.sources, forward_end(found)) == ({"x": TableSource.ABSENT}, None)


def test_a_file_that_never_was_is_a_slip_of_the_configuration(path: Path, before: CompiledPlan) -> None:
    path.write_text(edited((NAME, "cnc10v.tab")))
    assert settled(path, before).refused == ("x",)
    assert settled(path, None).refused == ("x",)
    assert settled(path, before, waiting={"x"}).refused == ("x",)


def test_a_folder_that_never_had_the_file_is_a_slip_of_the_configuration(
    path: Path, before: CompiledPlan
) -> None:
    (path.parent / "tbles").mkdir()
    path.write_text(edited(('name = "mill-1"', 'name = "mill-1"\ntables = "tbles"')))
    assert settled(path, before).refused == ("x",)
    (path.parent / "tables" / NAME).unlink()
    path.write_text(edited(('name = "mill-1"', 'name = "mill-1"\ntables = "tbles/../tables"')))
    assert settled(path, before).sources == {"x": TableSource.ABSENT}  # the same folder by another name


def test_a_file_that_is_gone_is_known_wherever_the_command_runs(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(path.parent)
    compile_into_state(load(Path(path.name)))
    before = last_plan(path.parent / "state")
    monkeypatch.chdir("/")
    (path.parent / "tables" / NAME).unlink()
    assert settled(path, before).sources == {"x": TableSource.ABSENT}


def test_a_file_that_was_gone_before_may_be_gone_at_the_start(path: Path, before: CompiledPlan) -> None:
    (path.parent / "tables" / NAME).unlink()
    loaded = load(path, forgives_tables=True)
    compile_into_state(loaded, settle(loaded, before).plan)
    again = last_plan(path.parent / "state")
    assert again is not None
    assert settled(path, again).sources == {"x": TableSource.ABSENT}
    save(path, TWO_WAYS)
    assert settled(path, again).sources == {"x": TableSource.FILE}


def test_a_file_renamed_to_bak_is_switched_off_from_the_first_start(path: Path) -> None:
    tables = path.parent / "tables"
    (tables / NAME).rename(tables / "cnc10x.bak")
    found = settled(path, None)
    assert (found.sources, forward_end(found)) == ({"x": TableSource.ABSENT}, None)


def test_a_file_that_is_being_written_counts_for_nothing(path: Path, before: CompiledPlan) -> None:
    save(path, ONE_WAY)
    found = settled(path, before, waiting={"x"})
    assert (found.sources, forward_end(found)) == ({"x": TableSource.KEPT}, -0.012)


def test_a_folder_that_cannot_be_read_changes_nothing(path: Path, before: CompiledPlan) -> None:
    (path.parent / "tables").rename(path.parent / "elsewhere")
    assert settled(path, before).sources == {"x": TableSource.KEPT}


class TestGroups:
    """Axes of one beam have their tables together or not at all."""

    @pytest.fixture
    def path(self, tmp_path: Path) -> Path:
        return written(tmp_path, PAIR, {NAME: TWO_WAYS, "cnc10y.tab": Y})

    @pytest.mark.parametrize(
        ("x", "y", "source"),
        [
            (TWO_WAYS, Y, TableSource.FILE),
            (BAD, Y, TableSource.KEPT),
            (None, Y, TableSource.ABSENT),
            (None, BAD, TableSource.ABSENT),
        ],
        ids=["good", "one is bad", "one is gone", "gone beats bad"],
    )
    def test_the_worst_file_decides(
        self, path: Path, before: CompiledPlan, x: str | None, y: str, source: TableSource
    ) -> None:
        save(path, y.replace("-0.0120", "-0.0130"), "cnc10y.tab")
        if x is None:
            (path.parent / "tables" / NAME).unlink()
        else:
            save(path, x)
        found = settled(path, before)
        assert found.sources == {"x": source, "y": source}
        y_end = {TableSource.FILE: -0.013, TableSource.KEPT: -0.012, TableSource.ABSENT: None}[source]
        assert forward_end(found, 1) == y_end
        assert (forward_end(found, 0) is None) == (source is TableSource.ABSENT)

    def test_no_table_of_another_name_stays_because_the_other_axis_has_a_bad_one(
        self, path: Path, before: CompiledPlan
    ) -> None:
        path.write_text(PAIR.replace(NAME, "new.tab"))
        save(path, TWO_WAYS, "new.tab")
        assert settled(path, before).refused == ()
        save(path, BAD, "cnc10y.tab")
        assert set(settled(path, before).refused) == {"x", "y"}

    def test_without_a_last_good_pair_a_bad_one_is_refused(self, path: Path) -> None:
        save(path, BAD)
        assert set(settled(path, None).refused) == {"x", "y"}


def test_a_file_that_moves_counts_for_nothing_even_where_nothing_was_before(path: Path) -> None:
    assert settled(path, waiting={"x"}).sources == {"x": TableSource.REFUSED}


def test_a_file_that_moves_keeps_no_table_that_the_new_limits_forbid(
    path: Path, before: CompiledPlan
) -> None:
    path.write_text(edited(("max_speed = 200.0", "max_speed = 200.0\nmax_correction = 0.005")))
    assert settled(path, before, waiting={"x"}).sources == {"x": TableSource.REFUSED}


MINT = """\
DIM fwd(5) = 10.02, 20.01, 30.00, 40.01, 50.01
PRECISIONTABLE(0, fwd)
PRECISIONINCREMENT.0 = 10
PRECISIONOFFSET.0 = 5
"""


def of_mint(more: str) -> str:
    """Return a configuration of which an earlier release read the offset as the place of mark A."""
    return edited(
        (NAME, "x.mnt"),
        ("travel = [-300.0, 0.0]", "travel = [0.0, 60.0]"),
        ("max_speed = 200.0", f'max_speed = 200.0\ntable_options = {{ file_units = "mm"{more} }}'),
    )


def test_a_mint_offset_that_nothing_explains_any_more_leaves_the_table_in_force(path: Path) -> None:
    path.write_text(of_mint(", file_start = 5.0"))
    save(path, MINT, "x.mnt")
    compile_into_state(load(path))
    last = last_plan(path.parent / "state")
    assert last is not None
    path.write_text(of_mint(""))
    found = settled(path, last)
    assert (found.sources, found.plan) == ({"x": TableSource.KEPT}, last.plan)
    (problem,) = load(path, forgives_tables=True).readings["x"].problems
    # 2 from A the motor is at 2 x 10 / 10.02, 12 from A at 10 + 1.98 / 9.99 x 10
    assert "7 is sent as 6.99601" in problem.found
    assert "7 is sent as 6.98198" in problem.found
    assert problem.line == 4
    # told as it was read before, it is the same table: nothing changes
    path.write_text(of_mint(", file_start = 5.0"))
    assert settled(path, last).plan == last.plan
