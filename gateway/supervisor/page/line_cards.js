// @ts-check
// Each line: the state of its drives, its traffic, and its errors.

import { Figure, SignedWords, heading, keepChildren, make, setAttribute, setSign, setText, show, sign } from "./dom.js";
import { NOT_KNOWN, count, rounded, span, time } from "./figures.js";
import { STALE_S } from "./model.js";
import { t } from "./language.js";

/**
 * @typedef {import("./model.js").Times} Times
 * @typedef {import("./words.js").State} State
 * @typedef {{ name: string, role: string, address: string | string[], connections?: string[], state?: string,
 *             failure?: string, asked_s?: number | null, silent_s?: number, gateway_us: Times,
 *             tls?: { sessions?: { subject: string, certified: string }[] } }} Controller
 *
 * @typedef {{ silent_s: number | null, answered_s: number | null }} Drive
 *
 * @typedef {{ state: string, exchanges: number, timeouts: number, crc_errors: number, exceptions: number,
 *             late: number, refused?: number, unit_ids?: { axes: Record<string, number>, drives?: Record<string, Drive> },
 *             budget_overruns?: number, gateway_us: Times, controllers: Controller[],
 *             drives: { address: string, failure: string } }} Line
 *
 * @typedef {"timeouts" | "crc_errors" | "exceptions" | "late" | "refused"} Counter
 */

/** @type {[Counter, string][]} */
const COUNTERS = [
  ["timeouts", t("Time-outs")],
  ["crc_errors", t("CRC errors")],
  ["exceptions", t("Exceptions")],
  ["refused", t("Refused")],
  ["late", t("Late")],
];
const UNKNOWN = { words: t("Not known"), sign: "wait", tone: "note" };
const GOOD = { words: "", sign: "ok", tone: "well" };
const AWAY = { words: "", sign: "off", tone: "note" };
const BROKEN = { words: "", sign: "error", tone: "error" };
/** @type {Record<string, State>} */
const OF_SEVERITY = { error: BROKEN, warning: { words: "", sign: "warning", tone: "warning" } };
const OF_ALL = new Set(["controller-absent", "controller-silent"]); // of all motion controllers of a line together
const QUIET_S = 5;
const RATE_MS = 3000;
const FRESH_MS = 60_000;

export class LineCard {
  /** @param {string} name */
  constructor(name) {
    this.state = new SignedWords("p", "state");
    this.drives = make("p", { class: "drives" });
    this.rate = new Figure(t("Exchanges/s"));
    this.counters = new Map(COUNTERS.map(([key, words]) => [key, new Figure(words)]));
    this.list = make("ul", { class: "controllers" });
    /** @type {Map<string, ControllerRow>} */
    this.controllers = new Map();
    /** @type {{ at: number, exchanges: number }[]} */
    this.seen = [];
    /** @type {Map<Counter, { value: number, changed: number }>} */
    this.last = new Map();
    this.name = name;
    this.element = make(
      "article",
      { class: "card line" },
      make("header", { class: "card-head" }, heading(t("Line"), name), this.state.element),
      this.drives,
      make("dl", { class: "counts" }, ...[this.rate, ...this.counters.values()].map((figure) => figure.element)),
      this.list,
    );
  }

  /**
   * @param {Line} line
   * @param {number} now in ms
   * @param {boolean} isKnown whether the gateway's data are current
   * @param {import("./model.js").Trouble[]} troubles
   */
  show(line, now, isKnown, troubles) {
    const state = isKnown ? stateOfLine(line, this.troublesOf(troubles)) : UNKNOWN;
    this.state.show(state);
    setAttribute(this.element, "data-tone", state.tone);
    const failure = line.drives.failure ? `: ${line.drives.failure}` : "";
    setText(this.drives, t("Drives at {address}{failure}", { address: line.drives.address, failure }));
    const rate = this.rateOf(line.exchanges, now);
    this.rate.show(rate === null ? NOT_KNOWN : rounded(rate, 10));
    for (const [key, figure] of this.counters) {
      this.showCounter(key, figure, line[key] ?? 0, now);
    }
    const byName = new Map(line.controllers.map((controller) => [controller.name, controller]));
    keepChildren(this.list, this.controllers, [...byName.keys()], () => new ControllerRow(), (row) => row.element);
    for (const [name, controller] of byName) {
      const where = `line ${this.name}, controller ${name}`;
      const isMissed = controller.role === "motion";
      const trouble = troubles.find(
        (each) => each.where === where || (isMissed && OF_ALL.has(each.kind) && each.where === `line ${this.name}`),
      );
      this.controllers.get(name)?.show(controller, isKnown, trouble);
    }
  }

  /**
   * The alarms of this line, with those of its controllers and unit ids.
   * @param {import("./model.js").Trouble[]} troubles
   */
  troublesOf(troubles) {
    const where = `line ${this.name}`;
    return troubles.filter((each) => each.where === where || each.where.startsWith(`${where}, `));
  }

  /**
   * Exchanges per second, over the last few seconds.
   * @param {number} exchanges
   * @param {number} now
   */
  rateOf(exchanges, now) {
    const newest = this.seen[this.seen.length - 1];
    if (newest && exchanges < newest.exchanges) {
      this.seen = []; // the relay was restarted
    }
    this.seen.push({ at: now, exchanges });
    while (this.seen.length > 2 && now - this.seen[1].at > RATE_MS) {
      this.seen.shift();
    }
    const oldest = this.seen[0];
    const seconds = (now - oldest.at) / 1000;
    return seconds < 0.5 ? null : (exchanges - oldest.exchanges) / seconds;
  }

  /**
   * @param {Counter} key
   * @param {Figure} figure
   * @param {number} value
   * @param {number} now
   */
  showCounter(key, figure, value, now) {
    const last = this.last.get(key) ?? { value, changed: -Infinity };
    if (value > last.value) {
      last.changed = now;
    }
    last.value = value;
    this.last.set(key, last);
    figure.show(count(value));
    const isFresh = now - last.changed < FRESH_MS;
    setAttribute(figure.value, "class", isFresh ? "fresh" : value ? "some" : "");
    setAttribute(figure.value, "title", isFresh ? t("more within the last minute") : t("since the start of the gateway"));
  }
}

class ControllerRow {
  constructor() {
    this.sign = sign("info");
    this.name = make("strong");
    this.role = make("span", { class: "quiet" });
    this.state = make("span", { class: "controller-state" });
    this.address = make("span", { class: "quiet address" });
    this.element = make("li", {}, this.sign, make("p", {}, this.name, this.role, this.state, this.address));
  }

  /**
   * @param {Controller} controller
   * @param {boolean} isKnown
   * @param {import("./model.js").Trouble} [trouble]
   */
  show(controller, isKnown, trouble) {
    const connections = controller.connections;
    const isUp = connections === undefined ? controller.state === "up" : connections.length > 0;
    const isWrong = connections === undefined && !isUp;
    const state = !isKnown ? UNKNOWN : isWrong ? BROKEN : trouble ? OF_SEVERITY[trouble.severity] ?? BROKEN : isUp ? GOOD : AWAY;
    setSign(this.sign, state.sign, state.tone);
    setText(this.name, controller.name);
    setText(this.role, controller.tls ? t("by certificate") : t(controller.role));
    const isGarbled = trouble?.kind === "controller-garbled";
    setText(this.state, !isKnown ? t("not known") : `${isGarbled ? `${t("not understood")}: ` : ""}${stateOf(controller)}${quietOf(controller)}`);
    const address = Array.isArray(controller.address) ? controller.address.join(", ") : controller.address;
    setText(this.address, address);
    setAttribute(this.element, "title", t("time in the gateway: p99 {time}", { time: time(controller.gateway_us.p99) }));
    show(this.address, address !== "");
  }
}

/**
 * @param {Line} line
 * @param {import("./model.js").Trouble[]} troubles of this line, worst first
 * @returns {State}
 */
function stateOfLine(line, troubles) {
  if (line.state !== "up") {
    return { words: t("Down"), sign: "error", tone: "error" };
  }
  const own = Object.entries(line.unit_ids?.drives ?? {}).filter(([unitId]) =>
    Object.values(line.unit_ids?.axes ?? {}).some((of) => String(of) === unitId),
  );
  const silent = own.filter(([, drive]) => drive.silent_s !== null && drive.silent_s >= STALE_S).length;
  if (silent) {
    return { words: t("{count} of {all} drives silent", { count: silent, all: own.length }), sign: "error", tone: "error" };
  }
  if (troubles.length) {
    return { ...(OF_SEVERITY[troubles[0].severity] ?? BROKEN), words: t("Drives up") };
  }
  return { words: t("Up"), sign: "ok", tone: "well" };
}

/**
 * The time since the last request of a quiet controller.
 * @param {Controller} controller
 */
function quietOf({ asked_s: asked, silent_s: silent }) {
  if (silent === undefined || silent < QUIET_S) {
    return "";
  }
  return asked === null ? t(", has not asked yet") : t(", asked last {span} ago", { span: span(silent) });
}

/** @param {Controller} controller */
function stateOf(controller) {
  const { connections, state, failure } = controller;
  if (connections === undefined) {
    return `${state === "up" ? t("port open") : t("port closed")}${failure ? `: ${failure}` : ""}`;
  }
  if (connections.length === 0) {
    return t("not connected");
  }
  const sessions = controller.tls?.sessions ?? [];
  const who = sessions.length ? `: ${sessions.map((session) => `${session.subject} (${session.certified})`).join(", ")}` : "";
  return `${connections.length === 1 ? t("connected") : t("{count} connections", { count: connections.length })}${who}`;
}
