// Pads of hammers and plucks, and sliders.

const scaled = (pad, share) => pad.rows.map(row => {
  const changed = [...row];
  if (pad.is_hammer) changed[7] *= share;
  else if (row[6]) changed[6] *= share;
  return changed;
});

// The value of the rows of a slider, with the roundings of live sound (engine.export.row_recorder.Law).
function valueOfRows([shift, part, unit, compliance, most], value) {
  return compliance ? value / (1 - Math.min(value * compliance, most)) : (value - shift) / part / unit;
}

// The value of a slider at a value of its rows.
const valueOfSlider = ([shift, part, unit, compliance], row) =>
  compliance ? row / (1 + row * compliance) : row * unit * part + shift;

const sliderRows = (slider, value) => slider.rows.map(row =>
  row.map((x, j) => j === 6 ? valueOfRows(slider.law, value) : x));

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
    button.onpointerdown = event => { if (!event.button) strike(2 * velocityOf(event) / 127); };
    button.onkeydown = event => {
      if (!isPress(event)) return;
      event.preventDefault(); // no click follows
      if (!event.repeat) strike(1);
    };
    button.onkeyup = event => { if (isPress(event)) event.preventDefault(); };
    button.onclick = event => { if (!event.detail) strike(1); }; // of a screen reader, or a voice
    if (n < 9) document.addEventListener("keydown", event => {
      if (event.code === `Digit${n + 1}` && !event.repeat && !isTyped(event)) strike(1);
    });
    $("pads").append(button);
  });
  $("pads").hidden = !data.pads.length;
  if (data.pads.length) $("hint").textContent = "Lower on a pad is harder. The computer's keys 1 to 9 strike as the patch does.";
}

const sliders = []; // with the rows of a position, whether they were moved by hand, and where to
const REST_AFTER_MOVE = 400; // ms in which the score does not move a slider that somebody moves

// A path in words: contact.felt.stiffness is felt: stiffness.
const nameOf = path => {
  const words = path.split(".").map(word => word.replaceAll("_", " "));
  return words.length > 2 ? `${words.slice(1, -1).join(" ")}: ${words.at(-1)}` : words.join(": ");
};

function addSlider({ path, unit, label: given }, limits, valueOf, rowsOf, placeOf) {
  const row = document.createElement("div"), label = document.createElement("label"), name = given || nameOf(path);
  const input = document.createElement("input"), output = document.createElement("output");
  const back = document.createElement("button"), small = document.createElement("small");
  row.className = "slider";
  input.id = label.htmlFor = `slider ${path}`;
  small.textContent = path;
  label.append(name, small);
  back.textContent = "↺";
  back.title = "Back to the value of the patch";
  back.setAttribute("aria-label", `Back to the value of the patch: ${name}`);
  output.setAttribute("aria-live", "off"); // the score moves it
  Object.assign(input, { type: "range", ...limits });
  const put = place => {
    input.value = place;
    output.textContent = `${decimals(valueOf(+input.value), 3)} ${unit.replace("^exponent", "ᵅ")}`;
    input.setAttribute("aria-valuetext", output.textContent);
  };
  const move = place => {
    put(place);
    Object.assign(slider, { isMoved: true, movedTo: +input.value, movedAt: performance.now() });
    if (playing) send({ rows: slider.rows() });
  };
  const place = () => +input.value, slider = {
    path, placeOf, put, move, place, rows: () => rowsOf(slider.movedTo), isMoved: false, movedAt: -Infinity,
  };
  input.oninput = () => move(input.value);
  back.onclick = () => move(limits.value);
  put(limits.value);
  row.append(label, input, output, back);
  $("sliders").append(row);
  sliders.push(slider);
  return slider;
}

// Move sliders to where the score has their numbers. values: of rows, one of each glided slider
function followScore(values) {
  values.forEach((value, n) => {
    const { low, high, law } = data.sliders[n], slider = sliders[n];
    const place = slider.placeOf(Math.min(high, Math.max(low, valueOfSlider(law, value))));
    const off = Math.abs(place - slider.place()), all = Math.abs(slider.placeOf(high) - slider.placeOf(low));
    if (off > 1e-6 * all && performance.now() - slider.movedAt > REST_AFTER_MOVE) slider.put(place);
  });
}

let bend = () => {}; // the pitch wheel, from -1 to 1, if the page was made with one

function makeSliders() {
  $("sliders").hidden = !data.sliders.length && !data.table_sliders.length;
  for (const slider of data.sliders) {
    const toPlace = x => slider.is_logarithmic ? Math.log10(x) : x;
    const valueOf = place => slider.is_logarithmic ? 10 ** place : place;
    const limits = { min: toPlace(slider.low), max: toPlace(slider.high), step: "any", value: toPlace(slider.value) };
    addSlider(slider, limits, valueOf, place => sliderRows(slider, valueOf(place)), toPlace);
  }
  const tabled = data.table_sliders.map(slider => {
    const { values, home, rows, overlapping } = slider;
    const limits = { min: 0, max: values.length - 1, step: 1, value: home };
    // tables are made for one slider at a time: others that change the same ones go home before
    const goHome = m => {
      const other = tabled[m], { home, rows } = data.table_sliders[m];
      if (!other.isMoved) return [];
      other.put(home);
      other.isMoved = false;
      return [rows[home]];
    };
    return addSlider(slider, limits, place => values[place],
      place => [...overlapping.flatMap(goHome), rows[place]],
      value => values.reduce((best, one, i) => Math.abs(one - value) < Math.abs(values[best] - value) ? i : best, 0));
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
