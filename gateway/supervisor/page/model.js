// @ts-check
// The gateway's data, as types. The names are those of the status model. The type of a part that only one
// script shows is in that script.

/**
 * @typedef {import("./axis_card.js").Axis} Axis
 * @typedef {import("./line_cards.js").Line} Line
 *
 * @typedef {{ p50: number | null, p99: number | null, p999: number | null, max: number, max_minute: number,
 *             below?: number[] }} Times microseconds; `below` counts up to each bound, and all
 *
 * @typedef {{ state: string, since: string, errors: number, warnings: number }} Verdict the state of the gateway: healthy,
 *             waiting, warning or error
 *
 * @typedef {{ kind: string, severity: string, where: string, what: string, remedy: string, since?: string,
 *             says?: import("./language.js").Said, axes?: string[], acknowledged?: { by: string, at: string } | null }} Trouble
 *
 * @typedef {{ gateway: { name: string, version: string, uptime_s: number | null, relay: string,
 *                        snapshot_age_s: number | null, latency_bounds_us?: number[] },
 *             lines: Record<string, Line>, axes: Record<string, Axis>, verdict: Verdict, troubles: Trouble[] }} Model
 *
 * @typedef {{ number: number, time: string, event: string, severity: string, axis?: string, line?: string,
 *             detail?: string } & Record<string, unknown>} Happening
 *
 * @typedef {{ units: string, digest: string, positions: number[], forward: number[], backward: number[],
 *             travel?: [number, number] | null, modulo?: number | null }} Table with the gain applied, on the
 *             controller's scale like all positions here; `modulo` is one turn of a rotary axis
 */

/** After so long without data the gateway counts as lost: it sends at least once a second. */
export const SILENT_MS = 3500;

/** After so long the relay counts as silent, as in the gateway's own list of alarms. */
export const STALE_S = 2;

/**
 * Whether the numbers of a model are current.
 * @param {Model} model
 */
export function isFresh(model) {
  const { relay, snapshot_age_s: age } = model.gateway;
  return relay === "up" && age !== null && age <= STALE_S;
}
