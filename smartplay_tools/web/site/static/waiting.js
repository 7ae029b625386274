"use strict";
// The report is on its way; the page says so until it comes.
$("live").textContent = "one moment";
