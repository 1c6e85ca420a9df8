// SPDX-License-Identifier: Apache-2.0
// Depth, sigma, kind and place of a pixel; distance and height between two points. Nothing here touches the page.
const fcsvMeasure = {
  // A value of pixel_view.log_codes; NaN where there is none.
  decoded: (code, low, step) => (code === 0 ? NaN : low * Math.exp((code - 1) * step)),

  // Whole pixel (u, v) under a place (x, y), both shares 0 to 1 of the shown picture.
  pixelAt(about, x, y) {
    const inside = (share, size) => Math.min(size - 1, Math.max(0, Math.floor(share * size)));
    return [inside(x, about.width), inside(y, about.height)];
  },

  kindName(about, code) {
    return code >= 2 && code <= about.most_pairs ? "agreed" : about.kinds[code] || about.kinds[0];
  },

  // Of the kept pixel nearest to (u, v): depth_m, sigma_m, kind, place_m in home, and way = change of the place per
  // metre of depth.
  pixel(about, codes, u, v) {
    const rows = codes.depth.length / about.columns;
    const column = Math.min(about.columns - 1, Math.round(u / about.step));
    const row = Math.min(rows - 1, Math.round(v / about.step));
    const i = row * about.columns + column;
    const depth_m = fcsvMeasure.decoded(codes.depth[i], about.depth_low_m, about.depth_step);
    const sigma_m = fcsvMeasure.decoded(codes.sigma[i], about.sigma_low_m, about.sigma_step);
    [u, v] = [column * about.step, row * about.step];
    const ray = [(u - about.cx) / about.fx, (v - about.cy) / about.fy, 1];
    const way = about.T_home_cam.map((r) => r[0] * ray[0] + r[1] * ray[1] + r[2] * ray[2]);
    const place_m = way.map((w, k) => about.T_home_cam[k][3] + depth_m * w + about.origin_m[k]);
    return {u, v, depth_m, sigma_m, code: codes.kind[i], kind: fcsvMeasure.kindName(about, codes.kind[i]), place_m, way};
  },

  // The way of a point of the cloud: the line from the camera through it, per metre along the camera's axis.
  wayOf(place_m, camera_m, axis) {
    const from = place_m.map((p, k) => p - camera_m[k]);
    const depth_m = from.reduce((sum, f, k) => sum + f * axis[k], 0);
    return from.map((f) => f / depth_m);
  },

  // Distance and height from a to b with the standard deviation that both depths' errors, taken as independent, give
  // them. A point has place_m, way, sigma_m.
  between(a, b) {
    const apart = b.place_m.map((p, k) => p - a.place_m[k]);
    const distance_m = Math.hypot(...apart);
    const along = (p, unit) => p.sigma_m * p.way.reduce((sum, w, k) => sum + w * unit[k], 0);
    const sigma = (unit) => Math.hypot(along(a, unit), along(b, unit));
    const unit = apart.map((d) => (distance_m > 0 ? d / distance_m : 0));
    return {distance_m, distance_sigma_m: sigma(unit), height_m: apart[2], height_sigma_m: sigma([0, 0, 1])};
  },

  metres(value, sigma) {
    const digits = Number.isFinite(sigma) && sigma > 0 ? Math.min(3, Math.max(0, 1 - Math.floor(Math.log10(sigma)))) : 2;
    if (!Number.isFinite(value)) return "none";
    return value.toFixed(digits) + (Number.isFinite(sigma) ? " ± " + sigma.toFixed(digits) : "") + " m";
  },

  pixelWords(name, p, words) {
    const pairs = p.kind === "agreed" ? `${p.code} pairs` : words[p.kind].split(": ").pop();
    const said = `${name}: pixel (${p.u}, ${p.v}), ${p.kind} (${pairs})`;
    if (!Number.isFinite(p.depth_m)) return `${said}; no depth`;
    const place = p.place_m.map((x, k) => "xyz"[k] + " " + x.toFixed(2)).join(", ");
    return `${said}; depth ${fcsvMeasure.metres(p.depth_m, p.sigma_m)}; in home ${place} m`;
  },

  betweenWords(a, b, up) {
    const m = fcsvMeasure.between(a, b);
    if (!Number.isFinite(m.distance_m)) return "A to B: a point without depth cannot be measured";
    const height = up ? `; height ${fcsvMeasure.metres(m.height_m, m.height_sigma_m)}` : "";
    return `A to B: distance ${fcsvMeasure.metres(m.distance_m, m.distance_sigma_m)}${height}`;
  },

  async unpacked(text) {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return await new Response(stream).arrayBuffer();
  },
};
