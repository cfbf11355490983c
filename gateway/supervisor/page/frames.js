// @ts-check
// The newest frames of a line, in words, newest first. Fetched only while they are visible.

import { byId, keepChildren, make, setAttribute, setText, show } from "./dom.js";
import { exactTimeOfDay } from "./figures.js";
import { t } from "./language.js";

/** @typedef {{ time: string, kind: string, side: string, words: string }} Frame `time` as ISO 8601 */

const EVERY_MS = 1000;
/** @type {Record<string, string>} */
const WAYS = { request: t("from controller"), sent: t("to drive"), reply: t("from drive"), answered: t("to controller") };
const ARROWS = /^(?:controller|)\s*[→←×]\s*/u;

export class Frames {
  constructor() {
    this.room = /** @type {HTMLDetailsElement} */ (byId("frames-room"));
    this.choice = /** @type {HTMLSelectElement} */ (byId("frames-of"));
    this.hold = byId("frames-hold");
    this.list = byId("frames");
    this.none = byId("no-frames");
    /** @type {Map<string, HTMLElement>} */
    this.options = new Map();
    this.isHeld = false;
    this.isAsking = false;
    this.newest = "";
    this.room.addEventListener("toggle", () => this.ask());
    this.choice.addEventListener("change", () => {
      this.newest = "";
      this.ask();
    });
    this.hold.addEventListener("click", () => {
      this.isHeld = !this.isHeld;
      setAttribute(this.hold, "aria-pressed", String(this.isHeld));
      setText(this.hold, this.isHeld ? t("Go on") : t("Hold"));
    });
    setInterval(() => this.ask(), EVERY_MS);
  }

  /** @param {string[]} lines */
  offer(lines) {
    const made = (/** @type {string} */ name) => make("option", { value: name, text: `${t("line")} ${name}` });
    keepChildren(this.choice, this.options, lines, made, (option) => option);
  }

  async ask() {
    if (!this.room.open || this.isHeld || this.isAsking || document.hidden || !this.choice.value) {
      return;
    }
    this.isAsking = true;
    try {
      const line = this.choice.value;
      const answer = await fetch(`frames/${encodeURIComponent(line)}`, { cache: "no-store" });
      const told = await answer.json();
      if (line === this.choice.value) {
        this.draw(answer.ok ? told.frames : [], answer.ok ? t("Nothing has passed yet.") : String(told.problem));
      }
    } catch {
      this.draw([], t("The gateway does not answer."));
    } finally {
      this.isAsking = false;
    }
  }

  /**
   * @param {Frame[]} frames oldest first
   * @param {string} none
   */
  draw(frames, none) {
    setText(this.none, none);
    show(this.none, frames.length === 0);
    const newest = JSON.stringify(frames[frames.length - 1] ?? null);
    if (newest !== this.newest) {
      this.newest = newest;
      this.list.replaceChildren(...frames.reverse().map(itemOf));
    }
  }
}

/** @param {Frame} frame */
function itemOf(frame) {
  const isWrong = /exception \d/u.test(frame.words) || ["abandoned", "stray", "down"].includes(frame.kind);
  const arrow = ARROWS.exec(frame.words);
  const way = WAYS[frame.kind] ?? "";
  const words = arrow ? frame.words.slice(arrow[0].length).replace(/^drive\s*/u, "") : frame.words;
  return make(
    "li",
    { class: `frame ${frame.side || "other"}${isWrong ? " wrong" : ""}` },
    make("time", { datetime: frame.time, title: frame.time, text: exactTimeOfDay(frame.time) }),
    make("span", { class: "way", text: way }),
    make("span", { class: "words", text: words }),
  );
}
