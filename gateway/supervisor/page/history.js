// @ts-check
// The last ten minutes of one axis: where it was, and what was added there.

import { draw } from "./dom.js";
import { fixed } from "./figures.js";

/** @typedef {{ at: number, nominal: number | null, correction: number | null }} Seen `at` in ms */
/** @typedef {{ ages_s: number[], nominal: (number | null)[], correction: (number | null)[] }} Told */

const KEPT_MS = 600_000;
const EVERY_MS = 1000;
const DRAWN_EVERY_MS = 10_000; // where nothing has changed it only moves to the left
const WIDTH = 600; // one of its own units is a second
const HEIGHT = 60;
const AIR = 5;

let number = 0;

export class History {
  /** @param {string} axis */
  constructor(axis) {
    number += 1;
    this.axis = axis;
    /** @type {Seen[]} oldest first */
    this.seen = [];
    this.drawnAt = -Infinity;
    this.drawn = "";
    /** @type {import("./figures.js").Scale | null} */
    this.scale = null;
    this.title = draw("title", { id: `history-${number}` });
    this.title.textContent = `Last ten minutes of axis ${axis}`;
    this.words = draw("desc", { id: `history-${number}-about` });
    this.position = draw("path", { class: "history-position" });
    this.correction = draw("path", { class: "history-correction" });
    this.element = draw(
      "svg",
      {
        class: "history",
        role: "img",
        viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
        preserveAspectRatio: "none",
        "aria-labelledby": `history-${number}`,
        "aria-describedby": `history-${number}-about`,
      },
      this.title,
      this.words,
      this.position,
      this.correction,
    );
    void this.fetch();
  }

  /** What was before this page was opened. */
  async fetch() {
    try {
      const answer = await fetch(`history/${encodeURIComponent(this.axis)}`, { cache: "no-store" });
      if (answer.ok) {
        const told = /** @type {Told} */ (await answer.json());
        const now = performance.now();
        const before = told.ages_s.map((age, index) => ({
          at: now - age * 1000,
          nominal: told.nominal[index],
          correction: told.correction[index],
        }));
        const first = this.seen.length ? this.seen[0].at : Infinity;
        this.seen = [...before.filter((one) => one.at < first && now - one.at <= KEPT_MS), ...this.seen];
        if (this.scale) {
          this.draw(now, this.scale);
        }
      }
    } catch {
      // It begins with what comes from now on.
    }
  }

  /**
   * Note where the axis is; null where nobody knows.
   * @param {number | null} nominal
   * @param {number | null} correction
   * @param {number} now in ms, as `performance.now`
   * @param {import("./figures.js").Scale} scale
   */
  add(nominal, correction, now, scale) {
    this.scale = scale;
    const newest = this.seen[this.seen.length - 1];
    if (!newest || now - newest.at >= EVERY_MS) {
      this.seen.push({ at: now, nominal, correction });
      while (this.seen.length && now - this.seen[0].at > KEPT_MS) {
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
    const times = this.seen.map(({ at }) => WIDTH - (now - at) / 1000);
    const positions = this.seen.map(({ nominal }) => nominal);
    const corrections = this.seen.map(({ correction }) => correction);
    this.position.setAttribute("d", lineOf(times, positions));
    this.correction.setAttribute("d", lineOf(times, corrections));
    const [low, high] = ends(positions);
    const [least, most] = ends(corrections);
    this.words.textContent =
      `Position from ${fixed(low, scale.decimals)} to ${fixed(high, scale.decimals)} ${scale.units}, ` +
      `correction from ${fixed(least && least * scale.perUnit, scale.smallDecimals, true)} to ` +
      `${fixed(most && most * scale.perUnit, scale.smallDecimals, true)} ${scale.small}.`;
  }
}

/** @param {(number | null)[]} values @returns {[number, number] | [null, null]} */
function ends(values) {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values) {
    if (value !== null) {
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  return low <= high ? [low, high] : [null, null];
}

/**
 * The path of a line that has gaps where nothing is known; it fills the height.
 * @param {number[]} times
 * @param {(number | null)[]} values
 */
function lineOf(times, values) {
  const [low, high] = ends(values);
  if (low === null || high === null) {
    return "";
  }
  const room = HEIGHT - 2 * AIR;
  const up = (/** @type {number} */ value) => (high > low ? HEIGHT - AIR - ((value - low) / (high - low)) * room : HEIGHT / 2);
  let isGap = true;
  let text = "";
  values.forEach((value, index) => {
    if (value !== null && times[index] >= 0) {
      text += `${isGap ? "M" : "L"}${times[index].toFixed(1)} ${up(value).toFixed(1)}`;
    }
    isGap = value === null || times[index] < 0;
  });
  return text;
}
