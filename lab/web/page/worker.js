// The library in its own thread: one question at a time, and the page never waits.
"use strict";
let wasm;
let stopped = false;
let ready = false;
let said = "";
const decoder = new TextDecoder();
const textAt = (address, bytes) => decoder.decode(new Uint8Array(wasm.memory.buffer, address, bytes));

// A program that computes hears no message, unless the browser can suspend it meanwhile. Where it
// cannot, only ending this worker stops it.
const suspends = "Suspending" in WebAssembly && "promising" in WebAssembly;

function report(address, bytes) {
  postMessage({ progress: JSON.parse(textAt(address, bytes)), suspends });
  return 1;
}

async function reportAndListen(address, bytes) {
  report(address, bytes);
  await new Promise((resolve) => { setTimeout(resolve); });
  return stopped ? 0 : 1;
}

// ---- The port, which the page holds: what comes is a message.

const came = [];
let gone = false;
let opened = () => {};
let wake = () => {};

function hearPort({ bytes, lost, open }) {
  if (bytes) came.push(bytes);
  if (lost !== undefined) gone = true;
  if (open !== undefined) opened(open);
  wake();
}

function say(text, at, room) {
  const bytes = new TextEncoder().encode(text).subarray(0, room);
  new Uint8Array(wasm.memory.buffer, at, bytes.length).set(bytes);
  return bytes.length;
}

async function openPort(baud, reset, at, room) {
  came.length = 0;
  gone = false;
  const reason = await new Promise((resolve) => {
    opened = resolve;
    postMessage({ port: { open: { baud, reset: Boolean(reset) } } });
  });
  return say(reason, at, room);
}

async function readPort(at, room, wait) {
  if (came.length === 0 && !gone) {
    await new Promise((resolve) => {
      const timer = setTimeout(resolve, wait);
      wake = () => { clearTimeout(timer); resolve(); };
    });
  }
  if (came.length === 0) return gone ? -1 : 0;
  let count = 0;
  while (came.length > 0 && count < room) {
    const piece = came[0].subarray(0, room - count);
    new Uint8Array(wasm.memory.buffer, at + count, piece.length).set(piece);
    count += piece.length;
    if (piece.length === came[0].length) came.shift(); else came[0] = came[0].subarray(piece.length);
  }
  return count;
}

const waits = (ms) => new Promise((resolve) => { setTimeout(resolve, ms); });
const bytesAt = (address, bytes) => new Uint8Array(wasm.memory.buffer, address, bytes).slice();
const suspending = (work, instead) => suspends ? new WebAssembly.Suspending(work) : instead;

const page = {
  date_ms: () => Date.now(),
  sleep_ms: suspending(waits, () => {}),
  port_open: suspending(openPort, (baud, reset, at, room) => say("that takes Chromium, Chrome or Edge 137 or later", at, room)),
  port_read: suspending(readPort, () => -1),
  port_write: (at, count) => postMessage({ port: { write: bytesAt(at, count) } }),
  port_close: () => postMessage({ port: { close: true } }),
  keep: (path, letters, at, count, append) => postMessage({ kept: { path: textAt(path, letters), bytes: bytesAt(at, count), append: Boolean(append) } }),
  forget: (path, letters) => postMessage({ kept: { path: textAt(path, letters), forget: true } }),
  shows: (at, bytes) => postMessage({ shows: JSON.parse(textAt(at, bytes)) }),
  has_enough: () => stopped ? 1 : 0,
  is_ready() {
    const was = ready;
    ready = false;
    return was ? 1 : 0;
  },
  now_ms: () => performance.now(),
  go_on: suspends ? new WebAssembly.Suspending(reportAndListen) : report,
  defect(address, bytes) { said = textAt(address, bytes); },
};

async function unpacked(packed) {
  const letters = atob(packed);
  const bytes = Uint8Array.from(letters, (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return WebAssembly.compile(await new Response(stream).arrayBuffer());
}

async function begin(start) {
  const module = start.module || await unpacked(start.packed);
  wasm = (await WebAssembly.instantiate(module, { page })).exports;
  return { answer: null, module };
}

async function answer({ question, file }) {
  const json = new TextEncoder().encode(JSON.stringify(question));
  const bytes = json.length + (file ? file.byteLength : 0);
  const room = wasm.room(bytes);
  if (room === 0) return { fault: { text: "The memory of this page is too small for the file. Split the recording, or keep every tenth row; the command softrig has the memory of the whole computer." } };
  const into = new Uint8Array(wasm.memory.buffer, room, bytes);
  into.set(json);
  if (file) into.set(new Uint8Array(file), json.length);
  stopped = false;
  const ask = suspends ? WebAssembly.promising(wasm.ask) : wasm.ask;
  const length = await ask(json.length);
  return JSON.parse(textAt(wasm.answer(), length));
}

async function reply(data) {
  try {
    postMessage({ id: data.id, ...await (data.start ? begin(data.start) : answer(data)) });
  } catch (error) {
    // Nothing that stands in its memory can be trusted now. Memory that is used up ends it without
    // a word; a defect says what it is.
    const text = said || !(error instanceof WebAssembly.RuntimeError || error instanceof RangeError)
      ? "This is a defect of softrig, not of your files. Please report it with this sentence: " + (said || error)
      : "This was too much for the memory of this page. Take shorter recordings, or fewer at a time; the command softrig has the memory of the whole computer.";
    postMessage({ id: data.id, fault: { text }, dead: true });
  }
}

let last = Promise.resolve();
onmessage = ({ data }) => {
  if (data.stop) stopped = true;
  else if (data.ready) ready = true;
  else if (data.port) hearPort(data.port);
  else last = last.then(() => reply(data));
};
