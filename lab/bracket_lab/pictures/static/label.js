// Labels of one picture at a time: items are holes, hands and parts; the chosen one gets what a key says.
const $ = id => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";
const token = location.hash.slice(1);
const HELP = {
  overhead: "Tab: next label. 0: empty, or nothing held. 1-9: type. c: covered. a: astray. "
    + "Drag: a hand. x: remove. n: no hand. p: no plate. Enter: save.",
  wrist: "Tab: next label. 1-9: type. a: lies or stands. Drag: a part. x: remove. Enter: save.",
};
let folder, number = 0, labels, places, items = [], chosen = 0, size = [1, 1], drawn = null, type = 0;

const say = text => { $("said").textContent = text; };
const told = item => item.kind === "hole"
  ? `${item.of.position}: ${item.of.covered > .5 ? "covered" : item.of.part ?? "empty"}${item.of.upright === false ? ", astray" : ""}`
  : item.kind === "hand" ? `hand${item.of.known === false ? "" : ", holds " + (item.of.held_part ?? "nothing")}`
  : `${item.of.part}${item.of.posture ? ", " + item.of.posture : ""}`;

function arrange() {
  items = [
    ...(labels.holes ?? []).map(of => ({ kind: "hole", of })),
    ...(labels.hands ?? []).map(of => ({ kind: "hand", of })),
    ...(labels.parts ?? []).map(of => ({ kind: "part", of })),
  ];
  chosen = Math.max(0, Math.min(chosen, items.length - 1));
}

function element(name, values, parent) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(values)) made.setAttribute(key, value);
  parent.append(made);
  return made;
}

function show() {
  arrange();
  $("marks").setAttribute("viewBox", `0 0 ${size[0]} ${size[1]}`);
  $("marks").replaceChildren();
  $("list").replaceChildren();
  items.forEach((item, index) => {
    const group = element("g", { class: `${item.kind}${index === chosen ? " chosen" : ""}` }, $("marks"));
    const [x, y] = item.kind === "hole" ? places[item.of.position] : (item.of.box_px ?? item.of.whole_box_px);
    if (item.kind === "hole") element("circle", { cx: x, cy: y, r: 8 }, group);
    else {
      const box = item.of.box_px ?? item.of.whole_box_px;
      element("rect", { x, y, width: box[2] - x, height: box[3] - y }, group);
    }
    const below = item.kind === "hole" ? [24, 36, -14][index % 3] : -3;  // neighbours beside each other
    element("text", { x: item.kind === "hole" ? x - 12 : x + 2, y: y + below }, group).textContent = told(item);
    const line = document.createElement("li");
    line.textContent = told(item);
    line.className = index === chosen ? "chosen" : "";
    line.addEventListener("click", () => { chosen = index; show(); });
    $("list").append(line);
  });
  if (drawn) element("rect", { x: Math.min(drawn[0], drawn[2]), y: Math.min(drawn[1], drawn[3]),
    width: Math.abs(drawn[2] - drawn[0]), height: Math.abs(drawn[3] - drawn[1]) }, $("marks"));
  $("where").textContent = `${number + 1} of ${folder.files.length}: ${folder.files[number]}`;
  document.body.classList.toggle("done", folder.done[number]);
  document.body.dataset.picture = number;
  document.body.dataset.labels = JSON.stringify(labels);
}

function name(index) {  // 0: nothing; 1 and more: types
  const item = items[chosen];
  if (index > folder.types.length || !item) return;
  const part = index ? folder.types[index - 1] : null;
  if (item.kind === "part" && part) { item.of.part = part; type = index - 1; }
  if (item.kind === "hole") { item.of.part = part; item.of.covered = 0; if (!part) item.of.upright = true; }
  if (item.kind === "hand") { item.of.held_part = part; item.of.known = true; }
  if (item.kind === "hole") chosen = Math.min(chosen + 1, items.length - 1);
  show();
}

const ACTS = {
  c: item => { if (item?.kind === "hole") item.of.covered = item.of.covered > .5 ? 0 : 1; },
  a: item => {
    if (item?.kind === "hole" && item.of.part) item.of.upright = item.of.upright === false;
    if (item?.kind === "part") item.of.posture = item.of.posture === "upright" ? "lying" : "upright";
  },
  x: item => {
    for (const list of [labels.hands, labels.parts]) if (item && list?.includes(item.of)) list.splice(list.indexOf(item.of), 1);
  },
  n: () => { if (folder.camera === "overhead") labels.hands = []; },
  p: () => { if (folder.camera === "overhead") labels.holes = []; },
};

async function open(wanted) {
  number = Math.max(0, Math.min(wanted, folder.files.length - 1));
  say("looking ...");
  const read = await (await fetch(`pictures/${number}`)).json();
  ({ labels, holes_px: places } = read);
  $("image").src = `images/${number}`;
  await $("image").decode();
  size = [$("image").naturalWidth, $("image").naturalHeight];
  const by = Object.entries(read.by).map(([what, kind]) => `${what} by ${kind}`).join(", ");
  say(folder.done[number] ? "labelled" : `suggested: ${by}`);
  chosen = 0;
  show();
}

async function save() {
  const answer = await fetch(`pictures/${number}`, { method: "PUT", body: JSON.stringify(labels),
    headers: { "Content-Type": "application/json", "X-Cell-Token": token } });
  if (!answer.ok) { say(await answer.text()); return; }
  folder.done[number] = true;
  if (folder.done.every(Boolean) && number === folder.files.length - 1) { say("all are labelled"); show(); return; }
  await open(number + 1);
}

const at = event => {
  const frame = $("marks").getBoundingClientRect();
  return [(event.clientX - frame.left) * size[0] / frame.width, (event.clientY - frame.top) * size[1] / frame.height]
    .map((value, axis) => Math.max(0, Math.min(size[axis], value)));
};
$("marks").addEventListener("pointerdown", event => {
  $("marks").setPointerCapture(event.pointerId);
  drawn = [...at(event), ...at(event)];
});
$("marks").addEventListener("pointermove", event => {
  if (drawn) { drawn = [...drawn.slice(0, 2), ...at(event)]; show(); }
});
$("marks").addEventListener("pointerup", () => {
  const [a, b, c, d] = drawn ?? [0, 0, 0, 0];
  drawn = null;
  const box = [Math.min(a, c), Math.min(b, d), Math.max(a, c), Math.max(b, d)];
  if (box[2] - box[0] < 4 || box[3] - box[1] < 4) {  // a click: the nearest label
    const away = item => {
      const [x, y, right = x, bottom = y] = item.kind === "hole" ? places[item.of.position] : (item.of.box_px ?? item.of.whole_box_px);
      return Math.hypot((x + right) / 2 - a, (y + bottom) / 2 - b);
    };
    if (items.length) chosen = items.map(away).reduce((best, value, index, all) => value < all[best] ? index : best, 0);
  } else {
    const hand = folder.camera === "overhead";
    const list = hand ? (labels.hands ??= []) : (labels.parts ??= []);
    list.push(hand ? { box_px: box, known: false } : { part: folder.types[type], whole_box_px: box });
    arrange();
    chosen = items.findIndex(item => item.of === list.at(-1));
  }
  show();
});
document.addEventListener("keydown", event => {
  if (event.ctrlKey || event.metaKey || event.altKey || !labels) return;
  const key = event.key === "Delete" ? "x" : event.key;
  if (key === "Tab") chosen = (chosen + (event.shiftKey ? items.length - 1 : 1)) % Math.max(1, items.length);
  else if (key === "Enter") { event.preventDefault(); save(); return; }
  else if (key === "ArrowLeft") { open(number - 1); return; }
  else if (key === "ArrowRight") { open(number + 1); return; }
  else if (/^[0-9]$/.test(key)) { name(Number(key)); return; }
  else if (key in ACTS) ACTS[key](items[chosen]);
  else return;
  event.preventDefault();
  show();
});
$("back").addEventListener("click", () => open(number - 1));
$("next").addEventListener("click", () => open(number + 1));
$("save").addEventListener("click", save);

folder = await (await fetch("folder")).json();
$("help").textContent = HELP[folder.camera];
[...(folder.camera === "overhead" ? ["empty"] : []), ...folder.types].forEach((text, index) => {
  const made = document.createElement("button"), key = index + (folder.camera === "overhead" ? 0 : 1);
  made.textContent = `${key} ${text}`;
  made.addEventListener("click", () => name(key));
  $("types").append(made);
});
await open(Math.max(0, folder.done.indexOf(false)));
