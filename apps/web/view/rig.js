// SPDX-License-Identifier: Apache-2.0
// The viewer's own camera: pose and lens, and how they move (orbit, look around, shift, fly to a
// camera). World axes are the scene's.
import {Matrix4, Quaternion, Vector3} from 'three';
import {lensOf, mixedLens, poseFromRows} from './picture/lens.js';

const STEEPEST = (89.5 * Math.PI) / 180; // largest angle between the horizon and the line of sight
const FLIGHT = 700; // milliseconds

const ease = t => (t < 0.5 ? 4 * t ** 3 : 1 - (2 - 2 * t) ** 3 / 2);
const calm = () => matchMedia('(prefers-reduced-motion: reduce)').matches;

export class Rig {
  // changed(): called after every movement.
  constructor(changed) {
    this.changed = changed;
    this.position = new Vector3();
    this.quaternion = new Quaternion();
    this.target = new Vector3(0, 0, 1); // the center of orbits
    this.up = new Vector3(0, -1, 0);
    this.lens = null;
    this.at = null; // index of the camera whose view this exactly is
    this.flight = null; // the animation towards another view
  }

  axis(x, y, z) {
    return new Vector3(x, y, z).applyQuaternion(this.quaternion);
  }
  get distance() {
    return this.position.distanceTo(this.target);
  }

  // After a movement by hand: the view is no longer a camera's, and a flight ends.
  moved() {
    this.at = null;
    this.flight = null;
    this.changed();
  }

  turn(rotation, pivot) {
    if (pivot) this.position.sub(pivot).applyQuaternion(rotation).add(pivot);
    this.quaternion.premultiply(rotation).normalize();
  }

  // Angles in radians, positive to the left and up; about `pivot`, or about the viewer if there is
  // none.
  rotate(yaw, pitch, pivot) {
    const elevation = Math.asin(Math.min(1, Math.max(-1, this.axis(0, 0, -1).dot(this.up))));
    const free = this.axis(0, 1, 0).dot(this.up) > 0; // an upright view stays upright
    const tilt = free
      ? Math.min(STEEPEST, Math.max(-STEEPEST, elevation + pitch)) - elevation
      : pitch;
    this.turn(new Quaternion().setFromAxisAngle(this.axis(1, 0, 0), tilt), pivot);
    this.turn(new Quaternion().setFromAxisAngle(this.up, yaw), pivot);
    this.moved();
  }

  orbit(yaw, pitch) {
    this.rotate(yaw, pitch, this.target);
  }
  look(yaw, pitch) {
    const distance = this.distance;
    this.rotate(yaw, pitch);
    this.target.copy(this.position).addScaledVector(this.axis(0, 0, -1), distance);
  }

  // Moves along the camera's axes, and the target with it. World units.
  shift(right, down, forward) {
    const by = this.axis(right, -down, -forward);
    this.position.add(by);
    this.target.add(by);
    this.moved();
  }

  // Towards the target (factor < 1) or away from it. The target stays at least `nearest` ahead.
  approach(factor, nearest) {
    const distance = this.distance,
      by = distance * (1 - factor),
      ahead = this.axis(0, 0, -1);
    this.position.addScaledVector(ahead, by);
    this.target.copy(this.position).addScaledVector(ahead, Math.max(nearest, distance - by));
    this.moved();
  }

  roll(angle) {
    this.turn(new Quaternion().setFromAxisAngle(this.axis(0, 0, -1), angle));
    this.moved();
  }

  // Makes this point the center of orbits and turns the view to it.
  setTarget(point) {
    const direction = point.clone().sub(this.position).normalize();
    const rotation = new Quaternion().setFromUnitVectors(this.axis(0, 0, -1), direction);
    this.target.copy(point);
    this.go({
      position: this.position.clone(),
      quaternion: rotation.multiply(this.quaternion.clone()),
    });
  }

  level() {
    this.go({position: this.position.clone(), quaternion: this.facing(this.axis(0, 0, -1))});
  }

  // The orientation that looks along `forward` with the horizon level.
  facing(forward) {
    const back = forward.clone().negate().normalize();
    let right = this.up.clone().cross(back);
    if (right.lengthSq() < 1e-8) right = this.axis(1, 0, 0);
    right.normalize();
    const up = back.clone().cross(right);
    return new Quaternion().setFromRotationMatrix(new Matrix4().makeBasis(right, up, back));
  }

  // Flies to a view, or jumps there if the user prefers reduced motion. view: {position,
  // quaternion, lens, at, target}
  go(view, {jump = calm()} = {}) {
    const lens = view.lens ?? this.lens;
    this.at = null;
    if (jump) return this.arrive({...view, lens});
    this.flight = {
      from: {position: this.position.clone(), quaternion: this.quaternion.clone(), lens: this.lens},
      to: {...view, lens},
      since: performance.now(),
    };
    this.changed();
  }

  // The view of a camera of scene.json. The target is the point on its line of sight at the depth
  // of `center`.
  viewOf(camera, center) {
    const pose = poseFromRows(camera.world_from_camera);
    const forward = new Vector3(0, 0, -1).applyQuaternion(pose.quaternion);
    const depth = Math.max(
      center.clone().sub(pose.position).dot(forward),
      0.2 * center.distanceTo(pose.position),
      1e-3,
    );
    return {
      ...pose,
      lens: lensOf(camera),
      target: pose.position.clone().addScaledVector(forward, depth),
    };
  }
  goToCamera(camera, index, center, options) {
    this.go({...this.viewOf(camera, center), at: index}, options);
  }

  // To where a camera stood, with the horizon level.
  goLevelTo(camera, center, options) {
    const view = this.viewOf(camera, center),
      forward = view.target.clone().sub(view.position);
    this.go({...view, quaternion: this.facing(forward)}, options);
  }

  // To a place from which the view looks at `center`; without one to where a model of this radius is
  // seen as a whole, a little from above.
  goInFrontOf(center, radius, place, lens, options) {
    const away = new Vector3(0.6, 0, 1)
      .projectOnPlane(this.up)
      .addScaledVector(this.up, 0.35)
      .normalize();
    const position = place ?? center.clone().addScaledVector(away, 2.5 * radius);
    this.go(
      {
        position,
        quaternion: this.facing(center.clone().sub(position)),
        target: center.clone(),
        lens,
      },
      options,
    );
  }

  arrive({position, quaternion, lens, at = null, target}) {
    this.position.copy(position);
    this.quaternion.copy(quaternion);
    if (target) this.target.copy(target);
    this.lens = lens;
    this.at = at;
    this.flight = null;
    this.changed();
  }

  // Advances a flight by one frame.
  advance(now) {
    if (!this.flight) return;
    const {from, to, since} = this.flight,
      t = Math.min(1, (now - since) / FLIGHT),
      s = ease(t);
    if (t >= 1) return this.arrive(to);
    this.position.lerpVectors(from.position, to.position, s);
    this.quaternion.slerpQuaternions(from.quaternion, to.quaternion, s);
    this.lens = mixedLens(from.lens, to.lens, s);
    this.changed();
  }
}
