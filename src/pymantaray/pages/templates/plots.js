"use strict";
// functions that the scripts of all pages share
const at = (id) => document.getElementById(id);
const dark = matchMedia("(prefers-color-scheme: dark)");
const metres = (value, digits = 2) =>
  value === null ? "–" : `${value > 0 ? "+" : ""}${value.toFixed(digits)} m`.replace("-", "−");
// hours as in the data: whole minutes, or seconds if some of the times are not whole minutes
function clock(hours) {
  const whole = hours.every((hour) => Math.abs(60 * hour - Math.round(60 * hour)) < 1e-3);
  return (hour) => {
    const seconds = whole ? 60 * Math.round(60 * hour) : Math.round(3600 * hour);
    const [h, min, s] = [Math.floor(seconds / 3600), Math.floor(seconds / 60) % 60, seconds % 60].map((part, i) => String(part).padStart(i ? 2 : 1, "0"));
    return whole ? `${h} h ${min} min` : `${h} h ${min} min ${s} s`;
  };
}
// numbers between two others at which a logarithmic scale is labelled: 1, 2 and 5 of each decade, or even steps of less than one
function logTicks(low, high) {
  const within = (values) => values.filter((x) => x >= low * (1 - 1e-9) && x <= high * (1 + 1e-9));
  const first = Math.floor(Math.log10(low));
  const decades = Array.from({ length: Math.ceil(Math.log10(high)) - first + 1 }, (_, k) => 10 ** (first + k));
  const round = within(decades.flatMap((x) => [1, 2, 5].map((y) => x * y)));
  if (round.length > 2) return round.map((x) => Number(x.toPrecision(1)));
  const step = [1, 2, 5, 10].map((y) => y * 10 ** Math.floor(Math.log10((high - low) / 4))).find((y) => (high - low) / y <= 7);
  const even = step > 0 ? Array.from({ length: 12 }, (_, k) => Number(((Math.ceil(low / step) + k) * step).toPrecision(12))) : [];
  const ticks = within(even);
  return ticks.length ? ticks : [low];
}
const webgl = (() => {
  const canvas = document.createElement("canvas");
  return Boolean(canvas.getContext("webgl2") ?? canvas.getContext("webgl"));
})();
const ink = () => (dark.matches ? "#e8e8e8" : "#1a1a1a");
const paper = () => (dark.matches ? "#15181b" : "#ffffff");
const faint = () => (dark.matches ? "#3a3f45" : "#d9d9d9");
function layout(extra) {
  const axis = { gridcolor: faint(), zerolinecolor: faint(), linecolor: faint() };
  const { xaxis, yaxis, ...rest } = extra;
  return {
    paper_bgcolor: paper(), plot_bgcolor: paper(), font: { color: ink(), size: 12 },
    margin: { l: 60, r: 15, t: 10, b: 45 }, showlegend: false, hovermode: "closest",
    xaxis: { ...axis, ...xaxis }, yaxis: { ...axis, ...yaxis }, ...rest,
  };
}
// text of others in a figure: a space without width keeps plotly from reading tags, entities and templates in it, and from looking a name
// of a property up in its memory of letters
const plain = (text) => `${String(text) in {} ? "\u200b" : ""}${text}`.replace(/[<&]|%(?={)/g, "$&\u200b");
// distinct names for a figure, in which long ones leave no room for anything else
function namesInFigure(names, fits = 28) {
  const cut = names.map((name) => {
    const letters = [...String(name)];
    return letters.length > fits ? [...letters.slice(0, fits / 2 - 1), "…", ...letters.slice(-fits / 2)].join("") : letters.join("");
  });
  const counts = cut.reduce((all, name) => all.set(name, (all.get(name) ?? 0) + 1), new Map());
  return new Map(names.map((name, i) => [name, plain(counts.get(cut[i]) > 1 ? `${i + 1}: ${cut[i]}` : cut[i])]));
}
const options = { displaylogo: false, responsive: true, displayModeBar: false };
const draw = (id, traces, extra) => Plotly.react(at(id), traces, layout(extra), options);
async function unpacked(id) {
  const bytes = Uint8Array.from(atob(at(id).textContent), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}
// unfolds the sections around the element that the address names
const unfold = () => {
  const named = document.querySelector(":target");
  for (let part = named?.closest("details"); part; part = part.parentElement.closest("details")) part.open = true;
  named?.scrollIntoView();
};
// the interactive part starts after the browser has shown the page; on the screen, it replaces the sections that are then folded
const start = (show) => {
  if (!window.DecompressionStream) {
    const note = Object.assign(document.createElement("p"), {className: "note"});
    note.textContent = "The interactive figures need a newer browser; figures and tables do not.";
    document.querySelector("noscript").before(note);
    return;
  }
  for (const part of document.querySelectorAll("[data-folds]")) part.open = false;
  for (const part of document.querySelectorAll("#look, .contents [hidden]")) part.hidden = false;
  addEventListener("hashchange", unfold);
  unfold();
  requestAnimationFrame(() => setTimeout(async () => {
    const library = document.createElement("script");
    library.textContent = await unpacked("library");
    document.head.append(library);
    show(JSON.parse(await unpacked("explorer")));
    document.documentElement.dataset.ready = "yes";
  }));
};
