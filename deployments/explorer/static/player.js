/** The player: one or two runs on one clock. */

import { element, fetched, showError } from "./dom.js";
import { unpacked } from "./packed.js";
import { SPEEDS, controls, layerBoxes } from "./player_controls.js";
import { helpDialog, onKeys } from "./player_keys.js";
import { MapView } from "./player_map.js";
import { choices, panel } from "./player_panels.js";
import { Layers, Run } from "./player_run.js";
import { onThemeChange, readTheme } from "./player_theme.js";
import { Tracks } from "./player_tracks.js";

const query = new URLSearchParams(location.search);

class Player {
  /**
   * @param {HTMLElement} place
   * @param {Array<{run: Run, query: string}>} sides The query asks for the run.
   */
  constructor(place, sides) {
    this.sides = sides.map((side) => ({ ...side, view: null, state: null, activities: side.run.header.activities || [] }));
    this.end = Math.max(...sides.map(({ run }) => run.end));
    this.tick = sides[0].run.header.tick_s;
    this.t = Math.min(Math.max(Number(query.get("t")) || 0, 0), this.end);
    this.playing = false;
    this.speed = 1;
    this.shown = new Set();
    this.asked = 0;
    this.executed = false;
    this.said = element("p", { class: "said", role: "status" });
    this.#build(place);
    this.repaint();
    new ResizeObserver(() => this.repaint()).observe(place);
    onThemeChange(() => this.repaint());
    onKeys(this.actions);
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (query.get("paused") !== "1" && !still && this.sides.some(({ view }) => view)) this.play();
  }

  /** @type {Object<string, (shift: boolean) => void>} */
  actions = {
    toggle: () => (this.playing ? this.pause() : this.play()),
    back: (shift) => this.seek(this.t - (shift ? 1 : 0.1)),
    ahead: (shift) => this.seek(this.t + (shift ? 1 : 0.1)),
    tickBack: () => this.seek((Math.ceil(this.t / this.tick - 1e-6) - 1) * this.tick),
    tickAhead: () => this.seek((Math.floor(this.t / this.tick + 1e-6) + 1) * this.tick),
    start: () => this.seek(0),
    end: () => this.seek(this.end),
    slower: () => this.setSpeed(SPEEDS[Math.max(SPEEDS.indexOf(this.speed) - 1, 0)]),
    faster: () => this.setSpeed(SPEEDS[Math.min(SPEEDS.indexOf(this.speed) + 1, SPEEDS.length - 1)]),
    contact: () => this.#nextContact(),
    next: () => this.#open("n"),
    previous: () => this.#open("p"),
    closer: () => this.views.forEach((view) => view.zoom(1.25)),
    farther: () => this.views.forEach((view) => view.zoom(0.8)),
    fit: () => this.views.forEach((view) => view.fit()),
    follow: () => this.#follow(),
    help: () => this.help.showModal(),
  };

  get views() {
    return this.sides.map(({ view }) => view).filter(Boolean);
  }

  #build(place) {
    const seek = (t) => this.seek(t);
    this.help = helpDialog();
    const maps = this.sides.map((side, k) => this.#map(side, k));
    this.execute = /** @type {HTMLButtonElement} */ (
      element("button", { click: () => this.load() }, "execute again for more layers")
    );
    this.bar = controls(this.actions, (speed) => this.setSpeed(speed), () => this.copy()); // prettier-ignore
    this.boxes = layerBoxes(this.shown, () => this.draw(), this.execute);
    const tracks = element("div", { class: "tracks" });
    this.tracks = new Tracks(tracks, this.sides, this.end, seek);
    const replay = this.views.length ? [element("div", { class: "maps" }, ...maps), this.bar.row, this.boxes.row] : maps;
    const left = element("div", { class: "replay" }, ...replay, this.said, tracks);
    const panels = element("div", { class: "panels" }, ...this.sides.map(({ run }) => panel(run, seek)));
    const whole = element("div", { class: this.sides.length > 1 ? "player two" : "player" }, left, panels);
    place.replaceChildren(choices(this.sides[0].run, query), whole, this.help);
  }

  #map(side, k) {
    const { run } = side;
    if (!run.hasRobot) return element("p", { class: "sentence" }, `${run.name}: ${run.header.sentence}`);
    const canvas = /** @type {HTMLCanvasElement} */ (
      element("canvas", { class: "map", tabindex: 0, role: "img", "aria-label": `Map of ${run.name}` })
    );
    side.view = new MapView(canvas, run, () => this.draw());
    side.state = element("figcaption", {});
    const name = this.sides.length > 1 ? [element("strong", {}, `${"AB"[k]} `)] : [];
    const line = element("div", { class: "state" }, ...name, side.state);
    return element("figure", { class: "map" }, canvas, line);
  }

  /** Draw everything anew, for another size or theme. */
  repaint() {
    const theme = readTheme();
    for (const view of this.views) {
      view.paint(theme);
      view.resize();
    }
    this.tracks.paint(theme);
    this.draw();
  }

  /** Draw the moment at the next chance. */
  draw() {
    if (!this.asked) this.asked = requestAnimationFrame((now) => this.#frame(now));
  }

  #frame(now) {
    this.asked = 0;
    if (this.playing) {
      // A page that was hidden must not jump.
      this.t = Math.min(this.t + Math.min((now - this.before) / 1000, 0.25) * this.speed, this.end);
      this.before = now;
      if (this.t >= this.end) this.pause();
      else this.draw();
    }
    for (const side of this.sides) {
      if (!side.view) continue;
      side.view.draw(this.t, this.shown);
      side.state.textContent = this.#state(side);
    }
    this.tracks.moveTo(this.t);
    this.bar.time.textContent = `${this.t.toFixed(2)} s of ${this.end.toFixed(2)} s`;
  }

  #state({ run, activities }) {
    if (this.t > run.end) return `${run.name}: ended at ${run.end.toFixed(2)} s`;
    const doing = run.activity(this.t, activities);
    const off = run.value("localization_error_mm", this.t);
    const said = [doing, `${(run.value("speed_mmps", this.t) + 0).toFixed(2)} m/s`];
    if (!Number.isNaN(off)) said.push(`localization ${(100 * off).toFixed(0)} cm off`);
    return [...(this.sides.length > 1 ? [run.name] : []), ...said.filter(Boolean)].join(" · ");
  }

  play() {
    if (this.t >= this.end) this.t = 0;
    this.playing = true;
    this.before = performance.now();
    this.bar.play.textContent = "Pause";
    this.draw();
  }

  pause() {
    this.playing = false;
    this.bar.play.textContent = "Play";
    this.#keepAddress();
    this.draw();
  }

  /**
   * Go to a time, and stay there.
   * @param {number} t
   */
  seek(t) {
    // To a hundredth of a tick, against sums of steps.
    this.t = Math.min(Math.max(Math.round(t * 2000) / 2000, 0), this.end);
    this.pause();
  }

  setSpeed(speed) {
    this.speed = speed;
    this.bar.speed.value = String(speed);
  }

  #nextContact() {
    const times = this.sides.flatMap(({ run }) => run.contacts.map((event) => event.t_s)).sort((a, b) => a - b);
    const next = times.find((t) => t > this.t + 1e-3);
    if (next === undefined) this.said.textContent = times.length ? "No contact after this." : "No contact.";
    else this.seek(next);
  }

  #follow() {
    const follow = !this.views.every((view) => view.follow);
    for (const view of this.views) {
      if (follow && view.fitted) view.zoom(Math.max(90 / view.scale, 1));
      view.follow = follow;
      view.fitted = false;
    }
    this.draw();
  }

  #open(key) {
    const link = /** @type {HTMLAnchorElement | null} */ (document.querySelector(`a[data-key="${key}"]`));
    if (link) link.click();
    else this.said.textContent = key === "n" ? "No failed run comes after this one." : "No failed run comes before.";
  }

  /** The address of this moment. */
  address() {
    const here = new URL(location.href);
    here.searchParams.set("t", String(+this.t.toFixed(3)));
    here.searchParams.set("paused", "1");
    if (this.executed) here.searchParams.set("layers", "1");
    return here.href;
  }

  #keepAddress() {
    clearTimeout(this.keeping);
    // Browsers limit how often an address may change. It replaces the last one, so that Back leaves the page.
    this.keeping = setTimeout(() => history.replaceState(null, "", this.address()), 250);
  }

  async copy() {
    const place = this.address();
    try {
      await navigator.clipboard.writeText(place);
      this.said.textContent = "The address of this moment is copied.";
    } catch {
      this.said.textContent = place;
    }
  }

  /** Ask for the layers that only an execution has. */
  async load() {
    this.execute.disabled = true;
    this.execute.textContent = "executing …";
    const sentences = [];
    for (const side of this.sides.filter(({ view }) => view)) {
      try {
        const reply = await fetched(`/api/layers?${side.query}`);
        side.view.layers = new Layers(unpacked(await reply.arrayBuffer()));
        const { activities, sentence, note } = side.view.layers.header;
        side.activities = activities;
        sentences.push(...[sentence, note].filter(Boolean).map((said) => `${side.run.name}: ${said}`));
      } catch (error) {
        sentences.push(`${side.run.name}: ${error instanceof Error ? error.message : error}`);
      }
    }
    this.executed = this.views.some((view) => view.layers);
    if (this.executed) this.boxes.enable();
    this.execute.hidden = this.executed;
    this.execute.disabled = false;
    this.execute.textContent = "execute again for more layers";
    this.said.textContent = sentences.join(" ");
    this.repaint();
  }
}

function asked(configuration, run) {
  return new URLSearchParams({ c: query.get("c") || "", configuration, run }).toString();
}

async function side(configuration, run) {
  const place = asked(configuration, run);
  const reply = await fetched(`/api/frames?${place}`);
  return { run: new Run(unpacked(await reply.arrayBuffer())), query: place };
}

const place = /** @type {HTMLElement} */ (document.getElementById("player"));
try {
  const runs = [side(query.get("configuration") || "", query.get("run") || "")];
  const other = query.get("with");
  if (other) runs.push(side(other, query.get("withrun") || "0"));
  const player = new Player(place, await Promise.all(runs));
  if (query.get("layers") === "1") await player.load();
} catch (error) {
  showError(place, error);
}
