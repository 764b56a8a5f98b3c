// The library in its own thread: one question at a time, and the page never waits.
"use strict";
let wasm;
let stopped = false;
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

const page = {
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
  if (data.stop) stopped = true; else last = last.then(() => reply(data));
};
