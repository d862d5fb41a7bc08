/** The side bar: values with rates, histograms with a brush, and a search of names. */
import { drawn, element } from "./dom.js";
import { onDrag, ordered } from "./drag.js";
import { breakable, count, interval, number, percent, VERDICTS } from "./selection.js";

/** What a run without a value is called. */
const MISSING = { verdict: "not judged", run: "none", metric: "not measured", factor: "not given", path: "not known" };
const WIDTH = 240;
const HEIGHT = 48;
const GROUPS = [
  ["verdict", "Verdicts"],
  ["factor", "Factors"],
  ["path", "Drawn paths"],
  ["run", "Runs"],
  ["metric", "Metrics"],
];

/**
 * Show all facets in an element; which groups are open and what has the focus stay as they are.
 * @param {HTMLElement} place
 * @param {any} found Reply of /api/facets.
 * @param {import("./selection.js").Condition[]} conditions
 * @param {(column: string, condition: import("./selection.js").Condition | null) => void} choose
 */
export function showFacets(place, found, conditions, choose) {
  const closed = new Set([...place.querySelectorAll("details:not([open])")].map((each) => each.dataset.group));
  const focus = document.activeElement instanceof HTMLElement ? document.activeElement.dataset.key : undefined;
  const of = new Map(conditions.map((each) => [each.column, each]));
  const first = place.childElementCount === 0;
  const groups = GROUPS.map(([group, title]) => {
    const own = found.facets.filter((facet) => facet.group === group);
    const shown = own.map((facet) => (facet.kind === "values" ? values : histogram)(facet, of.get(facet.name), choose));
    const open = first ? group !== "metric" || own.some((facet) => of.has(facet.name)) : !closed.has(group);
    return element(
      "details",
      { "data-group": group, open },
      element("summary", {}, `${title} (${own.length})`),
      ...shown,
    );
  });
  const search = searchOf(of.get("configuration"), choose);
  place.replaceChildren(search, ...groups.filter((group) => group.childElementCount > 1), ...notes(found));
  if (focus) {
    const again = [...place.querySelectorAll("[data-key]")].find((each) => each.dataset.key === focus);
    if (again instanceof HTMLElement) again.focus({ preventScroll: true });
  }
}

function notes(found) {
  const told = found.constant.map(({ name, value }) => element("li", {}, `${name}: ${value ?? "none"}`));
  const shown = [];
  if (told.length) {
    const title = element("summary", {}, `The same in all runs (${told.length})`);
    shown.push(element("details", { "data-group": "constant" }, title, element("ul", {}, ...told)));
  }
  if (found.places.length)
    shown.push(element("p", { class: "muted" }, `Places and lists, not shown: ${found.places.join(", ")}.`));
  return shown;
}

function searchOf(condition, choose) {
  const input = element("input", {
    type: "search",
    value: condition?.part ?? "",
    placeholder: "part of a name",
    "data-key": "search",
    change: () => choose("configuration", input.value ? { column: "configuration", part: input.value } : null),
  });
  return element("label", { class: "search" }, "Configuration ", input);
}

function heading(facet, condition, choose) {
  const clear = element(
    "button",
    { "data-key": `clear ${facet.name}`, click: () => choose(facet.name, null) },
    "clear",
  );
  return element(
    "div",
    { class: "heading" },
    element("h3", {}, ...breakable(facet.name)),
    ...(condition ? [clear] : []),
  );
}

function values(facet, condition, choose) {
  const chosen = new Set(condition?.values ?? []);
  const most = Math.max(1, ...facet.values.map((each) => each.passed + each.failed + each.not_judged));
  const rows = facet.values.map((each) => {
    const box = element("input", {
      type: "checkbox",
      checked: chosen.has(each.value),
      "data-key": `${facet.name} ${each.value}`,
      change: () => {
        if (box.checked) chosen.add(each.value);
        else chosen.delete(each.value);
        choose(facet.name, chosen.size ? { column: facet.name, values: [...chosen] } : null);
      },
    });
    const runs = each.passed + each.failed + each.not_judged;
    const parts = [each.passed, each.failed, each.not_judged];
    const title = `${parts.map((n, k) => `${count(n)} ${VERDICTS[k].word}`).join(", ")}; ${interval(each.interval)} passed`;
    const rate = element("span", { class: "n" }, each.rate === null ? "–" : percent(each.rate));
    const own = element("span", { class: "own" }, each.value ?? MISSING[facet.group]);
    return element(
      "label",
      { class: "value", title },
      box,
      own,
      bar(parts, most),
      element("span", { class: "n muted" }, count(runs)),
      rate,
    );
  });
  const more = facet.left_out
    ? [element("p", { class: "muted" }, `${count(facet.left_out)} more values, less frequent`)]
    : [];
  return element("div", { class: "facet" }, heading(facet, condition, choose), ...rows, ...more);
}

function bar(parts, most) {
  let at = 0;
  const shown = parts.map((n, k) => {
    const width = (60 * n) / most;
    at += width;
    return drawn("rect", { x: at - width, y: 0, width, height: 8, class: `fill-${k}` });
  });
  return drawn(
    "svg",
    { class: "small-bar", viewBox: "0 0 60 8", width: 60, height: 8, "aria-hidden": "true" },
    ...shown,
  );
}

function histogram(facet, condition, choose) {
  const { low, high, counts } = facet;
  const most = Math.max(1, ...counts.map((each) => each[0] + each[1] + each[2]));
  const width = WIDTH / counts.length;
  const bars = counts.flatMap((each, k) => {
    let top = HEIGHT;
    return each.map((n, verdict) => {
      const height = (HEIGHT * n) / most;
      top -= height;
      return drawn("rect", { x: k * width, y: top, width: width - 0.5, height, class: `fill-${verdict}` });
    });
  });
  const at = (value) => (WIDTH * (Math.min(Math.max(value, low), high) - low)) / (high - low);
  const from = condition ? at(condition.low ?? low) : 0;
  const to = condition ? at(condition.high ?? high) : 0;
  const band = drawn("rect", {
    class: "band",
    x: from,
    y: 0,
    width: Math.max(to - from, condition ? 1 : 0),
    height: HEIGHT,
  });
  const words = `${facet.name}: ${number(low)} to ${number(high)} ${facet.unit}`;
  const picture = drawn(
    "svg",
    { class: "histogram", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": words },
    ...bars,
    band,
  );
  const shareOf = (event) => {
    const box = picture.getBoundingClientRect();
    return [Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1)];
  };
  const mark = ([start], [end]) => {
    band.setAttribute("x", String(WIDTH * Math.min(start, end)));
    band.setAttribute("width", String(WIDTH * Math.abs(end - start)));
  };
  onDrag(picture, shareOf, mark, ([start], [end]) => {
    let shares = ordered(start, end);
    if (shares[1] - shares[0] < 0.005) {
      const k = Math.min(Math.floor(start * counts.length), counts.length - 1);
      shares = [k / counts.length, (k + 1) / counts.length]; // a click takes a bar
    }
    const [first, last] = shares.map((share) => rounded(low + share * (high - low), high - low));
    choose(facet.name, { column: facet.name, low: first, high: last });
  });
  const inputs = ["low", "high"].map((end) => {
    const input = element("input", {
      type: "number",
      step: "any",
      "aria-label": `${facet.name}, ${end === "low" ? "from" : "to"}`,
      placeholder: number(facet[end]),
      value: condition?.[end] ?? "",
      "data-key": `${facet.name} ${end}`,
      change: () => {
        const ends = { low: condition?.low ?? null, high: condition?.high ?? null };
        ends[end] = input.value === "" ? null : Number(input.value);
        choose(facet.name, ends.low === null && ends.high === null ? null : { column: facet.name, ...ends });
      },
    });
    return input;
  });
  const missing = element(
    "button",
    { "data-key": `missing ${facet.name}`, click: () => choose(facet.name, { column: facet.name, values: [null] }) },
    `${MISSING[facet.group]}: ${count(facet.missing)}`,
  );
  const below = element(
    "div",
    { class: "range" },
    inputs[0],
    "to",
    inputs[1],
    ...(facet.missing || condition?.values ? [missing] : []),
  );
  return element("div", { class: "facet" }, heading(facet, condition, choose), picture, below);
}

/** Round to a thousandth of a range, so that addresses stay short. */
function rounded(value, range) {
  const step = 10 ** Math.floor(Math.log10(range) - 3);
  return Number((Math.round(value / step) * step).toPrecision(12));
}
