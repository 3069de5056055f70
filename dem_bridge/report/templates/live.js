"use strict";
(() => {
  const digits = "⁰¹²³⁴⁵⁶⁷⁸⁹";
  const raised = (power) => (power < 0 ? "⁻" : "") + [...String(Math.abs(power))].map((digit) => digits[digit]).join("");
  function worded(value) {
    if (!Number.isFinite(value)) return "no value";
    if (value === 0 || (Math.abs(value) >= 1e-3 && Math.abs(value) < 1e5)) return String(Number(value.toPrecision(3))).replace("-", "−");
    const [front, power] = value.toExponential(2).split("e");
    return `${front.replace("-", "−")}×10${raised(Number(power))}`;
  }

  function read(figure) {
    const chain = JSON.parse(figure.dataset.chain);
    const bytes = Uint8Array.from(atob(chain.values), (letter) => letter.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    // row of a time, column of a body
    chain.at = (row, column) => {
      const whole = view.getInt16(2 * (row * chain.n + column), true);
      return whole === -32768 ? NaN : (whole / 32767) * chain.scale;
    };
    chain.stops = chain.colours.map((colour) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16)));
    return chain;
  }

  function colour(chain, value) {
    const last = chain.stops.length - 1;
    const place = Math.min(Math.max((value - chain.low) / (chain.high - chain.low), 0), 1) * last || 0;
    const k = Math.min(Math.floor(place), last - 1);
    return `rgb(${chain.stops[k].map((part, nth) => Math.round(part + (place - k) * (chain.stops[k + 1][nth] - part)))})`;
  }

  function start(live) {
    const figures = [...live.querySelectorAll(".view")], views = live.querySelector(".views");
    const player = live.querySelector(".player"), [button, slider, output] = player.children;
    const chains = new Map();
    let shown, chain, row = 0, column = 0, playing = 0;

    const part = (name) => shown.querySelector(name);
    const share = () => (chain.times[row] - chain.times[0]) / (chain.times.at(-1) - chain.times[0]);
    const when = () => `${chain.times[row]} ${chain.unit}`;

    function paint() {
      const canvas = part("canvas"), width = canvas.clientWidth, height = canvas.clientHeight;
      const pixels = devicePixelRatio || 1;
      canvas.width = width * pixels;
      canvas.height = height * pixels;
      const pen = canvas.getContext("2d");
      pen.scale(pixels, pixels);
      pen.strokeStyle = getComputedStyle(canvas).color;
      const radius = Math.max(1, Math.min((0.47 * width) / chain.n, 0.45 * height));
      const pitch = chain.lines ? 2.1 * radius : width / chain.n;
      for (let k = 0; k < chain.n; k++) {
        pen.beginPath();
        pen.arc((k + 0.5) * pitch, height / 2, radius, 0, 7);
        pen.fillStyle = colour(chain, chain.at(row, k));
        pen.fill();
        pen.lineWidth = 0.6;
        pen.stroke();
      }
    }

    function place() {
      slider.value = row;
      slider.setAttribute("aria-valuetext", when());
      const line = part(".cursor");
      line.style[chain.lines ? "left" : "bottom"] = `${100 * share()}%`;
      paint();
    }

    function say(text) {
      if (output.textContent !== text) output.textContent = text;
    }

    function tell() {
      if (chain.lines) {
        const all = Array.from({ length: chain.n }, (_, k) => `${k + chain.first}: ${worded(chain.at(row, k))}`);
        return say(`${when()}, ${chain.quantity} of ${chain.noun} ${all.join(", ")} m/s`);
      }
      let most = 0;
      for (let k = 1; k < chain.n; k++) if (Math.abs(chain.at(row, k)) > Math.abs(chain.at(row, most))) most = k;
      say(`${when()}: largest ${chain.quantity} ${worded(chain.at(row, most))} m/s, ${chain.noun} ${most + chain.first}`);
    }

    function point() {
      const pin = part(".pin");
      if (!chain.lines) {
        pin.hidden = false;
        pin.style.left = `${(100 * (column + 0.5)) / chain.n}%`;
        pin.style.bottom = `${100 * share()}%`;
      }
      if (chain.lines) return tell();
      say(`${chain.noun} ${column + chain.first} at ${when()}: ${chain.quantity} ${worded(chain.at(row, column))} m/s`);
    }

    function go(to) {
      row = Math.min(Math.max(to, 0), chain.times.length - 1);
      place();
    }

    function show(figure) {
      stop();
      const at = chain ? share() : 0.55;
      for (const other of figures) other.hidden = other !== figure;
      views?.querySelectorAll("button").forEach((one, nth) => one.setAttribute("aria-pressed", String(figures[nth] === figure)));
      shown = figure;
      figure.insertBefore(player, figure.querySelector("figcaption"));
      player.hidden = !figure.dataset.chain;
      if (player.hidden) return;
      if (!chains.has(figure)) chains.set(figure, prepare(figure));
      chain = chains.get(figure);
      slider.max = chain.times.length - 1;
      column = Math.min(column, chain.n - 1);
      part("canvas").hidden = false;
      go(Math.round(at * (chain.times.length - 1)));
      tell();
    }

    function prepare(figure) {
      const read_ = read(figure), frame = figure.querySelector(".frame");
      frame.insertAdjacentHTML("beforeend", '<i class="cursor"></i><i class="pin" hidden></i>');
      frame.tabIndex = 0;
      frame.setAttribute("role", "group");
      frame.setAttribute("aria-label", `${read_.quantity} over ${read_.noun} and time: the arrow keys read values`);
      frame.addEventListener("pointermove", (event) => {
        const box = frame.getBoundingClientRect();
        const x = (event.clientX - box.left) / box.width, y = 1 - (event.clientY - box.top) / box.height;
        const wanted = read_.times[0] + (read_.lines ? x : y) * (read_.times.at(-1) - read_.times[0]);
        let near = 0;
        read_.times.forEach((time, k) => {
          if (Math.abs(time - wanted) < Math.abs(read_.times[near] - wanted)) near = k;
        });
        column = Math.min(Math.max(Math.floor(x * read_.n), 0), read_.n - 1);
        stop();
        go(near);
        point();
      });
      frame.addEventListener("keydown", (event) => {
        const across = { ArrowLeft: -1, ArrowRight: 1 }[event.key] ?? 0, up = { ArrowDown: -1, ArrowUp: 1 }[event.key] ?? 0;
        if (!across && !up) return;
        event.preventDefault();
        stop();
        if (!read_.lines) column = Math.min(Math.max(column + across, 0), read_.n - 1);
        go(row + up + (read_.lines ? across : 0));
        point();
      });
      return read_;
    }

    function stop() {
      clearInterval(playing);
      playing = 0;
      button.textContent = "Play";
    }

    // 8 seconds from the first time to the last
    function play() {
      if (playing) return stop();
      if (row >= chain.times.length - 1) row = 0;
      button.textContent = "Pause";
      part(".pin").hidden = true;
      let at = row;
      playing = setInterval(() => {
        at += chain.times.length / 200;
        go(Math.round(at));
        tell();
        if (row >= chain.times.length - 1) stop();
      }, 40);
    }

    button.addEventListener("click", play);
    slider.addEventListener("input", () => {
      stop();
      go(Number(slider.value));
      part(".pin").hidden = true;
      tell();
    });
    if (views) {
      views.hidden = false;
      views.querySelectorAll("button").forEach((one, nth) => one.addEventListener("click", () => show(figures[nth])));
    }
    addEventListener("resize", () => player.hidden || place());
    show(figures[0]);
  }

  for (const live of document.querySelectorAll(".live")) start(live);

  // A row of the scale of errors says the values of all its dots.
  for (const figure of document.querySelectorAll(".errors")) {
    const output = figure.querySelector("output");
    for (const row of figure.querySelectorAll("li:not(.head, .foot)")) {
      const say = () => { output.textContent = `${row.firstElementChild.textContent}: ${row.querySelector(".spoken").textContent}`; };
      row.tabIndex = 0;
      row.addEventListener("pointerenter", say);
      row.addEventListener("focus", say);
    }
  }
})();
