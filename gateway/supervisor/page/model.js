// @ts-check
// What the gateway says, as types. The names are those of the status model.

/**
 * @typedef {{ p50: number | null, p99: number | null, p999: number | null, max: number, max_minute: number,
 *             below?: number[] }} Times microseconds; `below` counts up to each bound, and all
 *
 * @typedef {{ file: string | null, line: number | null, column: number | null, key: string, found: string,
 *             remedy: string }} Problem
 *
 * @typedef {{ file: string | null, format: string | null, compiled: string | null, points: number,
 *             status: string, error: string | null, loaded_at: string | null, problems?: Problem[] }} TableState
 *
 * @typedef {{ state: string, celsius: number | null, age_s: number | null, difference: number,
 *             correction: number | null, is_silent: boolean }} ThermalTerm
 *
 * @typedef {{ state: string, axes: string[], correction: number | null }} CrossTerm
 *
 * @typedef {{ correction: number | null, is_too_large: boolean, thermal?: ThermalTerm,
 *             cross?: CrossTerm }} Terms what is added to the table; corrections in the unit of the axis
 *
 * @typedef {{ compensation: string, units: string, direction: string, correction: number | null,
 *             gain: { forward: number, backward: number }, travel: [number, number] | null,
 *             nominal_setpoint: number | null, corrected_setpoint: number | null,
 *             nominal_actual: number | null, corrected_actual: number | null, table: TableState,
 *             writer?: string | null, terms?: Terms | null, verdict: AxisVerdict, position: Position,
 *             latency: { gateway_us: Times, budget_us: number, budget_overruns: number,
 *                        is_over_budget: boolean } }} Axis
 *
 * @typedef {{ name: string, role: string, address: string | string[], connections?: string[], state?: string,
 *             failure?: string, asked_s?: number | null, silent_s?: number, gateway_us: Times,
 *             tls?: { sessions?: { subject: string, certified: string }[] } }} Controller
 *
 * @typedef {{ silent_s: number | null, answered_s: number | null }} Drive
 *
 * @typedef {{ state: string, exchanges: number, timeouts: number, crc_errors: number, exceptions: number,
 *             late: number, refused?: number, unit_ids?: { axes: Record<string, number>, drives?: Record<string, Drive> },
 *             budget_overruns?: number, gateway_us: Times, controllers: Controller[],
 *             drives: { address: string, failure: string } }} Line
 *
 * @typedef {{ state: string, since: string, errors: number, warnings: number }} Verdict how the gateway is: healthy,
 *             waiting, warning or error
 *
 * @typedef {{ state: string, kind: string, title: string, since: string }} AxisVerdict the same of an axis; `title` is
 *             empty where the state of the compensation says it
 *
 * @typedef {{ of: string | null, nominal: number | null, corrected: number | null, age_s: number | null,
 *             is_at_least: boolean }} Position what is known best of where an axis is: a reading, the last reading or
 *             the target; null: nothing
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
 *             travel?: [number, number] | null, modulo?: number | null }} Table with the gain in it, on the
 *             controller's scale as all positions here; `modulo` is one turn of a rotary axis
 */

/** After so long without word the gateway counts as lost: it says something each second at least. */
export const SILENT_MS = 3500;

/** After so long the relay counts as silent, as in the gateway's own list of troubles. */
export const STALE_S = 2;

/**
 * Whether the numbers of a model can be taken for what the machine does now.
 * @param {Model} model
 */
export function isFresh(model) {
  const { relay, snapshot_age_s: age } = model.gateway;
  return relay === "up" && age !== null && age <= STALE_S;
}
