// @ts-check
// The values of a drawing at the pointer, and with the arrow keys: a slider under the drawing, for keys and
// screen readers, moves the same mark.

import { make, setAttribute, setText, show } from "./dom.js";

/**
 * A drawing that can be read.
 * @typedef {{ element: Element, stops: () => number, nearest: (share: number) => number,
 *             markAt: (index: number | null) => string }} Readable
 * `stops`: how many points have values; `nearest`: the point at this share of the width, from the left;
 * `markAt`: mark one, or none, and return its values in words
 */

export class Pointer {
  /**
   * @param {Readable} drawing
   * @param {string} name what a screen reader calls the slider
   */
  constructor(drawing, name) {
    this.drawing = drawing;
    /** @type {number | null} the marked point */
    this.at = null;
    this.words = make("p", { class: "pointer-words", "aria-hidden": "true", hidden: "" });
    this.slider = /** @type {HTMLInputElement} */ (
      make("input", { class: "pointer-slider", type: "range", min: "0", max: "0", step: "1", "aria-label": name })
    );
    for (const kind of ["pointermove", "pointerdown"]) {
      drawing.element.addEventListener(kind, (event) => this.point(/** @type {PointerEvent} */ (event)));
    }
    drawing.element.addEventListener("pointerleave", () => this.set(null));
    this.slider.addEventListener("focus", () => this.set(Number(this.slider.value)));
    this.slider.addEventListener("input", () => this.set(Number(this.slider.value)));
    this.slider.addEventListener("blur", () => this.set(null));
    this.slider.addEventListener("keydown", (event) => {
      if (event.key === "Escape") {
        this.set(null);
      }
    });
  }

  /** @param {PointerEvent} event */
  point(event) {
    const { left, width } = this.drawing.element.getBoundingClientRect();
    if (width > 0 && this.drawing.stops() > 0) {
      this.set(this.drawing.nearest((event.clientX - left) / width));
    }
  }

  /** @param {number | null} index */
  set(index) {
    const stops = this.drawing.stops();
    this.at = index === null || stops === 0 ? null : Math.max(0, Math.min(index, stops - 1));
    const words = this.drawing.markAt(this.at);
    show(this.words, this.at !== null);
    setText(this.words, words);
    if (this.at !== null) {
      setAttribute(this.slider, "max", String(stops - 1));
      this.slider.value = String(this.at);
      setAttribute(this.slider, "aria-valuetext", words);
    }
  }

  /** Redraw the mark after a change of the drawing under it. */
  redraw() {
    if (this.at !== null) {
      this.set(this.at);
    }
  }
}

/**
 * The index of the nearest of ascending values; there has to be at least one.
 * @param {number[]} values
 * @param {number} wanted
 */
export function nearestOf(values, wanted) {
  let low = 0;
  let high = values.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (values[middle] <= wanted) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return wanted - values[low] <= values[high] - wanted ? low : high;
}
