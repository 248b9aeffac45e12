// SPDX-License-Identifier: Apache-2.0
// The region of a crop: a box that stands upright or a sphere, as `gemsplat edit` takes it
// (docs/reference/edit.md). A box has the axes of the model after `--up`, which turns up to -y.
import {Matrix4, Quaternion, Vector3} from 'three';
import {MovingModel} from '../picture/moving.js';

const AXES = ['x', 'y', 'z'];
const EDGES = [
  [0, 1],
  [2, 3],
  [4, 5],
  [6, 7],
  [0, 2],
  [1, 3],
  [4, 6],
  [5, 7],
  [0, 4],
  [1, 5],
  [2, 6],
  [3, 7],
];
const SEGMENTS = 48; // of a circle
const DIGITS = 5,
  DIGITS_OF_UP = 7;
const LEVEL = 1e-4; // radians: less is no tilt

// The rotation from `up` to -y, as turn_upright() of model_transform.h has it.
function turnUpright({x, y, z}) {
  const turn = new Quaternion(z, 0, -x, 1 - y);
  return turn.lengthSq() < 1e-18 ? new Quaternion(1, 0, 0, 0) : turn.normalize();
}

export class Region {
  // offset: from the model's numbers to the coordinates that people and `gemsplat edit` know
  constructor(center, radius, offset, up) {
    this.offset = offset;
    const rounded = up
      .clone()
      .normalize()
      .toArray()
      .map(x => Number(x.toPrecision(DIGITS_OF_UP)));
    this.isTilted = up.angleTo(new Vector3(0, -1, 0)) > LEVEL;
    this.up = rounded.join(',');
    this.turn = this.isTilted ? turnUpright(new Vector3(...rounded).normalize()) : new Quaternion();
    this.turnedOffset = this.turned(new Vector3(...offset)).toArray();
    this.shape = 'box';
    this.drops = false;
    this.fitTo(center, radius);
  }

  // Between the world and the axes of the box.
  turned(point) {
    return point.clone().applyQuaternion(this.turn);
  }
  world(point) {
    return point.clone().applyQuaternion(this.turn.clone().conjugate());
  }

  fitTo(center, radius) {
    this.low = this.turned(center).subScalar(radius);
    this.high = this.turned(center).addScalar(radius);
    this.center = center.clone();
    this.radius = radius;
  }

  /// The numbers that people set: [label, value, set(value)].
  get fields() {
    const corner = (name, point, offset) =>
      AXES.map((axis, i) => [
        `${axis} ${name}`,
        point[axis] + offset[i],
        value => {
          point[axis] = value - offset[i];
        },
      ]);
    if (this.shape === 'box')
      return [
        ...corner('from', this.low, this.turnedOffset),
        ...corner('to', this.high, this.turnedOffset),
      ];
    return [
      ...corner('center', this.center, this.offset),
      [
        'radius',
        this.radius,
        value => {
          this.radius = Math.max(0, value);
        },
      ],
    ];
  }

  /// The words of the operation: "--keep box=-1,-1,-1,1,1,1"; of a tilted model between those that
  /// turn it upright and back.
  get operation() {
    const text = (point, offset) =>
      AXES.map((axis, i) =>
        String(
          Number((point[axis] + offset[i]).toPrecision(this.digitsOf(point[axis] + offset[i]))),
        ),
      ).join(',');
    const does = `--${this.drops ? 'drop' : 'keep'}`,
      number = String(Number(this.radius.toPrecision(DIGITS)));
    if (this.shape === 'sphere')
      return `${does} sphere=${text(this.center, this.offset)},${number}`;
    const [low, high] = this.corners,
      box = `${does} box=${text(low, this.turnedOffset)},${text(high, this.turnedOffset)}`;
    return this.isTilted ? `--up ${this.up} ${box} --restore-frame` : box;
  }
  // As precise as the region is large, also far from the origin.
  digitsOf(value) {
    const size = Math.max(this.radius, this.low.distanceTo(this.high), 1e-9);
    return Math.min(
      15,
      Math.max(DIGITS, DIGITS + Math.ceil(Math.log10(Math.max(1, Math.abs(value) / size)))),
    );
  }

  // Low and high, also where somebody has set them the other way around.
  get corners() {
    return [this.low.clone().min(this.high), this.low.clone().max(this.high)];
  }

  contains(x, y, z) {
    if (this.shape === 'sphere')
      return Math.hypot(x - this.center.x, y - this.center.y, z - this.center.z) <= this.radius;
    const [low, high] = this.corners,
      at = this.turned(new Vector3(x, y, z));
    return AXES.every(axis => at[axis] >= low[axis] && at[axis] <= high[axis]);
  }

  /// Sets the uniforms by which the page hides what would go (shaders.js).
  apply(splats) {
    const [low, high] = this.corners,
      isBox = this.shape === 'box';
    splats.effects.cropLow.value.copy(isBox ? low : this.center);
    splats.effects.cropHigh.value.copy(isBox ? high : new Vector3(this.radius, 0, 0));
    splats.effects.cropTurn.value.setFromMatrix4(
      new Matrix4().makeRotationFromQuaternion(this.turn),
    );
    splats.effects.cropDrops.value = this.drops;
    splats.setEffect('cropKind', isBox ? 1 : 2);
  }

  /// Its lines for people: pairs of points.
  get lines() {
    if (this.shape === 'box') {
      const [low, high] = this.corners,
        at = i =>
          new Vector3(i & 1 ? high.x : low.x, i & 2 ? high.y : low.y, i & 4 ? high.z : low.z);
      return EDGES.map(([a, b]) => [this.world(at(a)), this.world(at(b))]);
    }
    const circle = (u, v) =>
      Array.from({length: SEGMENTS}, (_, i) =>
        [i, i + 1].map(k => {
          const angle = (2 * Math.PI * k) / SEGMENTS,
            point = this.center.clone();
          point[u] += this.radius * Math.cos(angle);
          point[v] += this.radius * Math.sin(angle);
          return point;
        }),
      );
    return [...circle('x', 'y'), ...circle('y', 'z'), ...circle('z', 'x')];
  }

  /// Where it can be dragged: {point, axis, drag(distance along the axis)}.
  get handles() {
    const along = axis => new Vector3(...AXES.map(each => Number(each === axis)));
    if (this.shape === 'sphere') {
      const edge = this.center.clone().add(new Vector3(this.radius, 0, 0));
      const moves = AXES.map(axis => ({
        point: this.center
          .clone()
          .addScaledVector(along(axis), axis === 'x' ? 0 : 0.5 * this.radius),
        axis: along(axis),
        drag: by => {
          this.center[axis] += by;
        },
      }));
      return [
        ...moves.slice(1),
        {
          point: edge,
          axis: along('x'),
          drag: by => {
            this.radius = Math.max(0, this.radius + by);
          },
        },
      ];
    }
    const middle = this.low.clone().lerp(this.high, 0.5);
    return AXES.flatMap(axis =>
      [this.low, this.high].map(corner => {
        const point = middle.clone();
        point[axis] = corner[axis];
        return {
          point: this.world(point),
          axis: this.world(along(axis)),
          drag: by => {
            corner[axis] += by;
          },
        };
      }),
    );
  }

  /// How many Gaussians would remain, and of how many: {kept, all}, or null for a streamed model, of
  /// which the page has only a part.
  count(splats) {
    if (splats.streamed || !splats.mesh) return null;
    let kept = 0,
      all = 0;
    const take = (x, y, z) => {
      ++all;
      if (this.contains(x, y, z) !== this.drops) ++kept;
    };
    if (splats.mesh instanceof MovingModel) {
      for (const {
        extSplats: {
          chunk: {count, mean},
        },
      } of splats.mesh.children)
        for (let i = 0; i < count; ++i) take(mean[3 * i], mean[3 * i + 1], mean[3 * i + 2]);
      return {kept, all};
    }
    splats.mesh.updateMatrix();
    const world = new Matrix4().copy(splats.mesh.matrix),
      point = new Vector3();
    splats.mesh.forEachSplat((_, center) => {
      point.copy(center).applyMatrix4(world);
      take(point.x, point.y, point.z);
    });
    return {kept, all};
  }
}
