"""What the page shows of a model, as a person sees it."""

import re

import pytest

from tests.supervisor.page.models import axis, curve, line, model, table, trouble, verdict
from tests.supervisor.page.visit import Visit

STATE = "article.axis .state span:not(.since)"
COLOUR_OF_DIGITS = "getComputedStyle(document.querySelector('article.axis .digits')).color"
COLOUR_OF_ICON = """async () => {
  const image = new Image();
  image.src = document.getElementById("favicon").href;
  await image.decode();
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 32;
  const room = canvas.getContext("2d");
  room.drawImage(image, 0, 0, 32, 32);
  const { data } = room.getImageData(0, 0, 32, 32);
  const counts = new Map();
  for (let at = 0; at < data.length; at += 4) {
    const colour = data.slice(at, at + 3).join();
    counts.set(colour, (counts.get(colour) ?? 0) + (data[at + 3] === 255 ? 1 : 0));
  }
  return [...counts].sort((one, other) => other[1] - one[1])[0][0].split(",").map(Number);
}"""
"""Red, green and blue of most of its pixels."""
DIGITS = "article.axis .digits"
CORRECTION = "article.axis .facts dd"
MOVES = "article.axis .mark"


def standing_at(position: float, **changes: object) -> dict[str, object]:
    """An axis at a position, forward: corrected as :func:`curve` has it."""
    corrected = position - 0.0001 * position
    return axis(nominal_actual=position, corrected_actual=corrected, **changes)


def test_it_shows_where_the_axis_is_and_what_is_added(visit: Visit) -> None:
    visit.until_text(DIGITS, "−120.000")
    visit.until_text("article.axis .units", "mm")
    visit.until_text(CORRECTION, "+22.1\u202fµm")
    facts = visit.page.locator("article.axis .facts > div:not([hidden])").all_text_contents()
    assert facts == ["Correction+22.1\u202fµm", "On the drive−119.978\u202fmm", "Target−120.000\u202fmm"]
    visit.until_text(STATE, "Compensated")
    assert visit.page.locator("article.axis .direction").text_content() == "forward"


@pytest.mark.parametrize("is_read", [True, False])
def test_in_shadow_mode_it_shows_what_would_be_added_and_where_the_drive_really_is(
    visit: Visit, is_read: bool
) -> None:
    read = {"nominal_actual": -60.0, "corrected_actual": -60.0}  # shadow: positions pass as they are
    unread = {"nominal_actual": None, "corrected_actual": None}
    changes = read if is_read else unread
    shadow = axis(
        compensation="shadow", nominal_setpoint=-60.0, corrected_setpoint=-59.985, correction=0.015, **changes
    )
    visit.stage.show(model({"x": shadow}))
    visit.until_text(DIGITS, "−60.000")
    visit.until_text(CORRECTION, "+15.0\u202fµm")
    facts = visit.page.locator("article.axis .facts > div:not([hidden])").all_text_contents()
    assert facts[1] == "On the drive−60.000\u202fmm"


def test_the_machine_moves_on_its_curve(visit: Visit) -> None:
    for position in (-75.0, -225.0, -300.0):
        visit.stage.show(model({"x": standing_at(position)}))
        visit.until_text(DIGITS, f"−{-position:.3f}")
        share = round((position + 300.0) / 300.0, 2)
        visit.until_along(share)
        _, down, name = visit.place()
        assert down == pytest.approx(share, abs=0.02)  # the line falls from its top left to its bottom right
        assert name == "mark"


def test_the_machine_on_its_curve_never_stands_elsewhere_than_the_number(visit: Visit) -> None:
    visit.until_along(0.6)
    visit.page.evaluate(
        """() => {
          window.found = [];
          const digits = document.querySelector("article.axis .digits");
          const along = () => Math.round(((svg, line, x) => (x - line.x) / line.width * 100)(
            0, document.querySelector(".line-forward").getBBox(),
            document.querySelector("article.axis .mark").transform.baseVal[0].matrix.e)) / 100;
          new MutationObserver(() => window.found.push([digits.textContent, along()]))
            .observe(digits, { childList: true, characterData: true, subtree: true });
        }"""
    )
    for position in (-30.0, -270.0):
        visit.stage.show(model({"x": standing_at(position)}))
        visit.until_text(DIGITS, f"−{-position:.3f}")
    assert visit.page.evaluate("window.found") == [["−30.000", 0.9], ["−270.000", 0.1]]


DRIVE_SILENT = verdict("error", "drive-silent", "Drive silent")


def test_an_axis_whose_drive_is_silent_is_not_green_and_shows_where_it_was_seen(visit: Visit) -> None:
    last = {"of": "last-reading", "nominal": -44.0, "corrected": -43.9, "age_s": 75.3, "is_at_least": False}
    lost = {"nominal_actual": None, "corrected_actual": None, "verdict": DRIVE_SILENT, "position": last}
    visit.stage.show(model({"x": axis(**lost)}))
    visit.until_text(STATE, "Drive silent")
    visit.until_text(DIGITS, "−44.000")
    visit.until_text("article.axis .reading-name", "Last seen 1 min 15 s ago")
    visit.until_text(CORRECTION, "+100.0\u202fµm")
    card = visit.page.locator("article.axis")
    assert (card.get_attribute("data-tone"), card.get_attribute("data-known")) == ("error", "no")
    quiet = "getComputedStyle(document.querySelector('.quiet')).color"
    assert visit.page.evaluate(f"getComputedStyle(document.querySelector({DIGITS!r})).color === {quiet}")
    visit.stage.show(model({"x": axis()}))
    visit.until_text(STATE, "Compensated")
    visit.until_text("article.axis .reading-name", "Position")


@pytest.mark.parametrize(
    ("found", "words", "shown"),
    [
        (verdict(), "Compensated", "state well"),
        (verdict("healthy", "blending"), "Compensated", "state well"),
        (verdict("waiting", "controller-awaited", "Waiting for the controller"), None, "state note"),
        (verdict("warning", "controller-absent", "No controller"), None, "state warning"),
        (verdict("warning", "configuration"), "Compensated", "state warning"),
        (verdict("error", "table-rejected", "Table rejected"), None, "state error"),
    ],
)
def test_an_axis_has_the_colour_and_the_words_of_its_verdict(
    visit: Visit, found: dict[str, str], words: str | None, shown: str
) -> None:
    visit.stage.show(model({"x": axis(verdict=found)}))
    visit.until("document.querySelector('article.axis .state')?.className", shown)
    visit.until_text(STATE, words or found["title"])
    tone = shown.removeprefix("state ")
    assert visit.page.locator("article.axis").get_attribute("data-tone") == tone
    since = visit.page.locator("article.axis .state .since").text_content() or ""
    assert since.startswith("since 2026-05-0")


@pytest.mark.parametrize(
    ("position", "name"),
    [
        ({"of": "target", "age_s": 40.2}, "Target of 40 s ago (position not read)"),
        (
            {"of": "target", "age_s": 61.0, "is_at_least": True},
            "Target of more than 1 min 1 s ago (position not read)",
        ),
        ({"of": "last-reading", "age_s": 40.2}, "Last seen 40 s ago"),
        ({"of": None, "nominal": None, "corrected": None, "age_s": None}, "Position not known"),
    ],
)
def test_digits_that_are_no_reading_are_grey_and_say_how_old_they_are(
    visit: Visit, position: dict[str, object], name: str
) -> None:
    black = visit.page.evaluate(COLOUR_OF_DIGITS)
    old = {"nominal": -44.0, "corrected": -43.9, "is_at_least": False, **position}
    unread = {"nominal_actual": None, "corrected_actual": None}
    visit.stage.show(model({"x": axis(position=old, **unread)}))
    visit.until_text("article.axis .reading-name", name)
    quiet = visit.page.evaluate("getComputedStyle(document.querySelector('.quiet')).color")
    assert visit.page.evaluate(COLOUR_OF_DIGITS) == quiet != black
    visit.until_text(DIGITS, "–" if old["nominal"] is None else "−44.000")


def test_a_line_that_no_controller_asks_is_not_green_and_says_how_long_ago_one_did(visit: Visit) -> None:
    gone = line()
    gone["controllers"][0] |= {"asked_s": 40.0, "silent_s": 40.2}
    gone["controllers"][1] |= {"connections": [], "asked_s": None, "silent_s": 3600.0}
    missed = trouble(kind="controller-silent", severity="warning", where="line xyz")
    visit.stage.show(model(None, {"xyz": gone}, missed))
    states = "[...document.querySelectorAll('.controller-state')].map((one) => one.textContent)"
    visit.until(states, ["port open, asked last 40 s ago", "not connected, has not asked yet"])
    signs = "[...document.querySelectorAll('.controllers .sign')].map((one) => one.getAttribute('class'))"
    visit.until(signs, ["sign warning", "sign note"])
    visit.until_text("article.line .state", "Drives up")
    assert visit.page.locator("article.line").get_attribute("data-tone") == "warning"


def test_a_line_says_how_many_of_its_drives_are_silent(visit: Visit) -> None:
    answers = {"silent_s": None, "answered_s": 0.1}
    drives = {"1": answers, "2": {"silent_s": 3.0, "answered_s": None}, "17": {"silent_s": 9.0}}
    unit_ids = {"axes": {"x": 1, "y": 2}, "drives": drives}  # 17 has no axis
    visit.stage.show(model(None, {"xyz": line(unit_ids=unit_ids)}))
    visit.until_text("article.line .state", "1 of 2 drives silent")
    drives["2"] = answers
    visit.stage.show(model(None, {"xyz": line(unit_ids=unit_ids)}))
    visit.until_text("article.line .state", "Up")


@pytest.mark.parametrize(
    ("severities", "word", "about", "title"),
    [
        ([], "Healthy", "1 line, 1 axis", "mill-1: healthy"),
        (["warning"], "Warning", "1 warning", "⚠ mill-1: warning"),
        (["error", "warning", "warning"], "Error", "1 error, 2 warnings", "⚠ mill-1: error"),
    ],
)
def test_one_word_says_how_the_gateway_is_with_since_when_and_the_title_says_the_same(
    visit: Visit, severities: list[str], word: str, about: str, title: str
) -> None:
    troubles = [trouble(severity=each, where=f"axis a{n}") for n, each in enumerate(severities)]
    visit.stage.show(model(None, None, *troubles))
    visit.until_text("#verdict strong", word)
    visit.until("document.title", title)
    words = visit.page.locator("#verdict .about").text_content() or ""
    assert re.fullmatch(rf"since 2026-05-0[12] [0-9:]{{8}} · {about}", words)
    assert visit.page.locator("#troubles > li").count() == len(troubles)
    size = "parseFloat(getComputedStyle(document.querySelector('#verdict strong')).fontSize)"
    assert visit.page.evaluate(size) >= 30


def test_the_icon_of_the_tab_is_a_picture_of_the_verdict_that_no_file_is_needed_for(visit: Visit) -> None:
    icons = {}
    for state in ("healthy", "waiting", "warning", "error"):
        shown = model()
        shown["verdict"]["state"] = state
        visit.stage.show(shown)
        visit.until(f"document.title.endsWith(': {state}')", True)
        icons[visit.page.evaluate("document.getElementById('favicon').href")] = state
        red, green, blue = visit.page.evaluate(COLOUR_OF_ICON)
        assert state == {
            green > 1.5 * max(red, blue): "healthy",
            max(red, green, blue) < 1.5 * min(red, green, blue): "waiting",  # grey
            min(red, green) > 1.5 * blue: "warning",  # amber
            red > 1.5 * max(green, blue): "error",
        }.get(True)
    assert list(icons.values()) == ["healthy", "waiting", "warning", "error"]
    assert all(icon.startswith("data:image/svg+xml,") for icon in icons)


def test_while_nobody_has_asked_the_gateway_waits_and_is_not_green(visit: Visit) -> None:
    waiting = model()
    waiting["verdict"]["state"] = "waiting"
    visit.stage.show(waiting)
    visit.until_text("#verdict strong", "Waiting")
    assert visit.page.locator("#verdict").get_attribute("class") == "verdict note"
    visit.until("document.title", "mill-1: waiting")


def test_a_trouble_says_since_when_it_is_there(visit: Visit) -> None:
    visit.stage.show(model(None, None, trouble(since="2026-05-01T12:00:00+00:00")))
    since = "/^since 2026-05-0[12] [0-9:]{8}$/.test(document.querySelector('#troubles .since')?.textContent)"
    visit.until(since, True)


def test_ten_minutes_of_position_and_correction_are_drawn(visit: Visit) -> None:
    visit.stage.past["y"] = {
        "ages_s": [600.5, 300.0, 200.0, 100.0],
        "nominal": [9.0, -120.0, None, -60.0],
        "correction": [0.5, 0.010, None, 0.020],
    }
    visit.stage.tables["y"] = curve()
    visit.stage.show(model({"y": standing_at(-120.0)}))
    # The whole width is 600 s: 300 s ago is its middle, and nothing is drawn where nothing was known.
    path_of = "document.querySelector('.history-position')?.getAttribute('d')"
    visit.until(f"/M.*M/.test({path_of})", True)
    path = visit.page.locator(".history-position").get_attribute("d") or ""
    (first, low), (second, high) = (part.split(" ") for part in path[1:].split("L")[0].split("M")[:2])
    assert (float(low), float(high)) == (55.0, 5.0)
    assert float(second) - float(first) == pytest.approx(200.0, abs=0.15)
    assert 300.0 - 60.0 < float(first) <= 300.0  # a busy machine draws late
    words = visit.page.locator("article.axis .history desc").text_content()
    assert words == "Position from −120.000 to −60.000 mm, correction from +10.0 to +20.0 µm."


def test_travel_outside_the_table_is_hatched_and_the_machine_stays_at_the_edge(visit: Visit) -> None:
    changed = table(compiled="17" * 32)
    visit.stage.tables["x"] = curve(travel=[-350.0, 50.0])
    outside = standing_at(70.0, compensation="outside", table=changed)
    visit.stage.show(model({"x": outside}))
    visit.until("document.querySelectorAll('article.axis .outside').length", 2)
    widths = visit.page.evaluate(
        "[...document.querySelectorAll('article.axis .outside')].map((one) => one.width.baseVal.value)"
    )
    line_width = visit.page.evaluate("document.querySelector('article.axis .line-forward').getBBox().width")
    assert widths == pytest.approx([line_width / 6, line_width / 6], abs=0.3)
    visit.until("document.querySelector('article.axis .mark').getAttribute('class')", "mark beyond")
    visit.until_text(STATE, "Outside the table")


def test_a_turning_axis_comes_round(visit: Visit) -> None:
    visit.stage.tables["x"] = curve(modulo=300.0)
    changed = table(compiled="17" * 32)
    visit.stage.show(model({"x": standing_at(-1050.0, table=changed)}))
    # three turns of 300 further −150: half way
    visit.until_along(0.5)


def test_another_gain_brings_another_curve(visit: Visit) -> None:
    row = "article.axis tbody tr:first-child > *"
    first = f"[...document.querySelectorAll({row!r})].map((one) => one.textContent)"
    visit.page.locator(".values summary").focus()
    visit.page.keyboard.press("Enter")
    visit.until(first, ["−300.000", "+30.0", "+55.0"])
    scaled = curve()
    doubled, halved = [2 * one for one in scaled["forward"]], [one / 2 for one in scaled["backward"]]
    visit.stage.tables["x"] = {**scaled, "forward": doubled, "backward": halved}
    visit.stage.show(model({"x": axis(gain={"forward": 2.0, "backward": 0.5})}))
    visit.until(first, ["−300.000", "+60.0", "+27.5"])
    visit.until_text("article.axis .facts > div:last-child dd", "× 2 forward, × 0.5 backward")
    assert visit.page.locator("article.axis tbody tr").count() == 31


def test_an_axis_whose_position_nobody_reads_shows_its_target(visit: Visit) -> None:
    unread = axis(nominal_actual=None, corrected_actual=None, nominal_setpoint=-60.0, correction=None)
    visit.stage.show(model({"x": unread}))
    visit.until_text("article.axis .reading-name", "Target of 1 min 0 s ago (position not read)")
    visit.until_text(DIGITS, "−60.000")
    visit.until_text(CORRECTION, "–")


def test_it_says_who_moves_an_axis_as_long_as_somebody_does(visit: Visit) -> None:
    """Whoever wonders about an exception 6 finds the name here."""
    row = "article.axis .facts > div:nth-last-child(2)"
    visit.stage.show(model({"x": axis(writer="panel (192.168.0.9)")}))
    visit.until_text(row, "Moved bypanel (192.168.0.9)")
    assert visit.page.locator(row).is_visible()
    visit.stage.show(model({"x": axis(writer=None)}))
    visit.until(f"document.querySelector({row!r}).checkVisibility()", False)


@pytest.mark.parametrize(
    ("units", "digits", "correction"),
    [
        ("inch", "−120.0000", "+22.10\u202fthou"),
        ("degree", "−120.0000", "+79.6\u202f″"),
        ("mm", "−120.000", "+22.1\u202fµm"),
    ],
)
def test_lengths_are_shown_as_their_units_deserve(
    visit: Visit, units: str, digits: str, correction: str
) -> None:
    visit.stage.show(model({"x": axis(units=units)}))
    visit.until_text(CORRECTION, correction)
    visit.until_text(DIGITS, digits)


def test_keys_in_what_to_do_are_shown_as_code_and_said_as_words(visit: Visit) -> None:
    remedy = "name the device in `other_units` or correct `unit_id`"
    visit.stage.show(model(None, None, trouble(what="nobody answers at 7` or 8", remedy=remedy)))
    visit.until_text("#troubles .remedy", "Name the device in other_units or correct unit_id")
    assert visit.page.locator("#troubles .remedy code").all_text_contents() == ["other_units", "unit_id"]
    assert visit.page.locator("#troubles .what").text_content() == "nobody answers at 7` or 8"
    said = "Axis x: nobody answers at 7 or 8. name the device in other_units or correct unit_id."
    assert visit.page.get_by_role("alert").text_content() == said


def test_a_rejected_table_brings_a_banner_and_mending_it_takes_the_banner_away(visit: Visit) -> None:
    visit.until_text("#verdict strong", "Healthy")
    problem = {
        "file": "cnc10x.tab",
        "line": 12,
        "column": 3,
        "key": "",
        "found": "not a number: 0.0x",
        "remedy": "correct it",
    }
    rejected = table(status="rejected", error="cnc10x.tab:12:3: not a number: 0.0x", problems=[problem])
    visit.stage.show(model({"x": axis(table=rejected)}, None, trouble()))
    visit.until_text("#troubles .where", "Axis x")
    visit.until_text("#troubles .what", trouble()["what"])
    visit.until_text("#troubles .remedy", "Correct the file: it is read again when saved")
    visit.until_text("article.axis .problems", "cnc10x.tab:12:3: not a number: 0.0x; correct it")
    visit.until_text("#verdict strong", "Error")
    assert visit.page.get_by_role("alert").text_content() == (
        f"Axis x: {trouble()['what']}. {trouble()['remedy']}."
    )
    assert visit.page.title() == "⚠ mill-1: error"

    visit.stage.show(model())
    visit.until("document.querySelectorAll('#troubles > *').length", 0)
    visit.until_text("[role=status]", "Healthy: 1 line, 1 axis.")
    assert visit.page.get_by_role("alert").text_content() == ""
    visit.until_text("#verdict strong", "Healthy")
    assert visit.page.title() == "mill-1: healthy"


def test_a_trouble_that_only_changes_its_words_is_not_said_again(visit: Visit) -> None:
    silent = trouble(kind="relay-silent", where="gateway", what="the relay has reported nothing for 3 s")
    visit.stage.show(model(None, None, silent))
    visit.until_text("[role=alert]", f"Gateway: {silent['what']}. {silent['remedy']}.")
    visit.stage.show(model(None, None, {**silent, "what": "the relay has reported nothing for 4 s"}))
    visit.until_text("#troubles .what", "the relay has reported nothing for 4 s")
    assert visit.page.get_by_role("alert").text_content() == f"Gateway: {silent['what']}. {silent['remedy']}."


def test_many_troubles_are_folded_until_somebody_asks(visit: Visit) -> None:
    many = [trouble(where=f"axis a{index}") for index in range(7)]
    visit.stage.show(model(None, None, *many))
    more = visit.page.locator("#more")
    visit.until_text("#more", "Show 3 more")
    assert more.get_attribute("aria-expanded") == "false"
    more.focus()
    visit.page.keyboard.press("Enter")
    visit.until("document.querySelectorAll('#troubles > li').length", 7)
    assert more.get_attribute("aria-expanded") == "true"


def test_a_relay_that_is_silent_greys_all_but_what_is_wrong(visit: Visit) -> None:
    stale = model(None, None, trouble(kind="relay-silent", where="gateway"))
    stale["gateway"]["snapshot_age_s"] = 2.1
    visit.stage.show(stale)
    visit.until("getComputedStyle(document.querySelector('main')).filter", "grayscale(1)")
    visit.until_text("#link", "Relay silent: it may not obey")
    visit.until_text("article.line .state", "Not known")
    visit.until_text(".controllers .controller-state", "not known")
    visit.stage.show(model())
    visit.until("getComputedStyle(document.querySelector('main')).filter", "none")
    visit.until_text("#link", "Live")
    visit.until_text("article.line .state", "Up")


def test_lines_and_their_controllers_say_how_they_are(visit: Visit) -> None:
    down = line(
        state="down", timeouts=31, crc_errors=4, drives={"address": "192.168.0.20:502", "failure": "refused"}
    )
    down["controllers"][0] |= {"state": "down", "failure": "no such device"}
    down["controllers"][1] |= {"connections": []}
    visit.stage.show(model(None, {"xyz": down}))
    visit.until_text("article.line .state", "Down")
    visit.until_text("article.line .drives", "Drives at 192.168.0.20:502: refused")
    counts = visit.page.locator("article.line .counts > div").all_text_contents()
    assert counts[1:] == ["Time-outs31", "CRC errors4", "Exceptions2", "Refused0", "Late0"]
    states = visit.page.locator("article.line .controller-state").all_text_contents()
    assert states == ["port closed: no such device", "not connected"]


def test_a_controller_with_a_certificate_is_named_by_it(visit: Visit) -> None:
    secured = line()
    sessions = [{"peer": "192.168.0.7:50000", "certified": "Fitter", "role": "motion", "subject": "CN=panel"}]
    secured["controllers"][1] |= {"tls": {"sessions": sessions}}
    visit.stage.show(model(None, {"xyz": secured}))
    visit.until_text("article.line li:nth-child(2) .controller-state", "connected: CN=panel (Fitter)")
    assert (
        visit.page.locator("article.line li:nth-child(2) p > .quiet").first.text_content() == "by certificate"
    )


def test_exchanges_are_counted_each_second(visit: Visit) -> None:
    visit.page.wait_for_selector("article.line")
    # the page's own clock: 100 exchanges in each 200 ms are 500 in each second
    rates = visit.page.evaluate(
        """async () => {
          const { LineCard } = await import("./page/line_cards.js");
          const card = new LineCard("xyz");
          return [0, 1, 2, 3, 4, 30].map((step) => card.rateOf(100 * step, 200 * step));
        }"""
    )
    assert rates == [None, None, None, 500, 500, 500]


def test_times_are_drawn_beside_their_budget(visit: Visit) -> None:
    # of the counts 120, 5080, 3900, 800, 85, 13 and 2, the last two took longer than 1000 µs
    visit.until("document.querySelectorAll('#latency .bar').length", 7)
    visit.until("document.querySelectorAll('#latency .bar.over').length", 2)
    visit.until_text("#latency .budget-words", "budget 1 ms")
    rows = visit.page.locator("#latency tbody tr").all()
    assert [row.locator("th, td").all_text_contents() for row in rows] == [
        ["axis x", "96.2", "311", "940", "1\u202f902", "1\u202f000", "15"],
        ["line xyz", "96.2", "311", "940", "1\u202f902", "–", "15"],
    ]
    visit.page.select_option("#latency-of", "line xyz")
    visit.until("document.querySelectorAll('#latency .bar.over').length", 0)


def test_nothing_is_drawn_as_long_as_nothing_was_measured(visit: Visit) -> None:
    none = {"p50": 0.0, "p99": 0.0, "p999": 0.0, "max": 0.0, "max_minute": 0.0}
    fresh = axis()
    fresh["latency"] = {**fresh["latency"], "gateway_us": none}
    visit.stage.show(model({"x": fresh}, {"xyz": line(gateway_us={**none, "below": [0] * 15})}))
    visit.page.locator("#latency .no-curve").wait_for()
    assert visit.page.locator("#latency svg.drawing").is_hidden()
    visit.stage.show(model())
    visit.until("document.querySelectorAll('#latency .bar').length", 7)
    assert visit.page.locator("#latency svg.drawing").is_visible()


def test_axes_come_and_go(visit: Visit) -> None:
    visit.stage.show(model({"x": axis(), "y": axis(), "z": axis()}))
    visit.until(
        "[...document.querySelectorAll('article.axis h3')].map((one) => one.textContent)",
        ["Axis x", "Axis y", "Axis z"],
    )
    visit.complaints.clear()  # y and z have no curve here: the browser says so
    visit.stage.show(model({"y": axis()}))
    visit.until("[...document.querySelectorAll('article.axis h3')].map((one) => one.textContent)", ["Axis y"])
    visit.stage.show(model({}))
    visit.until("document.getElementById('no-axes').hidden", False)
    visit.complaints.clear()


def test_only_what_changed_is_touched(visit: Visit) -> None:
    names = [f"a{index}" for index in range(32)]
    visit.stage.tables |= dict.fromkeys(names, curve())
    everything = {name: standing_at(-120.0) for name in names}
    visit.stage.show(model(everything))
    visit.until("document.querySelectorAll('article.axis[data-curve=yes]').length", 32)
    visit.until("document.querySelectorAll('article.axis .mark[visibility=visible]').length", 32)
    visit.page.evaluate(
        """() => {
          window.touched = new Set();
          const axisOf = (node) => (node.closest ? node : node.parentElement)?.closest("article.axis");
          new MutationObserver((seen) => seen.forEach(({ target }) => {
            const axis = axisOf(target);  // none of what has gone meanwhile or stands beside them
            if (axis) window.touched.add(axis.querySelector("h3").textContent);
          }))
            .observe(document.body, {
              subtree: true, childList: true, attributes: true, characterData: true,
            });
        }"""
    )
    visit.stage.show(model({**everything, "a7": standing_at(-121.0)}))
    visit.until_text("article.axis:nth-child(8) .digits", "−121.000")
    visit.until("[...window.touched]", ["Axis a7"])
