// @ts-check
// Who looks, where the gateway asks that: a button to log out, and the page that asks once a session is over.

import { byId, make, show } from "./dom.js";

/** Show the button to whoever has a session, and see to it that it ends one. */
export async function showSession() {
  try {
    const answer = await fetch("session", { cache: "no-store" });
    const { by, how } = await answer.json();
    if (answer.ok && how === "session") {
      const button = /** @type {HTMLButtonElement} */ (byId("logout"));
      button.append(make("span", { text: "Log out" }));
      button.title = `Logged in with the token “${by}”`;
      button.addEventListener("click", () => void logOut(button));
      show(button, true);
    }
  } catch {
    // Nobody is there; what shows the status says so.
  }
}

/** @param {HTMLButtonElement} button */
async function logOut(button) {
  button.disabled = true;
  try {
    await fetch("logout", { method: "POST" });
  } finally {
    askAgain();
  }
}

/** Load the page anew: the gateway answers with the one that asks for the token. */
export function askAgain() {
  location.reload();
}
