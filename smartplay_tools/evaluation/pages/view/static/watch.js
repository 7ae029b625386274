"use strict";
// One episode that is being played, or two episodes side by side: replay pages in frames. The page of an episode in
// progress is made anew when its record has grown, and opens at its last turn while it is followed.

const RECORD = /^[0-9]+\/(episodes|attempts|running)\/[0-9a-f]{16}(\.[0-9]+)?$/;

function frame(record, name) {
  return element("iframe", { src: `/episode/${record}`, title: name });
}

function compare() {
  const asked = new URLSearchParams(location.search);
  const records = ["a", "b"].map((name) => asked.get(name) ?? "").filter((record) => RECORD.test(record));
  $("live").textContent = records.length === 2 ? "two episodes" : "The address names no two episodes.";
  $("frames").replaceChildren(...records.map((record, place) => frame(record, `episode ${place + 1}`)));
}

function watch() {
  const record = location.pathname.replace("/watch/", "");
  if (!RECORD.test(record)) return;
  const [run, kind, stem] = record.split("/");
  const key = stem.split(".")[0];
  const shown = frame(record, "the episode");
  let calls = null;
  const refresh = () => {
    // An episode has as many turns as calls; a turn beyond the last one is the last.
    shown.src = `/episode/${record}?calls=${calls ?? "end"}#turn=${Math.max(0, (calls ?? 1e6) - 1)}`;
  };
  $("frames").replaceChildren(shown);
  const stream = new EventSource("/api/live");
  stream.onmessage = (event) => {
    const playing = JSON.parse(event.data)[Number(run)].playing.find((one) => one.key === key);
    if (!playing) {
      $("live").textContent = kind === "running" ? "over" : "finished";
      stream.close();
      if ($("follow").checked) shown.src = `/episode/${record}`;
      return;
    }
    $("live").textContent = `${playing.game}, ${playing.player}: step ${playing.steps}, ${plural(playing.calls, "call")}, ${number(playing.tokens)} tokens`;
    if (playing.calls !== calls && $("follow").checked) {
      calls = playing.calls;
      refresh();
    }
  };
}

if (location.pathname === "/compare") compare();
else watch();
document.body.dataset.ready = "true";
