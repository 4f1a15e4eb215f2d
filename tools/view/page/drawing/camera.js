// From metres to pixels and back; zoom by wheel, pinch and buttons, pan by dragging.

export class Camera {
  constructor(canvas, changed) {
    this.canvas = canvas;
    this.changed = changed;
    this.centre = [0, 0];
    this.scale = 20; // pixels per metre
    this.isFree = false; // the user has moved it: it does not fit itself any more
    this.pointers = new Map();
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    }
  }

  resize(width, height) {
    this.width = width;
    this.height = height;
  }

  fit([x1, y1, x2, y2], margin_m = 1) {
    this.isFree = false;
    this.centre = [(x1 + x2) / 2, (y1 + y2) / 2];
    this.scale = Math.max(
      0.1,
      Math.min(this.width / (x2 - x1 + 2 * margin_m), this.height / (y2 - y1 + 2 * margin_m)),
    );
    this.changed();
  }

  x(x_m) {
    return this.width / 2 + (x_m - this.centre[0]) * this.scale;
  }

  y(y_m) {
    return this.height / 2 - (y_m - this.centre[1]) * this.scale;
  }

  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const scale = Math.min(400, Math.max(1, this.scale * factor));
    const ratio = 1 / this.scale - 1 / scale;
    this.centre[0] += (px - this.width / 2) * ratio;
    this.centre[1] -= (py - this.height / 2) * ratio;
    this.scale = scale;
    this.isFree = true;
    this.changed();
  }

  wheel(event) {
    event.preventDefault();
    this.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY];
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId);
    if (others.length) {
      const other = others[0][1];
      const far = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      if (far(before) > 0)
        this.zoom(far(now) / far(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    } else {
      this.centre[0] -= (now[0] - before[0]) / this.scale;
      this.centre[1] += (now[1] - before[1]) / this.scale;
      this.isFree = true;
      this.changed();
    }
    this.pointers.set(event.pointerId, now);
  }
}
