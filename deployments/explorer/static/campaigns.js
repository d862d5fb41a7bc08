/** The list of campaigns: two ticked ones can be compared, and what runs is followed. */

import { fetched } from "./dom.js";

const EVERY_MS = 4000;

/** Let the button compare exactly two. */
function tell() {
  const form = document.getElementById("ticked");
  if (!form) return;
  const ticked = form.querySelectorAll("input:checked").length;
  form.querySelector("button.main").disabled = ticked !== 2;
  const words = ["Tick two campaigns.", "Tick one more.", "The older is the baseline."];
  document.getElementById("told").textContent = words[ticked] ?? `Tick two, not ${ticked}.`;
}

/** Take the list anew if it changed; ticks, what is unfolded, and the focus stay. */
async function follow() {
  const place = document.getElementById("campaigns");
  if (document.hidden) return;
  const page = new DOMParser().parseFromString(await (await fetched(location.href)).text(), "text/html");
  const fresh = page.getElementById("campaigns");
  if (!fresh || fresh.dataset.version === place.dataset.version) return;
  place.dataset.version = fresh.dataset.version;
  const ticked = new Set([...place.querySelectorAll("input:checked")].map((each) => each.value));
  const unfolded = new Set([...place.querySelectorAll("details[open]")].map(keyOf));
  const focused = document.activeElement?.getAttribute("href") ?? document.activeElement?.getAttribute("value");
  place.replaceChildren(...fresh.childNodes);
  for (const each of place.querySelectorAll("input")) each.checked = ticked.has(each.value);
  for (const each of place.querySelectorAll("details")) each.open = unfolded.has(keyOf(each));
  if (focused) {
    [...place.querySelectorAll("a, input")]
      .find((each) => (each.getAttribute("href") ?? each.getAttribute("value")) === focused)
      ?.focus({ preventScroll: true });
  }
  tell();
}

function keyOf(details) {
  return details.closest("tr")?.querySelector("input")?.value;
}

addEventListener("change", tell);
addEventListener("pageshow", tell);
setInterval(() => follow().catch(() => {}), EVERY_MS);
tell();
