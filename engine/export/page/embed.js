// A page in another one: what its address asks for, and messages from the page around it (docs/export.md, On your site).

const COLOURS = ["ink", "soft", "line", "card", "page", "accent", "on-accent"];

function readAddress() {
  const asked = new URLSearchParams(location.search);
  if (asked.has("embed")) document.body.classList.add("embed");
  for (const name of COLOURS) {
    const colour = asked.get(name);
    if (colour && CSS.supports("color", colour)) document.documentElement.style.setProperty(`--${name}`, colour);
  }
}

const orders = {
  play, stop,
  note_on({ key, velocity = 80 }) {
    const pressed = keyOfNumber(key);
    if (!(velocity >= 1 && velocity <= 127)) throw new Error(`velocity ${velocity}: from 1 to 127`);
    hold(`message ${key}`, pressed, velocity);
  },
  note_off: ({ key }) => letGoOf(`message ${keyOfNumber(key).number}`),
  pedal: ({ value }) => movePedal("sustain", value),
  strike({ pad, strength = 1 }) {
    const struck = data.pads.find(one => one.name === pad);
    if (!struck) throw new Error(`no pad is called ${pad}; there are: ${data.pads.map(one => one.name).join(", ")}`);
    send({ rows: scaled(struck, strength) });
  },
  set({ path, value }) {
    const slider = sliders.find(one => one.path === path);
    if (!slider) throw new Error(`no slider is called ${path}; there are: ${sliders.map(one => one.path).join(", ")}`);
    if (!Number.isFinite(value)) throw new Error(`value ${value}: a number is needed`);
    slider.move(slider.placeOf(value));
  },
};

function keyOfNumber(number) {
  const key = data.keys.find(one => one.number === number);
  if (!key) throw new Error(`there is no key ${number}`);
  return key;
}

// The page around this one, which may send { fdh: "note_on", key: 60, velocity: 90 } and so on.
function listenToMessages() {
  window.addEventListener("message", ({ source, data: message }) => {
    if (source !== window.parent || typeof message?.fdh !== "string") return;
    const answer = reply => source.postMessage(reply, "*");
    const order = Object.hasOwn(orders, message.fdh) && orders[message.fdh];
    if (!order) return answer({ fdh: "refused", why: `there is no ${message.fdh}; there are: ${Object.keys(orders).join(", ")}` });
    try {
      order(message);
    } catch (error) {
      answer({ fdh: "refused", why: error.message });
    }
  });
  if (window.parent === window) return;
  window.parent.postMessage({
    fdh: "ready",
    keys: data.keys.map(key => key.number),
    pads: data.pads.map(pad => pad.name),
    sliders: sliders.map(slider => slider.path),
  }, "*"); // it tells only what the page shows
}
