// @ts-check
// The language of the page. English is in the program; every other language is a file with a translation of each
// English text. A text without translation is shown in English.

import { keep, kept } from "./kept.js";

/** The available languages, each by its own name. */
export const LANGUAGES = { en: "English", de: "Deutsch" };

/**
 * A sentence of the gateway: a text, or a template with values.
 * @typedef {string | { text: string, values: Record<string, Said> }} Said
 */

/** @returns {keyof typeof LANGUAGES} */
function chosenLanguage() {
  const wanted = [kept("language") ?? "", ...navigator.languages].map((each) => each.slice(0, 2).toLowerCase());
  return /** @type {keyof typeof LANGUAGES} */ (wanted.find((each) => Object.hasOwn(LANGUAGES, each)) ?? "en");
}

export const language = chosenLanguage();

/** @type {Record<string, string>} translation by English text */
let texts = {};
if (language !== "en") {
  try {
    const answer = await fetch(`page/${language}.json`);
    texts = answer.ok ? await answer.json() : {};
  } catch {
    // The gateway does not respond: the page shows that in English, too.
  }
}
if (Object.keys(texts).length) {
  document.documentElement.lang = language;
  translate(document.body);
}

/**
 * Return a text of the page in the user's language.
 * @param {string} text in English; `{name}` stands for a value
 * @param {Record<string, string | number>} [values]
 */
export function t(text, values = {}) {
  const found = Object.hasOwn(texts, text) ? texts[text] : text;
  return found.replace(/\{(\w+)\}/g, (whole, name) => (Object.hasOwn(values, name) ? String(values[name]) : whole));
}

/**
 * Return a sentence of the gateway in the user's language.
 * @param {Said | undefined} sentence
 * @param {string} english the same in English, from a gateway without templates
 * @returns {string}
 */
export function said(sentence, english) {
  if (sentence === undefined || typeof sentence === "string") {
    return t(sentence ?? english);
  }
  const values = Object.entries(sentence.values).map(([name, value]) => [name, said(value, "")]);
  return t(sentence.text, Object.fromEntries(values));
}

/**
 * Return where something is, as `line xyz, controller cnc`; names are not translated.
 * @param {string} where
 */
export function place(where) {
  return where
    .split(", ")
    .map((part) => {
      const found = /^(axis|axes|line|controller|unit id) (.*)$/u.exec(part);
      return found ? `${t(found[1])} ${found[2]}` : t(part);
    })
    .join(", ");
}

/** Translate the texts of index.html. @param {Element} root */
function translate(root) {
  const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = /** @type {Text} */ (walker.currentNode);
    const text = node.data.trim();
    if (text && Object.hasOwn(texts, text)) {
      node.data = node.data.replace(text, texts[text]);
    }
  }
  for (const element of root.querySelectorAll("[aria-label]")) {
    element.setAttribute("aria-label", t(element.getAttribute("aria-label") ?? ""));
  }
}

/** The choice of the language, stored in the browser. @param {HTMLSelectElement} choice */
export function offerLanguages(choice) {
  choice.append(...Object.entries(LANGUAGES).map(([value, name]) => new Option(name, value, false, value === language)));
  choice.addEventListener("change", () => {
    keep("language", choice.value);
    location.reload();
  });
}
