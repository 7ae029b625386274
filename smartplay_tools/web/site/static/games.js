"use strict";
// The games to choose from: a page of which nothing changes by itself.
connectKeys({ t: toggleTheme, "?": () => $("keys").showModal() });
$("live").textContent = "";
document.body.dataset.ready = "true";
