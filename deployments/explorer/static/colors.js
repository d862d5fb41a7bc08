/** Colors and words of verdicts, and rates that are drawn in them. */
import { drawn, element } from "./dom.js";

/** Verdicts by their codes: name, class and color in the style sheet, and word. */
export const VERDICTS = [
  { name: "pass", color: "pass", word: "passed" },
  { name: "fail", color: "fail", word: "failed" },
  { name: "not judged", color: "not-judged", word: "not judged" },
];

/** @type {(name: string) => {name: string, color: string, word: string}} */
export const verdictOf = (name) => VERDICTS.find((each) => each.name === name) ?? VERDICTS[2];

/** A verdict's word in its color. */
export const verdictMark = (name, tag = "span") => element(tag, { class: verdictOf(name).color }, verdictOf(name).word);

/**
 * Colors `rgb(…)` of the style sheet by name, as they are now: in light or dark.
 * @returns {Object<string, string>}
 */
export function readTheme() {
  const resolved = (name) => {
    // A browser resolves light and dark for properties that it knows alone.
    document.body.style.outlineColor = `var(--${name})`;
    return getComputedStyle(document.body).outlineColor;
  };
  return new Proxy({}, { get: (known, name) => (known[name] ??= resolved(String(name))) });
}

/** Colors of the verdicts. */
export function verdictKey() {
  const parts = VERDICTS.map(({ word, color }) => {
    const swatch = drawn("rect", { width: 10, height: 10, class: color });
    return element("span", {}, drawn("svg", { viewBox: "0 0 10 10", width: 10, height: 10 }, swatch), ` ${word}`);
  });
  return element("p", { class: "key muted" }, ...parts);
}

/** A drawing beside its text. */
const small = (width, height, kind, ...children) => {
  const viewBox = `0 0 ${width} ${height}`;
  return drawn("svg", { class: kind, width, height, viewBox, "aria-hidden": "true" }, ...children);
};

/** Numbers of passed, failed, and not judged runs as a bar; what is missing to its end is not judged yet. */
export function partsBar(parts, most, width, height) {
  const rects = parts.map((n, k) => {
    const x = (width * parts.slice(0, k).reduce((sum, each) => sum + each, 0)) / most;
    return drawn("rect", { class: VERDICTS[k].color, x, width: (width * n) / most, height });
  });
  return small(width, height, "parts", drawn("rect", { class: "track", width, height }), ...rects);
}

/** A rate with its interval, as in the list of campaigns. */
export function rateBar(rate, [low, high], width) {
  const span = { x: width * low, y: 3, width: Math.max(width * (high - low), 1), height: 4 };
  return small(
    width,
    10,
    "rate",
    drawn("rect", { class: "track", y: 3, width, height: 4 }),
    drawn("rect", { class: "interval", ...span }),
    drawn("rect", { class: "at", x: Math.min(width * rate - 1, width - 2), width: 2, height: 10 }),
  );
}
