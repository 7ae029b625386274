"use strict";
// Pages of which nothing changes by itself: the games to choose from, and a challenge. That is taken by a click, and only
// from its page, since a link can be opened by anybody's page.
$("take")?.addEventListener("click", async () => {
  const taken = await send("/api/challenge", { link: location.search.slice(1) });
  if (taken) location.assign(taken.play);
});
connectKeys({ t: toggleTheme, "?": () => $("keys").showModal() });
$("live").textContent = "";
document.body.dataset.ready = "true";
