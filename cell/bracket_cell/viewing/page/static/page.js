// Draws what the cell tells, and says what the operator presses. No framework, no build step.
import { learn, name, t } from "./words.js";

const SVG = ["svg", "rect", "circle", "text", "polyline", "polygon", "path", "g"];
const COLOURS = ["#3b82d6", "#d9822b", "#2a9d74", "#a24bb3", "#c23b4e", "#6b7a1f", "#8a8f98"];
const SIGNS = { alarm: "!", question: "?", waits: "II", brings: "II", finished: "✓", paused: "II", over: "■" };
const SURE_MS = 6000; // so long Stop waits to be pressed again
const NOTICE_S = 20; // a change of the orders is told for so long
const ARRIVE_MS = 3000; // an order that was not answered for so long did not arrive
const BETWEEN_MS = 4000; // a cell without a run says so each second
const ANEW_MS = 5000; // so long a silent connection is kept before the next is tried
const UNKNOWN = "none of these";
// name, key, words, what it says, and why it does nothing now: null where it does something
const BUTTONS = [
  ["pauseNow", "p", "Pause now", () => say("pause", "now"), (s) => (s.operator.pause === "now" ? "it is paused already" : null)],
  ["pausePart", "a", "Pause after the part", () => say("pause", "after part"), (s) => (s.operator.pause === "none" ? null : "it is paused already")],
  ["resume", "r", "Resume", () => say("resume"), (s) => (s.operator.pause === "none" ? "nothing is paused" : null)],
  ["acknowledge", "k", "Acknowledge", () => say("acknowledge"), (s) => (s.asks ? null : "nothing waits to be acknowledged")],
  ["place", "i", "I place this one", () => say("place", planned), () => (planned ? null : "no part is asked for")],
  ["finish", "e", "End after this bracket", () => say("finish"), (s) => whyNoFinish(s)],
  ["stop", "s", "Stop", stop, () => null],
];
let token = location.hash.slice(1) || sessionStorage.getItem("token") || localStorage.getItem("paired") || "";
if (location.hash) {
  sessionStorage.setItem("token", token);
  history.replaceState(null, "", location.pathname);
}
let shown = token ? { "X-Cell-Token": token } : {};
const $ = (id) => document.getElementById(id);
let still = null; // what does not change with the ticks
let last = null; // the newest state
let seen = null; // the hand, as it was told last
let points = []; // of the belief over time
let planned = ""; // type of the part that the robot asks for or fetches next
let front = "";
let operates = false;
let stopAsked = 0;
let space = null; // the view in three dimensions
let over = false;
let served = false; // the page outlives runs
let events = null; // the connection by which states come
let heard = Date.now(); // when the newest came, and when the connection was made
let age = 0; // of the newest, as it came [ms]
let ahead = Infinity; // the least that this clock was ever ahead of the cell's when news came [ms]
let known = {}; // the state that is followed by what changes
let opened = 0;
let silent = false; // what is shown is old
let between = null; // how the cell is while no run goes on
let changing = ""; // id of the order that is being changed
const lost = new Map(); // by name of a button, until when it says that its press did not arrive

function make(tag, attributes = {}, ...children) {
  const node = SVG.includes(tag) ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "onclick") node.addEventListener("click", value);
    else if (value !== null && value !== undefined && value !== false) node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children);
  return node;
}

async function say(kind, value = "", question = null) {
  return post("order", question === null ? { kind, value } : { kind, value, question });
}

async function post(to, values) {
  const body = JSON.stringify(values);
  const headers = { "Content-Type": "application/json", ...shown };
  try {
    const answer = await fetch(to, { method: "POST", headers, body, signal: AbortSignal.timeout(ARRIVE_MS) });
    refused(answer.ok ? "" : await answer.text());
    return answer.ok;
  } catch {
    refused("it did not reach the cell");
    return null;
  }
}

function refused(why) {
  $("said").textContent = why ? t("Not taken: {why}", { why }) : "";
}

function stop() {
  if (Date.now() - stopAsked < SURE_MS) return say("stop");
  stopAsked = Date.now();
  showButtons();
  setTimeout(showButtons, SURE_MS + 100);
  return true;
}

function whyNoFinish({ operator, brackets }) {
  if (!still.run.shift) return "this run makes one bracket, and ends after it in any case";
  return operator.brackets === 0 ? "this bracket is the last one already" : null;
}

function whyNot(button) {
  if (!operates) return "this page is view-only";
  if (!last || over || between) return "the run is over";
  if (silent) return "there is no news from the cell";
  return button[4](last);
}

function pressed(event) {
  if (!$("keys").checked || between || event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input, select")) return;
  const button = BUTTONS.find(([, key]) => key === event.key);
  if (button) {
    const why = whyNot(button);
    if (why) refused(why);
    else button[3]();
  } else if (/^[1-9]$/.test(event.key)) document.querySelectorAll(".answers button")[Number(event.key) - 1]?.click();
}

function begin() {
  document.addEventListener("keydown", pressed);
  $("toWork").addEventListener("click", () => turnTo("work"));
  $("toEngineer").addEventListener("click", () => turnTo("engineer"));
  $("percent").addEventListener("change", () => say("speed", $("percent").value));
  $("percent").addEventListener("input", () => ($("speed").querySelector("output").textContent = `${$("percent").value} %`));
  $("language").addEventListener("change", async () => {
    localStorage.setItem("language", $("language").value);
    await speak($("language").value);
  });
  $("keys").checked = localStorage.getItem("keys") !== "off";
  $("keys").addEventListener("change", () => localStorage.setItem("keys", $("keys").checked ? "on" : "off"));
  $("pair").addEventListener("submit", pair);
  for (const [name, key, , , ] of BUTTONS) {
    const onclick = async () => {
      if ((await BUTTONS.find((one) => one[0] === name)[3]()) !== null) return;
      lost.set(name, Date.now() + SURE_MS);
      showButtons();
      setTimeout(showButtons, SURE_MS + 100);
    };
    $("buttons").append(make("button", { id: name, "aria-keyshortcuts": key, class: name === "stop" ? "stop" : null, onclick, disabled: true }));
  }
}

function turnTo(view) {
  for (const name of ["work", "engineer"]) $(name).hidden = name !== view;
  $("toWork").setAttribute("aria-pressed", view === "work");
  $("toEngineer").setAttribute("aria-pressed", view === "engineer");
  $("tree").querySelector("iframe")?.remove(); // the run tells of its tree only while somebody looks
  if (view === "engineer") $("tree").append(make("iframe", { src: "tree", title: t("The tree") }));
}

// All words that do not come with the ticks, in a language.
async function speak(language) {
  const told = await learn(language);
  const heads = { bench: "What the camera sees", space: "The cell", goal: "Which product", tree: "The tree", log: "What was said" };
  for (const [id, words] of Object.entries(heads)) document.querySelector(`#${id} h2`).textContent = t(words);
  const [code, who] = document.querySelectorAll("#pair span");
  [code.textContent, who.textContent] = [t("Code that the cell shows"), t("Who operates, or where this page hangs")];
  document.querySelector("#pair button").textContent = t("Pair this page");
  document.querySelector("#log label span").textContent = t("Keys press buttons");
  document.querySelector("#jobs h2").textContent = t("Work orders");
  document.querySelector("#form summary").textContent = t("Order");
  document.querySelector("#done h2").textContent = t("Brackets done");
  $("tree").querySelector("iframe")?.contentWindow.location.reload();
  $("speed").querySelector("span").textContent = t("Speed");
  $("toWork").textContent = t("Work");
  $("toEngineer").textContent = t("Engineer");
  for (const [id, words] of Object.entries({ camera: "What the camera sees", view: "The cell", bracket: "The bracket", history: "Which product", language: "Language", percent: "Speed" })) $(id).setAttribute("aria-label", t(words));
  $("language").replaceChildren(...told.languages.map((name) => make("option", { value: name, selected: name === told.language }, name)));
  front = "";
  if (still) showStill();
  if (between) showBetween(between);
  else if (last) show(last);
  return told;
}

// A browser that the cell does not know says the code that the cell shows, once.
async function pair(event) {
  event.preventDefault();
  const answer = await fetch("pair", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ code: $("code").value, name: $("who").value }) });
  if (!answer.ok) return refused(await answer.text());
  token = (await answer.json()).token;
  shown = { "X-Cell-Token": token };
  localStorage.setItem("paired", token);
  refused("");
  $("pair").hidden = true;
  return follow();
}

// After trouble a run begins by a second press.
function beginRun(button, what) {
  if (between.moment !== "alarm" || Date.now() - (button.dataset.asked ?? 0) < SURE_MS) return post("begin", what);
  button.dataset.asked = Date.now();
  button.textContent = t("Nobody near? Press again");
  return setTimeout(() => ($("begins").dataset.shown = ""), SURE_MS);
}

// Between runs: what happened, and how to begin.
function showBetween(state) {
  [between, last, over] = [state, null, true];
  document.body.dataset.between = state.moment;
  $("begin").hidden = false;
  $("heading").textContent = document.title = state.product;
  for (const id of ["count", "clock"]) $(id).textContent = "";
  $("role").textContent = operates ? "" : t("view-only");
  showDo({ instruction: state });
  for (const id of ["front", "alarms", "robot"]) $(id).replaceChildren();
  if (!document.body.classList.contains("between")) $("form").open = true;
  document.body.classList.add("between");
  const begins = [["", "Begin", {}], ...(state.resumable ? [["again", "Go on where it ended", { resume: true }]] : [])];
  const key = JSON.stringify([state.may_begin, operates, state.resumable, document.documentElement.lang]);
  if ($("begins").dataset.shown !== key) {
    $("begins").dataset.shown = key;
    const buttons = begins.map(([id, words, what]) => make("button", { class: "begin", "data-begin": id || "new", disabled: !operates, onclick: (event) => beginRun(event.target, what) }, t(words)));
    $("begins").replaceChildren(...(state.may_begin ? buttons : []));
  }
  $("reason").textContent = state.problem;
  $("why").textContent = t(state.reason);
  const query = token ? `?token=${encodeURIComponent(token)}` : "";
  const links = [["production", "All that was made"], ["production.csv", "as a table"]];
  if ($("tables").dataset.lang !== document.documentElement.lang) {
    $("tables").dataset.lang = document.documentElement.lang;
    $("tables").replaceChildren(...links.flatMap(([to, words]) => [make("a", { href: to + query, target: "_blank" }, t(words)), " "]));
  }
  showOrderForm(state.variants);
  showWork(state.orders, state.brackets, state.variants);
  showButtons();
}

function colour(part) {
  return `rgb(${(still.parts[part]?.rgb ?? [136, 136, 136]).join(",")})`;
}

function title(part) {
  return t(still.parts[part]?.title ?? part);
}

// A shape for each type of part: types are told apart without colours.
function shape(part, x, y, r, attributes) {
  const number = Math.max(0, Object.keys(still.parts).indexOf(part));
  if (number % 4 === 0) return make("circle", { ...attributes, cx: x, cy: y, r });
  if (number % 4 === 1) return make("rect", { ...attributes, x: x - 0.9 * r, y: y - 0.9 * r, width: 1.8 * r, height: 1.8 * r });
  const up = number % 4 === 2 ? -1 : 1;
  return make("polygon", { ...attributes, points: `${x},${y + 1.1 * up * r} ${x + 1.05 * r},${y - 0.8 * up * r} ${x - 1.05 * r},${y - 0.8 * up * r}` });
}

// A bracket as the person sees it. `holes` by position: what is known of each, where it is one that is being worked on.
function drawn(placements, holes = null) {
  const places = Object.entries(still.holes);
  const across = places.map(([, place]) => place[1]);
  const down = places.map(([, place]) => place[0]);
  const [left, top] = [Math.min(...across) - 0.05, Math.min(...down) - 0.045];
  const width = Math.max(...across) - left + 0.05;
  const height = Math.max(...down) - top + (holes ? 0.055 : 0.045);
  const ink = { fill: "currentColor", "text-anchor": "middle" };
  const items = places.map(([name, [y, x]]) => {
    const hole = holes?.[name];
    const status = hole?.status ?? "placed";
    const parts = hole ? hole.parts : [placements[name]];
    const full = status === "placed";
    const line = { stroke: hole?.wrong ? "#a8231c" : "#14171b", "stroke-width": hole?.wrong || status === "robot" ? 0.006 : 0.002 };
    const dash = full ? {} : { "stroke-dasharray": status === "robot" ? "0.012 0.005" : "0.005 0.004" };
    const body = status === "open"
      ? [make("circle", { cx: x, cy: y, r: 0.024, fill: "none", ...line, ...dash })]
      : [shape(parts[0], x, y, 0.024, { fill: full ? colour(parts[0]) : "none", ...line, ...dash })];
    if (!holes) return make("g", {}, ...body);
    const letter = hole.wrong ? "!" : { placed: "", robot: "R", you: "↓", open: "?" }[status];
    body.push(make("text", { ...ink, x, y: y + 0.011, "font-size": 0.032, "font-weight": 700 }, letter));
    body.push(make("text", { ...ink, x, y: y + 0.046, "font-size": 0.02 }, name));
    return make("g", {}, ...body);
  });
  return { box: `${left} ${top} ${width} ${height}`, items };
}

function picture(placements) {
  const { box, items } = drawn(placements);
  return make("svg", { viewBox: box, "aria-hidden": "true" }, ...items);
}

function showStill() {
  const { run } = still;
  $("heading").textContent = [run.product, run.tree, run.safety && t("safety configuration {hash}", { hash: run.safety }), run.unsafe && t("UNSAFE, weaker than the shipped table: {what}", { what: run.unsafe })].filter(Boolean).join(", ");
  document.title = run.product ?? "cell";
  $("heading").classList.toggle("unsafe", Boolean(run.unsafe));
  $("role").textContent = operates ? "" : t("view-only");
  showOrderForm(titles());
  showButtons();
}

function titles() {
  return Object.fromEntries(Object.entries(still.goals).map(([name, goal]) => [name, goal.title]));
}

// The form for a work order, new or changed; it stays as it is while somebody fills it.
function showOrderForm(variants) {
  const key = JSON.stringify([variants, document.documentElement.lang]);
  if ($("next").dataset.shown === key) return;
  $("next").dataset.shown = key;
  const amount = make("input", { type: "number", min: 1, max: 999, value: 1, "aria-label": t("How many"), id: "amount" });
  const options = Object.entries(variants).map(([name, words]) => make("option", { value: name }, t(words)));
  const variant = make("select", { id: "variant", "aria-label": t("Which product") }, ...options);
  const id = make("input", { id: "orderId", maxlength: 60, placeholder: t("Number"), "aria-label": t("Number") });
  const due = make("input", { id: "due", type: "datetime-local", "aria-label": t("Due") });
  const start = async () => {
    const order = { variant: variant.value, amount: Number(amount.value), ...(id.value.trim() && { id: id.value.trim() }), ...((due.value || changing) && { due: due.value }) };
    if (await say("job", JSON.stringify(order))) change(null);
  };
  $("next").replaceChildren(variant, amount, id, due, make("button", { id: "start", onclick: start }, t("Order")));
}

function change(job) {
  if (job) $("form").open = true;
  changing = job?.id ?? "";
  [$("variant").value, $("amount").value, $("orderId").value, $("due").value] = [job?.variant ?? $("variant").value, job?.amount ?? 1, changing, job?.due?.slice(0, 16) ?? ""];
  $("orderId").readOnly = Boolean(job);
  $("start").textContent = t(job ? "Change" : "Order");
}

function showButtons() {
  for (const button of BUTTONS) {
    const [name, key, words] = button;
    const why = whyNot(button);
    const sure = name === "stop" && Date.now() - stopAsked < SURE_MS;
    $(name).disabled = Boolean(why);
    $(name).title = why ? t(why) : `${t("key")} ${key}`;
    const missed = (lost.get(name) ?? 0) > Date.now();
    $(name).textContent = sure ? t("Press again to stop") : missed ? t("{words}: not sent", { words: t(words) }) : t(words);
    $(name).classList.toggle("sure", sure);
    $(name).classList.toggle("missed", missed);
  }
  for (const name of ["start", "amount", "variant", "orderId", "due"]) if ($(name)) $(name).disabled = !operates || silent || (over && !between);
  $("percent").disabled = !operates || over || !last;
}

// What is old is not shown as if it were now: grey, and nothing in it can be pressed.
function watchNews() {
  const quiet = Date.now() - heard;
  const now = between ? quiet > BETWEEN_MS : Boolean(last) && !over && quiet > 1000 * still.silent_s;
  if (now !== silent) {
    silent = now;
    document.body.classList.toggle("silent", silent);
    for (const id of ["front", "pair", "work", "engineer", "buttons", "speed"]) $(id).inert = silent;
    $("words").dataset.told = $("said").textContent = front = "";
    if (!silent) between ? showBetween(between) : show(last);
    showButtons();
  }
  if (!silent) return;
  $("do").dataset.moment = "alarm";
  $("sign").textContent = SIGNS.alarm;
  $("words").textContent = t("No news for {silent_s} s. Use the stop button at the cell.", { silent_s: Math.floor(quiet / 1000) });
  if (Date.now() - opened > ANEW_MS) follow();
}

function showDo({ instruction }) {
  if ($("words").dataset.told === JSON.stringify([instruction.words, document.documentElement.lang])) return;
  $("words").dataset.told = JSON.stringify([instruction.words, document.documentElement.lang]);
  $("do").dataset.moment = instruction.moment;
  $("sign").textContent = SIGNS[instruction.moment] ?? "→";
  $("words").textContent = t(instruction.words);
}

function showFront(state) {
  const notice = [...state.lines].reverse().find(([time, level, words]) => level === "warning" && t(words).length && JSON.stringify(words).includes("work order") && state.time_s - time < NOTICE_S);
  const now = JSON.stringify([state.ended, state.instruction.moment, state.alarms, state.questions, notice, operates]);
  if (now === front) return; // a button that is being pressed stays the same
  front = now;
  const told = ["waits", "over"].includes(state.instruction.moment); // the sentence says it already
  const alarms = (told ? [] : state.alarms).map(([signal, words]) => make("div", { class: "alarm", "data-signal": signal }, t(words)));
  $("alarms").replaceChildren(...alarms, ...(notice ? [make("div", { class: "notice" }, t(notice[2]))] : []));
  $("front").replaceChildren(...state.questions.map(asked));
}

function asked(question) {
  const answers = question.answers.map((answer) => {
    const onclick = () => say("answer", answer.value, question.number);
    const words = question.kind === "goal" && still.goals[answer.value] ? still.goals[answer.value].title : answer.words;
    const button = make("button", { onclick, disabled: !operates, "data-value": answer.value }, t(words));
    if (Object.keys(answer.placements).length) button.append(picture(answer.placements));
    return button;
  });
  if (question.kind === "text") answers.push(...written(question));
  const words = [make("div", {}, t(question.reason))];
  if (question.tried) words.push(make("p", {}, t("Tried before: {tried}", { tried: question.tried })));
  const number = { class: "question", "data-number": question.number, "data-kind": question.kind };
  return make("div", number, ...words, make("div", { class: "answers" }, ...answers));
}

// A field for an answer in words of one's own.
function written(question) {
  const field = make("input", { maxlength: 200, disabled: !operates, "aria-label": t(question.reason) });
  const send = () => field.value.trim() && say("answer", field.value.trim(), question.number);
  field.addEventListener("keydown", (event) => event.key === "Enter" && send());
  return [field, make("button", { onclick: send, disabled: !operates }, t("Send"))];
}

function showBench({ hand }) {
  seen = hand;
  const held = hand.held ? `, ${title(hand.held)}` : "";
  $("action").textContent = t(hand.unknown) || (hand.box ? `${t("hand")}: ${t(hand.action)}${held}` : t("no hand in view"));
}

// What was found in the picture that is drawn, not in a newer one; and where the sentence means.
function showMarks(hand) {
  const [width, height] = still.image_px;
  $("overlay").setAttribute("viewBox", `0 0 ${width} ${height}`);
  const line = { fill: "none", stroke: "#ffdc00", "stroke-width": 2 };
  const marks = [];
  if (hand.track.length > 1) marks.push(make("polyline", { ...line, points: hand.track.join(" "), opacity: 0.8 }));
  if (hand.box) {
    const [x, y, right, bottom] = hand.box;
    marks.push(make("rect", { ...line, x, y, width: right - x, height: bottom - y }));
  }
  const { instruction, bracket } = last;
  for (const [name, [x, y, r]] of Object.entries(still.marks.holes)) {
    const letter = { placed: "", robot: "R", you: "", open: "?" }[bracket[name].status];
    if (letter) marks.push(...halo("text", { x, y: y + 6, "font-size": 18, "font-weight": 700, "text-anchor": "middle" }, letter));
    if (instruction.holes.includes(name) && bracket[name].status !== "open") marks.push(...halo("circle", { cx: x, cy: y, r: r * 1.6, fill: "none" }), ...arrow(x, y - r * 1.7));
  }
  const meant = instruction.bins.map((part) => [title(part), still.marks.bins[part]]);
  if (instruction.tray) meant.push(["", still.marks.tray]);
  for (const [words, place] of meant) if (place) marks.push(...pointed(words, place, width, height));
  $("overlay").replaceChildren(...marks);
  $("overlay").dataset.sequence = hand.sequence;
}

// White on black, so that it is seen on any picture.
function halo(tag, attributes, ...children) {
  const fill = attributes.fill ?? "#fff";
  return [["#000", 7], ["#fff", tag === "text" ? 0 : 3]].map(([stroke, width]) =>
    make(tag, { ...attributes, fill: fill === "none" ? "none" : fill, stroke, "stroke-width": width, "paint-order": "stroke" }, ...children));
}

function arrow(x, y, turn = 0) {
  return halo("path", { d: "M0,0 L-14,-20 L-5,-20 L-5,-44 L5,-44 L5,-20 L14,-20 Z", transform: `translate(${x} ${y}) rotate(${turn})` });
}

// An arrow at a place, or at the edge of the picture beyond which it is.
function pointed(words, [x, y], width, height) {
  const [inX, inY] = [Math.min(Math.max(x, 14), width - 14), Math.min(Math.max(y, 50), height - 14)];
  const outside = inX !== x || inY !== y;
  const turn = outside ? (Math.atan2(y - inY, x - inX) * 180) / Math.PI - 90 : 0;
  const label = { x: Math.min(Math.max(inX, 60), width - 60), y: Math.max(inY - 50, 18), "font-size": 20, "font-weight": 700, "text-anchor": "middle" };
  return [...arrow(inX, inY, turn), ...halo("text", label, words)];
}

function showBracket({ bracket, questions }) {
  const named = (where) => new Set(questions.flatMap((one) => ((one.kind === "where") === where ? one.positions : [])));
  const [wrong, offered] = [named(false), named(true)];
  for (const [name, hole] of Object.entries(bracket)) hole.wrong = wrong.has(name) || !hole.upright;
  const { box, items } = drawn({}, bracket);
  $("bracket").setAttribute("viewBox", box);
  $("bracket").replaceChildren(...items);
  const rows = Object.entries(bracket).map(([name, hole]) => {
    const asks = hole.wrong || offered.has(name);
    const parts = hole.parts.length > 1 ? hole.parts.map(title).reduce((first, second) => t("{first} or {second}", { first, second })) : title(hole.parts[0] ?? "");
    const words = {
      placed: hole.who === "robot" ? t("{part}, by the robot", { part: parts }) : t("{part}, by you", { part: parts }),
      robot: t("{part}: the robot brings it", { part: parts }),
      you: t("{part}: you place it", { part: parts }),
      open: hole.parts.length ? `${parts}?` : t("not known yet"),
    }[hole.status];
    return make("li", { class: asks ? "asked" : hole.status, "data-hole": name, title: words }, make("b", {}, `${hole.wrong ? "! " : ""}${name}`), asks && !hole.wrong ? t("here?") : words);
  });
  $("holes").replaceChildren(...rows);
}

// Which bracket it may be, by title and picture; one of them where it is known.
function showGoals({ belief, bracket }) {
  const open = Object.values(bracket).some((hole) => hole.status === "open");
  const likely = Object.keys(still.goals).filter((goal) => (belief[goal] ?? 0) >= 0.05).sort((a, b) => belief[b] - belief[a]);
  const shown = open ? likely : likely.slice(0, 1);
  const key = JSON.stringify([shown, operates, document.documentElement.lang]);
  if ($("goals").dataset.shown === key) return;
  $("goals").dataset.shown = key;
  const words = (goal) => shown.length > 1 ? `${t(still.goals[goal].title)}?` : t("taken for {goal}", { goal: still.goals[goal].title });
  const figures = shown.map((goal) => make("figure", { "data-goal": goal }, picture(still.goals[goal].placements), words(goal)));
  const other = { id: "other", onclick: () => say("other", shown[0]), disabled: !operates };
  $("goals").replaceChildren(...figures, ...(shown.length === 1 ? [make("button", other, t("Not this one"))] : []));
}

function showRobot({ robot, questions, pose, bracket, tray, hand }) {
  planned = questions.find((one) => one.part)?.part ?? robot.next?.[0] ?? "";
  const waits = !robot.next && !robot.moving && robot.doubt;
  const [does, ...why] = (t(robot.now) || t("nothing")).split("; ");
  const more = [...why, ...(waits ? [t("waits because {why}", { why: waits })] : [])];
  $("robot").replaceChildren(`${t("Robot")}: ${does}`, ...(more.length ? [make("small", {}, ` – ${more.join("; ")}`)] : []));
  space?.show({ pose, bracket, tray, hand });
}

function showWork(jobs, brackets, variants) {
  const key = JSON.stringify([jobs, brackets.map((one) => [one.run, one.number, one.finished, one.correct]), operates, document.documentElement.lang, Math.floor(Date.now() / 60000)]);
  if ($("orders").dataset.shown === key) return; // a button that is being pressed stays the same
  $("orders").dataset.shown = key;
  $("orders").replaceChildren(...jobs.map((job) => {
    const late = Boolean(job.due) && new Date(job.due) < new Date();
    const due = job.due ? t(late ? ", late: it was due {due}" : ", due {due}", { due: new Date(job.due).toLocaleString(document.documentElement.lang, { dateStyle: "short", timeStyle: "short" }) }) : "";
    const words = t("{id}: {done} of {amount} {variant}", { id: job.id, done: job.done, amount: job.amount, variant: variants[job.variant] ?? job.variant });
    let sure = 0;
    const cancel = (event) => {
      if (Date.now() - sure < SURE_MS) return say("job", JSON.stringify({ id: job.id, cancelled: true }));
      [sure, event.target.textContent] = [Date.now(), t("Press again to cancel")];
      return setTimeout(() => (event.target.textContent = t("Cancel")), SURE_MS);
    };
    const buttons = operates ? [make("button", { "data-change": job.id, onclick: () => change(job) }, t("Change")), make("button", { "data-cancel": job.id, onclick: cancel }, t("Cancel"))] : [];
    return make("li", { "data-order": job.id, class: late ? "late" : null }, make("span", {}, words + due), ...buttons);
  }));
  const done = [...brackets].reverse().filter((one) => one.finished !== null).map((one) => {
    const what = t(variants[one.variant] ?? one.variant ?? "");
    const who = t("robot {robot}, you {person}", { robot: one.robot, person: one.person });
    const missed = one.misses_order ? `, ${t("not as {order} wants it", { order: one.ordered })}` : "";
    const words = `${one.finished && one.correct !== false ? "✓" : "✗"} ${one.number} ${what} ${Math.round(one.took_s)} s, ${who}${one.order ? `, ${one.order}` : ""}${missed}`;
    const places = Object.entries(one.placed).map(([name, [part, by]]) => `${name} ${still ? title(part) : part}: ${by === "robot" ? t("Robot") : t("you")}`);
    const judge = operates && between && one.finished && one.correct === null ? [[true, "Right"], [false, "Wrong"]] : [];
    const buttons = judge.map(([right, words]) => make("button", { "data-right": right, onclick: () => post("order", { kind: "inspected", run: one.run, number: one.number, right }) }, t(words)));
    return make("li", { title: places.join("\n") }, words, ...buttons);
  });
  $("brackets").replaceChildren(...done);
}

function showCount({ operator, brackets }) {
  const number = brackets.at(-1)?.number;
  const wanted = operator.brackets;
  $("count").textContent = number ? (wanted ? t("bracket {number} of {wanted}", { number, wanted: Math.max(wanted, number) }) : t("bracket {number}", { number })) : "";
}

function showGoal(state) {
  const goals = Object.keys(state.belief);
  const bars = goals.map((goal, number) => {
    const value = state.belief[goal];
    const name = make("span", {}, t(still.goals[goal]?.title ?? goal));
    name.style.setProperty("--dot", COLOURS[number % COLOURS.length]);
    const share = make("span", {}, `${Math.round(100 * value)} %`);
    return make("div", { class: "bar" }, name, make("meter", { value, min: 0, max: 1, "aria-label": goal }), share);
  });
  $("bars").replaceChildren(...bars);
  if (state.point && points.at(-1)?.[0] !== state.point[0]) points = [...points.slice(-400), state.point];
  const first = points[0]?.[0] ?? 0;
  const end = Math.max(state.time_s, first + 1);
  const lines = goals.map((goal, number) => {
    const way = points.flatMap(([time, belief], place) =>
      [time, points[place + 1]?.[0] ?? end].map((at) => `${(1000 * (at - first)) / (end - first)},${96 - 92 * (belief[goal] ?? 0)}`));
    const stroke = COLOURS[number % COLOURS.length];
    return make("polyline", { points: way.join(" "), fill: "none", stroke, "stroke-width": 2, "vector-effect": "non-scaling-stroke" });
  });
  $("history").setAttribute("viewBox", "0 0 1000 100");
  $("history").replaceChildren(...lines);
  const key = goals.join() + operates + document.documentElement.lang;
  if ($("choices").dataset.goals === key) return;
  $("choices").dataset.goals = key;
  const buttons = goals.map((goal) => {
    const attributes = { onclick: () => say("goal", goal), disabled: !operates, "data-goal": goal };
    return make("button", attributes, goal === UNKNOWN ? t("a new one") : t(still.goals[goal]?.title ?? goal));
  });
  $("choices").replaceChildren(make("span", {}, t("It is ...")), ...buttons);
}

function showLines(state) {
  const lines = [...state.lines].reverse().map(([time, level, words]) =>
    make("li", { class: level }, make("time", {}, `${time.toFixed(1)} s`), t(words)));
  $("lines").replaceChildren(...lines);
  const [mode, why] = state.robot.safety;
  $("safety").textContent = [mode.replaceAll("_", " "), why].filter(Boolean).join(": ");
}

function showRest(state) {
  const pause = { now: t("paused"), "after part": t("pause after this part") }[state.operator.pause];
  const percent = Math.round(100 * state.operator.speed);
  $("clock").textContent = [`${state.time_s.toFixed(1)} s`, pause].filter(Boolean).join(", ");
  if (document.activeElement !== $("percent")) $("percent").value = percent;
  $("speed").querySelector("output").textContent = `${percent} %`;
  showButtons();
}

function show(state) {
  if (!still || state.tick === undefined) return;
  [last, between] = [state, null];
  over = Boolean(state.ended);
  if (document.body.classList.contains("between")) $("form").open = false;
  document.body.classList.remove("between");
  $("begin").hidden = true;
  for (const part of [showDo, showFront, showBench, showBracket, showGoals, showRobot, showCount, showRest]) part(state);
  showWork(state.operator.jobs, state.brackets, titles());
  if (!$("engineer").hidden) for (const part of [showGoal, showLines]) part(state);
  else if (state.point && points.at(-1)?.[0] !== state.point[0]) points = [...points.slice(-400), state.point];
  document.body.dataset.tick = state.tick;
}

function follow() {
  events?.close();
  [opened, ahead, known] = [Date.now(), Infinity, {}];
  events = new EventSource(token ? `events?token=${encodeURIComponent(token)}` : "events"); // which sends no headers
  events.addEventListener("role", (event) => {
    operates = event.data === "operate";
    $("pair").hidden = operates || !served;
    front = $("begins").dataset.shown = "";
  });
  events.addEventListener("still", (event) => {
    still = JSON.parse(event.data);
    points = still.history;
    name(Object.fromEntries(Object.entries(still.parts).map(([part, { title: words }]) => [part, words])));
    showStill();
    if (!silent) refused("");
    if (!space) build();
  });
  events.addEventListener("age", (event) => {
    const [old, sent] = event.data.split(" ").map((seconds) => 1000 * Number(seconds));
    ahead = Math.min(ahead, Date.now() - sent); // what comes later than the quickest was under way, or this page slept
    age = old + Date.now() - sent - ahead;
  });
  events.addEventListener("state", (event) => {
    const state = (known = { ...known, ...JSON.parse(event.data) });
    heard = Date.now() - (state.ended ? 0 : age);
    if (silent || Date.now() - heard > 1000 * still.silent_s) last = state;
    if (Date.now() - heard > 1000 * still.silent_s) return; // old news look old
    watchNews();
    show(state);
    if (state.ended && !served) events.close();
  });
  events.addEventListener("codes", (event) => {
    const { operate, look } = JSON.parse(event.data);
    $("codes").textContent = t("Code for another page: {operate} to operate, {look} only to look", { operate, look });
  });
  events.addEventListener("between", (event) => {
    const state = JSON.parse(event.data);
    [served, heard] = [true, Date.now() - age];
    if (silent) between = state;
    if (age > BETWEEN_MS) return;
    watchNews();
    showBetween(state);
  });
  events.addEventListener("served", () => (served = true));
  events.addEventListener("error", async () => {
    const answer = await fetch("metrics", { headers: shown, signal: AbortSignal.timeout(ARRIVE_MS) }).catch(() => null); // which says whether this browser is known
    if (answer?.status === 401) $("pair").hidden = false;
  });
}

// The view in three dimensions comes last: the page works without it, as where a browser has no WebGL.
async function build() {
  space = { show: () => {} };
  try {
    if (!make("canvas").getContext("webgl2")) throw new Error("WebGL");
    const [{ Space }, answer] = await Promise.all([import("./scene.js"), fetch("scene.json", { headers: shown })]);
    space = new Space($("view"), await answer.json(), still);
    if (last) showRobot(last);
  } catch (problem) {
    $("view").dataset.problem = String(problem);
    $("space").querySelector("h2").textContent = t("This browser shows no view in three dimensions");
  }
}

// Drawn when it is there, so that the picture never goes black in between.
async function watchCamera() {
  const camera = $("camera");
  try {
    const hand = seen;
    const answer = await fetch(hand ? `camera.jpg?sequence=${hand.sequence}` : "camera.jpg", { headers: shown, signal: AbortSignal.timeout(ARRIVE_MS) });
    if (answer.status === 200) {
      const image = await createImageBitmap(await answer.blob());
      [camera.width, camera.height] = [image.width, image.height];
      camera.getContext("2d").drawImage(image, 0, 0);
      if (hand && last) showMarks(hand);
    }
    setTimeout(watchCamera, answer.status === 200 && !over ? 80 : 1000);
  } catch {
    setTimeout(watchCamera, 1000);
  }
}

begin();
const { language, languages } = await speak(localStorage.getItem("language") ?? "usual");
const own = navigator.language.slice(0, 2);
if (language === "en" && own !== "en" && languages.includes(own) && !localStorage.getItem("language")) await speak(own);
follow();
setInterval(watchNews, 500);
for (const wakes of ["visibilitychange", "resume"]) document.addEventListener(wakes, watchNews);
watchCamera();
