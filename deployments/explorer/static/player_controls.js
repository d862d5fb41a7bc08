/** Controls: playing, speed, time, and layers. */

import { element } from "./dom.js";

export const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16];

/** Layers: name, words, color, whether it is shown at first. */
const RECORDED = [
  ["past", "trajectory so far", "pass", true],
  ["future", "to come", "muted", true],
  ["belief", "believed pose", "belief", true],
  ["reference", "reference path", "muted", false],
  ["obstacles", "obstacles", "obstacle", true],
  ["contacts", "contacts", "fail", true],
];
const EXECUTED = [
  ["scan", "lidar", "ink", true],
  ["plan", "plan", "goal", true],
  ["global", "global costmap", "cost", true],
  ["local", "local costmap", "belief", true],
  ["particles", "particles", "belief", true],
  ["horizon", "MPPI's horizon", "horizon", true],
];

/**
 * Make the row of buttons.
 * @param {Object<string, (shift: boolean) => void>} actions
 * @param {(speed: number) => void} setSpeed
 */
export function controls(actions, setSpeed) {
  const button = (text, name, title, kind = "") =>
    element("button", { class: kind, title, "aria-label": title, click: () => actions[name](false) }, text);
  const play = element("button", { class: "main", title: "space", click: () => actions.toggle(false) }, "Play");
  const time = element("output", { class: "time" });
  const options = SPEEDS.map((each) => element("option", { value: each, selected: each === 1 }, `${each} ×`));
  const change = () => setSpeed(Number(speed.value));
  const speed = /** @type {HTMLSelectElement} */ (element("select", { "aria-label": "speed", change }, ...options));
  const steps = [button("◂", "tickBack", "one tick back (,)"), button("▸", "tickAhead", "one tick ahead (.)")];
  const others = [
    button("next contact", "contact", "next contact (c)"),
    button("follow", "follow", "follow the robot (f)"),
    button("whole map", "fit", "whole map (0)"),
    button("copy address", "copy", "copy the address of this moment"),
    button("?", "help", "keys (?)"),
  ];
  return { row: element("div", { class: "row" }, play, ...steps, time, speed, ...others), play, time, speed };
}

/**
 * Make the check boxes of layers.
 * @param {Set<string>} shown Names of those that are ticked.
 * @param {() => void} changed
 * @param {HTMLElement} execute The button that asks for the layers of an execution.
 */
export function layerBoxes(shown, changed, execute) {
  const box = ([name, words, color, first], disabled) => {
    const tick = () => (input.checked ? shown.add(name) : shown.delete(name)) && changed();
    const input = /** @type {HTMLInputElement} */ (element("input", { type: "checkbox", checked: first, disabled }));
    input.addEventListener("change", tick);
    if (first) shown.add(name);
    const swatch = element("span", { class: "swatch" });
    swatch.style.background = `var(--${color})`;
    return { input, label: element("label", {}, input, swatch, words) };
  };
  const [recorded, executed] = [RECORDED.map((each) => box(each, false)), EXECUTED.map((each) => box(each, true))];
  const labels = [recorded, executed].map((boxes) => boxes.map(({ label }) => label));
  const row = element(
    "div",
    { class: "row", role: "group", "aria-label": "Layers" },
    ...labels[0],
    execute,
    ...labels[1],
  );
  return { row, enable: () => executed.forEach(({ input }) => (input.disabled = false)) };
}
