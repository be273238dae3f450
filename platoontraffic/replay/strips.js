// Gap, speed and spacing error of a platoon over time, with a cursor that shows and sets the time.

const STRIPS = [
  { name: "gap", title: "gap", unit: "m", positive: true, ofGap: 4 },
  { name: "speed", title: "speed", unit: "m/s", positive: true },
  { name: "error", title: "spacing error", unit: "m", ofGap: 1.5 },
];
// `ofGap`: limit of the axis, in median gaps of the platoon.
const LEFT = 44, RIGHT = 8; // margins of the plot, for labels [pixels]

class Strip {
  /** seek, hover: called with the time that is pressed, or pointed at (null: none) */
  constructor(canvas, strip, run, palette, seek, hover) {
    Object.assign(this, { canvas, strip, run, palette });
    this.context = canvas.getContext("2d");
    this.lines = document.createElement("canvas");
    this.key = "";
    const lead = (event) => {
      if (event.type === "pointerdown") canvas.setPointerCapture(event.pointerId);
      else if (!canvas.hasPointerCapture(event.pointerId)) return;
      seek(this.time(event.offsetX));
    };
    canvas.addEventListener("pointerdown", lead);
    canvas.addEventListener("pointermove", lead);
    canvas.addEventListener("pointermove", (event) => hover(this.time(event.offsetX)));
    canvas.addEventListener("pointerleave", () => hover(null));
  }

  time(px) {
    const share = (px - LEFT) / (this.canvas.clientWidth - LEFT - RIGHT);
    return this.run.from + Math.min(Math.max(share, 0), 1) * (this.run.until - this.run.from);
  }

  px(time) {
    return LEFT + ((Math.max(time, this.run.from) - this.run.from) / (this.run.until - this.run.from || 1)) * (this.canvas.clientWidth - LEFT - RIGHT);
  }

  py(value) {
    const [low, high] = this.range;
    return 6 + (1 - (value - low) / (high - low)) * (this.canvas.clientHeight - 12);
  }

  /** Whether one of these members ever has a value: one without a predecessor in its platoon has no gap. */
  shows(platoon) {
    const { members } = this.run, values = members[this.strip.name];
    return platoon.some((v) => members.tracksOf[v].some((track) =>
      values.subarray(members.begin[track], members.begin[track + 1]).some((value) => !Number.isNaN(value))));
  }

  /** From the least to the greatest value; a platoon that has parted would press the others onto the axis. */
  #findRange(members, platoon) {
    const sorted = (values) => {
      const those = platoon.flatMap((v) => members.tracksOf[v].flatMap((track) =>
        Array.from(values.subarray(members.begin[track], members.begin[track + 1]))));
      return Float64Array.from(those.filter((value) => !Number.isNaN(value))).sort();
    };
    const values = sorted(members[this.strip.name]);
    let low = values[0], high = values[values.length - 1];
    if (this.strip.ofGap) {
      const gaps = sorted(members.gap), usual = this.strip.ofGap * gaps[gaps.length >> 1];
      [low, high] = [Math.max(low, -usual), Math.min(high, usual)];
    }
    if (this.strip.positive) low = Math.min(low, 0);
    const margin = 0.06 * (high - low) || 0.5;
    return [low < 0 ? low - margin : low, high + margin];
  }

  draw(time, when, view) {
    const { canvas, context, palette, run: { members } } = this;
    const ratio = Math.min(window.devicePixelRatio || 1, 2), width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width) return;
    const key = [width, height, ratio, view.platoon, view.chosen, palette.ground].join();
    if (key !== this.key) {
      this.key = key;
      [canvas.width, canvas.height] = [this.lines.width, this.lines.height] = [width * ratio, height * ratio].map(Math.round);
      this.range = this.#findRange(members, view.members);
      this.#drawLines(ratio, width, height, view);
    }
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.drawImage(this.lines, 0, 0);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (view.hovered !== null) {
      context.strokeStyle = palette.faint;
      context.lineWidth = 1;
      context.beginPath();
      context.moveTo(this.px(view.hovered), 0);
      context.lineTo(this.px(view.hovered), height);
      context.stroke();
    }
    const px = this.px(time);
    context.strokeStyle = palette.ink;
    context.lineWidth = 1.2;
    context.beginPath();
    context.moveTo(px, 0);
    context.lineTo(px, height);
    context.stroke();
    for (const v of view.members) {
      const row = members.row(v, when);
      const value = row < 0 ? NaN : members[this.strip.name][row];
      if (Number.isNaN(value)) continue;
      context.beginPath();
      context.arc(px, Math.min(Math.max(this.py(value), 4), height - 4), v === view.chosen ? 4.5 : 3, 0, 2 * Math.PI);
      context.fillStyle = palette.member(members.place[v]);
      context.fill();
      context.strokeStyle = palette.panel;
      context.stroke();
    }
  }

  #drawLines(ratio, width, height, view) {
    const { palette, run: { members, events } } = this;
    const context = this.lines.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "right";
    context.textBaseline = "middle";
    const [low, high] = this.range;
    const rough = (high - low) / Math.max(3, Math.floor(height / 26));
    const power = 10 ** Math.floor(Math.log10(rough));
    const tick = [1, 2, 2.5, 5, 10].map((n) => n * power).find((n) => n >= rough);
    for (let value = Math.ceil(low / tick) * tick; value <= high; value += tick) {
      const py = this.py(value);
      context.strokeStyle = Math.abs(value) < tick / 1e6 && low < 0 ? palette.faint : palette.line;
      context.lineWidth = 1;
      context.beginPath();
      context.moveTo(LEFT, py);
      context.lineTo(width - RIGHT, py);
      context.stroke();
      context.fillStyle = palette.faint;
      context.fillText(String(+value.toPrecision(4)), LEFT - 6, py);
    }
    context.save();
    context.beginPath();
    context.rect(LEFT, 0, width - LEFT - RIGHT, height);
    context.clip();
    for (const event of events) {
      if (severity(event.kind) === "info" || event.vehicle !== members.ids[view.chosen]) continue;
      context.strokeStyle = severity(event.kind) === "bad" ? palette.wrong : palette.warn;
      context.setLineDash([3, 3]);
      context.beginPath();
      context.moveTo(this.px(event.time), 0);
      context.lineTo(this.px(event.time), height);
      context.stroke();
    }
    context.setLineDash([]);
    context.lineJoin = "round";
    const beyond = []; // where lines are cut off: place, whether above, member
    const behind = view.members.filter((v) => v !== view.chosen);
    for (const v of [...behind, view.chosen]) {
      context.strokeStyle = palette.member(members.place[v]);
      context.lineWidth = v === view.chosen ? 2.2 : 1.2;
      context.globalAlpha = v === view.chosen ? 1 : 0.75;
      context.beginPath();
      for (const track of members.tracksOf[v]) {
        let started = false;
        for (let row = members.begin[track]; row < members.begin[track + 1]; row++) {
          const value = members[this.strip.name][row];
          if (Number.isNaN(value)) {
            started = false;
            continue;
          }
          const px = this.px(members.times[members.first[track] + row - members.begin[track]]), py = this.py(value);
          if (value > high || value < low) beyond.push([px, value > high, v]);
          started ? context.lineTo(px, py) : context.moveTo(px, py);
          started = true;
        }
      }
      context.stroke();
    }
    context.globalAlpha = 1;
    context.restore();
    let last = -Infinity; // an arrowhead where a line is cut off, and another one every few pixels while it is
    for (const [px, above, v] of beyond) {
      if (Math.abs(px - last) < 24) continue;
      last = px;
      const [tip, foot] = above ? [0, 6] : [height, height - 6];
      context.fillStyle = palette.member(members.place[v]);
      context.beginPath();
      context.moveTo(px, tip);
      context.lineTo(px - 4, foot);
      context.lineTo(px + 4, foot);
      context.fill();
    }
  }

  /** Values of the members at a time, as a text. */
  values(time, view) {
    const { members } = this.run, when = members.instant(time);
    const of = view.members.flatMap((v) => {
      const row = members.row(v, when), value = row < 0 ? NaN : members[this.strip.name][row];
      return Number.isNaN(value) ? [] : [`${members.place[v]}: ${value.toFixed(2)}`];
    });
    return `${time.toFixed(1)} s  ${of.join("  ")}`;
  }
}
