// @ts-check
// A sound for a new alarm that is not acknowledged. It is off until the user switches it on: a browser
// permits sound only after a click or a key.

import { byId, setAttribute, setText } from "./dom.js";
import { keep, kept } from "./kept.js";
import { t } from "./language.js";

const TONES_HZ = [880, 660];
const TONE_S = 0.18;
const LOUDNESS = 0.25;

/** @typedef {import("./model.js").Trouble} Trouble */

export class Sound {
  constructor() {
    this.button = byId("sound");
    /** @type {AudioContext | null} */
    this.context = null;
    /** @type {Set<string> | null} alarms that were there before; null: nothing was received yet */
    this.heard = null;
    this.isLost = false;
    this.isOn = kept("sound") === "on";
    this.button.addEventListener("click", () => this.turn(!this.isOn));
    for (const kind of ["pointerdown", "keydown"]) {
      document.addEventListener(kind, () => this.allow());
    }
    this.show();
  }

  /** @param {boolean} isOn */
  turn(isOn) {
    this.isOn = isOn;
    keep("sound", isOn ? "on" : "off");
    this.allow();
    if (isOn) {
      this.play(1); // so sounds it
    }
    this.show();
  }

  /** After a click or a key the browser permits sound. */
  allow() {
    if (this.isOn) {
      this.context ??= new AudioContext();
      void this.context.resume().then(() => this.show());
    }
  }

  show() {
    const isAllowed = this.context?.state === "running";
    setText(this.button, !this.isOn ? t("Sound: off") : isAllowed ? t("Sound: on") : t("Sound: on after a click"));
    setAttribute(this.button, "aria-pressed", String(this.isOn));
  }

  /**
   * Play the sound if an alarm is new and not acknowledged. Alarms from before the page was opened are not new.
   * @param {Trouble[]} troubles
   */
  hear(troubles) {
    const now = new Set(troubles.map(({ kind, where, since }) => `${kind} ${where} ${since}`));
    const fresh = troubles.filter(
      ({ kind, where, since, acknowledged }) => !acknowledged && !this.heard?.has(`${kind} ${where} ${since}`),
    );
    if (this.heard !== null && fresh.length) {
      this.play(fresh.some(({ severity }) => severity === "error") ? 3 : 1);
    }
    this.heard = now;
  }

  /** @param {boolean} isLost whether the gateway does not answer */
  hearSilence(isLost) {
    if (isLost && !this.isLost && this.heard !== null) {
      this.play(3);
    }
    this.isLost = isLost;
  }

  /** @param {number} times */
  play(times) {
    const { context } = this;
    if (!this.isOn || context === null) {
      return;
    }
    const loudness = context.createGain();
    loudness.gain.value = LOUDNESS;
    loudness.connect(context.destination);
    for (let number = 0; number < times * TONES_HZ.length; number += 1) {
      const tone = context.createOscillator();
      tone.frequency.value = TONES_HZ[number % TONES_HZ.length];
      tone.connect(loudness);
      const begin = context.currentTime + number * TONE_S + Math.floor(number / TONES_HZ.length) * TONE_S;
      tone.start(begin);
      tone.stop(begin + TONE_S);
    }
  }
}
