// Hovering reads values off the drawings, dragging looks closer, switches hide runs
// and curves. The page is complete without it.
(function () {
  "use strict";
  const readout = document.getElementById("readout");
  const svgns = "http://www.w3.org/2000/svg";
  const numbers = (text) => text.trim().split(/\s+/).map(Number);

  // Three significant digits, or as many decimals as a pixel is worth.
  function shown(value, perPixel) {
    const decimals = Math.min(6, Math.max(0, Math.ceil(-Math.log10(perPixel))));
    return value.toFixed(decimals).replace("-", "\u2212");
  }

  // The ordinate of a drawn line at an abscissa, both in tenths of a pixel.
  function lineAt(series, x) {
    for (const line of series.querySelectorAll("polyline")) {
      const points = line.readings || (line.readings = numbers(line.getAttribute("points").replace(/,/g, " ")));
      const last = points.length - 2;
      if (last < 2 || x < points[0] || x > points[last]) continue;
      let low = 0;
      let high = last / 2;
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (points[2 * middle] <= x) low = middle; else high = middle;
      }
      const span = points[2 * high] - points[2 * low];
      const share = span > 0 ? (x - points[2 * low]) / span : 0;
      return points[2 * low + 1] + share * (points[2 * high + 1] - points[2 * low + 1]);
    }
    return null;
  }

  function hide() {
    readout.hidden = true;
    for (const hair of document.querySelectorAll(".hair")) hair.remove();
  }

  function place(event, text) {
    readout.textContent = text;
    readout.hidden = false;
    const room = document.documentElement.clientWidth;
    const width = readout.offsetWidth;
    const left = event.clientX + 14 + width > room ? event.clientX - 14 - width : event.clientX + 14;
    readout.style.left = Math.max(4, left) + window.scrollX + "px";
    readout.style.top = event.clientY + 14 + window.scrollY + "px";
  }

  function hover(event) {
    const svg = event.currentTarget;
    hide();
    const cell = event.target.closest(".cell");
    if (cell) return place(event, cell.dataset.text);
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    for (const panel of svg.querySelectorAll(".panel")) {
      const [left, top, right, bottom] = numbers(panel.dataset.area);
      if (at.x < left || at.x > right || at.y < top || at.y > bottom) continue;
      const [x0, x1] = numbers(panel.dataset.x);
      const [y0, y1] = numbers(panel.dataset.y);
      const lines = [];
      for (const series of panel.querySelectorAll(".series[data-label]:not(.off)")) {
        const y = lineAt(series, at.x);
        if (y === null) continue;
        const value = y0 + (bottom - y) / (bottom - top) * (y1 - y0);
        lines.push([Math.abs(y - at.y), series.dataset.label + ": " + shown(value, (y1 - y0) / (bottom - top))]);
      }
      if (!lines.length) return;
      // Of many lines, those next to the pointer.
      const near = lines.length > 5 ? lines.sort((a, b) => a[0] - b[0]).slice(0, 3) : lines;
      const x = x0 + (at.x - left) / (right - left) * (x1 - x0);
      for (const other of svg.querySelectorAll(".panel")) {
        const area = numbers(other.dataset.area);
        const hair = document.createElementNS(svgns, "line");
        hair.setAttribute("class", "hair");
        hair.setAttribute("x1", at.x);
        hair.setAttribute("x2", at.x);
        hair.setAttribute("y1", area[1]);
        hair.setAttribute("y2", area[3]);
        svg.append(hair);
      }
      const head = panel.dataset.xLabel || "time (s)";
      return place(event, [head + ": " + shown(x, (x1 - x0) / (right - left)), panel.dataset.yLabel, ...near.map((line) => line[1])].join("\n"));
    }
  }

  // ---- Looking closer: the panels of a picture share their abscissa.

  const within = (value, low, high) => Math.min(high, Math.max(low, value));
  const drawing = (name, attributes) => {
    const element = document.createElementNS(svgns, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return element;
  };

  // What a panel was drawn with, and which of it moves with the abscissa.
  function origin(panel, number) {
    if (panel.origin) return panel.origin;
    const [left, top, right, bottom] = numbers(panel.dataset.area);
    const own = [...panel.children];
    const spread = (line) => numbers(line.getAttribute("points").replace(/,/g, " "));
    const clip = drawing("clipPath", { id: "clip" + number });
    clip.append(drawing("rect", { x: left, y: top, width: right - left, height: bottom - top }));
    panel.prepend(clip);
    for (const series of panel.querySelectorAll(".series")) series.setAttribute("clip-path", "url(#clip" + number + ")");
    panel.origin = {
      area: [left, top, right, bottom],
      range: numbers(panel.dataset.x),
      lines: [...panel.querySelectorAll(".series polyline, .series polygon")].map((line) => [line, spread(line)]),
      dots: [...panel.querySelectorAll(".series circle")].map((dot) => [dot, Number(dot.getAttribute("cx"))]),
      grid: own.filter((line) => {
        if (line.tagName !== "polyline") return false;
        const points = spread(line);
        return points.length === 4 && points[0] === points[2];
      }),
      labels: own.filter((text) => text.tagName === "text" && text.getAttribute("text-anchor") === "middle" && Number(text.getAttribute("y")) > bottom && /^\s*[\u2212\d.]+\s*$/.test(text.textContent)),
      added: [],
    };
    return panel.origin;
  }

  // Some five round steps across a range.
  function steps(low, high) {
    const rough = (high - low) / 5;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((factor) => factor * power).find((it) => it >= rough);
    const found = [];
    for (let k = Math.ceil(low / step); k * step <= high; k += 1) found.push(k * step);
    return [found, step];
  }

  const everyPanel = [...document.querySelectorAll(".panel")];

  // Draws the panels over another range of the abscissa; over all of it without one.
  function closer(svg, range) {
    hide();
    [...svg.querySelectorAll(".panel")].forEach((panel) => {
      const from = origin(panel, everyPanel.indexOf(panel));
      const [left, top, right, bottom] = from.area;
      const [low, high] = range || from.range;
      const width = from.range[1] - from.range[0];
      const factor = width / (high - low);
      const start = left + (low - from.range[0]) / width * (right - left);
      const at = (x) => Math.round(left + (x - start) * factor);
      for (const [line, points] of from.lines) {
        line.setAttribute("points", points.map((value, k) => (k % 2 ? value : at(value))).join(" "));
        line.readings = null;
      }
      for (const [dot, x] of from.dots) dot.setAttribute("cx", at(x));
      panel.dataset.x = low + " " + high;
      for (const element of from.added.splice(0)) element.remove();
      for (const element of [...from.grid, ...from.labels]) element.style.display = range ? "none" : "";
      if (!range) return;
      const [ticks, step] = steps(low, high);
      for (const tick of ticks) {
        const x = Math.round(left + (tick - low) / (high - low) * (right - left));
        const line = drawing("polyline", { points: `${x},${top} ${x},${bottom}`, fill: "none", stroke: "#E6E6E6", "stroke-width": 8 });
        panel.querySelector("clipPath").after(line);
        from.added.push(line);
        if (!from.labels.length) continue;
        const label = from.labels[0].cloneNode(false);
        label.style.display = "";
        label.setAttribute("x", x);
        label.textContent = shown(tick, step);
        panel.append(label);
        from.added.push(label);
      }
    });
    svg.classList.toggle("closer", Boolean(range));
  }

  function drag(event) {
    const svg = event.currentTarget;
    if (event.pointerType === "touch" || event.button !== 0) return;
    const to = () => svg.getScreenCTM().inverse();
    const place = (it) => new DOMPoint(it.clientX, it.clientY).matrixTransform(to());
    const begin = place(event);
    const panel = [...svg.querySelectorAll(".panel")].find((it) => {
      const [left, top, right, bottom] = numbers(it.dataset.area);
      return begin.x >= left && begin.x <= right && begin.y >= top && begin.y <= bottom;
    });
    if (!panel || panel.querySelector(".cell")) return;
    event.preventDefault();
    const [left, top, right, bottom] = numbers(panel.dataset.area);
    const frame = drawing("rect", { class: "frame", y: top, height: bottom - top });
    svg.append(frame);
    let end = begin.x;
    const move = (it) => {
      end = within(place(it).x, left, right);
      frame.setAttribute("x", Math.min(begin.x, end));
      frame.setAttribute("width", Math.abs(end - begin.x));
    };
    const stop = (it) => {
      window.removeEventListener("pointermove", move);
      window.removeEventListener("pointerup", stop);
      window.removeEventListener("pointercancel", stop);
      frame.remove();
      // Less than a fiftieth of the width is a click that trembled.
      if (it.type !== "pointerup" || Math.abs(end - begin.x) < (right - left) / 50) return;
      const [x0, x1] = numbers(panel.dataset.x);
      const value = (x) => x0 + (x - left) / (right - left) * (x1 - x0);
      closer(svg, [value(Math.min(begin.x, end)), value(Math.max(begin.x, end))]);
    };
    window.addEventListener("pointermove", move);
    window.addEventListener("pointerup", stop);
    window.addEventListener("pointercancel", stop);
  }

  // Paper shows all of it.
  window.addEventListener("beforeprint", () => {
    for (const svg of document.querySelectorAll("svg.closer")) closer(svg, null);
  });

  for (const svg of document.querySelectorAll("svg.picture")) {
    svg.addEventListener("pointerdown", drag);
    svg.addEventListener("dblclick", () => closer(svg, null));
    svg.addEventListener("pointermove", hover);
    svg.addEventListener("pointerdown", hover);
    svg.addEventListener("pointerleave", hide);
  }

  // What a switch of each kind hides.
  const hides = {
    gap: (key) => document.querySelectorAll('#gap-pictures .series[data-key="' + CSS.escape(key) + '"]'),
    runs: (key) => document.querySelectorAll('#run-pictures figure[data-run="' + CSS.escape(key) + '"]'),
    curves: (key) => document.querySelectorAll('#run-pictures .series[data-label="' + CSS.escape(key) + '"]'),
  };
  for (const group of document.querySelectorAll("[data-switches]")) {
    group.hidden = false;
    group.classList.add("live");
    for (const input of group.querySelectorAll("input")) {
      input.hidden = false;
      // A browser may remember how it was left.
      input.checked = true;
      input.addEventListener("change", () => {
        hide();
        for (const element of hides[group.dataset.switches](input.value)) element.classList.toggle("off", !input.checked);
      });
    }
  }
})();
