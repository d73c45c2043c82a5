// What answers to clicks: tabs, views, sliders, charts. The viewers of hidden tabs begin when they are first shown.

function pressOne(buttons, pressed, attribute) {
  buttons.forEach((button) => button.setAttribute(attribute, String(button === pressed)));
}

function startViewers(root) {
  for (const element of root.querySelectorAll(".viewer")) {
    if (!element.viewer && element.offsetParent !== null) element.viewer = new Viewer(element);
  }
}

for (const tabs of document.querySelectorAll(".tabs")) {
  const buttons = [...tabs.querySelectorAll("[data-tab]")];
  const panels = [...tabs.parentElement.querySelectorAll("[data-panel]")];
  buttons.forEach((button) => button.addEventListener("click", () => {
    pressOne(buttons, button, "aria-selected");
    panels.forEach((panel) => { panel.hidden = panel.dataset.panel !== button.dataset.tab; });
    startViewers(tabs.parentElement);
  }));
}

for (const views of document.querySelectorAll(".views")) {
  const buttons = [...views.querySelectorAll("[data-view]")];
  const panels = [...views.querySelectorAll(".view")];
  buttons.forEach((button, i) => button.addEventListener("click", () => {
    pressOne(buttons, button, "aria-pressed");
    panels.forEach((panel, j) => { panel.hidden = i !== j; });
  }));
}

for (const compare of document.querySelectorAll(".compare")) {
  const input = compare.querySelector("input");
  input.addEventListener("input", () => compare.style.setProperty("--at", input.value + "%"));
}

function save(name, kind, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: kind }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// Splits a line of CSV; what is quoted may hold commas.
function fields(line) {
  return [...line.matchAll(/("(?:[^"]|"")*"|[^,]*)(,|$)/g)].slice(0, -1).map((match) => match[1].replace(/^"|"$/g, "").replace(/""/g, '"'));
}

for (const chart of document.querySelectorAll(".chart")) {
  const svg = chart.querySelector("svg");
  const csv = chart.querySelector("template").content.textContent;
  chart.querySelector("[data-save=csv]").addEventListener("click", () => save(chart.dataset.name + ".csv", "text/csv", csv));
  chart.querySelector("[data-save=svg]").addEventListener("click", () => {
    const style = [...document.styleSheets[0].cssRules].map((rule) => rule.cssText).filter((rule) => rule.includes(".dvr-chart")).join("\n");
    const copy = svg.cloneNode(true);
    const element = document.createElementNS("http://www.w3.org/2000/svg", "style");
    element.textContent = style;
    copy.prepend(element);
    save(chart.dataset.name + ".svg", "image/svg+xml", new XMLSerializer().serializeToString(copy));
  });
  if (svg.dataset.plot) pointAt(chart, svg, csv);
}

// Tells the numbers of the point that is nearest to the pointer.
function pointAt(chart, svg, csv) {
  const [left, top, right, bottom] = svg.dataset.plot.split(" ").map(Number);
  const place = (data, from, to) => {
    const [low, high, kind] = data.split(" ");
    const along = kind === "log" ? (value) => Math.log(value / low) / Math.log(high / low) : (value) => (value - low) / (high - low);
    return (value) => from + along(value) * (to - from);
  };
  const [x, y] = [place(svg.dataset.x, left, right), place(svg.dataset.y, bottom, top)];
  const points = csv.trim().split("\n").slice(1).map(fields).map(([name, a, b]) => ({ name, a: +a, b: +b, x: x(+a), y: y(+b) })).filter((point) => isFinite(point.x) && isFinite(point.y));
  const tip = document.createElement("div");
  tip.className = "tip";
  tip.hidden = true;
  chart.append(tip);
  const short = (value) => Number(value.toPrecision(4)).toString();
  svg.addEventListener("pointermove", (event) => {
    const box = svg.getBoundingClientRect();
    const scale = svg.viewBox.baseVal.width / box.width;
    const at = [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale];
    const distance = (point) => Math.hypot(point.x - at[0], point.y - at[1]);
    const nearest = points.reduce((best, point) => (!best || distance(point) < distance(best) ? point : best), null);
    tip.hidden = !nearest || distance(nearest) > 40;
    if (tip.hidden) return;
    tip.textContent = (nearest.name ? nearest.name + ": " : "") + short(nearest.a) + ", " + short(nearest.b);
    tip.style.left = nearest.x / scale + "px";
    tip.style.top = nearest.y / scale + "px";
  });
  svg.addEventListener("pointerleave", () => { tip.hidden = true; });
}

startViewers(document);
