"""What becomes of a file that is edited: the values, the old file, and what is refused."""

from pathlib import Path

import pytest

from gateway.commissioning.editor.editing import MOST_POINTS, EditError, Editing
from gateway.report.words import scale_of
from gateway.tabfile import TabFileError, dialect_named
from tests.editor.desk import UP_TO_HOME, opened, read, sampled
from tests.tabfile.mutants import Sample
from tests.tabfile.samples import SAMPLES, SIEMENS_CEC, TABLES

WRITABLE = [
    each
    for each in SAMPLES
    if dialect_named(each.dialect).is_writable and not dialect_named(each.dialect).moves_points
]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "cnc10x.tab"
    path.write_text(UP_TO_HOME)
    return path


@pytest.mark.parametrize("sample", WRITABLE, ids=lambda each: each.label or each.dialect)
def test_a_format_keeps_all_but_the_edited_value(sample: Sample, tmp_path: Path) -> None:
    editing, context = sampled(sample, tmp_path)
    before = read(editing, context).table
    unit = scale_of(before.units).factor
    index = len(before.positions) // 2
    index += before.positions[index] == 0.0  # some formats want 0 at home
    editing.change(index, "forward", before.forward[index] * unit + 4.0, together=False)
    editing.save()
    after = read(editing, context).table
    is_one_way = dialect_named(sample.dialect).directions == 1
    assert list(after.positions) == pytest.approx(list(before.positions), abs=1e-9)
    for name, old, new in (
        ("forward", before.forward, after.forward),
        ("backward", before.backward, after.backward),
    ):
        moved = 4.0 if name == "forward" or is_one_way else 0.0
        # 4 µm; in whole counts of 64000 per inch, 0.4 µm each, it is up to half a count less or more
        assert (new[index] - old[index]) * unit == pytest.approx(moved, abs=0.2)
        others = [at for at in range(len(old)) if at != index]
        assert [new[at] for at in others] == pytest.approx([old[at] for at in others], abs=1e-9)
    assert (tmp_path / f"{sample.name}.bak").read_bytes() == sample.data


def test_the_first_save_keeps_the_file_as_it_was_and_no_save_takes_an_older_one(file: Path) -> None:
    file.with_name("cnc10x.tab.bak").write_text("of last year")
    editing = opened(file)
    editing.change(0, "forward", 7.0, together=False)
    assert editing.save() == "cnc10x.tab is saved; the file as it was is in cnc10x.tab.2.bak"
    editing.change(0, "forward", 8.0, together=False)
    editing.save()
    names = {each.name: each.read_text() for each in file.parent.iterdir()}
    assert set(names) == {"cnc10x.tab", "cnc10x.tab.bak", "cnc10x.tab.2.bak"}
    assert (names["cnc10x.tab.bak"], names["cnc10x.tab.2.bak"]) == ("of last year", UP_TO_HOME)
    assert read(editing).table.forward[0] == 0.008
    assert editing.conclusion() == f"{file}: saved; the old file is cnc10x.tab.2.bak"


def test_undo_and_redo_go_through_all_changes(file: Path) -> None:
    editing = opened(file)
    for value in (7.0, 9.0):
        editing.change(0, "backward", value, together=False)
    editing.change(1, "backward", 1.0, together=False, is_kept=False)  # a drag that goes on
    seen = [editing.go(steps) for steps in (-1, -1, -1, 1, 1, 1)]
    # the point at -500 moves backward by 5 µm in the file
    assert [each.now.backward[0] for each in seen] == [7.0, 5.0, 5.0, 7.0, 9.0, 9.0]
    assert [each.can_undo for each in seen] == [True, False, False, True, True, True]
    assert [each.can_redo for each in seen] == [True, True, True, True, False, False]
    assert [each.is_changed for each in seen] == [True, False, False, True, True, True]
    editing.go(-1)
    assert editing.change(0, "backward", 8.0, together=False).can_redo is False
    assert editing.go(-1).now.backward[0] == 7.0


def test_both_directions_move_together_where_that_is_wanted(file: Path) -> None:
    editing = opened(file)
    now = editing.change(2, "forward", 11.0, together=True).now  # 9 forward and 2 backward at -300
    assert (now.forward[2], now.backward[2]) == (11.0, 4.0)


def test_a_table_of_one_direction_begins_with_both_together(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text("position_mm,correction_um\n0,0\n100,2\n200,3\n")
    assert opened(path).state().together is True
    path.write_text("position_mm,forward_um,backward_um\n0,0,0\n100,2,1\n200,3,1\n")
    assert opened(path).state().together is False


def test_the_ends_of_a_table_that_repeats_stay_equal(tmp_path: Path) -> None:
    sample = next(each for each in SAMPLES if each.dialect == "siemens-eec")
    path = tmp_path / sample.name
    path.write_bytes(sample.data.replace(b"IS_MODULO[0,X1]=0", b"IS_MODULO[0,X1]=1"))
    text = path.read_text()
    lines = [line for line in text.splitlines() if line.startswith("$AA_ENC_COMP[0,")]
    first = lines[0].partition("=")[2].split(";")[0].strip()
    end = lines[-1].partition("=")
    path.write_text(text.replace(lines[-1], f"{end[0]}={first}"))
    editing = opened(path, units=sample.context.units)
    now = editing.change(0, "forward", -9.0, together=False).now.forward
    assert (now[0], now[-1]) == (-9.0, -9.0)
    assert editing.state().refusals == []


def test_a_save_says_that_the_signature_was_for_the_file_as_it_was(file: Path) -> None:
    file.with_name("cnc10x.tab.sig").write_text("a signature")
    editing = opened(file)
    editing.change(0, "forward", 7.0, together=False)
    assert editing.save() == (
        "cnc10x.tab is saved; the file as it was is in cnc10x.tab.bak. Its signature was for that one: "
        f"sign it again: ssh-keygen -Y sign -n pitch-gateway -f KEY {file}"
    )


def test_an_error_keeps_the_table_from_being_saved_and_is_named(file: Path) -> None:
    editing = opened(file)
    # 600 µm: above 0.5 mm (L12), and with 589 µm more over 100 mm a slope of 0.0059, which is allowed
    state = editing.change(0, "forward", 600.0, together=False)
    assert [(each.code, each.point, each.way) for each in state.remarks if each.code == "L12"] == [
        ("L12", 0, "forward")
    ]
    assert [each[:4] for each in state.refusals] == ["L12:"]
    for save in (editing.save, editing.save_copy):
        with pytest.raises(EditError, match=r"not saved: L12: forward correction of 0.6 mm"):
            save()
    assert file.read_text() == UP_TO_HOME
    assert list(file.parent.iterdir()) == [file]


def test_a_remark_leads_to_no_point_where_its_line_has_several(tmp_path: Path) -> None:
    editing, _ = sampled(next(each for each in SAMPLES if each.dialect == "aerotech-cal"), tmp_path)
    remarks = editing.change(1, "forward", 600.0, together=False).remarks  # six values to a line
    assert [(each.point, each.way) for each in remarks if each.code == "L12"] == [(None, "")]


def test_a_value_that_no_table_can_have_is_not_taken(file: Path) -> None:
    editing = opened(file)
    with pytest.raises(EditError, match=r"not changed: .*slope"):
        editing.change(0, "forward", 200_000.0, together=False)  # 200 mm within 100 mm
    with pytest.raises(EditError, match="there is no point 6"):
        editing.change(6, "forward", 1.0, together=False)
    assert editing.is_changed is False


def test_what_the_format_cannot_hold_is_shown_and_not_saved(tmp_path: Path) -> None:
    path = tmp_path / "CNC7X.TAB"
    path.write_bytes((TABLES / "centroid-v1/CNC7X.TAB").read_bytes())
    editing = opened(path, file_counts_per_unit=64000.0, file_home=None)
    state = editing.change(len(state_of(editing)) - 1, "forward", 5.0, together=False)  # at home
    assert state.remarks == []
    assert len(state.refusals) == 1
    assert "at home" in state.refusals[0]
    with pytest.raises(EditError, match="at home"):
        editing.save()


def state_of(editing: Editing) -> list[str]:
    return list(editing.state().positions)


@pytest.mark.parametrize(
    ("there", "what"), [(True, "was changed by another program"), (False, "is no longer there")]
)
def test_a_file_that_changed_meanwhile_stays_as_it_is(file: Path, there: bool, what: str) -> None:
    editing = opened(file)
    editing.change(0, "forward", 7.0, together=False)
    other = UP_TO_HOME.replace("0.011", "0.012")
    if there:
        file.write_text(other)
    else:
        file.unlink()
    with pytest.raises(EditError, match=f"not saved: cnc10x.tab {what} .* Save a copy"):
        editing.save()
    assert [each.read_text() for each in file.parent.iterdir()] == ([other] if there else [])
    assert editing.save_copy() == "the edited table is in cnc10x.tab.edited.bak; cnc10x.tab is as it was"
    copy = file.with_name("cnc10x.tab.edited.bak")
    assert opened(copy).state().now.forward[0] == 7.0
    assert editing.is_changed is True
    assert editing.conclusion() == f"{file}: changes that were not saved are dropped"


def test_a_file_of_version_2_keeps_the_counts_in_its_header(tmp_path: Path) -> None:
    path = tmp_path / "cnc10z.tab"
    path.write_bytes((TABLES / "centroid-v2/cnc10z.tab").read_bytes())
    editing = opened(path)
    editing.change(1, "forward", 1.0, together=False)
    editing.save()
    # 9 steps of 0.5 inch are 114300 counts
    assert path.read_text().startswith("2 9 0.5 20 114300 0.000000 ; ")


def test_lines_that_saving_does_not_keep_are_named(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text("# measured by hand\nposition_mm,error_um\n0,0\n100,-2\n200,-3\n")
    notes = opened(path).state().notes
    assert notes[0] == (
        "2 lines are written in other words or left out: "
        "line 1: # measured by hand; line 2: position_mm,error_um"
    )


@pytest.mark.parametrize(
    ("dialect", "name"),
    [("carvera", "pitch_compensation"), ("renishaw-ren", "x"), ("pmac", "x"), ("mint", "leadscrew")],
)
def test_a_format_that_cannot_be_edited_is_refused_with_the_way_out(
    dialect: str, name: str, tmp_path: Path
) -> None:
    sample = next(each for each in SAMPLES if each.dialect == dialect)
    with pytest.raises(TabFileError) as error:
        sampled(sample, tmp_path)
    copy = f"a copy to edit: pitch-gateway table convert {sample.name} {name}-edit.csv --to csv"
    assert f"format {dialect}, wh" in str(error.value)
    assert str(error.value).endswith(copy)


def test_a_file_with_tables_of_several_axes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "two.ini"
    two = SIEMENS_CEC.replace(b"M0\nM17\n", b"") + SIEMENS_CEC.split(b"CHANDATA(1)\n")[1].replace(
        b"X1", b"Y1"
    ).replace(b"[1", b"[3").replace(b"[0", b"[2")
    path.write_bytes(two)
    with pytest.raises(TabFileError, match="several axes, of which saving would keep only one") as error:
        opened(
            path, units=SAMPLES[3].context.units, error_sense=SAMPLES[-4].context.error_sense, file_axis="Y1"
        )
    assert "--file-axis Y1" in str(error.value)


def test_more_points_than_a_person_can_use_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    rows = "".join(f"{at},0\n" for at in range(MOST_POINTS + 1))
    path.write_text(f"position_mm,correction_um\n{rows}")
    with pytest.raises(
        TabFileError, match=f"{MOST_POINTS + 1} points; allowed: at most {MOST_POINTS}: .*--resample"
    ):
        opened(path)
