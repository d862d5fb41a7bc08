/** A campaign while it runs. */
import { partsBar, rateBar, verdictMark, verdictOf } from "./colors.js";
import { address, drawn, element, fetchJson, link, row, showError } from "./dom.js";
import { count, interval, percent } from "./selection.js";

const SQUARE_PX = 9;
const LETTERS = { p: "pass", f: "fail", n: "not-judged" };
const at = (name) => document.getElementById(name);
const { id, events, stop } = at("live").dataset;

function showFamilies(families) {
  const rows = families.map((family) => {
    const parts = [family.passed, family.failed, family.not_judged];
    const judged = parts[0] + parts[1] + parts[2];
    const rate = [element("span", { class: "muted" }, "not measured")];
    if (family.interval) {
      const ends = element("small", { class: "muted" }, interval(family.interval).replace(" %", ""));
      rate.splice(0, 1, rateBar(family.rate, family.interval, 100), ` ${percent(family.rate)} `, ends);
    }
    return row(
      [
        family.family || "–",
        count(family.configurations),
        `${count(judged)} of ${count(family.runs)}`,
        [partsBar(parts, Math.max(family.runs, 1), 160, 10), ` ${parts.map(count).join(", ")}`],
        rate,
      ],
      ["name", "n", "n", "brief", "brief"],
    );
  });
  at("families").replaceChildren(...rows);
}

/** Squares of the newest verdicts, row by row. */
function showRecent(recent) {
  const drawing = at("recent");
  const columns = Math.max(10, Math.floor(drawing.parentElement.clientWidth / SQUARE_PX));
  const paths = Object.entries(LETTERS).map(([letter, kind]) => {
    const squares = [...recent].map((each, k) => {
      const [x, y] = [(k % columns) * SQUARE_PX, Math.floor(k / columns) * SQUARE_PX];
      return each === letter ? `M${x} ${y}h7v7h-7z` : "";
    });
    return drawn("path", { class: kind, d: squares.join("") });
  });
  drawing.replaceChildren(...paths);
  drawing.setAttribute("width", String(columns * SQUARE_PX));
  drawing.setAttribute("height", String(Math.ceil(recent.length / columns) * SQUARE_PX));
  at("recent-words").textContent = recent.length ? `The newest ${count(recent.length)}, the newest last.` : "None yet.";
}

function showLost({ lost, lost_total: total }) {
  const rows = lost.map(({ configuration, run, judgement, at, reason }) => {
    const kind = verdictOf(judgement).color;
    const opened = element(
      "a",
      { class: `run ${kind}`, href: address("/live-run", { c: id, configuration, run }) },
      run,
    );
    const cells = [at.slice(11, 19), opened, configuration, verdictMark(judgement), reason || "–"];
    return row(cells, ["brief", "", "name"]);
  });
  const focused = document.activeElement?.getAttribute("href");
  at("lost").replaceChildren(...rows);
  const again = [...at("lost").querySelectorAll("a")].find((each) => each.getAttribute("href") === focused);
  again?.focus({ preventScroll: true });
  const listed = total > lost.length ? `, the newest ${lost.length} are listed` : "";
  at("lost-total").textContent = `${count(total)}${listed}`;
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

function showEnd({ end, whole }) {
  const finished = whole && end.event === "ended";
  const state = finished ? "finished" : "stopped";
  at("state").textContent = state;
  at("state").className = `state ${state}`;
  const told = finished ? "The campaign is finished." : `The campaign stopped: ${end.reason || "no reason is known"}.`;
  const more = finished ? [" ", link(address("/campaign", { c: id }), "Open it")] : [];
  at("end").replaceChildren(element("p", { class: finished ? "sentence good" : "sentence" }, told, ...more));
}

function show(state) {
  const { runs_done: done, runs_total: total, at_most: atMost } = state.progress || {};
  const runs = total ? [`${count(done)} of ${atMost ? "at most " : ""}${count(total)} runs`] : [];
  const words = [...runs, ...state.words].join(", ");
  at("words").textContent = words && `${words}.`;
  showFamilies(state.families);
  showRecent(state.recent);
  showLost(state);
  showTold(state);
  at("stop").hidden = Boolean(state.end);
  if (state.end) showEnd(state);
}

const source = new EventSource(events);
source.onmessage = (message) => {
  const state = JSON.parse(message.data);
  show(state);
  if (state.end) source.close();
};
source.onerror = () => {
  const closed = source.readyState === EventSource.CLOSED;
  at("words").textContent = closed ? "The events can't be read; reload the page." : "Reconnecting…";
};

at("stop").addEventListener("submit", async (event) => {
  event.preventDefault();
  const form = event.target;
  const told = form.querySelector("[role=status]");
  form.querySelector("button").disabled = true;
  told.textContent = "Asked; runs in progress are given up, judged ones stay in the store.";
  try {
    const body = JSON.stringify({ reason: form.elements.reason.value });
    await fetchJson(stop, { method: "POST", body, headers: { "Content-Type": "application/json" } });
  } catch (error) {
    told.textContent = "";
    form.querySelector("button").disabled = false;
    showError(at("end"), error);
  }
});
