// SPDX-License-Identifier: Apache-2.0
// Lines, points and words over the picture, at places of the world: what tools draw.
import {Matrix4, Vector3} from 'three';
import {svg} from '../../shared/dom.js';

const NEAREST = 1e-3; // of the scene's radius: lines are cut off this far ahead of the eye

export class Overlay {
  // radius: of the scene, in world units
  constructor(radius) {
    this.nearest = NEAREST * radius;
    this.tools = [];
    this.node = svg('svg', {class: 'overlay', 'aria-hidden': 'true'});
    this.viewFromWorld = new Matrix4();
  }

  /// A tool has draw(overlay), which returns elements for this view.
  add(tool) {
    this.tools.push(tool);
  }

  /// view: {pose, lens}, the lens of the window
  draw({pose, lens}) {
    this.lens = lens;
    this.viewFromWorld.compose(pose.position, pose.quaternion, new Vector3(1, 1, 1)).invert();
    this.node.replaceChildren(...this.tools.flatMap(tool => tool.draw(this)));
  }

  seen(point) {
    return point.clone().applyMatrix4(this.viewFromWorld);
  }
  onScreen({x, y, z}) {
    return {x: this.lens.cx - (this.lens.fx * x) / z, y: this.lens.cy + (this.lens.fy * y) / z};
  }

  /// Where the window shows a point: {x, y} in CSS pixels, or null behind the eye.
  place(point) {
    const seen = this.seen(point);
    return seen.z < -this.nearest ? this.onScreen(seen) : null;
  }

  /// A line between two points, or nothing behind the eye.
  line(from, to, attributes) {
    const [a, b] = [this.seen(from), this.seen(to)].sort((a, b) => a.z - b.z);
    if (a.z >= -this.nearest) return [];
    if (b.z > -this.nearest) b.lerp(a, (b.z + this.nearest) / (b.z - a.z));
    const [p, q] = [this.onScreen(a), this.onScreen(b)];
    return [svg('line', {x1: p.x, y1: p.y, x2: q.x, y2: q.y, ...attributes})];
  }

  circle(point, r, attributes) {
    const at = this.place(point);
    return at ? [svg('circle', {cx: at.x, cy: at.y, r, ...attributes})] : [];
  }

  words(point, text, attributes = {}) {
    const at = this.place(point);
    return at ? [svg('text', {x: at.x, y: at.y, ...attributes}, text)] : [];
  }
}
