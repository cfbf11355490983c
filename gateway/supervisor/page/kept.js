// @ts-check
// The user's choices, stored in the browser. Without storage they last until the page is left.

const PREFIX = "pitch-gateway-";

/**
 * @param {string} name of the choice
 * @returns {string | null} null: there is none
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
    // Without storage it lasts until the page is left.
  }
}
