// @ts-check
// Creates elements, and changes only what differs. Text from the gateway is never set as markup.

const SVG = "http://www.w3.org/2000/svg";
let ids = 0;

/**
 * A unique name for an element of the page.
 * @param {string} kind
 */
export function newId(kind) {
  ids += 1;
  return `${kind}-${ids}`;
}

/**
 * Make an HTML element.
 * @param {string} tag
 * @param {Record<string, string>} [attributes] `text` is its text
 * @param {...(Node | null)} children
 * @returns {HTMLElement}
 */
export function make(tag, attributes = {}, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

/**
 * Make an SVG element.
 * @param {string} tag
 * @param {Record<string, string | number>} [attributes] `text` is its text
 * @param {...(Node | null)} children
 * @returns {SVGElement}
 */
export function draw(tag, attributes = {}, ...children) {
  return fill(/** @type {SVGElement} */ (document.createElementNS(SVG, tag)), attributes, children);
}

/**
 * @template {Element} T
 * @param {T} element
 * @param {Record<string, string | number>} attributes
 * @param {(Node | null)[]} children
 * @returns {T}
 */
function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "text") {
      element.textContent = String(value);
    } else {
      element.setAttribute(name, String(value));
    }
  }
  element.append(...children.filter((child) => child !== null));
  return element;
}

/**
 * Make one of the signs of index.html; words beside it have the same meaning.
 * @param {string} name
 * @returns {SVGElement}
 */
export function sign(name) {
  return draw("svg", { class: "sign", "aria-hidden": "true", focusable: "false" }, draw("use", { href: `#i-${name}` }));
}

/**
 * Show another sign.
 * @param {Element} of what {@link sign} made
 * @param {string} name
 * @param {string} [tone] its own colour, if it has one
 */
export function setSign(of, name, tone) {
  setAttribute(/** @type {Element} */ (of.firstElementChild), "href", `#i-${name}`);
  if (tone !== undefined) {
    setAttribute(of, "class", `sign ${tone}`);
  }
}

/** @type {Record<string, [string, string]>} colours of a sign and of what is in it, on light and on dark */
const OF_ICON = {
  well: ["#1a9550", "#ffffff"],
  note: ["#74849a", "#ffffff"],
  warning: ["#f0b429", "#10141a"],
  error: ["#d8303c", "#ffffff"],
};

/**
 * The address of a sign as an icon of the tab: the picture itself, which needs no gateway.
 * @param {string} name
 * @param {string} tone
 */
export function iconOf(name, tone) {
  const [colour, inside] = OF_ICON[tone];
  const parts = [...byId(`i-${name}`).children].map((part) => new XMLSerializer().serializeToString(part));
  const shape = parts.join("").replaceAll("var(--on-mark)", inside).replaceAll("currentColor", colour);
  return `data:image/svg+xml,${encodeURIComponent(`<svg xmlns="${SVG}" viewBox="0 0 24 24">${shape}</svg>`)}`;
}

/** A sign, words with the same meaning, and the colour of both. */
export class SignedWords {
  /**
   * @param {string} tag
   * @param {string} name its class, beside the tone
   * @param {...Node} after
   */
  constructor(tag, name, ...after) {
    this.name = name;
    this.sign = sign("wait");
    this.words = make("span");
    this.element = make(tag, { class: name }, this.sign, this.words, ...after);
  }

  /** @param {{ words: string, sign: string, tone?: string }} state */
  show({ words, sign: name, tone }) {
    setAttribute(this.element, "class", tone === undefined ? this.name : `${this.name} ${tone}`);
    setSign(this.sign, name);
    setText(this.words, words);
  }
}

/** A figure with its label, for a list of figures. */
export class Figure {
  /** @param {string} [name] */
  constructor(name = "") {
    this.name = make("dt", { text: name });
    this.value = make("dd");
    this.element = make("div", {}, this.name, this.value);
  }

  /** @param {string | null} text null: there is no text */
  show(text) {
    show(this.element, text !== null);
    setText(this.value, text ?? "");
  }
}

/**
 * The heading of a card; for screen readers with its kind.
 * @param {string} kind
 * @param {string} name
 * @param {Record<string, string>} [attributes]
 */
export function heading(kind, name, attributes = {}) {
  return make("h3", attributes, make("span", { class: "unseen", text: `${kind} ` }), make("span", { text: name }));
}

/**
 * @param {Element} element
 * @param {string} text
 */
export function setText(element, text) {
  if (element.textContent !== text) {
    element.textContent = text;
  }
}

/**
 * Show a sentence with keys and values between backticks.
 * @param {Element} element
 * @param {string} text
 */
export function setSentence(element, text) {
  const parts = text.split("`");
  if (parts.length % 2 === 0) {
    setText(element, text); // an unmatched backtick is plain text
  } else if (element.textContent !== parts.join("")) {
    element.replaceChildren(...parts.map((part, number) => (number % 2 ? make("code", { text: part }) : part)));
  }
}

/**
 * @param {Element} element
 * @param {string} name
 * @param {string} value
 */
export function setAttribute(element, name, value) {
  if (element.getAttribute(name) !== value) {
    element.setAttribute(name, value);
  }
}

/**
 * @param {Element} element an element with `hidden`
 * @param {boolean} isShown
 */
export function show(element, isShown) {
  const it = /** @type {HTMLElement} */ (element);
  if (it.hidden === isShown) {
    it.hidden = !isShown;
  }
}

/**
 * Find an element of index.html.
 * @param {string} id
 * @returns {HTMLElement}
 */
export function byId(id) {
  return /** @type {HTMLElement} */ (document.getElementById(id));
}

/**
 * Make the children of an element match a list: one for each key, in this order, created and removed as
 * keys come and go.
 * @template T
 * @param {Element} parent
 * @param {Map<string, T>} known the present children, by key; updated
 * @param {string[]} keys
 * @param {(key: string) => T} create
 * @param {(it: T) => Element} elementOf
 */
export function keepChildren(parent, known, keys, create, elementOf) {
  const wanted = new Set(keys);
  for (const [key, it] of known) {
    if (!wanted.has(key)) {
      elementOf(it).remove();
      known.delete(key);
    }
  }
  keys.forEach((key, index) => {
    let it = known.get(key);
    if (it === undefined) {
      it = create(key);
      known.set(key, it);
    }
    const element = elementOf(it);
    if (parent.children[index] !== element) {
      parent.insertBefore(element, parent.children[index] ?? null);
    }
  });
}
