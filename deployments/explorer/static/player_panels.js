/** What stands beside the map: verdicts with their reasons and metrics, and events. */

import { address, element } from "./dom.js";
import { VERDICTS } from "./player_theme.js";
import { reading } from "./player_tracks.js";

/**
 * Verdicts and events of a run.
 * @param {import("./player_run.js").Run} run
 * @param {(t: number) => void} seek
 * @returns {HTMLElement}
 */
export function panel(run, seek) {
  const { header } = run;
  const parts = [element("h2", {}, run.name, " ", chip(header.judgement))];
  if (header.executed !== header.configuration) {
    parts.push(element("p", { class: "muted" }, `It has the content of ${header.executed}, whose runs were recorded.`));
  }
  if (header.outcome) parts.push(element("p", {}, ending(header)));
  parts.push(...header.verdicts.map(verdict), events(run, seek));
  return element("section", { class: "panel", "aria-label": run.name }, ...parts);
}

function ending({ outcome, reason, simulated_s, distance_m, recoveries }) {
  const how = `${outcome.replaceAll("_", " ")}${reason ? `: ${reason}` : ""}`;
  const again = `${recoveries} ${recoveries === 1 ? "recovery" : "recoveries"}`;
  return `${how}. ${simulated_s.toFixed(2)} s, ${distance_m.toFixed(1)} m, ${again}.`;
}

function chip(judgement) {
  const [color, word] = VERDICTS[judgement];
  return element("span", { class: `chip ${color}` }, word);
}

function verdict({ oracle, judgement, reason, metrics }) {
  const rows = Object.entries(metrics).map(([name, { value, unit }]) =>
    element(
      "tr",
      {},
      element("th", { scope: "row" }, name.replaceAll("_", " ")),
      element("td", { class: value === null ? "muted" : "n" }, value === null ? "not measured" : reading(value)),
      element("td", { class: "muted" }, value === null || unit === "1" ? "" : unit),
    ),
  );
  const head = element("summary", {}, element("strong", {}, oracle), " ", chip(judgement));
  const said = reason ? [element("p", {}, reason)] : [];
  const table = rows.length ? [element("table", {}, element("tbody", {}, ...rows))] : [];
  return element("details", { open: judgement !== "pass" }, head, ...said, ...table);
}

function events(run, seek) {
  const found = run.events.map((event) =>
    element(
      "li",
      {},
      element(
        "button",
        { class: "event", click: () => seek(event.t_s) },
        element("span", { class: `mark ${event.mark}` }),
        element("span", { class: "n" }, event.t_s.toFixed(2)),
        element("span", {}, event.text),
      ),
    ),
  );
  const list = element("ol", { class: "events" }, ...found);
  const count = found.length === 1 ? "1 event" : `${found.length || "No"} events`;
  const actions = run.hasRobot ? [] : (run.header.behaviors || []).map(action);
  return element(
    "div",
    {},
    element("h3", {}, count),
    list,
    ...(actions.length ? [element("h3", {}, "Actions"), element("ol", { class: "events" }, ...actions)] : []),
  );
}

function action({ name, start_s, end_s, status, message }) {
  const how = { SUCCESS: "succeeded", FAILURE: "failed", RUNNING: "still running", INVALID: "given up" }[status];
  return element("li", {}, `${start_s.toFixed(1)}–${end_s.toFixed(1)} s ${name}: ${how}${message ? `, ${message}` : ""}`);
}

/**
 * Choices of another run of the configuration, and of one beside it.
 * @param {import("./player_run.js").Run} run
 * @param {URLSearchParams} query
 * @returns {HTMLElement}
 */
export function choices(run, query) {
  const go = (changes) => {
    const given = Object.fromEntries(query);
    for (const name of ["t", "paused"]) delete given[name];
    location.assign(address("/run", { ...given, ...changes }));
  };
  const options = (chosen) =>
    run.header.runs.map(([index, judgement]) =>
      element("option", { value: index, selected: index === chosen }, `${index} ${VERDICTS[judgement][1]}`),
    );
  const own = element("select", { change: () => go({ run: own.value }) }, ...options(run.header.run));
  const same = query.get("with") === run.header.configuration ? Number(query.get("withrun")) : -1;
  const none = element("option", { value: "" }, query.get("with") && same < 0 ? "another configuration" : "no other");
  const beside = element("select", {}, none, ...options(same));
  beside.addEventListener("change", () => {
    const chosen = beside.value !== "";
    go({ with: chosen ? run.header.configuration : null, withrun: chosen ? beside.value : null });
  });
  return element("div", { class: "choices" }, element("label", {}, "run ", own), element("label", {}, "beside run ", beside));
}
