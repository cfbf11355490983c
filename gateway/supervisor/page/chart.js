// @ts-check
// What the drawings share: a name for screen readers, size, letters, scales, grid lines.

import { draw, newId, setAttribute } from "./dom.js";

/** A drawing that fills its element. */
export class Chart {
  /**
   * @param {string} name its class
   * @param {...SVGElement} above elements that move over the drawing without redrawing it
   */
  constructor(name, ...above) {
    const id = newId(name);
    this.title = draw("title", { id: `${id}-title` });
    this.description = draw("desc", { id: `${id}-about` });
    this.back = draw("g");
    this.element = draw(
      "svg",
      { class: name, role: "img", "aria-labelledby": `${id}-title`, "aria-describedby": `${id}-about` },
      this.title,
      this.description,
      this.back,
      ...above,
    );
    this.width = 0;
    this.height = 0;
    this.font = 12; // letter size in pixels: read once for each drawing, because it costs a layout
  }

  /** Redraw, pixel for pixel, whenever the element's size changes. */
  follow() {
    new ResizeObserver(([{ contentRect: { width, height } }]) => {
      if (Math.abs(width - this.width) >= 1 || Math.abs(height - this.height) >= 1) {
        this.resize(width, height);
        this.redraw();
      }
    }).observe(this.element);
  }

  /**
   * @param {number} width
   * @param {number} height
   */
  resize(width, height) {
    this.width = width;
    this.height = height;
    setAttribute(this.element, "viewBox", `0 0 ${round(width)} ${round(height)}`);
  }

  /** Draw the content in the present size. */
  redraw() {}

  /** Clear the drawing; returns whether there is room to draw. */
  clear() {
    this.back.replaceChildren();
    this.font = Number.parseFloat(getComputedStyle(this.element).fontSize) || 12;
    return this.width >= 60 && this.height >= 20;
  }

  /**
   * A text behind the drawing.
   * @param {string} text
   * @param {number} x
   * @param {number} y
   * @param {string} anchor start, middle or end
   * @param {string} [name]
   */
  label(text, x, y, anchor, name = "tick") {
    this.back.append(draw("text", { x: round(x), y: round(y), "text-anchor": anchor, class: name, text }));
  }

  /**
   * A line behind the drawing.
   * @param {number} x1
   * @param {number} y1
   * @param {number} x2
   * @param {number} y2
   * @param {string} name
   */
  stroke(x1, y1, x2, y2, name) {
    this.back.append(draw("line", { x1: round(x1), y1: round(y1), x2: round(x2), y2: round(y2), class: name }));
  }

  /**
   * The horizontal grid lines, each with its value.
   * @param {number[]} ys in pixels
   * @param {string[]} words of each
   * @param {number} left
   * @param {number} right
   * @param {number} zero which of them is zero; -1: none
   */
  rows(ys, words, left, right, zero = -1) {
    const { font } = this;
    ys.forEach((y, index) => {
      this.stroke(left, y, right, y, index === zero ? "grid zero" : "grid");
      this.label(words[index], left - font * 0.45, y + font * 0.35, "end");
    });
  }
}

/**
 * The approximate width of a text: measuring it would cost a layout each time.
 * @param {string} text
 * @param {number} font
 */
export function textWidth(text, font) {
  return text.length * font * 0.63;
}

/**
 * A function from a range of values to a range of pixels; to its middle if the range has one value only.
 * @param {number} low
 * @param {number} high
 * @param {number} from
 * @param {number} to
 */
export function linear(low, high, from, to) {
  const scale = high === low ? 0 : (to - from) / (high - low);
  const start = high === low ? (from + to) / 2 : from;
  return (/** @type {number} */ value) => start + (value - low) * scale;
}

/**
 * The minimum and the maximum of some values; null if none is known.
 * @param {(number | null)[]} values
 * @returns {[number, number] | null}
 */
export function extent(values) {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values) {
    if (value !== null) {
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  return low <= high ? [low, high] : null;
}

/**
 * The path of a line through points, with a gap at unknown values.
 * @param {number[]} xs ascending
 * @param {(number | null)[]} ys
 * @param {(x: number) => number} across
 * @param {(y: number) => number} up
 * @param {number} [gap] the line is interrupted over so much of x
 */
export function path(xs, ys, across, up, gap = Infinity) {
  let text = "";
  ys.forEach((y, index) => {
    if (y !== null) {
      const isOn = index > 0 && ys[index - 1] !== null && xs[index] - xs[index - 1] <= gap;
      text += `${isOn ? "L" : "M"}${round(across(xs[index]))} ${round(up(y))}`;
    }
  });
  return text;
}

/** @param {number} pixels */
export function round(pixels) {
  return Math.round(pixels * 10) / 10;
}
