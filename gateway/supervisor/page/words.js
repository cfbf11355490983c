// @ts-check
// The gateway's own names in words, with the sign and colour of each.

import { t } from "./language.js";

/** @typedef {{ words: string, sign: string, tone: string }} State `tone`: well, note, warning or error */

/** @type {Record<string, State>} */
const COMPENSATION = {
  active: { words: t("Compensated"), sign: "ok", tone: "well" },
  blending: { words: t("Blending over"), sign: "blend", tone: "note" },
  shadow: { words: t("Shadow: shown, not applied"), sign: "shadow", tone: "warning" },
  off: { words: t("Off: not compensated"), sign: "off", tone: "warning" },
  unreferenced: { words: t("Not referenced"), sign: "warning", tone: "warning" },
  "no-table": { words: t("No table"), sign: "off", tone: "note" },
  outside: { words: t("Outside the table"), sign: "warning", tone: "warning" },
  blocked: { words: t("Blocked"), sign: "error", tone: "error" },
};

/** @type {Record<string, State>} the verdicts of the gateway, each in one word */
const VERDICT = {
  healthy: { words: t("Healthy"), sign: "ok", tone: "well" },
  waiting: { words: t("Waiting"), sign: "wait", tone: "note" },
  warning: { words: t("Warning"), sign: "warning", tone: "warning" },
  error: { words: t("Error"), sign: "error", tone: "error" },
};

/** @type {Record<string, State>} */
const TABLE = {
  active: { words: t("in force"), sign: "ok", tone: "well" },
  waiting: { words: t("not in force yet"), sign: "wait", tone: "note" },
  rejected: { words: t("rejected: the last good one stays"), sign: "error", tone: "error" },
  removed: { words: t("removed"), sign: "off", tone: "warning" },
  none: { words: t("no table"), sign: "off", tone: "note" },
};

/** @type {Record<string, { words: string, sign: string }>} */
const DIRECTION = {
  forward: { words: t("forward"), sign: "forward" },
  backward: { words: t("backward"), sign: "backward" },
  unsure: { words: t("direction unsure"), sign: "unknown" },
  unknown: { words: t("direction unknown"), sign: "unknown" },
};

/** @type {Record<string, State>} */
const OTHER_AXES = {
  waiting: { words: t("place not known yet"), sign: "wait", tone: "note" },
  held: { words: t("place not known: held"), sign: "wait", tone: "note" },
  fading: { words: t("place not known: fading"), sign: "warning", tone: "warning" },
  faded: { words: t("place not known: gone"), sign: "warning", tone: "warning" },
};

/** @type {Record<string, string>} */
const EVENTS = {
  "line-up": t("Line up"),
  "line-down": t("Line down"),
  "drives-not-reached": t("Drives not reached"),
  "drive-silent": t("Drive does not answer"),
  "drive-backed-off": t("Drive not asked any more"),
  "drive-answers": t("Drive answers again"),
  "axis-referenced": t("Axis referenced"),
  "reference-lost": t("Reference lost"),
  "direction-unsure": t("Direction unsure"),
  "compensation-ended": t("Compensation ended"),
  "refused-value": t("Value refused"),
  "axis-blocked": t("Axis blocked"),
  "axis-released": t("Axis released"),
  restaged: t("Target written once more"),
  "unknown-mode": t("Unknown mode"),
  "stored-move": t("Stored move"),
  "base-unknown": t("Start of a relative move unknown"),
  restored: t("Went on where it was"),
  "record-not-used": t("Record of the last run not used"),
  withdrawn: t("Request withdrawn"),
  "late-target": t("Late target"),
  "internal-fault": t("Fault of the gateway's own program"),
  "budget-overrun": t("Latency budget overrun"),
  "budget-kept": t("Latency budget kept again"),
  "late-reply": t("Late reply"),
  "table-activated": t("Table in force"),
  "table-handed-over": t("Table handed over"),
  "table-taken-away": t("Table taken away"),
  "table-removed": t("Table removed"),
  "table-rejected": t("Table rejected"),
  "table-refused": t("Table refused"),
  "table-waiting": t("Table not taken yet"),
  "table-mended": t("Table mended"),
  "gain-changed": t("Gain changed"),
  "limits-changed": t("Limits changed"),
  "configuration-changed": t("Configuration changed"),
  "reload-refused": t("Reload refused"),
  "nothing-to-reload": t("Nothing to reload"),
  supervising: t("Supervisor started"),
  "relay-reached": t("Relay reached"),
  "relay-not-reached": t("Relay not reached"),
  "watching-by-looks": t("Tables folder is looked at every second"),
  enabled: t("Compensation switched on"),
  disabled: t("Compensation switched off"),
  referenced: t("Taken as referenced"),
  "term-follows": t("Temperature or other axes known"),
  "term-held": t("Temperature or other axes not known: held"),
  "term-fades": t("Temperature or other axes not known: fading"),
  "term-too-large": t("Temperature or other axes add too much"),
  "temperature-wrong": t("Wrong temperature"),
  "temperature-not-read": t("Temperature not read"),
};

/**
 * From a state to its words; a state without words is shown by its name.
 * @param {Record<string, State>} states
 */
function among(states) {
  return (/** @type {string} */ state) => states[state] ?? { words: state, sign: "info", tone: "note" };
}

export const compensation = among(COMPENSATION);
export const verdict = among(VERDICT);
export const table = among(TABLE);
const otherAxesState = among(OTHER_AXES);

/** @param {string} direction */
export function direction(direction) {
  return DIRECTION[direction] ?? { words: direction, sign: "unknown" };
}

const GOING = t("going with the next target");

/**
 * The state of the temperature sensor of an axis; null if it sends.
 * @param {string} state
 * @param {boolean} isSilent for longer than its limit
 * @param {boolean} isHeard since the start
 * @param {string} silence how long, as ` for 5 min 1 s`, or nothing
 * @param {boolean} isAdded whether a correction for it is still added
 * @returns {State | null}
 */
export function sensor(state, isSilent, isHeard, silence, isAdded) {
  if (state === "following") {
    return isHeard ? null : { words: t("not heard since the restart: held"), sign: "wait", tone: "note" };
  }
  if (state === "waiting") {
    return isSilent
      ? { words: t("sensor never heard: nothing added"), sign: "warning", tone: "warning" }
      : { words: t("waiting for the sensor"), sign: "wait", tone: "note" };
  }
  const found = { held: t("held"), fading: t("fading"), faded: isAdded ? GOING : t("gone") }[state] ?? state;
  return { words: t("sensor silent{silence}: {state}", { silence, state: found }), sign: "warning", tone: "warning" };
}

/**
 * Whether the positions of the other axes that affect one are known; null if they are.
 * @param {string} state
 * @param {boolean} isAdded whether a correction for them is still added
 * @returns {State | null}
 */
export function otherAxes(state, isAdded) {
  if (state === "following") {
    return null;
  }
  const found = otherAxesState(state);
  return state === "faded" && isAdded ? { ...found, words: t("place not known: {state}", { state: GOING }) } : found;
}

/** @param {string} event */
export function event(event) {
  return EVENTS[event] ?? capital(event.replaceAll("-", " ").replace(/^(http|mqtt)\b/, (found) => found.toUpperCase()));
}

/**
 * A number of things, as `1 line` or `2 lines`.
 * @param {number} count
 * @param {string} one
 * @param {string} more
 */
export function counted(count, one, more) {
  return `${count} ${count === 1 ? one : more}`;
}

/** @param {string} text */
export function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

const TOLD = new Set(["number", "time", "event", "severity", "axis", "axes", "line", "detail", "process", "problems"]);

/**
 * All data of an event beside its name, as one sentence.
 * @param {import("./model.js").Happening} happening
 */
export function about(happening) {
  const parts = [];
  if (happening.detail) {
    parts.push(happening.detail);
  }
  if (Array.isArray(happening.problems)) {
    parts.push(...happening.problems.map(String));
  }
  for (const [key, value] of Object.entries(happening)) {
    const isTold = TOLD.has(key) || (key === "file" && Array.isArray(happening.problems));
    if (!isTold && value !== null && value !== "") {
      const words = Array.isArray(value) ? value.join(", ") : value;
      parts.push(`${key.replaceAll("_", " ")}: ${typeof words === "object" ? JSON.stringify(words) : words}`);
    }
  }
  return parts.join("; ");
}

/**
 * Where an event happened: `axis x`, `line xyz`, or nothing.
 * @param {import("./model.js").Happening} happening
 */
export function whereOf(happening) {
  if (happening.axis) {
    return `${t("axis")} ${happening.axis}`;
  }
  if (Array.isArray(happening.axes) && happening.axes.length) {
    return `${happening.axes.length === 1 ? t("axis") : t("axes")} ${happening.axes.join(", ")}`;
  }
  return happening.line && typeof happening.line === "string" ? `${t("line")} ${happening.line}` : "";
}
