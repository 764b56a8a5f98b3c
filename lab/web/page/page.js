// What stands on the page, and what is asked of the library behind it.

const $ = (id) => document.getElementById(id);
const made = (name, about = {}, ...inside) => {
  const element = Object.assign(document.createElement(name), about);
  element.append(...inside);
  return element;
};

// Beyond this no browser has the memory to diagnose a recording (bytes).
const LARGEST = 256 * 2 ** 20;

// So many recordings are drawn at once.
const SHOWN = 6;

// ---- The library, in a worker.

let packed = $("wasm").textContent;
const program = URL.createObjectURL(new Blob([$("worker").textContent], { type: "text/javascript" }));
let module = null;
let worker = null;
let started = null;
let number = 0;
const waiting = new Map();
let hears = () => {};

function end(text) {
  worker?.terminate();
  worker = null;
  for (const { reject } of waiting.values()) reject(new Fault({ text }));
  waiting.clear();
}

function send(message) {
  return new Promise((resolve, reject) => {
    number += 1;
    waiting.set(number, { resolve, reject });
    worker.postMessage({ ...message, id: number });
  });
}

class Fault extends Error {
  constructor(about) {
    super(about.text);
    this.about = about;
  }
}

// A worker that has its program and the files.
function start() {
  if (worker) return started;
  worker = new Worker(program);
  worker.onmessage = ({ data }) => {
    if (data.port) return port.does(data.port);
    if (data.kept) return takeKept(data.kept);
    if (data.shows) return showsRig(data.shows);
    if (!data.id) return hears(data);
    const { resolve, reject } = waiting.get(data.id) ?? {};
    waiting.delete(data.id);
    if (data.module) {
      module = data.module;
      packed = null;
    }
    if (data.dead) end(data.fault.text);
    if (data.fault) reject?.(new Fault(data.fault)); else resolve?.(data.answer);
  };
  worker.onerror = (event) => end("The program of this page does not run in this browser: " + event.message);
  started = send({ start: { module, packed } }).then(async () => {
    for (const [name, bytes] of files) await send({ question: { ask: "put", name }, file: bytes });
  });
  return started;
}

async function ask(question, file = null) {
  await start();
  return send({ question, file });
}

// ---- What was entered, and is kept from one visit to the next.

const files = new Map();
const fields = ["air", "zero", "flip", "exchange", "material", "length", "width", "height", "tolerance", "seed"];
let heldOut = new Set();
let result = null;
// What was said of a model that was made here.
let remarks = null;
// Whether the columns are as somebody said, and not as they were found.
let said = false;
// The columns of one table, as they are in the file.
let looked = null;
let quantities = [];

const store = new Promise((resolve) => {
  let request;
  try {
    request = indexedDB.open("softrig", 1);
  } catch {
    return resolve(null);
  }
  request.onupgradeneeded = () => request.result.createObjectStore("desk");
  request.onsuccess = () => resolve(request.result);
  // In a private window nothing is kept.
  request.onerror = () => resolve(null);
});

// The files as the store has them: while a rig is recorded only what grows is written again.
const stored = new Map();
const place = (name) => `file ${name}`;

async function keep() {
  const data = await store;
  if (!data) return;
  const entered = Object.fromEntries([...fields.map($), ...document.querySelectorAll("#triples input")]
    .map((field) => [field.id, field.type === "checkbox" ? field.checked : field.value]));
  await new Promise((resolve) => {
    const transaction = data.transaction("desk", "readwrite");
    const desk = transaction.objectStore("desk");
    const changed = [...files].filter(([name, bytes]) => stored.get(name) !== bytes);
    const gone = [...stored.keys()].filter((name) => !files.has(name));
    for (const [name, bytes] of changed) desk.put(bytes, place(name));
    for (const name of gone) desk.delete(place(name));
    desk.put({ names: [...files.keys()], entered, heldOut: [...heldOut], said, result, remarks, rig }, "all");
    transaction.oncomplete = () => {
      for (const [name, bytes] of changed) stored.set(name, bytes);
      for (const name of gone) stored.delete(name);
      resolve();
    };
    transaction.onerror = transaction.onabort = resolve;
  });
}

async function restore() {
  const data = await store;
  const desk = data?.transaction("desk").objectStore("desk");
  const kept = (key) => new Promise((resolve) => {
    const request = desk.get(key);
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => resolve(undefined);
  });
  const all = desk && await kept("all");
  if (!all) return;
  for (const name of all.names) {
    const bytes = await kept(place(name));
    if (!bytes) continue;
    files.set(name, bytes);
    stored.set(name, bytes);
  }
  for (const [id, value] of Object.entries(all.entered)) {
    if ($(id)?.type === "checkbox") $(id).checked = value; else if ($(id)) $(id).value = value;
  }
  heldOut = new Set(all.heldOut);
  said = all.said;
  result = all.result;
  remarks = all.remarks;
  Object.assign(rig, all.rig);
}

// ---- Saying things.

const say = (text) => { $("status").textContent = text; };

function trouble(error) {
  $("trouble").textContent = error?.message ?? "";
  $("trouble").hidden = !error;
  if (error && !(error instanceof Fault)) console.error(error);
}

// One thing at a time; what fails is said, and the page lives on.
let busy = false;
async function attempt(what, work) {
  if (busy) return;
  busy = true;
  trouble(null);
  say(what);
  document.body.classList.add("busy");
  for (const button of document.querySelectorAll("button:not(#stop, #rig-ready, .stop)")) button.disabled = true;
  try {
    await work();
    if ($("status").textContent === what) say("");
  } catch (error) {
    say("");
    trouble(error);
    $("trouble").scrollIntoView({ block: "nearest" });
  } finally {
    busy = false;
    document.body.classList.remove("busy");
    for (const button of document.querySelectorAll("button")) button.disabled = false;
  }
}

function save(link, text, type) {
  URL.revokeObjectURL(link.href);
  link.href = URL.createObjectURL(new Blob([text], { type }));
}

// ---- Files.

const typed = (id, what) => {
  const text = $(id).value.trim().replace(",", ".");
  const value = text === "" ? null : Number(text);
  const wrong = value !== null && !Number.isFinite(value);
  $(id).setAttribute("aria-invalid", wrong);
  if (wrong) throw new Fault({ text: `"${$(id).value}" is no number; correct the ${what}, or leave it empty.` });
  return value;
};

const keys = ["time", "pressure", "angle"];
const layout = () => ({
  columns: keys.map((key) => $("column-" + key).value),
  units: keys.map((key) => $("unit-" + key).value),
  air_kpa: typed("air", "pressure of the air"),
  angle_zero_deg: typed("zero", "angle at rest"),
  flip_angle: $("flip").checked,
  exchange: $("exchange").checked,
});

async function put(name, bytes) {
  files.set(name, bytes);
  if (looked?.name === name) looked = null;
  if (name.endsWith(".toml")) remarks = null;
  await ask({ ask: "put", name }, bytes);
}

async function take(list) {
  for (const file of list) {
    if (file.size > LARGEST) {
      throw new Fault({ text: `${file.name} has ${Math.round(file.size / 2 ** 20)} MiB, more than the ${LARGEST / 2 ** 20} that a page can diagnose. Split the recording, keep every tenth row, or use softrig.` });
    }
  }
  for (const file of list) {
    let bytes;
    try {
      bytes = await file.arrayBuffer();
    } catch {
      throw new Fault({ text: `${file.name} cannot be read: is it a folder, or was it moved?` });
    }
    await put(file.name, bytes);
  }
  changed();
  await read();
}

function changed() {
  if (result) result.stale = true;
}

async function drop(name) {
  files.delete(name);
  heldOut.delete(name);
  if (name.endsWith(".toml")) remarks = null;
  changed();
  await ask({ ask: "remove", name });
  await read();
}

// ---- What was read.

async function read() {
  let found = await ask({ ask: "read", layout: layout() });
  const shown = found.recordings.find((it) => it.fault) ?? found.recordings[0];
  if (looked?.name !== shown?.name) looked = shown ? await ask({ ask: "look", name: shown.name }) : null;
  const asIs = keys.every((key) => $("column-" + key).value === "");
  const guess = shown?.fault?.suggestion ?? (shown?.fault && looked?.guess);
  if (guess && !said && asIs && guess.columns.some((it, place) => it !== quantities[place].column)) {
    // Shown to be checked: a name is no proof of what is in a column.
    keys.forEach((key, place) => {
      $("column-" + key).value = guess.columns[place];
      $("unit-" + key).value = guess.units[place];
    });
    found = await ask({ ask: "read", layout: layout() });
  }
  await show(found);
  look();
  await keep();
}

// A column of the file: its first rows, its course, and what it is.
function look() {
  $("look").hidden = !looked;
  if (!looked) return;
  const row = ({ called, name, first, course }, at) => {
    const points = course.map((height, place) => height === null ? null : `${(100 * place / Math.max(1, course.length - 1)).toFixed(1)},${(19 - 18 * height).toFixed(1)}`);
    const picture = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    picture.setAttribute("viewBox", "0 0 100 20");
    picture.setAttribute("preserveAspectRatio", "none");
    picture.setAttribute("aria-hidden", "true");
    const line = document.createElementNS("http://www.w3.org/2000/svg", "polyline");
    line.setAttribute("points", points.filter((it) => it !== null).join(" "));
    picture.append(line);
    return made("tr", {}, made("th", { scope: "row", textContent: name }), made("td", { className: "first", textContent: first.join("   ") }),
      made("td", {}, picture), made("td", {}, meaning(called, at)));
  };
  const head = ["column", "first rows", "course", "what it is"].map((textContent) => made("th", { scope: "col", textContent }));
  $("look").replaceChildren(made("table", {}, made("caption", { textContent: looked.name }),
    made("thead", {}, made("tr", {}, ...head)), made("tbody", {}, ...looked.columns.map(row))));
}

// What a column is, and in which unit: writes into the fields below.
function meaning(called, at) {
  const names = [called, `#${at + 1}`];
  const isIn = ({ key, column }) => names.includes($("column-" + key).value || column);
  const choice = made("select", {}, made("option", { value: "", textContent: "not used" }));
  choice.setAttribute("aria-label", `What ${called} is`);
  for (const quantity of quantities) {
    const unit = isIn(quantity) ? $("unit-" + quantity.key).value : "";
    const units = ["", ...quantity.units, ...(quantity.units.includes(unit) || unit === "" ? [] : [unit])];
    choice.append(...units.map((it) => made("option", {
      value: `${quantity.key}=${it}`, textContent: it ? `${quantity.key}, ${it}` : quantity.key, selected: isIn(quantity) && it === unit,
    })));
  }
  choice.addEventListener("change", () => {
    const [key, unit] = choice.value.split("=");
    for (const quantity of quantities) {
      // A place that is given up is open again.
      if (quantity.key === key || !isIn(quantity)) continue;
      $("column-" + quantity.key).value = { time: "#0", pressure: "none", angle: "" }[quantity.key];
      $("unit-" + quantity.key).value = "";
    }
    if (key) {
      $("column-" + key).value = called;
      $("unit-" + key).value = unit;
    }
    said = true;
  });
  return choice;
}

function show(found) {
  const good = found.recordings.filter((it) => !it.fault);
  $("others").replaceChildren(...[
    ...(found.effects ? [[found.effects.name, `effects of your own: ${found.effects.kinds.join(", ") || "none"}`]] : []),
    ...(found.folder ? [[found.folder, "default columns and units"]] : []),
    ...found.meta_alone.map((name) => [name, "metadata without their recording"]),
  ].map(([name, what]) => made("li", {}, made("b", { textContent: name }), ` ${what} `, away(name))));
  // What is broken is seen first, and many recordings do not hide what is below them.
  const inOrder = [...found.recordings].sort((a, b) => Boolean(b.fault) - Boolean(a.fault)).map(run);
  $("runs").replaceChildren(...inOrder.slice(0, SHOWN));
  $("more-runs").replaceChildren(...inOrder.slice(SHOWN));
  $("more").hidden = inOrder.length <= SHOWN;
  $("more").firstElementChild.textContent = `${inOrder.length - SHOWN} more recordings`;
  $("names").replaceChildren(...[...new Set(good.flatMap((it) => [...it.columns, ...it.others]))].map((value) => made("option", { value })));
  for (const [section, isThere] of [["columns", files.size && found.recordings.length], ["model", true], ["diagnosis", found.recordings.length]]) {
    $(section).hidden = !isThere;
  }
  const named = keys.map((key) => $("column-" + key).value).some((it) => it !== "");
  $("detected").textContent = said ? "As you set it. The pictures above show the result."
    : named ? "Found by the names in the header. Check the pictures above: a name is no proof. Correct here what is wrong."
      : "The header says what is where. If a column holds something else, say so.";
  save($("save-layout"), "schema = 1\n" + found.section, "application/toml");
  model(found.model);
  verdict();
  return gap();
}

const away = (name) => {
  const button = made("button", { type: "button", className: "bare", textContent: "Remove" });
  button.setAttribute("aria-label", "Remove " + name);
  button.addEventListener("click", () => attempt("Putting it away …", () => drop(name)));
  return button;
};

// Saves a recording that was made here, with what is known about it.
const saved = (name) => {
  const button = made("button", { type: "button", className: "bare", textContent: "Save" });
  button.setAttribute("aria-label", "Save " + name);
  button.addEventListener("click", () => {
    for (const file of [name, name.replace(/csv$/, "meta.toml")]) {
      if (!files.has(file)) continue;
      const link = made("a", { download: file });
      save(link, files.get(file), "text/plain");
      link.click();
    }
  });
  return button;
};

function run(it) {
  const ofBoard = rig.runs.some(({ name }) => name === it.name);
  const figure = made("figure", { className: "run" }, made("h3", {}, it.name, " ", made("span", {}, ...(ofBoard ? [saved(it.name)] : []), away(it.name))));
  if (it.fault) {
    figure.append(made("p", { className: "fault", textContent: it.fault.text }));
    // The words are the command's, and so are the flags in them.
    if (it.fault.text.includes("--")) figure.append(made("p", { className: "remark", textContent: "On this page, use the fields of Columns and units." }));
    return figure;
  }
  const picture = made("div");
  // Drawn by the library, which escapes the names of files.
  picture.innerHTML = it.picture;
  const units = it.units.map((unit, place) => it.columns[place] + (unit ? ` in ${unit}` : ""));
  const box = made("input", { type: "checkbox", checked: heldOut.has(it.name) });
  box.addEventListener("change", () => {
    if (box.checked) heldOut.add(it.name); else heldOut.delete(it.name);
    changed();
    verdict();
    keep();
  });
  figure.append(picture,
    made("figcaption", {}, `${it.samples} samples, ${it.seconds} s, one every ${it.interval_ms} ms${it.runs ? `, ${it.runs} runs` : ""}${it.simulated ? ", simulated" : ""}. Columns: ${units.join(", ")}.`),
    ...it.warnings.map((textContent) => made("p", { className: "remark", textContent })),
    made("label", { className: "check" }, box, "Keep for validation: not fitted"));
  return figure;
}

function model(about) {
  $("has-model").hidden = !about;
  $("no-model").hidden = Boolean(about);
  if (!about) $("model-text").textContent = "";
  if (!about) return;
  $("model-name").replaceChildren(made("b", { textContent: about.name }), about.title ? `: ${about.title}` : "");
  $("model-remarks").textContent = about.fault?.text ?? [...about.warnings, ...(remarks ?? [])].join(" ");
  $("model-remarks").className = about.fault ? "fault" : "small";
  $("model-text").textContent = about.text ?? "";
  $("model-text").closest("details").hidden = !about.text;
  $("model-save").download = about.name;
  save($("model-save"), about.text ?? "", "application/toml");
  $("model-remove").onclick = () => attempt("Putting it away …", () => drop(about.name));
}

// ---- A first model.

async function first(recordings, withBeam) {
  if (recordings && ![...files.keys()].some((name) => !/\.toml$/.test(name))) {
    $("drop").scrollIntoView({ block: "center" });
    throw new Fault({ text: "No recording yet: drop at least two, or use material and dimensions alone." });
  }
  const all = withBeam ? ["length", "width", "height"].map((id) => typed(id, id)) : [null, null, null];
  const some = all.filter((it) => it !== null).length;
  if (some > 0 && some < 3) throw new Fault({ text: "A beam has a length, a width and a height: give all three, or none." });
  const material = withBeam ? $("material").value : "";
  if (some === 3 && material === "") throw new Fault({ text: "Dimensions need a material: choose one, or leave the dimensions out." });
  const found = await ask({ ask: "first_model", layout: layout(), recordings, material, dimensions_mm: some === 3 ? all : null });
  const said = [found.rmse === null ? "Nothing in it was measured yet." : `It follows the recordings to ${found.rmse} (RMS).`,
    ...(found.explains_little ? ["That explains little of the motion: check the columns and units."] : []), ...found.warnings];
  await put("model.toml", new TextEncoder().encode(found.model).buffer);
  remarks = said;
  changed();
}

// ---- The diagnosis.

let suspends = false;
let best = "";

async function diagnose() {
  if ($("has-model").hidden) {
    say("Making a first model of the recordings …");
    await first(true, false);
    await read();
  }
  say("Diagnosing …");
  $("progress").hidden = $("stop").hidden = false;
  $("stop").disabled = false;
  $("stage").textContent = "reading the recordings";
  $("how-far").textContent = $("best").textContent = best = "";
  $("bar").removeAttribute("value");
  $("progress").scrollIntoView({ block: "nearest" });
  hears = ({ progress, suspends: does }) => {
    suspends = does;
    $("stage").textContent = progress.stage;
    $("how-far").textContent = progress.how_far;
    $("best").textContent = best = progress.best;
    $("bar").value = progress.share;
  };
  try {
    const question = { ask: "diagnose", layout: layout(), holdout: [...heldOut], tolerance_deg: typed("tolerance", "tolerance"), seed: typed("seed", "seed") ?? 1, date: new Date().toISOString().slice(0, 10) };
    result = await ask(question);
  } finally {
    hears = () => {};
    $("progress").hidden = $("stop").hidden = true;
  }
  verdict();
  await keep();
  say("Done: " + result.sentence);
  $("result").scrollIntoView({ block: "start" });
  $("result").focus({ preventScroll: true });
}

function stop() {
  $("stop").disabled = true;
  if (suspends) {
    worker.postMessage({ stop: true });
    say("Stopping: finishing the current step …");
  } else {
    end(`Stopped; this is no diagnosis. ${best.charAt(0).toUpperCase()}${best.slice(1)}.`);
  }
}

function verdict() {
  shown();
  $("result").hidden = !result;
  if (!result) return;
  $("stale").hidden = !result.stale;
  $("sentence").textContent = result.sentence;
  $("summary").textContent = result.summary;
  $("truth").hidden = !result.truth;
  $("truth").textContent = result.truth ?? "";
  if ($("report").srcdoc !== result.report) $("report").srcdoc = result.report;
  save($("save-report"), result.report, "text/html");
  $("open-report").href = $("save-report").href;
  save($("save-model"), result.model, "application/toml");
  save($("save-verdict"), result.verdict, "application/json");
  $("next").hidden = !result.next;
  if (result.next) {
    const { title, seconds, setup, decides, protocol } = result.next;
    $("next").querySelector("h2").textContent = decides ? "The experiment that would decide" : "The experiment that comes closest to deciding";
    $("next-text").textContent = `${title} (${Math.round(seconds)} s). Play its protocol on the rig, and diagnose again with its recording beside the others.`;
    $("next-setup").replaceChildren(...setup.map((step) => made("li", { textContent: `Before: ${step}.` })));
    save($("save-next"), protocol, "application/toml");
  }
}

async function example() {
  const seed = 1 + Math.floor(Math.random() * 1e6);
  const { files: list, hidden } = await ask({ ask: "example", seed, effect: null });
  await clear();
  for (const { name, text } of list) await put(name, new TextEncoder().encode(text).buffer);
  await read();
  await diagnose();
  result.truth = `The simulated actuator hid: ${hidden.join(", ").replaceAll("_", " ")}.`;
  verdict();
  await keep();
}

async function clear() {
  files.clear();
  heldOut.clear();
  result = remarks = looked = null;
  Object.assign(rig, { uploads: 0, runs: [], clock: null });
  said = false;
  for (const field of document.querySelectorAll("main input, main select")) {
    if (field.type === "checkbox") field.checked = false; else field.value = field.id === "seed" ? "1" : "";
  }
  await ask({ ask: "clear" });
  await read();
}

// ---- The beginning.

async function begin() {
  const choices = await ask({ ask: "choices" });
  beginRig(choices);
  $("material").append(...choices.materials.map((name) => made("option", { value: name, textContent: name })));
  quantities = choices.quantities;
  $("triples").replaceChildren(...quantities.map(({ key, column, units }) => {
    const name = made("input", { id: "column-" + key, placeholder: column, autocomplete: "off", spellcheck: false });
    name.setAttribute("list", "names");
    const unit = made("input", { id: "unit-" + key, placeholder: "as named", autocomplete: "off", spellcheck: false });
    unit.setAttribute("list", "units-" + key);
    const known = made("datalist", { id: "units-" + key }, ...units.map((value) => made("option", { value })));
    return made("fieldset", {}, made("legend", { textContent: key }), made("label", {}, "column", name), made("label", {}, "unit", unit), known);
  }));
  $("triples").addEventListener("change", () => { said = true; });
  $("columns").addEventListener("change", () => attempt("Reading …", async () => { changed(); await read(); }));
  for (const id of fields) $(id).addEventListener("change", () => keep());
  await restore();
  for (const [name, bytes] of files) await ask({ ask: "put", name }, bytes);
  await read();
  $("version").textContent = choices.version;
}

$("files").addEventListener("change", () => {
  const list = [...$("files").files];
  $("files").value = "";
  attempt("Reading …", () => take(list));
});
for (const kind of ["dragover", "dragenter"]) {
  window.addEventListener(kind, (event) => { event.preventDefault(); document.body.classList.add("dragging"); });
}
for (const kind of ["dragleave", "drop"]) window.addEventListener(kind, () => document.body.classList.remove("dragging"));
window.addEventListener("drop", (event) => {
  event.preventDefault();
  const list = [...event.dataTransfer.files];
  attempt("Reading …", () => take(list));
});
const identified = (recordings, withBeam) => () => attempt("Identifying the parameters …", async () => { await first(recordings, withBeam); await read(); });
$("first").addEventListener("click", identified(true, false));
$("first-beam").addEventListener("click", identified(false, true));
$("first-both").addEventListener("click", identified(true, true));
$("diagnose").addEventListener("click", () => attempt("Diagnosing …", diagnose));
$("stop").addEventListener("click", stop);
$("example").addEventListener("click", () => attempt("Simulating an actuator with a hidden effect …", example));
$("clear").addEventListener("click", () => attempt("Clearing …", clear));
