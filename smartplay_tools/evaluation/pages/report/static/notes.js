"use strict";
// Notes of people about turns, in a file beside the record. Only a site that was started with --annotate writes them.

function notesOf(episode) {
  return new Map((episode.notes ?? []).map(({ turn, note }) => [turn, note]));
}

function renderNote() {
  const notes = notesOf(shown.episode);
  const note = notes.get(shown.turn);
  const others = [...notes.keys()].filter((turn) => turn !== shown.turn);
  const links = others.map((turn) => element("button", { type: "button", onclick: () => goTo(turn) }, `turn ${number(turn)}`));
  const list = others.length ? element("p", { class: "small" }, "notes at ", ...links) : null;
  $("note").replaceChildren(...[note ? element("pre", { class: "note" }, note) : null, list].filter(Boolean));
  $("note-card").hidden = !notes.size && !served?.notes;
  $("write-note").hidden = !served?.notes;
}

function openNote() {
  if (!served?.notes) {
    $("announce").textContent = "To write notes, start the site with smartplay-tools view --annotate.";
    return;
  }
  $("note-text").value = notesOf(shown.episode).get(shown.turn) ?? "";
  $("note-place").textContent = `turn ${number(shown.turn)}`;
  $("note-problem").textContent = "";
  $("note-dialog").showModal();
  $("note-text").focus();
}

async function saveNote() {
  const headers = { "Content-Type": "application/json", "X-SmartPlay-Key": served.key };
  const body = JSON.stringify({ turn: shown.turn, note: $("note-text").value });
  const { answer, problem } = await request(served.notes, { method: "POST", headers, body });
  $("note-problem").textContent = problem ?? "";
  if (!answer) return;
  shown.episode.notes = answer;
  $("note-dialog").close();
  renderNote();
}

function connectNotes() {
  $("write-note").addEventListener("click", openNote);
  $("save-note").addEventListener("click", saveNote);
  $("close-note").addEventListener("click", () => $("note-dialog").close());
}
