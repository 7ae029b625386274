"use strict";
connectKeys({ t: toggleTheme, "?": () => $("keys").showModal() });
$("live").textContent = "";
document.body.dataset.ready = "true";
