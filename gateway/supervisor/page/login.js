// @ts-check
// Sends the token to the gateway, once. It is in the body of a request, never in an address.

import { t } from "./language.js";

const form = /** @type {HTMLFormElement} */ (document.getElementById("form"));
const token = /** @type {HTMLInputElement} */ (document.getElementById("token"));
const enter = /** @type {HTMLButtonElement} */ (document.getElementById("enter"));
const reveal = /** @type {HTMLButtonElement} */ (document.getElementById("reveal"));
const problem = /** @type {HTMLElement} */ (document.getElementById("problem"));

/** @param {string} what */
function say(what) {
  problem.textContent = what;
  token.setAttribute("aria-invalid", what ? "true" : "false");
}

/** @returns {Promise<string>} why it was refused, "" if it was accepted */
async function logIn() {
  const body = JSON.stringify({ token: token.value.trim() });
  try {
    const headers = { "Content-Type": "application/json" };
    const answer = await fetch("login", { method: "POST", headers, body });
    if (answer.ok) {
      return "";
    }
    if (answer.status === 401) {
      return t("This gateway does not know this token.");
    }
    if (answer.status === 429) {
      const seconds = Number(answer.headers.get("Retry-After")) || 60;
      return t("Too many wrong tokens came from here. Try again in {count} seconds.", { count: seconds });
    }
    return t("The gateway answered {status}. Try again later.", { status: answer.status });
  } catch {
    return t("The gateway does not answer.");
  }
}

form.addEventListener("submit", (happening) => {
  happening.preventDefault();
  enter.disabled = true;
  say("");
  void logIn().then((why) => {
    enter.disabled = false;
    if (why === "") {
      token.value = "";
      location.reload();
      return;
    }
    say(why);
    token.select();
    token.focus();
  });
});

reveal.addEventListener("click", () => {
  const isShown = token.type === "password";
  token.type = isShown ? "text" : "password";
  reveal.textContent = isShown ? t("Hide") : t("Show");
  reveal.setAttribute("aria-pressed", String(isShown));
  token.focus();
});
