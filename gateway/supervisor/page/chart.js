// @ts-check
// What both drawings share: their size, their letters, and the lines behind them.

import { draw } from "./dom.js";

/**
 * The room of a drawing, in pixels: `left` to `right` and `top` to `bottom` is where values go.
 * @typedef {{ width: number, height: number, left: number, right: number, top: number, bottom: number,
 *             font: number }} Room
 */

/**
 * @param {Element} element
 * @returns {number} size of its letters in pixels
 */
export function fontSize(element) {
  return Number.parseFloat(getComputedStyle(element).fontSize) || 12;
}

/**
 * About how wide a text is drawn: asking the browser would cost a layout for each.
 * @param {string} text
 * @param {number} font
 */
export function textWidth(text, font) {
  return text.length * font * 0.63;
}

/**
 * A function from a stretch of values to a stretch of pixels.
 * @param {number} low
 * @param {number} high
 * @param {number} from
 * @param {number} to
 */
export function linear(low, high, from, to) {
  const scale = high === low ? 0 : (to - from) / (high - low);
  return (/** @type {number} */ value) => from + (value - low) * scale;
}

/**
 * A text of a drawing.
 * @param {string} text
 * @param {number} x
 * @param {number} y
 * @param {string} anchor start, middle or end
 * @param {string} [name]
 */
export function label(text, x, y, anchor, name = "tick") {
  return draw("text", { x: round(x), y: round(y), "text-anchor": anchor, class: name, text });
}

/**
 * A line across.
 * @param {number} x1
 * @param {number} y1
 * @param {number} x2
 * @param {number} y2
 * @param {string} name
 */
export function stroke(x1, y1, x2, y2, name) {
  return draw("line", { x1: round(x1), y1: round(y1), x2: round(x2), y2: round(y2), class: name });
}

/**
 * The path of a line through points.
 * @param {number[]} xs
 * @param {number[]} ys
 * @param {(x: number) => number} across
 * @param {(y: number) => number} up
 */
export function path(xs, ys, across, up) {
  return xs.map((x, index) => `${index ? "L" : "M"}${round(across(x))} ${round(up(ys[index]))}`).join("");
}

/** @param {number} pixels */
export function round(pixels) {
  return Math.round(pixels * 10) / 10;
}
