// The keys and pedals of an instrument.

// Rows between those of two velocities, of which the page has a few.
function atVelocity(rowsOn, velocity) {
  const { levels } = data;
  const v = Math.min(levels[levels.length - 1], Math.max(levels[0], velocity));
  let n = levels.findIndex(level => level >= v);
  if (levels[n] === v) return rowsOn[n];
  const a = rowsOn[n - 1], b = rowsOn[n], share = (v - levels[n - 1]) / (levels[n] - levels[n - 1]);
  if (a.length !== b.length) return share < 0.5 ? a : b;
  const { EXCHANGE_TABLES } = data.names.EventKind, between = (row, other) =>
    row[0] === EXCHANGE_TABLES ? share < 0.5 ? row : other : row.map((x, j) => j < 6 ? x : x + share * (other[j] - x));
  return a.map((row, i) => between(row, b[i]));
}

// --- keys and pedals, as live sound has them (engine.live.key_allocator)

const down = new Set(), kept = new Set(); // keys that are down, and those that the sostenuto pedal keeps
const pedals = { sustain: 0, sostenuto: 0, soft: 0 }; // how far down, 0 to 127
const presses = new Map(); // how often a key that is down was pressed: it is held as often
const velocities = new Map(); // with which keys were pressed last
let sounding = []; // keys whose dampers have not ended them, the oldest first

const isDown = pedal => pedals[pedal] >= data.pedal_down;

// Rows of a key that is let go, but for its dampers.
function letGo(key) {
  const off = isDown("soft") && key.soft_on.length ? key.soft_off : key.off;
  return off.length > 1 ? atVelocity(off, velocities.get(key)) : off[0];
}

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
  return [...rows, ...damp(key), ...key.steal]; // of two dampers the newer counts, and the other goes on
}

// Takes one press of a key back. Returns whether the key comes up.
function takeBack(key) {
  if (!down.has(key)) return false;
  presses.set(key, presses.get(key) - 1);
  return presses.get(key) < 1 && down.delete(key);
}

function press(key, velocity) {
  presses.set(key, (down.has(key) ? presses.get(key) : 0) + 1);
  if (data.voices.length) return pressVoice(key, velocity);
  const rows = down.has(key) ? [...letGo(key)] : [];
  const inGroup = other => other !== key && key.group !== null && other.group === key.group;
  for (const other of [...down].filter(inGroup)) {
    down.delete(other);
    rows.push(...letGo(other), ...damp(other));
    mark(other, false);
  }
  let others = sounding.filter(other => other !== key);
  while (others.length >= data.polyphony) {
    const oldest = others.find(other => !down.has(other)) || others[0];
    rows.push(...end(oldest));
    others = others.filter(other => other !== oldest);
  }
  sounding = [...others, key];
  down.add(key);
  velocities.set(key, velocity);
  rows.push(...atVelocity(isDown("soft") && key.soft_on.length ? key.soft_on : key.on, velocity));
  send({ rows });
  mark(key, true);
}

function release(key) {
  if (data.voices.length) return releaseVoice(key);
  if (!takeBack(key)) return;
  send({ rows: [...letGo(key), ...damp(key)] });
  mark(key, false);
}

function movePedal(pedal, value) {
  const was = isDown(pedal), share = data.shares[pedals.sustain], before = [...kept];
  pedals[pedal] = value;
  showPedals();
  if (data.voices.length) return movePedalOfVoices(pedal, was);
  let moved = [];
  if (pedal === "sustain" && share !== data.shares[value]) moved = data.keys;
  if (pedal === "sostenuto" && was !== isDown(pedal)) {
    kept.clear();
    if (isDown(pedal)) down.forEach(key => kept.add(key));
    moved = before;
  }
  const free = moved.filter(key => !down.has(key) && !kept.has(key));
  if (free.length) send({ rows: free.flatMap(key => data.shares[pedals.sustain] ? damp(key) : key.lift) });
}

// All keys and pedals come up; nothing is sent.
function letAllUp() {
  held.clear();
  down.forEach(key => mark(key, false));
  down.clear();
  kept.clear();
  sounding = [];
  voices.length = 0;
  for (const pedal in pedals) pedals[pedal] = 0;
  showPedals();
}

function showPedals() {
  for (const pedal in pedals) $(pedal).setAttribute("aria-pressed", isDown(pedal));
  $("depth").value = pedals.sustain;
}

function makePedals() {
  const isTuned = data.voices.length > 0, hasDampers = isTuned || data.keys.some(key => key.lift.length);
  const isSoftened = !isTuned && data.keys.some(key => key.soft_on.length);
  $("sustain").hidden = $("sostenuto").hidden = !hasDampers;
  $("depth-label").hidden = !hasDampers || isTuned;
  $("soft").hidden = !isSoftened;
  $("pedals").hidden = !hasDampers && !isSoftened;
  for (const pedal in pedals) $(pedal).onclick = () => movePedal(pedal, isDown(pedal) ? 0 : 127);
  $("depth").oninput = () => movePedal("sustain", +$("depth").value);
  if (!hasDampers) return;
  document.addEventListener("keydown", event => {
    if (event.key !== "Shift" || event.repeat) return;
    isShiftDown = true;
    movePedal("sustain", 127);
  });
  document.addEventListener("keyup", event => {
    if (event.key !== "Shift" || !isShiftDown) return;
    isShiftDown = false;
    movePedal("sustain", 0);
  });
  $("hint").textContent += " Shift is the pedal.";
}

// --- what holds keys: a finger, a key of the computer, a cable; each lets go of what it has pressed, wherever that ends

const held = new Map(); // by what holds it: the key

function hold(source, key, velocity) {
  if (held.has(source)) return;
  held.set(source, key);
  press(key, velocity);
}

function letGoOf(source) {
  const key = held.get(source);
  if (!held.delete(source)) return;
  release(key);
}

function letGoOfAll(kind) {
  for (const source of [...held.keys()]) if (source.startsWith(kind)) letGoOf(source);
}

const elements = new Map();

function mark(key, isDown) {
  elements.get(key)?.classList.toggle("down", isDown);
  elements.get(key)?.setAttribute("aria-pressed", isDown);
}

// Show which keys the score has down.
function lightScore(seconds) {
  const lit = new Set();
  if (isScore) for (const [key, from, to] of data.song_notes || []) if (from <= seconds && seconds < to) lit.add(key);
  for (const [key, button] of elements) button.classList.toggle("lit", lit.has(key.number));
}

// How far up a button was touched, as a velocity of MIDI: the lower, the louder, as on a key.
function velocityOf(event, button = event.currentTarget) {
  const box = button.getBoundingClientRect();
  return Math.round(20 + 107 * Math.min(1, Math.max(0, (event.clientY - box.top) / box.height)));
}

const isTyped = event => event.target.matches?.("input:not([type=range]), textarea, select");
const isPress = event => [" ", "Enter"].includes(event.key);
const hardness = () => +$("hardness").value;

// A finger or the mouse, which may be drawn over several keys.
function listenToFingers(box, keyOf) {
  const touch = event => {
    const button = document.elementFromPoint(event.clientX, event.clientY)?.closest?.(".keys button");
    const key = button && keyOf.get(button), source = `finger ${event.pointerId}`;
    if (held.get(source) === key) return;
    letGoOf(source);
    if (key) hold(source, key, velocityOf(event, button));
  };
  box.onpointerdown = event => {
    if (event.button) return;
    box.setPointerCapture(event.pointerId);
    touch(event);
  };
  box.onpointermove = event => { if (box.hasPointerCapture(event.pointerId)) touch(event); };
  box.onpointerup = box.onpointercancel = box.onlostpointercapture = event => letGoOf(`finger ${event.pointerId}`);
}

// Keys of the computer by their places, whatever is written on them.
function listenToComputerKeys(keyAt) {
  document.addEventListener("keydown", event => {
    if (event.repeat || event.ctrlKey || event.metaKey || event.altKey || isTyped(event)) return;
    const key = keyAt(COMPUTER_KEYS.indexOf(event.code));
    if (key) hold(`code ${event.code}`, key, hardness());
  });
  document.addEventListener("keyup", event => letGoOf(`code ${event.code}`));
  const leave = () => { // what is let go elsewhere is not heard of here
    letGoOfAll("code ");
    letGoOfAll("finger ");
    if (isShiftDown) movePedal("sustain", 0);
    isShiftDown = false;
  };
  window.addEventListener("blur", leave);
  document.addEventListener("visibilitychange", () => { if (document.hidden) leave(); });
}

let isShiftDown = false; // which is a pedal

function makeKeyboard() {
  const box = document.createElement("div"), { keys } = data, keyOf = new Map();
  const isChromatic = keys.length > 1 && keys.every((key, i) => key.number === keys[0].number + i);
  box.className = "keys";
  for (const key of keys) {
    const button = document.createElement("button"), isBlack = [1, 3, 6, 8, 10].includes(key.number % 12);
    button.className = !isChromatic ? "plain" : isBlack ? "black" : "white";
    button.textContent = !isChromatic || key.number % 12 === 0 ? key.name : "";
    button.setAttribute("aria-label", key.name);
    button.setAttribute("aria-pressed", "false");
    button.tabIndex = -1;
    button.onkeydown = event => {
      if (!isPress(event)) return;
      event.preventDefault(); // no click follows
      if (!event.repeat) hold(`code ${event.code}`, key, hardness());
    };
    button.onkeyup = event => { if (isPress(event)) event.preventDefault(); };
    button.onclick = event => { // of a screen reader, or a voice: there is no finger
      if (event.detail) return;
      hold(`click ${key.number}`, key, hardness());
      setTimeout(() => letGoOf(`click ${key.number}`), 400);
    };
    elements.set(key, button);
    keyOf.set(button, key);
    box.append(button);
  }
  $("keyboard").append(box);
  $("keyboard").hidden = $("octaves").hidden = false;
  const middle = keys.reduce((a, b) => Math.abs(b.number - 60) < Math.abs(a.number - 60) ? b : a);
  elements.get(middle).tabIndex = 0; // one stop of Tab; arrows go on from there
  box.onkeydown = event => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key], buttons = [...box.children];
    const next = step && buttons[buttons.indexOf(document.activeElement) + step];
    if (!next) return;
    buttons.forEach(button => { button.tabIndex = button === next ? 0 : -1; });
    next.focus();
    event.preventDefault();
  };
  const octave = isChromatic ? 12 : 7;
  let first = Math.max(0, keys.findIndex(key => key.number >= 48 && key.number % 12 === 0));
  const show = () => {
    const letters = [...box.querySelectorAll("[data-letter]")];
    letters.forEach(button => button.removeAttribute("data-letter"));
    COMPUTER_KEYS.forEach((code, n) => {
      if (keys[first + n]) elements.get(keys[first + n]).dataset.letter = letterOf(code);
    });
    $("lower").disabled = first <= 0;
    $("higher").disabled = first + octave >= keys.length;
  };
  const shift = step => {
    letGoOfAll("code ");
    first += step; // below 0 the first letters have no key, and Z stays a C
    $("keyboard").scrollTo({ left: elements.get(keys[Math.max(0, first)]).offsetLeft - 8, behavior: CALM ? "auto" : "smooth" });
    show();
  };
  $("lower").onclick = () => shift(-octave);
  $("higher").onclick = () => shift(octave);
  $("keyboard").scrollLeft = elements.get(middle).offsetLeft - $("keyboard").clientWidth / 2;
  listenToFingers(box, keyOf);
  listenToComputerKeys(n => n < 0 ? undefined : keys[first + n]);
  show();
  navigator.keyboard?.getLayoutMap?.().then(map => { // what this computer has written there
    layout = map;
    show();
  }, () => {});
  $("hint").textContent = "Lower on a key is louder. The computer's keys play too, by their places: two rows each of keys.";
  makePedals();
}

let layout = new Map();
const letterOf = code => (layout.get(code) || code.replace(/^(Key|Digit)/, "")).toUpperCase();
