/** Elements, and replies of the server. */

const SVG = "http://www.w3.org/2000/svg";

/**
 * Make an element. Text becomes text nodes, so that names are never read as HTML.
 * @param {string} tag
 * @param {Object<string, string | number | boolean | EventListener>} [attributes] A function is a listener of the event.
 * @param {...(Node | string | number)} children
 * @returns {HTMLElement}
 */
export function element(tag, attributes = {}, ...children) {
  return /** @type {HTMLElement} */ (filled(document.createElement(tag), attributes, children));
}

/**
 * Make an element of a drawing.
 * @param {string} tag
 * @param {Object<string, string | number | boolean | EventListener>} [attributes]
 * @param {...(Node | string | number)} children
 * @returns {SVGElement}
 */
export function drawn(tag, attributes = {}, ...children) {
  return /** @type {SVGElement} */ (filled(document.createElementNS(SVG, tag), attributes, children));
}

function filled(made, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name, value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(name, String(value));
  }
  made.append(...children.map((child) => (child instanceof Node ? child : String(child))));
  return made;
}

/**
 * Make an address with names in its query; null and undefined leave a name out.
 * @param {string} path
 * @param {Object<string, string | number | null | undefined>} query
 * @returns {string}
 */
export function address(path, query) {
  const given = Object.entries(query).filter(([, value]) => value !== null && value !== undefined);
  const text = new URLSearchParams(given.map(([name, value]) => [name, String(value)])).toString();
  return text ? `${path}?${text}` : path;
}

/**
 * Ask the server; an error has a sentence for people as its message.
 * @param {string} place
 * @param {RequestInit} [options]
 * @returns {Promise<Response>}
 */
export async function fetched(place, options = {}) {
  let reply;
  try {
    reply = await fetch(place, options);
  } catch (error) {
    if (error instanceof DOMException && error.name === "AbortError") throw error;
    throw new Error("The explorer does not answer; is `vastflow ui` still running?", { cause: error });
  }
  if (reply.ok) return reply;
  const told = await reply.json().catch(() => ({}));
  throw new Error(told.error || `The explorer answered ${reply.status}.`);
}

/**
 * Ask the server for JSON.
 * @param {string} place
 * @param {RequestInit} [options]
 * @returns {Promise<any>}
 */
export async function fetchJson(place, options = {}) {
  return (await fetched(place, options)).json();
}

/**
 * Show an error as a sentence in an element, which is emptied first; requests that were given up are no errors.
 * @param {Element} place
 * @param {unknown} error
 */
export function showError(place, error) {
  if (error instanceof DOMException && error.name === "AbortError") return;
  const text = error instanceof Error ? error.message : String(error);
  place.replaceChildren(element("p", { class: "sentence", role: "alert" }, text));
}
