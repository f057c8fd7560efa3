// how a scene in three dimensions is first seen: it fills its panel, and names do not cover each other
const minus = (a, b) => a.map((value, k) => value - b[k]);
const dot = (a, b) => a.reduce((sum, value, k) => sum + value * b[k], 0);
const times = (a, factor) => a.map((value) => value * factor);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => times(a, 1 / Math.hypot(...a));
// axes of the picture for a camera: right, up, forward
function cameraAxes(eye, center) {
  const forward = unit(minus(center, eye));
  const right = unit(cross(forward, [0, 0, 1]));
  return [right, cross(right, forward), forward];
}
// places of points in pixels from the middle of the panel, right and down; the camera of plotly sees 45 degrees over its height
function projected(points, { eye, center }, panelHeight) {
  const [right, up, forward] = cameraAxes(eye, center);
  const scale = panelHeight / 2 / Math.tan(Math.PI / 8);
  return points.map((point) => {
    const from = minus(point, eye);
    const depth = dot(from, forward);
    return [(scale * dot(from, right)) / depth, (-scale * dot(from, up)) / depth];
  });
}
// nearest camera in a direction from which a box of these sides about the origin is at most so wide and high [pixels], in the middle of
// a panel of this height
function fittingCamera(sides, direction, panelHeight, [width, height]) {
  const corners = [-0.5, 0.5].flatMap((x) => [-0.5, 0.5].flatMap((y) => [-0.5, 0.5].map((z) => [x * sides[0], y * sides[1], z * sides[2]])));
  for (let distance = Math.hypot(...sides) / 2; ; distance *= 1.02) {
    let center = [0, 0, 0];
    for (let pass = 0; ; pass += 1) {
      const eye = minus(center, times(unit(direction), -distance));
      const pixels = projected(corners, { eye, center }, panelHeight);
      const [low, high] = [Math.min, Math.max].map((pick) => [0, 1].map((k) => pick(...pixels.map((pixel) => pixel[k]))));
      const size = minus(high, low);
      if (pass === 6) {
        if ((size[0] <= width && size[1] <= height) || distance > 20) return { eye, center };
        break;
      }
      const [right, up] = cameraAxes(eye, center);
      const [x, y] = [0, 1].map((k) => ((low[k] + high[k]) * distance * Math.tan(Math.PI / 8)) / panelHeight);
      center = minus(center, minus(times(up, y), times(right, x)));
    }
  }
}
// side of each marker on which its name stands: away from the middle of all, where there are fewer lines, such that names cover
// neither markers nor other names if there is a free side
function sidesOfNames(pixels, names) {
  const middle = [0, 1].map((k) => pixels.reduce((sum, pixel) => sum + pixel[k], 0) / pixels.length);
  const ways = ["middle right", "middle left", "top center", "bottom center", "top right", "top left", "bottom right", "bottom left"];
  const box = ([x, y], name, way) => {
    const [vertical, horizontal] = way.split(" ");
    const half = 4 * name.length;
    const [dx, dy] = [{ left: -half - 8, center: 0, right: half + 8 }[horizontal], { top: -14, middle: 0, bottom: 14 }[vertical]];
    return [x + dx - half, y + dy - 7, x + dx + half, y + dy + 7];
  };
  const taken = pixels.map(([x, y]) => [x - 6, y - 6, x + 6, y + 6]);
  const meets = (a, b) => a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
  const outward = ([x, y], way) => {
    const [vertical, horizontal] = way.split(" ");
    const [dx, dy] = unit([{ left: -1, center: 0, right: 1 }[horizontal], { top: -1, middle: 0, bottom: 1 }[vertical]]);
    return dx * (x - middle[0]) + dy * (y - middle[1]);
  };
  return pixels.map((pixel, v) => {
    const sorted = [...ways].sort((one, other) => outward(pixel, other) - outward(pixel, one));
    const counts = sorted.map((way) => taken.filter((other, w) => w !== v && meets(box(pixel, names[v], way), other)).length);
    const way = sorted[counts.indexOf(Math.min(...counts))];
    taken.push(box(pixel, names[v], way));
    return way;
  });
}
