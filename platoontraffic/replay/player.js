// The page: selection, time, and input by mouse, touch and keyboard.

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 20];
const MOST_LISTED = 400; // events in the list
const CROWD = 20; // members of a platoon that are listed and drawn over time; of more, only the chosen one is
const BEGIN_WIDTH = 26; // lengths of the chosen vehicle that the map shows across at first, ...
const LARGE_ENOUGH = 10; // ... unless it has as many pixels as this when all of the road is shown

const element = (id) => document.getElementById(id);

function make(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

const words = (kind) => kind.replaceAll("_", " ");
const seconds = (time) => `${time.toFixed(1)} s`;
const digits = (value, places) => (Number.isNaN(value) ? "" : (Math.abs(value) < 0.5 * 10 ** -places ? 0 : value).toFixed(places));

// What layers look like on the map: parts of an SVG of 24 x 16; classes as in the style sheet.
const SIGNS = {
  scan: '<path class="s-fan" d="M1 8 20 1v14z"/><path class="s-beam" d="M1 8 20 1M1 8h19M1 8l19 7"/><path class="s-return" d="M19 0h3v3h-3zM19 6.500h3v3h-3zM19 13h3v3h-3z"/>',
  segments: '<path class="s-segment" d="M4 13 20 4"/>',
  target: '<circle class="s-right" cx="7" cy="8" r="4.500"/><path class="s-wrong" d="M15 4l8 8M15 12l8-8"/>',
  remembered: '<path class="s-remembered" d="M2 12 8 8l8-3 6 0"/><path class="s-remembered fill" d="M1 10.500h3v3H1zM7 6.500h3v3H7zM15 3.500h3v3h-3z"/>',
  paths: '<path class="s-path" d="M2 12C8 12 12 4 22 4"/>',
  traffic: '<path class="s-other" d="M4 4h13l3 2v4l-3 2H4z"/>',
  obstacles: '<path class="s-obstacle" d="M4 4h13l3 2v4l-3 2H4z"/>',
  buildings: '<path class="s-building" d="M3 2h10v12H3z"/><path class="s-wall" d="M17 1v14"/>',
  signals: '<path class="s-go" d="M3 3v10"/><path class="s-amber" d="M12 3v10"/><path class="s-stop" d="M21 3v10"/>',
  events: '<circle class="s-wrong" cx="7" cy="8" r="5"/><circle class="s-warn" cx="18" cy="8" r="4"/>',
  names: '<text x="12" y="12" class="s-name">Aa</text>',
};
const MEANINGS = {
  scan: "The last scan of the chosen member: the area that it swept, some of its beams, and all returns; it fades until the next",
  segments: "Groups of neighbouring returns",
  target: "What the law of the chosen member takes for its predecessor: a ring if it is that, a cross if it is something else, a square if there is no predecessor at that time",
  remembered: "The path that the law of the chosen member remembers",
  paths: "Where the platoon's members were in the last 30 s",
  traffic: "Vehicles that SUMO drives",
  obstacles: "Cars that cut in, pedestrians, boxes and others of the scenario, with their names",
  buildings: "Buildings, and walls that lasers see",
  signals: "Stop lines of traffic lights: green, amber, red; grey if the light is off. Links from one lane have a part each",
  events: "Where something has happened in the last 3 s: red for contacts and offences, amber for other faults",
  names: "Names of the platoon's members; where two would overlap, one gives way",
};

/** The link to a time in the address of the page of two runs in which this one stands: see beside.html. */
function hashOfPair() {
  try {
    return window.parent.location.hash;
  } catch { // a page of others
    return "";
  }
}

/** The page of a run; `state` is what it shows now. */
class Player {
  constructor(run) {
    this.run = run;
    this.palette = new Palette();
    this.map = new RoadMap(element("map"), run, this.palette);
    this.camera = new Camera(element("map"), this.map.bounds);
    this.time = run.from;
    this.playing = false;
    this.speed = 1;
    this.pointed = null; // vehicle below the mouse: {member} or {traffic}
    this.hovered = null; // time in a strip below the mouse [s]
    this.camera.closest = run.town ? 300 : 3000;
    this.layers = { signals: true, obstacles: true, events: true, traffic: true, buildings: true, scan: true, segments: true, target: true, remembered: true, paths: true, names: false };
    this.eventTimes = run.events.map((event) => event.time);
    this.drawn = null;
    this.frames = 0;
    this.follows = null;
    this.stale = true; // something has changed since the last frame
    this.#describe();
    this.#makeStrips();
    this.#makeMembers();
    this.#makeLayers();
    this.#makeEvents();
    this.#makeNumbers();
    this.#listen();
    this.choose(run.members.ids.indexOf(run.chosen));
    this.#goTo(location.hash || hashOfPair());
    requestAnimationFrame((now) => this.#frame(now));
  }

  // ---- selection

  get platoon() {
    return this.run.members.platoon[this.chosen];
  }

  /** Select the member that the laser view shows; a map that follows a vehicle then follows it. */
  choose(member) {
    const { members } = this.run;
    this.chosen = member;
    const platoon = members.ids.flatMap((_, v) => (members.platoon[v] === members.platoon[member] ? [v] : []));
    const crowd = platoon.length > CROWD;
    this.members = crowd ? [member] : platoon.sort((a, b) => members.place[a] - members.place[b]);
    element("crowd").hidden = !crowd;
    element("crowd").textContent = `one of ${platoon.length}: a click on the map chooses another`;
    if (this.follows) this.follow({ member });
    for (const strip of this.strips) strip.place.hidden = !strip.shows(this.members);
    this.#fillMembers();
    this.#fillNumbers();
    this.#fillEvents();
    this.#note();
    const pose = this.drawn && members.pose(member, members.instant(this.time));
    if (pose && !this.camera.shows(pose.x, pose.y)) this.follow({ member });
  }

  /** {member}, {traffic} (a vehicle's number), or null for a map that stands still. */
  follow(target) {
    this.follows = target;
    const { traffic } = this.run;
    const select = element("follow");
    select.querySelector("option.other")?.remove();
    if (target?.traffic !== undefined) {
      const other = make("option", { value: `t${target.traffic}`, textContent: traffic.ids[target.traffic], className: "other" });
      select.append(other);
    }
    select.value = target === null ? "" : target.member !== undefined ? `m${target.member}` : `t${target.traffic}`;
    this.stale = true;
  }

  // ---- time

  seek(time, announce = true) {
    this.time = Math.min(Math.max(time, this.run.from), this.run.until);
    this.stale = true;
    if (announce) this.#announce();
    this.#keepLink();
    this.#tell();
  }

  // ---- links: #t=12.5&member=platoon.2

  #goTo(hash) {
    const asked = new URLSearchParams(hash.slice(1)), time = parseFloat(asked.get("t"));
    const member = this.run.members.ids.indexOf(asked.get("member"));
    if (member >= 0) this.choose(member);
    if (Number.isFinite(time)) this.seek(time);
    this.linked = Number.isFinite(time) || member >= 0;
  }

  /** The address says what the page shows, so that it can be sent to others. */
  #keepLink() {
    clearTimeout(this.linking);
    this.linking = setTimeout(() => {
      const link = `#t=${+this.time.toFixed(2)}&member=${encodeURIComponent(this.run.members.ids[this.chosen])}`;
      try {
        if (!this.playing && location.hash !== link && this.drawn) history.replaceState(null, "", link);
      } catch { /* a page within a page has no address of its own */ }
    }, 300);
  }

  // ---- beside another run: see beside.html

  #tell() {
    if (window.parent === window || this.told) return;
    window.parent.postMessage({ time: this.time, playing: this.playing, speed: this.speed }, "*");
  }

  #hear({ time, playing, speed }) {
    if (![time, speed].every(Number.isFinite)) return;
    this.told = true; // and so does not tell it again
    this.speed = speed;
    element("speed").value = speed;
    this.seek(time, false);
    this.time = Math.min(time, this.run.until); // also before the begin of this run: it then begins when the other is there
    const goesOn = playing && time < this.run.until - SOON; // at its end it waits for the other
    if (goesOn !== this.playing) this.#set(goesOn);
    this.told = false;
  }

  /** Play or pause; at the end it plays from the begin. */
  play(playing) {
    if (playing && this.time >= this.run.until - SOON) this.time = this.run.from;
    this.#set(playing);
  }

  #set(playing) {
    this.playing = playing;
    this.stale = true;
    const button = element("play");
    button.setAttribute("aria-label", playing ? "Pause" : "Play");
    button.querySelector("use").setAttribute("href", playing ? "#i-pause" : "#i-play");
    if (!playing) {
      this.#announce();
      this.#keepLink();
    }
    this.#tell();
  }

  /** To the recorded instant before or behind; from scan to scan if wanted. */
  step(sense, scans = false) {
    this.play(false);
    const beside = scans && this.run.scans?.beside(this.chosen, this.time, sense);
    if (typeof beside === "number") return this.seek(beside);
    const { times } = this.run.members;
    const i = sense > 0 ? lastUpTo(times, this.time + SOON) + 1 : lastUpTo(times, this.time - 1e-3);
    return this.seek(times[Math.min(Math.max(i, 0), times.length - 1)]);
  }

  jump(event) {
    const member = this.run.members.ids.indexOf(event.vehicle);
    if (member >= 0 && (this.follows || !this.camera.shows(event.x, event.y))) this.follow({ member });
    if (member >= 0 && member !== this.chosen) this.choose(member);
    this.seek(event.time);
  }

  /** To the event before or behind of those in the list. */
  jumpBeside(sense) {
    const there = this.listed.filter((e) => (sense > 0 ? e.time > this.time + SOON : e.time < this.time - SOON));
    if (there.length) this.jump(sense > 0 ? there[0] : there[there.length - 1]);
  }

  // ---- every frame

  #frame(now) {
    requestAnimationFrame((later) => this.#frame(later));
    if (!this.camera.hasArea) return;
    const past = Math.min((now - (this.before ?? now)) / 1000, 0.25);
    this.before = now;
    if (this.playing) {
      this.time = Math.min(this.time + past * this.speed, this.run.until);
      this.stale = true;
      if (this.time >= this.run.until) {
        this.told = true; // a longer run beside it goes on
        this.#set(false);
        this.told = false;
      }
    }
    if (this.camera.resize()) this.stale = true;
    if (!this.frames) this.#begin();
    if (this.stale) {
      this.stale = false;
      this.frames++;
      this.#draw();
    }
  }

  #draw() {
    const { run, camera } = this;
    const when = run.members.instant(this.time);
    const target = this.follows;
    const pose = target?.member !== undefined ? run.members.pose(target.member, when)
      : target ? run.traffic.pose(target.traffic, run.traffic.instant(this.time)) : null;
    if (pose) [camera.x, camera.y] = [pose.x, pose.y];
    this.drawn = this.map.draw(camera, this.time, this);
    for (const strip of this.strips) strip.draw(this.time, when, this);
    this.#showTime();
    this.#showMembers(when);
    this.#showScan();
    this.#showEvent();
    this.#showPointed();
    this.#showValues();
  }

  /** Name, speed and kind of the vehicle that is pointed at. */
  #showPointed() {
    const { run, pointed } = this, tip = element("tip");
    let text = "";
    if (pointed) {
      const tracks = pointed.member !== undefined ? run.members : run.traffic, v = pointed.member ?? pointed.traffic;
      const pose = tracks.pose(v, tracks.instant(this.time));
      const kind = pointed.member !== undefined
        ? (run.members.place[v] ? `follower ${run.members.place[v]}` : "leader") : words(run.obstacle[v]) || "background traffic";
      const size = `${tracks.length[v].toFixed(2)} × ${tracks.width[v].toFixed(2)} m`;
      if (pose) text = `${tracks.ids[v]}: ${digits(tracks.speed[pose.row], 2)} m/s, ${kind}, ${size}`;
    }
    tip.hidden = !text;
    if (tip.textContent !== text) tip.textContent = text;
  }

  #showValues() {
    for (const strip of this.strips) {
      const text = this.hovered === null ? "" : strip.values(this.hovered, this);
      if (strip.output.textContent !== text) strip.output.textContent = text;
    }
  }

  #showTime() {
    const slider = element("slider");
    slider.value = this.time;
    slider.setAttribute("aria-valuetext", seconds(this.time));
    element("clock").firstChild.textContent = seconds(this.time);
    this.#drawMarks();
  }

  #showMembers(when) {
    const { members } = this.run;
    this.members.forEach((v, place) => {
      const row = members.row(v, when);
      const [speed, gap, error, sees] = this.cells[place];
      const show = (cell, text, name = "") => {
        if (cell.textContent !== text) cell.textContent = text;
        if (cell.className !== name) cell.className = name;
      };
      const there = row >= 0;
      show(speed, there ? digits(members.speed[row], 2) : "");
      show(gap, there ? digits(members.gap[row], 2) : "");
      show(error, there ? digits(members.error[row], 2) : "");
      const id = there ? members.targetId(row) : "", right = there ? members.isRight(v, row, when) : null;
      if (!there) show(sees, "not on the road", "info");
      else if (right === null) show(sees, id);
      else show(sees, id ? `${right ? "✓" : "✗"} ${id}` : "✗ nothing", right ? "sees-right" : "sees-wrong");
    });
  }

  #showScan() {
    const { scan } = this.drawn;
    const member = this.run.members.ids[this.chosen];
    const when = this.run.members.instant(this.time);
    let text = "";
    if (this.run.members.row(this.chosen, when) < 0) text = `${member} is not on the road`;
    else if (scan) text = `${member}: scan of ${scan.time.toFixed(2)} s, ${scan.returns} of ${scan.beams} beams returned, ${scan.segments} segment${scan.segments === 1 ? "" : "s"}`;
    if (element("scan-note").textContent !== text) element("scan-note").textContent = text;
  }

  /** The last event of the list up to now. */
  #showEvent() {
    const current = lastUpTo(this.listedTimes, this.time + SOON);
    if (current === this.current) return;
    this.current = current;
    const list = element("events");
    list.querySelector("[aria-current]")?.removeAttribute("aria-current");
    const item = list.children[current];
    if (!item?.querySelector("button")) return;
    item.setAttribute("aria-current", "true");
    if (!list.contains(document.activeElement)) list.scrollTop = item.offsetTop - list.clientHeight / 2;
  }

  #drawMarks() {
    const canvas = element("marks"), { palette, run } = this;
    const ratio = Math.min(window.devicePixelRatio || 1, 2), width = canvas.clientWidth, height = canvas.clientHeight;
    const key = [width, ratio, palette.ground, this.listed.length, this.listed[0]?.number, element("event-filter").value].join();
    if (key === this.marks) return;
    this.marks = key;
    [canvas.width, canvas.height] = [width * ratio, height * ratio].map(Math.round);
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    for (const event of this.listed) {
      const px = this.#markAt(event, width), kind = severity(event.kind);
      context.strokeStyle = context.fillStyle = kind === "bad" ? palette.wrong : kind === "warn" ? palette.warn : palette.faint;
      context.lineWidth = 2;
      context.beginPath();
      if (kind === "bad") {
        for (const s of [-1, 1]) {
          context.moveTo(px - 5, height / 2 - 5 * s);
          context.lineTo(px + 5, height / 2 + 5 * s);
        }
        context.stroke();
      } else if (kind === "warn") {
        context.moveTo(px, height - 3);
        context.lineTo(px - 5.5, height - 13);
        context.lineTo(px + 5.5, height - 13);
        context.fill();
      } else {
        context.moveTo(px, height - 3);
        context.lineTo(px, height - 11);
        context.stroke();
      }
    }
  }

  #markAt(event, width) {
    return ((event.time - this.run.from) / (this.run.until - this.run.from || 1)) * width;
  }

  /** Text for screen readers. */
  #announce() {
    const { members } = this.run;
    const when = members.instant(this.time), row = members.row(this.chosen, when);
    const id = members.ids[this.chosen];
    const parts = [seconds(this.time)];
    if (row < 0) parts.push(`${id} is not on the road`);
    else {
      parts.push(`${id}: speed ${digits(members.speed[row], 1)} metres per second`);
      if (!Number.isNaN(members.gap[row])) parts.push(`gap ${digits(members.gap[row], 1)} metres`);
      if (members.ahead(this.chosen, when) >= 0) parts.push(`target of its law: ${members.targetId(row) || "none"}`);
    }
    element("now").textContent = parts.join(", ");
  }

  // ---- parts of the page

  #describe() {
    const { run } = this;
    element("title").textContent = run.title;
    const facts = [run.run, run.seed !== null && `seed ${run.seed}`, run.version && `platoontraffic ${run.version}`];
    element("run").textContent = facts.filter(Boolean).join(" · ");
    const slider = element("slider");
    Object.assign(slider, { min: run.from, max: run.until, step: 0.001 });
    element("clock").append("", make("small", { textContent: ` of ${seconds(run.until)}` }));
    const missing = [];
    const replay = '"run --replay" or ';
    if (!run.traffic) missing.push(`other vehicles (${replay}record.traffic_every_s records them)`);
    const scansBy = `${run.replayRecordsScans ? replay : ""}record.scans_every_s`;
    if (!run.scans) missing.push(`scans, and so beams, returns and segments (${scansBy} records them)`);
    if (missing.length) element("missing").textContent = `Not recorded in this run: ${missing.join("; ")}.`;
    for (const speed of SPEEDS) element("speed").append(make("option", { value: speed, textContent: `${speed} ×` }));
    element("speed").value = 1;
    const follow = element("follow");
    follow.append(make("option", { value: "", textContent: "no vehicle" }));
    const groups = new Map();
    run.members.ids.forEach((id, v) => {
      const platoon = run.members.platoon[v];
      if (!groups.has(platoon)) {
        groups.set(platoon, make("optgroup", { label: platoon }));
        follow.append(groups.get(platoon));
      }
      groups.get(platoon).append(make("option", { value: `m${v}`, textContent: id }));
    });
    const platoons = element("platoon");
    for (const platoon of groups.keys()) platoons.append(make("option", { value: platoon, textContent: platoon }));
    element("platoon-label").hidden = groups.size < 2;
  }

  #makeStrips() {
    this.strips = STRIPS.map((strip) => {
      const label = `${strip.title} of the platoon's members over time`;
      const canvas = make("canvas");
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", label);
      const output = make("output");
      const head = make("span", {}, `${strip.title} [${strip.unit}] `, output);
      const place = make("div", { className: "strip" }, head, canvas);
      element("strips").append(place);
      const hover = (time) => {
        this.hovered = time;
        this.stale = true;
      };
      const made = new Strip(canvas, strip, this.run, this.palette, (time) => this.seek(time, false), hover);
      return Object.assign(made, { place, output });
    });
  }

  #makeMembers() {
    element("platoon").addEventListener("change", (event) => {
      const { members } = this.run;
      const theirs = members.ids.flatMap((_, v) => (members.platoon[v] === event.target.value ? [v] : []));
      const by = (place) => theirs.find((v) => members.place[v] === place);
      this.choose(by(members.place[this.chosen]) ?? theirs[0]);
    });
  }

  #fillMembers() {
    const { members } = this.run;
    element("platoon").value = this.platoon;
    const body = element("members").tBodies[0];
    const key = this.members.join();
    if (this.listedMembers !== key) {
      this.listedMembers = key;
      this.cells = [];
      body.replaceChildren(...this.members.map((v) => {
        const colour = this.palette.member(members.place[v]);
        const swatch = make("span", { className: "swatch", textContent: members.place[v] });
        Object.assign(swatch.style, { background: colour, color: contrasting(colour) });
        swatch.setAttribute("aria-hidden", "true");
        const button = make("button", { type: "button" }, swatch, make("span", { textContent: members.ids[v] }));
        button.addEventListener("click", () => this.choose(v));
        const head = make("th", { scope: "row" }, button);
        const cells = [0, 1, 2, 3].map(() => make("td"));
        this.cells.push(cells);
        const row = make("tr", {}, head, ...cells);
        row.dataset.vehicle = members.ids[v];
        return row;
      }));
    }
    [...body.rows].forEach((row, i) => {
      const chosen = this.members[i] === this.chosen;
      chosen ? row.setAttribute("aria-current", "true") : row.removeAttribute("aria-current");
    });
  }

  #makeLayers() {
    const { run } = this;
    const layers = [
      ["scan", "Beams and returns", run.scans],
      ["segments", "Segments", run.scans],
      ["target", "Target of the law", true],
      ["remembered", `Remembered path${run.scans?.path ? "" : " (not recorded)"}`, run.scans?.path],
      ["paths", "Driven paths", true],
      ["traffic", "Background traffic", run.traffic?.n],
      ["obstacles", "Obstacles", run.obstacle?.some(Boolean)],
      ["buildings", "Buildings, walls", (run.scene.walls?.length ?? 0) + (run.scene.buildings?.length ?? 0)],
      ["signals", "Traffic lights", run.signals],
      ["events", "Events", run.events.some((event) => severity(event.kind) !== "info")],
      ["names", "Names", true],
    ];
    for (const [layer, text, there] of layers) {
      const box = make("input", { type: "checkbox", checked: Boolean(there) && this.layers[layer], disabled: !there });
      box.id = `layer-${layer}`;
      this.layers[layer] = box.checked;
      box.addEventListener("change", () => {
        this.layers[layer] = box.checked;
        this.stale = true;
      });
      const sign = make("span", { className: "sign", innerHTML: `<svg viewBox="0 0 24 16" aria-hidden="true">${SIGNS[layer]}</svg>` });
      element("layers").append(make("label", { className: there ? "" : "off", title: MEANINGS[layer] }, box, sign, text));
    }
  }

  #makeEvents() {
    const filter = element("event-filter");
    const kinds = [...new Set(this.run.events.map((event) => event.kind))].sort();
    const troubles = this.run.events.some((event) => severity(event.kind) !== "info");
    filter.append(
      ...(troubles ? [make("option", { value: "!", textContent: "faults and holds" })] : []),
      make("option", { value: "", textContent: "all" }),
      make("option", { value: "@", textContent: "of the chosen member" }),
      ...kinds.map((kind) => make("option", { value: kind, textContent: words(kind), title: this.run.kinds[kind] ?? "" })),
    );
    filter.addEventListener("change", () => this.#fillEvents(true));
  }

  #fillEvents(changed = false) {
    const filter = element("event-filter").value;
    if (this.listed && !changed && filter !== "@") return;
    const wanted = (event) =>
      filter === "!" ? severity(event.kind) !== "info"
        : filter === "@" ? event.vehicle === this.run.members.ids[this.chosen]
          : !filter || event.kind === filter;
    this.listed = this.run.events.filter(wanted);
    this.listedTimes = this.listed.map((event) => event.time);
    this.current = undefined;
    const items = this.listed.slice(0, MOST_LISTED).map((event) => {
      const kind = severity(event.kind);
      const mark = make("span", { className: kind, textContent: { bad: "✕", warn: "▼", info: "·" }[kind] });
      mark.setAttribute("aria-hidden", "true");
      const vehicles = [event.vehicle, event.other].filter(Boolean).join(" – ");
      const more = [event.detail, Number.isFinite(event.duration) && event.duration !== null && `after ${seconds(event.duration)}`];
      const what = make("span", {}, `${words(event.kind)} `, make("strong", { textContent: vehicles }), " ",
        make("small", { textContent: more.filter(Boolean).join(", ") }));
      const button = make("button", { type: "button", title: this.run.kinds[event.kind] ?? "" },
        mark, make("span", { className: "when", textContent: seconds(event.time) }), what);
      button.addEventListener("click", () => {
        this.play(false);
        this.jump(event);
      });
      const item = make("li", {}, button);
      item.dataset.kind = event.kind;
      return item;
    });
    if (!items.length) items.push(make("li", {}, make("p", { textContent: "none" })));
    if (this.listed.length > MOST_LISTED) {
      const text = `${this.listed.length - MOST_LISTED} more; choose a kind or a member to see fewer.`;
      items.push(make("li", {}, make("p", { textContent: text })));
    }
    element("events").replaceChildren(...items);
    this.stale = true;
  }

  #makeNumbers() {
    const row = make("tr", {}, make("th", { scope: "col", textContent: "member" }));
    for (const [text, unit, metric] of this.run.metrics.headings) {
      row.append(make("th", { scope: "col", title: metric }, text, make("br"), make("small", { textContent: unit || " " })));
    }
    element("numbers").append(make("thead", {}, row), make("tbody"));
  }

  #fillNumbers() {
    const { members, metrics } = this.run;
    const body = element("numbers").tBodies[0];
    body.replaceChildren(...this.members.map((v) => {
      const values = metrics.rows[members.ids[v]] ?? metrics.headings.map(() => null);
      const cells = values.map((value) => make("td", { textContent: value === null ? "" : String(value) }));
      return make("tr", {}, make("th", { scope: "row", textContent: members.ids[v] }), ...cells);
    }));
  }

  #note() {
    this.stale = true;
    this.#announce();
  }

  /** All of a small road; else near enough to see what a laser sees. */
  #begin() {
    const { camera, run } = this;
    const length = run.members.length[this.chosen];
    camera.fit();
    if (camera.whole * length < LARGE_ENOUGH) {
      this.follow({ member: this.chosen });
      camera.scale = camera.width / (BEGIN_WIDTH * length);
    }
    const pose = run.members.pose(this.chosen, run.members.instant(this.time));
    if (!pose && !this.linked) { // it comes later
      const { times, first, tracksOf } = run.members;
      this.seek(times[first[tracksOf[this.chosen][0]]], false);
    }
  }

  // ---- mouse, touch and keyboard

  #listen() {
    const on = (id, what) => element(id).addEventListener("click", what);
    on("play", () => this.play(!this.playing));
    on("back", () => this.step(-1));
    on("forth", () => this.step(1));
    on("last-event", () => this.jumpBeside(-1));
    on("next-event", () => this.jumpBeside(1));
    on("zoom-in", () => this.camera.zoom(1.5));
    on("zoom-out", () => this.camera.zoom(1 / 1.5));
    on("whole", () => this.#showWhole());
    on("measure", () => this.#measure());
    window.addEventListener("hashchange", () => this.#goTo(location.hash));
    const canvas = element("map");
    const point = (event) => {
      const pointed = event && event.pointerType !== "touch" ? this.map.at(event.offsetX, event.offsetY, this.camera, this.time) : null;
      if (pointed?.member !== this.pointed?.member || pointed?.traffic !== this.pointed?.traffic) this.stale = true;
      this.pointed = pointed;
    };
    canvas.addEventListener("pointermove", point);
    canvas.addEventListener("pointerleave", () => point(null));
    element("slider").addEventListener("input", (event) => this.seek(Number(event.target.value), false));
    element("speed").addEventListener("change", (event) => {
      this.speed = Number(event.target.value);
      this.#tell();
    });
    window.addEventListener("message", (event) => {
      if (event.source === window.parent && event.source !== window) this.#hear(event.data ?? {});
    });
    element("follow").addEventListener("change", (event) => {
      const [kind, number] = [event.target.value[0], Number(event.target.value.slice(1))];
      this.follow(kind === "m" ? { member: number } : kind === "t" ? { traffic: number } : null);
      if (kind === "m") this.choose(number);
    });
    const marks = element("marks");
    const nearest = (px) => {
      const away = (event) => Math.abs(this.#markAt(event, marks.clientWidth) - px);
      const best = this.listed.reduce((a, b) => (a && away(a) <= away(b) ? a : b), null);
      return best && away(best) < 10 ? best : null;
    };
    marks.addEventListener("click", (event) => {
      const mark = nearest(event.offsetX);
      if (mark) this.jump(mark);
      else this.seek(this.run.from + (event.offsetX / marks.clientWidth) * (this.run.until - this.run.from));
    });
    marks.addEventListener("pointermove", (event) => {
      const mark = nearest(event.offsetX);
      marks.title = mark ? `${seconds(mark.time)} ${words(mark.kind)} ${mark.vehicle}` : "";
    });
    this.camera.onchange = () => { this.stale = true; };
    this.camera.onpan = () => this.follow(null);
    this.camera.onclick = (px, py) => {
      const hit = this.map.at(px, py, this.camera, this.time);
      this.pointed = hit;
      this.stale = true;
      if (hit?.member !== undefined) this.choose(hit.member);
      else if (hit) this.follow(hit);
    };
    const recolour = () => {
      this.palette.read();
      this.listedMembers = "";
      this.#fillMembers();
      this.stale = true;
      if (this.frames && this.camera.hasArea) this.#draw(); // no frame comes before a page is printed
    };
    for (const media of ["(prefers-color-scheme: dark)", "print"]) matchMedia(media).addEventListener("change", recolour);
    document.addEventListener("keydown", (event) => this.#key(event));
  }

  #measure() {
    const { camera } = this;
    camera.measuring = !camera.measuring;
    if (!camera.measuring) camera.rule = null;
    element("measure").setAttribute("aria-pressed", camera.measuring);
    element("map").style.cursor = camera.measuring ? "crosshair" : "";
    this.stale = true;
  }

  #showWhole() {
    this.follow(null);
    this.camera.fit();
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select")) return;
    const slider = event.target.matches("input[type=range]");
    const typed = event.target.matches("button, input, summary, a");
    const far = 60;
    const keys = {
      " ": typed && !slider ? null : () => this.play(!this.playing),
      ArrowLeft: () => this.step(-1, event.shiftKey),
      ArrowRight: () => this.step(1, event.shiftKey),
      p: () => this.jumpBeside(-1),
      n: () => this.jumpBeside(1),
      f: () => this.follow(this.follows ? null : { member: this.chosen }),
      "+": () => this.camera.zoom(1.5),
      "=": () => this.camera.zoom(1.5),
      "-": () => this.camera.zoom(1 / 1.5),
      Home: () => this.#showWhole(),
      m: () => this.#measure(),
      "[": () => this.#faster(-1),
      "]": () => this.#faster(1),
      w: () => this.#move(0, far),
      s: () => this.#move(0, -far),
      a: () => this.#move(far, 0),
      d: () => this.#move(-far, 0),
    };
    for (const member of this.members) { // the key is what is painted on it
      const place = this.run.members.place[member];
      if (place < 10) keys[place] = () => this.choose(member);
    }
    const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  #move(dx, dy) {
    this.follow(null);
    this.camera.pan(dx, dy);
  }

  #faster(sense) {
    const i = Math.min(Math.max(SPEEDS.indexOf(this.speed) + sense, 0), SPEEDS.length - 1);
    this.speed = SPEEDS[i];
    element("speed").value = this.speed;
    this.#tell();
  }

  /** State of the page for tests and scripts, in the network's metres. */
  get state() {
    const { run, drawn } = this;
    const [left, low] = run.origin;
    const placed = (thing) => thing && { ...thing, x: thing.x + left, y: thing.y + low };
    return Object.freeze({
      time: this.time,
      playing: this.playing,
      speed: this.speed,
      chosen: run.members.ids[this.chosen],
      follows: this.follows && (this.follows.member !== undefined ? run.members.ids[this.follows.member] : run.traffic.ids[this.follows.traffic]),
      layers: { ...this.layers },
      frames: this.frames,
      scale: this.camera.scale,
      centre: [this.camera.x + left, this.camera.y + low],
      rule: this.camera.rule && Math.hypot(...[0, 1].map((i) => this.camera.rule[0][i] - this.camera.rule[1][i])),
      drawn: drawn && { ...drawn, members: drawn.members.map(placed), target: placed(drawn.target) },
    });
  }
}

try {
  const player = new Player(await readRun(element("data").textContent));
  element("data").remove();
  Object.defineProperty(window, "replay", { get: () => player.state });
} catch (error) {
  element("trouble").hidden = false;
  element("trouble").textContent = typeof DecompressionStream === "undefined"
    ? "This browser is too old to unpack the run: it needs DecompressionStream (2023)."
    : `The run cannot be shown: ${error.message}`;
  throw error;
}
