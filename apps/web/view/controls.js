// SPDX-License-Identifier: Apache-2.0
// Turns mouse, touch, wheel and keys into movements of the rig.
const TURN = Math.PI; // radians for a drag across the window's shorter side
const WHEEL = 0.0011; // of the distance per pixel of the wheel, as a power of e
const CLICK = 5; // CSS pixels: a press that moves less is a click
const DOUBLE = 350; // milliseconds between the clicks of a double click
const FLY = 0.35; // scene radii a second, at speed 1
// Scene radii: least distance from the viewer to the center of orbits.
const NEAREST = 0.02;
const RAMP = 0.25; // seconds until a held key has its full speed

const MOVES = {
  // key, by its place on the keyboard -> right, down, forward
  KeyW: [0, 0, 1],
  KeyS: [0, 0, -1],
  KeyA: [-1, 0, 0],
  KeyD: [1, 0, 0],
  KeyQ: [0, 1, 0],
  KeyE: [0, -1, 0],
};
// With Alt; without it they step through cameras.
const TURNS = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]};

export class Controls {
  // element: receives the pointer; radius: of the scene, in world units; on: {hover(x, y), click(x,
  // y), double(x, y), wake(), focal(), brush()}; brush() is null, or what the drags of one pointer
  // are for: {begin(x, y), paint(x, y)}
  constructor(element, rig, radius, on) {
    Object.assign(this, {element, rig, radius, on});
    this.mode = 'orbit';
    this.speed = 1;
    this.keys = new Map(); // held: code -> since when, seconds
    this.pointers = new Map(); // down: id -> {x, y}
    this.travel = 0;
    this.lastClick = null;
    const listen = (type, act, options) => element.addEventListener(type, act, options);
    listen('pointerdown', event => this.down(event));
    listen('pointermove', event => this.move(event));
    listen('pointerup', event => this.lift(event));
    listen('pointercancel', event => this.pointers.delete(event.pointerId));
    listen('pointerleave', () => on.hover(null));
    listen('wheel', event => this.wheel(event), {passive: false});
    listen('contextmenu', event => event.preventDefault());
    addEventListener('blur', () => this.keys.clear());
  }

  get nearest() {
    return NEAREST * this.radius;
  }
  get perPixel() {
    return TURN / Math.min(this.element.clientWidth, this.element.clientHeight);
  }
  // World units of one CSS pixel at the target's distance.
  get worldPerPixel() {
    return this.rig.distance / this.on.focal();
  }

  down(event) {
    event.preventDefault();
    document.activeElement?.blur();
    this.element.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, {x: event.clientX, y: event.clientY});
    if (this.pointers.size === 1) this.travel = 0;
    else this.travel = Infinity; // two fingers are no click
    this.brush = event.button === 0 && this.pointers.size === 1 ? this.on.brush() : null;
    this.brush?.begin(event.clientX, event.clientY);
  }

  move(event) {
    const last = this.pointers.get(event.pointerId);
    if (!last) {
      if (event.pointerType === 'mouse') this.on.hover(event.clientX, event.clientY);
      return;
    }
    const now = {x: event.clientX, y: event.clientY},
      dx = now.x - last.x,
      dy = now.y - last.y;
    this.travel += Math.hypot(dx, dy);
    if (this.brush) {
      this.pointers.set(event.pointerId, now);
      return this.brush.paint(now.x, now.y);
    }
    if (this.travel < CLICK && event.pointerType !== 'mouse') return;
    if (this.pointers.size > 1) this.pinch(event.pointerId, last, now);
    else this.drag(event, dx, dy);
    this.pointers.set(event.pointerId, now);
  }

  drag(event, dx, dy) {
    if (this.travel < CLICK) return;
    const shifts =
      event.buttons & 4 || event.shiftKey || (event.buttons & 2 && this.mode === 'fly');
    const looks = !shifts && (this.mode === 'fly' || event.buttons & 2);
    if (shifts) this.rig.shift(-dx * this.worldPerPixel, -dy * this.worldPerPixel, 0);
    else if (looks) this.rig.look(-dx * this.perPixel * 0.5, -dy * this.perPixel * 0.5);
    else this.rig.orbit(-dx * this.perPixel, -dy * this.perPixel);
  }

  // Two fingers: moving both shifts the view, spreading them approaches the target, twisting them
  // rolls.
  pinch(id, last, now) {
    const other = [...this.pointers].find(([each]) => each !== id)[1];
    const before = {x: last.x - other.x, y: last.y - other.y},
      after = {x: now.x - other.x, y: now.y - other.y};
    const grown = Math.hypot(after.x, after.y) / Math.max(1, Math.hypot(before.x, before.y));
    this.rig.shift(
      (-(now.x - last.x) / 2) * this.worldPerPixel,
      (-(now.y - last.y) / 2) * this.worldPerPixel,
      0,
    );
    if (this.mode === 'fly') this.rig.shift(0, 0, Math.log(grown) * this.radius);
    else this.rig.approach(1 / grown, this.nearest);
    this.rig.roll(
      Math.atan2(before.x * after.y - before.y * after.x, before.x * after.x + before.y * after.y),
    );
  }

  lift(event) {
    if (this.brush) {
      this.brush = null;
      this.pointers.delete(event.pointerId);
      return;
    }
    if (!this.pointers.delete(event.pointerId) || this.travel >= CLICK || event.button > 0) return;
    const {clientX: x, clientY: y} = event,
      now = performance.now(),
      last = this.lastClick;
    if (last && now - last.at < DOUBLE && Math.hypot(x - last.x, y - last.y) < 4 * CLICK) {
      this.lastClick = null;
      return this.on.double(x, y);
    }
    this.lastClick = {x, y, at: now};
    this.on.click(x, y);
  }

  wheel(event) {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === 1 ? 18 : event.deltaMode === 2 ? 400 : 1);
    const by = Math.max(-240, Math.min(240, pixels));
    if (this.mode === 'fly') this.rig.shift(0, 0, -by * WHEEL * 0.25 * this.radius * this.speed);
    else this.rig.approach(Math.exp(by * WHEEL), this.nearest);
  }

  // Returns whether the key is one that moves the view.
  press(event) {
    if (!(event.code in MOVES) && !(event.code in TURNS && event.altKey)) return false;
    if (!this.keys.has(event.code)) this.keys.set(event.code, 0);
    this.fast = event.shiftKey;
    this.on.wake();
    return true;
  }
  release(event) {
    this.keys.delete(event.code);
    this.fast = event.shiftKey;
  }

  get isHeld() {
    return this.keys.size > 0;
  }

  // Moves by the keys that are held; `seconds` since the last call.
  step(seconds) {
    for (const [code, held] of this.keys) {
      const since = held + seconds,
        share = Math.min(1, since / RAMP);
      this.keys.set(code, since);
      const by = seconds * share * this.speed * (this.fast ? 4 : 1);
      if (MOVES[code]) {
        const [right, down, forward] = MOVES[code].map(x => x * by * FLY * this.radius);
        this.rig.shift(right, down, forward);
      } else {
        const [yaw, pitch] = TURNS[code];
        this.rig[this.mode === 'fly' ? 'look' : 'orbit'](-yaw * by, -pitch * by);
      }
    }
  }
}
