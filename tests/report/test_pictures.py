"""What is drawn: read back from the SVG, where every curve has its name."""

import re
import struct
from math import sin
from xml.etree import ElementTree as ET

import pytest

from gateway.compensation.direction import Direction
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.metrology.evaluation import evaluate
from gateway.metrology.readings import Survey
from gateway.report.axis_data import Report
from gateway.report.drawing import MOST_POINTS
from gateway.report.findings import find
from gateway.report.page import sentence_lines, shown_figures
from gateway.report.writing import render
from tests.report.stories import axis_data, report, survey

SVG = "{http://www.w3.org/2000/svg}"
NUMBERS = re.compile(r"-?\d+(?:\.\d+)?")


class Drawing:
    """One SVG; places in its own points, y downwards."""

    def __init__(self, told: Report) -> None:
        self.text = render(told, ".svg").decode()
        self.root = ET.fromstring(self.text)
        names = [element.get("id") for element in self.root.iter() if element.get("id")]
        assert len(names) == len(set(names))
        self._named = {element.get("id"): element for element in self.root.iter(f"{SVG}g")}

    def names(self, prefix: str) -> set[str]:
        """Return what is drawn under names with this prefix."""
        return {name.removeprefix(prefix) for name in self._named if name and name.startswith(prefix)}

    def line(self, name: str) -> list[tuple[float, float]]:
        """Return the corners of a curve."""
        path = next(self._named[name].iter(f"{SVG}path")).get("d")
        assert path is not None
        numbers = [float(number) for number in NUMBERS.findall(path)]
        return list(zip(numbers[::2], numbers[1::2], strict=True))

    def marks(self, name: str) -> int:
        """Return the number of marks of a curve, or of dots."""
        return len(list(self._named[name].iter(f"{SVG}use")))

    def heights(self, panel: str, name: str) -> list[float]:
        """Return the values of a curve in points above the line of no deviation."""
        zero = self.line(f"{panel}-zero")[0][1]
        return [zero - y for _, y in self.line(f"{panel}-{name}")]


@pytest.fixture(scope="module")
def drawing() -> Drawing:
    return Drawing(report())


def test_every_picture_is_there_with_its_curves(drawing: Drawing) -> None:
    assert drawing.names("axis1-") == {
        *(
            f"readings-{when}-{what}-{way}"
            for when in ("before", "after")
            for what in ("mean", "dots", "band")
            for way in ("forward", "backward")
        ),
        *(f"residue-{what}-{way}" for what in ("mean", "dots", "band") for way in ("forward", "backward")),
        *("residue-accuracy-low", "residue-accuracy-high"),
        *("correction-forward", "correction-backward", "slope-forward", "slope-backward"),
        *("backlash-before", "backlash-table", "backlash-after"),
        *(
            f"{panel}-zero"
            for panel in ("readings-before", "readings-after", "residue", "correction", "slope", "backlash")
        ),
    }


def test_a_long_sentence_is_told_to_its_end() -> None:
    lines = sentence_lines(find(axis_data(before=survey(runs=1), after=survey(runs=1), axis="a name " * 9)))
    assert " ".join(lines).endswith("it is not better.")
    assert [len(line) <= 106 for line in lines] == [True, True]


def test_readings_of_one_direction_have_their_results_in_the_picture() -> None:
    forward = tuple(each for each in survey().readings if each.direction is Direction.FORWARD)
    one, both = evaluate(Survey(forward, Units.MM)), evaluate(survey())
    assert [(each.symbol, each.direction) for each in shown_figures([one])] == [
        (symbol, way) for symbol in "ARE" for way in ("forward", "backward")
    ]
    assert {each.direction for each in shown_figures([one, both])} == {"both"}


def test_the_curves_of_the_table_are_its_points(drawing: Drawing) -> None:
    forward = drawing.heights("axis1-correction", "forward")
    # 0, 10, -5 and 20 µm
    assert forward[0] == pytest.approx(0, abs=1e-3)
    scale = forward[1] / 10
    assert forward == pytest.approx([0, 10 * scale, -5 * scale, 20 * scale], abs=1e-3)
    # -20, -10, -20 and 0 µm, on the same scale
    backward = drawing.heights("axis1-correction", "backward")
    assert backward == pytest.approx([-20 * scale, -10 * scale, -20 * scale, 0], abs=1e-3)
    x = [x for x, _ in drawing.line("axis1-correction-forward")]
    assert [(each - x[0]) / (x[1] - x[0]) for each in x] == pytest.approx([0, 1, 3, 4], abs=1e-4)
    assert drawing.marks("axis1-correction-forward") == drawing.marks("axis1-correction-backward") == 4


def test_backlash_is_forward_less_backward(drawing: Drawing) -> None:
    lost = drawing.heights("axis1-backlash", "table")
    # 20, 20, 15 and 20 µm
    assert [each / lost[0] for each in lost] == pytest.approx([1, 1, 0.75, 1], abs=1e-4)
    measured = drawing.heights("axis1-backlash", "before")
    # what stays behind: 12 - 2 and 7 - -4
    assert [each / lost[0] for each in measured] == pytest.approx([10 / 20, 11 / 20], abs=1e-4)
    left = drawing.heights("axis1-backlash", "after")
    assert [each / lost[0] for each in left] == pytest.approx([1 / 20, 1.1 / 20], abs=1e-4)


def test_the_slope_is_a_line_of_steps(drawing: Drawing) -> None:
    slope = drawing.heights("axis1-slope", "forward")
    # 1, -0.75 and 2.5 µm/mm
    expected = [1, 1, -0.75, -0.75, 2.5, 2.5]
    assert [each / slope[0] for each in slope] == pytest.approx(expected, abs=1e-4)


def test_before_and_after_share_one_scale(drawing: Drawing) -> None:
    before = drawing.heights("axis1-readings-before", "mean-backward")
    after = drawing.heights("axis1-readings-after", "mean-backward")
    # 12 and 7 µm, then a tenth
    assert before[1] / before[0] == pytest.approx(7 / 12, abs=1e-3)
    assert [each / before[0] for each in after] == pytest.approx([0.1, 0.7 / 12], abs=1e-3)


def test_a_band_is_two_standard_deviations_to_either_side(drawing: Drawing) -> None:
    mean = drawing.heights("axis1-readings-before", "mean-backward")[0]
    band = drawing.heights("axis1-readings-before", "band-backward")
    # 12 +- 4 sqrt(2) at the first target, 7 +- 2 sqrt(2) at the second
    corners = sorted(12 * height / mean for height in band)
    assert corners[0] == pytest.approx(7 - 2 * 2**0.5, abs=0.01)
    assert corners[-1] == pytest.approx(12 + 4 * 2**0.5, abs=0.01)
    assert drawing.marks("axis1-readings-before-dots-backward") == 4


def test_the_dashed_lines_of_the_residue_are_accuracy_apart(drawing: Drawing) -> None:
    mean = drawing.heights("axis1-residue", "mean-backward")[0]
    low = drawing.heights("axis1-residue", "accuracy-low")[0]
    high = drawing.heights("axis1-residue", "accuracy-high")[0]
    # mean 1.2 µm, A 2.1657 µm
    assert (high - low) / mean == pytest.approx(2.1657 / 1.2, abs=1e-3)


def test_what_nobody_measured_is_not_drawn() -> None:
    only = Drawing(report(axis_data(before=None, after=None)))
    assert {name.split("-")[0] for name in only.names("axis1-")} == {"correction", "backlash", "slope"}
    one_way = make_table([0, 10], [0.0, 0.01], [0.0, 0.01], Units.MM)
    uni = Drawing(report(axis_data(table=one_way, before=None, after=None)))
    assert uni.names("axis1-") == {"correction-both", "correction-zero", "slope-both", "slope-zero"}
    once = Drawing(report(axis_data(table=None, before=survey(runs=1), after=None)))
    shown = {"mean-forward", "mean-backward", "dots-forward", "dots-backward", "zero"}
    assert once.names("axis1-readings-before-") == shown


def test_a_single_target_and_a_table_of_zeros_are_drawn_too() -> None:
    here = tuple(each for each in survey().readings if each.target == 100.0)
    zeros = make_table([0, 1], [0.0, 0.0], [0.0, 0.0], Units.MM)
    one = Drawing(report(axis_data(before=Survey(here, Units.MM), table=zeros, after=None)))
    assert one.marks("axis1-readings-before-dots-forward") == 2
    assert one.heights("axis1-correction", "both") == [0, 0]


def test_each_axis_has_its_own_sheet() -> None:
    two = Drawing(report(axis_data(), axis_data(axis="y", before=None, after=None)))
    assert two.names("axis2-correction-") == {"forward", "backward", "zero"}


def test_a_table_of_100_000_points_stays_small_and_keeps_its_peaks() -> None:
    count = 100_000
    forward = [0.05 * sin(i / 9000) for i in range(count)]
    forward[77_777] = 0.09
    long = make_table([i * 0.1 for i in range(count)], forward, [0.0] * count, Units.MM)
    big = Drawing(report(axis_data(table=long, before=None, after=None)))
    assert len(big.text) < 300_000
    heights = big.heights("axis1-correction", "forward")
    assert len(heights) <= MOST_POINTS
    assert max(heights) / sorted(heights)[-2] == pytest.approx(90 / 50, abs=0.01)
    page = render(report(axis_data(table=long, before=None, after=None)), ".html").decode()
    assert "Of each 101 of the 100000 points only the smallest and the largest are drawn." in page
    assert "The first 1000 are listed" in page
    assert page.count('<tr><th scope="row">') == 1000


def test_a_png_is_one_picture_of_a_width_for_paper() -> None:
    png = render(report(), ".png")
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    width, height = struct.unpack(">II", png[16:24])
    assert width == 1500
    assert 1500 < height < 2400
