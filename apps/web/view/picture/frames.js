// SPDX-License-Identifier: Apache-2.0
// The picture of --remote: requests one frame after another from the server, small ones while the
// view moves.
import {rowsOfPose, resized} from './lens.js';
import {askForFrame} from '../server.js';

// Milliseconds from request to picture that are aimed at while the view moves.
const GOAL = 90;
const LEAST_SCALE = 0.15;
const MOST_PIXELS = 4096; // on a side: the server's limit
const QUALITY_MOVING = 70,
  QUALITY_STILL = 92,
  QUALITY_BEST = 100;

export class FramePicture {
  // canvas: where frames are drawn; shown(view): called after a frame of this view was drawn;
  // failed(error)
  constructor(canvas, shown, failed) {
    this.canvas = canvas;
    this.shown = shown;
    this.failed = failed;
    this.mode = 'color';
    this.look = null; // index of the camera whose photo's colors are shown
    this.scale = 0.5; // of frames while the view moves, to the window's pixels
    this.latency = null; // milliseconds from request to picture, of the last frame
    this.render = null; // of these, milliseconds that the server rendered
    this.wanted = null; // the view to request next
    this.isBusy = false;
    // The server drops a request when a newer one of the same client comes.
    this.client = Math.random().toString(36).slice(2);
  }

  get isPending() {
    return this.isBusy || this.wanted !== null;
  }

  // Shows this view as soon as possible. view: {pose, lens}, the lens in the window's pixels
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

  // The frame of {pose, time} with this lens, in the best quality and beside those of the canvas.
  async frameOf(view, lens) {
    return (
      await askForFrame(
        this.query({...view, mode: this.mode}, lens, QUALITY_BEST, `${this.client}-still`),
      )
    ).picture;
  }

  // through: the index of the camera through whose lens the picture is seen, or null
  query({pose, mode, time, through = null}, {width, height, fx, fy, cx, cy}, quality, client) {
    return {
      w: width,
      h: height,
      fx,
      fy,
      cx,
      cy,
      m: rowsOfPose(pose)
        .map(x => Number(x.toPrecision(9)))
        .join(','),
      mode,
      ...(time === undefined ? {} : {t: Number(time.toFixed(6))}),
      ...(this.look === null ? {} : {look: this.look}),
      ...(through === null || mode === 'normal' ? {} : {lens: through}),
      q: quality,
      client,
    };
  }

  async ask(view) {
    const scale = Math.min(view.scale, MOST_PIXELS / Math.max(view.lens.width, view.lens.height));
    const [width, height] = [view.lens.width, view.lens.height].map(pixels =>
      Math.max(16, Math.round(pixels * scale)),
    );
    const from = performance.now();
    const frame = await askForFrame(
      this.query(
        view,
        resized(view.lens, width, height),
        view.scale < 1 ? QUALITY_MOVING : QUALITY_STILL,
        this.client,
      ),
    );
    if (!frame) return; // a newer request has replaced it
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

  // Latency grows about in proportion to the number of pixels. Moves the scale halfway to the one
  // that meets the goal.
  adapt() {
    const wish = this.scale * Math.sqrt(GOAL / Math.max(this.latency, 5));
    this.scale = Math.min(1, Math.max(LEAST_SCALE, (this.scale + wish) / 2));
  }
}
