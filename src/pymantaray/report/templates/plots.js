"use strict";
// what the scripts of all pages share
const at = (id) => document.getElementById(id);
const dark = matchMedia("(prefers-color-scheme: dark)");
const metres = (value, digits = 2) =>
  value === null ? "–" : `${value > 0 ? "+" : ""}${value.toFixed(digits)} m`.replace("-", "−");
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
const options = { displaylogo: false, responsive: true, displayModeBar: false };
const draw = (id, traces, extra) => Plotly.react(at(id), traces, layout(extra), options);
async function unpacked(id) {
  const bytes = Uint8Array.from(atob(at(id).textContent), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}
// what moves comes after the page itself has been painted
const start = (show) => requestAnimationFrame(() => setTimeout(async () => {
  if (!window.DecompressionStream) {
    const note = Object.assign(document.createElement("p"), {className: "note"});
    note.textContent = "What moves needs a newer browser; figures and tables do not.";
    document.querySelector("noscript").before(note);
    return;
  }
  const library = document.createElement("script");
  library.textContent = await unpacked("library");
  document.head.append(library);
  show(JSON.parse(await unpacked("explorer")));
  document.documentElement.dataset.ready = "yes";
}));
