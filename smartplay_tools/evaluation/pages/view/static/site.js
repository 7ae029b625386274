"use strict";
// What the site's pages share: light and dark, and the list of keys.

function toggleTheme() {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const now = document.documentElement.dataset.theme ?? (dark ? "dark" : "light");
  document.documentElement.dataset.theme = now === "dark" ? "light" : "dark";
}

// Keys do what a table says, unless somebody writes, or a list of keys is open.
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
