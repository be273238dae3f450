// The run: unpacked data, and the state of every vehicle at a time.

/** Bytes of a base64 text. */
function bytesOf(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const letters = atob(text);
  const bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  return bytes;
}

/** The header, and a reader of its columns; see columns.py for how they are written. */
async function unpacked(text) {
  const packed = new Blob([bytesOf(text.trim())]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = new Uint8Array(await new Response(packed).arrayBuffer());
  const length = new DataView(bytes.buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
  const start = 4 + length;

  function column(place, Numbers = Float64Array) {
    const { at, n, planes, step, lowest } = place;
    const gaps = lowest !== undefined;
    const values = new Numbers(n);
    let whole = 0;
    for (let i = 0; i < n; i++) {
      let signed = 0;
      for (let plane = planes - 1; plane >= 0; plane--) signed = signed * 256 + bytes[start + at + plane * n + i];
      whole += signed % 2 ? -(signed + 1) / 2 : signed / 2;
      values[i] = !gaps ? whole * step : whole === 0 ? NaN : (whole - 1 + lowest) * step;
    }
    return values;
  }
  return { header, column };
}

/** The last place in sorted `values` with a value up to `limit`; -1: there is none. */
function lastUpTo(values, limit, from = 0, to = values.length) {
  let low = from, high = to;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] <= limit) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

const SOON = 1e-6; // tolerance in comparisons of times [s]

/** Vehicles and where they were: rows by vehicle and instant, in tracks of instants that follow each other. */
class Tracks {
  constructor(given, column) {
    this.ids = given.ids;
    this.n = given.ids.length;
    this.times = column(given.times);
    this.length = column(given.length, Float32Array);
    this.width = column(given.width, Float32Array);
    this.vehicle = column(given.vehicle, Int32Array);
    this.first = column(given.first, Int32Array);
    this.begin = column(given.begin, Int32Array);
    for (const name of ["x", "y", "heading", "speed"]) this[name] = given[name] && column(given[name], Float32Array);
    this.tracksOf = Array.from({ length: this.n }, () => []);
    this.vehicle.forEach((v, track) => this.tracksOf[v].push(track));
  }

  /** Instant before a time (-1: there is none), and how far it is to the next one, 0 to 1; the last one at and after it. */
  instant(time) {
    const i = lastUpTo(this.times, time + SOON);
    const share = i >= 0 && i + 1 < this.times.length ? (time - this.times[i]) / (this.times[i + 1] - this.times[i]) : 0;
    return { i, share: Math.min(Math.max(share, 0), 1) };
  }

  /** Row of a track at an instant; -1: not there. */
  rowOf(track, { i }) {
    const row = this.begin[track] + i - this.first[track];
    return row >= this.begin[track] && row < this.begin[track + 1] ? row : -1;
  }

  /** Row of a vehicle at an instant; -1: not there. */
  row(vehicle, when) {
    for (const track of this.tracksOf[vehicle]) {
      const row = this.rowOf(track, when);
      if (row >= 0) return row;
    }
    return -1;
  }

  /** A value between a row and the next of its track. */
  between(values, row, share, last) {
    return row < last ? values[row] + share * (values[row + 1] - values[row]) : values[row];
  }

  /** Calls visit(vehicle, x, y, heading, row) for every vehicle on the road. */
  forEach(when, visit) {
    for (let track = 0; track < this.vehicle.length; track++) {
      const row = this.rowOf(track, when);
      if (row < 0) continue;
      const last = this.begin[track + 1] - 1;
      const at = (values) => this.between(values, row, when.share, last);
      visit(this.vehicle[track], at(this.x), at(this.y), at(this.heading), row);
    }
  }

  /** Pose of one vehicle, or null. */
  pose(vehicle, when) {
    for (const track of this.tracksOf[vehicle]) {
      const row = this.rowOf(track, when);
      if (row < 0) continue;
      const last = this.begin[track + 1] - 1;
      const at = (values) => this.between(values, row, when.share, last);
      return { x: at(this.x), y: at(this.y), heading: at(this.heading), row, last };
    }
    return null;
  }
}

/** Members, with what was measured of them. */
class Members extends Tracks {
  constructor(given, column) {
    super(given, column);
    this.platoon = given.platoons;
    this.place = given.places;
    this.targets = given.targets;
    this.laser = ["laserX", "laserY", "laserYaw"].map((name) => column(given[name], Float32Array));
    for (const name of ["acceleration", "gap", "error", "seenGap", "seenBearing"]) {
      this[name] = given[name] ? column(given[name], Float32Array) : new Float32Array(this.x.length).fill(NaN);
    }
    this.speed ??= new Float32Array(this.x.length).fill(NaN);
    this.target = column(given.target, Int32Array);
    this.predecessors = given.predecessors; // of each member: begin, end (null: that of the run) and number of each
  }

  /** Number of a vehicle's predecessor at an instant; -1: it follows nobody, or that has left the road. */
  ahead(vehicle, { i }) {
    const time = this.times[i];
    const stretch = this.predecessors[vehicle].find(([begin, end]) => begin <= time + SOON && time + SOON < (end ?? Infinity));
    return stretch ? stretch[2] : -1;
  }

  /** Whether the law's target, by row, is the predecessor: true or false; null if there is no predecessor. */
  isRight(vehicle, row, when) {
    const ahead = this.ahead(vehicle, when);
    return ahead < 0 ? null : this.targetId(row) === this.ids[ahead];
  }

  /** Object that the law's target lies on, by row: an id, "wall", or "". */
  targetId(row) {
    return this.target[row] < 0 ? "" : this.targets[this.target[row]];
  }

  /** Position of the law's target in the world; null: it has none. */
  targetPoint(vehicle, pose, share) {
    const next = pose.row < pose.last && this.target[pose.row + 1] === this.target[pose.row] ? pose.row + 1 : pose.row;
    const between = (values) => values[pose.row] + share * (values[next] - values[pose.row]);
    const gap = between(this.seenGap), bearing = between(this.seenBearing);
    if (Number.isNaN(gap) || Number.isNaN(bearing)) return null;
    const [ahead, aside, yaw] = this.laser.map((values) => values[vehicle]);
    // The gap is measured from the front bumper, the bearing from the laser.
    const distance = gap + this.length[vehicle] / 2 - ahead;
    const cos = Math.cos(pose.heading), sin = Math.sin(pose.heading);
    const sensor = { x: pose.x + ahead * cos - aside * sin, y: pose.y + ahead * sin + aside * cos };
    const angle = pose.heading + yaw + bearing;
    return { sensor, x: sensor.x + distance * Math.cos(angle), y: sensor.y + distance * Math.sin(angle) };
  }
}

const NOTHING = 0, TOO_NEAR = 1, LOST = 2, FIRST = 3; // see content.py

/** Scans by member and time. */
class Scans {
  constructor(given, column) {
    Object.assign(this, given);
    for (const name of ["samples", "laser", "segments", "segmentFirst", "segmentLast"]) {
      this[name] = column(given[name], Int32Array);
    }
    for (const name of ["time", "x", "y", "heading"]) this[name] = column(given[name]);
    this.ranges = column(given.ranges, Uint16Array);
    const { path } = given;
    this.path = path && { offset: column(path.offset, Int32Array), x: column(path.x), y: column(path.y) };
    this.offset = new Float64Array(this.time.length + 1);
    this.laserOf = new Map();
    const recorded = new Set(this.laser); // a member has several lasers, of which that of its law is here
    column(given.member, Int32Array).forEach((member, laser) => recorded.has(laser) && this.laserOf.set(member, laser));
    this.rows = this.angleMin.map(() => [this.time.length, 0]); // first scan of each laser, and behind the last
    for (let i = 0; i < this.time.length; i++) {
      const rows = this.rows[this.laser[i]];
      rows[0] = Math.min(rows[0], i);
      rows[1] = i + 1;
      this.offset[i + 1] = this.offset[i] + this.samples[this.laser[i]];
    }
  }

  /** The last scan of a member at a time, with how long it is valid; null: there is none, or another is overdue. */
  at(member, time) {
    const laser = this.laserOf.get(member);
    if (laser === undefined) return null;
    const [from, to] = this.rows[laser];
    const i = lastUpTo(this.time, time + SOON, from, to);
    if (i < from) return null;
    const interval = to - from < 2 ? 1 : (this.time[to - 1] - this.time[from]) / (to - from - 1);
    const age = time - this.time[i];
    return age < 1.5 * interval ? this.scan(i, laser, age, interval) : null;
  }

  /** Time of the scan before or behind a time. */
  beside(member, time, sense) {
    const laser = this.laserOf.get(member);
    if (laser === undefined) return null;
    const [from, to] = this.rows[laser];
    const i = sense > 0 ? lastUpTo(this.time, time + SOON, from, to) + 1 : lastUpTo(this.time, time - 1e-3, from, to);
    return i >= from && i < to ? this.time[i] : null;
  }

  scan(i, laser, age, interval) {
    const n = this.samples[laser], begin = this.offset[i], step = this.rangeMax[laser] / this.rangeSteps;
    const cos = Math.cos(this.heading[i]), sin = Math.sin(this.heading[i]);
    const x = this.x[i] + this.mountX[laser] * cos - this.mountY[laser] * sin;
    const y = this.y[i] + this.mountX[laser] * sin + this.mountY[laser] * cos;
    const yaw = this.heading[i] + this.mountYaw[laser] + this.angleMin[laser];
    const ends = new Float64Array(2 * n); // of the beams
    const kinds = new Uint8Array(n); // NOTHING, TOO_NEAR, LOST or FIRST for a return
    let returns = 0;
    for (let beam = 0; beam < n; beam++) {
      const written = this.ranges[begin + beam];
      kinds[beam] = Math.min(written, FIRST);
      if (written >= FIRST) returns++;
      const range = written >= FIRST ? (written - FIRST) * step
        : written === NOTHING ? this.rangeMax[laser] : written === TOO_NEAR ? this.rangeMin[laser] : 0;
      const angle = yaw + beam * this.increment[laser];
      ends[2 * beam] = x + range * Math.cos(angle);
      ends[2 * beam + 1] = y + range * Math.sin(angle);
    }
    const segments = [];
    for (let s = this.segments[i]; s < this.segments[i + 1]; s++) {
      segments.push([this.segmentFirst[s], this.segmentLast[s]]);
    }
    const path = []; // that the law remembered then
    for (let p = this.path?.offset[i]; p < this.path?.offset[i + 1]; p++) path.push([this.path.x[p], this.path.y[p]]);
    const [farthest, increment] = [this.rangeMax[laser], this.increment[laser]];
    return { time: this.time[i], age, interval, x, y, ends, kinds, returns, segments, path, samples: n, farthest, increment };
  }
}

/** Everything of a run. */
async function readRun(text) {
  const { header, column } = await unpacked(text);
  const scene = {};
  for (const [kind, shape] of Object.entries(header.scene)) {
    const lengths = column(shape.lengths, Int32Array), x = column(shape.x, Float32Array), y = column(shape.y, Float32Array);
    let at = 0;
    scene[kind] = Array.from(lengths, (n) => {
      const line = { x: x.subarray(at, at + n), y: y.subarray(at, at + n) };
      at += n;
      return line;
    });
  }
  const members = new Members(header.members, column);
  const traffic = header.traffic && new Tracks(header.traffic, column);
  const obstacles = new Map(header.obstacles); // id -> kind
  const events = header.events.map(([time, kind, vehicle, other, x, y, duration, detail], number) => ({
    number, time, kind, vehicle, other, duration, detail,
    x: (x ?? NaN) - header.origin[0], y: (y ?? NaN) - header.origin[1],
  }));
  events.sort((a, b) => a.time - b.time || a.number - b.number);
  return {
    ...header,
    scene,
    members,
    traffic,
    obstacle: traffic?.ids.map((id) => obstacles.get(id) ?? (id.startsWith("person.") ? "pedestrian" : "")), // kind
    scans: header.scans && new Scans(header.scans, column),
    events,
    from: members.times[0],
    until: Math.max(header.until, members.times[members.times.length - 1]),
  };
}
