/** Elements, numbers, and replies of the server. */

const KINDS = { Uint8Array, Uint16Array, Uint32Array, Int16Array, Int32Array, Float32Array };

/** Verdicts by their codes: class and color in the style sheet, and word. */
export const VERDICTS = [
  { color: "pass", word: "passed" },
  { color: "fail", word: "failed" },
  { color: "not-judged", word: "not judged" },
];

const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** What the address has. */
export const query = new URLSearchParams(location.search);

export const $ = (id) => document.getElementById(id);

/** Make an element. Text becomes text nodes, so that names are never read as HTML. */
export const element = (tag, attributes = {}, ...children) => filled(document.createElement(tag), attributes, children);

/** Make an element of a drawing. */
export const drawn = (tag, attributes = {}, ...children) =>
  filled(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);

/** Set attributes, add listeners for those that are functions, and append children. */
export function filled(made, attributes, children = []) {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name, value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(name, String(value));
  }
  made.append(...children);
  return made;
}

/** Make an address with names in its query; null and undefined leave a name out. */
export function address(path, query) {
  const given = Object.entries(query).filter(([, value]) => value !== null && value !== undefined);
  return `${path}?${new URLSearchParams(given)}`;
}

/** Put changes into the address; the back button leaves the page as before. */
export function remember(changes) {
  for (const [key, value] of Object.entries(changes)) {
    if (value) query.set(key, value);
    else query.delete(key);
  }
  history.replaceState(null, "", `?${query}`);
}

/** Tell a run in an element: a link to its page, perhaps to a time, and its verdict. */
export function tellRun(place, configuration, run, verdict, more = "", t = null) {
  const href = address("/run", { c: query.get("c"), configuration, run, t });
  place.replaceChildren(element("a", { href }, `${configuration}, run ${run}`), `: ${VERDICTS[verdict].word}${more}`);
}

/** @returns {string} A number in four digits; what was not measured is a dash. */
export function number(value) {
  if (value === null || Number.isNaN(value)) return "–";
  if (Number.isInteger(value) && Math.abs(value) < 1e6) return String(value);
  return String(Number(value.toPrecision(4)));
}

export const count = (value) => value.toLocaleString("en-US");

/** Steps to the right and down of a key that moves something; undefined for others. @type {(event: KeyboardEvent) => any} */
export const stepOf = ({ key, ctrlKey, metaKey, altKey }) => (ctrlKey || metaKey || altKey ? undefined : STEPS[key]);

export const within = (value, low, high) => Math.min(Math.max(value, low), high);

/** Ask the server; an error has a sentence for people as its message. */
export async function fetched(place, options) {
  const reply = await fetch(place, options).catch((error) => {
    if (error.name === "AbortError") throw error;
    throw new Error("The explorer does not answer; is `vastflow ui` still running?", { cause: error });
  });
  if (reply.ok) return reply;
  const told = await reply.json().catch(() => ({}));
  throw Object.assign(new Error(told.error || `The explorer answered ${reply.status}.`), { asks: told.asks });
}

/** Ask the server for a header, a line of JSON, and arrays of numbers after it, which are read in place. */
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

/** Ask the server for parts of the page, and put them there. */
export async function fetchParts(place, options) {
  showParts(await (await fetched(place, { ...options, headers: { Accept: "text/html" } })).text());
}

/** Fill elements of the page from those of HTML that have the same ids. */
export function showParts(html) {
  for (const part of new DOMParser().parseFromString(html, "text/html").body.children) {
    filled($(part.id), Object.fromEntries([...part.attributes].map(({ name, value }) => [name, value])));
    replace($(part.id), ...part.childNodes);
  }
}

/** Replace the content of an element; what is unfolded and what has the focus stay, known by their keys. */
export function replace(place, ...children) {
  const open = new Map([...place.querySelectorAll("details")].map((each) => [each.dataset.key, each.open]));
  const focus = place.contains(document.activeElement) && document.activeElement.dataset.key;
  place.replaceChildren(...children);
  for (const each of place.querySelectorAll("details")) each.open = open.get(each.dataset.key) ?? each.open;
  if (focus) place.querySelector(`[data-key="${CSS.escape(focus)}"]`)?.focus({ preventScroll: true });
}

/** Show an error as a sentence in an element; requests that were given up are no errors. */
export function showError(place, error) {
  if (error.name !== "AbortError")
    place.replaceChildren(element("p", { class: "sentence", role: "alert" }, error.message));
}

/** Run a view; its error takes its place. */
export const shown = (place, view) => view().catch((error) => showError(place, error));

/** Copy a text, and tell it in an element, or something else where the browser does not let a page copy. */
export async function copy(text, place, told, otherwise) {
  place.textContent = await navigator.clipboard.writeText(text).then(
    () => told,
    () => otherwise,
  );
}

/** Colors `rgb(…)` of the style sheet by name, as they are now: in light or dark. */
export function readTheme() {
  const resolved = (name) => {
    // A browser resolves light and dark for properties that it knows alone.
    document.body.style.outlineColor = `var(--${name})`;
    return getComputedStyle(document.body).outlineColor;
  };
  return new Proxy({}, { get: (known, name) => (known[name] ??= resolved(String(name))) });
}

/** Count how often all of the page was shown, for tests. */
export function tellShown() {
  const { dataset } = document.documentElement;
  dataset.shown = String(Number(dataset.shown ?? 0) + 1);
}
