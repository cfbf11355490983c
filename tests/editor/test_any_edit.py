"""Any edit of any table: only the edited value changes in the file, and undo brings all of it back."""

from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.tabfile import WriteOptions, dialect_named
from tests.editor.desk import opened
from tests.tabfile.drawn import assert_same, uneven

LAST_PLACE = 1e-5
"""mm; every number is a multiple of it, which each of these formats holds."""


@st.composite
def even_from_home(draw: st.DrawFn) -> CorrectionTable:
    """A table of a format that wants its points even and 0 at an end."""
    size, step = draw(st.integers(2, 20)), draw(st.integers(1, 50))
    sign = draw(st.sampled_from((-1, 1)))
    positions = sorted(float(sign * at * step) + 0.0 for at in range(size))
    values = st.lists(st.integers(-400, 400), min_size=size, max_size=size)
    forward, backward = draw(values), draw(values)
    return make_table(
        positions, [each * LAST_PLACE for each in forward], [each * LAST_PLACE for each in backward], Units.MM
    )


@given(
    kind=st.sampled_from(("csv", "linuxcnc-1", "centroid-3")),
    tables=st.tuples(uneven({Units.MM: LAST_PLACE}, steps=(100_000, 90_000_000)), even_from_home()),
    place=st.integers(0, 19),
    way=st.sampled_from(("forward", "backward")),
    value=st.integers(-400, 400),
)
def test_only_the_edited_value_changes(
    kind: str, tables: tuple[CorrectionTable, CorrectionTable], place: int, way: str, value: int
) -> None:
    table = tables[kind == "centroid-3"]
    index = place % len(table.positions)
    facts = {"format": kind} | ({"units": Units.MM} if kind == "linuxcnc-1" else {})
    with TemporaryDirectory() as folder:
        file = Path(folder) / "x.tab"
        file.write_text(dialect_named(kind).write(table, WriteOptions(axis="X")).text)
        editing = opened(file, **facts)
        editing.change(index, way, value * LAST_PLACE * 1000, together=False)
        editing.save()
        curves = {"forward": list(table.forward), "backward": list(table.backward)}
        curves[way][index] = value * LAST_PLACE
        wanted = make_table(table.positions, curves["forward"], curves["backward"], Units.MM)
        assert_same(opened(file, **facts)._opened.table, wanted)
        editing.go(-1)
        back = editing._draft.loaded
        assert back is not None
        assert_same(back.table, table)
