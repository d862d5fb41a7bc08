/** Keys and buttons, which are in the page's markup with the names of their actions. */

/**
 * Call the actions of buttons that are pressed, and of keys outside of fields.
 * @param {Object<string, (shift: boolean) => void>} actions
 */
export function onActions(actions) {
  const keys = new Map([...document.querySelectorAll("kbd")].map(({ dataset }) => [dataset.key, dataset.action]));
  document.addEventListener("keydown", (event) => {
    if (!keys.has(event.key) || event.ctrlKey || event.metaKey || event.altKey) return;
    // Space presses what has the focus.
    const taken = event.key === " " ? "button, a, summary, input, select" : "select, input:not([type=checkbox])";
    if (document.activeElement?.matches(taken) || document.querySelector("dialog[open]")) return;
    event.preventDefault();
    actions[keys.get(event.key)](event.shiftKey);
  });
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("button[data-action]"))) {
    button.addEventListener("click", () => actions[button.dataset.action || ""](false));
  }
}

/**
 * Call `change` with the names of the layers that are ticked, now and when a box is.
 * @param {HTMLElement} row
 * @param {(shown: Set<string>) => void} change
 */
export function onLayers(row, change) {
  const boxes = [...row.querySelectorAll("input")];
  const tell = () => change(new Set(boxes.filter(({ checked }) => checked).map(({ value }) => value)));
  row.addEventListener("change", tell);
  for (const swatch of /** @type {NodeListOf<HTMLElement>} */ (row.querySelectorAll("[data-color]"))) {
    swatch.style.color = `var(--${swatch.dataset.color})`;
  }
  tell();
}
