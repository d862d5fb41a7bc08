/** Colors and words that all parts of the player share. */

/** Marks of events: a letter and a color. */
export const MARKS = {
  contact: ["✕", "fail"],
  recovery: ["●", "recovery"],
  error: ["▲", "error"],
  goal: ["◆", "goal"],
  obstacle: ["■", "obstacle-edge"],
  stop: ["■", "horizon"],
};

/** Activities to colors and opacities, as in the pictures of `vastflow replay`. */
export const BANDS = {
  driving: ["pass", 0.28],
  standing: ["muted", 0.35],
  following: ["pass", 0.28],
  "no progress": ["recovery", 0.5],
  "no command": ["ink", 0.7],
  stopped: ["fail", 0.95],
  spin: ["obstacle", 0.85],
  wait: ["muted", 0.6],
  "back up": ["belief", 0.85],
};

/** A number for people; a missing one is no 0. */
export function reading(value) {
  if (value === null || Number.isNaN(value)) return "–";
  if (Number.isInteger(value)) return String(value);
  const digits = Math.abs(value) < 10 ? 2 : Math.abs(value) < 100 ? 1 : 0;
  // Adding 0 takes the sign from a negative 0.
  return (Math.round(value * 1000) / 1000 + 0).toFixed(digits).replace(/^-(0\.?0*)$/, "$1");
}
