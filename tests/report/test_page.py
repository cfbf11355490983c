"""The HTML report: the numbers to the digit, nothing from outside, nothing of strangers as markup."""

import re
from html.parser import HTMLParser

import pytest

from gateway import __version__
from gateway.compensation.direction import Direction
from gateway.metrology.readings import Survey
from gateway.report.axis_data import Report
from gateway.report.writing import render
from tests.report.stories import axis_data, report, survey

VOID = {"meta", "link", "br"}


class Page(HTMLParser):
    """What is in a page; fails where a tag is not closed."""

    def __init__(self, told: Report) -> None:
        super().__init__()
        self.source = render(told, ".html").decode()
        self.tables: list[list[list[str]]] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.headings: list[str] = []
        self.texts: list[str] = []
        self._open: list[str] = []
        self.feed(self.source)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("th", "td"):
            self.tables[-1][-1].append("")
        elif tag in ("h1", "h2", "h3"):
            self.headings.append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" in self._open:
            return
        if self._open and self._open[-1] == "dd":
            self.texts.append(" ")
        self.texts.append(data)
        if {"th", "td"} & set(self._open):
            self.tables[-1][-1][-1] += data
        if self._open and self._open[-1] in ("h1", "h2", "h3"):
            self.headings[-1] += data

    @property
    def text(self) -> str:
        """Everything that can be read, in one line."""
        return " ".join("".join(self.texts).replace("\N{NO-BREAK SPACE}", " ").split())


@pytest.fixture(scope="module")
def page() -> Page:
    return Page(report())


def test_the_results_of_iso_230_2_to_the_digit(page: Page) -> None:
    # By hand, µm: s = sqrt 2, 2 sqrt 2, 0, sqrt 2. A = 12 + 4 sqrt 2 + 4; A backward = 5 + 6 sqrt 2;
    # A forward = 6 + 2 sqrt 2; R = 6 sqrt 2 + 10; R forward = 4 sqrt 2; R backward = 8 sqrt 2.
    share = "10.0\N{NO-BREAK SPACE}%"
    assert page.tables[0] == [
        ["quantity", "before", "after", "left over"],
        ["A accuracy", "21.66", "2.17", share],
        ["A forward", "8.83", "0.88", share],
        ["A backward", "13.49", "1.35", share],
        ["R repeatability", "18.49", "1.85", share],
        ["R forward", "5.66", "0.57", share],
        ["R backward", "11.31", "1.13", share],
        ["E systematic deviation", "16.00", "1.60", share],
        ["E forward", "6.00", "0.60", share],
        ["E backward", "5.00", "0.50", share],
        ["M mean systematic deviation", "5.50", "0.55", share],
        ["B largest reversal", "11.00", "1.10", share],
        ["B̄ mean reversal", "−10.50", "−1.05", share],
    ]


def test_what_the_readings_do_not_carry_is_a_dash() -> None:
    forward = tuple(each for each in survey().readings if each.direction is Direction.FORWARD)
    rows = Page(report(axis_data(before=Survey(forward, survey().units), after=None))).tables[0]
    assert {row[0]: row[1] for row in rows[1:]} == {
        "A accuracy": "–",
        "A forward": "8.83",
        "A backward": "–",
        "R repeatability": "–",
        "R forward": "5.66",
        "R backward": "–",
        "E systematic deviation": "–",
        "E forward": "6.00",
        "E backward": "–",
        "M mean systematic deviation": "–",
        "B largest reversal": "–",
        "B̄ mean reversal": "–",
    }


def test_the_points_of_the_table_can_be_unfolded(page: Page) -> None:
    assert page.tables[1] == [
        ["position / mm", "moving forward", "moving backward", "difference"],
        ["0", "0.00", "−20.00", "20.00"],
        ["10", "10.00", "−10.00", "20.00"],
        ["30", "−5.00", "−20.00", "15.00"],
        ["40", "20.00", "0.00", "20.00"],
    ]
    assert "details" in [tag for tag, _ in page.tags]


FEW = (
    "2 targets, 2 runs in each direction; not a test after ISO 230-2: 2 targets, 5 are required on this "
    "length; 2 runs in each direction, 5 are required"
)


def test_it_tells_everything_that_was_given(page: Page) -> None:
    for words in (
        "Axis x was accurate to 21.7 µm and is now accurate to 2.2 µm: 10 times better.",
        "2026-11-21",
        "customer Smith & Sons",
        "machine mill",
        "the laser was warm",
        f"Before: {FEW}.",
        f"After (measured): {FEW}.",
        "All means with their 2s lie between the dashed lines. Their distance, 2.2 µm, is the accuracy A.",
        "The steepest is 2.5 µm/mm: there the drive moves 0.25 % faster or slower than commanded.",
        f"Made by pitch-gateway {__version__}.",
    ):
        assert words in page.text
    assert "predicted" not in page.text


def test_a_prediction_is_marked_wherever_it_stands() -> None:
    predicted = Page(report(axis_data(is_predicted=True)))
    assert predicted.tables[0][0] == ["quantity", "before", "after, predicted at the targets", "left over"]
    for words in (
        "After (predicted): 2 targets",
        "Residue after compensation, magnified (predicted)",
        "These readings are predicted, not measured.",
        "it is computed from the readings before and the table",
    ):
        assert words in predicted.text
    assert "measured)" not in predicted.text


def test_headings_and_pictures_are_for_everybody(page: Page) -> None:
    assert page.headings[:2] == ["Accuracy of a mill", "Axis x"]
    assert page.headings[-1] == "How the numbers are made"
    names = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    pictures = [attributes for tag, attributes in page.tags if tag == "svg"]
    assert len(pictures) == 6
    for picture in pictures:
        assert picture["role"] == "img"
        assert set((picture["aria-labelledby"] or "").split()) <= names
    heads = [attributes for tag, attributes in page.tags if tag == "th"]
    assert all(head["scope"] in ("row", "col") for head in heads)
    assert [tag for tag, _ in page.tags].count("caption") == len(page.tables)


def test_nothing_comes_from_outside_and_nothing_runs(page: Page) -> None:
    assert not {"script", "link", "img", "iframe", "object", "use-credentials"} & {
        tag for tag, _ in page.tags
    }
    for _, attributes in page.tags:
        for name, value in attributes.items():
            assert not name.startswith("on")
            if name in ("src", "href", "xlink:href"):
                assert (value or "").startswith("#")
    assert "http://" not in page.source
    assert "https://" not in page.source
    assert "@import" not in page.source
    assert re.findall(r"url\((?!#)", page.source) == []


EVIL = '<script>alert("1")</script> & \' $x_1$ --> \x00\x1b[31m\udcff\u202e 数控机床 {} %s'


def test_the_printed_page_ends_with_lines_for_what_no_fact_states_and_to_sign() -> None:
    signed = "Measured by, date Signature Released by, date Signature"
    filled_in = "Machine, serial number Instrument, certificate Temperature of machine and air"
    bare = axis_data(facts={"date": "2026-11-21"})
    assert f"{filled_in} {signed} Made by" in Page(Report("A mill", (bare,), "")).text
    stated = axis_data(facts={"Laser serial number": "17"})
    machine = Report("A mill", (bare, stated), "", {"machine": "mill 7"})
    assert f"straight line. Temperature of machine and air {signed} Made by" in Page(machine).text


def test_what_strangers_wrote_is_text() -> None:
    facts = {EVIL: EVIL}
    axis = axis_data(axis=EVIL, facts=facts, notes=(EVIL,))
    evil = Page(Report(EVIL, (axis,), EVIL, facts))
    assert not {"script"} & {tag for tag, _ in evil.tags}
    assert "<script" not in evil.source
    assert (
        '<script>alert("1")</script> & \' $x_1$ --> \ufffd\ufffd[31m\ufffd\ufffd 数控机床 {} %s' in evil.text
    )
    for suffix in (".svg", ".png"):
        assert render(Report(EVIL, (axis,), EVIL, facts), suffix)


def test_every_name_is_given_once_and_every_reference_has_its_name() -> None:
    two = Page(report(axis_data(), axis_data()))
    ids = [attributes["id"] for _, attributes in two.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    named = re.findall(r"url\(#([^)]*)\)", two.source) + re.findall(r'href="#([^"]*)"', two.source)
    assert len(named) > 100
    assert set(named) <= set(ids)


def test_readings_that_nothing_follows_are_measured_not_before() -> None:
    alone = Page(report(axis_data(table=None, after=None)))
    assert alone.tables[0][0] == ["quantity", "measured"]
    assert "Measured: 2 targets" in alone.text
    assert "B̄ its mean with its sign, negative where the nut stays behind" in alone.text
