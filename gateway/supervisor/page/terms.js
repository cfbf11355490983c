// @ts-check
// What temperature and other axes add to the table of an axis: a line for each, and how well it is known.

import { make, setAttribute, setSign, setText, show, sign } from "./dom.js";
import { NOT_KNOWN, correctionText, fixed, scaleOf, span } from "./figures.js";
import { otherAxes, sensor } from "./words.js";
import { t } from "./language.js";

/**
 * @typedef {import("./model.js").Terms} TermsOf
 * @typedef {import("./figures.js").Scale} Scale
 */

/** One line: a name, what is added, and below it a word where that is not what it should be. */
class Row {
  constructor() {
    this.name = make("dt");
    this.added = make("dd");
    this.sign = sign("wait");
    this.words = make("span");
    this.state = make("dd", { class: "term-state" }, this.sign, this.words);
    this.element = make("div", { class: "term" }, this.name, this.added, this.state);
  }

  /**
   * @param {string} name
   * @param {string} added
   * @param {import("./words.js").State | null} state null: there is nothing to say
   */
  show(name, added, state) {
    setText(this.name, name);
    setText(this.added, added);
    show(this.state, state !== null);
    setText(this.words, state?.words ?? "");
    if (state !== null) {
      setAttribute(this.state, "class", `term-state state ${state.tone}`);
      setSign(this.sign, state.sign);
    }
  }
}

/** The lines of one axis; made for the axes that have any. */
export class Terms {
  /** @param {Element} above the lines stand below it */
  constructor(above) {
    this.thermal = new Row();
    this.cross = new Row();
    this.limit = new Row();
    above.after(this.thermal.element, this.cross.element, this.limit.element);
  }

  /**
   * @param {TermsOf | null | undefined} terms
   * @param {string} units of the axis
   */
  show(terms, units) {
    const scale = scaleOf(units);
    const { thermal, cross } = terms ?? {};
    show(this.thermal.element, Boolean(thermal));
    if (thermal) {
      const { celsius, age_s: age, correction = null } = thermal;
      const degrees = celsius === null ? "" : `${fixed(celsius, 1)}\u202f°C`;
      const silence = age === null ? "" : t(" for {span}", { span: span(age) });
      const state = sensor(thermal.state, thermal.is_silent, celsius !== null, silence, isAdded(correction));
      this.thermal.show(t("Temperature"), words(degrees, adds(correction, scale)), state);
    }
    show(this.cross.element, Boolean(cross));
    if (cross) {
      const name = `${cross.axes.length === 1 ? t("Axis") : t("Axes")} ${cross.axes.join(", ")}`;
      this.cross.show(name, words(adds(cross.correction, scale)), otherAxes(cross.state, isAdded(cross.correction)));
    }
    show(this.limit.element, Boolean(terms?.is_too_large));
    this.limit.show(t("Limit"), t("reached"), {
      words: t("at max_correction: not followed"),
      sign: "warning",
      tone: "warning",
    });
  }
}

/** @param {number | null} correction */
function isAdded(correction) {
  return correction !== null && correction !== 0;
}

/**
 * @param {number | null} correction
 * @param {Scale} scale
 */
function adds(correction, scale) {
  return correction === null ? "" : t("adds {correction}", { correction: correctionText(correction, scale) });
}

/** @param {...string} parts */
function words(...parts) {
  return parts.filter(Boolean).join(" ") || NOT_KNOWN;
}
