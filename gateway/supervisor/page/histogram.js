// @ts-check
// The gateway's own time: the number of exchanges in each interval, with logarithmic axes, and the budget.

import { Chart, linear, round, textWidth } from "./chart.js";
import { draw } from "./dom.js";
import { shortCount, time } from "./figures.js";
import { t } from "./language.js";

/** @typedef {{ bounds: number[], below: number[], budget: number | null }} Counted microseconds */

export class Histogram extends Chart {
  constructor() {
    super("drawing");
    this.follow();
    /** @type {Counted | null} */
    this.counted = null;
    this.drawn = "";
  }

  /** @param {Counted | null} counted */
  show(counted) {
    const key = JSON.stringify(counted);
    if (key !== this.drawn) {
      this.drawn = key;
      this.counted = counted;
      this.redraw();
    }
  }

  redraw() {
    if (this.clear() && this.counted !== null) {
      this.draw(this.counted);
    }
  }

  /** @param {Counted} counted */
  draw({ bounds, below, budget }) {
    const { font } = this;
    const counts = below.map((all, index) => all - (index ? below[index - 1] : 0));
    const most = 10 ** Math.max(1, Math.ceil(Math.log10(Math.max(...counts, 1) + 1)));
    const left = textWidth(shortCount(most), font) + font * 0.9;
    const right = this.width - font * 0.3;
    const top = font * 1.9;
    const bottom = this.height - font * 1.8;
    const up = linear(0, Math.log10(most) + HALF, bottom, top);
    const across = linear(0, counts.length, left, right);
    const every = Math.max(1, Math.ceil((font * 1.5) / Math.abs(up(1) - up(0))));
    const powers = [...Array(Math.round(Math.log10(most)) + 1).keys()].filter((power) => power % every === 0);
    this.rows(powers.map((power) => up(power + HALF)), powers.map((power) => shortCount(10 ** power)), left, right);
    const beyond = budget === null ? Infinity : barOf(budget, bounds);
    counts.forEach((count, index) => {
      this.stroke(across(index), bottom, across(index), bottom + 4, "grid");
      if (count > 0) {
        const x = across(index) + 1;
        const y = up(Math.log10(count) + HALF);
        const size = { width: round(across(index + 1) - 1 - x), height: round(bottom - y) };
        const name = index >= Math.ceil(beyond) ? "bar over" : "bar";
        this.back.append(draw("rect", { x: round(x), y: round(y), ...size, rx: 1.5, class: name }));
      }
    });
    this.stroke(left, bottom, right, bottom, "grid zero");
    this.times(bounds, across, bottom);
    if (budget !== null) {
      const x = across(beyond);
      const words = `${t("budget")} ${time(budget)}`;
      const fits = x + textWidth(words, font) + 6 < right;
      this.stroke(x, font * 0.4, x, bottom, "budget");
      this.label(words, x + (fits ? 6 : -6), font * 1.1, fits ? "start" : "end", "budget-words");
    }
  }

  /**
   * The bounds between the bars; as many as there is room for.
   * @param {number[]} bounds
   * @param {(index: number) => number} across
   * @param {number} bottom
   */
  times(bounds, across, bottom) {
    const { font } = this;
    let free = -Infinity;
    const isNarrow = across(1) - across(0) < textWidth("500 µs", font) + font * 0.4;
    bounds.forEach((bound, index) => {
      const isPower = Number.isInteger(Math.log10(bound));
      const x = across(index + 1);
      const text = time(bound);
      const half = textWidth(text, font) / 2;
      if ((isPower || !isNarrow) && x - half > free) {
        const isAtEdge = x + half > this.width;
        this.label(text, isAtEdge ? this.width - 1 : x, bottom + font * 1.5, isAtEdge ? "end" : "middle");
        free = x + half + font * 0.4;
      }
    });
  }
}

const HALF = 0.35; // a single one is visible, too

/**
 * The position of a time on the bars.
 * @param {number} value
 * @param {number[]} bounds
 */
function barOf(value, bounds) {
  const index = bounds.findIndex((bound) => value <= bound);
  if (index < 0) {
    return bounds.length;
  }
  const high = bounds[index];
  const low = index ? bounds[index - 1] : high / 2;
  return index + Math.max(0, Math.log(value / low) / Math.log(high / low));
}
