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
  const n = voiceFor(key), voice = voices[n], other = voice.key, isNew = other !== key;
  const rows = atVelocity(data.voices[n].on[key.body], velocity);
  if (other && isNew) mark(other, false);
  Object.assign(voice, { key, since: ++pressed });
  down.add(key);
  send({
    voice: n, rows: isNew ? [key.tune[n], ...rows] : rows, steal: isNew ? data.voices[n].steal : [],
    frames: data.steal_frames,
  });
  mark(key, true);
}

// Damp the voice of a key, unless the key is down or a pedal keeps it.
function dampVoice(key) {
  const n = voices.findIndex(voice => voice.key === key);
  if (n < 0 || down.has(key) || kept.has(key) || isDown("sustain")) return;
  send({ voice: n, rows: data.voices[n].release, frames: data.release_frames });
}

function releaseVoice(key) {
  if (!takeBack(key)) return;
  dampVoice(key);
  mark(key, false);
}

function movePedalOfVoices(pedal, was) {
  if (was === isDown(pedal) || pedal === "soft") return;
  if (pedal === "sostenuto") {
    kept.clear();
    if (isDown(pedal)) down.forEach(key => kept.add(key));
  }
  voices.filter(({ key }) => key).forEach(({ key }) => dampVoice(key));
}
