// SPDX-License-Identifier: Apache-2.0
// The picture that the server draws: asks for one frame after the other, small ones while the view moves.
import {rowsOfPose, resized} from './lens.js';
import {askForFrame} from './server.js';

const GOAL = 90;                    // milliseconds from request to picture, while the view moves
const LEAST_SCALE = 0.15;
const MOST_PIXELS = 4096;           // a side, of the server's
const QUALITY_MOVING = 70, QUALITY_STILL = 92;

export class FramePicture {
  // canvas: where frames go; shown(view): a frame of this view is there; failed(error)
  constructor(canvas, shown, failed) {
    this.canvas = canvas;
    this.shown = shown;
    this.failed = failed;
    this.mode = 'color';
    this.scale = 0.5;          // of the frames while the view moves
    this.latency = null;       // milliseconds, of the last frame; `render`: of these on the server
    this.render = null;
    this.wanted = null;        // the view that is to be seen
    this.isBusy = false;
    this.client = Math.random().toString(36).slice(2);  // the server drops requests that a newer one of the same page has overtaken
  }

  get isPending() { return this.isBusy || this.wanted !== null; }

  // view: {pose, lens}, lens with the window's pixels
  want(view, isMoving) {
    this.wanted = {...view, mode: this.mode, scale: isMoving ? this.scale : 1};
    if (!this.isBusy) this.next();
  }

  async next() {
    this.isBusy = true;
    while (this.wanted) {
      const view = this.wanted;
      this.wanted = null;
      try {
        await this.ask(view);
      } catch (error) {
        this.failed(error);
        await new Promise(done => setTimeout(done, 1000));
      }
    }
    this.isBusy = false;
  }

  async ask(view) {
    const scale = Math.min(view.scale, MOST_PIXELS / Math.max(view.lens.width, view.lens.height));
    const [width, height] = [view.lens.width, view.lens.height].map(pixels => Math.max(16, Math.round(pixels * scale)));
    const {fx, fy, cx, cy} = resized(view.lens, width, height);
    const from = performance.now();
    const frame = await askForFrame({
      w: width, h: height, fx, fy, cx, cy, m: rowsOfPose(view.pose).map(x => Number(x.toPrecision(9))).join(','),
      mode: view.mode, q: view.scale < 1 ? QUALITY_MOVING : QUALITY_STILL, client: this.client});
    if (!frame) return;  // overtaken
    this.latency = performance.now() - from;
    this.render = frame.milliseconds;
    const {picture} = frame;
    if (view.scale < 1) this.adapt();
    this.canvas.width = picture.width;
    this.canvas.height = picture.height;
    this.canvas.getContext('2d').drawImage(picture, 0, 0);
    picture.close();
    this.shown(view);
  }

  // Pixels take time about in proportion: towards the goal, by half of what is missing.
  adapt() {
    const wish = this.scale * Math.sqrt(GOAL / Math.max(this.latency, 5));
    this.scale = Math.min(1, Math.max(LEAST_SCALE, (this.scale + wish) / 2));
  }
}
