"use strict";
const $ = id => document.getElementById(id);
const data = JSON.parse($("data").textContent);
const WORKLET = JSON.parse($("worklet").textContent).source;
const COMPUTER_KEYS = "zsxdcvgbhnjmq2w3er5t6y7ui9o0p"; // two octaves and a half, as on many synthesisers
const FUSED = "AGFzbQEAAAABBQFgAAF7AwIBAAoTAREAQQD9D0EA/Q9BAP0P/YcCCw=="; // a module with a fused multiply-add
const SIMD = "AGFzbQEAAAABBQFgAAF7AwIBAAoPAQ0AQQD9D0EA/Q/98gEL"; // a module with a product of pairs

// --- faults, in plain sentences

function say(text) {
  $("fault").textContent = text;
  $("fault").hidden = !text;
}

const bytesOf = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));

function missing() {
  if (!window.WebAssembly || !window.AudioWorkletNode || !window.DecompressionStream)
    return "This browser has no WebAssembly or no AudioWorklet. A recent Chrome, Edge, Firefox or Safari plays this page.";
  if (!WebAssembly.validate(bytesOf(SIMD)))
    return "This browser lacks the SIMD of WebAssembly. Chrome and Edge from version 91 on, Firefox from 89 on and Safari"
      + " from 16.4 on have it.";
  return "";
}

// --- the sound

// Without a fused multiply-add the page multiplies and then adds; #plain at the end of its address asks for that.
const isFused = !missing() && WebAssembly.validate(bytesOf(FUSED)) && location.hash !== "#plain";

async function unpack(text) {
  const stream = new Blob([bytesOf(text)]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Numbers of eight bytes come with all their first bytes first (engine.export.page.by_place).
function inOrder(packed) {
  const out = new Uint8Array(packed.length), count = packed.length / 8;
  for (let place = 0; place < 8; place++)
    for (let n = 0, from = place * count; n < count; n++) out[8 * n + place] = packed[from + n];
  return fillIn(out.subarray(0, data.size));
}

// What follows from other numbers is left out of the scene (engine.export.player_bytes): products of two, and how much
// the lower half of a symmetric matrix is like the upper.
function fillIn(scene) {
  for (const [phi, kick, drift, kickPhi, driftPhi, count] of data.left_out) {
    const [a, t, v, x, y] = [phi, kick, drift, kickPhi, driftPhi].map(at =>
      new Float64Array(scene.buffer, at - data.base, count));
    for (let n = 0; n < count; n++) {
      x[n] = t[n] * a[n];
      y[n] = v[n] * a[n];
    }
  }
  for (const [at, size] of data.symmetric) {
    const bits = new BigInt64Array(scene.buffer, at - data.base, size * size);
    for (let row = 1; row < size; row++)
      for (let column = 0; column < row; column++) bits[row * size + column] += bits[column * size + row];
  }
  return scene;
}

let unpacked;
async function options(messages, isLive) {
  await started;
  unpacked ||= Promise.all([unpack(data.kernel), unpack(data.scene).then(inOrder)]);
  const [kernel, scene] = await unpacked;
  const { at, names, functions, base, size, block, samplerate, channels, gain, coarsest } = data;
  const numbers = { at, names, functions, base, size, block, samplerate, channels, gain, coarsest };
  return { ...numbers, kernel, scene, messages, isLive, isFused };
}

async function makeNode(context, messages) {
  const isLive = context instanceof AudioContext;
  // a blob: URL has no origin in a page opened from disk
  await context.audioWorklet.addModule("data:text/javascript;charset=utf-8," + encodeURIComponent(WORKLET));
  const processorOptions = await options(messages, isLive);
  return new AudioWorkletNode(context, "fdh-patch", {
    numberOfInputs: 0, outputChannelCount: [data.channels], processorOptions,
  });
}

let playing, context, analyser;
async function begin() {
  const reason = missing();
  if (reason) throw new Error(reason);
  try {
    context = new AudioContext({ sampleRate: data.samplerate, latencyHint: "interactive" });
  } catch {
    throw new Error(`The browser refuses the ${data.samplerate} Hz of this page. fdh export --samplerate makes another.`);
  }
  resume();
  if (navigator.audioSession) navigator.audioSession.type = "playback"; // an iPhone's switch would silence it otherwise
  const node = await makeNode(context, [{ gain: gain() }]);
  analyser = new AnalyserNode(context, { fftSize: 4096, smoothingTimeConstant: 0.6 });
  node.connect(analyser).connect(context.destination);
  node.port.onmessage = ({ data: message }) => message.recorded ? keep(message.recorded) : show(message);
  node.onprocessorerror = () => say("The sound has stopped because of an error. Load the page again.");
  requestAnimationFrame(draw);
  return node;
}

// Phones let sound begin when a finger leaves the screen, not when it touches it.
function resume() {
  if (context && context.state !== "running") context.resume().catch(() => {}); // the next touch asks again
}
for (const kind of ["pointerup", "touchend", "click", "keydown"]) document.addEventListener(kind, resume);

async function send(message) {
  try {
    playing ||= begin();
    const node = await playing;
    resume();
    node.port.postMessage(message);
  } catch (error) {
    playing = undefined;
    say(error.message);
  }
}

const gain = () => data.gain * 10 ** ($("gain").value / 20);
$("gain").oninput = () => {
  $("gain-value").textContent = `${(+$("gain").value).toFixed(1)} dB`;
  if (playing) send({ gain: gain() });
};

// --- meters

const decimals = (x, digits) => Number.isFinite(x) ? x.toPrecision(digits) : "–";

function show(m) {
  $("level").textContent = m.level > 0 ? `${(20 * Math.log10(m.level)).toFixed(1)} dB` : "silent";
  $("level").classList.toggle("bad", m.level > 1);
  $("load").textContent = `${(100 * m.load).toFixed(0)} %` + (m.quality ? `, coarser by ${m.quality}` : "");
  $("load").classList.toggle("bad", m.quality > 0);
  $("error").textContent = m.error.toExponential(1);
  $("error").classList.toggle("bad", !(m.error < 1e-9));
  $("iterations").textContent = m.iterations ? decimals(m.iterations, 2) : "none";
  if (m.force > 0) $("force").textContent = `${decimals(m.force, 3)} N`;
  $("awake").textContent = `${m.awake} of ${data.at.islands}`;
  if (m.silenced) say(`${m.silenced} samples were not finite, and are silent. Play again to start anew.`);
}

function frameOf(canvas) {
  const { clientWidth: w, clientHeight: h } = canvas, scale = devicePixelRatio || 1;
  if (canvas.width !== Math.round(w * scale)) {
    canvas.width = Math.round(w * scale);
    canvas.height = Math.round(h * scale);
  }
  const g = canvas.getContext("2d");
  g.setTransform(scale, 0, 0, scale, 0, 0);
  g.clearRect(0, 0, w, h);
  g.strokeStyle = getComputedStyle(document.documentElement).getPropertyValue("--accent");
  g.lineWidth = 1.5;
  g.beginPath();
  return [g, w, h];
}

function draw() {
  const samples = new Float32Array(analyser.fftSize), bins = new Float32Array(analyser.frequencyBinCount);
  analyser.getFloatTimeDomainData(samples);
  analyser.getFloatFrequencyData(bins);
  let [g, w, h] = frameOf($("wave"));
  const count = 1024, first = Math.max(0, samples.findIndex((x, i) => i > 0 && samples[i - 1] < 0 && x >= 0));
  for (let i = 0; i < count; i++)
    g.lineTo(i / count * w, h / 2 * (1 - samples[Math.min(first + i, samples.length - 1)]));
  g.stroke();
  [g, w, h] = frameOf($("spectrum"));
  const top = data.samplerate / 2, octaves = Math.log2(top / 30);
  for (let x = 0; x < w; x++) {
    const bin = 30 * 2 ** (x / w * octaves) / top * bins.length;
    g.lineTo(x, h * Math.min(1, Math.max(0, -bins[Math.min(bins.length - 1, Math.floor(bin))] / 110)));
  }
  g.stroke();
  requestAnimationFrame(draw);
}

// --- rows of events

// Rows between those of two velocities, of which the page has a few.
function rowsAt(key, velocity) {
  const { levels } = data, rowsOn = isDown("soft") && key.soft_on.length ? key.soft_on : key.on;
  const v = Math.min(levels[levels.length - 1], Math.max(levels[0], velocity));
  let n = levels.findIndex(level => level >= v);
  if (levels[n] === v) return rowsOn[n];
  const a = rowsOn[n - 1], b = rowsOn[n], share = (v - levels[n - 1]) / (levels[n] - levels[n - 1]);
  if (a.length !== b.length) return share < 0.5 ? a : b;
  const { EXCHANGE_TABLES } = data.names.EventKind, between = (row, other) =>
    row[0] === EXCHANGE_TABLES ? share < 0.5 ? row : other : row.map((x, j) => j < 6 ? x : x + share * (other[j] - x));
  return a.map((row, i) => between(row, b[i]));
}

const scaled = (pad, share) => pad.rows.map(row => {
  const changed = [...row];
  if (pad.is_hammer) changed[7] *= share;
  else if (row[6]) changed[6] *= share;
  return changed;
});

const sliderRows = (slider, value) => slider.rows.map((row, i) => row.map((x, j) =>
  j < 6 ? x : x + value * (slider.rows_at_one[i][j] - x)));

// --- keys and pedals, as live sound has them (engine.live.key_allocator)

const down = new Set(), kept = new Set(); // keys that are down, and those that the sostenuto pedal keeps
const pedals = { sustain: 0, sostenuto: 0, soft: 0 }; // how far down, 0 to 127
let sounding = []; // keys whose dampers have not ended them, the oldest first

const isDown = pedal => pedals[pedal] >= data.pedal_down;
const letGo = key => isDown("soft") && key.soft_on.length ? key.soft_off : key.off;

// Rows that put the dampers of a key down as far as the pedals let them.
function damp(key) {
  const share = down.has(key) || kept.has(key) ? 0 : data.shares[pedals.sustain];
  if (!share) return [];
  sounding = sounding.filter(one => one !== key);
  return key.damp[share - 1];
}

// Rows that end a key, as it cannot go on beside another.
function end(key) {
  const rows = down.delete(key) ? letGo(key) : [];
  kept.delete(key);
  sounding = sounding.filter(one => one !== key);
  mark(key, false);
  return [...rows, ...key.steal, ...damp(key)];
}

function press(key, velocity) {
  const rows = [];
  const inGroup = other => other !== key && key.group !== null && other.group === key.group;
  for (const other of sounding.filter(inGroup)) rows.push(...end(other));
  let others = sounding.filter(other => other !== key);
  while (others.length >= data.polyphony) {
    const oldest = others.find(other => !down.has(other)) || others[0];
    rows.push(...end(oldest));
    others = others.filter(other => other !== oldest);
  }
  sounding = [...others, key];
  down.add(key);
  rows.push(...rowsAt(key, velocity));
  send({ rows });
  mark(key, true);
}

function release(key) {
  if (!down.delete(key)) return;
  send({ rows: [...letGo(key), ...damp(key)] });
  mark(key, false);
}

function movePedal(pedal, value) {
  const was = isDown(pedal), share = data.shares[pedals.sustain], before = [...kept];
  pedals[pedal] = value;
  showPedals();
  let moved = [];
  if (pedal === "sustain" && share !== data.shares[value]) moved = data.keys;
  if (pedal === "sostenuto" && was !== isDown(pedal)) {
    kept.clear();
    if (isDown(pedal)) down.forEach(key => kept.add(key));
    moved = before;
  }
  const free = moved.filter(key => !down.has(key) && !kept.has(key));
  if (free.length) send({ rows: free.flatMap(key => [...key.lift, ...damp(key)]) });
}

// All keys and pedals come up; nothing is sent.
function letAllUp() {
  down.forEach(key => mark(key, false));
  down.clear();
  kept.clear();
  sounding = [];
  for (const pedal in pedals) pedals[pedal] = 0;
  showPedals();
}

function showPedals() {
  for (const pedal in pedals) $(pedal).setAttribute("aria-pressed", isDown(pedal));
  $("depth").value = pedals.sustain;
}

function makePedals() {
  const hasDampers = data.keys.some(key => key.lift.length), isSoftened = data.keys.some(key => key.soft_on.length);
  $("sustain").hidden = $("sostenuto").hidden = $("depth-label").hidden = !hasDampers;
  $("soft").hidden = !isSoftened;
  $("pedals").hidden = !hasDampers && !isSoftened;
  for (const pedal in pedals) $(pedal).onclick = () => movePedal(pedal, isDown(pedal) ? 0 : 127);
  $("depth").oninput = () => movePedal("sustain", +$("depth").value);
  if (!hasDampers) return;
  document.addEventListener("keydown", event => { if (event.key === "Shift" && !event.repeat) movePedal("sustain", 127); });
  document.addEventListener("keyup", event => { if (event.key === "Shift") movePedal("sustain", 0); });
  $("hint").textContent += " Shift is the pedal.";
}

const elements = new Map();
const mark = (key, isDown) => elements.get(key)?.classList.toggle("down", isDown);

// How far up a button was touched, as a velocity of MIDI: the lower, the louder, as on a key.
function velocityOf(event) {
  const box = event.currentTarget.getBoundingClientRect();
  return Math.round(20 + 107 * Math.min(1, Math.max(0, (event.clientY - box.top) / box.height)));
}

function makeKeyboard() {
  const box = document.createElement("div"), { keys } = data;
  const isChromatic = keys.length > 1 && keys.every((key, i) => key.number === keys[0].number + i);
  box.className = "keys";
  for (const key of keys) {
    const button = document.createElement("button"), isBlack = [1, 3, 6, 8, 10].includes(key.number % 12);
    button.className = !isChromatic ? "plain" : isBlack ? "black" : "white";
    button.textContent = !isChromatic || key.number % 12 === 0 ? key.name : "";
    button.setAttribute("aria-label", key.name);
    button.onpointerdown = event => {
      button.setPointerCapture(event.pointerId);
      press(key, velocityOf(event));
    };
    button.onpointerup = button.onpointercancel = () => release(key);
    button.onkeydown = event => { if ([" ", "Enter"].includes(event.key) && !event.repeat) press(key, 80); };
    button.onkeyup = event => { if ([" ", "Enter"].includes(event.key)) release(key); };
    elements.set(key, button);
    box.append(button);
  }
  $("keyboard").append(box);
  $("keyboard").hidden = false;
  const middle = keys.reduce((a, b) => Math.abs(b.number - 60) < Math.abs(a.number - 60) ? b : a);
  const button = elements.get(middle);
  $("keyboard").scrollLeft = button.offsetLeft - $("keyboard").clientWidth / 2;
  const first = keys.findIndex(key => key.number >= 48 && key.number % 12 === 0);
  const offset = Math.max(0, first);
  const keyOf = event => event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input") ? undefined
    : keys[offset + COMPUTER_KEYS.indexOf(event.key.toLowerCase())];
  const played = event => COMPUTER_KEYS.includes(event.key.toLowerCase()) && event.key.length === 1;
  document.addEventListener("keydown", event => {
    const key = played(event) ? keyOf(event) : undefined;
    if (key && !event.repeat) press(key, 80);
  });
  document.addEventListener("keyup", event => {
    const key = played(event) ? keyOf(event) : undefined;
    if (key) release(key);
  });
  window.addEventListener("blur", () => [...down].forEach(key => release(key))); // no key is left hanging
  $("hint").textContent = "Lower on a key is louder. The computer's keys Z to M and Q to P play too.";
  makePedals();
}

function makePads() {
  data.pads.forEach((pad, n) => {
    const button = document.createElement("button"), name = document.createElement("span");
    const size = document.createElement("small");
    button.className = "pad";
    name.textContent = pad.name;
    size.textContent = pad.is_hammer ? `throw, ${decimals(Math.abs(pad.size), 3)} ${pad.unit}` : "pluck";
    button.append(name, size);
    const strike = share => {
      send({ rows: scaled(pad, share) });
      size.textContent = pad.is_hammer ? `${decimals(Math.abs(pad.size * share), 3)} ${pad.unit}`
        : `× ${decimals(share, 2)}`;
      button.classList.add("down");
      setTimeout(() => button.classList.remove("down"), 150);
    };
    button.onpointerdown = event => strike(2 * velocityOf(event) / 127);
    button.onkeydown = event => { if ([" ", "Enter"].includes(event.key) && !event.repeat) strike(1); };
    if (n < 9) document.addEventListener("keydown", event => {
      if (event.key === String(n + 1) && !event.repeat && !event.target.matches("input")) strike(1);
    });
    $("pads").append(button);
  });
  $("pads").hidden = !data.pads.length;
  if (data.pads.length) $("hint").textContent = "Lower on a pad is harder. The computer's keys 1 to 9 strike as the patch does.";
}

const sliders = []; // with their inputs, the rows of a position, and whether they were moved

function addSlider(path, unit, limits, valueOf, rowsOf) {
  const label = document.createElement("label"), name = document.createElement("span");
  const input = document.createElement("input"), output = document.createElement("output");
  label.className = "slider";
  name.textContent = path;
  Object.assign(input, { type: "range", ...limits });
  const put = place => {
    input.value = place;
    output.textContent = `${decimals(valueOf(+input.value), 3)} ${unit}`;
    input.setAttribute("aria-valuetext", output.textContent);
  };
  const move = place => {
    put(place);
    slider.isMoved = true;
    send({ rows: slider.rows() });
  };
  const slider = { put, move, rows: () => rowsOf(+input.value), place: () => +input.value, isMoved: false };
  input.oninput = () => move(input.value);
  put(limits.value);
  label.append(name, input, output);
  $("sliders").append(label);
  sliders.push(slider);
  return slider;
}

let bend = () => {}; // the pitch wheel, from -1 to 1, if the page was made with one

function makeSliders() {
  $("sliders").hidden = !data.sliders.length && !data.table_sliders.length;
  for (const slider of data.sliders) {
    const toPlace = x => slider.is_logarithmic ? Math.log10(x) : x;
    const valueOf = place => slider.is_logarithmic ? 10 ** place : place;
    const limits = { min: toPlace(slider.low), max: toPlace(slider.high), step: "any", value: toPlace(slider.value) };
    addSlider(slider.path, slider.unit, limits, valueOf, place => sliderRows(slider, valueOf(place)));
  }
  const tabled = data.table_sliders.map(({ path, unit, values, home, rows, overlapping }) => {
    const limits = { min: 0, max: values.length - 1, step: 1, value: home };
    // tables are made for one slider at a time: others that change the same ones go home before
    const goHome = m => {
      const other = tabled[m], { home, rows } = data.table_sliders[m];
      if (!other.isMoved) return [];
      other.put(home);
      other.isMoved = false;
      return [rows[home]];
    };
    return addSlider(path, unit, limits, place => values[place],
      place => [...overlapping.flatMap(goHome), rows[place]]);
  });
  const wheel = data.table_sliders.findIndex(({ path }) => path === data.bend);
  if (wheel < 0) return;
  const { values } = data.table_sliders[wheel];
  bend = share => {
    const off = values.map(value => Math.abs(value - share * data.bend_cents));
    const place = off.indexOf(Math.min(...off));
    if (place !== tabled[wheel].place()) tabled[wheel].move(place);
  };
}

// --- buttons

$("play").onclick = () => {
  if (playing) send({ reset: true });
  letAllUp();
  send({ rows: sliders.filter(slider => slider.isMoved).flatMap(slider => slider.rows()) }); // they stay where they are
  send({ song: data.song || [] });
};
$("damp").onclick = () => send({ rows: data.keys.length ? data.keys.flatMap(end) : data.damp });
$("copy").onclick = async () => {
  await navigator.clipboard.writeText($("text").textContent);
  $("copy").textContent = "Copied";
};

let isRecording = false;
$("record").onclick = () => {
  isRecording = !isRecording;
  $("record").setAttribute("aria-pressed", isRecording);
  $("record").textContent = isRecording ? "Stop and save" : "Record";
  send(isRecording ? { record: true } : { keep: true });
};

// A WAV of 32-bit floating-point numbers.
function wavOf(blocks) {
  const count = blocks.reduce((sum, block) => sum + block.length, 0), head = new DataView(new ArrayBuffer(44));
  const { channels, samplerate } = data;
  const text = (place, word) => [...word].forEach((c, i) => head.setUint8(place + i, c.charCodeAt(0)));
  text(0, "RIFF"); head.setUint32(4, 36 + 4 * count, true); text(8, "WAVEfmt "); head.setUint32(16, 16, true);
  head.setUint16(20, 3, true); head.setUint16(22, channels, true); head.setUint32(24, samplerate, true);
  head.setUint32(28, 4 * channels * samplerate, true); head.setUint16(32, 4 * channels, true);
  head.setUint16(34, 32, true); text(36, "data"); head.setUint32(40, 4 * count, true);
  return new Blob([head, ...blocks], { type: "audio/wav" });
}

function keep(blocks) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(wavOf(blocks));
  link.download = `${document.title.replace(/[^\w-]+/g, "_")}.wav`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

async function useMidi() {
  try {
    const access = await navigator.requestMIDIAccess();
    const listen = () => access.inputs.forEach(input => { input.onmidimessage = hear; });
    access.onstatechange = listen;
    listen();
    say(access.inputs.size ? "" : "No MIDI keyboard is connected; one that you plug in is heard.");
  } catch {
    say("The browser was not allowed to use MIDI; allow it for this page, and press the button again.");
  }
}

function hear({ data: [status, number, value] }) {
  const kind = status & 0xf0, key = data.keys.find(one => one.number === number);
  if (kind === 0x90 && value > 0 && key) press(key, value);
  else if ((kind === 0x80 || kind === 0x90) && key) release(key);
  else if (kind === 0xe0) bend((number + 128 * value) / 8192 - 1);
  else if (kind === 0xb0 && number in data.pedals) movePedal(data.pedals[number], value);
}

$("midi").onclick = useMidi;

async function start() {
  say(missing());
  $("unfused").hidden = isFused || !!missing();
  if (!window.DecompressionStream) return;
  Object.assign(data, JSON.parse(new TextDecoder().decode(await unpack(data.controls))));
  if (data.keys.length) makeKeyboard();
  else makePads();
  makeSliders();
  $("midi").hidden = !navigator.requestMIDIAccess || !data.keys.length;
}
const started = start();

// --- for tests: the sound without a device, as text

const textOf = channel => {
  const bytes = new Uint8Array(channel.buffer, channel.byteOffset, channel.byteLength);
  let text = "";
  for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  return btoa(text);
};

window.fdh = {
  data,
  async render(frames, messages) {
    await started;
    const offline = new OfflineAudioContext(data.channels, frames, data.samplerate);
    const node = await makeNode(offline, JSON.parse(messages));
    let meter;
    node.port.onmessage = ({ data: message }) => { meter = message; };
    node.connect(offline.destination);
    const begin = performance.now(), buffer = await offline.startRendering(), took = performance.now() - begin;
    await new Promise(resolve => setTimeout(resolve, 200));
    const channels = Array.from({ length: data.channels }, (_, c) => textOf(buffer.getChannelData(c)));
    return JSON.stringify({ channels, meter, took });
  },
};
