// The page of `table edit`. Every change goes to the program, which writes the table, reads it back and returns
// it with its remarks (`Editing.state`): nothing about a table is computed here.

import { Chart, extent, linear, path, round, textWidth } from "./chart.js";
import { byId, draw, make, setText, show } from "./dom.js";
import { fixed, ticks } from "./figures.js";

const NAMES = { forward: "forward", backward: "backward", both: "both directions" };
const STEPS = { ArrowUp: 1, ArrowDown: -1, PageUp: 10, PageDown: -10 };
const REACH = 28; // pixels around a point in which it can be taken
const MOST_MARKS = 90;
let state = null;
let ways = [];
let last = Promise.resolve(); // requests go one after the other

/** Ask for what a function returns when its turn comes; null: nothing any more. */
function ask(what) {
  last = last.then(async () => {
    const asked = what();
    if (asked !== null) {
      try {
        const answer = await fetch("do", { method: "POST", body: JSON.stringify(asked) });
        if (answer.status !== 200 && answer.status !== 409) {
          throw new Error(await answer.text());
        }
        showState(await answer.json(), answer.status === 409, asked.do);
      } catch (error) {
        say(`The program does not answer (${error.message}). Start table edit again.`, true);
      }
    }
  });
}

function changed(way, index, value, what = "change") {
  return { do: what, index, way, value: tidy(value), together: byId("together").checked };
}

/** Change a value by steps, from what it is by then. */
function nudge(way, index, steps) {
  ask(() => changed(way, index, state.now[way][index] + steps * step()));
}

function step() {
  const typed = numberOf(byId("step").value);
  return typed > 0 && Number.isFinite(typed) ? typed : 0.1;
}

function tidy(value) {
  return Number(value.toFixed(3));
}

function numberOf(text) {
  return text.trim() === "" ? NaN : Number(text.trim().replace("−", "-").replace(",", "."));
}

// --- The picture

class Picture extends Chart {
  constructor() {
    const chosen = draw("circle", { class: "chosen", r: 7, visibility: "hidden" });
    super("drawing", chosen);
    this.mark = chosen;
    this.chosen = null; // the point whose value has the focus
    this.dragged = null;
    this.next = null; // the newest value of a drag that was not asked for yet
    this.element.addEventListener("pointerdown", (event) => this.take(event));
    this.element.addEventListener("pointermove", (event) => this.drag(event));
    this.element.addEventListener("pointerup", (event) => this.drop(event));
    this.element.addEventListener("pointercancel", () => {
      this.dragged = null;
      ask(() => ({ do: "show" }));
    });
    this.follow();
  }

  redraw() {
    if (!this.clear() || state === null) {
      return;
    }
    const { font } = this;
    const { places, now, before } = state;
    const [first, end] = [places[0], places[places.length - 1]];
    if (this.dragged === null) { // under a drag the scale stays
      const [low, high] = extent([0, ...ways.flatMap((way) => [...now[way], ...before[way]])]);
      const air = (high - low) * 0.12 || 1;
      this.limits = [low - air, high + air];
    }
    const [top, bottom] = [font * 1.8, this.height - font * 2.9];
    const rows = ticks(...this.limits, (bottom - top) / (font * 2.6));
    const words = rows.values.map((value) => fixed(value, rows.decimals));
    const left = Math.max(...words.map((text) => textWidth(text, font))) + font;
    const right = this.width - font;
    this.across = linear(first, end, left + font, right - font);
    this.up = linear(...this.limits, bottom, top);
    this.value = linear(bottom, top, ...this.limits);
    this.rows(rows.values.map(this.up), words, left, right, rows.values.findIndex((value) => Math.abs(value) < 1e-12));
    this.label(state.small, 0, font, "start");
    const columns = ticks(first, end, (right - left) / (font * 5));
    for (const value of columns.values) {
      this.stroke(this.across(value), top, this.across(value), bottom, "grid");
      this.label(fixed(value, columns.decimals), this.across(value), bottom + font * 1.4, "middle");
    }
    this.label(`position / ${state.unit}`, (left + right) / 2, bottom + font * 2.7, "middle");
    this.curves("line before", before);
    this.curves("line", now);
    if (places.length <= MOST_MARKS) {
      for (const way of ways) {
        this.back.append(draw("path", { class: `mark ${kind(way)}`, d: places.map((_, index) => this.triangle(way, index)).join("") }));
      }
    }
    this.mark.setAttribute("visibility", this.chosen === null ? "hidden" : "visible");
    if (this.chosen !== null) {
      const [x, y] = this.place(this.chosen.way, this.chosen.index);
      this.mark.setAttribute("transform", `translate(${x} ${y})`);
      this.mark.setAttribute("class", `chosen ${kind(this.chosen.way)}`);
    }
  }

  curves(name, values) {
    for (const way of ways) {
      this.back.append(draw("path", { class: `${name} ${kind(way)}`, d: path(state.places, values[way], this.across, this.up) }));
    }
  }

  place(way, index) {
    return [round(this.across(state.places[index])), round(this.up(state.now[way][index]))];
  }

  /** A mark that points in the direction of travel. */
  triangle(way, index) {
    const [[x, y], size] = [this.place(way, index), way === "forward" ? 5 : -5];
    return `M${x - size} ${y - 5}L${x + size} ${y}L${x - size} ${y + 5}Z`;
  }

  choose(point) {
    this.chosen = point;
    this.redraw();
  }

  take(event) {
    const { left, top } = this.element.getBoundingClientRect();
    let nearest = REACH;
    for (const way of ways) {
      state.places.forEach((_, index) => {
        const [x, y] = this.place(way, index);
        const distance = Math.hypot(left + x - event.clientX, top + y - event.clientY);
        if (distance < nearest) {
          nearest = distance;
          this.dragged = { way, index, from: event.clientY, isMoved: false };
        }
      });
    }
    if (this.dragged !== null) {
      event.preventDefault();
      this.element.setPointerCapture(event.pointerId);
      inputs[this.dragged.way][this.dragged.index].focus({ preventScroll: true }); // the arrow keys go on from here
    }
  }

  /** The value under the pointer, in whole steps. */
  under(event) {
    return Math.round(this.value(event.clientY - this.element.getBoundingClientRect().top) / step()) * step();
  }

  drag(event) {
    if (this.dragged !== null && (this.dragged.isMoved ||= Math.abs(event.clientY - this.dragged.from) > 2)) {
      const isAsked = this.next !== null;
      this.next = this.under(event);
      if (!isAsked) {
        ask(() => this.tried());
      }
    }
  }

  /** Ask for the newest place of a drag: those that passed meanwhile are of no interest. */
  tried() {
    const { dragged, next } = this;
    this.next = null;
    return dragged === null || next === null ? null : changed(dragged.way, dragged.index, next, "try");
  }

  drop(event) {
    const { dragged } = this;
    if (dragged !== null) {
      const value = this.under(event);
      this.dragged = null;
      this.next = null;
      if (dragged.isMoved) { // a click alone chooses a point
        ask(() => changed(dragged.way, dragged.index, value));
      }
    }
  }
}

function kind(way) {
  return state.one_way ? "both" : way;
}

// --- The grid

const inputs = {};
const lines = [];

function makeGrid() {
  const heads = [`at / ${state.unit}`, ...ways.map((way) => `${NAMES[kind(way)]} / ${state.small}`), ...(state.one_way ? [] : ["difference"])];
  byId("heads").append(...heads.map((text) => make("th", { scope: "col", text })));
  for (const way of ways) {
    inputs[way] = [];
  }
  state.positions.forEach((position, index) => {
    const row = make("tr", {}, make("th", { scope: "row", text: position }));
    for (const way of ways) {
      const label = `${NAMES[kind(way)]} at ${position} ${state.unit}`;
      const input = make("input", { inputmode: "decimal", autocomplete: "off", "aria-label": label, "aria-describedby": "help" });
      input.addEventListener("change", () => typed(input, way, index));
      input.addEventListener("keydown", (event) => pressed(event, way, index));
      input.addEventListener("focus", () => {
        input.select();
        picture.choose({ way, index });
      });
      input.addEventListener("blur", () => picture.choose(null));
      inputs[way].push(input);
      row.append(make("td", {}, input, make("span", { class: "was" })));
    }
    row.append(...(state.one_way ? [] : [make("td", { class: "difference" })]));
    lines.push(row);
  });
  byId("grid").append(...lines);
}

function typed(input, way, index) {
  const value = numberOf(input.value);
  if (!Number.isFinite(value)) {
    say(`“${input.value}” is not a number. The value stays ${state.now[way][index]} ${state.small}.`, true);
    put(input, state.now[way][index]);
    return;
  }
  input.dataset.shown = input.value; // the answer may replace it
  if (value !== state.now[way][index]) {
    ask(() => changed(way, index, value));
  }
}

function put(input, value) {
  input.value = String(value);
  input.dataset.shown = input.value;
}

function pressed(event, way, index) {
  const input = inputs[way][index];
  if (event.key in STEPS) {
    event.preventDefault();
    typed(input, way, index);
    nudge(way, index, STEPS[event.key]);
  } else if (event.key === "Enter") {
    typed(input, way, index);
    inputs[way][index + (event.shiftKey ? -1 : 1)]?.focus();
  } else if (event.key === "Escape") {
    put(input, state.now[way][index]);
  }
}

// --- Showing a state

let shownRemarks = "";

function say(text, isRefused = false) {
  setText(byId("said"), text);
  byId("said").className = isRefused ? "refused" : "";
}

function showState(newest, isRefused, asked) {
  const isFirst = state === null;
  state = newest;
  if (isFirst) {
    begin();
  }
  lines.forEach((line, index) => {
    for (const way of ways) {
      const [input, now, before] = [inputs[way][index], state.now[way][index], state.before[way][index]];
      if (input !== document.activeElement || input.value === input.dataset.shown) {
        put(input, now); // what is being typed stays
      }
      setText(input.nextElementSibling, now === before ? "" : `was ${before}`);
    }
    line.classList.toggle("changed", ways.some((way) => state.now[way][index] !== state.before[way][index]));
    if (!state.one_way) {
      setText(line.lastElementChild, String(tidy(state.now.forward[index] - state.now.backward[index])));
    }
  });
  byId("undo").disabled = !state.can_undo;
  byId("redo").disabled = !state.can_redo;
  byId("save").disabled = !state.is_changed || state.refusals.length > 0;
  show(byId("copy"), asked === "save" ? isRefused : !byId("copy").hidden && state.is_changed);
  document.title = `${state.is_changed ? "• " : ""}${state.file}`;
  showRemarks();
  picture.redraw();
  say(state.said, isRefused);
}

function showRemarks() {
  const { remarks, refusals } = state;
  const loads = remarks.length === 0 ? "No remarks: the gateway loads this table." : "The gateway loads this table, with remarks.";
  setText(byId("verdict"), refusals.length > 0 ? "This table cannot be saved: correct the errors." : loads);
  byId("verdict").className = refusals.length > 0 ? "refused" : "";
  const newest = JSON.stringify([remarks, refusals]);
  if (newest !== shownRemarks) { // a screen reader reads what is new
    shownRemarks = newest;
    const unread = remarks.length === 0 ? refusals : []; // there is no file to read
    byId("remarks").replaceChildren(...unread.map((text) => make("li", { text })), ...remarks.map(remark));
  }
}

function remark({ code, severity, message, point, way }) {
  const item = make("li", { class: severity }, make("b", { text: `${severity} ${code}` }), make("span", { text: ` ${message} ` }));
  if (point !== null) {
    const button = make("button", { text: `to the point at ${state.positions[point]}` });
    button.addEventListener("click", () => inputs[state.one_way ? "forward" : way][point].focus());
    item.append(button);
  }
  return item;
}

function begin() {
  ways = state.one_way ? ["forward"] : ["forward", "backward"];
  setText(byId("name"), state.file);
  setText(byId("about"), `${state.axis ? `Axis ${state.axis}, ` : ""}${state.format}, ${state.positions.length} points, in ${state.folder}`);
  setText(byId("step-unit"), state.small);
  byId("together").checked = state.together;
  show(byId("together-label"), !state.one_way);
  byId("notes").replaceChildren(...state.notes.map((text) => make("li", { text })));
  for (const [line, text] of [...ways.map((way) => [kind(way), NAMES[kind(way)]]), ["before", "dotted: as the file was opened"]]) {
    const sample = draw("svg", { viewBox: "0 0 36 12", "aria-hidden": "true" }, draw("path", { class: `line ${line}`, d: "M0 7H36" }));
    byId("legend").append(make("span", {}, sample, make("span", { text })));
  }
  setText(picture.title, "Corrections over the position; the table of points has the values");
  byId("drawing").append(picture.element);
  makeGrid();
}

const picture = new Picture();
for (const what of ["undo", "redo", "save", "copy"]) {
  byId(what).addEventListener("click", () => ask(() => ({ do: what })));
}
document.addEventListener("keydown", (event) => {
  const key = event.key.toLowerCase();
  if ((event.ctrlKey || event.metaKey) && ["z", "y", "s"].includes(key)) {
    event.preventDefault();
    document.activeElement.dispatchEvent(new Event("change")); // what was typed so far counts
    const what = key === "s" ? "save" : key === "y" || event.shiftKey ? "redo" : "undo";
    ask(() => ({ do: what }));
  }
});
window.addEventListener("beforeunload", (event) => {
  if (state?.is_changed) {
    event.preventDefault();
  }
});
const stream = new EventSource("events"); // its end is the end of this tab
stream.addEventListener("open", () => say(""));
stream.addEventListener("error", () => say("The program has ended: start table edit again.", true));
ask(() => ({ do: "show" }));
