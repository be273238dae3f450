// The part of the world that the map shows, and its control by mouse, wheel and touch.

const LEAST_SIDE = 8; // of a canvas that is worth drawing on [CSS pixels]

class Camera {
  /** bounds: [left, low, right, high] of the road [m]. */
  constructor(canvas, bounds) {
    this.canvas = canvas;
    this.bounds = bounds;
    this.x = (bounds[0] + bounds[2]) / 2;
    this.y = (bounds[1] + bounds[3]) / 2;
    this.scale = 1; // CSS pixels per metre
    this.width = this.height = 1;
    this.ratio = 1; // screen pixels per CSS pixel
    this.measuring = false; // a drag then measures, and does not move the map
    this.rule = null; // the two ends of what is measured, in metres
    this.closest = 2000; // largest scale
    this.onchange = () => {};
    this.onpan = () => {};
    this.onclick = () => {};
    this.#listen();
  }

  /** Whether there is anything to draw on: in a folded part of a page there is not. */
  get hasArea() {
    return this.canvas.clientWidth >= LEAST_SIDE && this.canvas.clientHeight >= LEAST_SIDE;
  }

  /** To be called when the canvas may have another size; says whether it had. */
  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    if (width === this.width && height === this.height && ratio === this.ratio) return false;
    [this.width, this.height, this.ratio] = [width, height, ratio];
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    return true;
  }

  screen(x, y) {
    return [this.width / 2 + (x - this.x) * this.scale, this.height / 2 - (y - this.y) * this.scale];
  }

  world(px, py) {
    return [this.x + (px - this.width / 2) / this.scale, this.y - (py - this.height / 2) / this.scale];
  }

  shows(x, y) {
    const [px, py] = this.screen(x, y);
    return px >= 0 && py >= 0 && px <= this.width && py <= this.height;
  }

  get whole() {
    const [left, low, right, high] = this.bounds;
    return 0.94 * Math.min(this.width / Math.max(right - left, 1e-3), this.height / Math.max(high - low, 1e-3));
  }

  fit() {
    const [left, low, right, high] = this.bounds;
    this.scale = this.whole;
    [this.x, this.y] = [(left + right) / 2, (low + high) / 2];
    this.onchange();
  }

  /** By a factor, so that what is at a point of the canvas stays there. */
  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const [x, y] = this.world(px, py);
    this.scale = Math.min(Math.max(this.scale * factor, 0.7 * this.whole), Math.max(this.closest, this.whole));
    this.x = x - (px - this.width / 2) / this.scale;
    this.y = y + (py - this.height / 2) / this.scale;
    this.onchange();
  }

  pan(dx, dy) {
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
    this.onchange();
  }

  #listen() {
    const { canvas } = this;
    const fingers = new Map();
    let moved = 0;
    const at = (event) => [event.offsetX, event.offsetY];
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, at(event));
      if (fingers.size === 1) moved = 0;
      if (this.measuring) this.rule = [this.world(...at(event)), this.world(...at(event))];
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = at(event);
      const other = [...fingers].find(([id]) => id !== event.pointerId)?.[1];
      fingers.set(event.pointerId, now);
      moved += Math.hypot(now[0] - before[0], now[1] - before[1]);
      if (moved < 4) return;
      if (this.measuring && !other) {
        this.rule[1] = this.world(...now);
        this.onchange();
      } else if (other) {
        const apart = (point) => Math.max(Math.hypot(point[0] - other[0], point[1] - other[1]), 1);
        this.zoom(apart(now) / apart(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
        this.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
      } else {
        this.onpan();
        this.pan(now[0] - before[0], now[1] - before[1]);
      }
    });
    const lift = (event) => {
      if (fingers.delete(event.pointerId) && event.type === "pointerup" && moved < 4) this.onclick(...at(event));
    };
    canvas.addEventListener("pointerup", lift);
    canvas.addEventListener("pointercancel", lift);
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 16 : 1;
      this.zoom(Math.exp(-event.deltaY * lines * 0.0015), ...at(event));
    }, { passive: false });
  }
}
