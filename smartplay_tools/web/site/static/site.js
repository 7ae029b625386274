"use strict";
// What the site’s pages share: the list of keys, and requests that change something.

$("live").textContent = "connecting"; // without scripts it says so

// Keys do what a table says, unless a field is being typed in or the list of keys is open.
function connectKeys(keys) {
  const press = (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || $("keys").open) return;
    if (event.target.matches("input, select, textarea")) {
      if (event.key === "Escape") event.target.blur();
      return;
    }
    if (event.key === "Enter" && event.target.matches("a, button")) return;
    if (!(event.key in keys)) return;
    event.preventDefault();
    keys[event.key]();
  };
  document.addEventListener("keydown", press);
  $("theme").addEventListener("click", toggleTheme);
  $("help").addEventListener("click", () => $("keys").showModal());
  $("close-keys").addEventListener("click", () => $("keys").close());
}

// Only a page with the key may change something; a refusal is shown where the page has a place for it.
async function send(path, body = {}) {
  const headers = { "Content-Type": "application/json", "X-SmartPlay-Key": document.body.dataset.key };
  const { answer, problem } = await request(path, { method: "POST", headers, body: JSON.stringify(body) });
  $("problem").textContent = problem ?? "";
  return answer ?? null;
}
