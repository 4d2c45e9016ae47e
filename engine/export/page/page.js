"use strict";
const $ = id => document.getElementById(id);
const data = JSON.parse($("data").textContent);
const WORKLET = JSON.parse($("worklet").textContent).source;
// Two octaves and a half, as on many synthesisers: places on a keyboard, as events name them.
const COMPUTER_KEYS = [..."ZSXDCVGBHNJMQ2W3ER5T6Y7UI9O0P"].map(c => (c < "A" ? "Digit" : "Key") + c);
const CALM = matchMedia("(prefers-reduced-motion: reduce)").matches;
const FUSED = "AGFzbQEAAAABBQFgAAF7AwIBAAoTAREAQQD9D0EA/Q9BAP0P/YcCCw=="; // a module with a fused multiply-add
const SIMD = "AGFzbQEAAAABBQFgAAF7AwIBAAoPAQ0AQQD9D0EA/Q/98gEL"; // a module with a product of pairs

// --- faults, in plain sentences

document.addEventListener("securitypolicyviolation", ({ effectiveDirective }) =>
  say(`This site's Content-Security-Policy forbids what the page needs (${effectiveDirective}).`));

function say(text) {
  $("fault").textContent = text;
  $("fault").hidden = !text;
}

const bytesOf = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));

function missing() {
  if (!window.isSecureContext)
    return "A browser lets no page compute sound that came over plain http. Put this one behind https, or open the file.";
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
const unpackAll = () => unpacked ||= Promise.all([unpack(data.kernel), unpack(data.scene).then(inOrder)]);

async function options(messages, isLive) {
  await started;
  const [kernel, scene] = await unpackAll();
  const { at, names, functions, base, size, block, samplerate, channels, gain, coarsest } = data;
  const motion = { ...data.motion, shapes: [], most: FIGURES };
  const numbers = { at, names, functions, base, size, block, samplerate, channels, gain, coarsest, motion };
  numbers.places = data.value_places;
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

let playing, context, analyser, fader;
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
  const node = await makeNode(context, [{ gain: gain() }, { rows: movedRows() }]);
  analyser = new AnalyserNode(context, { fftSize: 4096, smoothingTimeConstant: 0.6 });
  fader = new GainNode(context);
  node.connect(fader).connect(analyser).connect(context.destination);
  node.port.onmessage = ({ data: message }) => message.recorded ? keep(message.recorded) : show(message);
  node.onprocessorerror = () => say("The sound has stopped because of an error. Load the page again.");
  requestAnimationFrame(draw);
  return node;
}

// Phones let sound begin when a finger leaves the screen, not when it touches it.
function resume() {
  if (context && !isStopped && context.state !== "running") context.resume().catch(() => {}); // the next touch asks again
}
for (const kind of ["pointerup", "touchend", "click", "keydown"]) document.addEventListener(kind, resume);

async function send(message) {
  try {
    playing ||= begin();
    const node = await playing;
    if (isStopped) wake(node);
    resume();
    node.port.postMessage(message);
  } catch (error) {
    playing = undefined;
    context?.close().catch(() => {});
    context = undefined;
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
  if (isRecording) $("record").textContent = `Stop and save ${(m.seconds - recordedFrom).toFixed(0)} s`;
  now = m.seconds;
  if (isScore && m.level === 0 && m.seconds > data.score_seconds) {
    isScore = false;
    showPlay();
  }
  takeMotion(m.motion);
  followScore(m.values);
  lightScore(m.seconds);
  $("coarse").hidden = !m.quality;
  if (m.silenced) say(`${m.silenced} samples were not finite, and are silent. Play again to start anew.`);
}

let accent, soft; // colours of the style as it is now

function frameOf(canvas) {
  const { clientWidth: w, clientHeight: h } = canvas, scale = devicePixelRatio || 1;
  if (canvas.width !== Math.round(w * scale)) {
    canvas.width = Math.round(w * scale);
    canvas.height = Math.round(h * scale);
  }
  const g = canvas.getContext("2d");
  g.setTransform(scale, 0, 0, scale, 0, 0);
  g.clearRect(0, 0, w, h);
  g.strokeStyle = accent;
  g.lineWidth = 1.5;
  g.beginPath();
  return [g, w, h];
}

let samples, bins; // of the analyser: kept, as pictures are many

let isSecond = false; // whether scopes are due, or what moves: thirty pictures a second are enough of either

function draw() {
  const style = getComputedStyle(document.documentElement);
  [accent, soft] = ["--accent", "--soft"].map(name => style.getPropertyValue(name));
  if (isSecond = !isSecond) drawScopes();
  else drawMotion();
  requestAnimationFrame(draw);
}

function drawScopes() {
  samples ||= new Float32Array(analyser.fftSize);
  bins ||= new Float32Array(analyser.frequencyBinCount);
  analyser.getFloatTimeDomainData(samples);
  analyser.getFloatFrequencyData(bins);
  let [g, w, h] = frameOf($("wave"));
  const count = 1024, first = Math.max(0, samples.findIndex((x, i) => i > 0 && samples[i - 1] < 0 && x >= 0));
  for (let i = 0; i < count; i += 2)
    g.lineTo(i / count * w, h / 2 * (1 - samples[Math.min(first + i, samples.length - 1)]));
  g.stroke();
  label(g, h, [[6, `${decimals(1000 * count / data.samplerate, 2)} ms, from -1 to 1 of full scale`]]);
  [g, w, h] = frameOf($("spectrum"));
  const top = data.samplerate / 2, octaves = Math.log2(top / 30);
  for (let x = 0; x < w; x++) {
    const bin = 30 * 2 ** (x / w * octaves) / top * bins.length;
    g.lineTo(x, (h - 18) * Math.min(1, Math.max(0, -bins[Math.min(bins.length - 1, Math.floor(bin))] / 110)));
  }
  g.stroke();
  label(g, h, [100, 1000, 10_000].map(f => [Math.log2(f / 30) / octaves * w, f < 1000 ? `${f} Hz` : `${f / 1000} kHz`]));
}

// Names of places along the lower edge of a picture.
function label(g, h, names) {
  g.fillStyle = soft;
  g.font = "11px system-ui, sans-serif";
  for (const [x, name] of names) g.fillText(name, x, h - 5);
}

// --- buttons

// Sliders stay where they are when the sound begins anew.
const movedRows = () => sliders.filter(slider => slider.isMoved).flatMap(slider => slider.rows());
const FADE_SECONDS = 0.05;
let isStopped = false, isScore = false; // whether the sound was stopped, and whether the score plays

function showPlay() {
  $("play").textContent = isScore ? "Stop" : "Play";
}

function play() {
  if (playing) send({ reset: true, rows: movedRows() });
  letAllUp();
  send({ song: data.song || [] });
  isScore = true;
  showPlay();
}

// Fade out, and rest until a key or Play asks for sound: what a bow does has no end of its own.
async function stop() {
  isScore = false;
  letAllUp();
  showPlay();
  if (!playing) return;
  await playing;
  isStopped = true;
  fader.gain.setTargetAtTime(0, context.currentTime, FADE_SECONDS / 4);
  setTimeout(() => { if (isStopped) context.suspend().catch(() => {}); }, 2000 * FADE_SECONDS);
}

// The sound begins anew after a stop, from rest.
function wake(node) {
  isStopped = false;
  fader.gain.cancelScheduledValues(0);
  fader.gain.value = 1;
  node.port.postMessage({ reset: true, rows: movedRows() });
}

$("play").onclick = () => isScore ? stop() : play();
$("damp").onclick = () => { // before anything sounds there is nothing to damp
  if (playing && !isStopped) send({ rows: data.damp.length ? data.damp : data.keys.flatMap(end) });
};
$("copy").onclick = async () => {
  try {
    await navigator.clipboard.writeText($("text").textContent);
    $("copy").textContent = "Copied";
  } catch {
    getSelection().selectAllChildren($("text"));
    $("copy").textContent = "Selected: copy it with the browser's menu";
  }
};

let isRecording = false, recordedFrom = 0, now = 0; // s
$("record").onclick = () => {
  isRecording = !isRecording;
  recordedFrom = now;
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
    const listen = () => access.inputs.forEach(input => { input.onmidimessage = event => hear(event, input.id); });
    access.onstatechange = ({ port }) => {
      if (port.type === "input" && port.state === "disconnected") letGoOfInput(port.id);
      listen();
    };
    listen();
    say(access.inputs.size ? "" : "No MIDI keyboard is connected; one that you plug in is heard.");
  } catch {
    say("The browser was not allowed to use MIDI; allow it for this page, and press the button again.");
  }
}

const heldByMidi = []; // presses of keys that have not been let go: [input, channel, key]
const NOTES_OFF = 120; // controllers from here on end notes or change modes, which ends them, too; 121 and 122 do not

function hear({ data: [status, number, value] }, input = "") {
  const kind = status & 0xf0, channel = status & 0x0f, key = data.keys.find(one => one.number === number);
  if (kind === 0x90 && value > 0 && key) {
    heldByMidi.push([input, channel, key]);
    press(key, value);
  } else if ((kind === 0x80 || kind === 0x90) && key) {
    const n = heldByMidi.findIndex(([from, on, one]) => from === input && on === channel && one === key);
    if (n >= 0) heldByMidi.splice(n, 1);
    release(key);
  } else if (kind === 0xe0) bend((number + 128 * value) / 8192 - 1);
  else if (kind === 0xb0 && number in data.pedals) movePedal(data.pedals[number], value);
  else if (kind === 0xb0 && number >= NOTES_OFF && number !== 121 && number !== 122) letGoOfInput(input, channel);
}

// Let go of what an input has pressed, on one channel or on all.
function letGoOfInput(input, channel) {
  for (let n = heldByMidi.length; n--;) {
    const [from, on, key] = heldByMidi[n];
    if (from !== input || (channel !== undefined && on !== channel)) continue;
    heldByMidi.splice(n, 1);
    release(key);
  }
}

$("midi").onclick = useMidi;
