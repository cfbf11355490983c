"""What the page shows of temperature and other axes: in words, for everybody, and only where there is any."""

from typing import Any

import pytest

from tests.supervisor.page.models import axis, curve, model
from tests.supervisor.page.test_page_for_everybody import CONTRASTS
from tests.supervisor.page.visit import Visit

ROWS = """[...document.querySelectorAll("article.axis .facts > .term:not([hidden])")]
  .map((row) => [...row.children].filter((one) => !one.hidden).map((one) => one.textContent))"""
TONES = """[...document.querySelectorAll("article.axis .term:not([hidden]) > .term-state:not([hidden])")]
  .map((one) => one.className.split(" ").at(-1))"""


def thermal(state: str = "following", **changes: Any) -> dict[str, Any]:
    """A screw of 30.5 °C whose sensor was heard just now; 57.5 µm are taken off."""
    silent = state not in {"following", "waiting"}
    its = {"celsius": 30.5, "age_s": 1.2, "difference": 10.0, "correction": -0.0575, "is_silent": silent}
    return {"state": state, **its, **changes}


def cross(state: str = "following", **changes: Any) -> dict[str, Any]:
    return {"state": state, "axes": ["y"], "correction": 0.04, **changes}


def show(visit: Visit, units: str = "mm", *, is_too_large: bool = False, **terms: Any) -> None:
    found = {"correction": -0.0175, "is_too_large": is_too_large, **terms}
    visit.stage.show(model({"x": axis(units=units, terms=found)}))


def test_each_term_has_a_line_below_the_correction(visit: Visit) -> None:
    show(visit, thermal=thermal(), cross=cross())
    visit.until(ROWS, [["Temperature", "30.5\u202f°C adds −57.5\u202fµm"], ["Axis y", "adds +40.0\u202fµm"]])
    names = visit.page.locator("article.axis .facts > div:not([hidden]) > dt").all_text_contents()
    assert names == ["Correction", "Temperature", "Axis y", "On the drive", "Target"]
    show(visit, "inch", thermal=thermal(correction=-0.001))
    visit.until(ROWS, [["Temperature", "30.5\u202f°C adds −1.00\u202fthou"]])
    show(visit, "degree", cross=cross(axes=["y", "z"], correction=0.01))
    visit.until(ROWS, [["Axes y, z", "adds +36.0\u202f″"]])


@pytest.mark.parametrize(
    ("term", "added", "words", "tone"),
    [
        (
            thermal("waiting", celsius=None, age_s=None, correction=None),
            "–",
            "waiting for the sensor",
            "note",
        ),
        (
            thermal("waiting", celsius=None, age_s=None, correction=0.0, is_silent=True),
            "adds 0.0\u202fµm",
            "sensor never heard: nothing added",
            "warning",
        ),
        (
            thermal("following", celsius=None, age_s=None),
            "adds −57.5\u202fµm",
            "not heard since the restart: held",
            "note",
        ),
        (
            thermal("held", age_s=125.4),
            "30.5\u202f°C adds −57.5\u202fµm",
            "sensor silent for 2 min 5 s: held",
            "warning",
        ),
        (thermal("held", celsius=None, age_s=None), "adds −57.5\u202fµm", "sensor silent: held", "warning"),
        (
            thermal("fading", age_s=700.0, correction=-0.0123),
            "30.5\u202f°C adds −12.3\u202fµm",
            "sensor silent for 11 min 40 s: fading",
            "warning",
        ),
        (
            thermal("faded", age_s=3999.0),
            "30.5\u202f°C adds −57.5\u202fµm",
            "sensor silent for 1 h 6 min: going with the next target",
            "warning",
        ),
        (
            thermal("faded", age_s=3999.0, correction=0.0),
            "30.5\u202f°C adds 0.0\u202fµm",
            "sensor silent for 1 h 6 min: gone",
            "warning",
        ),
    ],
)
def test_a_sensor_that_is_not_heard_is_said_in_words(
    visit: Visit, term: dict[str, Any], added: str, words: str, tone: str
) -> None:
    show(visit, thermal=term)
    visit.until(ROWS, [["Temperature", added, words]])
    assert visit.page.evaluate(TONES) == [tone]
    show(visit, thermal=thermal())
    visit.until(ROWS, [["Temperature", "30.5\u202f°C adds −57.5\u202fµm"]])


@pytest.mark.parametrize(
    ("state", "correction", "words", "tone"),
    [
        ("waiting", None, "place not known yet", "note"),
        ("held", 0.04, "place not known: held", "note"),
        ("fading", 0.04, "place not known: fading", "warning"),
        ("faded", 0.04, "place not known: going with the next target", "warning"),
        ("faded", 0.0, "place not known: gone", "warning"),
    ],
)
def test_another_axis_that_nobody_knows_is_said_in_words(
    visit: Visit, state: str, correction: float | None, words: str, tone: str
) -> None:
    show(visit, cross=cross(state, correction=correction))
    added = "–" if correction is None else f"adds {'+40.0' if correction else '0.0'}\u202fµm"
    visit.until(ROWS, [["Axis y", added, words]])
    assert visit.page.evaluate(TONES) == [tone]


def test_terms_that_do_not_follow_say_so(visit: Visit) -> None:
    show(visit, is_too_large=True, cross=cross())
    visit.until(
        ROWS, [["Axis y", "adds +40.0\u202fµm"], ["Limit", "reached", "at max_correction: not followed"]]
    )
    show(visit, cross=cross())
    visit.until(ROWS, [["Axis y", "adds +40.0\u202fµm"]])


@pytest.mark.parametrize("terms", [{}, {"terms": None}])
def test_an_axis_without_terms_has_no_line_for_them(visit: Visit, terms: dict[str, Any]) -> None:
    visit.stage.show(model({"x": axis(nominal_setpoint=-60.0, **terms)}))
    visit.until_text("article.axis .facts > div:nth-child(3) dd", "−60.000\u202fmm")
    assert visit.page.locator(".term").count() == 0
    assert visit.page.locator("article.axis .facts > div").count() == 5


def test_lines_go_when_an_axis_has_no_terms_any_more(visit: Visit) -> None:
    show(visit, thermal=thermal(), cross=cross())
    visit.until(f"{ROWS}.length", 2)
    visit.stage.show(model())
    visit.until(ROWS, [])


def in_doubt() -> dict[str, Any]:
    """Return axes with every line that there can be."""
    lost = {"correction": 0.0, "is_too_large": True, "thermal": thermal("faded", age_s=4000.0)}
    held = {"correction": 0.0, "is_too_large": False, "thermal": thermal("waiting", correction=0.0)}
    return {
        "x": axis(terms={**lost, "cross": cross("fading", axes=["y", "z"])}),
        "y": axis(terms={**held, "cross": cross("held")}),
        "z": axis(terms={**held, "thermal": thermal(celsius=-10.25, correction=-1.2345)}),
    }


@pytest.mark.parametrize(
    "visit",
    [
        {"viewport": {"width": width, "height": 844}, "color_scheme": scheme}
        for width in (360, 390, 1280)
        for scheme in ("light", "dark")
    ],
    indirect=True,
    ids=lambda options: f"{options['viewport']['width']}-{options['color_scheme']}",
)
def test_the_lines_fit_and_stand_out_on_phones_and_screens(visit: Visit) -> None:
    visit.stage.tables |= dict.fromkeys("yz", curve())
    visit.stage.show(model(in_doubt()))
    visit.until(f"{ROWS}.length", 6)
    visit.until("document.querySelectorAll('article.axis[data-curve=yes]').length", 3)
    assert visit.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    cut = """[...document.querySelectorAll(".term:not([hidden]), .term:not([hidden]) > :not([hidden])")]
      .filter((one) => one.scrollWidth > one.clientWidth + 1).map((one) => one.textContent)"""
    assert visit.page.evaluate(cut) == []
    visit.page.emulate_media(reduced_motion="reduce")
    assert [found for found in visit.page.evaluate(CONTRASTS) if found[0] < 4.5] == []  # WCAG 2.2, 1.4.3


@pytest.mark.parametrize("visit", [{"viewport": {"width": 390, "height": 844}}], indirect=True)
def test_a_line_is_one_line_on_a_phone(visit: Visit) -> None:
    show(visit, thermal=thermal(), cross=cross())
    visit.until(f"{ROWS}.length", 2)
    heights = visit.page.evaluate(
        """[...document.querySelectorAll(".term:not([hidden])")].map((row) =>
          row.getBoundingClientRect().height / parseFloat(getComputedStyle(row).fontSize))"""
    )
    assert max(heights) < 2  # of letters: two lines are more


def test_a_screen_reader_hears_name_and_words_and_nothing_by_itself(visit: Visit) -> None:
    show(visit, thermal=thermal("held", age_s=125.0), cross=cross())
    visit.until(f"{ROWS}.length", 2)
    for role in ("term", "definition"):
        names = visit.page.locator("article.axis .facts").get_by_role(role).all_text_contents()
        assert len([name for name in names if name]) == {"term": 5, "definition": 6}[role], names
    assert visit.page.locator(".term svg:not([aria-hidden=true])").count() == 0
    assert visit.page.locator("[aria-live], [role=alert], [role=status], [role=log]").count() == 2
    assert visit.page.get_by_role("alert").text_content() == ""


def test_what_stays_the_same_is_not_touched(visit: Visit) -> None:
    show(visit, thermal=thermal("held", age_s=125.2), cross=cross())
    visit.until(f"{ROWS}.length", 2)
    visit.page.evaluate(
        """() => {
          window.touched = 0;
          const rows = document.querySelector("article.axis .facts");
          new MutationObserver((seen) => { window.touched += seen.length; })
            .observe(rows, { subtree: true, childList: true, attributes: true, characterData: true });
        }"""
    )
    show(visit, thermal=thermal("held", age_s=125.4), cross=cross())
    visit.stage.publish_event(
        {"number": 1, "time": "2026-05-01T12:00:00Z", "event": "term-held", "severity": "warning"}
    )
    visit.until("document.querySelectorAll('#events li').length", 1)
    assert visit.page.evaluate("window.touched") == 0
    show(visit, thermal=thermal("held", age_s=126.0), cross=cross())
    visit.until("document.querySelector('.term-state').textContent", "sensor silent for 2 min 6 s: held")
    assert visit.page.evaluate("window.touched") == 1
