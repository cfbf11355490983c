"""The page over time: a gateway that goes away, events that come, names that mean harm."""

from datetime import UTC, datetime, timedelta

import pytest

from gateway.supervisor import page
from tests.supervisor.page.models import axis, line, model, table, trouble
from tests.supervisor.page.stage import FOLDER
from tests.supervisor.page.visit import Visit

HARM = '<img src=x onerror="window.harmed=1"><script>window.harmed=1</script>\'"&amp;'


def happening(number: int, severity: str = "info", **changes: object) -> dict[str, object]:
    """An event of the first of May at noon and so many seconds."""
    time = datetime(2026, 5, 1, 12, tzinfo=UTC) + timedelta(seconds=number)
    base = {"number": number, "time": time.isoformat(), "event": "late-reply", "severity": severity}
    return {**base, "line": "xyz", "detail": f"number {number}", **changes}


def test_it_says_that_the_gateway_is_gone_and_goes_on_when_it_is_back(visit: Visit) -> None:
    visit.until_text("#link", "Live")
    visit.stage.close()
    visit.until_text("#link", "No connection")
    assert visit.page.locator("#lost").is_visible()
    assert visit.page.locator("#verdict").is_hidden()
    assert visit.page.get_by_role("alert").text_content() == "The gateway does not answer."
    assert visit.page.title() == "⚠ mill-1: no connection"
    visit.until("getComputedStyle(document.querySelector('main')).filter", "grayscale(1)")
    visit.until("/What is shown is [1-9] s old/.test(document.getElementById('lost').textContent)", True)
    icon = "document.getElementById('favicon').href.replace(/,.*/, '')"
    visit.until(icon, "data:image/svg+xml")  # the gateway cannot send one now

    visit.stage.show(model({"x": axis(nominal_actual=-44.0)}))
    visit.stage.open()
    visit.until_text("article.axis .digits", "−44.000")
    visit.until_text("#link", "Live")
    assert visit.page.locator("#lost").is_hidden()
    assert visit.page.locator("#verdict").is_visible()
    assert visit.page.get_by_role("alert").text_content() == ""
    assert all("ERR_" in said for said in visit.complaints)  # the browser's own, of the dead connection
    visit.complaints.clear()


def test_a_stream_that_stays_open_and_says_nothing_is_a_gateway_that_is_gone(visit: Visit) -> None:
    visit.until_text("#link", "Live")
    visit.stage.is_mute = True
    visit.until_text("#link", "No connection")
    visit.stage.is_mute = False
    visit.stage.show(model())
    visit.until_text("#link", "Live")


def test_a_tab_that_nobody_sees_draws_nothing_and_still_tells_of_trouble(visit: Visit) -> None:
    visit.until_text("article.axis .digits", "−120.000")
    hide = """isHidden => {
      Object.defineProperty(document, "hidden", { configurable: true, get: () => isHidden });
      document.dispatchEvent(new Event("visibilitychange"));
    }"""
    visit.page.evaluate(hide, True)
    visit.stage.show(model({"x": axis(nominal_actual=-44.0)}, None, trouble()))
    visit.until("document.title", "⚠ mill-1: error")
    assert visit.page.locator("article.axis .digits").text_content() == "−120.000"
    assert visit.page.locator("#troubles > li").count() == 0
    visit.page.evaluate(hide, False)
    visit.until_text("article.axis .digits", "−44.000")
    visit.until("document.querySelectorAll('#troubles > li').length", 1)


def test_where_no_stream_is_to_be_had_the_status_is_asked_for(visit: Visit) -> None:
    visit.until_text("article.axis .digits", "−120.000")
    visit.stage.is_full = True
    visit.page.reload()
    visit.until_text("article.axis .digits", "−120.000")
    visit.stage.show(model({"x": axis(nominal_actual=-44.0)}))
    visit.until_text("article.axis .digits", "−44.000")
    assert visit.page.locator("#link").text_content() == "Live"
    assert "/status" in visit.stage.asked
    visit.stage.is_full = False
    visit.stage.publish_event(happening(1))
    visit.until_text("#events li:first-child .words", "number 1")
    assert all("503" in said for said in visit.complaints)
    visit.complaints.clear()


def test_what_the_gateway_says_is_text_and_nothing_else(visit: Visit) -> None:
    problem = {"file": HARM, "line": 1, "column": 1, "key": HARM, "found": HARM, "remedy": HARM}
    bad = table(file=HARM, status="rejected", error=HARM, problems=[problem])
    harmful = model({HARM: axis(table=bad, compensation=HARM, direction=HARM, units=HARM)})
    drives = {"address": HARM, "failure": HARM}
    harmful["lines"] = {HARM: line(drives=drives)}
    harmful["lines"][HARM]["controllers"][0] |= {"name": HARM, "role": HARM, "address": HARM, "failure": HARM}
    harmful["gateway"] |= {"name": HARM, "version": HARM}
    harmful["troubles"] = [trouble(kind=HARM, severity=HARM, where=HARM, what=HARM, remedy=HARM)]
    visit.stage.tables[HARM] = visit.stage.tables["x"]
    visit.stage.show(harmful)
    visit.stage.publish_event(
        happening(1, event=HARM, severity=HARM, axis=HARM, detail=HARM, more=HARM, problems=[HARM])
    )
    for place in (
        "#name",
        "article.axis h3 span:last-child",
        "article.axis .file",
        "article.axis .state span:not(.since)",
        "article.line h3 span:last-child",
        ".controllers strong",
        "#troubles .what",
    ):
        visit.until_text(place, HARM)
    visit.until("document.querySelector('#events .words').textContent.includes('<img src=x')", True)
    assert visit.page.locator("img, body script").count() == 0
    assert visit.page.evaluate("window.harmed") is None


def test_events_come_newest_first_and_two_hundred_are_kept(visit: Visit) -> None:
    for number in range(1, 151):
        visit.stage.publish_event(happening(number))
    visit.until("document.querySelectorAll('#events li').length", 150)
    for number in range(151, 251):
        visit.stage.publish_event(happening(number))
    visit.until_text("#events li:first-child .words", "number 250")
    visit.until("document.querySelectorAll('#events li').length", 200)
    visit.until_text("#events li:last-child .words", "number 51")
    visit.until_text("#events li:first-child strong", "Late reply")
    visit.until_text("#events li:first-child .where", "Line xyz")


def test_a_list_in_an_event_is_shown_as_words(visit: Visit) -> None:
    visit.stage.publish_event(happening(1, keys=["mqtt.host", "axis.x.gain"]))
    visit.until_text("#events li:first-child .words", "number 1; keys: mqtt.host, axis.x.gain")


def test_events_are_told_once_though_the_gateway_tells_them_again(visit: Visit) -> None:
    for number in (1, 2, 3):
        visit.stage.publish_event(happening(number))
    visit.until("document.querySelectorAll('#events li').length", 3)
    visit.stage.close()
    visit.until_text("#link", "No connection")
    visit.stage.publish_event(happening(4))
    visit.stage.open()
    visit.until_text("#events li:first-child .words", "number 4")
    assert visit.page.locator("#events .words").all_text_contents() == [
        "number 4",
        "number 3",
        "number 2",
        "number 1",
    ]
    visit.complaints.clear()


def test_events_are_picked_by_how_bad_they_are(visit: Visit) -> None:
    for number, severity in enumerate(("info", "warning", "error", "info"), start=1):
        visit.stage.publish_event(happening(number, severity))
    visit.until("document.querySelectorAll('#events li').length", 4)
    shown = "[...document.querySelectorAll('#events li:not([hidden]) .words')].map((one) => one.textContent)"
    visit.find("radio", "Warnings").check(force=True)
    visit.until(shown, ["number 3", "number 2"])
    visit.find("radio", "Errors").check(force=True)
    visit.until(shown, ["number 3"])
    visit.stage.publish_event(happening(5, "info"))
    visit.stage.publish_event(happening(6, "error"))
    visit.until(shown, ["number 6", "number 3"])
    visit.find("radio", "All").check(force=True)
    visit.until(shown, [f"number {number}" for number in (6, 5, 4, 3, 2, 1)])


def test_whoever_reads_further_down_stays_there_when_events_come(visit: Visit) -> None:
    for number in range(1, 101):
        visit.stage.publish_event(happening(number))
    visit.until("document.querySelectorAll('#events li').length", 100)
    top = "Math.round(document.querySelector('#events li:nth-last-child(40)').getBoundingClientRect().top)"
    visit.page.evaluate("document.getElementById('events-frame').scrollTop = 2000")
    before = visit.page.evaluate(top)
    for number in range(101, 111):
        visit.stage.publish_event(happening(number))
    visit.until("document.querySelectorAll('#events li').length", 110)
    # Rows are no whole pixels high.
    assert visit.page.evaluate(top) == pytest.approx(before, abs=1)


def test_the_list_of_files_is_what_stands_in_the_folder() -> None:
    there = {path.name for path in FOLDER.iterdir() if path.suffix not in {".py", ""}}
    assert there == set(page.FILES)
    assert len(page.FILES) == len(set(page.FILES))


def test_no_file_names_an_address_outside_or_makes_elements_of_text() -> None:
    for name in page.FILES:
        text = (FOLDER / name).read_text()
        if name == "dom.js":  # the icon of the tab
            text = text.replace("data:image/svg+xml,", "", 1)
        for address in ("http://", "https://", "//cdn", "@import", "data:"):
            assert address not in text.replace("http://www.w3.org/2000/svg", ""), (name, address)
        for way in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "Function("):
            assert way not in text, (name, way)
        assert name.endswith(".html") is False or ("style=" not in text and "onclick" not in text)
        assert len(text.splitlines()) <= 400, name
