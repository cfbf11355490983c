// @ts-check
// Connects the gateway's data and the parts of the page that show them.

import { AxisCard } from "./axis_card.js";
import { Banner } from "./banner.js";
import { byId, iconOf, keepChildren, make, setAttribute, setSign, setText, show, sign } from "./dom.js";
import { EventList } from "./event_list.js";
import { span } from "./figures.js";
import { Frames } from "./frames.js";
import { keep } from "./kept.js";
import { Latency } from "./latency.js";
import { LineCard } from "./line_cards.js";
import { isFresh } from "./model.js";
import { showSession } from "./session.js";
import { Sound } from "./sound.js";
import { Stream } from "./stream.js";
import { Tables } from "./tables.js";
import { counted, verdict } from "./words.js";
import { offerLanguages, t } from "./language.js";

/** @typedef {import("./model.js").Model} Model */

const LOST = { sign: "error", tone: "error" };
const CONNECTING = { sign: "wait", tone: "note" };

class Page {
  constructor() {
    this.banner = new Banner();
    this.events = new EventList();
    this.latency = new Latency();
    this.frames = new Frames();
    this.sound = new Sound();
    void showSession(() => this.banner.allow());
    /** @type {Map<string, AxisCard>} */
    this.axes = new Map();
    /** @type {Map<string, LineCard>} */
    this.lines = new Map();
    this.tables = new Tables((axis, table) => {
      this.axes.get(axis)?.take(table);
    });
    /** @type {Model | null} the newest */
    this.model = null;
    this.isDrawn = true;
    this.isSilent = true;
    this.linkSign = sign("wait");
    this.linkWords = make("span", { text: t("Connecting") });
    byId("link").append(this.linkSign, this.linkWords);
    document.addEventListener("visibilitychange", () => this.drawSoon());
    this.stream = new Stream("events", "status", {
      status: (model) => {
        this.model = model;
        this.sound.hear(model.troubles);
        this.showMark();
        this.drawSoon();
      },
      event: (happening) => {
        this.events.add(happening);
        this.drawSoon();
      },
      missed: (count) => this.events.addMissed(count),
      silent: (silentMs) => this.showSilence(silentMs),
    });
  }

  /** Draw with the browser's next frame; never in a hidden tab. */
  drawSoon() {
    if (this.isDrawn && !document.hidden) {
      this.isDrawn = false;
      requestAnimationFrame((now) => {
        this.isDrawn = true;
        this.draw(now);
      });
    }
  }

  /** @param {number} now */
  draw(now) {
    this.events.draw();
    const { model } = this;
    if (model === null) {
      return;
    }
    const { gateway } = model;
    setText(byId("name"), gateway.name);
    const runs = gateway.uptime_s === null ? "" : ` · ${t("runs for {span}", { span: span(gateway.uptime_s) })}`;
    setText(byId("about"), `pitch-gateway ${gateway.version}${runs}`);
    setAttribute(document.body, "data-fresh", isFresh(model) ? "yes" : "no");
    this.banner.show(model.verdict, model.troubles, contentsOf(model));
    this.drawAxes(model, now);
    const lines = Object.keys(model.lines);
    keepChildren(byId("lines"), this.lines, lines, (name) => new LineCard(name), (card) => card.element);
    for (const [name, line] of Object.entries(model.lines)) {
      this.lines.get(name)?.show(line, now, isFresh(model), model.troubles);
    }
    this.latency.show(model);
    this.frames.offer(lines);
    this.showLink();
  }

  /**
   * @param {Model} model
   * @param {number} now
   */
  drawAxes(model, now) {
    const room = byId("axes");
    const names = Object.keys(model.axes);
    for (const [name, card] of this.axes) {
      if (!Object.hasOwn(model.axes, name)) {
        card.leave();
        this.axes.delete(name);
        this.tables.forget(name);
      }
    }
    keepChildren(room, this.axes, names, (name) => new AxisCard(name), (card) => card.element);
    setAttribute(room, "data-count", names.length > 8 ? "many" : String(names.length));
    show(byId("no-axes"), names.length === 0 && Object.keys(model.lines).length > 0);
    for (const [name, axis] of Object.entries(model.axes)) {
      this.axes.get(name)?.show(axis, now);
      const { points, compiled } = axis.table;
      this.tables.want(name, points ? `${compiled} ${axis.gain.forward} ${axis.gain.backward}` : null);
    }
  }

  /** @param {number | null} silentMs */
  showSilence(silentMs) {
    this.isSilent = silentMs !== null;
    this.sound.hearSilence(this.isSilent);
    this.banner.showSilence(silentMs, this.model !== null);
    setAttribute(document.body, "data-link", this.isSilent ? "lost" : "live");
    this.showLink();
    this.showMark();
  }

  showLink() {
    const isLost = document.body.dataset.link === "lost";
    const relay = this.model === null || isFresh(this.model) ? null : this.model.gateway.relay;
    if (!isLost && this.model !== null) {
      setAttribute(document.body, "data-link", relay === null ? "live" : "relay");
    }
    setSign(this.linkSign, isLost || relay ? "error" : this.model ? "ok" : "wait");
    const ofRelay = relay === "up" ? t("Relay silent: it may not obey") : t("Relay down: nothing passes");
    setText(this.linkWords, isLost ? t("No connection") : relay ? ofRelay : this.model ? t("Live") : t("Connecting"));
  }

  /** The tab's name and icon; also while the page is hidden. */
  showMark() {
    const isLost = document.body.dataset.link === "lost";
    const state = this.model?.verdict.state;
    const words = isLost ? t("no connection") : t(state ?? "connecting");
    const { sign: name, tone } = isLost ? LOST : state === undefined ? CONNECTING : verdict(state);
    setAttribute(byId("favicon"), "href", iconOf(name, tone));
    const gateway = this.model?.gateway.name ?? "Pitch gateway";
    const title = `${tone === "error" || tone === "warning" ? "⚠ " : ""}${gateway}: ${words}`;
    if (document.title !== title) {
      document.title = title;
    }
  }
}

/**
 * What the gateway has, as `2 lines, 3 axes`.
 * @param {Model} model
 */
function contentsOf(model) {
  const axes = Object.keys(model.axes).length;
  const lines = Object.keys(model.lines).length;
  return [counted(lines, t("line"), t("lines")), axes ? counted(axes, t("axis"), t("axes")) : ""].filter(Boolean).join(", ");
}

/** The switch for light and dark, stored in the browser. */
function offerColours() {
  const button = byId("theme");
  const order = ["auto", "light", "dark"];
  const words = { auto: t("auto"), light: t("light"), dark: t("dark") };
  const root = document.documentElement;
  const showChoice = () => {
    const chosen = /** @type {keyof typeof words} */ (root.dataset.theme ?? "auto");
    setText(button, t("Colours: {choice}", { choice: words[chosen] }));
  };
  button.addEventListener("click", () => {
    const next = order[(order.indexOf(root.dataset.theme ?? "auto") + 1) % order.length];
    if (next === "auto") {
      delete root.dataset.theme;
    } else {
      root.dataset.theme = next;
    }
    keep("colours", next); // read by theme.js
    showChoice();
  });
  showChoice();
}

offerLanguages(/** @type {HTMLSelectElement} */ (byId("language")));
offerColours();
new Page();
