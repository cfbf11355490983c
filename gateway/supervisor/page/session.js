// @ts-check
// The user's session, if the gateway requires one, and its actions: log out, and acknowledge alarms.

import { byId, make, show } from "./dom.js";
import { t } from "./language.js";

/**
 * Show the button that ends a session, if there is one.
 * @param {() => void} mayAcknowledge called if the user may acknowledge alarms
 */
export async function showSession(mayAcknowledge) {
  try {
    const answer = await fetch("session", { cache: "no-store" });
    const { by, how, may_acknowledge: may } = await answer.json();
    if (answer.ok && may) {
      mayAcknowledge();
    }
    if (answer.ok && how === "session") {
      const button = /** @type {HTMLButtonElement} */ (byId("logout"));
      button.append(make("span", { text: t("Log out") }));
      button.title = t("Logged in with the token “{name}”", { name: by });
      button.addEventListener("click", () => void logOut(button));
      show(button, true);
    }
  } catch {
    // The gateway does not respond; the parts with the status show that.
  }
}

/**
 * Acknowledge an alarm; returns why it failed, "" if it succeeded.
 * @param {{ kind: string, where: string, since?: string }} alarm
 */
export async function acknowledged(alarm) {
  try {
    const headers = { "Content-Type": "application/json" };
    const answer = await fetch("acknowledge", { method: "POST", headers, body: JSON.stringify(alarm) });
    if (answer.status === 401) {
      askAgain(); // the session is over
    }
    return answer.ok ? "" : answer.status === 404 ? t("This alarm has just changed. Look again.") : t("Not acknowledged: the gateway refused it.");
  } catch {
    return t("Not acknowledged: the gateway does not answer.");
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

/** Reload the page: the gateway answers with the login page. */
export function askAgain() {
  location.reload();
}
