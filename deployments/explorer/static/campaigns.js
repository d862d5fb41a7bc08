/** The list of campaigns: two ticked ones can be compared, and what runs is followed. */
import { $, fetched, replace } from "./dom.js";

const EVERY_MS = 4000;

/** Let the button compare exactly two. */
function tell() {
  const form = $("ticked");
  if (!form) return;
  const ticked = form.querySelectorAll("input:checked").length;
  form.querySelector("button.main").disabled = ticked !== 2;
}

/** Take the list anew if it changed; ticks stay. */
async function follow() {
  if (document.hidden) return;
  const page = new DOMParser().parseFromString(await (await fetched(location.href)).text(), "text/html");
  const [place, fresh] = [$("campaigns"), page.getElementById("campaigns")];
  if (!fresh || fresh.dataset.version === place.dataset.version) return;
  place.dataset.version = fresh.dataset.version;
  const ticked = new Set([...place.querySelectorAll("input:checked")].map((each) => each.value));
  replace(place, ...fresh.childNodes);
  for (const each of place.querySelectorAll("input")) each.checked = ticked.has(each.value);
  tell();
}

addEventListener("change", tell);
addEventListener("pageshow", tell);
setInterval(() => follow().catch(() => {}), EVERY_MS);
tell();
