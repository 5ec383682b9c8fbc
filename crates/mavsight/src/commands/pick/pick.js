// Clicks on control points: the server finds the ball about each click and calibrates anew.
"use strict";

const LOUPE = 8; // times enlarged
const ENLARGED = 30; // residuals
const $ = (id) => document.getElementById(id);
const still = $("still"), loupe = $("loupe");
let state = null, chosen = 0, camera = 0;
const pictures = [];

async function ask(path) {
  const answer = await fetch(path, { headers: { "x-mavsight": "page" } });
  if (!answer.ok) throw new Error(await answer.text());
  return answer;
}

/** Takes over what the server says, and shows it. */
async function update(path) {
  try {
    state = await (await ask(path)).json();
    $("said").textContent = state.said;
  } catch (error) {
    $("said").textContent = String(error.message || error);
  }
  show();
}

const picked = (point) => state.picked.find((p) => p.camera === camera && p.point === point);

function show() {
  if (!state) return;
  drawStill();
  const ball = picked(chosen);
  if (ball) magnify([ball.u_px + 0.5, ball.v_px + 0.5]);
  $("points").replaceChildren(...state.points.map(row));
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
  swatch.style.background = ball ? ball.color : point.color;
  const color = document.createElement("td");
  color.append(swatch, ball ? ball.color : `(${point.color})`);
  const residual = !ball ? "–" : ball.residual_px === null ? "found" : `${ball.residual_px.toFixed(2)} px`;
  const cells = [point.name, color, ball && ball.wrong ? `✕ ${residual}` : residual, ""].map((content) => {
    if (content instanceof HTMLElement) return content;
    const cell = document.createElement("td");
    cell.textContent = content;
    return cell;
  });
  if (ball) {
    const back = document.createElement("button");
    back.textContent = "take back";
    back.onclick = (event) => { event.stopPropagation(); update(`do/forget?camera=${camera}&point=${k}`); };
    cells[3].append(back);
  }
  line.append(...cells);
  line.onclick = () => { chosen = k; show(); };
  line.onkeydown = (event) => { if (event.key === "Enter") { chosen = k; show(); } };
  return line;
}

/** A stroke that shows on anything: white on black. */
function stroke(pen, width) {
  for (const [color, wide] of [["#000", 2.4 * width], ["#fff", width]]) {
    pen.strokeStyle = color;
    pen.lineWidth = wide;
    pen.stroke();
  }
}

function drawStill() {
  const picture = pictures[camera], pen = still.getContext("2d");
  if (!picture || !picture.width) return;
  still.width = picture.width;
  still.height = picture.height;
  pen.drawImage(picture, 0, 0);
  const unit = picture.width / 640;
  for (const ball of state.picked.filter((p) => p.camera === camera)) {
    // The centre of the first pixel is 0, half a pixel from the corner.
    const x = ball.u_px + 0.5, y = ball.v_px + 0.5, r = 0.5 * ball.diameter_px + 2 * unit;
    pen.beginPath();
    pen.arc(x, y, r, 0, 2 * Math.PI);
    if (ball.wrong) {
      for (const side of [-1, 1]) { pen.moveTo(x - 1.5 * r, y - side * 1.5 * r); pen.lineTo(x + 1.5 * r, y + side * 1.5 * r); }
    }
    stroke(pen, 1.2 * unit);
    if (ball.residual_uv_px) {
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x + ENLARGED * ball.residual_uv_px[0], y + ENLARGED * ball.residual_uv_px[1]);
      stroke(pen, unit);
    }
    pen.font = `bold ${12 * unit}px sans-serif`;
    pen.lineWidth = 3 * unit;
    pen.strokeStyle = "#000";
    pen.fillStyle = "#fff";
    const text = state.points[ball.point].name + (ball.wrong ? " ✕ wrong" : "");
    const left = x + r + 3 * unit + pen.measureText(text).width > picture.width;
    pen.textAlign = left ? "right" : "left";
    const at = left ? x - r - 3 * unit : x + r + 3 * unit;
    pen.strokeText(text, at, y + 4 * unit);
    pen.fillText(text, at, y + 4 * unit);
  }
}

function place(event) {
  const box = still.getBoundingClientRect();
  return [(event.clientX - box.left) * still.width / box.width, (event.clientY - box.top) * still.height / box.height];
}

function magnify([x, y]) {
  const pen = loupe.getContext("2d"), side = loupe.width / LOUPE, middle = loupe.width / 2;
  pen.imageSmoothingEnabled = false;
  pen.fillStyle = "#777";
  pen.fillRect(0, 0, loupe.width, loupe.height);
  pen.drawImage(still, x - side / 2, y - side / 2, side, side, 0, 0, loupe.width, loupe.height);
  pen.beginPath();
  pen.moveTo(middle, 0); pen.lineTo(middle, middle - 10); pen.moveTo(middle, middle + 10); pen.lineTo(middle, loupe.width);
  pen.moveTo(0, middle); pen.lineTo(middle - 10, middle); pen.moveTo(middle + 10, middle); pen.lineTo(loupe.width, middle);
  stroke(pen, 1);
}

still.onpointermove = (event) => magnify(place(event));
still.onclick = async (event) => {
  const [x, y] = place(event), before = state.picked.length;
  await update(`do/pick?camera=${camera}&point=${chosen}&u_px=${x - 0.5}&v_px=${y - 0.5}`);
  if (state.picked.length > before) {
    const next = state.points.findIndex((_, k) => !picked(k));
    if (next >= 0) chosen = next;
    show();
  }
};
$("camera").onchange = () => {
  camera = Number($("camera").value);
  chosen = Math.max(0, state.points.findIndex((_, k) => !picked(k)));
  show();
};
$("save").onclick = () => update("do/save");

(async () => {
  await update("state");
  if (!state) return;
  $("camera").replaceChildren(...state.cameras.map(({ name }, k) => new Option(name, String(k))));
  for (let k = 0; k < state.cameras.length; k += 1) {
    const picture = new Image();
    picture.onload = show;
    picture.src = await (await ask(`still?camera=${k}`)).text();
    pictures[k] = picture;
  }
})();
