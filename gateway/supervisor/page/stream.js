// @ts-check
// The gateway's stream of status and events. It reports silence, and retries for ever.

import { SILENT_MS } from "./model.js";
import { askAgain } from "./session.js";

const RETRY_MS = [500, 1000, 2000];
const LOOK_MS = 500;
const DEAD_MS = 12_000; // a connection that is silent for so long is closed

/**
 * @typedef {{ status: (model: import("./model.js").Model) => void,
 *             event: (happening: import("./model.js").Happening) => void,
 *             missed: (count: number) => void,
 *             silent: (silentMs: number | null) => void }} Listener
 * `silent`: for how long nothing has been received, twice a second while that is too long; null: data come again
 */

export class Stream {
  /**
   * @param {string} address
   * @param {string} fallback address of the status alone
   * @param {Listener} listener
   */
  constructor(address, fallback, listener) {
    this.address = address;
    this.fallback = fallback;
    this.listener = listener;
    this.heard = performance.now();
    this.opened = this.heard;
    this.isSilent = false;
    this.failures = 0;
    /** @type {EventSource | null} */
    this.source = null;
    this.open();
    setInterval(() => this.look(), LOOK_MS);
    document.addEventListener("visibilitychange", () => this.look());
    window.addEventListener("online", () => this.reopen());
  }

  open() {
    this.opened = performance.now();
    const source = new EventSource(this.address);
    this.source = source;
    source.addEventListener("status", (message) => {
      const model = parsed(message);
      if (model !== null) {
        this.hear(true);
        this.listener.status(model);
      }
    });
    source.addEventListener("event", (message) => {
      const happening = parsed(message);
      if (happening !== null) {
        this.listener.event(happening);
      }
    });
    source.addEventListener("missed", (message) => {
      this.listener.missed(Number(parsed(message)?.events) || 0);
    });
    source.addEventListener("error", () => {
      if (source === this.source) {
        this.openLater(source);
        void this.ask();
      }
    });
  }

  /**
   * Fetch the status if the stream is not available: it may have no free slot, or a proxy does not let it through.
   * A gateway that does not answer at all is reported immediately, without waiting for the silence.
   */
  async ask() {
    try {
      const answer = await fetch(this.fallback, { cache: "no-store" });
      if (answer.status === 401) {
        askAgain(); // the session is over
        return;
      }
      if (answer.ok) {
        const model = await answer.json();
        this.hear(false);
        this.listener.status(model);
        return;
      }
    } catch {
      // The gateway does not respond.
    }
    this.isSilent = true;
    this.look();
  }

  /**
   * A browser reconnects after most failures, but not after a response such as 503, and some browsers only
   * after a long while.
   * @param {EventSource} failed
   */
  openLater(failed) {
    failed.close();
    const wait = RETRY_MS[Math.min(this.failures, RETRY_MS.length - 1)];
    this.failures += 1;
    setTimeout(() => {
      if (this.source === failed) {
        this.open();
      }
    }, wait);
  }

  reopen() {
    this.source?.close();
    this.open();
  }

  /** @param {boolean} isStream whether the data came from the stream */
  hear(isStream) {
    this.heard = performance.now();
    this.failures = isStream ? 0 : this.failures;
    if (this.isSilent) {
      this.isSilent = false;
      this.listener.silent(null);
    }
  }

  look() {
    const now = performance.now();
    const silentMs = now - this.heard;
    if (silentMs > SILENT_MS && !document.hidden) {
      this.isSilent = true;
    }
    if (this.isSilent) {
      this.listener.silent(silentMs);
    }
    if (silentMs > DEAD_MS && now - this.opened > DEAD_MS && this.source?.readyState !== EventSource.CLOSED) {
      this.reopen();
    }
  }
}

/**
 * @param {Event} message
 * @returns {any} null if it is not JSON: a proxy's page, half a line
 */
function parsed(message) {
  try {
    return JSON.parse(/** @type {MessageEvent<string>} */ (message).data);
  } catch {
    return null;
  }
}
