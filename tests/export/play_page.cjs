// Plays a page in Node, without a device: `node play_page.cjs PAGE FRAMES MESSAGES HASH`. MESSAGES: to the audio side, an
// expression of the page's script; HASH: of the page's address
// Prints what the page's fdh.render returns, and `isFused`: whether the page has nothing to say of its multiply-adds.
// What a browser has beyond Node is imitated here.
const { readFileSync } = require("fs");
const { runInThisContext } = require("vm");
const [page, frames, messages, hash] = process.argv.slice(2);
const html = readFileSync(page, "utf8");

// An object of which nothing is expected: whatever is asked of it, it is another, or zero.
const nothing = () => {
  const held = {};
  return new Proxy(() => nothing(), {
    get: (_, name) => name === Symbol.toPrimitive ? () => 0 : name in held ? held[name] : nothing(),
    set: (_, name, value) => { held[name] = value; return true; },
  });
};
const elements = {};
for (const [, id, text] of html.matchAll(/<script type="application\/json" id="(\w+)">(.*?)<\/script>/gs))
  elements[id] = { textContent: text };

globalThis.window = globalThis.parent = globalThis;
globalThis.document = { getElementById: id => elements[id] ||= nothing(), createElement: nothing,
  addEventListener() {}, body: nothing(), documentElement: nothing() };
Object.defineProperty(globalThis, "navigator", { value: {} });
globalThis.addEventListener = () => {};
globalThis.location = { hash, search: "" };
globalThis.isSecureContext = true;
globalThis.matchMedia = () => ({ matches: false });
globalThis.AudioContext = class {};
globalThis.AudioWorkletProcessor = class { port = { postMessage: () => {} }; };
let Processor;
globalThis.registerProcessor = (_, made) => { Processor = made; };
globalThis.AudioWorkletNode = class {
  constructor(context, _, { processorOptions }) {
    context.processor = new Processor({ processorOptions: structuredClone(processorOptions) });
    this.port = { set onmessage(hear) { context.processor.port.postMessage = data => hear({ data }); } };
  }
  connect() {}
};
globalThis.OfflineAudioContext = class {
  constructor(channels, length) {
    this.channels = Array.from({ length: channels }, () => new Float32Array(length));
    this.audioWorklet = { addModule: async url => (0, eval)(decodeURIComponent(url.slice(url.indexOf(",") + 1))) };
  }
  async startRendering() {
    const { length } = this.channels[0];
    for (let begin = 0; begin < length; begin += 128) {
      const block = this.channels.map(() => new Float32Array(128));
      this.processor.process([], [block]);
      block.forEach((samples, n) => this.channels[n].set(samples.subarray(0, length - begin), begin));
    }
    return { getChannelData: n => this.channels[n] };
  }
};

runInThisContext(html.slice(html.lastIndexOf("<script>") + 8, html.lastIndexOf("</script>")));
(async () => {
  await runInThisContext("started");
  const text = await window.fdh.render(+frames, JSON.stringify(runInThisContext(messages)));
  console.log(JSON.stringify({ ...JSON.parse(text), isFused: elements.unfused.hidden }));
})();
