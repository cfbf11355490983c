// @ts-check
// The correction of one axis over its travel, in both directions, and where the machine is on it.

import { Chart, extent, linear, path, round, textWidth } from "./chart.js";
import { draw, make, setAttribute } from "./dom.js";
import { correctionText, fixed, positionText, ticks } from "./figures.js";
import { Pointer, nearestOf } from "./pointer.js";
import { t } from "./language.js";

/**
 * @typedef {import("./model.js").Table} Table
 * @typedef {import("./figures.js").Scale} Scale
 * @typedef {{ table: Table, travel: [number, number] | null, scale: Scale }} Shown
 * @typedef {{ position: number, correction: number }} Place in the units of the table
 */

export class Curve extends Chart {
  /** @param {string} axis */
  constructor(axis) {
    const mark = draw(
      "g",
      { class: "mark" },
      draw("line", { class: "mark-line", x1: 0, x2: 0 }),
      draw("circle", { class: "mark-halo", r: 9 }),
      draw("circle", { class: "mark-dot", r: 5.5 }),
    );
    const reading = draw(
      "g",
      { class: "reading-mark", visibility: "hidden" },
      draw("line", { class: "reading-line", x1: 0, x2: 0 }),
      draw("circle", { class: "reading-forward", r: 4 }),
      draw("circle", { class: "reading-backward", r: 4 }),
    );
    super("drawing", mark, reading);
    this.follow();
    this.mark = mark;
    this.reading = reading;
    this.pointer = new Pointer(this, t("Correction of axis {axis} at a position", { axis }));
    this.frame = make("div", { class: "drawing-frame" }, this.element, this.pointer.slider, this.pointer.words);
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

  /** @param {Shown | null} shown */
  show(shown) {
    this.shown = shown;
    if (shown === null) {
      this.pointer.set(null);
    }
    this.redraw();
  }

  /**
   * Move the machine's mark, in step with the displayed position.
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
    const y = this.up(place.correction);
    setAttribute(this.mark, "visibility", "visible");
    setAttribute(this.mark, "class", isBeyond ? "mark beyond" : "mark");
    putMark(this.mark, x, y, y);
  }

  /** The number of points that can be read. */
  stops() {
    return this.across === null || this.shown === null ? 0 : this.shown.table.positions.length;
  }

  /**
   * The point nearest to a position in the drawing.
   * @param {number} share of its width, from the left
   */
  nearest(share) {
    const { across, shown } = this;
    return across === null || shown === null ? 0 : nearestOf(shown.table.positions.map(across), share * this.width);
  }

  /**
   * Mark a point; returns its values in words.
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
    putMark(this.reading, across(position), this.up(forward), this.up(backward));
    return t("{position}: forward {forward}, backward {backward}", {
      position: positionText(position, scale),
      forward: correctionText(forward, scale),
      backward: correctionText(backward, scale),
    });
  }

  redraw() {
    this.across = null;
    if (this.clear() && this.shown !== null) {
      this.draw(this.shown);
    }
    this.move(this.place);
    this.pointer.redraw();
  }

  /** @param {Shown} shown */
  draw({ table, travel, scale }) {
    const { font } = this;
    const { positions } = table;
    const first = positions[0];
    const last = positions[positions.length - 1];
    const [low, high] = /** @type {[number, number]} */ (extent([first, last, ...(travel ?? [])]));
    const small = (/** @type {number} */ correction) => correction * scale.perUnit;
    const [least, most] = withAir([...table.forward, ...table.backward].map(small));

    const top = font * 1.75;
    const bottom = this.height - font * 1.7;
    const rows = ticks(least, most, (bottom - top) / (font * 2.4));
    const words = rows.values.map((value) => fixed(value, rows.decimals));
    const left = Math.max(...words.map((text) => textWidth(text, font))) + font * 0.9;
    const right = this.width - font * 0.8;
    const across = linear(low, high, left, right);
    const up = linear(least, most, bottom, top);
    const zero = rows.values.findIndex((value) => Math.abs(value) < 1e-12);
    this.rows(rows.values.map(up), words, left, right, zero);
    this.columns(low, high, across, { left, right, top, bottom, units: scale.units });
    this.label(scale.small, 0, font * 0.95, "start", "unit");
    for (const [from, to] of [[low, first], [last, high]]) {
      const [x, width] = [across(from), across(to) - across(from)].map(round);
      if (width > 0.5) {
        this.back.append(draw("rect", { x, y: round(top), width, height: round(bottom - top), class: "outside" }));
      }
    }
    this.ends = [low, high];
    this.across = across;
    this.up = (correction) => Math.min(bottom, Math.max(top, up(small(correction))));
    this.back.append(
      draw("path", { d: path(positions, table.backward, across, this.up), class: "line-backward" }),
      draw("path", { d: path(positions, table.forward, across, this.up), class: "line-forward" }),
    );
    for (const [line, y1] of /** @type {[Element, number][]} */ ([[this.mark.children[0], top - font * 0.3], [this.reading.children[0], top]])) {
      setAttribute(line, "y1", String(round(y1)));
      setAttribute(line, "y2", String(round(bottom)));
    }
  }

  /**
   * The grid lines over the travel; as many as their numbers have room.
   * @param {number} low
   * @param {number} high
   * @param {(value: number) => number} across
   * @param {{ left: number, right: number, top: number, bottom: number, units: string }} room
   */
  columns(low, high, across, { left, right, top, bottom, units }) {
    const { font } = this;
    const y = bottom + font * 1.35;
    const longest = Math.max(fixed(low, 0).length, fixed(high, 0).length) + 3;
    const columns = ticks(low, high, (right - left) / textWidth("0".repeat(longest), font));
    let free = this.width; // the last number has the unit, and the others do not overlap it
    for (const value of columns.values.reverse()) {
      const x = across(value);
      const text = fixed(value, columns.decimals);
      const half = textWidth(text, font) / 2;
      this.stroke(x, top, x, bottom, "grid");
      if (free === this.width) {
        const words = `${text}\u202f${units}`;
        const width = textWidth(words, font);
        const end = Math.min(this.width - 1, x - half + width);
        this.label(words, end, y, "end");
        free = end - width - font * 0.8;
      } else if (x + half < free) {
        this.label(text, x, y, "middle");
        free = x - half - font * 0.5;
      }
    }
  }
}

/**
 * Move a mark: a line across the drawing with two dots on it.
 * @param {SVGElement} mark
 * @param {number} x
 * @param {number} first
 * @param {number} second
 */
function putMark(mark, x, first, second) {
  setAttribute(mark, "transform", `translate(${round(x)} 0)`);
  setAttribute(mark.children[1], "cy", String(round(first)));
  setAttribute(mark.children[2], "cy", String(round(second)));
}

/**
 * Minimum and maximum of some values and zero, with a margin.
 * @param {number[]} values
 * @returns {[number, number]}
 */
function withAir(values) {
  const [low, high] = /** @type {[number, number]} */ (extent([0, ...values]));
  const air = (high - low) * 0.08 || 1;
  return [low < 0 || high === 0 ? low - air : low, high > 0 || low === 0 ? high + air : high];
}
