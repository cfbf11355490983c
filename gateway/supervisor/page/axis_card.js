// @ts-check
// One axis: what it does, where it is, its correction and its table.

import { extent } from "./chart.js";
import { Curve } from "./curve.js";
import { Figure, SignedWords, heading, make, newId, setAttribute, setSign, setText, show, sign } from "./dom.js";
import { correctionText, fixed, positionText, scaleOf, span, timeOfDay } from "./figures.js";
import { History } from "./history.js";
import { Terms } from "./terms.js";
import { compensation, direction, table as tableState, verdict } from "./words.js";
import { t } from "./language.js";

/**
 * @typedef {import("./figures.js").Scale} Scale
 * @typedef {import("./model.js").Table} Table
 * @typedef {import("./model.js").Times} Times
 * @typedef {import("./terms.js").TermsOf} TermsOf
 *
 * @typedef {{ file: string | null, line: number | null, column: number | null, key: string, found: string,
 *             remedy: string }} Problem
 *
 * @typedef {{ file: string | null, format: string | null, compiled: string | null, points: number,
 *             status: string, error: string | null, loaded_at: string | null, problems?: Problem[] }} TableState
 *
 * @typedef {{ state: string, kind: string, title: string, since: string }} AxisVerdict the verdict on an axis; `title` is
 *             empty where the state of the compensation is enough
 *
 * @typedef {{ of: string | null, nominal: number | null, corrected: number | null, age_s: number | null,
 *             is_at_least: boolean }} Position the best known position: a reading, the last reading or
 *             the target; null: unknown
 *
 * @typedef {{ compensation: string, units: string, direction: string, correction: number | null,
 *             gain: { forward: number, backward: number }, travel: [number, number] | null,
 *             nominal_setpoint: number | null, corrected_setpoint: number | null,
 *             nominal_actual: number | null, corrected_actual: number | null, table: TableState,
 *             writer?: string | null, terms?: TermsOf | null, verdict: AxisVerdict, position: Position,
 *             latency: { gateway_us: Times, budget_us: number, budget_overruns: number,
 *                        is_over_budget: boolean } }} Axis
 */

const LONG = 8; // digits that fit a narrow card in the largest size

/** @type {[string, (axis: Axis, scale: Scale) => string | null][]} the figures below the position; null: not shown */
const FIGURES = [
  [t("Correction"), (axis, scale) => correctionText(correctionOf(axis), scale)],
  [t("On the drive"), ({ position }, scale) => positionText(position.corrected, scale)],
  [t("Target"), (axis, scale) => (axis.position.of === "target" ? null : positionText(axis.nominal_setpoint, scale))],
  [t("Moved by"), ({ writer }) => writer || null],
  [t("Gain"), ({ gain }) => gainText(gain)],
];

export class AxisCard {
  /** @param {string} name */
  constructor(name) {
    this.name = name;
    /** @type {Axis | null} */
    this.axis = null;
    /** @type {Table | null} */
    this.table = null;
    this.shownCurve = "";
    this.curve = new Curve(name);
    this.history = new History(name);
    this.since = make("span", { class: "since" });
    this.state = new SignedWords("p", "state", this.since);
    this.positionName = make("span", { class: "reading-name", text: t("Position") });
    this.position = make("span", { class: "digits" });
    this.units = make("span", { class: "units" });
    this.big = make("p", { class: "position" }, this.position, this.units);
    this.direction = new SignedWords("p", "direction");
    this.figures = FIGURES.map(([words]) => new Figure(words));
    /** @type {Terms | null} */
    this.terms = null;
    this.tableSign = sign("info");
    this.tableName = make("span", { class: "file" });
    this.tableWords = make("span", { class: "file-state" });
    this.problems = make("ul", { class: "problems" });
    this.noCurve = make("p", { class: "no-curve quiet" });
    this.valuesBody = make("tbody");
    this.valuesHead = make("tr");
    this.values = make("details", { class: "values" }, make("summary", { text: t("Values of the table") }));
    this.element = this.laidOut();
    this.values.addEventListener("toggle", () => this.fillValues());
  }

  laidOut() {
    const title = newId("axis");
    const frame = make(
      "div",
      { class: "values-frame", tabindex: "0", role: "region", "aria-label": t("Values of the table of axis {axis}", { axis: this.name }) },
      make("table", {}, make("thead", {}, this.valuesHead), this.valuesBody),
    );
    this.values.append(frame);
    return make(
      "article",
      { class: "card axis", "aria-labelledby": title },
      make(
        "header",
        { class: "card-head" },
        heading(t("Axis"), this.name, { id: title }),
        this.state.element,
      ),
      make(
        "div",
        { class: "axis-body" },
        make(
          "div",
          { class: "readings" },
          make("div", { class: "reading-head" }, this.positionName, this.direction.element),
          this.big,
          make("dl", { class: "facts" }, ...this.figures.map((figure) => figure.element)),
          this.history.figure,
        ),
        make("figure", { class: "curve" }, this.curve.frame, this.noCurve, this.legend()),
      ),
      make(
        "footer",
        { class: "table-state" },
        make("p", {}, this.tableSign, this.tableName, this.tableWords),
        this.problems,
        this.values,
      ),
    );
  }

  legend() {
    return make(
      "figcaption",
      { class: "legend", "aria-hidden": "true" },
      make("span", { class: "key-forward", text: t("forward") }),
      make("span", { class: "key-backward", text: t("backward") }),
      make("span", { class: "key-machine", text: t("machine") }),
      make("span", { class: "key-outside", text: t("no table") }),
    );
  }

  leave() {
    this.element.remove();
  }

  /**
   * @param {Axis} axis
   * @param {number} now
   */
  show(axis, now) {
    this.axis = axis;
    const scale = scaleOf(axis.units);
    const state = stateOf(axis);
    const { position } = axis;
    const isRead = position.of === "reading";
    setAttribute(this.element, "data-tone", state.tone);
    setAttribute(this.element, "data-known", isRead ? "yes" : "no");
    this.state.show(state);
    setText(this.since, t("since {time}", { time: timeOfDay(axis.verdict.since) }));

    setText(this.positionName, nameOf(position));
    const digits = fixed(position.nominal, scale.decimals);
    setText(this.position, digits);
    setAttribute(this.big, "class", digits.length > LONG ? "position long" : "position");
    setText(this.units, scale.units);
    this.direction.show(direction(axis.direction));
    FIGURES.forEach(([, textOf], index) => this.figures[index].show(textOf(axis, scale)));
    if (axis.terms) {
      this.terms ??= new Terms(this.figures[0].element);
    }
    this.terms?.show(axis.terms, axis.units);
    this.showTable(axis);
    this.showCurve(axis);
    const correction = correctionOf(axis);
    this.curve.move(this.placeOf(position.nominal, correction));
    this.history.add(isRead ? position.nominal : null, isRead ? correction : null, now, scale);
  }

  /**
   * Show the machine's position on its table; a rotary axis repeats after a turn.
   * @param {number | null} nominal
   * @param {number | null} correction
   */
  placeOf(nominal, correction) {
    if (nominal === null || this.table === null) {
      return null;
    }
    const turn = this.table.modulo ?? 0;
    const start = this.table.positions[0];
    const position = turn > 0 ? start + ((((nominal - start) % turn) + turn) % turn) : nominal;
    return { position, correction: correction ?? 0 };
  }

  /** @param {Axis} axis */
  showTable(axis) {
    const its = axis.table;
    const state = tableState(its.status);
    setSign(this.tableSign, state.sign, state.tone);
    setText(this.tableName, its.file ?? "");
    const without = its.status === "none" ? t("No table is configured") : t("No table: backlash alone");
    const parts = [its.file === null ? without : state.words];
    if (its.points && its.file !== null) {
      parts.push(t("{count} points", { count: its.points }));
    }
    if (its.loaded_at) {
      parts.push(t("loaded {time}", { time: timeOfDay(its.loaded_at) }));
    }
    setText(this.tableWords, parts.join(" · "));
    const problems = (its.problems ?? []).map(sentence);
    if (!problems.length && its.error) {
      problems.push(its.error);
    }
    const key = problems.join("\n");
    if (this.problems.dataset.key !== key) {
      this.problems.dataset.key = key;
      this.problems.replaceChildren(...problems.map((text) => make("li", { text })));
    }
  }

  /** @param {Table | null} table as received; null: there is none */
  take(table) {
    this.table = table;
    this.shownCurve = "";
    if (this.axis !== null) {
      this.show(this.axis, performance.now());
    }
    this.fillValues();
  }

  /** @param {Axis} axis */
  showCurve(axis) {
    const hasTable = axis.table.points > 0;
    setText(this.noCurve, hasTable ? t("The curve is being fetched.") : t("No table: positions pass as they are."));
    const has = this.table !== null && this.table.positions.length > 1;
    show(this.noCurve, !has);
    setAttribute(this.element, "data-curve", has ? "yes" : "no");
    const key = has ? `${axis.units} ${axis.travel}` : "none";
    if (key === this.shownCurve) {
      return;
    }
    this.shownCurve = key;
    if (this.table === null || !has) {
      this.curve.show(null);
      show(this.values, false);
      return;
    }
    show(this.values, true);
    const { table } = this;
    const scale = scaleOf(axis.units);
    const travel = table.travel === undefined ? axis.travel : table.travel;
    this.curve.show({ table, travel, scale });
    this.fillValues();
    setText(this.curve.title, t("Correction of axis {axis} over its travel", { axis: this.name }));
    const last = table.positions[table.positions.length - 1];
    const isShort = travel !== null && (travel[0] < table.positions[0] || travel[1] > last);
    setAttribute(this.element, "data-outside", isShort ? "yes" : "no");
    setText(
      this.curve.description,
      t("{count} points from {low} to {high} {units}. Forward {forward}, backward {backward}. The values are below, under Values of the table.", {
        count: axis.table.points,
        low: fixed(table.positions[0], scale.decimals),
        high: fixed(last, scale.decimals),
        units: scale.units,
        forward: range(table.forward, scale),
        backward: range(table.backward, scale),
      }),
    );
  }

  fillValues() {
    const isOpen = /** @type {HTMLDetailsElement} */ (this.values).open;
    if (!isOpen || this.table === null || this.axis === null) {
      this.valuesBody.replaceChildren();
      return;
    }
    const scale = scaleOf(this.axis.units);
    const { positions, forward, backward } = this.table;
    const heads = [`${t("Position")} ${scale.units}`, `${t("Forward")} ${scale.small}`, `${t("Backward")} ${scale.small}`];
    this.valuesHead.replaceChildren(...heads.map((text) => make("th", { scope: "col", text })));
    this.valuesBody.replaceChildren(
      ...positions.map((position, index) =>
        make(
          "tr",
          {},
          make("th", { scope: "row", text: fixed(position, scale.decimals) }),
          make("td", { text: fixed(forward[index] * scale.perUnit, scale.smallDecimals, true) }),
          make("td", { text: fixed(backward[index] * scale.perUnit, scale.smallDecimals, true) }),
        ),
      ),
    );
  }
}

/**
 * The verdict on an axis, in words. Without a title it is the state of the compensation.
 * @param {Axis} axis
 * @returns {import("./words.js").State}
 */
function stateOf({ verdict: found, compensation: state }) {
  const of = compensation(state);
  const { sign: name, tone } = verdict(found.state);
  const isOwn = !found.title && (found.state === "healthy" || of.tone === tone);
  return { words: found.title ? t(found.title) : of.words, sign: isOwn ? of.sign : name, tone };
}

/**
 * The label of the large number.
 * @param {Position} position
 */
function nameOf({ of, age_s: age, is_at_least: isAtLeast }) {
  if (of === "reading") {
    return t("Position");
  }
  if (of === null || age === null) {
    return t("Position not known");
  }
  const time = isAtLeast ? t("more than {span}", { span: span(age) }) : span(age);
  return of === "target" ? t("Target of {span} ago (position not read)", { span: time }) : t("Last seen {span} ago", { span: time });
}

/**
 * The correction at the displayed position. It is that of the last target if the position is not read, and in shadow
 * mode, where the drive does not have it.
 * @param {Axis} axis
 */
function correctionOf({ position, compensation: state, correction }) {
  const { of, nominal, corrected } = position;
  const isRead = of === "reading" || of === "last-reading";
  return isRead && state !== "shadow" && nominal !== null && corrected !== null ? corrected - nominal : correction;
}

/** @param {Axis["gain"]} gain */
function gainText({ forward, backward }) {
  if (forward !== backward) {
    return t("× {forward} forward, × {backward} backward", { forward, backward });
  }
  return forward === 1 ? null : `× ${forward}`;
}

/** @param {Problem} problem */
function sentence(problem) {
  const place = [problem.file, problem.line, problem.column].filter((part) => part !== null && part !== "").join(":");
  return [place, problem.key, [problem.found, problem.remedy].filter(Boolean).join("; ")].filter(Boolean).join(": ");
}

/**
 * @param {number[]} values
 * @param {Scale} scale
 */
function range(values, scale) {
  const [low, high] = (extent(values) ?? []).map((value) => fixed(value * scale.perUnit, scale.smallDecimals, true));
  return t("from {low} to {high} {units}", { low, high, units: scale.small });
}
