start((data) => {
  const { columns, labels, colours } = data;
  const rows = columns[data.up[0]].length;
  const label = (name) => labels[name] ?? name;
  const isNumber = (name) => typeof columns[name].find((value) => value !== null) === "number";
  // numbers in their order; words of results in that of the table, which is the order of the configuration, words of events by letter
  const known = (name) => {
    const values = [...new Set(columns[name])];
    if (isNumber(name)) return values.sort((a, b) => a - b);
    return data.lines ? values : values.sort((a, b) => String(a).localeCompare(String(b)));
  };
  const fill = (id, names, none) => at(id).replaceChildren(...(none ? [new Option(none, "")] : []), ...names.map((name) => new Option(label(name), name)));
  const menus = () => [...at("only").querySelectorAll("select")];
  function narrow() {
    const used = [at("across").value, at("each").value];
    const before = new Map(menus().filter((select) => select.dataset.chosen).map((select) => [select.name, select.value]));
    at("only").replaceChildren(...data.each.filter((name) => !used.includes(name) && known(name).length > 1).map((name) => {
      const select = document.createElement("select");
      select.name = name;
      select.append(new Option("all", ""), ...known(name).map((value, i) => new Option(value, i)));
      select.value = before.get(name) ?? "";
      if (before.has(name)) select.dataset.chosen = "yes";
      select.addEventListener("change", () => { select.dataset.chosen = "yes"; show(); });
      const words = document.createElement("label");
      words.append(`${label(name)} `, select);
      return words;
    }));
    if (data.lines && isNumber(at("across").value)) fix();
    show();
  }
  function shownRows() {
    const [up, across] = ["up", "across"].map((id) => at(id).value);
    const only = menus().filter((select) => select.value !== "").map((select) => [select.name, known(select.name)[Number(select.value)]]);
    return Array.from({ length: rows }, (_, row) => row).filter((row) => columns[up][row] !== null && columns[across][row] !== null && only.every(([name, value]) => columns[name][row] === value));
  }
  // fixes the other keys at their first values where a line would have several points at one place
  function fix() {
    const place = (row) => JSON.stringify([at("across").value, at("each").value].map((name) => columns[name]?.[row]));
    for (const select of menus().filter((menu) => !menu.dataset.chosen)) {
      const shown = shownRows();
      const first = new Map(shown.toReversed().map((row) => [place(row), columns[select.name][row]]));
      if (shown.some((row) => columns[select.name][row] !== first.get(place(row)))) select.value = known(select.name).indexOf(columns[select.name][shown[0]]);
    }
  }
  function show() {
    const [up, across, each] = ["up", "across", "each"].map((id) => at(id).value);
    const shown = shownRows();
    const groups = each ? known(each) : [null];
    const lines = data.lines && isNumber(across);
    const [inLegend, onAxis] = [groups, isNumber(across) ? [] : known(across)].map((names) => namesInFigure(names));
    const title = (name) => namesInFigure([label(name)]).get(label(name));
    const traces = groups.map((group, g) => {
      const own = shown.filter((row) => group === null || columns[each][row] === group);
      if (lines) own.sort((a, b) => columns[across][a] - columns[across][b]);
      const colour = (each === "condition" && data.own[group]) || colours[g % colours.length];
      const single = new Set(own.map((row) => columns[across][row])).size === own.length;
      return {
        type: "scatter", mode: lines && single ? "lines+markers" : "markers", name: inLegend.get(group), x: own.map((row) => onAxis.get(columns[across][row]) ?? columns[across][row]), y: own.map((row) => columns[up][row]),
        text: own.map((row) => data.each.map((name) => plain(`${label(name)}: ${columns[name][row]}`)).join("<br>")), hovertemplate: "%{y}<br>%{text}<extra></extra>",
        marker: { color: colour, size: rows > 500 ? 4 : 8, opacity: rows > 500 ? 0.6 : 1 }, line: { color: colour },
      };
    });
    at("per").textContent = traces.some((trace) => trace.mode !== "markers") ? "One line per" : "One colour per";
    draw("chart", traces, {
      showlegend: each !== "", legend: { orientation: "h", y: 1.02, yanchor: "bottom" }, margin: { l: 70, r: 15, t: 40, b: 60 },
      xaxis: { title: { text: title(across) }, type: isNumber(across) ? "linear" : "category", automargin: true },
      yaxis: { title: { text: title(up) }, type: at("logarithmic").checked ? "log" : "linear" },
    });
    at("told").textContent = `${shown.length} of ${rows} rows`;
  }
  fill("up", data.up);
  fill("across", data.across);
  fill("each", data.each, "nothing");
  at("each").value = data.each.includes(data.first) ? data.first : "";
  for (const id of ["across", "each"]) at(id).addEventListener("change", narrow);
  for (const id of ["up", "logarithmic"]) at(id).addEventListener("change", show);
  dark.addEventListener("change", show);
  narrow();
});
