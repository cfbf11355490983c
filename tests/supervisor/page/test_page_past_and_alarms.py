"""The past of an axis, values at the pointer, and alarms that are acknowledged and heard."""

from http import HTTPStatus

import pytest

from tests.supervisor.page.models import axis, curve, model, trouble
from tests.supervisor.page.visit import Visit

LATER = "2026-05-01T13:00:00+00:00"
COUNT_TONES = """() => {
  window.tones = 0;
  const make = AudioContext.prototype.createOscillator;
  AudioContext.prototype.createOscillator = function () {
    window.tones += 1;
    return make.call(this);
  };
}"""


def curve_of(visit: Visit) -> dict[str, float]:
    visit.page.wait_for_selector("article.axis .line-forward")
    box = visit.page.locator("article.axis .line-forward").bounding_box()
    assert box is not None
    return {"x": box["x"], "y": box["y"], "width": box["width"]}


def test_the_pointer_reads_the_curve(visit: Visit) -> None:
    line = curve_of(visit)
    # 31 points from -300 to 0 mm: at two thirds of the line stands -100, forward 10 um, backward 25 above it
    visit.page.mouse.move(line["x"] + line["width"] * 2 / 3, line["y"] + 5)
    visit.until_text(
        ".curve .pointer-words", "−100.000\u202fmm: forward +10.0\u202fµm, backward +35.0\u202fµm"
    )
    assert visit.page.locator(".reading-mark").get_attribute("visibility") == "visible"
    visit.page.mouse.move(0, 0)
    visit.until("document.querySelector('.curve .pointer-words').hidden", True)
    assert visit.page.locator(".reading-mark").get_attribute("visibility") == "hidden"


def test_the_arrow_keys_read_it_too_and_a_screen_reader_hears_the_values(visit: Visit) -> None:
    curve_of(visit)
    slider = visit.find("slider", "Correction of axis x at a position")
    slider.focus()
    first = "−300.000\u202fmm: forward +30.0\u202fµm, backward +55.0\u202fµm"
    for key, words in (
        ("Home", first),
        ("ArrowRight", "−290.000\u202fmm: forward +29.0\u202fµm, backward +54.0\u202fµm"),
        ("End", "0.000\u202fmm: forward 0.0\u202fµm, backward +25.0\u202fµm"),
        ("ArrowRight", "0.000\u202fmm: forward 0.0\u202fµm, backward +25.0\u202fµm"),
        ("Home", first),
    ):
        visit.page.keyboard.press(key)
        visit.until("document.querySelector('.curve .pointer-slider').getAttribute('aria-valuetext')", words)
        visit.until_text(".curve .pointer-words", words)
    visit.page.keyboard.press("Escape")
    visit.until("document.querySelector('.curve .pointer-words').hidden", True)


def test_the_past_is_read_with_pointer_and_keys(visit: Visit) -> None:
    ages = [float(age) for age in range(599, 0, -1)]
    visit.stage.past["y"] = {"ages_s": ages, "nominal": [-age for age in ages], "correction": [0.01] * 599}
    visit.stage.tables["y"] = curve()
    visit.stage.show(model({"y": axis(nominal_actual=-1.0)}))
    visit.page.wait_for_selector("article.axis .history-position[d]")
    box = visit.page.locator("article.axis .history").bounding_box()
    assert box is not None
    visit.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 5)
    said = "document.querySelector('.past .pointer-words').textContent"
    visit.until(f"/^.*: −(29[0-9]|30[0-9])\\.000.mm, correction \\+10\\.0.µm$/.test({said})", True)
    visit.find("slider", "Axis y at a time").focus()
    visit.page.keyboard.press("Home")
    visit.until(f"/: −59[0-9]\\.000.mm, correction/.test({said})", True)


@pytest.mark.parametrize(("chosen", "minutes"), [("1 hour", 60), ("8 hours", 480), ("1 day", 1440)])
def test_the_span_of_the_past_is_chosen_and_so_is_the_file(visit: Visit, chosen: str, minutes: int) -> None:
    visit.page.wait_for_selector("article.axis .past-span")
    with visit.page.expect_response(lambda each: each.url.endswith(f"?minutes={minutes}")):
        visit.page.locator(".past-span").select_option(label=chosen)
    visit.until("document.querySelector('.history title').textContent", f"Last {chosen} of axis x")
    file = visit.page.locator(".past-file")
    assert file.get_attribute("href") == f"history/x.csv?minutes={minutes}"
    assert file.get_attribute("aria-label") == f"Axis x, last {chosen}, as CSV file"
    assert visit.stage.spans[-1] == f"minutes={minutes}"


def test_a_gap_in_what_was_kept_is_a_gap_in_the_line(visit: Visit) -> None:
    ages = [400.0, 390.0, 300.0, 290.0]
    visit.stage.past["y"] = {"ages_s": ages, "nominal": [1.0, 2.0, 3.0, 4.0], "correction": [0.0] * 4}
    visit.stage.tables["y"] = curve()
    visit.stage.show(model({"y": axis(nominal_actual=None)}))
    path = "document.querySelector('.history-position')?.getAttribute('d')"
    visit.until(f"({path} || '').replace(/[^ML]/g, '')", "MLML")


def test_whoever_may_not_acknowledge_sees_no_button(visit: Visit) -> None:
    visit.stage.show(model(None, None, trouble()))
    visit.until("document.querySelectorAll('#troubles li').length", 1)
    assert visit.page.locator("#troubles button").is_hidden()


def test_an_alarm_is_acknowledged_and_stays_listed_with_who_and_when(visit: Visit) -> None:
    visit.stage.may_acknowledge = True
    visit.page.reload()
    visit.stage.show(model(None, None, trouble(), trouble(kind="blocked", where="axis y", what="lost")))
    visit.until("document.querySelectorAll('#troubles li').length", 2)
    button = visit.page.locator("#troubles li").nth(0).get_by_role("button")
    assert (button.get_attribute("aria-label") or "").startswith("Acknowledge: axis x, cnc10x.tab:12:3")
    button.focus()
    with visit.page.expect_response("**/acknowledge"):
        visit.page.keyboard.press("Enter")
    alarm = {"kind": "table-rejected", "where": "axis x", "since": "2026-05-01T12:00:00+00:00"}
    assert visit.stage.acknowledged == [("/acknowledge", "application/json", alarm)]
    seen = {**trouble(), "acknowledged": {"by": "shift", "at": "2026-05-01T12:03:04+00:00"}}
    visit.stage.show(model(None, None, seen, trouble(kind="blocked", where="axis y", what="lost")))
    visit.until("document.querySelector('#troubles li').classList.contains('acknowledged')", True)
    words = visit.page.locator("#troubles .seen").first.text_content() or ""
    assert words.startswith("acknowledged by shift, 2026-05-01 ")
    assert visit.page.locator("#troubles li").nth(0).get_by_role("button").count() == 0
    assert visit.page.locator("#troubles li").nth(1).get_by_role("button").count() == 1
    visit.until("document.activeElement.id", "banner")


def test_an_alarm_that_is_another_one_by_now_is_told(visit: Visit) -> None:
    visit.stage.may_acknowledge, visit.stage.refusal = True, HTTPStatus.NOT_FOUND
    visit.page.reload()
    visit.stage.show(model(None, None, trouble()))
    visit.page.locator("#troubles button").click()
    visit.until_text("#troubles .problem", "This alarm has just changed. Look again.")
    visit.complaints.clear()


def test_a_new_alarm_is_heard_once_it_was_asked_for_and_an_acknowledged_one_never(visit: Visit) -> None:
    visit.page.evaluate(COUNT_TONES)
    visit.stage.show(model(None, None, trouble()))
    visit.until("document.querySelectorAll('#troubles li').length", 1)
    assert visit.page.evaluate("window.tones") == 0  # off by itself
    visit.find("button", "Sound: off").click()
    visit.find("button", "Sound: on").wait_for()
    visit.until("window.tones", 2)  # so sounds it
    warning = trouble(kind="unreferenced", severity="warning", where="axis y")
    visit.stage.show(model(None, None, trouble(), warning))
    visit.until("window.tones", 4)
    seen = {**trouble(since=LATER), "acknowledged": {"by": "shift", "at": LATER}}
    visit.stage.show(model(None, None, seen, warning))
    visit.until("document.querySelectorAll('#troubles .acknowledged').length", 1)
    assert visit.page.evaluate("window.tones") == 4
    visit.stage.show(model(None, None, trouble(since="2026-05-01T14:00:00+00:00"), warning))
    visit.until("window.tones", 10)  # an error sounds three times
    visit.find("button", "Sound: on").click()
    visit.stage.show(model(None, None, trouble(since="2026-05-01T15:00:00+00:00"), warning))
    visit.until("document.querySelectorAll('#troubles .acknowledged').length", 0)
    assert visit.page.evaluate("window.tones") == 10


def test_the_choice_of_the_sound_is_remembered(visit: Visit) -> None:
    visit.find("button", "Sound: off").click()
    visit.find("button", "Sound: on").wait_for()
    visit.page.reload()
    visit.page.wait_for_selector("#sound[aria-pressed=true]")
