// @ts-check
// The curves of the axes: fetched once for each table, a few at a time, and again after a failure.

const AT_ONCE = 3;
const POINTS = 800; // more than a screen shows
const RETRY_MS = 3000;

/** @typedef {import("./model.js").Table} Table */

export class Tables {
  /** @param {(axis: string, table: Table | null) => void} take called with each received curve */
  constructor(take) {
    this.take = take;
    /** @type {Map<string, string | null>} digest of what is shown or requested, by axis */
    this.wanted = new Map();
    /** @type {string[]} */
    this.queue = [];
    this.running = 0;
  }

  /**
   * Request the curve of an axis, unless it is unchanged.
   * @param {string} axis
   * @param {string | null} digest any text that changes with the curve; null: there is none
   */
  want(axis, digest) {
    if (this.wanted.get(axis) === digest) {
      return;
    }
    this.wanted.set(axis, digest);
    if (digest === null) {
      this.take(axis, null);
    } else if (!this.queue.includes(axis)) {
      this.queue.push(axis);
      this.work();
    }
  }

  /** @param {string} axis */
  forget(axis) {
    this.wanted.delete(axis);
  }

  work() {
    while (this.running < AT_ONCE && this.queue.length) {
      const axis = /** @type {string} */ (this.queue.shift());
      this.running += 1;
      void this.fetch(axis).finally(() => {
        this.running -= 1;
        this.work();
      });
    }
  }

  /** @param {string} axis */
  async fetch(axis) {
    const digest = this.wanted.get(axis);
    if (!digest) {
      return;
    }
    let table = null;
    try {
      const answer = await fetch(`tables/${encodeURIComponent(axis)}?points=${POINTS}`, { cache: "no-store" });
      if (answer.ok) {
        table = /** @type {Table} */ (await answer.json());
      } else if (answer.status !== 404) {
        this.again(axis, digest);
        return;
      }
    } catch {
      this.again(axis, digest);
      return;
    }
    if (this.wanted.get(axis) === digest) {
      this.take(axis, table);
      if (table === null) {
        this.again(axis, digest);
      }
    } else if (this.wanted.get(axis)) {
      this.queue.push(axis);
    }
  }

  /**
   * @param {string} axis
   * @param {string} digest
   */
  again(axis, digest) {
    setTimeout(() => {
      if (this.wanted.get(axis) === digest && !this.queue.includes(axis)) {
        this.queue.push(axis);
        this.work();
      }
    }, RETRY_MS);
  }
}
