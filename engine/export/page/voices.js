// Keys of a patch that is no instrument: voices, each of which can have any pitch (engine.live.voice_allocator).

const voices = []; // of each: the key that it has, and when that was pressed last
let pressed = 0; // keys so far

// The voice for a key: the one that has it; else the oldest of those whose keys are up, or of all.
function voiceFor(key) {
  const mine = voices.findIndex(voice => voice.key === key);
  if (mine >= 0) return mine;
  const isFree = voice => !voice.key || !down.has(voice.key), free = voices.filter(isFree);
  return voices.indexOf((free.length ? free : voices).reduce((a, b) => b.since < a.since ? b : a));
}

function pressVoice(key, velocity) {
  while (voices.length < data.voices.length) voices.push({ key: null, since: 0 });
  const n = voiceFor(key), { on, steal } = data.voices[n], voice = voices[n], other = voice.key;
  let rows = atVelocity(on[key.body], velocity);
  if (other !== key) rows = [key.tune[n], ...rows];
  if (other && other !== key) { // the note begins when the last one is damped
    rows = [...steal, ...rows.map(row => [...row.slice(0, 4), row[4] + data.steal_frames, ...row.slice(5)])];
    down.delete(other);
    mark(other, false);
  }
  Object.assign(voice, { key, since: ++pressed });
  down.add(key);
  send({ rows });
  mark(key, true);
}

// Rows that damp the voice of a key, unless it is down or a pedal keeps it.
function dampVoice(key) {
  const n = voices.findIndex(voice => voice.key === key);
  return n < 0 || down.has(key) || kept.has(key) || isDown("sustain") ? [] : data.voices[n].release;
}

function releaseVoice(key) {
  if (!down.delete(key)) return;
  send({ rows: dampVoice(key) });
  mark(key, false);
}

function movePedalOfVoices(pedal, was) {
  if (was === isDown(pedal) || pedal === "soft") return;
  if (pedal === "sostenuto") {
    kept.clear();
    if (isDown(pedal)) down.forEach(key => kept.add(key));
  }
  send({ rows: voices.filter(({ key }) => key).flatMap(({ key }) => dampVoice(key)) });
}
