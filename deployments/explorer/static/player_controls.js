/** The row of controls: playing, speed, time, layers. */

import { element } from "./dom.js";

export const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16];

/** @type {Array<[string, string, boolean]>} Layers of the recording: name, words, whether shown at first. */
export const RECORDED = [
  ["past", "trajectory so far", true],
  ["future", "trajectory to come", true],
  ["belief", "believed pose", true],
  ["reference", "reference path", false],
  ["obstacles", "obstacles", true],
  ["contacts", "contacts", true],
];
/** @type {Array<[string, string, boolean]>} Layers of an execution. */
export const EXECUTED = [
  ["scan", "lidar", true],
  ["plan", "plan", true],
  ["global", "global costmap", true],
  ["local", "local costmap", true],
  ["particles", "particles", true],
  ["horizon", "MPPI's horizon", true],
];

/**
 * Make the controls.
 * @param {Object<string, (shift: boolean) => void>} actions
 * @param {(speed: number) => void} setSpeed
 * @param {() => void} copy
 */
export function controls(actions, setSpeed, copy) {
  const press = (name) => () => actions[name](false);
  const play = element("button", { class: "main", click: press("toggle") }, "Play");
  const time = element("output", { class: "time" });
  const speed = /** @type {HTMLSelectElement} */ (
    element(
      "select",
      { "aria-label": "Speed", change: () => setSpeed(Number(speed.value)) },
      ...SPEEDS.map((each) => element("option", { value: each, selected: each === 1 }, `${each} ×`)),
    )
  );
  const row = element(
    "div",
    { class: "controls" },
    play,
    element("button", { click: press("tickBack"), title: "one tick back (,)", "aria-label": "one tick back" }, "◂"),
    element("button", { click: press("tickAhead"), title: "one tick ahead (.)", "aria-label": "one tick ahead" }, "▸"),
    time,
    speed,
    element("button", { click: press("contact"), title: "c" }, "next contact"),
    element("button", { click: press("follow"), title: "f" }, "follow"),
    element("button", { click: press("fit"), title: "0" }, "whole map"),
    element("button", { click: copy }, "copy address"),
    element("button", { click: press("help"), title: "?", "aria-label": "keys" }, "?"),
  );
  return { row, play, time, speed };
}

/**
 * Make the check boxes of layers.
 * @param {Set<string>} shown Changed with the boxes.
 * @param {() => void} changed
 * @param {HTMLElement} execute The button that asks for the layers of an execution.
 */
export function layerBoxes(shown, changed, execute) {
  const box = (disabled) => (layer) => {
    const [name, words, first] = layer;
    if (first) shown.add(name);
    const input = /** @type {HTMLInputElement} */ (element("input", { type: "checkbox", checked: first, disabled }));
    input.addEventListener("change", () => {
      if (input.checked) shown.add(name);
      else shown.delete(name);
      changed();
    });
    return { input, label: element("label", {}, input, element("span", { class: `swatch ${name}` }), words) };
  };
  const recorded = RECORDED.map(box(false));
  const executed = EXECUTED.map(box(true));
  const labels = (boxes) => boxes.map(({ label }) => label);
  const row = element("fieldset", { class: "layers" }, element("legend", {}, "Layers"), ...labels(recorded), execute);
  row.append(...labels(executed));
  return { row, enable: () => executed.forEach(({ input }) => (input.disabled = false)) };
}
