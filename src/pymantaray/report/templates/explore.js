start((data) => {
  const { fleet, links, errors, nees } = data;
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const sections = new Map(data.rays.map((section) => [section.link, section]));
  const nameOf = (link) => `${fleet.names[links.first[link]]} – ${fleet.names[links.second[link]]}`;
  const largest = (link) => Math.max(...links.error[link].map((value) => Math.abs(value ?? 0)));
  const state = { frame: fleet.ping[0] ?? 0, link: null, timer: null };

  // the fleet
  const pingAt = (frame) => {
    let ping = 0;
    fleet.ping.forEach((sample, p) => { if (sample <= frame) ping = p; });
    return fleet.ping.length ? ping : null;
  };
  const linksOf = (ping) => links.ping.flatMap((p, link) => (p === ping ? [link] : []));
  const place = (who) => {
    if (who >= fleet.vehicles) return fleet.landmarks[who - fleet.vehicles];
    const frame = fleet.ping[pingAt(state.frame)];
    return [fleet.north[who][frame], fleet.east[who][frame], fleet.down[who][frame]];
  };
  const sizes = links.error.flat().filter((value) => value !== null).map(Math.abs).sort((a, b) => a - b);
  const scale = Math.max(1, sizes[Math.floor(0.95 * sizes.length)] ?? 1);
  function shade(error) {
    const x = Math.max(-1, Math.min(1, error / scale));
    const grey = dark.matches ? 150 : 190;
    const end = x > 0 ? [213, 94, 0] : [0, 114, 178];
    return `rgb(${end.map((c) => Math.round(grey + (c - grey) * Math.abs(x))).join(",")})`;
  }
  function graphTraces() {
    const ping = pingAt(state.frame);
    if (ping === null || Math.abs(fleet.ping[ping] - state.frame) > 0) return [];
    return linksOf(ping).map((link) => {
      const [a, b] = [place(links.first[link]), place(links.second[link])];
      const worst = links.error[link].reduce((x, y) => (Math.abs(y ?? 0) > Math.abs(x ?? 0) ? y : x), null);
      const chosen = link === state.link;
      return {
        type: "scatter3d", mode: "lines", x: [a[1], b[1]], y: [a[0], b[0]], z: [a[2], b[2]], customdata: [link, link],
        line: { color: chosen ? ink() : worst === null ? faint() : shade(worst), width: chosen ? 8 : 3, dash: worst === null ? "dash" : "solid" },
        hovertemplate: `${nameOf(link)}<br>${metres(worst)}<extra>${data.statuses[links.status[link]]}</extra>`,
      };
    });
  }
  function drawFleet() {
    const { bed } = fleet;
    const traces = [{
      type: "surface", x: bed.east, y: bed.north, z: bed.down, showscale: false, opacity: 0.55, hoverinfo: "skip",
      colorscale: [[0, "#b9ab9a"], [1, "#5b4f44"]],
    }];
    for (let v = 0; v < fleet.vehicles; v += 1) {
      const upTo = state.frame + 1;
      traces.push({
        type: "scatter3d", mode: "lines", hoverinfo: "skip", line: { color: fleet.colours[v], width: 3 },
        x: fleet.east[v].slice(0, upTo), y: fleet.north[v].slice(0, upTo), z: fleet.down[v].slice(0, upTo),
      });
    }
    const now = (rows) => rows.map((row) => row[state.frame]);
    traces.push({
      type: "scatter3d", mode: "markers+text", text: fleet.names.slice(0, fleet.vehicles), textposition: "top center",
      x: now(fleet.east), y: now(fleet.north), z: now(fleet.down), marker: { size: 5, color: fleet.colours, line: { color: ink(), width: 1 } },
      textfont: { color: ink() }, hovertemplate: "%{text}<br>%{z:.0f} m deep<extra></extra>",
    });
    if (fleet.landmarks.length) {
      traces.push({
        type: "scatter3d", mode: "markers+text", text: fleet.names.slice(fleet.vehicles), marker: { symbol: "diamond", size: 5, color: ink() },
        x: fleet.landmarks.map((p) => p[1]), y: fleet.landmarks.map((p) => p[0]), z: fleet.landmarks.map((p) => p[2]), hovertemplate: "%{text}<extra></extra>",
      });
    }
    traces.push(...graphTraces());
    const axis = (title, more) => ({ title: { text: title }, color: ink(), gridcolor: faint(), backgroundcolor: paper(), showspikes: false, ...more });
    const back = at("fleet").clientWidth < 600 ? 1.9 : 1; // so that its axes are not cut
    draw("fleet", traces, {
      margin: { l: 0, r: 0, t: 0, b: 0 }, uirevision: "fleet",
      scene: {
        xaxis: axis("East [m]"), yaxis: axis("North [m]"), zaxis: axis("Depth [m]", { autorange: "reversed" }),
        aspectmode: "manual", aspectratio: { x: 1.2, y: 1.2, z: 0.6 }, camera: { eye: { x: 1.5 * back, y: -1.6 * back, z: 0.9 * back }, center: { x: 0, y: 0, z: -0.15 } },
      },
    });
    at("hour").textContent = `${fleet.hour[state.frame].toFixed(1)} h`;
    at("time").value = state.frame;
    at("time").setAttribute("aria-valuetext", at("hour").textContent);
  }
  function show(frame) {
    const before = pingAt(state.frame);
    state.frame = Math.max(0, Math.min(fleet.hour.length - 1, frame));
    drawFleet();
    if (pingAt(state.frame) !== before) listLinks();
  }
  function stop() {
    clearInterval(state.timer);
    state.timer = null;
    at("play").textContent = "Play";
    at("play").setAttribute("aria-pressed", "false");
  }
  function play() {
    if (state.timer) return stop();
    if (state.frame === fleet.hour.length - 1) show(0);
    at("play").textContent = "Stop";
    at("play").setAttribute("aria-pressed", "true");
    state.timer = setInterval(() => (state.frame < fleet.hour.length - 1 ? show(state.frame + 1) : stop()), still ? 600 : 120);
  }
  function toPing(step) {
    const ping = pingAt(state.frame);
    if (ping === null) return;
    const back = step < 0 && fleet.ping[ping] < state.frame ? 0 : step;
    show(fleet.ping[Math.max(0, Math.min(fleet.ping.length - 1, ping + back))]);
  }

  // links and their rays
  function listLinks() {
    const ping = pingAt(state.frame);
    const rows = at("which").value === "rays" ? [...sections.keys()].sort((a, b) => largest(b) - largest(a)) : linksOf(ping);
    at("links").replaceChildren(...rows.map((link) => {
      const heard = links.error[link].some((value) => value !== null);
      const text = heard ? links.error[link].filter((v) => v !== null).map((v) => metres(v)).join(", ") : data.statuses[links.status[link]];
      const when = at("which").value === "rays" ? `, ${fleet.hour[fleet.ping[links.ping[link]]].toFixed(1)} h` : "";
      return new Option(`${sections.has(link) ? "* " : "  "}${nameOf(link)}: ${(links.distance[link] / 1e3).toFixed(2)} km${when}: ${text}`, link, false, link === state.link);
    }));
  }
  function describe(link, section) {
    const words = [`${nameOf(link)}, ${fleet.hour[fleet.ping[links.ping[link]]].toFixed(1)} h: ${(links.distance[link] / 1e3).toFixed(3)} km, ${data.statuses[links.status[link]]}.`];
    links.error[link].forEach((error, way) => {
      if (error === null) return;
      const [from, to] = way === 0 ? [links.first, links.second] : [links.second, links.first];
      words.push(`From ${fleet.names[from[link]]} to ${fleet.names[to[link]]} the range is wrong by ${metres(error)}: reference speed ${metres(links.reference[link][way])}, bending ${metres(links.bending[link][way])}.`);
    });
    if (!section) words.push("Its rays are not kept.");
    else section.time.forEach((time, ray) => words.push(
      `Ray ${ray + 1}: ${(1e3 * time).toFixed(3)} ms, ${section.surface[ray]} surface and ${section.bottom[ray]} bottom bounces, spreading ${section.spreading[ray]} dB beyond spherical.`));
    return words.join(" ");
  }
  function choose(link) {
    state.link = link;
    const section = sections.get(link);
    at("link").textContent = describe(link, section);
    const deepest = section ? section.depth[section.depth.length - 1] : 1;
    const kindOf = (ray) => Number(section.surface[ray] > 0) + 2 * Number(section.bottom[ray] > 0);
    const far = section ? section.range[section.range.length - 1] : 1;
    const traces = !section ? [] : [
      { type: "heatmap", x: section.range, y: section.depth, z: section.speed, colorscale: data.water, showlegend: false, colorbar: { title: { text: "m/s" }, thickness: 10 }, hovertemplate: "%{x:.0f} m, %{y:.0f} m: %{z:.1f} m/s<extra></extra>" },
      ...section.ray_range.map((range, ray) => {
        const kind = data.kinds[kindOf(ray)];
        const first = section.ray_range.findIndex((_, other) => kindOf(other) === kindOf(ray)) === ray;
        return { type: "scatter", mode: "lines", name: kind.name, showlegend: first, x: range, y: section.ray_depth[ray], line: { color: kind.colour, dash: kind.dash, width: 2.5 }, hovertemplate: `ray ${ray + 1}<extra></extra>` };
      }),
      { type: "scatter", mode: "lines+markers", name: "chord", x: [0, far], y: section.ends, line: { color: "#1a1a1a", dash: "dot", width: 1.2 }, marker: { color: "#ffffff", size: 8, line: { color: "#1a1a1a", width: 1.5 } }, hoverinfo: "skip" },
      { type: "scatter", mode: "lines", x: [0, far], y: [2 * deepest, 2 * deepest], line: { width: 0 }, showlegend: false, hoverinfo: "skip" },
      { type: "scatter", mode: "lines", x: section.range, y: section.bed, fill: "tonexty", fillcolor: "#8d7f70", line: { color: "#4a4038", width: 2 }, showlegend: false, hoverinfo: "skip" },
    ];
    const named = (text, x, y, side) => ({ text: `<b>${text}</b>`, x, y, xanchor: side, showarrow: false, xshift: side === "left" ? 8 : -8, yshift: -12, font: { color: "#1a1a1a" }, bgcolor: "rgba(255,255,255,0.75)" });
    draw("rays", traces, {
      xaxis: { title: { text: "Range [m]" }, range: [0, far] }, yaxis: { title: { text: "Depth [m]" }, range: [deepest, 0] },
      showlegend: true, legend: { orientation: "h", y: 1.02, yanchor: "bottom" }, margin: { l: 60, r: 15, t: 30, b: 45 },
      annotations: section
        ? [named(fleet.names[links.first[link]], 0, section.ends[0], "left"), named(fleet.names[links.second[link]], far, section.ends[1], "right")]
        : [{ text: "no rays kept", showarrow: false, x: 0.5, y: 0.5, xref: "paper", yref: "paper" }],
    });
    drawFleet();
    drawErrors();
    for (const option of at("links").options) option.selected = Number(option.value) === link;
  }

  // range errors
  function drawErrors() {
    const chosen = state.link === null ? null : `${links.first[state.link]} ${links.second[state.link]}`;
    for (const [id, values, title] of [["by-distance", links.distance.map((d) => d / 1e3), "Distance [km]"], ["by-depth", links.depth, "Depth of the deeper end [m]"]]) {
      const all = { x: [], y: [], link: [] };
      const mine = { x: [], y: [], link: [] };
      links.error.forEach((both, link) => both.forEach((error) => {
        if (error === null) return;
        const into = `${links.first[link]} ${links.second[link]}` === chosen ? mine : all;
        into.x.push(values[link]);
        into.y.push(error);
        into.link.push(link);
      }));
      const dots = (part, colour, size, opacity) => ({
        type: "scattergl", mode: "markers", x: part.x, y: part.y, customdata: part.link, text: part.link.map(nameOf),
        marker: { color: colour, size, opacity }, hovertemplate: "%{text}<br>%{y:.2f} m<extra></extra>",
      });
      draw(id, [dots(all, dark.matches ? "#56B4E9" : "#0072B2", 4, chosen === null ? 0.5 : 0.25), dots(mine, "#D55E00", 8, 1)], { xaxis: { title: { text: title } }, yaxis: { title: { text: "Range error [m]" } } });
    }
  }

  // position errors
  function drawOverTime() {
    const v = Number(at("vehicle").value);
    const traces = errors.conditions.flatMap((condition) => [
      { type: "scatter", mode: "lines", name: condition.label, x: errors.hour, y: condition.rms[v], line: { color: condition.colour, dash: condition.dash } },
      ...(condition.sigma3 ? [{ type: "scatter", mode: "markers", name: `${condition.label}, 3 sigma`, showlegend: false, x: condition.sigma_hour, y: condition.sigma3[v], marker: { color: condition.colour, size: 5, symbol: "circle-open" } }] : []),
    ]);
    draw("over-time", traces, { showlegend: true, legend: { orientation: "h", y: 1.15 }, margin: { l: 60, r: 15, t: 40, b: 45 }, xaxis: { title: { text: "Time [h]" } }, yaxis: { title: { text: "Position error [m]" }, type: "log" } });
  }
  function drawEstimates() {
    at("estimates").hidden = !errors.conditions.length;
    if (!errors.conditions.length) return;
    drawOverTime();
    const share = Array.from({ length: 101 }, (_, i) => i);
    draw("distribution", errors.conditions.map((c) => ({ type: "scatter", mode: "lines", name: c.label, x: c.quantiles, y: share, line: { color: c.colour, dash: c.dash } })), {
      showlegend: true, legend: { orientation: "h", y: 1.15 }, margin: { l: 60, r: 15, t: 40, b: 45 },
      xaxis: { title: { text: "Position error [m]" }, type: "log" }, yaxis: { title: { text: "Poses with a smaller error [%]" } },
    });
    at("nees-part").hidden = !nees.length;
    if (!nees.length) return;
    const of = (name) => nees.filter((row) => row.condition === name);
    const traces = errors.conditions.filter((c) => of(c.name).length).map((c) => ({ type: "scatter", mode: "lines+markers", name: c.label, x: of(c.name).map((r) => r.time_h), y: of(c.name).map((r) => r.ratio), line: { color: c.colour } }));
    const bounds = of(nees[0].condition);
    for (const side of ["low", "high"]) traces.push({ type: "scatter", mode: "lines+markers", x: bounds.map((r) => r.time_h), y: bounds.map((r) => r[side]), line: { color: ink(), dash: "dash", width: 1 }, marker: { color: ink(), symbol: "line-ew-open", size: 10 }, showlegend: false, hoverinfo: "skip" });
    draw("nees", traces, { showlegend: true, legend: { orientation: "h", y: 1.15 }, margin: { l: 60, r: 15, t: 40, b: 45 }, xaxis: { title: { text: "Time [h]" } }, yaxis: { title: { text: "NEES / degrees of freedom" }, type: "log" } });
  }

  function drawAll() {
    drawFleet();
    listLinks();
    drawEstimates();
    const first = sections.keys().next();
    if (state.link !== null || !first.done) choose(state.link ?? first.value);
    else drawErrors();
  }
  at("vehicle").replaceChildren(...fleet.names.slice(0, fleet.vehicles).map((name, v) => new Option(name, v)));
  at("time").max = fleet.hour.length - 1;
  at("time").addEventListener("input", () => { stop(); show(Number(at("time").value)); });
  at("play").addEventListener("click", play);
  at("before").addEventListener("click", () => { stop(); toPing(-1); });
  at("after").addEventListener("click", () => { stop(); toPing(1); });
  at("which").addEventListener("change", listLinks);
  at("links").addEventListener("change", () => choose(Number(at("links").value)));
  at("vehicle").addEventListener("change", drawOverTime);
  dark.addEventListener("change", drawAll);
  if (data.rays.length) state.frame = fleet.ping[links.ping[data.rays[0].link]];
  drawAll();
  for (const id of ["fleet", "by-distance", "by-depth"]) {
    at(id).on("plotly_click", (event) => {
      const link = event.points[0].customdata;
      if (link !== undefined && link !== null) choose(Number(Array.isArray(link) ? link[0] : link));
    });
  }
});
