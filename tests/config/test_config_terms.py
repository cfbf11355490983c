"""``thermal`` and ``cross``: what reaches the plan, and everything that is refused."""

import hashlib
from pathlib import Path

import pytest

from gateway.compensation.settings import ThermalSettings
from gateway.config.compile import compile_into_state, sources_of
from gateway.config.summary import summary_lines
from gateway.exchange.plan import AxisPlan, CrossPlan
from gateway.state.folder import StateError
from gateway.state.plan import read_plan
from tests.config.config_bench import ONE_WAY, TWO_WAYS, edited, loaded, refusal, refused
from tests.config.test_config_groups import GROUP, PATIENT, SECOND, TABLES

MQTT = '[mqtt]\nhost = "127.0.0.1"\n\n'
WARM = 'thermal = { alpha = 11.5e-6, fixed_at = -300.0, source = { mqtt = "hall/x" } }\n'
ACROSS = 'cross = [{ axis = "y", table = "x-over-y.tab" }]\n'
OVER_Y = ONE_WAY.replace("-0.0100", "0.0000").replace("-0.0200", "0.0300")
FILES = {**TABLES, "x-over-y.tab": OVER_Y}
REGISTERS = "[axis.x.registers]"


def with_x(keys: str, text: str = PATIENT) -> str:
    return MQTT + edited((REGISTERS, keys + "\n" + REGISTERS), text=text)


def _other(folder: Path) -> Path:
    other = folder / "2"
    other.mkdir()
    return other


def axis_of(tmp_path: Path, text: str, files: dict[str, str] | None = None) -> AxisPlan:
    result = loaded(tmp_path, text, FILES if files is None else files)
    return result.plan.lines[0].axes[0]


def test_a_warm_screw_reaches_the_plan_with_its_defaults(tmp_path: Path) -> None:
    assert axis_of(tmp_path, with_x(WARM)).thermal == ThermalSettings(
        11.5e-6,
        reference=20.0,
        fixed_at=-300.0,
        timeout_s=60.0,
        hold_s=600.0,
        rate_per_min=2.0,
        largest_dt=40.0,
    )


def test_another_axis_reaches_the_plan_with_its_table_and_comes_back_out_of_the_state(tmp_path: Path) -> None:
    result = loaded(tmp_path, with_x(WARM + ACROSS, PATIENT + SECOND), FILES)
    x = result.plan.lines[0].axes[0]
    digest = hashlib.sha256(OVER_Y.encode()).hexdigest()
    assert x.cross == (
        CrossPlan("y", (-300.0, -150.0, 0.0), (0.03, 0.0, 0.0), 1.0, 0.0, 60.0, "x-over-y.tab", digest),
    )
    assert result.plan.lines[0].axes[1].cross == ()
    # 300 mm of steel, and the table over y; of y itself nothing is said.
    assert [line for line in summary_lines(result.plan, {}) if line.startswith(("  warm", "  where"))] == [
        "  warm: up to 0.00345 mm for each kelvin from 20 °C, held at -300 mm",
        "  where y is (x-over-y.tab): up to 0.03 mm",
    ]
    compile_into_state(result)
    assert read_plan(result.state_folder, result.path).plan.lines[0].axes[0] == x
    table = tmp_path / "tables" / "x-over-y.tab"
    assert sources_of(result)[str(table)] == digest
    table.write_text(OVER_Y.replace("0.0300", "0.0200"))
    with pytest.raises(StateError, match=r"x-over-y\.tab has changed since it was compiled"):
        read_plan(result.state_folder, result.path)


def test_positions_of_the_other_axis_are_in_its_own_units_in_the_file(tmp_path: Path) -> None:
    inch = SECOND.replace('"mm"', '"inch"').replace("[-300, 0]", "[-12, 0]")
    [cross] = axis_of(tmp_path, with_x(ACROSS, PATIENT + inch)).cross
    assert cross.scale == 25.4
    assert cross.positions == (-300.0, -150.0, 0.0)


MODBUS = '{ modbus = "127.0.0.1:1600", address = 100 }'
SOURCE = '{ mqtt = "hall/x" }'


@pytest.mark.parametrize(
    ("source", "key", "found"),
    [
        ("{}", "", "neither mqtt nor modbus"),
        ('{ mqtt = "a", modbus = "127.0.0.1:1600", address = 1 }', "", "mqtt and modbus"),
        ('{ mqtt = "a/#" }', ".mqtt", 'found "a/#"'),
        ('{ mqtt = "a", scale = 0.1 }', ".scale", "scale beside mqtt"),
        ('{ modbus = "127.0.0.1:1600" }', ".address", "missing"),
        ('{ modbus = "127.0.0.1" , address = 1 }', ".modbus", 'found "127.0.0.1"'),
        (
            '{ modbus = "127.0.0.1:1600", address = 0xFFFF, type = "float32" }',
            ".address",
            "float32 at 0xffff ends beyond 0xffff",
        ),
        ('{ modbus = "127.0.0.1:1600", address = 1, function = 6 }', ".function", "found 6"),
        (
            '{ modbus = "127.0.0.1:1600", address = 1, every_s = 60 }',
            ".every_s",
            "every_s = 60 and timeout_s = 60",
        ),
    ],
)
def test_sources_that_are_refused(tmp_path: Path, source: str, key: str, found: str) -> None:
    problem = refusal(
        tmp_path, with_x(WARM.replace(SOURCE, source)), f"axis.x.thermal.source{key}", tables=FILES
    )
    assert problem.found == found
    assert problem.remedy


def test_a_modbus_source_needs_no_broker(tmp_path: Path) -> None:
    text = edited((REGISTERS, WARM.replace(SOURCE, MODBUS) + REGISTERS), text=PATIENT)
    assert axis_of(tmp_path, text).thermal is not None
    problem = refusal(
        _other(tmp_path),
        edited((REGISTERS, WARM + REGISTERS), text=PATIENT),
        "axis.x.thermal.source.mqtt",
        tables=FILES,
    )
    assert problem.found == "a topic without [mqtt]"


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("alpha = 11.5e-6", "alpha = 0.0", "alpha"),
        ("alpha = 11.5e-6", "alpha = -1e-5", "alpha"),
        ("alpha = 11.5e-6", "alpha = 11.5", "alpha"),
        ("alpha = 11.5e-6", "alpha = nan", "alpha"),
        ("alpha = 11.5e-6", "alpha = 1e-5, reference = 3000.0", "reference"),
        ("alpha = 11.5e-6", "alpha = 1e-5, largest_dt = inf", "largest_dt"),
        ("alpha = 11.5e-6", "alpha = 1e-5, rate_per_min = 0.0", "rate_per_min"),
        ("alpha = 11.5e-6", "alpha = 1e-5, timeout_s = 0", "timeout_s"),
        ("alpha = 11.5e-6", "alpha = 1e-5, warm = true", "warm"),
    ],
)
def test_numbers_that_are_refused(tmp_path: Path, old: str, new: str, key: str) -> None:
    refusal(tmp_path, with_x(WARM.replace(old, new)), f"axis.x.thermal.{key}", tables=FILES)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (('table = "cnc10x.tab"\n', ""), "thermal without a table"),
        (("travel = [-300.0, 0.0]\n", ""), "thermal without travel"),
    ],
)
def test_what_a_warm_screw_needs(tmp_path: Path, change: tuple[str, str], found: str) -> None:
    problems = refused(tmp_path, with_x(WARM, edited(change, text=PATIENT)), FILES)
    assert [problem.found for problem in problems if problem.key == "axis.x.thermal"] == [found]


def test_a_turn_stays_a_turn(tmp_path: Path) -> None:
    text = with_x(WARM, edited(('units = "mm"', 'units = "degree"'), text=PATIENT))
    problems = refused(tmp_path, text, FILES)
    assert "thermal of a rotary axis" in [problem.found for problem in problems]


def test_axes_of_a_group_are_told_the_same(tmp_path: Path) -> None:
    text = with_x(WARM, PATIENT + SECOND + GROUP)
    assert refusal(tmp_path, text, "axis.x.thermal", tables=FILES).found == "thermal of an axis in a group"


def test_steep_limits_and_large_differences_cannot_be_inverted(tmp_path: Path) -> None:
    keys = WARM.replace("alpha = 11.5e-6", "alpha = 1e-3, largest_dt = 200.0") + "max_slope = 0.9\n"
    problem = refusal(tmp_path, with_x(keys), "axis.x.thermal", tables=FILES)
    assert problem.found == "alpha × largest_dt = 0.2 and max_slope = 0.9"


def test_a_difference_that_would_add_more_than_allowed_is_warned_of(tmp_path: Path) -> None:
    result = loaded(tmp_path, with_x(WARM.replace("-300.0", "2000.0")), FILES)
    [warning] = result.warnings
    assert warning.key == "axis.x.thermal"
    assert warning.found == "40 K would add 1.058 mm, more than max_correction = 0.5"
    assert warning.remedy.startswith("check fixed_at: the correction stops following beyond 18.9 K")


@pytest.mark.parametrize(
    ("cross", "key", "found"),
    [
        ('[{ axis = "x", table = "x-over-y.tab" }]', "cross[1].axis", "x itself"),
        ('[{ axis = "z", table = "x-over-y.tab" }]', "cross[1].axis", "there is no [axis.z]"),
        (
            '[{ axis = "y", table = "x-over-y.tab" }, { axis = "y", table = "x-over-y.tab" }]',
            "cross[2].axis",
            "y is listed twice",
        ),
        ('[{ axis = "y", table = "two.tab" }]', "cross[1].table", "two.tab has two directions"),
        ('[{ axis = "y", table = "../x.tab" }]', "cross[1].table", 'found "../x.tab"'),
        ('[{ axis = "y" }]', "cross[1].table", "missing"),
        ('[{ axis = "y", table = "x-over-y.tab", fresh_s = 0 }]', "cross[1].fresh_s", "found 0"),
    ],
)
def test_other_axes_that_are_refused(tmp_path: Path, cross: str, key: str, found: str) -> None:
    text = with_x(f"cross = {cross}\n", PATIENT + SECOND)
    assert refusal(tmp_path, text, f"axis.x.{key}", tables={**FILES, "two.tab": TWO_WAYS}).found == found


def test_a_table_that_is_missing_or_switched_off_is_refused(tmp_path: Path) -> None:
    text = with_x(ACROSS, PATIENT + SECOND)
    problem = refusal(tmp_path, text, "axis.x.cross[1].table", tables=TABLES)
    assert problem.found.startswith("there is no x-over-y.tab in ")
    off = {**TABLES, "x-over-y.bak": OVER_Y}
    problem = refusal(_other(tmp_path), text, "axis.x.cross[1].table", tables=off)
    assert problem.found == "x-over-y.tab was renamed to x-over-y.bak"


def test_a_damaged_table_names_its_line(tmp_path: Path) -> None:
    text = with_x(ACROSS, PATIENT + SECOND)
    bad = {**TABLES, "x-over-y.tab": OVER_Y.replace("-150.0 ", "-15o.0 ")}
    problem = refusal(tmp_path, text, "axis.x.cross[1].table", tables=bad)
    assert (Path(problem.file).name, problem.line) == ("x-over-y.tab", 7)


def test_angles_over_lengths_are_refused(tmp_path: Path) -> None:
    turning = SECOND.replace('"mm"', '"degree"')
    problems = refused(tmp_path, with_x(ACROSS, PATIENT + turning), FILES)
    assert "x is in mm and y in degree" in [problem.found for problem in problems]
