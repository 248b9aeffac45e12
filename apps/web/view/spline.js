// SPDX-License-Identifier: Apache-2.0
// A smooth path through camera poses: that of gs_render/camera_spline.h, which `gemsplat render`
// follows.
import {Quaternion, Vector3} from 'three';

const SAMPLES = 128; // of each interval, along which the length of the path is measured

// Exact for small angles, unlike acos.
const angleBetween = (a, b) => {
  const sign = a.dot(b) < 0 ? -1 : 1;
  return (
    4 *
    Math.asin(
      Math.min(
        1,
        Math.hypot(a.x - sign * b.x, a.y - sign * b.y, a.z - sign * b.z, a.w - sign * b.w) / 2,
      ),
    )
  );
};

/// Through keys {position, quaternion}; a closed path returns to the first one.
export class Spline {
  constructor(keys, isClosed) {
    this.turnLength = 1;
    this.keys = keys.filter((key, i) => i === 0 || this.between(keys[i - 1], key) > 0);
    while (isClosed && this.keys.length > 1 && this.between(this.keys[0], this.keys.at(-1)) === 0)
      this.keys.pop();
    this.isClosed = isClosed && this.keys.length > 1;
    // Translation and rotation have the same share of the path through the keys.
    const pairs = this.keys.slice(1).map((key, i) => [this.keys[i], key]),
      sum = of => pairs.reduce((total, pair) => total + of(...pair), 0);
    const moved = sum((a, b) => a.position.distanceTo(b.position)),
      turned = sum((a, b) => angleBetween(a.quaternion, b.quaternion));
    if (moved > 0 && turned > 0) this.turnLength = moved / turned;
    this.knots = [0];
    const intervals = this.isClosed ? this.keys.length : this.keys.length - 1;
    for (let i = 0; i < intervals; ++i) this.knots.push(this.knots[i] + this.interval(i));
    this.measure();
  }

  get end() {
    return this.knots.at(-1);
  }
  between(a, b) {
    return Math.hypot(
      a.position.distanceTo(b.position),
      this.turnLength * angleBetween(a.quaternion, b.quaternion),
    );
  }
  key(i) {
    const n = this.keys.length;
    return this.keys[this.isClosed ? ((i % n) + n) % n : Math.min(n - 1, Math.max(0, i))];
  }
  // From key i to key i + 1, centripetal; 0 beyond the ends.
  interval(i) {
    return Math.sqrt(this.between(this.key(i), this.key(i + 1)));
  }

  /// The pose at time t of the knots.
  at(t) {
    const {knots} = this,
      last = knots.length - 2;
    if (last < 0)
      return {position: this.keys[0].position.clone(), quaternion: this.keys[0].quaternion.clone()};
    const time = Math.min(this.end, Math.max(0, t));
    let i = 0;
    while (i < last && knots[i + 1] <= time) ++i;
    const span = knots[i + 1] - knots[i],
      s = (time - knots[i]) / span;
    const values = [-1, 0, 1, 2].map(k => this.key(i + k)),
      first = values[1].quaternion;
    // All quaternions in one hemisphere: the third decides for the last.
    const onSide = (q, of) => (q.dot(of) < 0 ? new Quaternion(-q.x, -q.y, -q.z, -q.w) : q);
    const third = onSide(values[2].quaternion, first),
      turns = [
        onSide(values[0].quaternion, first),
        first,
        third,
        onSide(values[3].quaternion, third),
      ];
    const flat = values.map(({position: p}, k) => [
      p.x,
      p.y,
      p.z,
      turns[k].x,
      turns[k].y,
      turns[k].z,
      turns[k].w,
    ]);
    const before = this.interval(i - 1),
      after = this.interval(i + 1);
    const mixed = flat[1].map((_, k) =>
      hermite(
        flat.map(each => each[k]),
        before,
        span,
        after,
        s,
      ),
    );
    return {
      position: new Vector3(...mixed.slice(0, 3)),
      quaternion: new Quaternion(...mixed.slice(3)).normalize(),
    };
  }

  // The length of the path up to evenly spaced times of each interval.
  measure() {
    this.samples = [{t: 0, length: 0}];
    let last = this.at(0);
    for (let i = 0; i + 1 < this.knots.length; ++i)
      for (let k = 1; k <= SAMPLES; ++k) {
        const t = this.knots[i] + ((this.knots[i + 1] - this.knots[i]) * k) / SAMPLES,
          pose = this.at(t);
        this.samples.push({t, length: this.samples.at(-1).length + this.between(last, pose)});
        last = pose;
      }
  }

  /// The pose at a share of the path, 0 to 1: at constant speed (pace "even"), or with the same time
  /// from each key to the next ("keys").
  along(share, pace) {
    const s = Math.min(1, Math.max(0, share)),
      intervals = this.knots.length - 1;
    if (intervals < 1) return this.at(0);
    if (pace === 'keys') {
      const at = Math.min(intervals - 1, Math.floor(s * intervals)),
        rest = s * intervals - at;
      return this.at(this.knots[at] + rest * (this.knots[at + 1] - this.knots[at]));
    }
    const wanted = s * this.samples.at(-1).length,
      next = this.samples.findIndex(({length}) => length >= wanted);
    if (next <= 0) return this.at(0);
    const [a, b] = [this.samples[next - 1], this.samples[next]];
    return this.at(a.t + ((b.t - a.t) * (wanted - a.length)) / (b.length - a.length));
  }
}

// Cubic between p1 and p2 with the slopes of a Catmull-Rom spline whose knots are not evenly spaced.
function hermite([p0, p1, p2, p3], before, span, after, s) {
  const slope = (a, b, c, x, y) =>
    x > 0 && y > 0
      ? (b - a) / x - (c - a) / (x + y) + (c - b) / y
      : x > 0
        ? (b - a) / x
        : (c - b) / y;
  const m1 = span * slope(p0, p1, p2, before, span),
    m2 = span * slope(p1, p2, p3, span, after);
  const s2 = s * s,
    s3 = s2 * s;
  return (
    (2 * s3 - 3 * s2 + 1) * p1 + (s3 - 2 * s2 + s) * m1 + (3 * s2 - 2 * s3) * p2 + (s3 - s2) * m2
  );
}
