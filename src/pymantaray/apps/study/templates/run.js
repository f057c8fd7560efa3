start((data) => {
  const { fleet, links, errors, nees } = data;
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const sections = new Map(data.rays.map((section) => [section.link, section]));
  const every = sections.size === links.ping.length;
  const nameOf = (link, names = fleet.names) => `${names[links.first[link]]} – ${names[links.second[link]]}`;
  const shownNames = [...namesInFigure(fleet.names, 24).values()];
  const shownConditions = namesInFigure(errors.conditions.map((condition) => condition.label));
  const largest = (link) => Math.max(...links.error[link].map((value) => Math.abs(value ?? 0)));
  const hours = clock(fleet.hour);
  const hourOf = (link) => hours(fleet.hour[fleet.ping[links.ping[link]]]);
  const state = { frame: fleet.ping[0] ?? 0, link: null, timer: null };

  // the fleet
  const pingAt = (frame) => {
    let ping = 0;
    fleet.ping.forEach((sample, p) => { if (sample <= frame) ping = p; });
    return fleet.ping.length ? ping : null;
  };
  const linksOf = (ping) => links.ping.flatMap((p, link) => (p === ping ? [link] : []));
  const place = (who, ping) => {
    if (who >= fleet.vehicles) return fleet.landmarks[who - fleet.vehicles];
    const frame = fleet.ping[ping];
    return [fleet.north[who][frame], fleet.east[who][frame], fleet.down[who][frame]];
  };
  const sizes = links.error.flat().filter((value) => value !== null).map(Math.abs).sort((a, b) => a - b);
  const scale = Math.max(1, sizes[Math.floor(0.95 * sizes.length)] ?? 1);
  const scaleColours = () => [[0, "#0072B2"], [0.5, dark.matches ? "#969696" : "#bebebe"], [1, "#D55E00"]];
  function shade(error) {
    const x = Math.max(-1, Math.min(1, error / scale));
    const grey = dark.matches ? 150 : 190;
    const end = x > 0 ? [213, 94, 0] : [0, 114, 178];
    return `rgb(${end.map((c) => Math.round(grey + (c - grey) * Math.abs(x))).join(",")})`;
  }
  const bar = (title, place) => ({ title: { text: title, side: "top" }, orientation: "h", thickness: 8, len: 0.6, xanchor: "center", x: 0.5, yanchor: "bottom", tickfont: { color: ink() }, ...place });
  // least and greatest east, north and depth of all that is drawn
  const limits = [[fleet.east, fleet.bed.east, 1], [fleet.north, fleet.bed.north, 0], [fleet.down, fleet.bed.down, 2]].map(([rows, bed, k]) => {
    const values = [...rows.flat(), ...bed.flat(), ...fleet.landmarks.map((p) => p[k]), ...(k === 2 ? [0] : [])].filter((value) => value !== null);
    const [low, high] = values.reduce(([least, greatest], value) => [Math.min(least, value), Math.max(greatest, value)], [Infinity, -Infinity]);
    const beyond = k === 2 ? 0.03 * (high - low) : 0; // below the sea bed, which the box would cut
    return high > low ? [low, high + beyond] : [low - 1, low + 1];
  });
  const BELOW_SCENE = 80; // pixels, for the scale of colours
  // the scene's box and the camera that shows it; margins are for the numbers of its axes
  function sceneView() {
    const { clientWidth: width, clientHeight: height } = at("fleet");
    const narrow = width < 600;
    const shown = height - BELOW_SCENE;
    const sides = narrow ? [1.2, 1.2, 0.9] : [2.4, 1.3, 0.8];
    return { sides, shown, ...fittingCamera(sides, [1.1, -1.65, 1.0], shown, narrow ? [width - 115, shown - 70] : [width - 160, shown - 50]) };
  }
  // where the names of vehicles and landmarks stand in the picture as it is first shown
  function sides(vehicles) {
    const places = [...vehicles, ...fleet.landmarks.map((p) => [p[1], p[0], p[2]])];
    const part = (value, k) => ((value ?? limits[k][0]) - limits[k][0]) / (limits[k][1] - limits[k][0]) - 0.5;
    let pixels;
    if (webgl) {
      const view = sceneView();
      pixels = projected(places.map((p) => [0, 1, 2].map((k) => part(p[k], k) * view.sides[k] * (k === 2 ? -1 : 1))), view, view.shown);
    } else {
      const scale = Math.min((at("fleet").clientWidth - 85) / (limits[0][1] - limits[0][0]), (at("fleet").clientHeight - 180) / (limits[1][1] - limits[1][0]));
      pixels = places.map(([x, y]) => [(x ?? 0) * scale, -(y ?? 0) * scale]);
    }
    return sidesOfNames(pixels, shownNames);
  }
  function pairTraces(make) {
    const ping = pingAt(state.frame);
    if (ping === null || fleet.ping[ping] !== state.frame) return [];
    return linksOf(ping).map((link) => {
      const worst = links.error[link].reduce((x, y) => (Math.abs(y ?? 0) > Math.abs(x ?? 0) ? y : x), null);
      const chosen = link === state.link;
      return {
        mode: "lines", customdata: [link, link], line: { color: chosen ? ink() : worst === null ? faint() : shade(worst), width: chosen ? 2.5 : 1, dash: worst === null ? "dash" : "solid" },
        hovertemplate: `${nameOf(link, shownNames)}<br>${metres(worst)}<extra>${data.statuses[links.status[link]]}</extra>`, ...make(place(links.first[link], ping), place(links.second[link], ping)),
      };
    });
  }
  const now = (rows) => rows.map((row) => row[state.frame]);
  const tracks = (make) => fleet.colours.map((colour, v) => ({ mode: "lines", hoverinfo: "skip", line: { color: colour, width: 1 }, ...make(...[fleet.east, fleet.north, fleet.down].map((rows) => rows[v].slice(0, state.frame + 1))) }));
  const errorScale = (extra) => ({ marker: { color: [0], cmin: -scale, cmax: scale, colorscale: scaleColours(), showscale: true, opacity: 0, colorbar: bar("Range error [m]", { y: -0.02, yanchor: "top" }) }, mode: "markers", hoverinfo: "skip", ...extra });
  // traces of vehicles and landmarks with their names
  function named(x, y, z) {
    const beside = sides(x.map((_, v) => [x[v], y[v], z[v]]));
    const common = { mode: "markers+text", textfont: webgl ? { color: ink() } : { color: ink(), shadow: Array(3).fill(`0 0 3px ${paper()}`).join(", ") }, hovertemplate: "%{text}<br>%{customdata:.0f} m deep<extra></extra>" };
    const [north, east, down] = [0, 1, 2].map((k) => fleet.landmarks.map((p) => p[k]));
    return [
      { ...common, text: shownNames.slice(0, fleet.vehicles), textposition: beside.slice(0, fleet.vehicles), x, y, z, customdata: z },
      { ...common, text: shownNames.slice(fleet.vehicles), textposition: beside.slice(fleet.vehicles), x: east, y: north, z: down, customdata: down },
    ];
  }
  function drawSolid() {
    const { bed } = fleet;
    const traces = [{
      type: "surface", x: bed.east, y: bed.north, z: bed.down, showscale: false, opacity: 0.55, hoverinfo: "skip",
      colorscale: [[0, "#b9ab9a"], [1, "#5b4f44"]],
    }];
    traces.push(...tracks((x, y, z) => ({ type: "scatter3d", x, y, z })).map((t) => ({ ...t, line: { ...t.line, width: 3 } })));
    const [x, y, z] = [fleet.east, fleet.north, fleet.down].map(now);
    const [own, landmarks] = named(x, y, z);
    traces.push({ ...own, type: "scatter3d", marker: { size: 5, color: fleet.colours, line: { color: ink(), width: 1 } } });
    if (fleet.landmarks.length) traces.push({ ...landmarks, type: "scatter3d", marker: { symbol: "diamond", size: 5, color: ink() } });
    traces.push(...pairTraces((a, b) => ({ type: "scatter3d", x: [a[1], b[1]], y: [a[0], b[0]], z: [a[2], b[2]] })).map((t) => ({ ...t, line: { ...t.line, width: 3 * t.line.width } })));
    traces.push(errorScale({ type: "scatter3d", x: [x[0]], y: [y[0]], z: [z[0]] }));
    const axis = (title, more) => ({ title: { text: title }, color: ink(), gridcolor: faint(), backgroundcolor: paper(), showspikes: false, nticks: 5, ...more });
    const { sides: box, eye, center } = sceneView();
    const vector = ([vx, vy, vz]) => ({ x: vx, y: vy, z: vz });
    draw("fleet", traces, {
      margin: { l: 0, r: 0, t: 0, b: BELOW_SCENE }, uirevision: "fleet",
      scene: {
        xaxis: axis("East [m]", { range: limits[0] }), yaxis: axis("North [m]", { range: limits[1] }), zaxis: axis("Depth [m]", { range: [limits[2][1], limits[2][0]] }),
        aspectmode: "manual", aspectratio: vector(box), camera: { eye: vector(eye), center: vector(center) },
      },
    });
  }
  // without WebGL: the plan, vehicles coloured by their depth
  function drawPlan() {
    const { bed } = fleet;
    const deepest = Math.max(1, ...fleet.down.flatMap((row) => row.filter((z) => z !== null)));
    const [x, y, z] = [fleet.east, fleet.north, fleet.down].map(now);
    const traces = [{ type: "contour", x: bed.east, y: bed.north, z: bed.down, showscale: false, hoverinfo: "skip", contours: { coloring: "none", showlabels: true, labelfont: { color: "#8d7f70" } }, line: { color: "#8d7f70", width: 0.7 } }];
    traces.push(...tracks((east, north) => ({ type: "scatter", x: east, y: north })), ...pairTraces((a, b) => ({ type: "scatter", x: [a[1], b[1]], y: [a[0], b[0]] })));
    const [own, landmarks] = named(x, y, z);
    if (fleet.landmarks.length) traces.push({ ...landmarks, type: "scatter", marker: { symbol: "diamond", size: 9, color: ink() } });
    traces.push({ ...own, type: "scatter", marker: { size: 11, color: z, cmin: 0, cmax: deepest, colorscale: "Viridis", reversescale: true, showscale: true, line: { color: ink(), width: 1 }, colorbar: bar("Depth [m]", { y: 1.01 }) } });
    traces.push(errorScale({ type: "scatter", x: [x[0]], y: [y[0]], marker: { ...errorScale().marker, colorbar: bar("Range error [m]", { y: -0.2, yanchor: "top" }) } }));
    draw("fleet", traces, { margin: { l: 70, r: 15, t: 60, b: 120 }, uirevision: "fleet", xaxis: { title: { text: "East [m]" } }, yaxis: { title: { text: "North [m]" }, scaleanchor: "x" } });
  }
  function drawFleet() {
    if (webgl) drawSolid();
    else drawPlan();
    at("hour").textContent = hours(fleet.hour[state.frame]);
    at("time").value = state.frame;
    at("time").setAttribute("aria-valuetext", at("hour").textContent);
  }
  function show(frame) {
    const before = pingAt(state.frame);
    state.frame = Math.max(0, Math.min(fleet.hour.length - 1, frame));
    const ping = pingAt(state.frame);
    if (ping === before) return drawFleet();
    // the chosen pair goes along, so that all pictures show one hour
    const same = state.link === null ? undefined : linksOf(ping).find((link) => nameOf(link) === nameOf(state.link));
    state.link = same ?? null;
    listLinks();
    showLink();
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
    at("columns").textContent = `Pair: distance${at("which").value === "rays" ? ", time" : ""}: range error in each direction, or reason for none`;
    at("links").replaceChildren(...rows.map((link) => {
      const heard = links.error[link].some((value) => value !== null);
      const text = heard ? links.error[link].filter((v) => v !== null).map((v) => metres(v)).join(", ") : data.statuses[links.status[link]];
      const when = at("which").value === "rays" ? `, ${hourOf(link)}` : "";
      return new Option(`${every ? "" : sections.has(link) ? "* " : "  "}${nameOf(link)}: ${(links.distance[link] / 1e3).toFixed(2)} km${when}: ${text}`, link, false, link === state.link);
    }));
  }
  function describe(link, section) {
    const words = [`${nameOf(link)}, ${hourOf(link)}: ${(links.distance[link] / 1e3).toFixed(3)} km, ${data.statuses[links.status[link]]}.`];
    links.error[link].forEach((error, way) => {
      if (error === null) return;
      const [from, to] = way === 0 ? [links.first, links.second] : [links.second, links.first];
      words.push(`From ${fleet.names[from[link]]} to ${fleet.names[to[link]]} the range error is ${metres(error)}: reference speed ${metres(links.reference[link][way])}, bending ${metres(links.bending[link][way])}.`);
    });
    if (section) section.time.forEach((time, ray) => words.push(
      `Ray ${ray + 1}: ${(1e3 * time).toFixed(3)} ms, ${section.surface[ray]} surface and ${section.bottom[ray]} bottom bounces, spreading loss ${String(section.spreading[ray]).replace("-", "−")} dB above spherical.`));
    return words.join(" ");
  }
  function commandOf(link) {
    const ends = [links.first[link], links.second[link]].map((who) => [...place(who, links.ping[link])].join(","));
    return `${data.command} --source=${ends[0]} --receiver=${ends[1]}`;
  }
  function choose(link) {
    state.link = link;
    const frame = fleet.ping[links.ping[link]];
    if (frame !== state.frame) {
      state.frame = frame;
      listLinks();
    }
    showLink();
  }
  function showLink() {
    const link = state.link;
    const section = sections.get(link);
    at("link").textContent = link === null ? "Select a link." : describe(link, section);
    at("command").hidden = link === null || section !== undefined;
    if (!at("command").hidden) at("command").querySelector("code").textContent = commandOf(link);
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
      { type: "scatter", mode: "lines+markers", name: "chord", x: [0, far], y: section.ends, line: { color: "#1a1a1a", dash: "dash", width: 1.6 }, marker: { color: "#ffffff", size: 8, line: { color: "#1a1a1a", width: 1.5 } }, hoverinfo: "skip" },
      { type: "scatter", mode: "lines", x: [0, far], y: [2 * deepest, 2 * deepest], line: { width: 0 }, showlegend: false, hoverinfo: "skip" },
      { type: "scatter", mode: "lines", x: section.range, y: section.bed, fill: "tonexty", fillcolor: "#8d7f70", line: { color: "#4a4038", width: 2 }, showlegend: false, hoverinfo: "skip" },
    ];
    const named = (text, x, y, side) => ({ text: `<b>${text}</b>`, x, y, xanchor: side, showarrow: false, xshift: side === "left" ? 8 : -8, yshift: -12, font: { color: "#1a1a1a" }, bgcolor: "rgba(255,255,255,0.75)" });
    draw("rays", traces, {
      xaxis: { title: { text: "Range [m]" }, range: [0, far] }, yaxis: { title: { text: "Depth [m]" }, range: [deepest, 0] },
      showlegend: true, legend: { orientation: "h", y: 1.02, yanchor: "bottom", bgcolor: "#eef2f5", font: { color: "#1a1a1a" } }, margin: { l: 60, r: 15, t: 30, b: 45 },
      annotations: section
        ? [named(shownNames[links.first[link]], 0, section.ends[0], "left"), named(shownNames[links.second[link]], far, section.ends[1], "right")]
        : [{ text: link === null ? "no link selected" : "This page does not have the rays of this link.<br>The command below draws them.", showarrow: false, x: 0.5, y: 0.5, xref: "paper", yref: "paper" }],
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
        type: webgl ? "scattergl" : "scatter", mode: "markers", x: part.x, y: part.y, customdata: part.link, text: part.link.map((link) => nameOf(link, shownNames)),
        marker: { color: colour, size, opacity }, hovertemplate: "%{text}<br>%{y:.2f} m<extra></extra>",
      });
      draw(id, [dots(all, dark.matches ? "#56B4E9" : "#0072B2", 4, chosen === null ? 0.5 : 0.25), dots(mine, "#D55E00", 8, 1)], { xaxis: { title: { text: title } }, yaxis: { title: { text: "Range error [m]" } } });
    }
  }

  // position errors
  function drawOverTime() {
    const v = Number(at("vehicle").value);
    const traces = errors.conditions.flatMap((condition) => [
      { type: "scatter", mode: "lines", name: shownConditions.get(condition.label), x: errors.hour, y: condition.rms[v], line: { color: condition.colour, dash: condition.dash } },
      ...(condition.sigma3 ? [{ type: "scatter", mode: "markers", name: `${shownConditions.get(condition.label)}, 3 sigma`, showlegend: false, x: condition.sigma_hour, y: condition.sigma3[v], marker: { color: condition.colour, size: 5, symbol: "circle-open" } }] : []),
    ]);
    draw("over-time", traces, { showlegend: true, legend: { orientation: "h", y: 1.15 }, margin: { l: 60, r: 15, t: 40, b: 45 }, xaxis: { title: { text: "Time [h]" } }, yaxis: { title: { text: "Position error [m]" }, type: "log" } });
  }
  function drawEstimates() {
    at("estimates").hidden = !errors.conditions.length;
    if (!errors.conditions.length) return;
    drawOverTime();
    const share = Array.from({ length: 101 }, (_, i) => i);
    draw("distribution", errors.conditions.map((c) => ({ type: "scatter", mode: "lines", name: shownConditions.get(c.label), x: c.quantiles, y: share, line: { color: c.colour, dash: c.dash } })), {
      showlegend: true, legend: { orientation: "h", y: 1.15 }, margin: { l: 60, r: 15, t: 40, b: 45 },
      xaxis: { title: { text: "Position error [m]" }, type: "log" }, yaxis: { title: { text: "Poses with a smaller error [%]" } },
    });
    at("nees-part").hidden = !nees.length;
    if (!nees.length) return;
    const of = (name) => nees.filter((row) => row.condition === name);
    const traces = errors.conditions.filter((c) => of(c.name).length).map((c) => ({ type: "scatter", mode: "lines+markers", name: shownConditions.get(c.label), x: of(c.name).map((r) => r.time_h), y: of(c.name).map((r) => r.ratio), line: { color: c.colour } }));
    const bounds = of(nees[0].condition);
    for (const side of ["low", "high"]) traces.push({ type: "scatter", mode: "lines+markers", x: bounds.map((r) => r.time_h), y: bounds.map((r) => r[side]), line: { color: ink(), dash: "dash", width: 1 }, marker: { color: ink(), symbol: "line-ew-open", size: 10 }, showlegend: false, hoverinfo: "skip" });
    draw("nees", traces, { showlegend: true, legend: { orientation: "h", y: 1.15 }, margin: { l: 60, r: 15, t: 40, b: 45 }, xaxis: { title: { text: "Time [h]" } }, yaxis: { title: { text: "NEES / degrees of freedom" }, type: "log" } });
  }

  function drawAll() {
    drawFleet();
    listLinks();
    drawEstimates();
    if (state.link !== null) choose(state.link);
    else showLink();
  }
  at("vehicle").replaceChildren(...fleet.names.slice(0, fleet.vehicles).map((name, v) => new Option(name, v)));
  at("vehicle").value = fleet.first;
  at("time").max = fleet.hour.length - 1;
  at("time").addEventListener("input", () => { stop(); show(Number(at("time").value)); });
  at("play").addEventListener("click", play);
  at("before").addEventListener("click", () => { stop(); toPing(-1); });
  at("after").addEventListener("click", () => { stop(); toPing(1); });
  at("which").addEventListener("change", listLinks);
  at("links").addEventListener("change", () => choose(Number(at("links").value)));
  at("vehicle").addEventListener("change", drawOverTime);
  dark.addEventListener("change", drawAll);
  // the largest range error of the first ping with rays, so that the mission plays from its beginning
  const first = Math.min(...data.rays.map((section) => links.ping[section.link]));
  state.link = data.rays.map((section) => section.link).filter((link) => links.ping[link] === first).reduce((worst, link) => (worst === null || largest(link) > largest(worst) ? link : worst), null);
  if (state.link !== null) state.frame = fleet.ping[links.ping[state.link]];
  at("shown").textContent = [
    every ? "" : `This page has the rays of ${sections.size} of ${links.ping.length} links, marked with a star. For other links it prints a command.`,
    fleet.ping.length < data.pings ? `It has ${fleet.ping.length} of ${data.pings} pings.` : "",
    webgl ? "" : "This browser has no WebGL: the fleet is a map, coloured by depth.",
  ].join(" ").trim();
  at("fleet").classList.toggle("solid", webgl);
  drawAll();
  for (const id of ["fleet", "by-distance", "by-depth"]) {
    at(id).on("plotly_click", (event) => {
      const link = event.points[0].customdata;
      if (link !== undefined && link !== null) choose(Number(Array.isArray(link) ? link[0] : link));
    });
  }
});
