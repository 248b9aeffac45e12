// SPDX-License-Identifier: Apache-2.0
// The picture that the server draws: asks for one frame after the other, small ones while the view moves.
import {rowsOfPose, resized} from './lens.js';
import {askForFrame} from './server.js';

const GOAL = 90;                    // milliseconds from request to picture, while the view moves
const LEAST_SCALE = 0.15;
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
    const width = Math.max(16, Math.round(view.lens.width * view.scale)), height = Math.max(16, Math.round(view.lens.height * view.scale));
    const {fx, fy, cx, cy} = resized(view.lens, width, height);
    const from = performance.now();
    const {picture, milliseconds} = await askForFrame({
      w: width, h: height, fx, fy, cx, cy, m: rowsOfPose(view.pose).map(x => Number(x.toPrecision(9))).join(','),
      mode: view.mode, q: view.scale < 1 ? QUALITY_MOVING : QUALITY_STILL});
    this.latency = performance.now() - from;
    this.render = milliseconds;
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
