// @ts-check
// What this browser remembers of its user's choices. One that keeps nothing has them until the page is left.

const PREFIX = "pitch-gateway-";

/**
 * @param {string} name of the choice
 * @returns {string | null} null: none was made
 */
export function kept(name) {
  try {
    return localStorage.getItem(PREFIX + name);
  } catch {
    return null;
  }
}

/**
 * @param {string} name of the choice
 * @param {string} choice
 */
export function keep(name, choice) {
  try {
    localStorage.setItem(PREFIX + name, choice);
  } catch {
    // It holds until the page is left.
  }
}
