// ---- A board at a port of this computer: connect, flash, check, record, upload, gap.

// USB chips behind which a board may be.
let chips = [];

// How often an unfinished recording is put where a closed tab does not lose it (ms).
const KEPT_EVERY = 1000;

// The port. The worker asks for it and hears what comes.
const port = {
  device: null,
  reader: null,
  writer: null,
  isWanted: false,
  reading: Promise.resolve(),
  last: Promise.resolve(),

  does(what) {
    this.last = this.last.then(() => this.obeys(what));
  },

  async obeys({ open, write, close }) {
    if (open) worker?.postMessage({ port: { open: await this.opens(open).then(() => "", (error) => error.message || String(error)) } });
    // What cannot be written shows at the next read.
    if (write) await this.writer?.write(write).catch(() => {});
    if (close) await this.closes();
  },

  async opens({ baud, reset }) {
    await this.closes();
    if (!this.device) throw new Error("no board is connected; press Connect");
    await this.device.open({ baudRate: baud, bufferSize: 2 ** 16 });
    if (reset) {
      for (const level of [false, true]) {
        await this.device.setSignals({ dataTerminalReady: level, requestToSend: level }).catch(() => {});
        await new Promise((resolve) => { setTimeout(resolve, 50); });
      }
    }
    this.isWanted = true;
    this.writer = this.device.writable.getWriter();
    this.reading = this.reads();
  },

  // A line that is disturbed ends a stream and begins another; a cable that is pulled ends the last.
  async reads() {
    let why = "the port was closed";
    while (this.isWanted && this.device.readable) {
      this.reader = this.device.readable.getReader();
      try {
        for (;;) {
          const { value, done } = await this.reader.read();
          if (done) break;
          worker?.postMessage({ port: { bytes: value } });
        }
      } catch (error) {
        why = error.message;
      } finally {
        this.reader.releaseLock();
      }
    }
    if (this.isWanted) worker?.postMessage({ port: { lost: why } });
  },

  async closes() {
    if (!this.isWanted) return;
    this.isWanted = false;
    await this.reader?.cancel().catch(() => {});
    await this.reading;
    this.writer?.releaseLock();
    await this.device.close().catch(() => {});
  },
};

// What was made with a board, and is kept as what was entered is.
const rig = { uploads: 0, runs: [], clock: null };

// What is written at the moment: the pieces of a file each.
const writing = new Map();
let keptAt = 0;

function takeKept({ path, bytes, append, forget }) {
  if (forget) return void writing.delete(path);
  if (append) writing.get(path)?.push(bytes); else writing.set(path, [bytes]);
  if (performance.now() > keptAt + KEPT_EVERY) {
    keptAt = performance.now();
    keepWritten();
  }
}

async function keepWritten() {
  for (const [path, pieces] of writing) files.set(path, await new Blob(pieces).arrayBuffer());
  await keep();
}

// ---- The live picture.

const live = { rows: [], drawn: false };
const lines = [
  { panel: 0, key: "angle_deg", label: "angle", colour: "--ink" },
  { panel: 0, key: "predicted_deg", label: "predicted by the board", colour: "--accent" },
  { panel: 0, key: "setpoint_deg", label: "asked for", colour: "--soft", dash: [5, 4] },
  { panel: 1, key: "pressure_kpa", label: "pressure", colour: "--ink" },
];

function drawLive() {
  live.drawn = false;
  const canvas = $("live");
  const { width, height } = canvas.getBoundingClientRect();
  if (width === 0) return;
  const scale = window.devicePixelRatio || 1;
  canvas.width = width * scale;
  canvas.height = height * scale;
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  pen.font = getComputedStyle(canvas).font;
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(name).trim();
  const { rows } = live;
  const end = Math.max(10, rows.at(-1)?.time_s ?? 0);
  const panels = [{ top: 24, bottom: 0.62 * height, unit: "°" }, { top: 0.62 * height + 30, bottom: height - 22, unit: "kPa" }];
  panels.forEach(({ top, bottom, unit }, panel) => {
    const all = lines.filter((line) => line.panel === panel);
    const values = rows.flatMap((row) => all.map(({ key }) => row[key])).filter((it) => it !== null);
    const low = values.reduce((a, b) => Math.min(a, b), 0);
    const high = values.reduce((a, b) => Math.max(a, b), panel === 0 ? 10 : 5);
    const x = (time) => 44 + (width - 52) * time / end;
    const y = (value) => bottom - (bottom - top) * (value - low) / (high - low);
    pen.strokeStyle = colour("--line");
    pen.lineWidth = 1;
    pen.fillStyle = colour("--soft");
    pen.textAlign = "right";
    for (const value of [low, high]) {
      pen.beginPath();
      pen.moveTo(44, y(value));
      pen.lineTo(width - 8, y(value));
      pen.stroke();
      pen.fillText(`${Math.round(value)} ${unit}`, 40, y(value) + 4);
    }
    pen.textAlign = "left";
    let at = 44;
    for (const { key, label, colour: name, dash } of all) {
      if (!rows.some((row) => row[key] !== null)) continue;
      pen.strokeStyle = pen.fillStyle = colour(name);
      pen.fillText(label, at, top - 8);
      at += pen.measureText(label).width + 16;
      pen.setLineDash(dash ?? []);
      pen.lineWidth = 1.5;
      pen.beginPath();
      let isDown = false;
      for (const row of rows) {
        if (row[key] === null) { isDown = false; continue; }
        if (isDown) pen.lineTo(x(row.time_s), y(row[key])); else pen.moveTo(x(row.time_s), y(row[key]));
        isDown = true;
      }
      pen.stroke();
      pen.setLineDash([]);
    }
  });
  pen.fillStyle = colour("--soft");
  pen.textAlign = "right";
  pen.fillText(`${Math.round(end)} s`, width - 8, height - 4);
}

function showsRig(said) {
  if (said.stage) {
    $("rig-stage").textContent = said.stage;
    if (said.purpose) $("rig-purpose").textContent = said.moves ? `${said.purpose} Moves: ${said.moves}.` : said.purpose;
    if (typeof said.share === "number") $("rig-bar").value = said.share; else $("rig-bar").removeAttribute("value");
  }
  if (said.ask) $("rig-stage").textContent = said.ask;
  if (said.ask) $("rig-ready").hidden = false;
  if (said.now) $("rig-now").textContent = said.now;
  if (said.note) $("rig-findings").append(made("li", { textContent: said.note }));
  if (said.remark) $("rig-findings").append(made("li", { className: "remark", textContent: said.remark }));
  if (said.finding) $("rig-findings").append(finding(said.finding));
  if (said.time_s !== undefined) {
    $("live").hidden = false;
    live.rows.push(said);
    const [angle, pressure] = [said.angle_deg, said.pressure_kpa].map((it) => it?.toFixed(2) ?? "–");
    $("rig-now").textContent = `${said.time_s.toFixed(1)} s   ${said.state}   ${angle}°   ${pressure} kPa`;
    if (!live.drawn) {
      live.drawn = true;
      requestAnimationFrame(drawLive);
    }
  }
}

const outcomes = { passed: "passed", failed: "FAILED", skipped: "not made" };

function finding({ title, outcome, sentence, advice, measured }) {
  const values = measured.filter(({ value, unit }) => value !== null && unit !== "")
    .map(({ name, value, unit, passed }) => `${passed ? "" : "! "}${name} ${Number(value.toPrecision(3))} ${unit}`);
  return made("li", { className: outcome }, made("b", { textContent: `${title}: ${outcomes[outcome]}. ` }), sentence,
    ...(advice ? [made("p", { textContent: `What to do: ${advice}` })] : []),
    ...(values.length ? [made("p", { className: "small", textContent: values.join("; ") })] : []));
}

// ---- What is done with it.

let isRunning = false;

// A session with the board, with a stop that is always in view and on the space bar.
function session(what, work) {
  return attempt(what, async () => {
    if (!port.device) throw new Fault({ text: "No board is connected: plug it in, and press Connect." });
    isRunning = true;
    live.rows = [];
    writing.clear();
    $("rig-findings").replaceChildren();
    $("rig-table").textContent = "";
    $("rig-done").textContent = $("rig-now").textContent = $("rig-purpose").textContent = "";
    $("live").hidden = true;
    $("rig-progress").hidden = $("rig-stop").hidden = false;
    $("rig-stop").disabled = false;
    $("rig-stage").textContent = what;
    $("rig-bar").removeAttribute("value");
    $("rig-progress").scrollIntoView({ block: "nearest" });
    try {
      const { sentence } = await work();
      $("rig-done").textContent = sentence;
    } finally {
      isRunning = false;
      $("rig-stop").hidden = $("rig-ready").hidden = true;
      $("rig-bar").value = 1;
      if (writing.size) {
        await keepWritten();
        for (const path of [...writing.keys()]) await ask({ ask: "put", name: path }, files.get(path));
        // What is held out changes nothing in the verdict.
        if (rig.uploads === 0) changed();
        await read();
      }
      shown();
    }
  });
}

function stopRig() {
  $("rig-stop").disabled = true;
  $("rig-stage").textContent = "stopping the pump";
  worker?.postMessage({ stop: true });
}

async function connect() {
  port.device = await navigator.serial.requestPort({ filters: $("any-port").checked ? [] : chips }).catch((error) => {
    if (error.name === "NotFoundError") return null;
    throw error;
  });
  shown();
  if (!port.device) throw new Fault({ text: "No port was chosen. If the board is not in the list, look at its cable (some only charge), or tick “Show every port”." });
}

async function image() {
  const [own] = $("image").files;
  if (own) return own.arrayBuffer();
  const packed = $("firmware").textContent.trim();
  if (!packed) throw new Fault({ text: "This page carries no firmware: choose the .hex file of a release below." });
  const bytes = Uint8Array.from(atob(packed), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

const freeName = () => {
  let number = 1;
  while (files.has(`run${number}.csv`)) number += 1;
  return `run${number}.csv`;
};

async function recordRig() {
  const name = freeName();
  const planned = $("protocol").value === "next" ? result.next.protocol : $("protocol").value;
  try {
    return await ask({ do: "record", name, protocol: planned, clock_factor: rig.clock, clear: $("clear-fault").checked });
  } finally {
    if (writing.has(name)) {
      rig.runs.push({ name, uploads: rig.uploads });
      // What was recorded with the repaired model in the board is not to be fitted again.
      if (rig.uploads > 0) heldOut.add(name);
    }
  }
}

async function checkRig() {
  const checked = await ask({ do: "check", seconds: 20, moving: $("moving").checked });
  rig.clock = checked.clock_factor ?? rig.clock;
  return checked;
}

function calibrateRig() {
  const points = $("points").value.split(/[\s,;]+/).filter((it) => it !== "").map(Number);
  if (points.some((it) => !Number.isFinite(it))) throw new Fault({ text: `"${$("points").value}" is no list of angles: write 0 30 60 90 120.` });
  return tabled({ do: "calibrate", points, lower_limits: $("lower-limits").checked });
}

// What is answered with a table.
async function tabled(question) {
  const answer = await ask(question);
  $("rig-table").textContent = answer.table;
  return answer;
}

async function uploadRig() {
  const uploaded = await tabled(result ? { do: "upload", model: result.model, verdict: result.verdict } : { do: "upload", model: $("model-text").textContent, verdict: null });
  rig.uploads += 1;
  return uploaded;
}

// The gap, as soon as there is a recording before the last upload and one after it.
async function gap() {
  const here = rig.runs.filter(({ name }) => files.has(name));
  const [before, after] = [rig.uploads - 1, rig.uploads].map((uploads) => here.filter((it) => it.uploads === uploads).map(({ name }) => name));
  $("gap").hidden = !(before.length && after.length);
  if ($("gap").hidden) return;
  const { sentence, tracking, before_deg, after_deg, figure } = await ask({ ask: "gap", before, after });
  $("gap-tracking").textContent = tracking ?? "";
  $("gap-sentence").textContent = sentence ?? `The board's own prediction was off by ${before_deg.toFixed(2)}° before the upload, and by ${after_deg.toFixed(2)}° after it.`;
  // Drawn by the library, which escapes the names of files.
  $("gap-figure").innerHTML = figure;
}

// What of the section can be used now.
function shown() {
  const has = Boolean(port.device);
  $("connect").textContent = has ? "Connect another board" : "Connect a board";
  $("connect").classList.toggle("main", !has);
  $("rig-actions").hidden = !has;
  $("upload").hidden = !result?.model && $("model-text").textContent === "";
  $("upload").textContent = result?.model ? "Upload the resulting model" : "Upload the model below";
  const next = $("protocol").querySelector("[value=next]");
  next.hidden = next.disabled = !result?.next;
  $("rig-table").hidden = $("rig-table").textContent === "";
}

function beginRig({ protocols, boards }) {
  chips = boards.map(([usbVendorId, usbProductId]) => ({ usbVendorId, usbProductId }));
  const hasPort = "serial" in navigator;
  $("no-port").hidden = hasPort;
  $("with-port").hidden = !hasPort;
  $("protocol").append(...protocols.map(({ name, title, seconds }) => made("option", { value: name, textContent: `${name}, ${Math.ceil(seconds / 60)} min: ${title}` })),
    made("option", { value: "next", textContent: "the experiment that the verdict asks for", hidden: true, disabled: true }));
  $("image-note").textContent = $("firmware").textContent.trim() ? "This page carries the firmware of its version." : "This page carries no firmware; choose the .hex file of a release.";
  if (!hasPort) return;
  // A board that is plugged in again is a new port.
  navigator.serial.addEventListener("connect", ({ target }) => { if (port.device) port.device = target; });
  $("connect").addEventListener("click", () => attempt("Choose the board's port …", connect));
  $("flash").addEventListener("click", () => session("Flashing …", async () => ask({ do: "flash" }, await image())));
  $("check").addEventListener("click", () => session("Checking …", checkRig));
  $("record").addEventListener("click", () => session("Recording …", recordRig));
  $("calibrate").addEventListener("click", () => session("Calibrating …", calibrateRig));
  $("rig-ready").addEventListener("click", () => worker?.postMessage({ ready: true }));
  $("upload").addEventListener("click", () => session("Uploading …", uploadRig));
  $("rig-stop").addEventListener("click", stopRig);
  window.addEventListener("keydown", (event) => {
    if (!isRunning || event.code !== "Space") return;
    event.preventDefault();
    stopRig();
  });
  window.addEventListener("beforeunload", (event) => { if (isRunning) event.preventDefault(); });
  shown();
}
