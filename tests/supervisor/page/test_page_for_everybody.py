"""The page on phones and walls, light and dark, with a keyboard, and for a screen reader."""

import pytest

from tests.supervisor.page.models import axis, curve, line, model, table, trouble
from tests.supervisor.page.visit import Visit

CONTRASTS = """() => {
  const parts = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const light = ([r, g, b]) => [r, g, b]
    .map((value) => value / 255)
    .map((value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4))
    .reduce((sum, value, index) => sum + value * [0.2126, 0.7152, 0.0722][index], 0);
  const ground = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const colour = parts(getComputedStyle(at).backgroundColor);
      if (colour.length === 3 || colour[3] > 0.99) return colour;
    }
    throw new Error("no background");
  };
  const found = [];
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const element = texts.currentNode.parentElement;
    const isSeen = element.checkVisibility() && element.getBoundingClientRect().width > 2;
    if (!texts.currentNode.data.trim() || !isSeen || element.closest(".unseen, script, option")) continue;
    const style = getComputedStyle(element);
    const ink = light(parts(element instanceof SVGElement ? style.fill : style.color));
    const back = light(ground(element));
    const ratio = (Math.max(ink, back) + 0.05) / (Math.min(ink, back) + 0.05);
    found.push([ratio, texts.currentNode.data]);
  }
  return found;
}"""


def in_trouble() -> dict[str, object]:
    """Return a model in which everything that has a colour is there."""
    axes = {
        "x": axis(table=table(status="rejected", error="bad")),
        "y": axis(compensation="unreferenced", table=table(status="waiting")),
        "z": axis(compensation="blocked", table=table(status="removed")),
        "a": axis(compensation="blending", table=table(status="none", points=0, compiled=None)),
    }
    axes["y"]["latency"] = {**axes["y"]["latency"], "is_over_budget": True}
    lines = {"xy": line(state="down"), "z": line()}
    return model(axes, lines, trouble(), trouble(kind="unreferenced", severity="warning", where="axis y"))


def lay_out(visit: Visit, axes: int) -> None:
    names = [f"a{index}" for index in range(axes)]
    visit.stage.tables |= dict.fromkeys(names, curve())
    long = axis(nominal_setpoint=-1234.567, nominal_actual=-1234.567, corrected_actual=-1234.545)
    visit.stage.show(model(dict.fromkeys(names, long)))
    visit.until("document.querySelectorAll('article.axis').length", axes)
    visit.until_text("article.axis .digits", "−1234.567")
    for number in range(60):
        visit.stage.publish_event(
            {
                "number": number,
                "time": "2026-05-01T12:00:00Z",
                "event": "x",
                "severity": "error",
                "detail": "d",
            }
        )
    visit.until("document.querySelectorAll('#events li').length", 60)


@pytest.mark.parametrize("axes", [1, 3, 4, 32])
@pytest.mark.parametrize(
    ("visit", "columns"),
    [
        ({"viewport": {"width": 360, "height": 740}}, {1: 1, 3: 1, 4: 1, 32: 1}),
        ({"viewport": {"width": 1280, "height": 800}}, {1: 1, 3: 3, 4: 2, 32: 4}),
        ({"viewport": {"width": 2560, "height": 1440}}, {1: 1, 3: 3, 4: 4, 32: 4}),
    ],
    indirect=["visit"],
)
def test_it_fits_phones_and_walls(visit: Visit, columns: dict[int, int], axes: int) -> None:
    lay_out(visit, axes)
    places = visit.page.evaluate(
        """[...document.querySelectorAll("article.axis")]
          .map((one) => Math.round(one.getBoundingClientRect().left))"""
    )
    assert len(set(places)) == columns[axes]
    assert visit.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    below = "document.documentElement.scrollHeight - Math.ceil(document.body.getBoundingClientRect().bottom)"
    assert visit.page.evaluate(below) <= 1
    cut = """[...document.querySelectorAll("article.axis .position, dd, .controllers p, .event p")]
      .filter((one) => one.scrollWidth > one.clientWidth + 1).map((one) => one.textContent)"""
    assert visit.page.evaluate(cut) == []
    left_of_card = """[...document.querySelectorAll("article.axis")].filter((card) => {
      const edge = card.getBoundingClientRect().left + 8;
      return card.querySelector(".digits").getBoundingClientRect().left < edge;
    }).length"""
    assert visit.page.evaluate(left_of_card) == 0


WIDTHS = (360, 390, 768, 1280, 1600, 1920, 2560, 3840)


@pytest.mark.parametrize("lines", [1, 2, 8])
@pytest.mark.parametrize("axes", [1, 2, 8, 32])
def test_nothing_reaches_beyond_the_edge_of_any_screen(visit: Visit, lines: int, axes: int) -> None:
    names = [f"a{index}" for index in range(axes)]
    visit.stage.tables |= dict.fromkeys(names, curve())
    address = "/dev/serial/by-id/usb-FTDI_USB-RS485_Cable_FT4X1ABC-if00-port0"
    long = line(exchanges=123_456_789, timeouts=12_345, drives={"address": address, "failure": ""})
    of_lines = {f"line{index}": long for index in range(lines)}
    visit.stage.show(model(dict.fromkeys(names, axis()), of_lines, trouble()))
    visit.until("document.querySelectorAll('article.axis').length", axes)
    visit.until("document.querySelectorAll('article.line').length", lines)
    wide = []
    for width in WIDTHS:
        visit.page.set_viewport_size({"width": width, "height": 900})
        visit.page.wait_for_function("width => innerWidth === width", arg=width)
        if not visit.page.evaluate("document.documentElement.scrollWidth <= innerWidth"):
            wide.append((width, visit.page.evaluate("document.documentElement.scrollWidth")))
        cut = """[...document.querySelectorAll("article.line :not(.unseen)")]
          .filter((one) => one.clientWidth && one.scrollWidth > one.clientWidth + 1)
          .map((one) => one.className)"""
        assert visit.page.evaluate(cut) == [], width
    assert wide == []


@pytest.mark.parametrize("visit", [{"viewport": {"width": 1920, "height": 1080}}], indirect=True)
@pytest.mark.parametrize("axes", [1, 3, 6])
def test_lines_and_troubles_are_seen_without_scrolling(visit: Visit, axes: int) -> None:
    lay_out(visit, axes)
    names = [f"a{index}" for index in range(axes)]
    troubles = [trouble(where=f"axis a{axes - 1}"), trouble(kind="unreferenced", where="axis a0")]
    visit.stage.show(model(dict.fromkeys(names, axis()), {"xy": line(), "z": line()}, *troubles))
    visit.until("document.querySelectorAll('article.line').length", 2)
    visit.until("document.querySelectorAll('#troubles li').length", 2)
    shown = "article.line .state, article.line .controllers, #troubles li"
    lowest = f"""Math.max(...[...document.querySelectorAll({shown!r})]
      .map((one) => one.getBoundingClientRect().bottom))"""
    assert visit.page.evaluate(lowest) <= 1080


@pytest.mark.parametrize(
    ("visit", "axes", "least_px"),
    [
        ({"viewport": {"width": 1280, "height": 800}}, 3, 40),
        ({"viewport": {"width": 1280, "height": 800}}, 1, 60),
        ({"viewport": {"width": 2560, "height": 1440}}, 3, 80),
    ],
    indirect=["visit"],
)
def test_positions_are_read_at_two_metres(visit: Visit, axes: int, least_px: int) -> None:
    names = [f"a{index}" for index in range(axes)]
    visit.stage.tables |= dict.fromkeys(names, curve())
    visit.stage.show(model(dict.fromkeys(names, axis())))
    visit.until("document.querySelectorAll('article.axis').length", axes)
    visit.until_text("article.axis .digits", "−120.000")
    size = visit.page.evaluate("parseFloat(getComputedStyle(document.querySelector('.digits')).fontSize)")
    assert size >= least_px


@pytest.mark.parametrize(
    "visit", [{"color_scheme": "light"}, {"color_scheme": "dark"}], indirect=True, ids=["light", "dark"]
)
def test_every_word_stands_out_from_its_ground(visit: Visit) -> None:
    visit.stage.tables |= dict.fromkeys("yza", curve())
    visit.stage.show(in_trouble())
    for number, severity in enumerate(("info", "warning", "error")):
        visit.stage.publish_event(
            {
                "number": number,
                "time": "2026-05-01T12:00:00Z",
                "event": "x",
                "severity": severity,
                "detail": "d",
            }
        )
    visit.until("document.querySelectorAll('article.axis[data-curve=yes]').length", 3)
    visit.until("document.querySelectorAll('#events li').length", 3)
    visit.page.emulate_media(reduced_motion="reduce")
    contrasts = visit.page.evaluate(CONTRASTS)
    assert len(contrasts) > 100
    assert [found for found in contrasts if found[0] < 4.5] == []  # WCAG 2.2, 1.4.3, level AA


@pytest.mark.parametrize("visit", [{"color_scheme": "dark"}], indirect=True)
def test_the_choice_of_colours_is_remembered(visit: Visit) -> None:
    ground = "getComputedStyle(document.body).backgroundColor"
    dark, light = "rgb(12, 15, 19)", "rgb(238, 240, 243)"
    visit.until(ground, dark)
    for name, colour in (("Colours: auto", light), ("Colours: light", dark), ("Colours: dark", dark)):
        visit.find("button", name).click()
        visit.until(ground, colour)
    visit.find("button", "Colours: auto").click()
    visit.page.reload()
    visit.find("button", "Colours: light").wait_for()
    visit.until(ground, light)


def test_everything_is_reached_with_the_keyboard_and_shows_where_it_is(visit: Visit) -> None:
    visit.stage.show(model(None, None, *(trouble(where=f"axis a{index}") for index in range(6))))
    visit.until_text("#more", "Show 2 more")
    visit.page.wait_for_selector("article.axis summary")
    reached = []
    for _ in range(17):
        visit.page.keyboard.press("Tab")
        reached.append(
            visit.page.evaluate(
                """() => {
                  const at = document.activeElement;
                  const marked = at.matches("input[type=radio]") ? at.nextElementSibling : at;
                  const style = getComputedStyle(marked);
                  const isMarked = style.outlineStyle === "solid" && parseFloat(style.outlineWidth) >= 2;
                  return isMarked ? at.id || at.className || at.name || at.localName : "";
                }"""
            )
        )
    wanted = [
        "skip",
        "language",
        "sound",
        "theme",
        "more",
        "pointer-slider",
        "past-span",
        "past-file",
        "pointer-slider",
        "summary",
        "latency-of",
        "card figures",
        "severity",
        "events-frame",
    ]
    assert reached[: len(wanted)] == wanted


def test_skipping_goes_to_the_axes(visit: Visit) -> None:
    visit.page.keyboard.press("Tab")
    visit.page.keyboard.press("Enter")
    visit.until("document.activeElement.id", "main")


def test_a_screen_reader_finds_its_way(visit: Visit) -> None:
    visit.page.wait_for_selector("article.axis .line-forward")
    for role, name in (
        ("banner", ""),
        ("main", ""),
        ("contentinfo", ""),
        ("region", "How the gateway is"),
        ("region", "Axes"),
        ("region", "Lines"),
        ("region", "Time in the gateway"),
        ("region", "Events"),
        ("article", "Axis x"),
        ("heading", "mill-1"),
        ("heading", "Axis x"),
        ("heading", "Line xyz"),
        ("img", "Correction of axis x over its travel"),
        ("img", "Last 10 minutes of axis x"),
        ("slider", "Correction of axis x at a position"),
        ("slider", "Axis x at a time"),
        ("combobox", "Span of the past of axis x"),
        ("link", "Axis x, last 10 minutes, as CSV file"),
        ("button", "Sound: off"),
        ("img", "Time in the gateway, axis x"),
        ("combobox", "Show times of"),
        ("radio", "All"),
    ):
        found = visit.find(role, name) if name else visit.any_of(role)
        assert found.count() == 1, (role, name)
    assert visit.page.locator("html").get_attribute("lang") == "en"
    description = visit.page.locator("article.axis .curve desc").text_content() or ""
    assert description.startswith(
        "31 points from −300.000 to 0.000 mm. Forward from 0.0 to +30.0 µm, backward from +25.0 to +55.0 µm."
    )
    # positions change five times a second: nothing that holds one is ever announced
    assert visit.page.locator("[aria-live], [role=alert], [role=status], [role=log]").count() == 2
    assert visit.page.locator("svg:not([role=img]):not([aria-hidden=true])").count() == 0


def test_levels_of_headings_do_not_leap(visit: Visit) -> None:
    visit.page.wait_for_selector("article.line")
    levels = visit.page.evaluate(
        "[...document.querySelectorAll('h1, h2, h3, h4')].map((one) => Number(one.localName[1]))"
    )
    assert levels == [1, 2, 3, 2, 3, 2, 2, 2]
