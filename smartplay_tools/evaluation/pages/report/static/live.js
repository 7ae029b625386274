"use strict";
// A page that a site serves: it knows the list of episodes and its neighbours there, and takes in new turns of an episode
// that is being played, without being loaded again. A page from a file knows no site.

const served = JSON.parse(document.body.dataset.site ?? "null");

const LIST = "smartplay-list";

// The least seconds between two requests; more where an answer takes long to make.
const PAUSE = 0.3;

function connectSite() {
  if (!served) return;
  for (const link of document.querySelectorAll('a.brand, .crumbs a[href="#"]')) link.setAttribute("href", home());
  if (!served.updates) return;
  $("follow").addEventListener("change", () => $("follow").checked && goTo(lastTurn()));
  followRecord();
}

// The list as it was left, if it led here; else the run in it.
function home() {
  const list = listed();
  return list?.records.includes(location.pathname) ? list.home : served.home;
}

function listed() {
  try {
    return JSON.parse(sessionStorage.getItem(LIST));
  } catch {
    return null;
  }
}

// The address of the next or the previous episode: of the list as it was filtered and sorted, else of the run.
function neighbour(direction) {
  const records = listed()?.records ?? [];
  const at = records.indexOf(location.pathname);
  if (at >= 0) return records[at + direction] ?? null;
  return (direction > 0 ? served.next : served.previous) ?? null;
}

function leave() {
  location.assign(home());
}

// --- New turns -------------------------------------------------------------------------------------------------------

async function followRecord() {
  let version = served.version;
  for (;;) {
    const began = performance.now();
    try {
      const answer = await fetch(`${served.updates}?after=${encodeURIComponent(version)}`);
      if (!answer.ok) {
        $("live").textContent = await answer.text();
        return;
      }
      const news = await answer.json();
      version = news.version;
      served.playing = news.playing;
      $("live").textContent = news.playing ? news.figures : "over";
      if (news.data) await takeIn(news.data, news.playing);
      document.body.dataset.version = version;
      if (!news.playing) return;
    } catch {
      $("live").textContent = "the server does not answer";
    }
    await new Promise((resolve) => setTimeout(resolve, Math.max(1000 * PAUSE, performance.now() - began)));
  }
}

// Show the new state of the episode; a page that follows it, and is at its last turn, moves to the new last turn.
async function takeIn(packed, isPlaying) {
  const key = shown.episode.key;
  const follows = $("follow").checked && shown.turn >= lastTurn();
  $("pack-0").textContent = packed;
  useEpisode(await openEpisode(key));
  if (!isPlaying) $("follow").disabled = true;
  goTo(follows ? lastTurn() : shown.turn, follows ? null : shown.step);
}
