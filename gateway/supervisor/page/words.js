// @ts-check
// The gateway's own names in words, and the sign and colour that go with each.

/** @typedef {{ words: string, sign: string, tone: string }} State `tone`: well, note, warning or error */

/** @type {Record<string, State>} */
const COMPENSATION = {
  active: { words: "Compensated", sign: "ok", tone: "well" },
  blending: { words: "Blending over", sign: "blend", tone: "note" },
  shadow: { words: "Shadow: shown, not applied", sign: "shadow", tone: "warning" },
  off: { words: "Off: not compensated", sign: "off", tone: "warning" },
  unreferenced: { words: "Not referenced", sign: "warning", tone: "warning" },
  "no-table": { words: "No table", sign: "off", tone: "note" },
  outside: { words: "Outside the table", sign: "warning", tone: "warning" },
  blocked: { words: "Blocked", sign: "error", tone: "error" },
};

/** @type {Record<string, State>} the verdicts of the gateway, each in one word */
const VERDICT = {
  healthy: { words: "Healthy", sign: "ok", tone: "well" },
  waiting: { words: "Waiting", sign: "wait", tone: "note" },
  warning: { words: "Warning", sign: "warning", tone: "warning" },
  error: { words: "Error", sign: "error", tone: "error" },
};

/** @type {Record<string, State>} */
const TABLE = {
  active: { words: "in force", sign: "ok", tone: "well" },
  waiting: { words: "is being written: not read yet", sign: "wait", tone: "note" },
  rejected: { words: "rejected: the last good one stays", sign: "error", tone: "error" },
  removed: { words: "removed", sign: "off", tone: "warning" },
  none: { words: "no table", sign: "off", tone: "note" },
};

/** @type {Record<string, { words: string, sign: string }>} */
const DIRECTION = {
  forward: { words: "forward", sign: "forward" },
  backward: { words: "backward", sign: "backward" },
  unsure: { words: "direction unsure", sign: "unknown" },
  unknown: { words: "direction unknown", sign: "unknown" },
};

/** @type {Record<string, State>} */
const OTHER_AXES = {
  waiting: { words: "place not known yet", sign: "wait", tone: "note" },
  held: { words: "place not known: held", sign: "wait", tone: "note" },
  fading: { words: "place not known: fading", sign: "warning", tone: "warning" },
  faded: { words: "place not known: gone", sign: "warning", tone: "warning" },
};

/** @type {Record<string, string>} */
const EVENTS = {
  "line-up": "Line up",
  "line-down": "Line down",
  "drives-not-reached": "Drives not reached",
  "drive-silent": "Drive does not answer",
  "drive-backed-off": "Drive not asked any more",
  "drive-answers": "Drive answers again",
  "axis-referenced": "Axis referenced",
  "reference-lost": "Reference lost",
  "direction-unsure": "Direction unsure",
  "compensation-ended": "Compensation ended",
  "refused-value": "Value refused",
  "axis-blocked": "Axis blocked",
  "axis-released": "Axis released",
  restaged: "Target written once more",
  "unknown-mode": "Unknown mode",
  "stored-move": "Stored move",
  "base-unknown": "Start of a relative move unknown",
  restored: "Went on where it was",
  "record-not-used": "Record of the last run not used",
  withdrawn: "Request withdrawn",
  "late-target": "Late target",
  "budget-overrun": "Latency budget overrun",
  "budget-kept": "Latency budget kept again",
  "late-reply": "Late reply",
  "table-activated": "Table in force",
  "table-handed-over": "Table handed over",
  "table-taken-away": "Table taken away",
  "table-removed": "Table removed",
  "table-rejected": "Table rejected",
  "table-refused": "Table refused",
  "table-mended": "Table mended",
  "gain-changed": "Gain changed",
  "limits-changed": "Limits changed",
  "configuration-changed": "Configuration changed",
  "reload-refused": "Reload refused",
  "nothing-to-reload": "Nothing to reload",
  supervising: "Supervisor started",
  "relay-reached": "Relay reached",
  "relay-not-reached": "Relay not reached",
  "watching-by-looks": "Tables folder is looked at every second",
  enabled: "Compensation switched on",
  disabled: "Compensation switched off",
  referenced: "Taken as referenced",
  "term-follows": "Temperature or other axes known",
  "term-held": "Temperature or other axes not known: held",
  "term-fades": "Temperature or other axes not known: fading",
  "term-too-large": "Temperature or other axes add too much",
  "temperature-wrong": "Wrong temperature",
  "temperature-not-read": "Temperature not read",
};

/** @param {string} state @returns {State} */
export function compensation(state) {
  return COMPENSATION[state] ?? { words: state, sign: "info", tone: "note" };
}

/** @param {string} state @returns {State} */
export function verdict(state) {
  return VERDICT[state] ?? { words: state, sign: "info", tone: "note" };
}

/** @param {string} state @returns {State} */
export function table(state) {
  return TABLE[state] ?? { words: state, sign: "info", tone: "note" };
}

/** @param {string} direction */
export function direction(direction) {
  return DIRECTION[direction] ?? { words: direction, sign: "unknown" };
}

const GOING = "going with the next target";

/**
 * How the sensor of an axis's temperature is; null where it is heard.
 * @param {string} state
 * @param {boolean} isSilent for longer than it may be
 * @param {boolean} isHeard since the start
 * @param {string} silence how long, as ` for 5 min 1 s`, or nothing
 * @param {boolean} isAdded whether something is added for it as yet
 * @returns {State | null}
 */
export function sensor(state, isSilent, isHeard, silence, isAdded) {
  if (state === "following") {
    return isHeard ? null : { words: "not heard since the restart: held", sign: "wait", tone: "note" };
  }
  if (state === "waiting") {
    return isSilent
      ? { words: "sensor never heard: nothing added", sign: "warning", tone: "warning" }
      : { words: "waiting for the sensor", sign: "wait", tone: "note" };
  }
  const found = { held: "held", fading: "fading", faded: isAdded ? GOING : "gone" }[state] ?? state;
  return { words: `sensor silent${silence}: ${found}`, sign: "warning", tone: "warning" };
}

/**
 * How well it is known where the other axes are that act on one; null where it is.
 * @param {string} state
 * @param {boolean} isAdded whether something is added for them as yet
 * @returns {State | null}
 */
export function otherAxes(state, isAdded) {
  if (state === "following") {
    return null;
  }
  const found = OTHER_AXES[state] ?? { words: state, sign: "info", tone: "note" };
  return state === "faded" && isAdded ? { ...found, words: `place not known: ${GOING}` } : found;
}

/** @param {string} event */
export function event(event) {
  return EVENTS[event] ?? capital(event.replaceAll("-", " "));
}

/** @param {string} text */
export function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

const TOLD = new Set(["number", "time", "event", "severity", "axis", "axes", "line", "detail", "process", "problems"]);

/**
 * Everything that an event says beside its name, as one sentence.
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
 * Where something happened: `axis x`, `line xyz`, or nothing.
 * @param {import("./model.js").Happening} happening
 */
export function whereOf(happening) {
  if (happening.axis) {
    return `axis ${happening.axis}`;
  }
  if (Array.isArray(happening.axes) && happening.axes.length) {
    return `${happening.axes.length === 1 ? "axis" : "axes"} ${happening.axes.join(", ")}`;
  }
  return happening.line && typeof happening.line === "string" ? `line ${happening.line}` : "";
}
