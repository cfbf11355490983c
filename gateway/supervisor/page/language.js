// @ts-check
// The language of the page. English stands in the program; every other language is a file that says each English
// text once more. What a file does not know is shown in English.

import { keep, kept } from "./kept.js";

/** The languages there are, each called as its readers call it. */
export const LANGUAGES = { en: "English", de: "Deutsch" };

/**
 * A sentence of the gateway: a text, or a text with what differs in it.
 * @typedef {string | { text: string, values: Record<string, Said> }} Said
 */

/** @returns {keyof typeof LANGUAGES} */
function chosenLanguage() {
  const wanted = [kept("language") ?? "", ...navigator.languages].map((each) => each.slice(0, 2).toLowerCase());
  return /** @type {keyof typeof LANGUAGES} */ (wanted.find((each) => Object.hasOwn(LANGUAGES, each)) ?? "en");
}

export const language = chosenLanguage();

/** @type {Record<string, string>} what each English text is */
let texts = {};
if (language !== "en") {
  try {
    const answer = await fetch(`page/${language}.json`);
    texts = answer.ok ? await answer.json() : {};
  } catch {
    // Nobody is there: in English it says so, too.
  }
}
if (Object.keys(texts).length) {
  document.documentElement.lang = language;
  translate(document.body);
}

/**
 * Say a text of the page in the language of whoever reads it.
 * @param {string} text in English; `{name}` stands for a value
 * @param {Record<string, string | number>} [values]
 */
export function t(text, values = {}) {
  const found = Object.hasOwn(texts, text) ? texts[text] : text;
  return found.replace(/\{(\w+)\}/g, (whole, name) => (Object.hasOwn(values, name) ? String(values[name]) : whole));
}

/**
 * Say a sentence of the gateway.
 * @param {Said | undefined} sentence
 * @param {string} english the same in English, of a gateway that says no more
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
 * Say where something is, as `line xyz, controller cnc`: names stay.
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

/** Say what stands in index.html. @param {Element} root */
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

/** A choice of the language, which this browser remembers. @param {HTMLSelectElement} choice */
export function offerLanguages(choice) {
  choice.append(...Object.entries(LANGUAGES).map(([value, name]) => new Option(name, value, false, value === language)));
  choice.addEventListener("change", () => {
    keep("language", choice.value);
    location.reload();
  });
}
