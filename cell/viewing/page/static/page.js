// Draws what the cell tells, and says what the operator presses. No framework, no build step.
import { STRINGS as S } from "./strings.js";

const SVG = ["svg", "rect", "circle", "text", "polyline", "g"];
const COLOURS = ["#3b82d6", "#d9822b", "#2a9d74", "#a24bb3", "#c23b4e", "#6b7a1f", "#8a8f98"];
const ORDERS = [
  ["pauseNow", "p", () => say("pause", "now")],
  ["pausePart", "a", () => say("pause", "after part")],
  ["resume", "r", () => say("resume")],
  ["place", "i", () => say("place", planned)],
  ["acknowledge", "k", () => say("acknowledge")],
  ["finish", "e", () => say("finish")],
  ["stop", "s", stop],
];
const token = location.hash.slice(1) || sessionStorage.getItem("token") || "";
if (location.hash) {
  sessionStorage.setItem("token", token);
  history.replaceState(null, "", location.pathname);
}
const $ = (id) => document.getElementById(id);
let still = null; // what does not change with the ticks
let seen = null; // the hand, as it was told last
let points = []; // of the belief over time
let planned = ""; // type of the part that the robot asks for or fetches next
let front = "";
let stopAsked = 0;

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
  const body = JSON.stringify(question === null ? { kind, value } : { kind, value, question });
  const headers = { "Content-Type": "application/json", "X-Cell-Token": token };
  try {
    const answer = await fetch("order", { method: "POST", headers, body });
    const told = [kind, value].filter(Boolean).join(" ");
    $("said").textContent = answer.ok ? S.sent + told : S.refused + (await answer.text());
  } catch {
    $("said").textContent = S.lost;
  }
}

function stop() {
  if (Date.now() - stopAsked < 4000) return say("stop");
  stopAsked = Date.now();
  $("said").textContent = S.stopSure;
  return null;
}

function pressed(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input")) return;
  const order = ORDERS.find(([, key]) => key === event.key);
  if (order && token) order[2]();
  else if (/^[1-9]$/.test(event.key)) document.querySelectorAll(".answers button")[Number(event.key) - 1]?.click();
}

function begin() {
  const heads = { bench: S.bench, work: S.bracket, robot: S.robot, goal: S.goal, tree: S.tree, log: S.log };
  for (const [id, words] of Object.entries(heads)) document.querySelector(`#${id} h2`).textContent = words;
  document.title = S.title;
  document.querySelector("#tree label span").textContent = S.leaf;
  for (const [name, key, onclick] of ORDERS) {
    const attributes = { id: name, title: `${S.key} ${key}`, class: name === "stop" ? "stop" : null, onclick };
    $("orders").append(make("button", { ...attributes, disabled: !token }, S[name]));
  }
  if (!token) $("said").textContent = S.lookOnly;
  document.addEventListener("keydown", pressed);
}

function colour(part) {
  return `rgb(${(still.parts[part]?.rgb ?? [136, 136, 136]).join(",")})`;
}

function title(part) {
  return part ? `${still.parts[part]?.title ?? part} (${part})` : S.nothing;
}

// A bracket as the person sees it. `states` by position, where it is one that is being worked on.
function drawn(placements, states = null) {
  const holes = Object.entries(still.holes);
  const across = holes.map(([, place]) => place[1]);
  const down = holes.map(([, place]) => place[0]);
  const left = Math.min(...across) - 0.05;
  const top = Math.min(...down) - 0.045;
  const width = Math.max(...across) - left + 0.05;
  const height = Math.max(...down) - top + (states ? 0.055 : 0.045);
  const plate = { x: left, y: top, width, height, rx: 0.012, fill: "none", stroke: "currentColor", "stroke-width": 0.002 };
  const items = holes.map(([name, [x, y]]) => {
    const part = placements[name];
    const state = states?.[name];
    const full = !states || state?.placed;
    const spot = make("circle", {
      cx: y, cy: x, r: 0.025, fill: part && full ? colour(part) : "none", stroke: state?.wrong ? "#ff4136" : part ? colour(part) : "gray",
      "stroke-width": state?.wrong || (state?.who === "robot" && !full) ? 0.008 : 0.004, "stroke-dasharray": full ? null : "0.010 0.006",
    });
    const label = { x: y, y: x + 0.046, "font-size": 0.016, "text-anchor": "middle", fill: "currentColor" };
    return make("g", {}, spot, ...(states ? [make("text", label, name)] : []));
  });
  return { box: `${left} ${top} ${width} ${height}`, items: [make("rect", plate), ...items] };
}

function showFront(state) {
  const now = JSON.stringify([state.ended, state.alarms, state.questions]);
  if (now === front) return; // a button that is being pressed stays the same
  front = now;
  const blocks = state.ended ? [make("div", { class: "alarm" }, S.ended + state.ended)] : [];
  for (const [signal, words] of state.alarms) blocks.push(make("div", { class: "alarm", "data-signal": signal }, words));
  for (const question of state.questions) blocks.push(asked(question));
  $("front").replaceChildren(...blocks);
}

function asked(question) {
  const answers = question.answers.map((answer) => {
    const onclick = () => say("answer", answer.value, question.number);
    const button = make("button", { onclick, disabled: !token, "data-value": answer.value }, answer.words);
    if (Object.keys(answer.placements).length) {
      const { box, items } = drawn(answer.placements);
      button.append(make("svg", { viewBox: box }, ...items));
    }
    return button;
  });
  if (question.kind === "text") answers.push(...written(question));
  const words = [make("div", {}, question.reason)];
  if (question.tried) words.push(make("p", {}, S.tried + question.tried));
  if (question.todo) words.push(make("p", {}, `${S.todo}${question.todo}.`));
  const number = { class: "question", "data-number": question.number, "data-kind": question.kind };
  return make("div", number, ...words, make("div", { class: "answers" }, ...answers));
}

// A field for an answer in words of one's own.
function written(question) {
  const field = make("input", { maxlength: 200, disabled: !token, "aria-label": question.reason });
  const send = () => field.value.trim() && say("answer", field.value.trim(), question.number);
  field.addEventListener("keydown", (event) => event.key === "Enter" && send());
  return [field, make("button", { onclick: send, disabled: !token }, S.send)];
}

function showBench({ hand }) {
  seen = hand;
  const held = hand.held ? `, ${title(hand.held)}` : "";
  $("action").textContent = hand.unknown || (hand.box ? `${S.hand}: ${hand.action}${held}` : S.noHand);
}

// What was found in the picture that is drawn, not in a newer one.
function showMarks(hand) {
  $("overlay").setAttribute("viewBox", `0 0 ${still.image_px.join(" ")}`);
  const line = { fill: "none", stroke: "#ffdc00", "stroke-width": 3 };
  const marks = [];
  if (hand.track.length > 1) marks.push(make("polyline", { ...line, points: hand.track.join(" "), opacity: 0.8 }));
  if (hand.box) {
    const [x, y, right, bottom] = hand.box;
    marks.push(make("rect", { ...line, x, y, width: right - x, height: bottom - y }));
  }
  $("overlay").replaceChildren(...marks);
  $("overlay").dataset.sequence = hand.sequence;
}

function showBracket({ bracket, questions }) {
  const named = (where) => new Set(questions.flatMap((one) => ((one.kind === "where") === where ? one.positions : [])));
  const [wrong, offered] = [named(false), named(true)];
  for (const one of bracket) one.wrong = wrong.has(one.position);
  const states = Object.fromEntries(bracket.map((one) => [one.position, one]));
  const { box, items } = drawn(Object.fromEntries(bracket.map((one) => [one.position, one.part])), states);
  $("bracket").setAttribute("viewBox", box);
  $("bracket").setAttribute("aria-label", S.bracket);
  $("bracket").replaceChildren(...items);
  const rows = bracket.map((one) => {
    const robot = one.who === "robot";
    const who = one.placed ? (robot ? S.placedByRobot : S.placedByPerson) : robot ? S.nextHere : S.remains;
    const open = offered.has(one.position);
    const next = one.wrong ? "wrong" : open || (!one.placed && robot) ? "next" : null;
    const words = one.wrong ? S.lookHere : open ? S.here : one.part ? `${title(one.part)}: ${who}` : one.any_part ? S.anyPart : S.notKnown;
    return make("li", { class: next }, make("b", {}, one.position), words);
  });
  $("holes").replaceChildren(...rows);
}

function showRobot({ robot, questions }) {
  planned = questions.find((one) => one.part)?.part ?? robot.next?.part ?? "";
  const rows = [[S.now, robot.now || S.nothing]];
  rows.push([S.next, robot.next ? `${title(robot.next.part)} ${robot.next.positions.join(" ")}` : S.nothing]);
  if (robot.why) rows.push([S.waits, robot.why]);
  if (robot.holding) rows.push(["", S.holds]);
  $("does").replaceChildren(...rows.flatMap(([name, words]) => [make("dt", {}, name), make("dd", {}, words)]));
}

function showGoal(state) {
  const goals = Object.keys(state.belief);
  const bars = goals.map((goal, number) => {
    const value = state.belief[goal];
    const name = make("span", {}, goal);
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
      [time, points[place + 1]?.[0] ?? end].map((at) => {
        const y = 96 - 92 * (belief[goal] ?? 0);
        return `${(1000 * (at - first)) / (end - first)},${y}`;
      }));
    const stroke = COLOURS[number % COLOURS.length];
    return make("polyline", { points: way.join(" "), fill: "none", stroke, "stroke-width": 2, "vector-effect": "non-scaling-stroke" });
  });
  $("history").setAttribute("viewBox", "0 0 1000 100");
  $("history").setAttribute("aria-label", S.goal);
  $("history").replaceChildren(...lines);
  if ($("choices").dataset.goals === goals.join()) return;
  $("choices").dataset.goals = goals.join();
  const buttons = goals.map((goal) => {
    const attributes = { onclick: () => say("goal", goal), disabled: !token, "data-goal": goal };
    return make("button", attributes, goal === "none of these" ? S.newGoal : goal);
  });
  $("choices").replaceChildren(make("span", {}, S.sayGoal), ...buttons);
}

function showTree({ statuses }) {
  const only = $("leaf").checked;
  const shown = still.nodes.filter((node) => !only || statuses[node.uid]?.[0] === "RUNNING");
  const rows = shown.map((node) => {
    const [status, words] = statuses[node.uid] ?? ["", ""];
    const name = node.name === node.kind ? node.kind : `${node.kind} ${node.name}`;
    const item = make("li", { class: status }, name, make("em", {}, words ? `  ${words}` : ""));
    item.style.paddingLeft = `${0.4 + 0.3 * node.depth}rem`;
    return item;
  });
  $("nodes").replaceChildren(...rows);
}

function showRest(state) {
  const { run } = still;
  $("heading").textContent = [run.product, run.tree, run.unsafe && `${S.unsafe}: ${run.unsafe}`].filter(Boolean).join(", ");
  $("heading").classList.toggle("unsafe", Boolean(run.unsafe));
  const pause = { now: S.paused, "after part": S.pausing }[state.operator.pause];
  $("clock").textContent = `${state.time_s.toFixed(1)} s${pause ? `, ${pause}` : ""}`;
  const number = state.brackets.at(-1)?.number;
  const wanted = state.operator.brackets;
  $("count").textContent = number ? `${S.bracketNumber} ${number}${wanted ? ` ${S.of} ${wanted}` : ""}` : "";
  $("pauseNow").classList.toggle("on", state.operator.pause === "now");
  $("pausePart").classList.toggle("on", state.operator.pause === "after part");
  const lines = [...state.lines].reverse().map(([time, level, words]) =>
    make("li", { class: level }, make("time", {}, `${time.toFixed(1)} s`), words));
  $("lines").replaceChildren(...lines);
}

function show(state) {
  if (!still || state.tick === undefined) return;
  for (const part of [showFront, showBench, showBracket, showRobot, showGoal, showTree, showRest]) part(state);
  document.body.dataset.tick = state.tick;
}

function follow() {
  const events = new EventSource("events");
  events.addEventListener("still", (event) => {
    still = JSON.parse(event.data);
    points = still.history;
    if ($("said").textContent === S.lost) $("said").textContent = "";
  });
  events.addEventListener("state", (event) => {
    const state = JSON.parse(event.data);
    show(state);
    if (state.ended) events.close();
  });
  events.addEventListener("error", () => {
    $("said").textContent = S.lost;
  });
}

// Drawn when it is there, so that the picture never goes black in between.
async function watchCamera() {
  const camera = $("camera");
  camera.setAttribute("aria-label", S.bench);
  try {
    const hand = seen;
    const answer = await fetch(hand ? `camera.jpg?sequence=${hand.sequence}` : "camera.jpg");
    if (answer.status === 200) {
      const image = await createImageBitmap(await answer.blob());
      [camera.width, camera.height] = [image.width, image.height];
      camera.getContext("2d").drawImage(image, 0, 0);
      if (hand) showMarks(hand);
    }
    setTimeout(watchCamera, 80);
  } catch {
    setTimeout(watchCamera, 1000);
  }
}

begin();
follow();
watchCamera();
