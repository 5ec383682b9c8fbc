// Clicks on control points and markers: the server finds the ball about each click, calibrates anew, or measures its colour.
"use strict";

const LOUPE = 8; // times enlarged
const ENLARGED = 30; // residuals
const MOST_WIDTH = 8192; // of a drawing, pixels
const HINT = {
  control: `Choose a point, click on its ball. A ring is what was found, a line its residual, ${ENLARGED} times enlarged. Brackets: the colour of the table.`,
  markers: "Choose a frame and a marker, click on its ball. A ring is a click, a square what the detection finds in this frame by the colours of the list. Brackets: the colour of the vehicle file. Save writes them there.",
};
const $ = (id) => document.getElementById(id);
const still = $("still"), loupe = $("loupe");
let state = null, of = "control", chosen = 0, camera = 0, frame = 0, wanted = 0, zoom = 1;
const pictures = new Map();

const isFlight = () => of === "markers";
const place = () => `of=${of}&camera=${camera}&frame=${frame}`;

async function ask(path) {
  const answer = await fetch(path, { headers: { "x-mavsight": "page" } });
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

/** Takes over what the server says, and shows it. */
async function update(path) {
  try {
    const asked = place();
    state = await ask(`${path}${path.includes("?") ? "&" : "?"}${asked}`);
    $("said").textContent = state.said;
  } catch (error) {
    $("said").textContent = String(error.message || error);
  }
  show();
}

const isShown = (ball) => ball.camera === camera && (!isFlight() || ball.frame === frame);
const picked = (point) => state.picked.find((p) => isShown(p) && p.point === point);
const unpicked = () => Math.max(0, state.points.findIndex((_, k) => !picked(k)));

function show() {
  if (!state) return;
  drawStill();
  const ball = picked(chosen), picture = pictures.get(place());
  if (picture) magnify(ball ? [ball.u_px + 0.5, ball.v_px + 0.5] : [picture.width / 2, picture.height / 2]);
  $("points").replaceChildren(...state.points.map(row));
  $("hint").textContent = HINT[of];
  $("measure").textContent = isFlight() ? "Found" : "Residual";
  $("verdict").textContent = state.cameras[camera] ? state.cameras[camera].verdict : "";
  $("wrong").replaceChildren(...state.wrong.map((text) => {
    const item = document.createElement("li");
    item.textContent = "✕ " + text;
    return item;
  }));
}

function row(point, k) {
  const line = document.createElement("tr"), ball = picked(k);
  line.setAttribute("aria-selected", String(k === chosen));
  line.tabIndex = 0;
  line.className = ball && ball.wrong ? "wrong" : "";
  const swatch = document.createElement("span");
  swatch.className = "swatch";
  const isMeasured = isFlight() ? state.picked.some((p) => p.point === k) : ball;
  const own = ball && !isFlight() ? ball.color : point.color;
  swatch.style.background = own;
  const color = document.createElement("td");
  color.append(swatch, isMeasured ? own : `(${own})`);
  const cells = [point.name, color, isFlight() ? found(k, ball) : residual(ball), ""].map((content) => {
    if (content instanceof HTMLElement) return content;
    const cell = document.createElement("td");
    cell.textContent = content;
    return cell;
  });
  if (ball) {
    const back = document.createElement("button");
    back.textContent = "take back";
    back.onclick = (event) => { event.stopPropagation(); update(`do/forget?point=${k}`); };
    cells[3].append(back);
  }
  line.append(...cells);
  line.onclick = () => { chosen = k; show(); };
  line.onkeydown = (event) => { if (event.key === "Enter") { chosen = k; show(); } };
  return line;
}

function residual(ball) {
  if (!ball) return "–";
  const words = ball.residual_px === null ? "found" : `${ball.residual_px.toFixed(2)} px`;
  return ball.wrong ? `✕ ${words}` : words;
}

/** What the detection finds of a marker: the ball that was clicked, and others of its colour. */
function found(point, ball) {
  const count = state.found.filter((f) => state.points[f.point].color === state.points[point].color).length;
  if (!ball) return count === 0 ? "–" : count === 1 ? "1 ball" : `${count} balls`;
  if (ball.wrong) return "✕ not found";
  return count > 1 ? `✓ and ${count - 1} more` : "✓";
}

/** A stroke that shows on anything: white on black. */
function stroke(pen, width) {
  for (const [color, wide] of [["#000", 2.4 * width], ["#fff", width]]) {
    pen.strokeStyle = color;
    pen.lineWidth = wide;
    pen.stroke();
  }
}

/** Image pixels of one pixel of the page. */
const unitOf = (picture) => picture.width / (still.getBoundingClientRect().width || picture.width);

function drawStill() {
  const picture = pictures.get(place()), pen = still.getContext("2d");
  if (!picture || !picture.width) return;
  still.style.width = `${100 * zoom}%`;
  const unit = unitOf(picture), fine = Math.min(Math.max(1, 2 / unit), MOST_WIDTH / picture.width);
  still.width = Math.round(fine * picture.width);
  still.height = Math.round(fine * picture.height);
  pen.setTransform(still.width / picture.width, 0, 0, still.height / picture.height, 0, 0);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(picture, 0, 0);
  for (const ball of state.found) {
    const half = 0.5 * ball.diameter_px + 4 * unit;
    pen.beginPath();
    pen.rect(ball.u_px + 0.5 - half, ball.v_px + 0.5 - half, 2 * half, 2 * half);
    stroke(pen, unit);
    if (!picked(ball.point)) write(pen, state.points[ball.point].name, ball.u_px + 0.5, ball.v_px + 0.5, half, unit);
  }
  for (const ball of state.picked.filter(isShown)) {
    // The centre of the first pixel is 0, half a pixel from the corner.
    const x = ball.u_px + 0.5, y = ball.v_px + 0.5, r = 0.5 * ball.diameter_px + unit;
    pen.beginPath();
    pen.arc(x, y, r, 0, 2 * Math.PI);
    if (ball.wrong) {
      for (const side of [-1, 1]) { pen.moveTo(x - 1.5 * r, y - side * 1.5 * r); pen.lineTo(x + 1.5 * r, y + side * 1.5 * r); }
    }
    stroke(pen, 1.5 * unit);
    if (ball.residual_uv_px) {
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x + ENLARGED * ball.residual_uv_px[0], y + ENLARGED * ball.residual_uv_px[1]);
      stroke(pen, unit);
    }
    write(pen, state.points[ball.point].name + (ball.wrong ? " ✕ wrong" : ""), x, y, isFlight() ? r + 3 * unit : r, unit);
  }
}

/** A name beside a ball, on the side where there is room. */
function write(pen, text, x, y, r, unit) {
  pen.font = `bold ${14 * unit}px sans-serif`;
  pen.lineWidth = 3 * unit;
  pen.strokeStyle = "#000";
  pen.fillStyle = "#fff";
  const left = x + r + 3 * unit + pen.measureText(text).width > pictures.get(place()).width;
  pen.textAlign = left ? "right" : "left";
  const at = left ? x - r - 3 * unit : x + r + 3 * unit;
  pen.strokeText(text, at, y + 5 * unit);
  pen.fillText(text, at, y + 5 * unit);
}

/** Where in the picture the pointer is. */
function pixel(event) {
  const box = still.getBoundingClientRect(), picture = pictures.get(place());
  return [(event.clientX - box.left) * picture.width / box.width, (event.clientY - box.top) * picture.height / box.height];
}

function magnify([x, y]) {
  const pen = loupe.getContext("2d"), side = loupe.width / LOUPE, middle = loupe.width / 2;
  pen.imageSmoothingEnabled = false;
  pen.fillStyle = "#777";
  pen.fillRect(0, 0, loupe.width, loupe.height);
  pen.drawImage(pictures.get(place()), x - side / 2, y - side / 2, side, side, 0, 0, loupe.width, loupe.height);
  pen.beginPath();
  pen.moveTo(middle, 0); pen.lineTo(middle, middle - 10); pen.moveTo(middle, middle + 10); pen.lineTo(middle, loupe.width);
  pen.moveTo(0, middle); pen.lineTo(middle - 10, middle); pen.moveTo(middle + 10, middle); pen.lineTo(loupe.width, middle);
  stroke(pen, 1);
}

/** Enlarges the picture about a place of it: the balls of the frame, or its middle. */
function enlarge() {
  const picture = pictures.get(place()), balls = state.picked.filter(isShown).concat(state.found), view = $("picture");
  zoom = Number($("zoom").value);
  if (!picture) return;
  drawStill();
  const mean = (key, side) => (balls.length ? balls.reduce((sum, b) => sum + b[key], 0) / balls.length : side / 2);
  const [x, y] = [mean("u_px", picture.width), mean("v_px", picture.height)], unit = unitOf(picture);
  view.scrollTo(x / unit - view.clientWidth / 2, y / unit - view.clientHeight / 2);
}

still.onpointermove = (event) => { if (pictures.has(place())) magnify(pixel(event)); };
still.onclick = async (event) => {
  if (!state || !pictures.has(place())) return;
  const [x, y] = pixel(event), before = state.picked.length;
  await update(`do/pick?point=${chosen}&u_px=${x - 0.5}&v_px=${y - 0.5}`);
  if (state.picked.length > before) {
    const next = state.points.findIndex((_, k) => !picked(k));
    if (next >= 0) chosen = next;
    show();
  }
};

/** Loads the picture of a place; the server reads a film on by about a second with each request. */
async function load() {
  const at = place();
  while (!pictures.has(at) && at === place()) {
    const answer = await ask(`picture?${at}`);
    if (answer.refused) throw new Error(answer.refused);
    if (answer.address) {
      const picture = new Image();
      picture.src = answer.address;
      await picture.decode();
      picture.time = answer.t_s;
      pictures.set(at, picture);
    } else if (at === place()) {
      $("said").textContent = `The film is read: ${answer.t_s === null ? "" : `${answer.t_s.toFixed(1)} s so far`}`;
    }
  }
}

/** Shows another picture. */
async function go() {
  wanted += 1;
  const own = wanted;
  $("film").hidden = !isFlight();
  try {
    await load();
  } catch (error) {
    $("said").textContent = String(error.message || error);
    return;
  }
  if (own !== wanted) return;
  await update("state");
  const count = state.cameras[camera] ? state.cameras[camera].frames : 0, time = (pictures.get(place()) || {}).time;
  $("frame").max = String(Math.max(0, count - 1));
  // A film that is shorter than it announces.
  if (isFlight() && frame > Math.max(0, count - 1)) { goTo(count - 1); return; }
  $("frame").value = String(frame);
  $("back").disabled = frame <= 0;
  $("on").disabled = frame >= count - 1;
  $("time").textContent = isFlight() ? `${frame + 1} of ${count}${time === null || time === undefined ? "" : `, ${time.toFixed(2)} s`}` : "";
  chosen = unpicked();
  show();
}

function goTo(next) {
  frame = Math.min(Math.max(0, next), Number($("frame").max));
  go();
}

/** What is named: control points or markers. */
async function choose(what) {
  of = what;
  camera = 0;
  frame = 0;
  await update("state");
  if (!state) return;
  $("of").value = of;
  $("camera").replaceChildren(...state.cameras.map(({ name }, k) => new Option(name, String(k))));
  if (state.cameras.length > 0) await go(); else $("film").hidden = true;
}

$("of").onchange = () => choose($("of").value);
$("camera").onchange = () => { camera = Number($("camera").value); go(); };
$("frame").onchange = () => goTo(Number($("frame").value));
$("back").onclick = () => goTo(frame - 1);
$("on").onclick = () => goTo(frame + 1);
$("zoom").onchange = enlarge;
window.onresize = () => { if (state) drawStill(); };
$("save").onclick = () => update("do/save");

(async () => {
  await choose(location.hash === "#markers" ? "markers" : "control");
  if (state && state.cameras.length === 0 && !isFlight()) {
    $("of").options[0].disabled = true;
    await choose("markers");
  }
})();
