// @ts-check
// The correction of one axis over its travel, in both directions, and where the machine is on it.

import { label, fontSize, linear, path, round, stroke, textWidth } from "./chart.js";
import { draw, setAttribute } from "./dom.js";
import { fixed, ticks } from "./figures.js";
import { nearestOf } from "./pointer.js";
import { t } from "./language.js";

/**
 * @typedef {import("./model.js").Table} Table
 * @typedef {import("./figures.js").Scale} Scale
 * @typedef {{ table: Table, travel: [number, number] | null, scale: Scale }} Shown
 * @typedef {{ position: number, correction: number }} Place in the units of the table
 */

let number = 0;

export class Curve {
  constructor() {
    number += 1;
    this.title = draw("title", { id: `curve-${number}-title` });
    this.description = draw("desc", { id: `curve-${number}-about` });
    this.back = draw("g");
    this.mark = draw(
      "g",
      { class: "mark" },
      draw("line", { class: "mark-line", x1: 0, x2: 0 }),
      draw("circle", { class: "mark-halo", r: 9 }),
      draw("circle", { class: "mark-dot", r: 5.5 }),
    );
    this.reading = draw(
      "g",
      { class: "reading-mark", visibility: "hidden" },
      draw("line", { class: "reading-line", x1: 0, x2: 0 }),
      draw("circle", { class: "reading-forward", r: 4 }),
      draw("circle", { class: "reading-backward", r: 4 }),
    );
    this.element = draw(
      "svg",
      {
        class: "drawing",
        role: "img",
        "aria-labelledby": `curve-${number}-title`,
        "aria-describedby": `curve-${number}-about`,
      },
      this.title,
      this.description,
      this.back,
      this.mark,
      this.reading,
    );
    this.width = 0;
    this.height = 0;
    /** @type {Shown | null} */
    this.shown = null;
    /** @type {Place | null} */
    this.place = null;
    /** @type {((position: number) => number) | null} */
    this.across = null;
    /** @type {(correction: number) => number} */
    this.up = () => 0;
    this.ends = [0, 0];
  }

  /**
   * @param {number} width in pixels
   * @param {number} height in pixels
   */
  resize(width, height) {
    if (Math.abs(width - this.width) >= 1 || Math.abs(height - this.height) >= 1) {
      this.width = width;
      this.height = height;
      this.redraw();
    }
  }

  /** @param {Shown | null} shown */
  show(shown) {
    this.shown = shown;
    this.redraw();
  }

  /**
   * Put the machine somewhere: with the number that says where, never behind it.
   * @param {Place | null} place
   */
  move(place) {
    this.place = place;
    if (place === null || this.across === null) {
      setAttribute(this.mark, "visibility", "hidden");
      return;
    }
    const [low, high] = this.ends;
    const isBeyond = place.position < low || place.position > high;
    const x = this.across(Math.min(high, Math.max(low, place.position)));
    const dot = round(this.up(place.correction));
    setAttribute(this.mark, "visibility", "visible");
    setAttribute(this.mark, "class", isBeyond ? "mark beyond" : "mark");
    setAttribute(this.mark, "transform", `translate(${round(x)} 0)`);
    setAttribute(this.mark.children[1], "cy", String(dot));
    setAttribute(this.mark.children[2], "cy", String(dot));
  }

  /** How many points can be read. */
  stops() {
    return this.across === null || this.shown === null ? 0 : this.shown.table.positions.length;
  }

  /**
   * Which point is nearest to a place of the drawing.
   * @param {number} share of its width, from the left
   */
  nearest(share) {
    const { across, shown } = this;
    return across === null || shown === null ? 0 : nearestOf(shown.table.positions.map(across), share * this.width);
  }

  /**
   * Mark a point, and say its values.
   * @param {number | null} index null: none
   */
  markAt(index) {
    const { across, shown } = this;
    setAttribute(this.reading, "visibility", index === null || across === null ? "hidden" : "visible");
    if (index === null || across === null || shown === null) {
      return "";
    }
    const { table, scale } = shown;
    const [position, forward, backward] = [table.positions[index], table.forward[index], table.backward[index]];
    setAttribute(this.reading, "transform", `translate(${round(across(position))} 0)`);
    setAttribute(this.reading.children[1], "cy", String(round(this.up(forward))));
    setAttribute(this.reading.children[2], "cy", String(round(this.up(backward))));
    const small = (/** @type {number} */ value) =>
      `${fixed(value * scale.perUnit, scale.smallDecimals, true)}\u202f${scale.small}`;
    const at = `${fixed(position, scale.decimals)}\u202f${scale.units}`;
    return t("{position}: forward {forward}, backward {backward}", {
      position: at,
      forward: small(forward),
      backward: small(backward),
    });
  }

  redraw() {
    this.back.replaceChildren();
    this.across = null;
    if (this.shown === null || this.width < 60 || this.height < 40) {
      this.move(this.place);
      return;
    }
    const font = fontSize(this.element);
    const { table, travel, scale } = this.shown;
    this.element.setAttribute("viewBox", `0 0 ${round(this.width)} ${round(this.height)}`);
    const forward = table.forward.map((correction) => correction * scale.perUnit);
    const backward = table.backward.map((correction) => correction * scale.perUnit);
    const first = table.positions[0];
    const last = table.positions[table.positions.length - 1];
    const low = Math.min(first, travel ? travel[0] : first);
    const high = Math.max(last, travel ? travel[1] : last);
    const [bottomValue, topValue] = withAir(forward, backward);

    const top = font * 1.75;
    const bottom = this.height - font * 1.7;
    const rows = ticks(bottomValue, topValue, (bottom - top) / (font * 2.4));
    const rowWords = rows.values.map((value) => fixed(value, rows.decimals));
    const left = Math.max(...rowWords.map((text) => textWidth(text, font))) + font * 0.9;
    const right = this.width - font * 0.8;
    const across = linear(low, high, left, right);
    const up = linear(bottomValue, topValue, bottom, top);

    rows.values.forEach((value, index) => {
      const name = Math.abs(value) < 1e-12 ? "grid zero" : "grid";
      this.back.append(
        stroke(left, up(value), right, up(value), name),
        label(rowWords[index], left - font * 0.45, up(value) + font * 0.35, "end"),
      );
    });
    this.columns(low, high, across, { left, right, top, bottom, font });
    this.back.append(label(scale.small, 0, font * 0.95, "start", "unit"));
    for (const [from, to] of [[low, first], [last, high]]) {
      if (across(to) - across(from) > 0.5) {
        const room = { x: round(across(from)), y: round(top), width: round(across(to) - across(from)) };
        this.back.append(draw("rect", { ...room, height: round(bottom - top), class: "outside" }));
      }
    }
    this.back.append(
      draw("path", { d: path(table.positions, backward, across, up), class: "line-backward" }),
      draw("path", { d: path(table.positions, forward, across, up), class: "line-forward" }),
    );
    this.ends = [low, high];
    this.across = across;
    this.up = (correction) => {
      const y = up(correction * scale.perUnit);
      return Math.min(bottom, Math.max(top, y));
    };
    this.mark.children[0].setAttribute("y1", String(round(top - font * 0.3)));
    this.mark.children[0].setAttribute("y2", String(round(bottom)));
    this.reading.children[0].setAttribute("y1", String(round(top)));
    this.reading.children[0].setAttribute("y2", String(round(bottom)));
    this.move(this.place);
  }

  /**
   * The lines of the travel; as many as have room for their numbers.
   * @param {number} low
   * @param {number} high
   * @param {(value: number) => number} across
   * @param {{ left: number, right: number, top: number, bottom: number, font: number }} room
   */
  columns(low, high, across, { left, right, top, bottom, font }) {
    const longest = Math.max(fixed(low, 0).length, fixed(high, 0).length) + 3;
    const columns = ticks(low, high, (right - left) / textWidth("0".repeat(longest), font));
    const unit = /** @type {Shown} */ (this.shown).scale.units;
    let free = this.width; // the last number carries the unit, and the others keep clear of it
    for (const value of columns.values.reverse()) {
      const x = across(value);
      const text = fixed(value, columns.decimals);
      const isLast = free === this.width;
      const words = isLast ? `${text}\u202f${unit}` : text;
      const width = textWidth(words, font);
      const to = Math.min(this.width - 1, x - textWidth(text, font) / 2 + width);
      this.back.append(stroke(x, top, x, bottom, "grid"));
      if (isLast) {
        this.back.append(label(words, to, bottom + font * 1.35, "end"));
        free = to - width - font * 0.8;
      } else if (x + width / 2 < free) {
        this.back.append(label(words, x, bottom + font * 1.35, "middle"));
        free = x - width / 2 - font * 0.5;
      }
    }
  }
}

/**
 * Lowest and highest value of both lines and of zero, with some air.
 * @param {number[]} forward
 * @param {number[]} backward
 * @returns {[number, number]}
 */
function withAir(forward, backward) {
  let low = 0;
  let high = 0;
  for (const values of [forward, backward]) {
    for (const value of values) {
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  const air = (high - low) * 0.08 || 1;
  return [low < 0 || high === 0 ? low - air : low, high > 0 || low === 0 ? high + air : high];
}
