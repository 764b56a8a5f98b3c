// Hovering reads values off the drawings; switches hide runs and curves. The
// page is complete without it.
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

  for (const svg of document.querySelectorAll("svg.picture")) {
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
