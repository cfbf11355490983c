"""One look at the page with a browser."""

import json
from collections.abc import Mapping
from typing import Any, Final

from playwright.sync_api import Browser, ConsoleMessage, Error, Locator, Page, Request

from tests.supervisor.page.stage import Stage

WAIT_MS: Final = 100_000
SIZE: Final = {"width": 1280, "height": 800}
ALONG: Final = """(() => {
  const svg = document.querySelector("article.axis svg.drawing");
  const line = svg.querySelector(".line-forward").getBBox();
  const x = svg.querySelector(".mark").transform.baseVal[0].matrix.e;
  return Math.round(((x - line.x) / line.width) * 100) / 100;
})()"""
PLACE: Final = """() => {
  const svg = document.querySelector("article.axis svg.drawing");
  const line = svg.querySelector(".line-forward").getBBox();
  const mark = svg.querySelector(".mark");
  const x = mark.transform.baseVal[0].matrix.e;
  const y = Number(mark.querySelector(".mark-dot").getAttribute("cy"));
  return [(x - line.x) / line.width, (y - line.y) / line.height, mark.getAttribute("class")];
}"""


class Tabs:
    """One tab of a browser for each language: with a new tab, a visit takes twice the processor time."""

    def __init__(self, browser: Browser) -> None:
        self._browser: Final = browser
        self._by_locale: dict[str, Page] = {}

    def blank(self, options: Mapping[str, Any]) -> Page:
        """Return an empty tab with these options of a browser context: viewport, color_scheme and locale."""
        locale = options.get("locale", "en-US")
        if locale not in self._by_locale:
            self._by_locale[locale] = self._browser.new_context(locale=locale).new_page()
        tab = self._by_locale[locale]
        tab.set_default_timeout(WAIT_MS)
        tab.set_viewport_size(options.get("viewport", SIZE))
        tab.emulate_media(color_scheme=options.get("color_scheme", "light"), reduced_motion="no-preference")
        tab.mouse.move(-1, -1)  # a pointer above the page would hover over what comes there
        return tab


class Visit:
    """The page of a stage in a tab with settings of its own, which remembers nothing of earlier visits."""

    def __init__(self, tabs: Tabs, stage: Stage, options: Mapping[str, Any]) -> None:
        self.complaints: list[str] = []
        """What the browser's console says."""
        self.elsewhere: list[str] = []
        """Addresses that were asked for outside the gateway."""
        self.stage = stage
        self.page = tabs.blank(options)
        self.page.on("console", self._complained)
        self.page.on("pageerror", self._failed)
        self.page.on("request", self._asked)
        self.page.goto(stage.address)
        self.page.wait_for_selector("#axes article, #no-axes:not([hidden])")

    def _complained(self, message: ConsoleMessage) -> None:
        self.complaints.append(message.text)

    def _failed(self, error: Error) -> None:
        self.complaints.append(str(error))

    def _asked(self, request: Request) -> None:
        if not request.url.startswith(self.stage.address):
            self.elsewhere.append(request.url)

    def close(self) -> None:
        """Leave an empty tab, and no choice of this visit: a later gateway may get the same port."""
        self.page.remove_listener("console", self._complained)
        self.page.remove_listener("pageerror", self._failed)
        self.page.remove_listener("request", self._asked)
        self.page.evaluate("localStorage.clear(), sessionStorage.clear()")
        self.page.goto("about:blank")

    def until(self, script: str, wanted: object) -> None:
        """Wait until an expression has a value; fail with what it has else."""
        try:
            self.page.wait_for_function(
                f"wanted => JSON.stringify({script}) === wanted", arg=_compact(wanted), timeout=WAIT_MS
            )
        except Exception as error:
            raise AssertionError(
                f"{script}: {self.page.evaluate(f'() => {script}')!r}, not {wanted!r}"
            ) from error

    def until_text(self, selector: str, wanted: str) -> None:
        """Wait until an element has this text."""
        self.until(f"document.querySelector({selector!r})?.textContent", wanted)

    def until_along(self, share: float) -> None:
        """Wait until the machine is drawn so far along the forward line."""
        self.page.wait_for_selector("article.axis .mark[transform]")
        self.until(ALONG, share)

    def place(self) -> tuple[float, float, str]:
        """Where the machine is drawn, as shares of the forward line's width and height, and its class."""
        along, down, name = self.page.evaluate(PLACE)
        return along, down, name

    def find(self, role: Any, name: str) -> Locator:
        """Find what a screen reader finds."""
        return self.page.get_by_role(role, name=name, exact=True)

    def any_of(self, role: Any) -> Locator:
        """Find all of one role."""
        return self.page.get_by_role(role)


def _compact(value: object) -> str:
    if isinstance(value, float) and value.is_integer():
        value = int(value)  # as JavaScript writes it
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))
