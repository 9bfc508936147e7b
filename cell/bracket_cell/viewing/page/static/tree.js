"use strict";
// A tree as an outline of which only the rows in sight are elements; over a log with the state at any of its ticks,
// which lie in the page, or come from a run that goes on.
const at = (id) => document.getElementById(id);
const live = !at("data");
const { parts, line, title, remarks } = live ? { parts: [], line: { ticks: [], words: [""] }, title: "", remarks: [] } : JSON.parse(at("data").textContent);
const ROW = 22, SPARE = 8, KEY = 200; // pixels; rows beyond the window; ticks between two whole states
const MARKS = { 0: "○", 1: "▶", 2: "✔", 3: "✘", 4: "–" };
const COLOURS = { 1: "--run", 2: "--good", 3: "--bad" };
const MOST = 30000, ASK_MS = 200, SILENT_MS = 2000, ANSWER_MS = 3000; // ticks that are kept; how a run is asked
const DEPTH = 0, TAG = 1, NAME = 2, KIND = 3, PORTS = 4, FILE = 5, LINE = 6, PATH = 7;
const words = line ? line.words : [];
let part = 0, now = 0, chosen = 0, query = "", shown = [], found = new Set(), timer = 0;
let state = null; // of the tick `now`: codes and words by uid, entries
let t = (text) => text; // into the language of the page; a file speaks English

function learnt(one) {
  const count = one.nodes.length;
  one.end = new Int32Array(count); // of each node the place after all that is below it
  one.up = new Int32Array(count).fill(-1);
  one.text = one.nodes.map((n) => [n[TAG], n[NAME], n[PATH], ...Object.entries(n[PORTS]).flat()].join(" ").toLowerCase());
  one.folded = new Set();
  const open = [];
  one.nodes.forEach((n, place) => {
    while (open.length > n[DEPTH]) one.end[open.pop()] = place;
    if (open.length) one.up[place] = open[open.length - 1];
    open.push(place);
  });
  while (open.length) one.end[open.pop()] = count;
  return one;
}
parts.forEach(learnt);

// --- the state at a tick -------------------------------------------------------------------------------------------
const keys = new Map();
const fresh = (p) => ({ codes: new Uint8Array(parts[p].nodes.length), said: new Int32Array(parts[p].nodes.length), entries: {}, new: new Set() });
const copy = (s) => ({ codes: s.codes.slice(), said: s.said.slice(), entries: { ...s.entries }, new: new Set(s.new) });

function take(s, tick, before) {
  const [p, , , , changes, entries, , , , whole] = line.ticks[tick];
  if (whole || tick === 0 || line.ticks[tick - 1][0] !== p) Object.assign(s, fresh(p), { entries: before && !whole ? s.entries : {} });
  for (const [uid, code, said] of changes) { s.codes[uid - 1] = code; if (said !== undefined) s.said[uid - 1] = said; }
  s.new = new Set(Object.keys(entries));
  for (const [key, word] of Object.entries(entries)) { if (word === null) delete s.entries[key]; else s.entries[key] = word; }
}

function go(tick) {
  if (!line || !line.ticks.length) return;
  tick = Math.max(0, Math.min(line.ticks.length - 1, tick));
  let from = now;
  if (!state || tick < now || tick - now > KEY) {
    from = Math.floor(tick / KEY) * KEY;
    while (from > 0 && !keys.has(from)) from -= KEY;
    state = from > 0 ? copy(keys.get(from)) : fresh(line.ticks[0][0]);
    if (from === 0) take(state, 0, false);
  }
  for (let one = from + 1; one <= tick; one++) {
    take(state, one, true);
    if (one % KEY === 0 && !keys.has(one)) keys.set(one, copy(state));
  }
  now = tick;
  if (line.ticks[now][0] !== part) turn(line.ticks[now][0]);
  if (following()) follow();
  lay();
}

const following = () => at("follow") && at("follow").getAttribute("aria-pressed") === "true";
function follow() { // open what runs, fold the rest, and keep the deepest node that runs in sight
  const one = parts[part], runs = new Set();
  let last = -1;
  state.codes.forEach((code, place) => { if (code === 1) { last = place; for (let up = place; up >= 0 && !runs.has(up); up = one.up[up]) runs.add(up); } });
  one.folded = new Set();
  for (let place = 0; place < one.nodes.length; place++) if (one.end[place] > place + 1 && !runs.has(place) && place > 0) one.folded.add(place);
  follow.to = last;
}

// --- the outline ---------------------------------------------------------------------------------------------------
function lay() { // which rows there are
  const one = parts[part];
  if (!one) return;
  found = new Set();
  const keep = query ? new Set() : null;
  if (query) one.text.forEach((text, place) => {
    if (!text.includes(query)) return;
    found.add(place);
    for (let up = place; up >= 0 && !keep.has(up); up = one.up[up]) keep.add(up);
  });
  shown = [];
  for (let place = 0; place < one.nodes.length;) {
    if (!keep || keep.has(place)) shown.push(place);
    place = !keep && one.folded.has(place) ? one.end[place] : place + 1;
  }
  at("all").style.height = `${shown.length * ROW}px`;
  at("found").textContent = query ? `${found.size} of ${one.nodes.length}` : `${one.nodes.length} nodes`;
  if (following() && follow.to >= 0) sight(follow.to);
  draw();
}

function draw() { // the rows in sight
  const one = parts[part], box = at("tree");
  if (!one) return;
  const first = Math.max(0, Math.floor(box.scrollTop / ROW) - SPARE);
  const last = Math.min(shown.length, Math.ceil((box.scrollTop + box.clientHeight) / ROW) + SPARE);
  at("all").replaceChildren(...shown.slice(first, last).map((place, n) => row(one, place, first + n)));
  tell();
}

function span(name, text) { const made = document.createElement(name === "b" ? "b" : name === "i" ? "i" : "span"); made.textContent = text; return made; }
function row(one, place, turn_) {
  const n = one.nodes[place], code = state ? state.codes[place] : 0, below = one.end[place] - place - 1;
  const made = document.createElement("div");
  made.className = `row ${n[KIND]} s${code}${place === chosen ? " chosen" : ""}${found.has(place) ? " found" : ""}`;
  made.style.top = `${turn_ * ROW}px`;
  made.style.paddingLeft = `${6 + n[DEPTH] * 16}px`;
  made.dataset.place = place;
  made.setAttribute("role", "treeitem");
  made.setAttribute("aria-level", n[DEPTH] + 1);
  if (below) made.setAttribute("aria-expanded", !one.folded.has(place));
  const fold = span("i", below ? (one.folded.has(place) && !query ? "▸" : "▾") : "");
  fold.className = "fold";
  made.append(fold);
  if (line) { const mark = span("i", MARKS[code % 10]); mark.className = "mark"; made.append(mark); }
  made.append(span("b", n[TAG]), n[NAME] ? ` ${n[NAME]} ` : " ");
  const said = state && code ? words[state.said[place]] : "";
  const ports = Object.entries(n[PORTS]).map(([key, value]) => `${key}=${value}`).join("  ");
  const tail = span("span", said || ports);
  tail.className = said ? "says" : "ports";
  made.append(tail);
  if (below && one.folded.has(place) && !query) { const more = span("span", `  … ${below}`); more.className = "in"; made.append(more); }
  return made;
}

function sight(place) {
  const one = parts[part], box = at("tree");
  if (!query) for (let up = one.up[place]; up >= 0; up = one.up[up]) if (one.folded.delete(up)) sight.again = true;
  if (sight.again) { sight.again = false; lay(); }
  const top = shown.indexOf(place) * ROW;
  if (top < box.scrollTop + ROW || top > box.scrollTop + box.clientHeight - 3 * ROW) box.scrollTop = top - box.clientHeight / 2;
}

function choose(place, look) {
  chosen = place;
  if (look) sight(place);
  draw();
  lane();
}

function fold(place) {
  const one = parts[part];
  if (one.end[place] === place + 1) return;
  unfollow();
  if (!one.folded.delete(place)) one.folded.add(place);
  lay();
}

// --- what is said beside it ----------------------------------------------------------------------------------------
function paragraph(text, soft) { const made = document.createElement("p"); made.textContent = text; if (soft) made.className = "soft"; return made; }
function tell() {
  const one = parts[part], n = one.nodes[chosen];
  const place = n[FILE] ? `${n[FILE]}:${n[LINE]}` : "";
  const ports = Object.entries(n[PORTS]).map(([key, value]) => paragraph(`${key} = ${value}`));
  at("node").replaceChildren(paragraph(`${n[TAG]} ${n[NAME]}`), paragraph([n[KIND], place, n[PATH]].filter(Boolean).join(" · "), true),
    paragraph(one.meanings[n[TAG]] ?? "", true), ...ports);
  if (!line || !line.ticks.length) return;
  const [, number, time_s, root, , , why, otherwise] = line.ticks[now];
  at("at").value = now;
  at("clock").textContent = `${time_s.toFixed(2)} s · tick ${number} · ${words[root]}`;
  at("why").textContent = words[why];
  at("otherwise").textContent = words[otherwise];
  at("board").replaceChildren(...Object.keys(state.entries).sort().map((key) => {
    const made = document.createElement("tr"), [tree, name] = key.split("\t");
    if (state.new.has(key)) made.className = "new";
    for (const text of [name, words[state.entries[key]]]) { const cell = document.createElement("td"); cell.textContent = text; made.append(cell); }
    made.title = tree;
    return made;
  }));
}

function lane() { // the chosen node's status over the whole log
  if (!line || !line.ticks.length) return;
  const canvas = at("lane"), count = line.ticks.length, style = getComputedStyle(document.documentElement);
  canvas.width = canvas.clientWidth; canvas.height = canvas.clientHeight;
  const pen = canvas.getContext("2d");
  let code = 0;
  line.ticks.forEach(([p, , , , changes], tick) => {
    if (p !== part) return;
    for (const [uid, to] of changes) if (uid === chosen + 1) code = to;
    const colour = COLOURS[code < 10 || line.ticks[tick][4].some(([uid]) => uid === chosen + 1) ? code % 10 : 0];
    pen.fillStyle = style.getPropertyValue(colour ?? "--line");
    pen.fillRect((tick / count) * canvas.width, 0, canvas.width / count + 1, canvas.height);
  });
}

function change(step) { // to the next tick in which the chosen node changes
  for (let tick = now + step; tick >= 0 && tick < line.ticks.length; tick += step)
    if (line.ticks[tick][0] === part && line.ticks[tick][4].some(([uid]) => uid === chosen + 1)) return go(tick);
}

function play() {
  const plays = timer !== 0;
  clearInterval(timer);
  timer = plays ? 0 : setInterval(() => (now + 1 < line.ticks.length ? go(now + 1) : play()), 40);
  at("play").textContent = plays ? "▶" : "❚❚";
}

function turn(to) { part = to; chosen = 0; at("part").value = to; at("tree").scrollTop = 0; lane(); }

// --- what people do ------------------------------------------------------------------------------------------------
const rowOf = (event) => event.target.closest(".row");
at("tree").addEventListener("scroll", () => requestAnimationFrame(draw));
at("tree").addEventListener("click", (event) => {
  const one = rowOf(event);
  if (!one) return;
  if (event.target.classList.contains("fold")) fold(+one.dataset.place);
  choose(+one.dataset.place);
});
at("tree").addEventListener("dblclick", (event) => { if (rowOf(event)) fold(+rowOf(event).dataset.place); });
at("tree").addEventListener("keydown", (event) => {
  const one = parts[part], place = shown.indexOf(chosen), below = one.end[chosen] > chosen + 1;
  const to = { ArrowDown: shown[place + 1], ArrowUp: shown[place - 1], Home: shown[0], End: shown[shown.length - 1] }[event.key];
  if (to !== undefined) choose(to, true);
  else if (event.key === "ArrowRight" && below) one.folded.has(chosen) ? fold(chosen) : choose(chosen + 1, true);
  else if (event.key === "ArrowLeft") below && !one.folded.has(chosen) ? fold(chosen) : one.up[chosen] >= 0 && choose(one.up[chosen], true);
  else return;
  event.preventDefault();
});
at("search").addEventListener("input", () => { query = at("search").value.trim().toLowerCase(); at("tree").scrollTop = 0; lay(); });
at("search").addEventListener("keydown", (event) => {
  if (event.key === "Enter" && found.size) { const all = [...found]; choose(all.find((place) => place > chosen) ?? all[0], true); }
  if (event.key === "Escape") { at("search").value = query = ""; lay(); sight(chosen); draw(); }
});
at("open").onclick = () => { unfollow(); parts[part].folded.clear(); lay(); };
at("close").onclick = () => {
  unfollow();
  const one = parts[part];
  one.nodes.forEach((_, place) => { if (one.end[place] > place + 1) one.folded.add(place); });
  lay();
};
function unfollow() { if (at("follow")) at("follow").setAttribute("aria-pressed", "false"); }
if (line) {
  at("at").max = line.ticks.length - 1;
  at("at").addEventListener("input", () => go(+at("at").value));
  at("play").onclick = play;
  at("before").onclick = () => change(-1);
  at("after").onclick = () => change(1);
  at("follow").onclick = () => { at("follow").setAttribute("aria-pressed", String(!following())); go(now); };
  at("lane").onclick = (event) => go(Math.floor((event.offsetX / at("lane").clientWidth) * line.ticks.length));
  at("why").onclick = () => { const leaf = line.ticks[now][8]; if (leaf) { unfollow(); choose(leaf - 1, true); } };
  document.addEventListener("keydown", (event) => {
    if (event.target.matches("input[type=search], select")) return;
    if (event.key === " ") { play(); event.preventDefault(); }
    if (event.key === "," || event.key === ".") go(now + (event.key === "." ? 1 : -1));
  });
}
document.addEventListener("keydown", (event) => {
  if (event.key === "/" && event.target !== at("search")) { at("search").focus(); event.preventDefault(); }
});
function name() {
  at("part").replaceChildren(...parts.map((one, place) => new Option(line && parts.length > 1 ? `${one.title} (${place + 1})` : one.title, place)));
  at("part").hidden = parts.length < 2;
  at("part").value = part;
}
function speak() {
  const heads = [t("Node"), t("Why"), t("Blackboard")];
  document.querySelectorAll("h2").forEach((head, place) => (head.textContent = heads[place]));
  at("search").placeholder = `${t("Search")} (/)`;
  [at("open").textContent, at("close").textContent, at("follow").textContent] = [t("Unfold all"), t("Fold all"), t("Follow what runs")];
}
at("part").onchange = () => {
  const to = +at("part").value;
  if (line) return go(line.ticks.findIndex(([p]) => p === to));
  turn(to);
  lay();
};
addEventListener("resize", () => { lane(); draw(); });
document.querySelector("h1").textContent = title;
for (const remark of remarks) {
  const said = span("span", remark);
  said.classList.add("warn", "remarks");
  said.title = remark;
  document.querySelector("header").append(said);
}
if (!line) {
  at("tree").classList.add("still");
  for (const id of ["time", "follow", "moment"]) at(id).hidden = true;
}
name();
speak();
if (line && line.ticks.length) go(0); else lay();
lane();

// --- a run that goes on --------------------------------------------------------------------------------------------
const known = new Map([['""', 0]]); // places of words, by what was told
let run = "", number = 0, heard = Date.now(), drawn = 0;
const token = location.hash.slice(1) || sessionStorage.getItem("token") || localStorage.getItem("paired") || "";

function placed(told) {
  const key = JSON.stringify(told);
  if (!known.has(key)) known.set(key, words.push(t(told)) - 1);
  return known.get(key);
}

function learn([p, tick, time_s, root, changes, entries, why, otherwise, leaf, whole]) {
  const nodes = changes.map(([uid, code, said]) => [uid, code, placed(said)]);
  const board = Object.fromEntries(Object.entries(entries).map(([key, text]) => [key, text === null ? null : placed(text)]));
  return [p, tick, time_s, placed(root), nodes, board, placed(why), placed(otherwise), leaf, whole];
}

function follows(told) {
  if (told.run !== run) {
    parts.length = line.ticks.length = now = part = 0;
    state = null;
    keys.clear();
  }
  [run, number] = [told.run, told.number];
  parts.push(...told.parts.map(learnt));
  if (told.parts.length) name();
  if (!told.ticks.length) return;
  heard = Date.now();
  const newest = now >= line.ticks.length - 1;
  line.ticks.push(...told.ticks.map(learn));
  at("at").max = line.ticks.length - 1;
  if (line.ticks.length > MOST) forget(MOST / 2);
  if (newest) go(line.ticks.length - 1);
  if (Date.now() - drawn < 1000) return;
  drawn = Date.now();
  lane();
}

function forget(count) { // the oldest ticks; the first that stays has the whole state
  const was = now;
  go(count);
  const { codes, said, entries } = state, first = line.ticks[count];
  [first[4], first[5], first[9]] = [[...codes].map((code, place) => [place + 1, code, said[place]]), { ...entries }, true];
  line.ticks.splice(0, count);
  keys.clear();
  [state, now] = [null, 0];
  at("at").max = line.ticks.length - 1;
  go(Math.max(0, was - count));
}

async function ask() {
  try {
    const query = new URLSearchParams({ run, number, parts: parts.length });
    const answer = await fetch(`tree.json?${query}`, { headers: token ? { "X-Cell-Token": token } : {}, signal: AbortSignal.timeout(ANSWER_MS) });
    if (answer.status === 200) follows(await answer.json());
  } catch (problem) {
    if (!(problem instanceof TypeError || problem instanceof DOMException)) throw problem; // nobody answered
  } finally {
    const quiet = Date.now() - heard;
    document.body.classList.toggle("silent", quiet > SILENT_MS);
    if (quiet > SILENT_MS) at("clock").textContent = t("No news for {silent_s} s", { silent_s: Math.floor(quiet / 1000) });
    setTimeout(ask, ASK_MS);
  }
}

if (live) import("./words.js").then(async (told) => {
  await told.learn(localStorage.getItem("language") ?? "usual");
  t = told.t;
  speak();
  ask();
});
