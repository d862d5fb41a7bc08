/** Keys of the player, and the dialog that lists them. */

import { element } from "./dom.js";

/** @type {Array<[string, string, string]>} Keys, action, and words. */
export const KEYS = [
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
    const target = /** @type {Element} */ (event.target);
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    if (target.matches("select, textarea, input:not([type=checkbox])")) return;
    // Space presses what has the focus.
    if (event.key === " " && target.matches("button, a, summary, input")) return;
    const found = KEYS.find(([key]) => key === event.key);
    if (!found) return;
    event.preventDefault();
    actions[found[1]](event.shiftKey);
  });
}

/**
 * Make the dialog with all keys.
 * @returns {HTMLDialogElement}
 */
export function helpDialog() {
  const rows = KEYS.map(([key, , words]) =>
    element("tr", {}, element("th", { scope: "row" }, element("kbd", {}, NAMES[key] || key)), element("td", {}, words)),
  );
  const close = element("button", { click: () => dialog.close() }, "close");
  const dialog = /** @type {HTMLDialogElement} */ (
    element(
      "dialog",
      { class: "panel", "aria-label": "Keys" },
      element("h2", {}, "Keys"),
      element("table", {}, element("tbody", {}, ...rows)),
      element("p", { class: "muted" }, "On the map: drag to move, wheel or two fingers to zoom, double click for all of it."),
      close,
    )
  );
  return dialog;
}
