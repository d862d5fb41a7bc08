/** The side bar: values with rates, histograms with a brush, and a search of names. */
import { partsBar, VERDICTS } from "./colors.js";
import { drawn, element, note, onDrag, ordered } from "./dom.js";
import { breakable, count, interval, number, percent } from "./selection.js";

/** What a run without a value is called. */
const MISSING = { verdict: "not judged", run: "none", metric: "not measured", factor: "not given", path: "not known" };
const WIDTH = 240;
const HEIGHT = 48;
const GROUPS = { verdict: "Verdicts", factor: "Factors", path: "Drawn paths", run: "Runs", metric: "Metrics" };

/**
 * Show all facets in an element; which groups are open and what has the focus stay as they are.
 * @param {HTMLElement} place
 * @param {any} found Reply of /api/facets.
 * @param {import("./selection.js").Condition[]} conditions
 * @param {(column: string, condition: import("./selection.js").Condition | null) => void} choose
 */
export function showFacets(place, found, conditions, choose) {
  const open = new Map([...place.querySelectorAll("details")].map((each) => [each.dataset.group, each.open]));
  const focus = document.activeElement.dataset.key;
  const of = new Map(conditions.map((each) => [each.column, each]));
  const folded = (group, title, n, otherwise, ...children) => {
    const summary = element("summary", {}, `${title} (${n})`);
    return element("details", { "data-group": group, open: open.get(group) ?? otherwise }, summary, ...children);
  };
  const groups = Object.entries(GROUPS).flatMap(([group, title]) => {
    const own = found.facets.filter((facet) => facet.group === group);
    const facets = own.map((facet) => {
      const condition = of.get(facet.name);
      const parts = (facet.kind === "values" ? values : histogram)(facet, condition, (given) =>
        choose(facet.name, given && { column: facet.name, ...given }),
      );
      const clear = { "data-key": `clear ${facet.name}`, click: () => choose(facet.name, null) };
      const heading = element("div", { class: "heading" }, element("h3", {}, ...breakable(facet.name)));
      if (condition) heading.append(element("button", clear, "clear"));
      return element("div", { class: "facet" }, heading, ...parts);
    });
    const shown = group !== "metric" || own.some((facet) => of.has(facet.name));
    return own.length ? [folded(group, title, own.length, shown, ...facets)] : [];
  });
  const same = found.constant.map(({ name, value }) => element("li", {}, `${name}: ${value ?? "none"}`));
  if (same.length)
    groups.push(folded("constant", "The same in all runs", same.length, false, element("ul", {}, ...same)));
  if (found.places.length) groups.push(note(`Places and lists, not shown: ${found.places.join(", ")}.`));
  place.replaceChildren(searchOf(of.get("configuration"), choose), ...groups);
  const again = [...place.querySelectorAll("[data-key]")].find((each) => each.dataset.key === focus);
  again?.focus({ preventScroll: true });
}

function searchOf(condition, choose) {
  const input = element("input", {
    type: "search",
    value: condition?.part,
    placeholder: "part of a name",
    "data-key": "search",
    change: () => choose("configuration", input.value ? { column: "configuration", part: input.value } : null),
  });
  return element("label", { class: "search" }, "Configuration ", input);
}

function values(facet, condition, choose) {
  const chosen = new Set(condition?.values);
  const runsOf = ({ passed, failed, not_judged }) => passed + failed + not_judged;
  const most = Math.max(1, ...facet.values.map(runsOf));
  const rows = facet.values.map((each) => {
    const box = element("input", {
      type: "checkbox",
      checked: chosen.has(each.value),
      "data-key": `${facet.name} ${each.value}`,
      change: () => {
        if (box.checked) chosen.add(each.value);
        else chosen.delete(each.value);
        choose(chosen.size ? { values: [...chosen] } : null);
      },
    });
    const parts = [each.passed, each.failed, each.not_judged];
    const title = `${parts.map((n, k) => `${count(n)} ${VERDICTS[k].word}`).join(", ")}; ${interval(each.interval)} passed`;
    return element(
      "label",
      { class: "value", title },
      box,
      element("span", { class: "own" }, each.value ?? MISSING[facet.group]),
      partsBar(parts, most, 60, 8),
      element("span", { class: "n muted" }, count(runsOf(each))),
      element("span", { class: "n" }, percent(each.rate)),
    );
  });
  return facet.left_out ? [...rows, note(`${count(facet.left_out)} more values, less frequent`)] : rows;
}

function histogram(facet, condition, choose) {
  const { low, high, counts } = facet;
  const most = Math.max(1, ...counts.map((each) => each[0] + each[1] + each[2]));
  const width = WIDTH / counts.length;
  const bars = counts.flatMap((each, k) => {
    let y = HEIGHT;
    return each.map((n, verdict) => {
      const height = (HEIGHT * n) / most;
      y -= height;
      return drawn("rect", { x: k * width, y, width: width - 0.5, height, class: VERDICTS[verdict].color });
    });
  });
  const at = (value) => (WIDTH * (Math.min(Math.max(value, low), high) - low)) / (high - low);
  const from = condition ? at(condition.low ?? low) : 0;
  const chosen = condition ? Math.max(at(condition.high ?? high) - from, 1) : 0;
  const band = drawn("rect", { class: "band", x: from, width: chosen, height: HEIGHT });
  const words = `${facet.name}: ${number(low)} to ${number(high)} ${facet.unit}`;
  const attributes = { class: "histogram", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": words };
  const picture = drawn("svg", attributes, ...bars, band);
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
    choose({ low: first, high: last });
  });
  const [least, greatest] = ["low", "high"].map((end) => {
    const input = element("input", {
      type: "number",
      step: "any",
      "aria-label": `${facet.name}, ${end === "low" ? "from" : "to"}`,
      placeholder: number(facet[end]),
      value: condition?.[end],
      "data-key": `${facet.name} ${end}`,
      change: () => {
        const ends = { low: condition?.low ?? null, high: condition?.high ?? null };
        ends[end] = input.value === "" ? null : Number(input.value);
        choose(ends.low === null && ends.high === null ? null : ends);
      },
    });
    return input;
  });
  const range = element("div", { class: "range" }, least, "to", greatest);
  const only = { "data-key": `missing ${facet.name}`, click: () => choose({ values: [null] }) };
  if (facet.missing || condition?.values)
    range.append(element("button", only, `${MISSING[facet.group]}: ${count(facet.missing)}`));
  return [picture, range];
}

/** Round to a thousandth of a range, so that addresses stay short. */
function rounded(value, range) {
  const step = 10 ** Math.floor(Math.log10(range) - 3);
  return Number((Math.round(value / step) * step).toPrecision(12));
}
