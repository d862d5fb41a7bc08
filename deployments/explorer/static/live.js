/** A campaign while it runs. */

import { address, drawn, element, fetchJson, showError } from "./dom.js";

const place = document.getElementById("live");
const id = place.dataset.id;
const SQUARE_PX = 9;
const LETTERS = { p: "pass", f: "fail", n: "not-judged" };

/** @param {string} name */
function at(name) {
  return document.getElementById(name);
}

function count(number) {
  return number.toLocaleString("en-US");
}

/** Percent, rounded as on the other pages; a dash where nothing was measured. */
function percent(share) {
  return share === null ? "–" : `${(100 * share).toFixed(1)} %`;
}

/** A bar of judged runs; what is missing to its end is not judged yet. */
function bar(family) {
  const total = Math.max(family.runs, 1);
  const parts = [
    ["pass", family.passed],
    ["fail", family.failed],
    ["not-judged", family.not_judged],
  ];
  let x = 0;
  const rects = parts.map(([kind, runs]) => {
    const width = (160 * runs) / total;
    x += width;
    return drawn("rect", { class: kind, x: x - width, width, height: 10 });
  });
  const words = `${count(family.passed)}, ${count(family.failed)}, ${count(family.not_judged)}`;
  const track = drawn("rect", { class: "track", width: 160, height: 10 });
  const attributes = { class: "bar", width: 160, height: 10, viewBox: "0 0 160 10", "aria-hidden": "true" };
  return [drawn("svg", attributes, track, ...rects), ` ${words}`];
}

/** A rate and its interval, as in the list of campaigns. */
function rate(family) {
  if (family.interval === null) return [element("span", { class: "muted" }, "not measured")];
  const [low, high] = family.interval;
  const drawing = drawn(
    "svg",
    { class: "rate", width: 100, height: 10, viewBox: "0 0 100 10", "aria-hidden": "true" },
    drawn("rect", { class: "track", y: 3, width: 100, height: 4 }),
    drawn("rect", { class: "interval", x: 100 * low, y: 3, width: Math.max(100 * (high - low), 1), height: 4 }),
    drawn("rect", { class: "at", x: Math.min(100 * family.rate - 1, 98), width: 2, height: 10 }),
  );
  // Ends are rounded outwards, as in the report.
  const ends = `${(Math.floor(1e3 * low + 1e-6) / 10).toFixed(1)}–${(Math.ceil(1e3 * high - 1e-6) / 10).toFixed(1)}`;
  return [drawing, ` ${percent(family.rate)} `, element("small", { class: "muted" }, ends)];
}

function showFamilies(families) {
  const rows = families.map((family) =>
    element(
      "tr",
      {},
      element("td", { class: "name" }, family.family || "–"),
      element("td", { class: "n" }, count(family.configurations)),
      element(
        "td",
        { class: "n" },
        `${count(family.passed + family.failed + family.not_judged)} of ${count(family.runs)}`,
      ),
      element("td", { class: "brief" }, ...bar(family)),
      element("td", { class: "brief" }, ...rate(family)),
    ),
  );
  at("families").replaceChildren(...rows);
}

/** Squares of the newest verdicts, row by row. */
function showRecent(recent) {
  const drawing = at("recent");
  const columns = Math.max(10, Math.floor(drawing.parentElement.clientWidth / SQUARE_PX));
  const paths = Object.entries(LETTERS).map(([letter, kind]) => {
    const squares = [...recent].flatMap((each, k) => {
      if (each !== letter) return [];
      return `M${(k % columns) * SQUARE_PX} ${Math.floor(k / columns) * SQUARE_PX}h7v7h-7z`;
    });
    return drawn("path", { class: kind, d: squares.join("") });
  });
  drawing.replaceChildren(...paths);
  drawing.setAttribute("width", String(columns * SQUARE_PX));
  drawing.setAttribute("height", String(Math.ceil(recent.length / columns) * SQUARE_PX));
  at("recent-words").textContent = recent.length ? `The newest ${count(recent.length)}, the newest last.` : "None yet.";
}

function showLost(state) {
  const rows = state.lost.map((run) => {
    const query = { c: id, configuration: run.configuration, run: run.run };
    const kind = run.judgement === "fail" ? "fail" : "not-judged";
    return element(
      "tr",
      {},
      element("td", { class: "brief" }, run.at.slice(11, 19)),
      element("td", {}, element("a", { class: `run ${kind}`, href: address("/live-run", query) }, run.run)),
      element("td", { class: "name" }, run.configuration),
      element("td", { class: kind }, run.judgement === "fail" ? "failed" : run.judgement),
      element("td", {}, run.reason || "–"),
    );
  });
  const focused = document.activeElement?.getAttribute("href");
  at("lost").replaceChildren(...rows);
  if (focused)
    at("lost")
      .querySelector(`a[href="${CSS.escape(focused)}"]`)
      ?.focus({ preventScroll: true });
  const hidden = state.lost_total - state.lost.length;
  at("lost-total").textContent = hidden
    ? `${count(state.lost_total)}, the newest ${state.lost.length} are listed`
    : count(state.lost_total);
}

function showTold(state) {
  const lines = [
    ...state.faults.map((text) => element("li", {}, element("b", { class: "fail" }, "fault "), text)),
    ...state.notices.map((text) => element("li", {}, text)),
  ];
  if (state.damaged) lines.push(element("li", {}, `${count(state.damaged)} lines of the events are damaged.`));
  at("told").hidden = !lines.length;
  at("told-list").replaceChildren(...lines);
  const hidden = state.faults_total + state.notices_total - state.faults.length - state.notices.length;
  at("told-total").textContent = hidden ? `${count(hidden)} older are not listed` : "";
}

function showEnd(state) {
  const { end } = state;
  const finished = state.whole && end.event === "ended";
  at("state").textContent = finished ? "finished" : "stopped";
  at("state").className = `state ${finished ? "finished" : "stopped"}`;
  const told = finished ? "The campaign is finished." : `The campaign stopped: ${end.reason || "no reason is known"}.`;
  const more = finished ? [" ", element("a", { href: address("/campaign", { c: id }) }, "Open it")] : [];
  at("end").replaceChildren(element("p", { class: finished ? "sentence good" : "sentence" }, told, ...more));
  at("stop").hidden = true;
}

function show(state) {
  const { progress } = state;
  const runs =
    progress && progress.runs_total
      ? [`${count(progress.runs_done)} of ${progress.at_most ? "at most " : ""}${count(progress.runs_total)} runs`]
      : [];
  const words = [...runs, ...state.words];
  at("words").textContent = words.length ? `${words.join(", ")}.` : "";
  showFamilies(state.families);
  showRecent(state.recent);
  showLost(state);
  showTold(state);
  if (state.end) showEnd(state);
  else at("stop").hidden = false;
}

function follow() {
  const source = new EventSource(place.dataset.events);
  source.onmessage = (message) => {
    const state = JSON.parse(message.data);
    show(state);
    if (state.end) source.close();
  };
  source.onerror = () => {
    at("words").textContent =
      source.readyState === EventSource.CLOSED ? "The events can't be read; reload the page." : "Reconnecting…";
  };
}

at("stop").addEventListener("submit", async (event) => {
  event.preventDefault();
  const form = event.target;
  const told = form.querySelector("[role=status]");
  form.querySelector("button").disabled = true;
  told.textContent = "Asked; runs in progress are given up, judged ones stay in the store.";
  try {
    const body = JSON.stringify({ reason: form.elements.reason.value });
    await fetchJson(place.dataset.stop, { method: "POST", body, headers: { "Content-Type": "application/json" } });
  } catch (error) {
    told.textContent = "";
    form.querySelector("button").disabled = false;
    showError(at("end"), error);
  }
});
follow();
