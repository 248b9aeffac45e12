// SPDX-License-Identifier: Apache-2.0
// The photos' cameras as frusta: draws them over the picture, and finds the one under the pointer.
import {Color, Matrix4, PerspectiveCamera, Scene, Vector3} from 'three';
import {LineMaterial} from 'three/addons/lines/LineMaterial.js';
import {LineSegments2} from 'three/addons/lines/LineSegments2.js';
import {LineSegmentsGeometry} from 'three/addons/lines/LineSegmentsGeometry.js';
import {projectionOf} from './lens.js';

const FAINT = 0.3;
const WIDTH = 1.6,
  WIDTH_MARKED = 3; // CSS pixels
const REACH = 12; // CSS pixels: a pointer this near to an apex hits it
// On any picture, light or dark.
const COLORS = {train: '#6ea8ff', test: '#ffae57', '': '#6ea8ff', marked: '#ffffff'};
const NEAREST = 2.5; // frustum sizes: lines nearer to the eye are not drawn
// 5: the tip of the roof, which shows where up is.
const EDGES = [
  [0, 1],
  [0, 2],
  [0, 3],
  [0, 4],
  [1, 2],
  [2, 3],
  [3, 4],
  [4, 1],
  [1, 5],
  [5, 2],
];

// The apex, the four corners and the roof's tip of a camera's frustum whose picture lies `depth`
// ahead.
function corners(camera, depth) {
  const {width, height, fx, fy, cx, cy} = camera;
  const matrix = new Matrix4().set(...camera.world_from_camera);
  const at = (u, v) =>
    new Vector3(((u - cx) / fx) * depth, ((v - cy) / fy) * depth, depth).applyMatrix4(matrix);
  return [
    new Vector3().setFromMatrixPosition(matrix),
    at(0, 0),
    at(width, 0),
    at(width, height),
    at(0, height),
    at(width / 2, -0.18 * height),
  ];
}

// A size at which neighbors do not overlap: a fraction of the median distance between cameras,
// within limits of the scene's radius.
function sizeFor(centers, radius) {
  const step = Math.max(1, Math.floor(centers.length / 200)),
    gaps = [];
  for (let i = 0; i < centers.length; i += step) {
    let nearest = Infinity;
    for (const other of centers)
      if (other !== centers[i]) nearest = Math.min(nearest, centers[i].distanceTo(other));
    if (nearest > 0 && nearest < Infinity) gaps.push(nearest);
  }
  const gap = gaps.length ? gaps.sort((a, b) => a - b)[gaps.length >> 1] : radius;
  return Math.min(Math.max(0.4 * gap, 0.01 * radius), 0.12 * radius);
}

export class Frusta {
  constructor(cameras, radius) {
    this.cameras = cameras;
    this.visible = false; // as the settings say
    this.isSuppressed = false; // while the interface is hidden
    this.marked = this.hidden = null; // indices: under the pointer; the view itself
    this.scene = new Scene();
    this.eye = new PerspectiveCamera();
    const centers = cameras.map(({world_from_camera: m}) => new Vector3(m[3], m[7], m[11]));
    this.size = sizeFor(centers, radius);
    this.points = cameras.map(camera =>
      corners(
        camera,
        (this.size * 2 * Math.min(camera.fx, camera.fy)) / Math.hypot(camera.width, camera.height),
      ),
    );
    this.lines = new LineSegments2(
      new LineSegmentsGeometry(),
      new LineMaterial({vertexColors: true, linewidth: WIDTH, depthTest: false, transparent: true}),
    );
    this.mark = new LineSegments2(
      new LineSegmentsGeometry(),
      new LineMaterial({
        color: COLORS.marked,
        linewidth: WIDTH_MARKED,
        depthTest: false,
        transparent: true,
      }),
    );
    for (const each of [this.lines, this.mark]) {
      each.frustumCulled = false;
      this.scene.add(each);
    }
    this.mark.visible = false;
    this.build();
  }

  build() {
    const positions = [],
      colors = [];
    this.points.forEach((points, i) => {
      if (i === this.hidden) return;
      const {r, g, b} = new Color(COLORS[this.cameras[i].split] ?? COLORS['']);
      for (const edge of EDGES)
        for (const end of edge) {
          positions.push(...points[end]);
          colors.push(r, g, b);
        }
    });
    this.lines.visible = positions.length > 0;
    if (!this.lines.visible) return;
    this.lines.geometry.dispose();
    this.lines.geometry = new LineSegmentsGeometry().setPositions(positions).setColors(colors);
  }

  // Hides one frustum: that of the view's own camera, whose lines would frame the whole picture.
  hide(index) {
    if (index === this.hidden) return;
    this.hidden = index;
    this.build();
  }

  setMarked(index) {
    if (index === this.marked) return false;
    this.marked = index;
    this.mark.visible = index !== null;
    if (index !== null) {
      this.mark.geometry.dispose();
      this.mark.geometry = new LineSegmentsGeometry().setPositions(
        EDGES.flatMap(edge => edge.flatMap(end => [...this.points[index][end]])),
      );
    }
    return true;
  }

  get isShown() {
    return this.visible && !this.isSuppressed && this.cameras.length > 0;
  }

  // lens: of the window; isFaint: drawn weaker, while the picture is compared. Lines near the eye
  // are clipped, so that a frustum that it nearly stands in does not cover the picture.
  draw(renderer, {position, quaternion}, lens, far, isFaint) {
    if (!this.isShown) return;
    this.lines.material.opacity = isFaint ? FAINT : 0.8;
    const projection = projectionOf(lens, Math.min(NEAREST * this.size, far / 2), far);
    this.eye.position.copy(position);
    this.eye.quaternion.copy(quaternion);
    this.eye.updateMatrixWorld(true);
    this.eye.projectionMatrix.copy(projection);
    this.eye.projectionMatrixInverse.copy(projection).invert();
    renderer.render(this.scene, this.eye);
  }

  // The index of the nearest camera at a place of the window (CSS pixels), or null.
  pick(x, y, {position, quaternion}, lens) {
    if (!this.isShown) return null;
    const viewFromWorld = new Matrix4()
      .compose(position, quaternion, new Vector3(1, 1, 1))
      .invert();
    const onScreen = point => {
      const p = point.clone().applyMatrix4(viewFromWorld);
      return p.z < -NEAREST * this.size
        ? {x: lens.cx - (lens.fx * p.x) / p.z, y: lens.cy + (lens.fy * p.y) / p.z, depth: -p.z}
        : null;
    };
    let best = null,
      depth = Infinity;
    this.points.forEach((points, i) => {
      if (i === this.hidden) return;
      const [apex, ...corners] = points.slice(0, 5).map(onScreen);
      const near = apex && Math.hypot(apex.x - x, apex.y - y) < REACH;
      const inside = corners.every(Boolean) && isInside(corners, x, y);
      const here = near ? apex.depth : inside ? corners[0].depth : Infinity;
      if (here < depth) [best, depth] = [i, here];
    });
    return best;
  }
}

// Whether (x, y) lies in a convex polygon of either orientation.
function isInside(polygon, x, y) {
  const sides = polygon.map((a, i) => {
    const b = polygon[(i + 1) % polygon.length];
    return (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
  });
  return sides.every(side => side >= 0) || sides.every(side => side <= 0);
}
