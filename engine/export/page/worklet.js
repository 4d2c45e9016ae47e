// The audio side of a page: the kernels of fdh-engine in WebAssembly play the memory of a player of the engine.
// This script only moves numbers: it writes events into the player's queue, lets the kernel play, and reads meters.

// A multiply-add that can be replaced in its place (engine.compiler.wasm_multiply_add); its bytes 4 to 6 name a local.
const FUSED = [0xfd, 0x87, 0x02, 0x41, null, null, null, 0x1a, 1, 1, 1, 1, 1, 1];

// Multiply and then add wherever a module would fuse the two, which this browser cannot.
function replaceFused(module) {
  for (let at = module.indexOf(0xfd); at >= 0; at = module.indexOf(0xfd, at + 1)) {
    if (!FUSED.every((byte, n) => byte === null || byte === module[at + n])) continue;
    const local = module.subarray(at + 4, at + 7);
    module.set([0x21, ...local, 0xfd, 0xf2, 0x01, 0x20, ...local, 0xfd, 0xf0, 0x01], at);
  }
}

// Rows that begin so many frames later.
const delayed = (rows, frames) => rows.map(row => [...row.slice(0, 4), row[4] + frames, ...row.slice(5)]);

class Patch extends AudioWorkletProcessor {
  constructor({ processorOptions: o }) {
    super();
    this.o = o;
    const { at, names } = o, room = (o.base + o.size + 63) & ~63, bytes = 4 * o.block * o.channels;
    const memory = new WebAssembly.Memory({ initial: Math.ceil((room + bytes) / 65536) });
    const table = new WebAssembly.Table({ initial: 4, element: "anyfunc" });
    if (!o.isFused) replaceFused(o.kernel);
    const module = new WebAssembly.Module(o.kernel), env = {
      __linear_memory: memory,
      __indirect_function_table: table,
      __stack_pointer: new WebAssembly.Global({ value: "i32", mutable: true }, o.base), // it grows down from here
      clock_gettime: () => 0,
    };
    this.x = new WebAssembly.Instance(module, { env }).exports;
    for (const name of ["render", "insert"]) table.set(o.functions[name], this.x[name]);
    const view = (type, place, count) => new type(memory.buffer, place, count);
    this.memory = view(Uint8Array, o.base, o.size);
    this.counters = view(BigInt64Array, at.counters, Object.keys(names.Slot).length);
    this.gauges = view(Float64Array, at.gauges, Object.keys(names.Gauge).length);
    this.events = view(BigInt64Array, at.events, at.queue * at.event);
    this.values = view(Float64Array, at.values, at.queue * at.values_per_event);
    this.balance = view(Float64Array, at.balance, Object.keys(names.Balance).length);
    this.sleep = view(BigInt64Array, at.sleep, at.islands * at.rest);
    this.iterations = view(BigInt64Array, at.iterations, at.islands * at.solves);
    this.force = view(Float64Array, at.force, at.contacts);
    this.q = view(Float64Array, at.q, at.modes);
    this.p = view(Float64Array, at.p, at.modes);
    this.omegaSquared = view(Float64Array, at.omega_squared, at.modes);
    this.numbers = view(Float64Array, 0, memory.buffer.byteLength / 8);
    this.flight = view(BigInt64Array, at.flight, at.islands * o.motion.flight[0]);
    this.touches = new Set(); // places that were touched since the last report
    this.out = view(Float32Array, room, o.block * o.channels);
    this.call = [BigInt(at.memory), BigInt(room)];
    this.now = globalThis.performance ? () => performance.now() : Date.now;
    this.gain = o.gain;
    this.recorded = null;
    this.reset();
    for (const message of o.messages) this.take(message);
    this.port.onmessage = ({ data }) => this.take(data);
  }
  // Back to the first sample.
  reset() {
    this.memory.set(this.o.scene);
    this.messages = []; // that come at a frame
    this.waiting = []; // rows, which go into the queue at once, in their order …
    this.song = []; // … and rows that go there soon before they begin
    this.voices = []; // of each: by how many frames its note began later, and the frame from which it is quiet
    this.gauges[this.o.names.Gauge.GAIN] = this.gain;
    this.frame = 0;
    this.quality = this.limited = this.ease = 0;
    this.solves = new Float64Array(this.o.at.solves);
    this.clearMeters();
  }
  clearMeters() {
    this.spent = this.frames = this.largestForce = 0;
  }
  take(message) {
    if (message.at > this.frame) return void this.messages.push(message);
    if (message.reset) this.reset();
    if (message.gain !== undefined) this.gauges[this.o.names.Gauge.GAIN] = this.gain = message.gain;
    if (message.record) this.recorded = [];
    if (message.keep && this.recorded) {
      this.port.postMessage({ recorded: this.recorded });
      this.recorded = null;
    }
    const { rows, song, voice } = message;
    if (rows) this.waiting.push(...delayed(voice === undefined ? rows : this.rowsOfVoice(message), this.frame));
    if (song) this.song = [...this.song, ...delayed(song, this.frame)].sort((a, b) => a[4] - b[4]);
  }
  // Rows of a voice that gets a note, or that is released: without `steal`. A note begins when the last one is damped, and
  // ends as much later (engine.live.voice_allocator). frames: that the damper takes
  rowsOfVoice({ voice, rows, steal, frames }) {
    const known = this.voices[voice] ||= { delay: 0, quiet: 0 };
    if (!steal) {
      known.quiet = Math.min(known.quiet, this.frame + known.delay + frames);
      return delayed(rows, known.delay);
    }
    known.delay = steal.length && known.quiet > this.frame ? frames : 0;
    known.quiet = Infinity;
    return known.delay ? [...steal, ...delayed(rows, known.delay)] : rows;
  }
  // Take messages that come at a frame.
  takeDue() {
    const due = this.messages.filter(message => message.at <= this.frame);
    if (due.length) this.messages = this.messages.filter(message => message.at > this.frame);
    due.forEach(({ at, ...message }) => this.take(message));
  }
  // Write rows into the player's queue, as many as it has room for.
  sendEvents() {
    const soon = this.song.findIndex(row => row[4] >= this.frame + 8 * this.o.block);
    this.waiting.push(...this.song.splice(0, soon < 0 ? this.song.length : soon));
    let sent = 0;
    while (sent < this.waiting.length && this.sendEvent(this.waiting[sent])) sent++;
    this.waiting.splice(0, sent);
  }
  // Write a row into the player's queue. Returns whether there was room.
  sendEvent(row) {
    const { Slot } = this.o.names, { queue, event } = this.o.at, { counters } = this, index = counters[Slot.WRITE_INDEX];
    if (index - counters[Slot.READ_INDEX] >= BigInt(queue)) return false;
    const slot = Number(index % BigInt(queue));
    for (let i = 0; i < event; i++) this.events[slot * event + i] = i < 6 ? BigInt(Math.round(row[i])) : 0n;
    const { note, release, table, values_per_event } = this.o.at;
    this.events[slot * event + note] = BigInt(row[9]);
    this.events[slot * event + release] = BigInt(row[10]);
    this.events[slot * event + table] = BigInt(row[11] || 0); // of an exchange: where its copies are
    for (let i = 0; i < values_per_event; i++) this.values[values_per_event * slot + i] = row[6 + i];
    counters[Slot.WRITE_INDEX] = index + 1n;
    return true;
  }
  process(inputs, [out]) {
    const { channels } = this.o, frames = out[0].length, begin = this.now();
    this.takeDue();
    this.sendEvents();
    for (let done = 0; done < frames;) {
      const count = Math.min(frames - done, this.o.block);
      this.x.play(...this.call, BigInt(count));
      for (let c = 0; c < out.length; c++) {
        const to = out[c], from = c % channels;
        for (let i = 0; i < count; i++) to[done + i] = this.out[i * channels + from];
      }
      if (this.recorded) this.recorded.push(this.out.slice(0, count * channels));
      done += count;
      this.frame += count;
      for (const f of this.force) if (f > this.largestForce) this.largestForce = f;
      this.o.motion.touched.forEach(({ contact }, n) => {
        if (this.force[contact] !== 0) this.touches.add(n);
      });
    }
    this.spent += this.now() - begin;
    this.frames += frames;
    if (this.frames >= 2048) this.report();
    return true;
  }
  report() {
    const { at, names } = this.o, { gauges, balance, counters } = this, { Gauge, Balance, Slot, Sleep } = names;
    const load = this.spent / 1000 / (this.frames / this.o.samplerate), awake = [];
    for (let n = 0; n < at.islands; n++) if (this.sleep[n * at.rest + Sleep.WAKE_FRAME] <= this.frame) awake.push(n);
    this.adapt(load);
    this.port.postMessage({
      level: gauges[Gauge.PEAK],
      load,
      awake: awake.length,
      error: balance[Balance.LARGEST] > 0 ? balance[Balance.MAX_ERROR] / balance[Balance.LARGEST] : 0,
      iterations: this.meanIterations(),
      limited: Number(counters[Slot.LIMITED_SAMPLES]),
      silenced: Number(counters[Slot.NONFINITE_SAMPLES]),
      quality: this.quality,
      force: this.largestForce,
      seconds: this.frame / this.o.samplerate,
      motion: this.motion(),
      values: this.o.places.map(([address, shift, unit]) => (this.numbers[address / 8] - shift) / unit),
    });
    this.touches.clear();
    gauges[Gauge.PEAK] = 0;
    this.clearMeters();
  }
  // The modes of the bodies that move most, at the end of a flight if their island flies, and what has touched them.
  motion() {
    const { bodies, flight: [columns, end], most } = this.o.motion;
    const energies = bodies.map(({ modes }) =>
      modes.reduce((sum, m) => sum + this.p[m] ** 2 + this.omegaSquared[m] * this.q[m] ** 2, 0));
    const chosen = bodies.map((_, n) => n).sort((a, b) => energies[b] - energies[a] || a - b).slice(0, most);
    const moving = chosen.sort((a, b) => a - b).map(body => {
      const { modes, island } = bodies[body], until = Number(this.flight[island * columns + end]);
      const omega = modes.map(m => Math.sqrt(this.omegaSquared[m])); // as it is now, for pitches glide
      return {
        body,
        omega,
        q: modes.map(m => this.q[m]),
        r: modes.map((m, n) => this.p[m] / omega[n]),
        seconds: Math.max(this.frame, until) / this.o.samplerate,
      };
    });
    return { bodies: moving, touches: [...this.touches] };
  }
  // Mean of the rounds of the contact solves since the last report.
  meanIterations() {
    const { at } = this.o;
    let rounds = 0, solves = 0;
    for (let n = 0; n < at.solves; n++) {
      let count = 0;
      for (let island = 0; island < at.islands; island++) count += Number(this.iterations[island * at.solves + n]);
      rounds += n * (count - this.solves[n]);
      solves += count - this.solves[n];
      this.solves[n] = count;
    }
    return solves ? rounds / solves : 0;
  }
  // A page that is too slow gets coarser before it breaks, as live sound does.
  adapt(load) {
    if (!this.o.isLive || this.frame < this.o.samplerate) return; // at first, the browser still compiles
    this.ease = load < 0.4 ? this.ease + this.frames : 0;
    const before = this.quality;
    if (load > 0.85) this.quality++;
    else if (this.ease > this.o.samplerate && this.quality) this.quality--;
    if (this.quality === before) return;
    this.quality = Math.min(this.quality, this.o.coarsest);
    this.ease = 0;
    this.waiting.unshift([this.o.names.EventKind.QUALITY, 0, this.quality, 0, this.frame, 0, 0, 0, 0, 0, 0]);
  }
}
registerProcessor("fdh-patch", Patch);
