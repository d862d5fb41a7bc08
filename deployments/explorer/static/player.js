/** The player: one or two runs on one clock. */
import { $, copy, element, fetchPacked, fetched, query, readTheme, remember, showError, within } from "./dom.js";
import { RunMap } from "./player_map.js";
import { Layers, Run } from "./player_run.js";
import { Tracks } from "./player_tracks.js";
import { save } from "./save.js";

const find = (selector) => /** @type {any} */ (document.querySelector(selector));
const [play, time, execute] = ["[data-action=toggle]", ".time", "[data-action=execute]"].map(find);
const [said, speed, layers] = ["said", "speed", "layers"].map($);
/** Longest step of the clock, so that a page that was hidden does not jump. */
const MOST_S = 0.25;

class Player {
  /** @param {Array<{run: Run, query: string}>} sides The query asks for the run. */
  constructor(sides) {
    this.sides = sides.map((side) => ({ ...side, view: null, activities: side.run.header.activities || [] }));
    this.end = Math.max(...sides.map(({ run }) => run.end));
    this.tick = sides[0].run.header.tick_s;
    this.t = within(Number(query.get("t")) || 0, 0, this.end);
    this.frame = 0;
    find(".maps").replaceChildren(...this.sides.map((side, k) => this.#map(side, k)));
    $("controls").hidden = !this.views.length;
    this.tracks = new Tracks(find(".most"), this.sides, this.end, (t) => this.seek(t));
    this.#listen();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.recolor());
    new ResizeObserver(() => this.repaint()).observe(find(".player"));
    this.recolor();
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (query.get("paused") !== "1" && !still && this.views.length) this.play();
  }

  actions = {
    toggle: () => (this.playing ? this.pause() : this.play()),
    back: (shift) => this.seek(this.t - (shift ? 1 : 0.1)),
    ahead: (shift) => this.seek(this.t + (shift ? 1 : 0.1)),
    tickBack: () => this.seek((Math.ceil(this.t / this.tick - 1e-6) - 1) * this.tick),
    tickAhead: () => this.seek((Math.floor(this.t / this.tick + 1e-6) + 1) * this.tick),
    start: () => this.seek(0),
    end: () => this.seek(this.end),
    slower: () => (speed.selectedIndex = Math.max(speed.selectedIndex - 1, 0)),
    faster: () => (speed.selectedIndex = Math.min(speed.selectedIndex + 1, speed.length - 1)),
    contact: () => this.#toNext("contact", (event) => event.kind === "contact"),
    event: () => this.#toNext("event", () => true),
    next: () => this.#open("n", "No failed run comes after this one."),
    previous: () => this.#open("p", "No failed run comes before this one."),
    closer: () => this.views.forEach((view) => view.zoom(1.25)),
    farther: () => this.views.forEach((view) => view.zoom(0.8)),
    fit: () => this.views.forEach((view) => view.fit()),
    follow: () => this.#follow(),
    copy: () => copy(this.keep(), said, "The address of this moment is copied.", location.href),
    execute: () => this.load(),
    foxglove: () => this.#saveBags(),
    help: () => find("dialog").showModal(),
  };

  get views() {
    return this.sides.map(({ view }) => view).filter(Boolean);
  }

  #map(side, k) {
    const { run } = side;
    const name = element("strong", {}, this.sides.length > 1 ? `${"AB"[k]}: ${run.name} ` : "");
    name.style.color = `var(--${k ? "horizon" : "accent"})`;
    if (!run.hasRobot) return element("p", { class: "panel" }, `${run.name}: ${run.header.sentence}`);
    const canvas = element("canvas", { class: "map", role: "img", "aria-label": `Map of ${run.name}` });
    side.view = new RunMap(/** @type {HTMLCanvasElement} */ (canvas), run, () => this.draw());
    side.state = element("span");
    return element("div", {}, canvas, name, side.state);
  }

  /** Keys and buttons are in the page's markup with the names of their actions. */
  #listen() {
    const keys = new Map([...document.querySelectorAll("kbd")].map(({ dataset }) => [dataset.key, dataset.action]));
    document.addEventListener("keydown", (event) => {
      if (!keys.has(event.key) || event.ctrlKey || event.metaKey || event.altKey) return;
      // Space presses what has the focus.
      const taken = event.key === " " ? "button, a, summary, input, select" : "select, input:not([type=checkbox])";
      if (document.activeElement?.matches(taken) || find("dialog[open]")) return;
      event.preventDefault();
      this.actions[keys.get(event.key)](event.shiftKey);
    });
    document.addEventListener("click", ({ target }) => {
      const button = target.closest("button[data-action]");
      if (button) this.actions[button.dataset.action](false);
      const moment = target.closest("button[data-t]");
      if (moment) this.seek(Number(moment.dataset.t));
    });
    layers.addEventListener("change", () => this.draw());
    document.addEventListener("toggle", ({ target }) => target.dataset.signal && keepSignals(), true);
    for (const swatch of document.querySelectorAll("[data-color]"))
      swatch.style.color = `var(--${swatch.dataset.color})`;
  }

  /** Draw the maps in the colors of light or dark. */
  recolor() {
    const theme = readTheme();
    for (const view of this.views) view.paint(theme);
    this.repaint();
  }

  /** Draw the maps in the size of the page. */
  repaint() {
    for (const view of this.views) view.place();
    this.tracks.paint();
    this.#draw(performance.now());
  }

  /** Draw the moment at the next chance. */
  draw() {
    this.frame ||= requestAnimationFrame((now) => this.#draw(now));
  }

  #draw(now) {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    if (this.playing) {
      this.t = Math.min(this.t + Math.min((now - this.before) / 1000, MOST_S) * Number(speed.value), this.end);
      this.before = now;
      if (this.t < this.end) this.draw();
      else this.pause();
    }
    const shown = new Set([...layers.querySelectorAll(":checked")].map(({ value }) => value));
    for (const { view, state, run, activities } of this.sides.filter(({ view }) => view)) {
      view.draw(this.t, shown);
      const doing = activities.find(([start, end]) => start <= this.t && this.t < end)?.[2] || "";
      const [speed, off] = ["speed_mmps", "localization_error_mm"].map((name) => run.value(name, this.t));
      const lost = Number.isNaN(off) ? "" : `localization ${(100 * off).toFixed(0)} cm off`;
      const words = [doing, `${speed.toFixed(2)} m/s`, lost].filter(Boolean).join(" · ");
      state.textContent = this.t > run.end ? `ended at ${run.end.toFixed(2)} s` : words;
    }
    this.tracks.moveTo(this.t);
    time.textContent = `${this.t.toFixed(2)} s of ${this.end.toFixed(2)} s`;
  }

  play() {
    if (this.t >= this.end) this.t = 0;
    this.playing = true;
    this.before = performance.now();
    play.textContent = "Pause";
    this.draw();
  }

  pause() {
    this.playing = false;
    play.textContent = "Play";
    clearTimeout(this.keeping);
    // Browsers limit how often an address may change. It replaces the last one, so that Back leaves the page.
    this.keeping = setTimeout(() => this.keep(), 250);
    this.draw();
  }

  /** Go to a time, and stay there. */
  seek(t) {
    // Rounded against sums of steps.
    this.t = within(Math.round(t * 2000) / 2000, 0, this.end);
    this.pause();
  }

  /** Put this moment into the address, and return it. */
  keep() {
    remember({ t: String(+this.t.toFixed(3)), paused: "1", layers: execute.hidden && "1" });
    return location.href;
  }

  /** Go to the next event of a kind. */
  #toNext(kind, is) {
    const events = this.sides.flatMap(({ run }) => run.events.filter(is));
    const times = events.map((event) => event.t_s).sort((a, b) => a - b);
    const next = times.find((t) => t > this.t + 1e-3);
    if (next !== undefined) this.seek(next);
    else said.textContent = times.length ? `No ${kind} comes after this moment.` : `There is no ${kind}.`;
  }

  #follow() {
    const follow = !this.views.every((view) => view.follow);
    for (const view of this.views) {
      if (follow && view.fitted) view.zoom(Math.max(90 / view.scale, 1));
      Object.assign(view, { follow, fitted: false });
    }
    this.draw();
  }

  #open(key, otherwise) {
    const link = find(`a[data-key="${key}"]`);
    if (link) link.click();
    else said.textContent = otherwise;
  }

  /** Save each run as an MCAP file. */
  async #saveBags() {
    said.textContent = "Executing …";
    try {
      for (const { run, query: place } of this.sides) {
        const blob = await executed("mcap", place, async (...asked) => (await fetched(...asked)).blob());
        save(blob, `${run.name.replace(/[^\w.-]+/g, "-")}.mcap`);
      }
      said.textContent = "Saved as MCAP: open the file in Foxglove.";
    } catch (error) {
      showError(said, error);
    }
  }

  /** Ask for the layers that only an execution has. */
  async load() {
    execute.disabled = true;
    said.textContent = "Executing …";
    const told = [];
    for (const side of this.sides.filter(({ view }) => view)) {
      try {
        side.view.layers = new Layers(await executed("layers", side.query, fetchPacked));
        const { activities, sentence, note } = side.view.layers.header;
        side.activities = activities;
        told.push(sentence && `${side.run.name}: ${sentence}`, note);
      } catch (error) {
        told.push(`${side.run.name}: ${error.message}`);
      }
    }
    execute.disabled = false;
    execute.hidden = this.views.some((view) => view.layers);
    for (const box of layers.querySelectorAll("input")) box.disabled &&= !execute.hidden;
    said.textContent = [...new Set(told)].filter(Boolean).join(" ");
    this.repaint();
  }
}

/** Put the signals that are unfolded into the address, and into those of the next failed runs. */
function keepSignals() {
  const open = [...document.querySelectorAll("[data-signal][open]")].map(({ dataset }) => dataset.signal);
  remember({ signals: String(open) || "none" });
  for (const link of document.querySelectorAll("a[data-key]")) {
    const place = new URL(link.href);
    place.searchParams.set("signals", query.get("signals"));
    link.href = String(place);
  }
}

/** Execute a run; where it needs code of others, ask whether to permit that code as it is now. */
async function executed(what, place, read, permit = "") {
  const more = permit && `&permit=${permit}`;
  return read(`/api/${what}?${place}${more}`, { method: "POST" }).catch((error) => {
    if (!error.asks || permit || !confirm(`${error.message}\nExecute it, now and from now on?`)) throw error;
    return executed(what, place, read, error.asks.digest);
  });
}

async function sideOf(c, configuration, run) {
  const place = String(new URLSearchParams({ c, configuration, run }));
  const found = new Run(await fetchPacked(`/api/frames?${place}`));
  if (query.get("withc")) found.name += ` of ${c}`;
  return { run: found, query: place };
}

let player = /** @type {Player | undefined} */ (undefined);
$("runs").addEventListener("change", () => {
  const moment = player && { t: player.t.toFixed(3), paused: player.playing ? "" : "1" };
  const [layers, signals] = ["layers", "signals"].map((name) => query.get(name));
  for (const [name, value] of Object.entries({ ...moment, layers, signals }))
    if (value) $("runs").append(element("input", { type: "hidden", name, value }));
  $("runs").submit();
});
try {
  const given = (name) => query.get(name) || "";
  const runs = [sideOf(given("c"), given("configuration"), given("run"))];
  if (given("withrun")) runs.push(sideOf(given("withc") || given("c"), given("with"), given("withrun")));
  player = new Player(await Promise.all(runs));
  said.textContent = "";
  if (query.get("layers") === "1") await player.load();
} catch (error) {
  showError(said, error);
}
