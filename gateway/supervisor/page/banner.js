// @ts-check
// The gateway's verdict in one word, what is wrong and what to do, and whether the page has lost the gateway.

import { byId, keepChildren, make, setAttribute, setSentence, setSign, setText, show, sign } from "./dom.js";
import { span, timeOfDay } from "./figures.js";
import { acknowledged } from "./session.js";
import { capital, counted, verdict as inWords } from "./words.js";
import { place, said, t } from "./language.js";

const AT_FIRST = matchMedia("(max-width: 40rem)").matches ? 2 : 4; // the axes should stay visible

/**
 * @typedef {import("./model.js").Trouble} Trouble
 * @typedef {import("./model.js").Verdict} Verdict
 */

export class Banner {
  constructor() {
    this.list = byId("troubles");
    this.verdict = byId("verdict");
    this.lost = byId("lost");
    this.more = byId("more");
    this.sayAlert = byId("say-alert");
    this.sayStatus = byId("say-status");
    /** @type {Map<string, TroubleItem>} */
    this.items = new Map();
    this.mayAcknowledge = false;
    /** @type {Trouble[]} */
    this.troubles = [];
    /** @type {Set<string> | null} */
    this.said = null;
    this.isOpen = false;
    this.isLost = false;
    this.lostWhat = make("strong");
    this.lostHow = make("span", { class: "remedy" });
    this.lost.append(sign("error"), make("p", {}, this.lostWhat, this.lostHow));
    this.verdictSign = sign("wait");
    this.verdictWord = make("strong");
    this.verdictAbout = make("span", { class: "about" });
    this.verdict.append(this.verdictSign, this.verdictWord, this.verdictAbout);
    this.more.addEventListener("click", () => {
      this.isOpen = !this.isOpen;
      this.draw();
    });
  }

  /**
   * @param {Verdict} verdict
   * @param {Trouble[]} troubles worst first
   * @param {string} about what the gateway has, as `2 lines, 3 axes`
   */
  show(verdict, troubles, about) {
    this.troubles = troubles;
    const { words, sign: name, tone } = inWords(verdict.state);
    setAttribute(this.verdict, "class", `verdict ${tone}`);
    setSign(this.verdictSign, name);
    setText(this.verdictWord, words);
    setText(this.verdictAbout, `${t("since {time}", { time: timeOfDay(verdict.since) })} · ${wrongs(verdict) || about}`);
    this.say(`${words}: ${about}.`);
    this.draw();
  }

  /**
   * @param {number | null} silentMs for how long nothing has been received; null: data come
   * @param {boolean} hasModel whether anything was ever received
   */
  showSilence(silentMs, hasModel) {
    const isLost = silentMs !== null;
    if (isLost) {
      const age = span(silentMs / 1000);
      setText(this.lostWhat, hasModel ? t("The gateway does not answer. What is shown is {span} old.", { span: age }) : t("The gateway does not answer."));
      setText(this.lostHow, t("Is it running, and is the network there? This page tries again automatically."));
    }
    if (isLost !== this.isLost) {
      this.isLost = isLost;
      setText(this.sayAlert, isLost ? t("The gateway does not answer.") : "");
      setText(this.sayStatus, isLost ? "" : t("The gateway answers again."));
      this.draw();
    }
  }

  draw() {
    show(this.lost, this.isLost);
    show(this.verdict, !this.isLost && this.said !== null);
    const seen = this.isOpen ? this.troubles : this.troubles.slice(0, AT_FIRST);
    const hidden = this.troubles.length - Math.min(this.troubles.length, AT_FIRST);
    /** @type {Map<string, Trouble>} */
    const byKey = new Map();
    for (const trouble of seen) {
      let key = keyOf(trouble);
      while (byKey.has(key)) {
        key += "+";
      }
      byKey.set(key, trouble);
    }
    keepChildren(this.list, this.items, [...byKey.keys()], () => new TroubleItem(), (item) => item.element);
    for (const [key, trouble] of byKey) {
      this.items.get(key)?.show(trouble, this.mayAcknowledge);
    }
    show(this.more, hidden > 0);
    setText(this.more, this.isOpen ? t("Show fewer") : t("Show {count} more", { count: hidden }));
    setAttribute(this.more, "aria-expanded", String(this.isOpen));
  }

  /** Offer to acknowledge alarms: the user has the right to. */
  allow() {
    this.mayAcknowledge = true;
    this.draw();
  }

  /**
   * Announce new alarms to screen readers, but not changes of their words only.
   * @param {string} noTrouble announced when the last alarm is over
   */
  say(noTrouble) {
    const now = new Set(this.troubles.map(keyOf));
    const before = this.said;
    this.said = now;
    const fresh = this.troubles.filter((trouble) => !before?.has(keyOf(trouble)));
    if (fresh.length) {
      const isError = fresh.some((trouble) => trouble.severity === "error");
      const words = fresh.slice(0, AT_FIRST).map((trouble) => `${capital(place(trouble.where))}: ${said(trouble.says, trouble.what)}. ${t(trouble.remedy)}.`);
      setText(isError ? this.sayAlert : this.sayStatus, words.join(" ").replaceAll("`", ""));
    } else if (now.size === 0 && before?.size) {
      setText(this.sayAlert, "");
      setText(this.sayStatus, noTrouble);
    }
  }
}

class TroubleItem {
  constructor() {
    this.where = make("strong", { class: "where" });
    this.what = make("span", { class: "what" });
    this.remedy = make("span", { class: "remedy" });
    this.since = make("span", { class: "since" });
    this.kind = make("span", { class: "unseen" });
    this.sign = sign("warning");
    this.seen = make("span", { class: "seen", hidden: "" });
    this.button = /** @type {HTMLButtonElement} */ (make("button", { type: "button", class: "plain", text: t("Acknowledge") }));
    this.problem = make("span", { class: "problem" });
    /** @type {Trouble | null} */
    this.trouble = null;
    this.isAsking = false;
    this.button.addEventListener("click", () => void this.acknowledge());
    this.element = make(
      "li",
      { class: "trouble" },
      this.sign,
      make("p", {}, this.kind, this.where, this.what, this.since, this.seen, this.remedy, this.problem),
      this.button,
    );
  }

  /** Acknowledge the alarm at the gateway; the next status shows the result. */
  async acknowledge() {
    if (this.trouble === null || this.isAsking) {
      return;
    }
    const { kind, where, since } = this.trouble;
    this.isAsking = true; // a disabled button would lose the focus
    const why = await acknowledged({ kind, where, since });
    this.isAsking = false;
    setText(this.problem, why);
    setText(byId("say-alert"), why);
  }

  /**
   * @param {Trouble} trouble
   * @param {boolean} mayAcknowledge
   */
  show(trouble, mayAcknowledge) {
    const seen = trouble.acknowledged ?? null;
    const hadFocus = document.activeElement === this.button;
    this.trouble = trouble;
    show(this.seen, seen !== null);
    setText(this.seen, seen === null ? "" : t("acknowledged by {name}, {time}", { name: seen.by, time: timeOfDay(seen.at) }));
    show(this.button, mayAcknowledge && seen === null);
    if (seen !== null) {
      setText(this.problem, "");
      if (hadFocus) {
        byId("banner").focus(); // the focused button is gone
      }
    }
    setAttribute(this.button, "aria-label", `${t("Acknowledge")}: ${place(trouble.where)}, ${said(trouble.says, trouble.what)}`);
    const isError = trouble.severity === "error";
    setAttribute(this.element, "class", `trouble ${isError ? "error" : "warning"}${seen ? " acknowledged" : ""}`);
    setSign(this.sign, isError ? "error" : "warning");
    setText(this.kind, isError ? `${t("Error")}: ` : `${t("Warning")}: `);
    setText(this.where, capital(place(trouble.where)));
    setSentence(this.what, said(trouble.says, trouble.what));
    setText(this.since, trouble.since ? t("since {time}", { time: timeOfDay(trouble.since) }) : "");
    setSentence(this.remedy, capital(t(trouble.remedy)));
  }
}

/**
 * The number of alarms, as `1 error, 2 warnings`; empty if there are none.
 * @param {Verdict} verdict
 */
function wrongs({ errors, warnings }) {
  const parts = [errors ? counted(errors, t("error"), t("errors")) : "", warnings ? counted(warnings, t("warning"), t("warnings")) : ""];
  return parts.filter(Boolean).join(", ");
}

/** @param {Trouble} trouble */
function keyOf(trouble) {
  return `${trouble.severity} ${trouble.kind} ${trouble.where}`;
}
