// @ts-check
// The events, newest first. New ones do not move a list that is scrolled down.

import { byId, make, setText, show, sign } from "./dom.js";
import { timeOfDay } from "./figures.js";
import { about, capital, event as eventWords, whereOf } from "./words.js";
import { t } from "./language.js";

/** @typedef {import("./model.js").Happening} Happening */

export const MOST = 200;

/** @type {Record<string, { level: number, sign: string, words: string }>} */
const SEVERITIES = {
  info: { level: 0, sign: "info", words: "" },
  warning: { level: 1, sign: "warning", words: `${t("Warning")}: ` },
  error: { level: 2, sign: "error", words: `${t("Error")}: ` },
};

export class EventList {
  constructor() {
    this.frame = byId("events-frame");
    this.list = byId("events");
    this.none = byId("no-events");
    this.least = 0;
    /** @type {{ key: string, level: number, element: HTMLElement }[]} newest first */
    this.items = [];
    /** @type {Set<string>} */
    this.keys = new Set();
    /** @type {HTMLElement[]} came while the list was not visible; newest first */
    this.coming = [];
    byId("filter").addEventListener("change", (changed) => {
      const value = /** @type {HTMLInputElement} */ (changed.target).value;
      this.least = SEVERITIES[value]?.level ?? 0;
      for (const item of this.items) {
        show(item.element, item.level >= this.least);
      }
      this.frame.scrollTop = 0;
      this.showNone();
    });
  }

  /** @param {Happening} happening */
  add(happening) {
    const key = `${happening.time} ${happening.number}`;
    if (this.keys.has(key)) {
      return; // repeated after a reconnect
    }
    this.keys.add(key);
    this.put(key, SEVERITIES[happening.severity]?.level ?? 0, itemOf(happening));
  }

  /** @param {number} count how many the gateway dropped */
  addMissed(count) {
    const element = make("li", { class: "event info", text: t("{count} events were left out: they came too fast.", { count }) });
    this.put(`missed ${performance.now()}`, 2, element);
  }

  /**
   * @param {string} key
   * @param {number} level
   * @param {HTMLElement} element
   */
  put(key, level, element) {
    show(element, level >= this.least);
    this.items.unshift({ key, level, element });
    this.coming.unshift(element);
    for (const old of this.items.splice(MOST)) {
      old.element.remove();
      this.keys.delete(old.key);
    }
  }

  /** Draw all new events together. */
  draw() {
    if (this.coming.length === 0) {
      return;
    }
    const { scrollTop, scrollHeight } = this.frame;
    this.list.prepend(...this.coming.slice(0, MOST));
    this.coming = [];
    if (scrollTop > 0) {
      this.frame.scrollTop = scrollTop + this.frame.scrollHeight - scrollHeight;
    }
    this.showNone();
  }

  showNone() {
    const isEmpty = !this.items.some((item) => item.level >= this.least);
    setText(this.none, this.least ? t("Nothing of this kind.") : t("Nothing has happened yet."));
    show(this.none, isEmpty);
  }
}

/** @param {Happening} happening */
function itemOf(happening) {
  const severity = SEVERITIES[happening.severity] ?? SEVERITIES.info;
  const where = whereOf(happening);
  const words = about(happening);
  return make(
    "li",
    { class: `event ${Object.hasOwn(SEVERITIES, happening.severity) ? happening.severity : "info"}` },
    sign(severity.sign),
    make("time", { datetime: happening.time, title: happening.time, text: timeOfDay(happening.time) }),
    make(
      "p",
      {},
      make("span", { class: "unseen", text: severity.words }),
      make("strong", { text: eventWords(happening.event) }),
      where ? make("span", { class: "where", text: capital(where) }) : null,
      words ? make("span", { class: "words", text: words }) : null,
    ),
  );
}
