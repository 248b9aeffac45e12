// SPDX-License-Identifier: Apache-2.0
// The picture that fills the window: decides when it is drawn, at how many pixels, and by which of
// the browser and the server; draws frusta over it.
import {ColorManagement, LinearSRGBColorSpace, WebGLRenderer} from 'three';
import {el} from '../../shared/dom.js';
import {FramePicture} from './frames.js';
import {Frusta} from './frusta.js';
import {fitted, projectionOf} from './lens.js';
import {MeshPicture} from './mesh.js';
import {SplatPicture} from './splats.js';

// Milliseconds without movement until the view counts as still.
const REST = 160;
const MOST_PIXEL_RATIO = 2;
// Milliseconds per frame: fewer pixels above, more below, while the view moves.
const SLOW = 45,
  QUICK = 20;
const LEAST_SCALE = 0.3;

// Colors are what files say, display sRGB: nothing converts them.
ColorManagement.enabled = false;

const pause = milliseconds => new Promise(done => setTimeout(done, milliseconds));

export class Stage {
  // rig: the viewer's camera; step(seconds): moves it by the held keys, true while any is held;
  // drawn(view): called after each frame; marginsOf(): what the interface covers, {above, below} in
  // CSS pixels; failed(error)
  constructor(scene, rig, {step, drawn, marginsOf, failed}) {
    Object.assign(this, {scene, rig, step, drawn, marginsOf, failed});
    this.isRemote = scene.mode === 'remote';
    this.frameCanvas = this.isRemote ? el('canvas.frame', {'aria-hidden': 'true'}) : null;
    this.canvas = el('canvas.gl', {tabindex: '-1', 'aria-label': 'the picture'});
    this.node = el('div.stage', {}, this.frameCanvas, this.canvas);
    this.renderer = this.makeRenderer();
    this.frusta = this.renderer && new Frusta(scene.cameras, scene.radius);
    if (this.isRemote) {
      this.frames = new FramePicture(this.frameCanvas, view => this.overlay(view), failed);
    } else {
      this.splats = new SplatPicture(
        this.renderer,
        scene.model,
        () => this.request(),
        () => this.touch(),
      );
      this.splats.setBackground(scene.background);
      this.mesh = new MeshPicture(this.renderer, () => this.request());
    }
    this.isStale = true; // something has changed since the last frame
    // The picture is sorted for exactly this view and has all its pixels.
    this.isExact = false;
    this.changedAt = 0;
    this.margins = {above: 0, below: 0}; // CSS pixels that the interface covers
    // Of the picture's side while the view moves: below 1 for slow machines.
    this.scale = 1;
    this.fullSize = false; // keep all pixels while the view moves
    this.frameTime = null; // milliseconds per frame, a running mean while the view moves
    this.canvas.addEventListener('webglcontextlost', () =>
      failed(
        new Error(
          'The graphics driver has lost this picture, perhaps for lack of memory. Load the page again.',
        ),
      ),
    );
    new ResizeObserver(() => this.resize()).observe(this.node);
  }

  makeRenderer() {
    try {
      const renderer = new WebGLRenderer({
        canvas: this.canvas,
        antialias: true,
        alpha: this.isRemote,
        powerPreference: 'high-performance',
      });
      renderer.outputColorSpace = LinearSRGBColorSpace;
      renderer.autoClear = false;
      return renderer;
    } catch {
      // Frames from the server need no WebGL; only frusta are missing then.
      if (this.isRemote) return null;
      throw new Error(
        'This browser has no WebGL 2, which is needed to draw Gaussians. "gemsplat view --remote" draws them on the machine that gemsplat runs on.',
      );
    }
  }

  resize() {
    const {clientWidth: width, clientHeight: height} = this.node;
    if (!width || !height) return;
    this.width = width;
    this.height = height;
    this.pixelRatio = Math.min(devicePixelRatio || 1, MOST_PIXEL_RATIO);
    this.renderer?.setPixelRatio(this.pixelRatio);
    this.renderer?.setSize(width, height, false);
    this.margins = this.marginsOf();
    this.touch();
    this.draw(); // at once: a canvas of another size is empty
  }

  // Called after the view has changed.
  touch() {
    this.changedAt = performance.now();
    this.isExact = false;
    this.request();
  }
  request() {
    this.isStale = true;
    if (!this.requested) this.requested = requestAnimationFrame(now => this.frame(now));
  }

  // Of a model that moves, 0 to 1.
  setTime(time) {
    if (time === this.time) return;
    this.time = time;
    this.splats?.setTime(time);
    this.touch();
  }

  // What is shown: color, depth or normal.
  show(quantity) {
    if (this.isRemote) this.frames.mode = quantity;
    else this.splats.setQuantity(quantity);
    this.touch();
  }
  showFrusta(on) {
    if (this.frusta) this.frusta.visible = on;
    this.request();
  }

  setFullSize(on) {
    this.fullSize = on;
    this.scale = 1;
    this.touch();
  }

  // The window's lens in pixels, of which `ratio` make one CSS pixel.
  lens(ratio = 1) {
    const {above, below} = this.margins;
    return fitted(this.rig.lens, Math.round(this.width * ratio), Math.round(this.height * ratio), {
      above: above * ratio,
      below: below * ratio,
    });
  }
  get pose() {
    return {position: this.rig.position.clone(), quaternion: this.rig.quaternion.clone()};
  }
  get isMoving() {
    return performance.now() - this.changedAt < REST || this.rig.flight !== null;
  }

  frame(now) {
    this.requested = null;
    const seconds = Math.min(0.1, (now - (this.lastFrame ?? now)) / 1000);
    const goesOn = this.step(seconds);
    this.rig.advance(now);
    this.measure(now);
    this.lastFrame = now;
    if (this.isStale && this.width) this.draw();
    if (goesOn || this.rig.flight) this.request();
    else this.settleSoon();
  }

  // Measures the time per frame while the view moves, and adapts the number of pixels to it.
  measure(now) {
    const milliseconds = now - (this.lastFrame ?? -Infinity);
    if (milliseconds > 1000 || !this.isMoving) return;
    this.frameTime =
      this.frameTime === null ? milliseconds : 0.8 * this.frameTime + 0.2 * milliseconds;
    if (this.fullSize || this.isRemote) return;
    if (this.frameTime > SLOW) this.scale = Math.max(LEAST_SCALE, this.scale * 0.9);
    else if (this.frameTime < QUICK) this.scale = Math.min(1, this.scale * 1.05);
  }

  // The camera with a lens whose view this is, or null.
  through() {
    return this.scene.cameras[this.rig.at]?.has_lens ? this.rig.at : null;
  }

  draw() {
    this.isStale = false;
    const view = {pose: this.pose, lens: this.lens(), at: this.rig.at};
    if (this.isRemote) {
      this.frames.want(
        {
          ...view,
          time: this.time,
          lens: this.lens(this.pixelRatio),
          window: view.lens,
          through: this.through(),
        },
        this.isMoving,
      );
      if (!this.frames.hasShown) this.overlay(view);
      return;
    }
    const scale = this.pixelRatio * (this.isMoving ? this.scale : 1);
    this.splats.place(view.pose, projectionOf(view.lens, this.scene.near, this.scene.far));
    this.splats.draw(
      Math.max(1, Math.round(this.width * scale)),
      Math.max(1, Math.round(this.height * scale)),
      view.lens,
    );
    this.drawMesh(this.width, this.height);
    this.frusta.draw(this.renderer, view.pose, view.lens, this.scene.far, view.at !== null);
    this.drawn(view);
  }

  // Over splats that were just drawn; to: a target with a buffer of depth, or null for the canvas
  drawMesh(width, height, to) {
    this.mesh.draw(this.splats.camera, this.splats.background, width, height, to);
  }

  // Draws the frusta over a frame of the server, from the view that this frame shows.
  overlay(view) {
    const lens = view.window ?? view.lens;
    if (this.renderer) {
      this.renderer.setClearColor(0, 0);
      this.renderer.clear();
      this.frusta.draw(this.renderer, view.pose, lens, this.scene.far, view.at !== null);
    }
    if (view.window) this.frames.hasShown = true;
    this.drawn({...view, lens});
  }

  settleSoon() {
    if (this.isExact || this.settling) return;
    this.settling = setTimeout(() => {
      this.settling = null;
      if (this.isMoving) return this.settleSoon();
      this.settle().catch(this.failed);
    }, REST);
  }

  async settle() {
    this.isExact = true;
    if (this.isRemote) return this.draw();
    this.draw();
    await this.splats.settle();
  }

  // Resolves when Gaussians of the first model are drawn: a slow machine sorts them for seconds.
  async shown() {
    while (
      this.splats.isBlank &&
      (this.isStale || this.requested || !this.isExact || this.splats.isPending)
    )
      await pause(30);
  }

  // Resolves when the picture on the screen is sorted for exactly this view and has all its pixels.
  async settled() {
    const isPending = () =>
      !this.isExact ||
      this.isMoving ||
      this.isStale ||
      this.requested ||
      (this.frames ?? this.splats).isPending;
    for (let calm = 0; calm < 3;) {
      calm = isPending() ? 0 : calm + 1;
      await pause(30);
    }
  }

  // The place of the world that the window shows at a point (CSS pixels) at this depth along the axis.
  worldAt(x, y, depth) {
    const {fx, fy, cx, cy} = this.lens(),
      {position} = this.rig;
    return position
      .clone()
      .add(this.rig.axis(((x - cx) / fx) * depth, (-(y - cy) / fy) * depth, -depth));
  }
  // The surface there, by the mean depth of what is drawn, or null.
  surfaceAt(x, y) {
    const depth = this.splats?.depthAt(x, y, this) ?? null;
    return depth === null ? null : this.worldAt(x, y, depth);
  }

  // The world point of the nearest Gaussian at a place of the window (CSS pixels), or null.
  pointAt(x, y) {
    return this.splats?.pick((2 * x) / this.width - 1, 1 - (2 * y) / this.height) ?? null;
  }
}
