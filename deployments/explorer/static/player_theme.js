/** Colors of the drawings, from the page's style sheet, so that they follow light and dark. */

const NAMES = [
  ...["pass", "fail", "not-judged", "accent", "ink", "muted", "line", "ground", "panel", "well"],
  ...["wall", "free", "unknown", "world-wall", "keepout", "speed-zone", "obstacle", "obstacle-edge"],
  ...["belief", "plan", "horizon", "scan", "goal", "reference", "cost", "mark"],
  ...["recovery", "error", "stop", "second"],
];

/**
 * Read the colors.
 * @returns {Object<string, string>}
 */
export function readTheme() {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(NAMES.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

/**
 * Call `changed` when the system goes from light to dark or back.
 * @param {() => void} changed
 */
export function onThemeChange(changed) {
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
}

/**
 * Red, green, blue of a color `#rrggbb`.
 * @param {string} color
 * @returns {[number, number, number]}
 */
export function rgb(color) {
  const whole = Number.parseInt(color.slice(1), 16);
  return [whole >> 16, (whole >> 8) & 255, whole & 255];
}

/** Activities and the colors of their bands, as in the pictures of `vastflow replay`. */
const BANDS = {
  driving: ["pass", 0.28],
  standing: ["muted", 0.35],
  following: ["pass", 0.28],
  "no progress": ["recovery", 0.55],
  "no command": ["ink", 0.7],
  stopped: ["fail", 0.95],
  spin: ["mark", 0.85],
  wait: ["muted", 0.6],
  "back up": ["belief", 0.85],
};

/**
 * Color and opacity of an activity's band.
 * @param {string} activity
 * @returns {[string, number]}
 */
export function band(activity) {
  return BANDS[activity] || ["muted", 0.22];
}

/** Verdicts to the names of their colors and to words. */
export const VERDICTS = {
  pass: ["pass", "passed"],
  fail: ["fail", "failed"],
  "not judged": ["not-judged", "not judged"],
};
