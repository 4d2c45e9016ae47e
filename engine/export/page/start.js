// The beginning, when all else is defined.

async function start() {
  readAddress();
  say(missing());
  $("unfused").hidden = isFused || !!missing();
  if (!window.DecompressionStream) return;
  Object.assign(data, JSON.parse(new TextDecoder().decode(await unpack(data.controls))));
  if (data.keys.length) makeKeyboard();
  else makePads();
  makeSliders();
  makeMotion();
  listenToMessages();
  $("midi").hidden = !navigator.requestMIDIAccess || !data.keys.length;
}
const started = start();
started.then(unpackAll).catch(() => {}); // while nobody waits; what fails is said when it is asked for

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
