/** Beside the map: verdicts with their reasons and metrics, and events. */
import { element, VERDICTS } from "./dom.js";

/** Marks of events: a letter and a color. */
export const MARKS = {
  contact: ["✕", "fail"],
  recovery: ["●", "belief"],
  error: ["▲", "fail"],
  goal: ["◆", "goal"],
  obstacle: ["■", "obstacle-edge"],
  stop: ["■", "horizon"],
};
const JUDGEMENTS = { pass: VERDICTS[0], fail: VERDICTS[1] };
const ENDS = { SUCCESS: "succeeded", FAILURE: "failed", RUNNING: "still running", INVALID: "given up" };

/** @type {(judgement: string) => {color: string, word: string}} */
export const verdictOf = (judgement) => JUDGEMENTS[judgement] ?? VERDICTS[2];

/** A number for people; a missing one is no 0. */
export function reading(value) {
  if (value === null || Number.isNaN(value)) return "–";
  if (Number.isInteger(value)) return String(value);
  const digits = Math.abs(value) < 10 ? 2 : Math.abs(value) < 100 ? 1 : 0;
  // Adding 0 takes the sign from a negative 0.
  return (Math.round(value * 1000) / 1000 + 0).toFixed(digits).replace(/^-(0\.?0*)$/, "$1");
}

function mark(judgement) {
  const { color, word } = verdictOf(judgement);
  return element("strong", { class: color }, word);
}

/** Verdicts and events of a run. @type {(run: import("./player_run.js").Run, seek: (t: number) => void) => Element} */
export function panel(run, seek) {
  const { header } = run;
  const { outcome, reason, simulated_s, distance_m, recoveries } = header;
  const said = [];
  const other = header.executed !== header.configuration;
  if (other) said.push(`It has the content of ${header.executed}, whose runs were recorded.`);
  if (outcome) {
    const how = `${outcome.replaceAll("_", " ")}${reason ? `: ${reason}` : ""}`;
    const again = `${recoveries} ${recoveries === 1 ? "recovery" : "recoveries"}`;
    said.push(`${how}. ${simulated_s.toFixed(2)} s${run.hasRobot ? `, ${distance_m.toFixed(1)} m, ${again}` : ""}.`);
  }
  const events = run.events.map((event) => [...MARKS[event.mark], event.t_s, event.text]);
  for (const { name, start_s, status, message } of run.hasRobot ? [] : header.behaviors || []) {
    events.push(["▬", "muted", start_s, `${name} ${ENDS[status]}${message ? `: ${message}` : ""}`]);
  }
  const items = events.map(([letter, color, t_s, text]) => {
    const sign = element("span", {}, letter);
    sign.style.color = `var(--${color})`;
    return element("button", { click: () => seek(t_s) }, sign, ` ${t_s.toFixed(2)} s  ${text}`);
  });
  return element(
    "section",
    { class: "panel", "aria-label": run.name },
    element("h2", {}, run.name, " ", mark(header.judgement)),
    ...said.map((text) => element("p", {}, text)),
    ...header.verdicts.map(verdict),
    element("h2", {}, items.length ? `Events: ${items.length}` : "No events"),
    element("div", { class: "events scroll low" }, ...items),
  );
}

function verdict({ oracle, judgement, reason, metrics }) {
  const rows = Object.entries(metrics).map(([name, { value, unit }]) => {
    const [said, of] = value === null ? ["not measured", ""] : [reading(value), unit === "1" ? "" : unit];
    const title = element("th", { scope: "row" }, name.replaceAll("_", " "));
    return element("tr", {}, title, element("td", { class: "n" }, said), element("td", { class: "muted" }, of));
  });
  return element(
    "details",
    { open: judgement !== "pass" },
    element("summary", {}, oracle, " ", mark(judgement)),
    ...(reason ? [element("p", {}, reason)] : []),
    element("table", { class: "plain" }, ...rows),
  );
}
