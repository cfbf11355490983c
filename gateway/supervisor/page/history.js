// @ts-check
// The history of one axis, from ten minutes to a day: its positions and corrections.

import { Chart, extent, linear, path } from "./chart.js";
import { draw, make, setAttribute } from "./dom.js";
import { correctionText, fixed, positionText, timeOfDay } from "./figures.js";
import { Pointer, nearestOf } from "./pointer.js";
import { t } from "./language.js";

/** @typedef {{ at: number, nominal: number | null, correction: number | null }} Seen `at` in ms */
/** @typedef {{ ages_s: number[], nominal: (number | null)[], correction: (number | null)[] }} Told */

const MS_PER_MINUTE = 60_000;
const EVERY_MS = 1000; // the gateway's interval in the last ten minutes
const SELDOM_MS = 10_000; // and before that
const DRAWN_EVERY_MS = 10_000; // an unchanged strip only moves to the left
const GAP_MS = 35_000; // a longer silence interrupts the line
const WIDTH = 600;
const HEIGHT = 60;
const AIR = 5;
/** @type {Record<string, string>} spans by minutes */
export const SPANS = { 10: t("10 minutes"), 60: t("1 hour"), 480: t("8 hours"), 1440: t("1 day") };

export class History extends Chart {
  /** @param {string} axis */
  constructor(axis) {
    const position = draw("path", { class: "history-position" });
    const correction = draw("path", { class: "history-correction" });
    const reading = draw("line", { class: "history-reading", y1: 0, y2: HEIGHT, visibility: "hidden" });
    super("history", position, correction, reading);
    this.resize(WIDTH, HEIGHT);
    setAttribute(this.element, "preserveAspectRatio", "none"); // the browser scales it
    this.axis = axis;
    this.position = position;
    this.correction = correction;
    this.reading = reading;
    this.minutes = 10;
    /** @type {Seen[]} oldest first */
    this.seen = [];
    this.drawnAt = -Infinity;
    this.drawn = "";
    /** @type {import("./figures.js").Scale | null} */
    this.scale = null;
    this.name();
    this.pointer = new Pointer(this, t("Axis {axis} at a time", { axis }));
    this.figure = this.laidOut();
    void this.fetch();
  }

  /** The strip, with the choice of its span and a download. */
  laidOut() {
    const label = t("Span of the past of axis {axis}", { axis: this.axis });
    const choice = /** @type {HTMLSelectElement} */ (make("select", { class: "past-span", "aria-label": label }));
    choice.append(...Object.entries(SPANS).map(([value, text]) => make("option", { value, text })));
    const file = make("a", { class: "past-file", download: "", text: "CSV" });
    const name = () => {
      setAttribute(file, "href", `history/${encodeURIComponent(this.axis)}.csv?minutes=${choice.value}`);
      setAttribute(file, "aria-label", t("Axis {axis}, last {span}, as CSV file", { axis: this.axis, span: SPANS[choice.value] }));
    };
    choice.addEventListener("change", () => {
      name();
      this.choose(Number(choice.value));
    });
    name();
    return make(
      "figure",
      { class: "past" },
      make("div", { class: "past-frame" }, this.element, this.pointer.slider, this.pointer.words),
      make(
        "figcaption",
        { class: "legend" },
        make("span", { class: "key-position", "aria-hidden": "true", text: t("position") }),
        make("span", { class: "key-forward", "aria-hidden": "true", text: t("correction") }),
        make("span", { class: "key-time" }, choice, file),
      ),
    );
  }

  name() {
    this.title.textContent = t("Last {span} of axis {axis}", { span: SPANS[this.minutes], axis: this.axis });
  }

  get keptMs() {
    return this.minutes * MS_PER_MINUTE;
  }

  /**
   * Show another span.
   * @param {number} minutes one of {@link SPANS}
   */
  choose(minutes) {
    this.pointer.set(null);
    this.minutes = minutes;
    this.seen = [];
    this.name();
    void this.fetch();
  }

  /** The history before this page was opened. */
  async fetch() {
    const { minutes } = this;
    try {
      const address = `history/${encodeURIComponent(this.axis)}?minutes=${minutes}`;
      const answer = await fetch(address, { cache: "no-store" });
      if (answer.ok && minutes === this.minutes) {
        const told = /** @type {Told} */ (await answer.json());
        const now = performance.now();
        const before = told.ages_s.map((age, index) => ({
          at: now - age * 1000,
          nominal: told.nominal[index],
          correction: told.correction[index],
        }));
        const first = this.seen.length ? this.seen[0].at : Infinity;
        this.seen = [...before.filter((one) => one.at < first && now - one.at <= this.keptMs), ...this.seen];
        if (this.scale) {
          this.draw(now, this.scale);
        }
      }
    } catch {
      // It begins with the next values.
    }
  }

  /**
   * Add the position of the axis; null: unknown.
   * @param {number | null} nominal
   * @param {number | null} correction
   * @param {number} now in ms, as `performance.now`
   * @param {import("./figures.js").Scale} scale
   */
  add(nominal, correction, now, scale) {
    this.scale = scale;
    const newest = this.seen[this.seen.length - 1];
    if (!newest || now - newest.at >= (this.minutes > 10 ? SELDOM_MS : EVERY_MS)) {
      this.seen.push({ at: now, nominal, correction });
      while (this.seen.length && now - this.seen[0].at > this.keptMs) {
        this.seen.shift();
      }
    }
    const key = `${nominal} ${correction}`;
    const isDue = now - this.drawnAt >= (key === this.drawn ? DRAWN_EVERY_MS : EVERY_MS);
    if (isDue) {
      this.drawn = key;
      this.drawnAt = now;
      this.draw(now, scale);
    }
  }

  /**
   * @param {number} now
   * @param {import("./figures.js").Scale} scale
   */
  draw(now, scale) {
    const seen = this.seen.filter(({ at }) => now - at <= this.keptMs);
    const times = seen.map(({ at }) => at);
    const across = (/** @type {number} */ at) => this.acrossOf(at, now);
    const drawn = (/** @type {Element} */ line, /** @type {(number | null)[]} */ values) => {
      const [low, high] = extent(values) ?? [null, null];
      const up = linear(low ?? 0, high ?? 0, HEIGHT - AIR, AIR);
      setAttribute(line, "d", path(times, values, across, up, GAP_MS));
      return [low, high];
    };
    const [low, high] = drawn(this.position, seen.map(({ nominal }) => nominal));
    const [least, most] = drawn(this.correction, seen.map(({ correction }) => correction));
    const small = (/** @type {number | null} */ value) => fixed(value && value * scale.perUnit, scale.smallDecimals, true);
    this.description.textContent = t("Position from {low} to {high} {units}, correction from {least} to {most} {small}.", {
      low: fixed(low, scale.decimals),
      high: fixed(high, scale.decimals),
      units: scale.units,
      least: small(least),
      most: small(most),
      small: scale.small,
    });
    this.pointer.redraw();
  }

  /**
   * @param {number} at
   * @param {number} now
   */
  acrossOf(at, now) {
    return WIDTH - ((now - at) / this.keptMs) * WIDTH;
  }

  /** The number of points that can be read. */
  stops() {
    return this.scale === null ? 0 : this.seen.length;
  }

  /** @param {number} share of the width, from the left */
  nearest(share) {
    const at = performance.now() - (1 - share) * this.keptMs;
    return nearestOf(this.seen.map((one) => one.at), at);
  }

  /**
   * Mark a point; returns time and position in words.
   * @param {number | null} index null: none
   */
  markAt(index) {
    const { scale } = this;
    setAttribute(this.reading, "visibility", index === null ? "hidden" : "visible");
    if (index === null || scale === null) {
      return "";
    }
    const { at, nominal, correction } = this.seen[index];
    const now = performance.now();
    const x = this.acrossOf(at, now).toFixed(1);
    setAttribute(this.reading, "x1", x);
    setAttribute(this.reading, "x2", x);
    const when = timeOfDay(new Date(Date.now() - (now - at)).toISOString());
    if (nominal === null) {
      return t("{time}: position not known", { time: when });
    }
    return t("{time}: {position}, correction {correction}", {
      time: when,
      position: positionText(nominal, scale),
      correction: correctionText(correction, scale),
    });
  }
}
