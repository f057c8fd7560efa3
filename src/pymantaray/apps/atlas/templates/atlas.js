start((data) => {
  const { time, lat, lon, conventions, distances, pairs } = data;
  // length of a degree of latitude over that of one of longitude, as on the maps of the figures
  const degree = 1 / Math.max(Math.cos(((lat[0] + lat[lat.length - 1]) / 2) * (Math.PI / 180)), 0.02);
  const shape = [time.length, lat.length, lon.length, conventions.length, pairs.length, distances.length];
  const one = (place) => data.error[place.reduce((sum, index, dim) => sum * shape[dim] + index, 0)];
  const chosen = () => Object.fromEntries(["convention", "distance", "pair", "time", "lat", "lon"].map((id) => [id, Number(at(id).value)]));
  function error(t, i, j, convention, pair, distance) {
    if (pair >= 0) return one([t, i, j, convention, pair, distance]);
    const known = pairs.map((_, p) => one([t, i, j, convention, p, distance])).filter((value) => value !== null);
    return known.length ? Math.max(...known) : null;
  }
  const words = (name, value) => `${Math.abs(value).toFixed(2)}° ${name === "lat" ? (value < 0 ? "S" : "N") : value < 0 ? "W" : "E"}`;
  function showMap() {
    const c = chosen();
    const z = lat.map((_, i) => lon.map((_, j) => error(c.time, i, j, c.convention, c.pair, c.distance)));
    const known = z.flat().filter((value) => value !== null && value > 0);
    const [least, most] = known.length ? [Math.max(known.reduce((x, y) => Math.min(x, y)), 1e-3), known.reduce((x, y) => Math.max(x, y))] : [0.1, 1];
    const [low, high] = [Math.log10(least), Math.log10(Math.max(most, least))];
    const ticks = logTicks(least, Math.max(most, least));
    draw("map", [
      { type: "heatmap", x: lon, y: lat, z: z.map((row) => row.map((value) => (value === null ? null : Math.log10(Math.max(value, 1e-3))))), customdata: z, zmin: low, zmax: Math.max(high, low + 1e-3), colorscale: data.colours,
        colorbar: { title: { text: "error [m]" }, thickness: 10, tickvals: ticks.map(Math.log10), ticktext: ticks.map((x) => String(Number(x.toPrecision(3)))) }, hovertemplate: "%{y:.2f}, %{x:.2f}: %{customdata:.2f} m<extra></extra>" },
      { type: "scatter", mode: "markers", x: [lon[c.lon]], y: [lat[c.lat]], marker: { symbol: "circle-open", size: 14, color: "#D55E00", line: { width: 3 } }, hoverinfo: "skip" },
    ], { xaxis: { title: { text: "Longitude [°]" }, ticksuffix: "°", constrain: "domain" }, yaxis: { title: { text: "Latitude [°]" }, ticksuffix: "°", constrain: "domain", scaleanchor: "x", scaleratio: degree } });
    at("instant").textContent = time[c.time];
    at("time").setAttribute("aria-valuetext", time[c.time]);
    showPlace();
  }
  function showPlace() {
    const c = chosen();
    const place = `${words("lat", lat[c.lat])}, ${words("lon", lon[c.lon])}`;
    for (const id of ["lat", "lon"]) at(id).setAttribute("aria-valuetext", words(id, data[id][c[id]]));
    const here = error(c.time, c.lat, c.lon, c.convention, c.pair, c.distance);
    at("here").textContent = `${place}, ${distances[c.distance] / 1e3} km, ${conventions[c.convention].name}: ${here === null ? "no direct path, or no water" : `${here.toFixed(2)} m`}`;
    const lines = (x, value) => conventions.map((convention, k) => ({ type: "scatter", mode: "lines+markers", name: convention.name, x, y: x.map((_, n) => value(k, n)), line: { color: convention.colour }, marker: { color: convention.colour } }));
    const common = { showlegend: true, legend: { orientation: "h", y: 1.02, yanchor: "bottom" }, margin: { l: 60, r: 15, t: 70, b: 45 }, yaxis: { title: { text: "Largest range error [m]" }, type: "log" } };
    draw("over-distance", lines(distances.map((d) => d / 1e3), (k, n) => error(c.time, c.lat, c.lon, k, c.pair, n)), { ...common, xaxis: { title: { text: "Distance [km]" } } });
    at("over-time").hidden = time.length < 2;
    if (time.length > 1) draw("over-time", lines(time, (k, n) => error(n, c.lat, c.lon, k, c.pair, c.distance)), { ...common, xaxis: { title: { text: "Time (UTC)", standoff: 8 }, automargin: true } });
  }
  at("convention").replaceChildren(...conventions.map((c, k) => new Option(c.name, k)));
  at("distance").replaceChildren(...distances.map((d, k) => new Option(`${d / 1e3} km`, k)));
  at("pair").replaceChildren(new Option("the worst of all", -1), ...pairs.map(([a, b], k) => new Option(`${a} m to ${b} m`, k)));
  at("time").max = time.length - 1;
  at("when").hidden = time.length < 2;
  // the first place is the one with an error that is nearest to the middle
  const middle = [lat, lon].map((axis) => Math.floor(axis.length / 2));
  const first = lat.flatMap((_, i) => lon.map((_, j) => [i, j])).filter(([i, j]) => error(0, i, j, 0, -1, 0) !== null)
    .reduce((best, place) => {
      const far = ([i, j]) => Math.hypot(i - middle[0], j - middle[1]);
      return best === null || far(place) < far(best) ? place : best;
    }, null) ?? middle;
  for (const [k, id] of ["lat", "lon"].entries()) {
    at(id).max = data[id].length - 1;
    at(id).value = first[k];
    at(id).addEventListener("input", showMap);
  }
  for (const id of ["convention", "distance", "pair"]) at(id).addEventListener("change", showMap);
  at("time").addEventListener("input", showMap);
  dark.addEventListener("change", showMap);
  showMap();
  at("map").on("plotly_click", (event) => {
    const point = event.points[0];
    at("lat").value = lat.indexOf(point.y);
    at("lon").value = lon.indexOf(point.x);
    showMap();
  });
});
