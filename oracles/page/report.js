"use strict";
// Sorts and filters the tables whose rows are in the page as JSON. Without it they are plain tables of their first rows.
(() => {
  const STEP = 50;
  const COLLATOR = new Intl.Collator("en", { numeric: true, sensitivity: "base" });

  const element = (name, attributes = {}, ...children) => {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  };

  const percent = (rate) => {
    for (const digits of [0, 1, 2, 3]) {
      const text = (100 * rate).toFixed(digits);
      if (rate === 0 || rate === 1 || digits === 3 || (Number(text) !== 0 && Number(text) !== 100)) return `${text}\u00a0%`;
    }
  };

  const number = (value) => {
    if (value === null || value === undefined || value === "") return "–";
    const rounded = Math.round(value * 1000) / 1000;
    if (Math.abs(rounded) >= 100 || Number.isInteger(rounded)) return Math.round(rounded).toLocaleString("en-US").replace("-", "\u2212");
    return String(Number(rounded.toPrecision(3))).replace("-", "\u2212");
  };

  const wide = (text) => (text.length > 40 ? "long" : text.length > 24 ? "" : "brief");

  const cell = {
    text: (value, first) => element("td", { class: first ? "name" : wide(String(value ?? "")) }, String(value ?? "")),
    choice: (value) => element("td", { class: "name" }, String(value ?? "")),
    code: (value) => element("td", {}, element("code", {}, value)),
    number: (value) => element("td", { class: "n" }, number(value)),
    class: (value) => element("td", {}, element("span", { class: "tag" }, element("i", { class: value }), value)),
    rate: ([passed, judged, unjudged, low, high, rate]) => {
      if (!judged) return element("td", {}, "–", element("br"), element("small", {}, unjudged ? "not judged" : "not run"));
      const made = element("td", {}, element("small", {}, `${passed.toLocaleString("en-US")} of ${judged.toLocaleString("en-US")}`));
      if (rate !== null) {
        // As `span_text` in headline.py: rounded outwards, with a digit more where the interval is narrow.
        const ends = high - low < 50 ? [(low / 10).toFixed(1), (high / 10).toFixed(1)] : [Math.floor(low / 10), Math.ceil(high / 10)];
        const style = `--l:${low / 10}%;--w:${(high - low) / 10}%;--a:${100 * rate}%`;
        made.prepend(percent(rate), " ");
        made.append(element("span", { class: "bar", style, "aria-hidden": "true" }), element("small", {}, `${ends.join("\u2060–\u2060")}\u00a0%`));
      }
      if (unjudged) made.append(element("br"), element("small", {}, `${unjudged} not judged`));
      return made;
    },
  };

  const key = {
    number: (value) => (typeof value === "number" ? value : null),
    rate: ([passed, judged, , , , rate]) => (judged ? rate ?? passed / judged : null),
  };

  // Places on a map go by x and then by y; their minus is U+2212.
  const PLACE = /^\((\S+), (\S+)\) m$/;
  const place = (value) => {
    const found = PLACE.exec(value);
    return found && found.slice(1).map((meters) => Number(meters.replace("\u2212", "-")));
  };

  // Nothing comes last, whichever way the rest goes.
  const compare = (a, b, sign) => {
    if (a === null || b === null) return (a === null) - (b === null);
    const [here, there] = [place(a), place(b)];
    if (here && there) return sign * (here[0] - there[0] || here[1] - there[1]);
    return sign * (typeof a === "number" ? a - b : COLLATOR.compare(a, b));
  };

  // A minus is found by the hyphen that keyboards have.
  const plain = (text) => text.toLowerCase().replaceAll("\u2212", "-");

  const words = (row, kinds) => plain(row.filter((_, k) => kinds[k] !== "rate").join(" "));

  function enhance(table) {
    const { kinds, rows } = JSON.parse(document.getElementById(`data-${table.id}`).textContent);
    const body = table.tBodies[0];
    const heads = [...table.tHead.rows[0].cells];
    const label = heads[0].textContent.trim();
    const texts = new Map(rows.map((row) => [row, words(row, kinds)]));
    const count = element("output", { "aria-live": "polite" });
    const search = element("input", { type: "search", placeholder: "Filter by any word", "aria-label": `Filter ${label} rows by words` });
    const tools = element("div", { class: "tools" }, search);
    const more = element("button", { type: "button", class: "more" }, "Show more");
    const choices = [];
    const failing = Number(table.dataset.failing ?? 0);
    const only = element("input", { type: "checkbox" });
    const rate = kinds.indexOf("rate");
    let shown = STEP, order = rows, sorted = null;

    kinds.forEach((kind, k) => {
      const values = kind === "choice" || kind === "class" ? [...new Set(rows.map((row) => row[k]))] : [];
      if (values.length < 2 || values.length > 300) return;
      const select = element("select", { "aria-label": `Show only one ${heads[k].textContent.trim()}` },
        element("option", { value: "" }, `${heads[k].textContent.trim()}: all`),
        ...values.sort(COLLATOR.compare).map((value) => element("option", { value }, value)));
      select.addEventListener("change", update);
      choices.push([k, select]);
      tools.append(select);
    });
    if (failing && failing < rows.length) {
      only.checked = true;
      only.addEventListener("change", update);
      tools.append(element("label", {}, only, ` with failures only (${failing.toLocaleString("en-US")})`));
    }
    tools.append(count);

    function wanted() {
      const asked = plain(search.value).split(/\s+/).filter(Boolean);
      return order.filter((row) => (!only.checked || row[rate][0] < row[rate][1]) && asked.every((word) => texts.get(row).includes(word))
        && choices.every(([k, select]) => !select.value || String(row[k]) === select.value));
    }

    function draw() {
      const found = wanted();
      const drawn = found.slice(0, shown);
      body.replaceChildren(...drawn.map((row) => element("tr", {}, ...row.map((value, k) => cell[kinds[k]](value, k === 0)))));
      const all = found.length === rows.length ? "" : ` (of ${rows.length.toLocaleString("en-US")})`;
      count.textContent = `${drawn.length.toLocaleString("en-US")} of ${found.length.toLocaleString("en-US")} rows${all}`;
      more.hidden = drawn.length === found.length;
    }

    function update() { shown = STEP; draw(); }

    function sort(k) {
      const kind = kinds[k];
      // Words begin at A and numbers at the greatest; the second click turns that round.
      const first = kind === "number" ? -1 : 1;
      const sign = sorted && sorted[0] === k ? -sorted[1] : first;
      sorted = [k, sign];
      const of = key[kind] || ((value) => String(value));
      order = rows.map((row) => [of(row[k]), row]).sort(([a], [b]) => compare(a, b, sign)).map(([, row]) => row);
      heads.forEach((head, i) => head.setAttribute("aria-sort", i === k ? (sign > 0 ? "ascending" : "descending") : "none"));
      update();
    }

    heads.forEach((head, k) => {
      const button = element("button", { type: "button" }, head.textContent.trim());
      button.addEventListener("click", () => sort(k));
      head.replaceChildren(button);
      head.setAttribute("aria-sort", "none");
    });
    search.addEventListener("input", update);
    more.addEventListener("click", () => { shown += 4 * STEP; draw(); });
    table.caption?.remove();
    if (rows.length > 8 || only.checked) table.parentElement.before(tools);
    table.parentElement.after(more);
    draw();
  }

  document.querySelectorAll("table[data-rows]").forEach(enhance);

  // A link opens what it leads to, and paper has everything.
  const folds = () => [...document.querySelectorAll("details:not([open])")];
  const reveal = (hash) => {
    const target = hash.length > 1 && document.getElementById(decodeURIComponent(hash.slice(1)));
    for (let it = target; it; it = it.parentElement) if (it.tagName === "DETAILS") it.open = true;
  };
  addEventListener("hashchange", () => reveal(location.hash));
  document.addEventListener("click", ({ target }) => reveal(target.closest?.('a[href^="#"]')?.hash ?? ""));
  reveal(location.hash);
  let opened = [];
  addEventListener("beforeprint", () => { opened = folds(); opened.forEach((fold) => { fold.open = true; }); });
  addEventListener("afterprint", () => { opened.forEach((fold) => { fold.open = false; }); opened = []; });
})();
