// @ts-check
// Numbers for display: decimals that suit the unit, a real minus sign, steps of 1, 2 and 5.

/**
 * How lengths of an axis are displayed. `small` is the unit of corrections, `perUnit` how many make one unit.
 * @typedef {{ units: string, decimals: number, small: string, perUnit: number, smallDecimals: number }} Scale
 */

/** @type {Record<string, Scale>} */
const SCALES = {
  mm: { units: "mm", decimals: 3, small: "µm", perUnit: 1000, smallDecimals: 1 },
  inch: { units: "in", decimals: 4, small: "thou", perUnit: 1000, smallDecimals: 2 },
  degree: { units: "°", decimals: 4, small: "″", perUnit: 3600, smallDecimals: 1 },
};

export const NOT_KNOWN = "–";

/**
 * @param {string} units as in the status
 * @returns {Scale}
 */
export function scaleOf(units) {
  return SCALES[units] ?? { units, decimals: 4, small: units, perUnit: 1, smallDecimals: 5 };
}

/**
 * @param {number | null | undefined} value
 * @param {number} decimals
 * @param {boolean} [hasSign] also with a plus sign
 */
export function fixed(value, decimals, hasSign = false) {
  if (value === null || value === undefined || !Number.isFinite(value)) {
    return NOT_KNOWN;
  }
  const text = Math.abs(value).toFixed(decimals);
  const isZero = Number(text) === 0;
  const before = isZero ? "" : value < 0 ? "−" : hasSign ? "+" : "";
  return before + text;
}

/**
 * A number that is not negative: one decimal below `whole`, none from there on.
 * @param {number} value
 * @param {number} whole
 */
export function rounded(value, whole) {
  return value < whole ? value.toFixed(1) : count(Math.round(value));
}

/**
 * A position with its unit.
 * @param {number | null} value
 * @param {Scale} scale
 */
export function positionText(value, { decimals, units }) {
  return withUnits(fixed(value, decimals), units);
}

/**
 * A correction with its sign and its small unit.
 * @param {number | null} value in the unit of the axis
 * @param {Scale} scale
 */
export function correctionText(value, { perUnit, smallDecimals, small }) {
  return withUnits(fixed(value && value * perUnit, smallDecimals, true), small);
}

/**
 * @param {string} text
 * @param {string} units
 */
function withUnits(text, units) {
  return text === NOT_KNOWN ? text : `${text}\u202f${units}`;
}

/**
 * A count, in groups of three.
 * @param {number} value
 */
export function count(value) {
  return String(value).replace(/\B(?=(\d{3})+(?!\d))/g, "\u202f");
}

/**
 * A count in a few characters.
 * @param {number} value
 */
export function shortCount(value) {
  for (const [size, letter] of /** @type {[number, string][]} */ ([[1e9, "G"], [1e6, "M"], [1e3, "k"]])) {
    if (value >= size) {
      return `${value / size}${letter}`;
    }
  }
  return String(value);
}

/**
 * Microseconds, in µs, ms or s.
 * @param {number | null | undefined} value
 */
export function time(value) {
  if (value === null || value === undefined) {
    return NOT_KNOWN;
  }
  for (const [size, unit] of /** @type {[number, string][]} */ ([[1e6, "s"], [1e3, "ms"], [1, "µs"]])) {
    if (value >= size || size === 1) {
      const scaled = value / size;
      return `${Number(scaled.toFixed(scaled < 10 && size > 1 ? 2 : scaled < 100 ? 1 : 0))} ${unit}`;
    }
  }
  return NOT_KNOWN;
}

/**
 * A span of seconds in words.
 * @param {number} seconds
 */
export function span(seconds) {
  const whole = Math.floor(seconds);
  for (const [size, unit, part, partUnit] of /** @type {[number, string, number, string][]} */ ([
    [86400, "d", 3600, "h"],
    [3600, "h", 60, "min"],
    [60, "min", 1, "s"],
  ])) {
    if (whole >= size) {
      return `${Math.floor(whole / size)} ${unit} ${Math.floor((whole % size) / part)} ${partUnit}`;
    }
  }
  return `${whole} s`;
}

/**
 * The time of day of an ISO time, with the day if it is not today.
 * @param {string} iso
 */
export function timeOfDay(iso) {
  const then = new Date(iso);
  if (Number.isNaN(then.getTime())) {
    return iso;
  }
  return then.toDateString() === new Date().toDateString() ? clock(then) : `${day(then)} ${clock(then)}`;
}

/**
 * The time of day with milliseconds.
 * @param {string} iso
 */
export function exactTimeOfDay(iso) {
  const then = new Date(iso);
  return `${clock(then)}.${String(then.getMilliseconds()).padStart(3, "0")}`;
}

/** @param {Date} date */
function clock(date) {
  return [date.getHours(), date.getMinutes(), date.getSeconds()].map(two).join(":");
}

/** @param {Date} date */
function day(date) {
  return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
}

/** @param {number} number */
function two(number) {
  return String(number).padStart(2, "0");
}

/**
 * Round steps of 1, 2 or 5 between two numbers, about so many.
 * @param {number} low
 * @param {number} high
 * @param {number} about
 * @returns {{ values: number[], decimals: number }}
 */
export function ticks(low, high, about) {
  const rough = (high - low) / Math.max(about, 1);
  if (!(rough > 0) || !Number.isFinite(rough)) {
    return { values: [low], decimals: 0 };
  }
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = ([1, 2, 5, 10].find((factor) => factor * power >= rough * 0.999) ?? 10) * power;
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const values = [];
  for (let index = Math.ceil(low / step - 1e-9); index * step <= high + step * 1e-9; index += 1) {
    values.push(index * step);
  }
  return { values, decimals };
}
