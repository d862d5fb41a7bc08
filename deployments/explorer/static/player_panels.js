/** Beside the map: verdicts with their reasons and metrics, and events. */

import { verdictMark } from "./colors.js";
import { element, row } from "./dom.js";
import { MARKS, reading } from "./player_theme.js";

const ENDS = { SUCCESS: "succeeded", FAILURE: "failed", RUNNING: "still running", INVALID: "given up" };

/**
 * Verdicts and events of a run.
 * @param {import("./player_run.js").Run} run
 * @param {(t: number) => void} seek
 * @returns {HTMLElement}
 */
export function panel(run, seek) {
  const { header } = run;
  const { outcome, reason, simulated_s, distance_m, recoveries } = header;
  const said = [];
  if (header.executed !== header.configuration) {
    said.push(`It has the content of ${header.executed}, whose runs were recorded.`);
  }
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
    const mark = element("span", {}, letter);
    mark.style.color = `var(--${color})`;
    return element("button", { class: "event", click: () => seek(t_s) }, mark, ` ${t_s.toFixed(2)} s  ${text}`);
  });
  return element(
    "section",
    { class: "panel", "aria-label": run.name },
    element("h2", {}, run.name, " ", verdictMark(header.judgement, "strong")),
    ...said.map((text) => element("p", {}, text)),
    ...header.verdicts.map(verdict),
    element("h2", {}, items.length ? `Events: ${items.length}` : "No events"),
    element("div", { class: "events" }, ...items),
  );
}

function verdict({ oracle, judgement, reason, metrics }) {
  const rows = Object.entries(metrics).map(([name, { value, unit }]) => {
    const title = element("th", { scope: "row" }, name.replaceAll("_", " "));
    const cells = value === null ? ["not measured", ""] : [reading(value), unit === "1" ? "" : unit];
    const made = row(cells, [value === null ? "muted" : "n", "muted"]);
    made.prepend(title);
    return made;
  });
  return element(
    "details",
    { open: judgement !== "pass" },
    element("summary", {}, element("strong", {}, oracle), " ", verdictMark(judgement, "strong")),
    ...(reason ? [element("p", {}, reason)] : []),
    element("table", { class: "plain" }, element("tbody", {}, ...rows)),
  );
}
