/** A campaign while it runs: its state comes as parts of the page. */
import { $, fetched, shown, showError, showParts } from "./dom.js";

const form = /** @type {HTMLFormElement} */ ($("stop"));
const source = new EventSource(`/api/events${location.search}`);

source.onmessage = (message) => {
  const { end, html } = JSON.parse(message.data);
  showParts(html);
  form.hidden = Boolean(end);
  if (end) source.close();
};
source.onerror = () => {
  const closed = source.readyState === EventSource.CLOSED;
  $("words").textContent = closed ? "The events can't be read; reload the page." : "Reconnecting…";
};

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const [button, told] = [form.querySelector("button"), form.querySelector("output")];
  button.disabled = true;
  told.textContent = "Asked; runs in progress are given up, judged ones stay in the store.";
  try {
    const body = JSON.stringify({ reason: form.elements.reason.value });
    await fetched(form.action, { method: "POST", body, headers: { "Content-Type": "application/json" } });
  } catch (error) {
    told.textContent = "";
    button.disabled = false;
    showError($("end"), error);
  }
});

// Opening a run reads the campaign's file and its store, which no link does by itself.
$("lost").addEventListener("click", (event) => {
  const link = /** @type {HTMLElement} */ (event.target).closest("a");
  if (!link || $("state").textContent.includes("finished")) return;
  event.preventDefault();
  $("words").textContent = "Reading the run from the store …";
  shown($("end"), async () => location.assign((await (await fetched(link.href, { method: "POST" })).json()).address));
});
