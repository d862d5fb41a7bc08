/** Elements, and replies of the server. */

const KINDS = { Uint8Array, Uint16Array, Uint32Array, Int16Array, Int32Array, Float32Array };

/** @typedef {Object<string, string | number | boolean | EventListener | null | undefined>} Attributes */

/**
 * Make an element. Text becomes text nodes, so that names are never read as HTML.
 * @param {string} tag
 * @param {Attributes} [attributes] A function is a listener of the event.
 * @param {...(Node | string | number)} children
 * @returns {HTMLElement}
 */
export function element(tag, attributes = {}, ...children) {
  return /** @type {HTMLElement} */ (filled(document.createElement(tag), attributes, children));
}

/** Make an element of a drawing. @type {(tag: string, attributes?: Attributes, ...children: any[]) => SVGElement} */
export function drawn(tag, attributes = {}, ...children) {
  return filled(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

function filled(made, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name, value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(name, String(value));
  }
  made.append(...children);
  return made;
}

/** A paragraph in muted color. @type {(...children: (Node | string)[]) => HTMLElement} */
export const note = (...children) => element("p", { class: "muted" }, ...children);

/** @type {(href: string, text: string) => HTMLElement} */
export const link = (href, text) => element("a", { href }, text);

/**
 * Make a row of a table.
 * @param {(Node | string | (Node | string)[])[]} cells
 * @param {string[]} [classes] One for each column.
 * @param {Attributes} [more]
 */
export function row(cells, classes = [], tag = "td", more = {}) {
  const made = cells.map((cell, k) => element(tag, { class: classes[k], ...more }, ...[cell].flat()));
  return element("tr", {}, ...made);
}

/** Make a table in a box that scrolls by itself. */
export function tableOf(heads, rows, classes = []) {
  const head = element("thead", {}, row(heads, classes, "th", { scope: "col" }));
  const body = element("tbody", {}, ...rows.map((cells) => row(cells, classes)));
  return element("div", { class: "scroll" }, element("table", {}, head, body));
}

/** Make an address with names in its query; null and undefined leave a name out. */
export function address(path, query) {
  const given = Object.entries(query).filter(([, value]) => value !== null && value !== undefined);
  return `${path}?${new URLSearchParams(given)}`;
}

/**
 * Ask the server; an error has a sentence for people as its message.
 * @param {string} place
 * @param {RequestInit} [options]
 */
export async function fetched(place, options) {
  const reply = await fetch(place, options).catch((error) => {
    if (error.name === "AbortError") throw error;
    throw new Error("The explorer does not answer; is `vastflow ui` still running?", { cause: error });
  });
  if (reply.ok) return reply;
  const told = await reply.json().catch(() => ({}));
  throw new Error(told.error || `The explorer answered ${reply.status}.`);
}

/** Ask the server for JSON. */
export const fetchJson = async (place, options) => (await fetched(place, options)).json();

/**
 * Ask the server for a line of JSON and arrays of numbers after it, which are read in place.
 * @returns {Promise<{header: any, arrays: Object<string, any>}>}
 */
export async function fetchPacked(place, options) {
  const buffer = await (await fetched(place, options)).arrayBuffer();
  const bytes = new Uint8Array(buffer);
  const line = bytes.indexOf(10);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(0, line)));
  const arrays = {};
  for (const [name, { type, shape, offset }] of Object.entries(header.arrays)) {
    const Kind = KINDS[`${type.replace(/^./, (letter) => letter.toUpperCase())}Array`];
    const length = shape.reduce((product, n) => product * n, 1);
    arrays[name] = new Kind(buffer, line + 1 + offset, length);
  }
  return { header, arrays };
}

/** Show an error as a sentence in an element; requests that were given up are no errors. */
export function showError(place, error) {
  if (error.name !== "AbortError")
    place.replaceChildren(element("p", { class: "sentence", role: "alert" }, error.message));
}

/** Run a view; its error takes its place. */
export const shown = (place, view) => view().catch((error) => showError(place, error));

/**
 * Follow drags over an element.
 * @param {Element} over
 * @param {(event: PointerEvent) => number[]} placeOf In units of the caller.
 * @param {(from: number[], to: number[]) => void} moved
 * @param {(from: number[], to: number[]) => void} done
 * @param {(event: PointerEvent) => void} [hovered] While no button is down.
 */
export function onDrag(over, placeOf, moved, done, hovered = () => {}) {
  let from = null;
  over.addEventListener("pointerdown", (event) => {
    from = placeOf(event);
    over.setPointerCapture(event.pointerId);
  });
  over.addEventListener("pointermove", (event) => (from ? moved(from, placeOf(event)) : hovered(event)));
  over.addEventListener("pointercancel", () => (from = null));
  over.addEventListener("pointerup", (event) => {
    if (from) done(from, placeOf(event));
    from = null;
  });
}

/** @returns {[number, number]} Two numbers, the lesser first. */
export const ordered = (a, b) => (a < b ? [a, b] : [b, a]);
