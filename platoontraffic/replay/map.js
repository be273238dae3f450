// The map: road, vehicles, and one laser's view.

const BEAM_SPACING = 7; // least distance between the ends of drawn beams; all of them would merge into a surface [pixels]
const TRAIL = 30; // length of the paths behind vehicles [s]

class Palette {
  constructor() {
    this.read();
  }

  /** From the style sheet, which knows whether it is light or dark. */
  read() {
    const style = getComputedStyle(document.documentElement);
    this.of = (name) => style.getPropertyValue(name).trim();
    const named = ["ground", "road", "junction", "lane", "middle", "wall", "building", "other",
      "other-edge", "ink", "faint", "fan", "beam", "return", "segment", "remembered", "right", "wrong", "warn", "panel", "line", "obstacle", "go", "stop", "amber"];
    for (const name of named) this[name] = this.of(`--${name}`);
    this.order = [0, 1, 2, 3, 4, 5, 6, 7].map((place) => this.of(`--place-${place}`));
  }

  member(place) {
    return this.order[place % this.order.length];
  }
}

function pathOf(lines, closed) {
  const path = new Path2D();
  for (const { x, y } of lines ?? []) {
    for (let i = 0; i < x.length; i++) i ? path.lineTo(x[i], y[i]) : path.moveTo(x[i], y[i]);
    if (closed) path.closePath();
  }
  return path;
}

class RoadMap {
  constructor(canvas, run, palette) {
    this.run = run;
    this.palette = palette;
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.ground = document.createElement("canvas");
    this.grounds = null; // the view that `ground` shows
    const areas = ["road", "junctions", "buildings"];
    this.paths = Object.fromEntries(["road", "junctions", "buildings", "lanes", "middle", "walls"].map((kind) =>
      [kind, pathOf(run.scene[kind], areas.includes(kind))]));
    const edges = [Infinity, Infinity, -Infinity, -Infinity];
    for (const lines of Object.values(run.scene)) {
      for (const { x, y } of lines) {
        for (let i = 0; i < x.length; i++) {
          edges[0] = Math.min(edges[0], x[i]);
          edges[1] = Math.min(edges[1], y[i]);
          edges[2] = Math.max(edges[2], x[i]);
          edges[3] = Math.max(edges[3], y[i]);
        }
      }
    }
    this.bounds = Number.isFinite(edges[0]) ? edges : [-10, -10, 10, 10];
  }

  /** Draw one frame; returns what is on it. `view`: selected member, layers, platoon. */
  draw(camera, time, view) {
    const { context, run, palette } = this;
    const drawn = { time, members: [], traffic: 0, scan: null, remembered: 0, target: null };
    this.#ground(camera, view.layers);
    context.setTransform(camera.ratio, 0, 0, camera.ratio, 0, 0);
    const when = run.members.instant(time);
    const chosen = run.members.pose(view.chosen, when);
    if (view.layers.paths) this.#trails(camera, time, when, view);
    if (chosen && view.layers.scan && run.scans) drawn.scan = this.#scan(camera, time, view);
    if (view.layers.signals && run.signals) drawn.signals = this.#signals(camera, time);
    if (run.traffic && view.layers.traffic) drawn.traffic = this.#traffic(camera, time, view);
    if (chosen && view.layers.remembered && run.scans) drawn.remembered = this.#remembered(camera, time, view);
    this.taken = []; // boxes of the labels of this frame, which give way to each other
    if (run.traffic && view.layers.obstacles) drawn.obstacles = this.#obstacles(camera, time, view);
    this.#members(camera, when, view, drawn);
    if (chosen && view.layers.target) drawn.target = this.#target(camera, chosen, when, view);
    if (view.layers.events) this.#events(camera, time, view);
    if (view.pointed) this.#pointed(camera, time, view.pointed);
    if (camera.rule) this.#rule(camera);
    this.#scaleBar(camera);
    return drawn;
  }

  /** What does not move is drawn once for a view, with something around it, and copied until the view has left that. */
  #ground(camera, layers) {
    const { context, ground, palette } = this;
    const key = [camera.scale, camera.width, camera.height, camera.ratio, layers.buildings, palette.ground].join();
    const margin = 0.25;
    const far = (a, b, size) => Math.abs(a - b) * camera.scale > margin * size;
    const old = this.grounds;
    if (old?.key !== key || far(old.x, camera.x, camera.width) || far(old.y, camera.y, camera.height)) {
      ground.width = Math.round(camera.width * (1 + 2 * margin) * camera.ratio);
      ground.height = Math.round(camera.height * (1 + 2 * margin) * camera.ratio);
      this.#drawGround(ground, camera, layers);
      this.grounds = { key, x: camera.x, y: camera.y };
    }
    const at = this.grounds;
    const dx = Math.round(((at.x - camera.x) * camera.scale - margin * camera.width) * camera.ratio);
    const dy = Math.round(((camera.y - at.y) * camera.scale - margin * camera.height) * camera.ratio);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(ground, dx, dy);
  }

  #drawGround(ground, camera, layers) {
    const context = ground.getContext("2d", { alpha: false });
    const { paths, palette } = this;
    context.fillStyle = palette.ground;
    context.fillRect(0, 0, ground.width, ground.height);
    const k = camera.scale * camera.ratio;
    context.setTransform(k, 0, 0, -k, ground.width / 2 - camera.x * k, ground.height / 2 + camera.y * k);
    const pixel = 1 / camera.scale;
    const town = this.run.town;
    context.lineJoin = context.lineCap = "round";
    if (layers.buildings) {
      context.fillStyle = palette.building;
      context.fill(paths.buildings, "evenodd");
    }
    context.fillStyle = palette.road;
    context.fill(paths.road, "evenodd");
    context.strokeStyle = palette.road;
    context.lineWidth = 1.2 * pixel; // a town's streets are not lost from afar
    context.stroke(paths.road);
    context.fillStyle = palette.junction;
    context.fill(paths.junctions, "evenodd");
    const mark = (path, colour, width, dash) => {
      context.strokeStyle = colour;
      context.lineWidth = Math.max(width, 0.7 * pixel);
      context.setLineDash(dash);
      context.lineCap = dash.length ? "butt" : "round";
      context.stroke(path);
      context.setLineDash([]);
    };
    if (camera.scale * (town ? 3 : 0.6) > 5) mark(paths.lanes, palette.lane, town ? 0.14 : 0.02, town ? [3, 5] : [0.15, 0.2]);
    if (camera.scale * (town ? 3 : 0.6) > 2) mark(paths.middle, palette.middle, town ? 0.14 : 0.02, []);
    if (layers.buildings) mark(paths.walls, palette.wall, town ? 0.25 : 0.03, []);
  }

  /** Stop lines of traffic lights in their colours; returns the number of links that are green. */
  #signals(camera, time) {
    const { context, palette, run } = this, { links, states } = run.signals;
    const now = Object.fromEntries(Object.entries(states).map(([light, [times, texts]]) => [light, texts[lastUpTo(times, time + SOON)]]));
    let green = 0;
    context.lineCap = "butt";
    context.lineWidth = Math.max(0.5 * camera.scale, 3);
    run.scene.signals.forEach(({ x, y }, k) => {
      const [light, number] = links[k], letter = now[light]?.[number]?.toLowerCase();
      if (letter === "g") green++;
      context.strokeStyle = letter === "g" ? palette.go : letter === "r" ? palette.stop : letter === "y" || letter === "u" ? palette.amber : palette.faint;
      context.beginPath();
      context.moveTo(...camera.screen(x[0], y[0]));
      context.lineTo(...camera.screen(x[x.length - 1], y[y.length - 1]));
      context.stroke();
    });
    return green;
  }

  /** A vehicle's outline, its front corners cut, in pixels; never too small to be seen. */
  #outline(context, camera, x, y, heading, length, width, least) {
    const [px, py] = camera.screen(x, y);
    const a = Math.max(length * camera.scale, least) / 2, b = Math.max(width * camera.scale, 0.5 * least) / 2;
    const cos = Math.cos(heading), sin = -Math.sin(heading);
    const reach = a + b;
    if (px < -reach || py < -reach || px > camera.width + reach || py > camera.height + reach) return false;
    const corner = (u, v, first) => {
      const cx = px + u * cos + v * sin, cy = py + u * sin - v * cos;
      first ? context.moveTo(cx, cy) : context.lineTo(cx, cy);
    };
    corner(-a, b, true);
    corner(-a, -b);
    corner(a - 0.7 * b, -b);
    corner(a, -0.45 * b);
    corner(a, 0.45 * b);
    corner(a - 0.7 * b, b);
    context.closePath();
    return true;
  }

  #traffic(camera, time, view) {
    const { context, palette, run } = this, { traffic } = run;
    let n = 0;
    context.beginPath();
    let followed = null;
    traffic.forEach(traffic.instant(time), (v, x, y, heading) => {
      if (run.obstacle[v]) return;
      if (view.follows?.traffic === v) followed = [x, y, heading, v];
      n += this.#outline(context, camera, x, y, heading, traffic.length[v], traffic.width[v], 5);
    });
    context.fillStyle = palette.other;
    context.fill();
    context.strokeStyle = palette["other-edge"];
    context.lineWidth = 0.8;
    if (camera.scale * (this.run.town ? 4 : 0.2) > 8) context.stroke();
    if (followed) {
      const [x, y, heading, v] = followed;
      context.beginPath();
      this.#outline(context, camera, x, y, heading, traffic.length[v], traffic.width[v], 8);
      context.strokeStyle = palette.ink;
      context.lineWidth = 2;
      context.stroke();
      this.#label(camera, x, y, traffic.ids[v], palette.ink);
    }
    return n;
  }

  /** Cars that cut in, pedestrians and other obstacles, with their names; returns their number. */
  #obstacles(camera, time, view) {
    const { context, palette, run } = this, { traffic } = run;
    let n = 0;
    traffic.forEach(traffic.instant(time), (v, x, y, heading) => {
      if (!run.obstacle[v]) return;
      context.beginPath();
      if (!this.#outline(context, camera, x, y, heading, traffic.length[v], traffic.width[v], 9)) return;
      context.fillStyle = palette.obstacle;
      context.fill();
      context.strokeStyle = view.follows?.traffic === v ? palette.ink : palette.ground;
      context.lineWidth = 1.5;
      context.stroke();
      this.#label(camera, x, y, traffic.ids[v], palette.ink);
      n++;
    });
    return n;
  }

  /** A thin frame round the vehicle that is pointed at. */
  #pointed(camera, time, pointed) {
    const { context, palette, run } = this;
    const tracks = pointed.member !== undefined ? run.members : run.traffic, v = pointed.member ?? pointed.traffic;
    const pose = tracks.pose(v, tracks.instant(time));
    if (!pose) return;
    const [px, py] = camera.screen(pose.x, pose.y);
    context.strokeStyle = palette.ink;
    context.lineWidth = 1;
    context.beginPath();
    context.arc(px, py, Math.max(0.6 * tracks.length[v] * camera.scale, 9), 0, 2 * Math.PI);
    context.stroke();
  }

  /** What is measured, with its length. */
  #rule(camera) {
    const { context, palette } = this;
    const [a, b] = camera.rule, [ax, ay] = camera.screen(...a), [bx, by] = camera.screen(...b);
    context.beginPath();
    for (const [x, y] of [[ax, ay], [bx, by]]) context.rect(x - 2.5, y - 2.5, 5, 5);
    context.moveTo(ax, ay);
    context.lineTo(bx, by);
    for (const [width, colour] of [[4, palette.ground], [1.6, palette.ink]]) {
      context.lineWidth = width;
      context.strokeStyle = colour;
      context.stroke();
    }
    const length = Math.hypot(a[0] - b[0], a[1] - b[1]);
    this.taken = [];
    this.#label(camera, b[0], b[1], `${length.toFixed(2)} m`, palette.ink);
  }

  #members(camera, when, view, drawn) {
    const { context, palette, run: { members } } = this;
    const near = camera.scale * members.width[view.chosen] > 9;
    members.forEach(when, (v, x, y, heading, row) => {
      const colour = palette.member(members.place[v]);
      const mine = members.platoon[v] === members.platoon[view.chosen];
      context.beginPath();
      const seen = this.#outline(context, camera, x, y, heading, members.length[v], members.width[v], v === view.chosen ? 11 : 9);
      drawn.members.push({ id: members.ids[v], x, y, heading, row, seen });
      if (!seen) return;
      context.globalAlpha = mine ? 1 : 0.75;
      context.fillStyle = colour;
      context.fill();
      context.globalAlpha = 1;
      context.strokeStyle = v === view.chosen ? palette.ink : palette.ground;
      context.lineWidth = v === view.chosen ? 2.4 : 1;
      context.stroke();
      const [px, py] = camera.screen(x, y);
      if (near) {
        context.fillStyle = contrasting(colour);
        context.font = `600 ${Math.min(Math.max(members.width[v] * camera.scale * 0.62, 8), 22)}px system-ui, sans-serif`;
        context.textAlign = "center";
        context.textBaseline = "middle";
        context.fillText(members.place[v], px, py);
      }
      if (view.layers.names && mine) this.#label(camera, x, y, members.ids[v], palette.ink);
    });
  }

  #label(camera, x, y, text, colour) {
    const { context, palette } = this;
    const [px, py] = camera.screen(x, y);
    context.font = "12px system-ui, sans-serif";
    const box = [px + 10, py - 22, px + 14 + context.measureText(text).width, py - 6];
    if (this.taken.some((one) => box[0] < one[2] && one[0] < box[2] && box[1] < one[3] && one[1] < box[3])) return;
    this.taken.push(box);
    context.textAlign = "left";
    context.textBaseline = "middle";
    context.lineWidth = 3;
    context.strokeStyle = palette.ground;
    context.strokeText(text, px + 12, py - 14);
    context.fillStyle = colour;
    context.fillText(text, px + 12, py - 14);
  }

  /** The path of the platoon's members over the last half minute. */
  #trails(camera, time, when, view) {
    const { context, palette, run: { members } } = this;
    const from = members.instant(time - TRAIL).i;
    context.lineWidth = 1.5;
    context.globalAlpha = 0.55;
    for (let v = 0; v < members.n; v++) {
      if (members.platoon[v] !== members.platoon[view.chosen]) continue;
      context.beginPath();
      for (const track of members.tracksOf[v]) {
        const begin = members.begin[track], first = members.first[track];
        const end = Math.min(members.begin[track + 1] - 1, begin + when.i - first);
        let started = false;
        for (let row = Math.max(begin, begin + from - first); row <= end; row++) {
          const [px, py] = camera.screen(members.x[row], members.y[row]);
          started ? context.lineTo(px, py) : context.moveTo(px, py);
          started = true;
        }
      }
      context.strokeStyle = palette.member(members.place[v]);
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  /** The last scan of the chosen member, where it was made; it fades until the next. */
  #scan(camera, time, view) {
    const { context, palette, run } = this;
    const scan = run.scans.at(view.chosen, time);
    if (!scan) return null;
    const { ends, kinds, samples } = scan;
    const fresh = 1 - 0.5 * Math.min(scan.age / scan.interval, 1);
    const [sx, sy] = camera.screen(scan.x, scan.y);
    const end = (beam) => camera.screen(ends[2 * beam], ends[2 * beam + 1]);

    context.globalAlpha = fresh;
    context.beginPath(); // the area that the beams sweep
    context.moveTo(sx, sy);
    for (let beam = 0; beam < samples; beam++) if (kinds[beam] !== LOST) context.lineTo(...end(beam));
    context.closePath();
    context.fillStyle = palette.fan;
    context.fill();

    context.beginPath();
    const every = Math.max(1, Math.ceil(BEAM_SPACING / (scan.farthest * scan.increment * camera.scale)));
    let beams = 0;
    for (let beam = 0; beam < samples; beam++) {
      if (kinds[beam] === LOST || (beam % every && beam !== samples - 1)) continue;
      context.moveTo(sx, sy);
      context.lineTo(...end(beam));
      beams++;
    }
    context.strokeStyle = palette.beam;
    context.lineWidth = 0.7;
    context.stroke();

    if (view.layers.segments) {
      context.lineCap = context.lineJoin = "round";
      context.strokeStyle = palette.segment;
      context.lineWidth = 5;
      context.beginPath();
      for (const [first, last] of scan.segments) {
        const behind = first > last ? last + samples : last; // across the seam of a full turn
        let started = false;
        for (let beam = first; beam <= behind; beam++) {
          if (kinds[beam % samples] !== FIRST) continue;
          started ? context.lineTo(...end(beam % samples)) : context.moveTo(...end(beam % samples));
          started = true;
        }
      }
      context.stroke();
    }

    context.fillStyle = palette.return;
    for (let beam = 0; beam < samples; beam++) {
      if (kinds[beam] !== FIRST) continue;
      const [px, py] = end(beam);
      context.fillRect(px - 1, py - 1, 2, 2);
    }
    context.globalAlpha = 1;
    return { time: scan.time, beams: samples, returns: scan.returns, segments: scan.segments.length };
  }

  /** The path that the selected member's law remembered at its last scan; returns its number of points. */
  #remembered(camera, time, view) {
    const { context, palette, run } = this;
    const path = run.scans.at(view.chosen, time)?.path ?? [];
    context.beginPath();
    path.forEach(([x, y], i) => i ? context.lineTo(...camera.screen(x, y)) : context.moveTo(...camera.screen(x, y)));
    context.strokeStyle = context.fillStyle = palette.remembered;
    context.lineWidth = 2;
    context.stroke();
    for (const [x, y] of path) {
      const [px, py] = camera.screen(x, y);
      context.fillRect(px - 2, py - 2, 4, 4);
    }
    return path.length;
  }

  /** What the law takes for its predecessor: a ring if it is that, else a cross; a square if there is no predecessor. */
  #target(camera, pose, when, view) {
    const { context, palette, run: { members } } = this;
    const target = members.targetPoint(view.chosen, pose, when.share);
    if (!target) return null;
    const id = members.targetId(pose.row), right = members.isRight(view.chosen, pose.row, when);
    const [sx, sy] = camera.screen(target.sensor.x, target.sensor.y);
    const [px, py] = camera.screen(target.x, target.y);
    const colour = right === null ? palette.ink : right ? palette.right : palette.wrong;
    const size = Math.min(Math.max(0.5 * members.width[view.chosen] * camera.scale, 4), 7);
    for (const [width, style] of [[5, palette.ground], [2.4, colour]]) {
      context.strokeStyle = style;
      context.lineWidth = width;
      context.setLineDash(width > 3 ? [] : [7, 4]);
      context.beginPath();
      context.moveTo(sx, sy);
      context.lineTo(px, py);
      context.stroke();
      context.setLineDash([]);
      context.beginPath();
      if (right) {
        context.arc(px, py, size, 0, 2 * Math.PI);
      } else if (right === null) {
        context.rect(px - size, py - size, 2 * size, 2 * size);
      } else {
        for (const s of [-1, 1]) {
          context.moveTo(px - size, py - size * s);
          context.lineTo(px + size, py + size * s);
        }
      }
      context.stroke();
    }
    return { id, right, x: target.x, y: target.y };
  }

  /** Where something has just happened. */
  #events(camera, time, view) {
    const { context, palette, run } = this;
    for (let i = lastUpTo(view.eventTimes, time + SOON); i >= 0 && time - run.events[i].time < 3; i--) {
      const event = run.events[i];
      if (Number.isNaN(event.x) || severity(event.kind) === "info") continue;
      const [px, py] = camera.screen(event.x, event.y);
      const age = (time - event.time) / 3;
      context.globalAlpha = 1 - age;
      context.strokeStyle = severity(event.kind) === "bad" ? palette.wrong : palette.warn;
      context.lineWidth = 3;
      context.beginPath();
      context.arc(px, py, 14 + 20 * age, 0, 2 * Math.PI);
      context.stroke();
      context.globalAlpha = 1;
    }
  }

  #scaleBar(camera) {
    const { context, palette } = this;
    const most = Math.min(160, camera.width / 3) / camera.scale;
    const power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].map((n) => n * power).find((n) => n <= most);
    const [x, y] = [14, camera.height - 14];
    context.strokeStyle = palette.ink;
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(x, y - 5);
    context.lineTo(x, y);
    context.lineTo(x + length * camera.scale, y);
    context.lineTo(x + length * camera.scale, y - 5);
    context.stroke();
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "left";
    context.textBaseline = "alphabetic";
    context.lineWidth = 3;
    context.strokeStyle = palette.ground;
    const text = length >= 1 ? `${length} m` : `${Math.round(length * 100)} cm`;
    context.strokeText(text, x + 5, y - 6);
    context.fillStyle = palette.ink;
    context.fillText(text, x + 5, y - 6);
  }

  /** Who is at a point of the canvas: {member} or {traffic}, or null. */
  at(px, py, camera, time) {
    let best = null, least = 16;
    const look = (tracks, kind, bonus) => tracks?.forEach(tracks.instant(time), (v, x, y) => {
      const [vx, vy] = camera.screen(x, y);
      const away = Math.hypot(vx - px, vy - py) - Math.min((tracks.length[v] * camera.scale) / 2, 40) - bonus;
      if (away < least) [best, least] = [{ [kind]: v }, away];
    });
    look(this.run.traffic, "traffic", 0);
    look(this.run.members, "member", 3);
    return best;
  }
}

/** Black or white, to be read on a colour. */
function contrasting(colour) {
  const [r, g, b] = [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16));
  return 0.299 * r + 0.587 * g + 0.114 * b > 140 ? "#000000" : "#ffffff";
}

/** How much an event matters; kinds that are not known here do. */
function severity(kind) {
  const fine = "departed|arrived|locked|lock_regained|standstill_end|on_road|end|rejoined|released|repaired|told|obstacle|obstacle_gone";
  if (new RegExp(`^(${fine})$`).test(kind)) return "info";
  return /^(collision|off_road|red_light|failed_to_yield|near_miss)$/.test(kind) ? "bad" : "warn";
}
