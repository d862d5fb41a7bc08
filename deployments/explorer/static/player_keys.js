/** Keys of the player, and the dialog that lists them. */

import { element } from "./dom.js";

/** Keys, actions, and words. */
const KEYS = [
  [" ", "toggle", "play, pause"],
  ["ArrowLeft", "back", "0.1 s back; with shift 1 s"],
  ["ArrowRight", "ahead", "0.1 s ahead; with shift 1 s"],
  [",", "tickBack", "one tick back"],
  [".", "tickAhead", "one tick ahead"],
  ["Home", "start", "to the start"],
  ["End", "end", "to the end"],
  ["[", "slower", "slower"],
  ["]", "faster", "faster"],
  ["c", "contact", "to the next contact"],
  ["n", "next", "next failed run"],
  ["p", "previous", "previous failed run"],
  ["+", "closer", "zoom in"],
  ["-", "farther", "zoom out"],
  ["0", "fit", "whole map"],
  ["f", "follow", "follow the robot"],
  ["?", "help", "these keys"],
];
const NAMES = { " ": "space", ArrowLeft: "←", ArrowRight: "→" };

/**
 * Call the action of each key that is pressed outside of fields.
 * @param {Object<string, (shift: boolean) => void>} actions
 */
export function onKeys(actions) {
  document.addEventListener("keydown", (event) => {
    const found = KEYS.find(([key]) => key === event.key);
    if (!found || event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    // Space presses what has the focus.
    const taken = event.key === " " ? "button, a, summary, input, select" : "select, input:not([type=checkbox])";
    if (document.activeElement?.matches(taken)) return;
    event.preventDefault();
    actions[found[1]](event.shiftKey);
  });
}

/** @returns {HTMLDialogElement} */
export function helpDialog() {
  const rows = KEYS.map(([key, , words]) => {
    return element("tr", {}, element("th", { scope: "row" }, NAMES[key] || key), element("td", {}, words));
  });
  const map = "On the map: drag to move it, wheel or two fingers to zoom, double click to see all of it.";
  const close = element("form", { method: "dialog" }, element("button", {}, "close"));
  const table = element("table", {}, element("tbody", {}, ...rows));
  const dialog = element("dialog", { class: "panel", "aria-label": "Keys" }, table, element("p", {}, map), close);
  return /** @type {HTMLDialogElement} */ (dialog);
}
