// @ts-check
// The gateway's own time: one axis or line as a histogram, all of them as figures beside their budget.

import { byId, keepChildren, make, setAttribute, setText, show, sign } from "./dom.js";
import { NOT_KNOWN, count, rounded, time } from "./figures.js";
import { Histogram } from "./histogram.js";
import { t } from "./language.js";

/**
 * @typedef {import("./model.js").Model} Model
 * @typedef {import("./model.js").Times} Times
 * @typedef {{ key: string, words: string, times: Times, budget: number | null, overruns: number,
 *             isOver: boolean }} Measured
 */

export class Latency {
  constructor() {
    this.room = byId("latency");
    this.choice = byId("latency-choice");
    this.select = /** @type {HTMLSelectElement} */ (byId("latency-of"));
    this.chosen = "";
    /** @type {Model | null} */
    this.model = null;
    this.histogram = new Histogram();
    this.none = make("p", { class: "quiet no-curve", text: t("Nothing has been measured yet.") });
    this.drawing = make("div", { class: "drawing-frame" }, this.histogram.element);
    this.body = make("tbody");
    /** @type {Map<string, Row>} */
    this.rows = new Map();
    /** @type {Map<string, HTMLElement>} */
    this.options = new Map();
    this.room.append(
      make("figure", { class: "card times" }, this.drawing, this.none, caption()),
      make(
        "div",
        { class: "card figures", tabindex: "0", role: "region", "aria-label": t("Times in the gateway as figures") },
        make("table", {}, make("caption", { class: "unseen", text: t("Time in the gateway beside its budget") }), head(), this.body),
      ),
    );
    this.select.addEventListener("change", () => {
      this.chosen = this.select.value;
      if (this.model) {
        this.show(this.model);
      }
    });
  }

  /** @param {Model} model */
  show(model) {
    this.model = model;
    const all = measuredOf(model);
    const byKey = new Map(all.map((measured) => [measured.key, measured]));
    keepChildren(this.body, this.rows, [...byKey.keys()], () => new Row(), (row) => row.element);
    keepChildren(this.select, this.options, [...byKey.keys()], (key) => make("option", { value: key }), (option) => option);
    for (const measured of all) {
      this.rows.get(measured.key)?.show(measured);
      setText(/** @type {HTMLElement} */ (this.options.get(measured.key)), measured.words);
    }
    show(this.choice, all.length > 1);
    const shown = byKey.get(this.chosen) ?? all.find((measured) => measured.isOver) ?? all[0];
    if (shown && this.select.value !== shown.key) {
      this.select.value = shown.key;
    }
    this.draw(shown, model.gateway.latency_bounds_us ?? []);
  }

  /**
   * @param {Measured | undefined} measured
   * @param {number[]} bounds
   */
  draw(measured, bounds) {
    const below = measured?.times.below;
    const isThere = measured !== undefined && below !== undefined && below.length === bounds.length + 1;
    const all = isThere ? below[below.length - 1] : 0;
    show(this.none, all === 0);
    show(this.drawing, all > 0);
    if (!isThere || all === 0) {
      this.histogram.show(null);
      return;
    }
    this.histogram.show({ bounds, below, budget: measured.budget });
    setText(this.histogram.title, t("Time in the gateway, {where}", { where: measured.words }));
    const inBudget = measured.budget === null ? "" : t(" The budget is {time}.", { time: time(measured.budget) });
    setText(
      this.histogram.description,
      t("{count} exchanges: half of them within {p50}, 99 % within {p99}, 99.9 % within {p999}.{budget}", {
        count: count(all),
        p50: time(measured.times.p50),
        p99: time(measured.times.p99),
        p999: time(measured.times.p999),
        budget: inBudget,
      }),
    );
  }
}

class Row {
  constructor() {
    this.name = make("th", { scope: "row" });
    this.cells = Array.from({ length: 5 }, () => make("td"));
    this.over = make("td", { class: "over-cell" });
    this.overWords = make("span");
    this.overSign = sign("warning");
    this.over.append(this.overSign, this.overWords);
    this.element = make("tr", {}, this.name, ...this.cells, this.over);
  }

  /** @param {Measured} measured */
  show({ words, times, budget, overruns, isOver }) {
    setText(this.name, words);
    [times.p50, times.p99, times.p999, times.max, budget].forEach((value, index) => setText(this.cells[index], value === null ? NOT_KNOWN : rounded(value, 100)));
    setText(this.overWords, count(overruns));
    setAttribute(this.element, "class", isOver ? "is-over" : "");
  }
}

function head() {
  const words = ["µs", "p50", "p99", "p99.9", "max", t("budget"), t("over")];
  return make("thead", {}, make("tr", {}, ...words.map((text) => make("th", { scope: "col", text }))));
}

function caption() {
  return make("figcaption", { class: "quiet small", text: t("Exchanges by the time that the gateway added to them, since its start") });
}

/**
 * @param {Model} model
 * @returns {Measured[]}
 */
function measuredOf(model) {
  const axes = Object.entries(model.axes).map(([name, { latency }]) => ({
    key: `axis ${name}`,
    words: `${t("axis")} ${name}`,
    times: latency.gateway_us,
    budget: latency.budget_us,
    overruns: latency.budget_overruns,
    isOver: latency.is_over_budget,
  }));
  const lines = Object.entries(model.lines).map(([name, line]) => ({
    key: `line ${name}`,
    words: `${t("line")} ${name}`,
    times: line.gateway_us,
    budget: null,
    overruns: line.budget_overruns ?? 0,
    isOver: false,
  }));
  return [...axes, ...lines];
}
