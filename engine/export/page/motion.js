// What moves, seen through a stroboscope: each body by its lowest modes, as they are at the moment (engine.export.motion).

const SWINGS = 0.8; // a second, of the lowest mode as it is drawn
const FIGURES = 8; // bodies that are drawn at a time
const figures = []; // canvases with their captions
const sizes = new Map(); // of a body: the largest displacement now, and since the sound began, m
let moving = []; // what the audio side told last
const touches = new Map(); // when each place was touched, ms

function makeMotion() {
  const { bodies, shapes, touched } = data.motion;
  const off = (a, b) => Array.isArray(a) ? Math.hypot(a[0] - b[0], a[1] - b[1]) : Math.abs(a - b);
  for (const touch of touched) {
    const { places } = shapes[bodies[touch.body].shape];
    touch.nearest = places.reduce((best, one, i) => off(one, touch.place) < off(places[best], touch.place) ? i : best, 0);
  }
  $("motion").hidden = !bodies.length;
  for (let n = 0; n < Math.min(FIGURES, bodies.length); n++) {
    const figure = document.createElement("figure"), canvas = document.createElement("canvas");
    const caption = document.createElement("figcaption");
    canvas.setAttribute("aria-hidden", "true");
    figure.append(canvas, caption);
    $("motion").append(figure);
    figures.push({ canvas, caption });
    caption.textContent = bodies[n].name.replaceAll("_", " ");
  }
}

function takeMotion(told) {
  moving = told.bodies;
  for (const number of told.touches) touches.set(number, performance.now());
  moving.forEach(({ body }, n) => {
    figures[n].caption.textContent = `${data.motion.bodies[body].name.replaceAll("_", " ")}, ${lengthText(sizes.get(body)?.[0] || 0)}`;
  });
}

// Displacements of a body at its places, m: as it was at a moment, turned on by less than half a period to the phase that
// a stroboscope shows. Partials of a string have one stroboscope, those of a plate one each.
function shapeOf(body, { q, r, omega, seconds }, shown) {
  const { scales, is_harmonic } = body, { places, values } = data.motion.shapes[body.shape];
  const heights = new Float64Array(places.length);
  for (let n = 0; n < q.length; n++) {
    const reference = omega[is_harmonic ? 0 : n];
    const turns = SWINGS * shown * reference / omega[0] - reference * seconds / (2 * Math.PI);
    const angle = 2 * Math.PI * omega[n] / reference * (turns - Math.round(turns));
    const size = scales[n] * (q[n] * Math.cos(angle) + r[n] * Math.sin(angle));
    for (let i = 0; i < heights.length; i++) heights[i] += size * values[n][i];
  }
  return heights;
}

const lengthText = x => x < 1e-6 ? "at rest" : x < 1e-3 ? `${+(1e6 * x).toPrecision(2)} µm` : `${+(1e3 * x).toPrecision(2)} mm`;

function drawMotion() {
  const shown = CALM ? 0.25 / SWINGS : performance.now() / 1000;
  moving.forEach((state, n) => {
    const body = data.motion.bodies[state.body], shapes = data.motion.shapes[body.shape];
    const heights = shapeOf(body, state, shown), peak = heights.reduce((m, x) => Math.max(m, Math.abs(x)), 0);
    const [size, most] = sizes.get(state.body) || [0, 0], now = Math.max(peak, 0.97 * size), all = Math.max(now, most);
    sizes.set(state.body, [now, all]);
    const factor = now > 1e-9 && !isStopped ? (now / all) ** 0.3 / now : 0; // what is quiet can still be seen
    const [g, w, h] = frameOf(figures[n].canvas);
    const at = shapes.columns ? onSheet(w, h) : onLine(w, h);
    const points = shapes.places.map((place, i) => at(place, factor * heights[i]));
    if (shapes.columns) drawGrid(g, shapes, points);
    else points.forEach(point => g.lineTo(...point));
    g.stroke();
    drawTouches(g, state.body, points);
  });
}

const onLine = (w, h) => (x, height) => [8 + x * (w - 16), h * (0.5 - 0.4 * height)];
const onSheet = (w, h) => ([x, y], height) => [8 + (x + 0.4 * y) / 1.4 * (w - 16), h * (0.8 - 0.45 * y - 0.22 * height)];

function drawGrid(g, { columns, numbers }, points) {
  const byNumber = new Map(numbers.map((number, i) => [number, points[i]]));
  for (const [number, point] of byNumber) {
    const right = (number + 1) % columns && byNumber.get(number + 1), below = byNumber.get(number + columns);
    for (const other of [right, below].filter(Boolean)) {
      g.moveTo(...point);
      g.lineTo(...other);
    }
  }
}

// Dots where something touches, for a moment.
function drawTouches(g, number, points) {
  g.fillStyle = g.strokeStyle;
  for (const [touch, at] of touches) {
    const { body, nearest } = data.motion.touched[touch], age = performance.now() - at;
    if (age > 300) touches.delete(touch);
    if (body !== number || age > 300) continue;
    g.globalAlpha = 1 - age / 300;
    g.beginPath();
    g.arc(...points[nearest], 5, 0, 2 * Math.PI);
    g.fill();
  }
  g.globalAlpha = 1;
}
