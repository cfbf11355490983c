// @ts-check
// What temperature and other axes add to the table of an axis: a line for each, with its state.

import { Figure, SignedWords, setAttribute, setText, show } from "./dom.js";
import { NOT_KNOWN, correctionText, fixed, scaleOf, span } from "./figures.js";
import { otherAxes, sensor } from "./words.js";
import { t } from "./language.js";

/**
 * @typedef {import("./figures.js").Scale} Scale
 *
 * @typedef {{ state: string, celsius: number | null, age_s: number | null, difference: number,
 *             correction: number | null, is_silent: boolean }} ThermalTerm
 *
 * @typedef {{ state: string, axes: string[], correction: number | null }} CrossTerm
 *
 * @typedef {{ correction: number | null, is_too_large: boolean, thermal?: ThermalTerm,
 *             cross?: CrossTerm }} TermsOf what is added to the table; corrections in the unit of the axis
 */

/** One line: a name, what is added, and below it a word if something is wrong. */
class Row extends Figure {
  constructor() {
    super();
    this.state = new SignedWords("dd", "term-state state");
    this.element.append(this.state.element);
    setAttribute(this.element, "class", "term");
  }

  /**
   * @param {string} name
   * @param {string | null} added null: the line is not shown
   * @param {import("./words.js").State | null} state null: there is no text
   */
  say(name, added, state) {
    setText(this.name, name);
    this.show(added);
    show(this.state.element, state !== null);
    if (state !== null) {
      this.state.show(state);
    }
  }
}

/** The lines of one axis; made only for axes with terms. */
export class Terms {
  /** @param {Element} above the lines are below it */
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
      this.thermal.say(t("Temperature"), words(degrees, adds(correction, scale)), state);
    }
    show(this.cross.element, Boolean(cross));
    if (cross) {
      const name = `${cross.axes.length === 1 ? t("Axis") : t("Axes")} ${cross.axes.join(", ")}`;
      this.cross.say(name, words(adds(cross.correction, scale)), otherAxes(cross.state, isAdded(cross.correction)));
    }
    const isTooLarge = { words: t("at max_correction: not followed"), sign: "warning", tone: "warning" };
    this.limit.say(t("Limit"), terms?.is_too_large ? t("reached") : null, isTooLarge);
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
