// SPDX-License-Identifier: Apache-2.0
// A slow turn around the scene, with which an exported page begins: over the arc from which photos
// were taken, or all around, until somebody touches the page.
import {Quaternion, Vector3} from 'three';
import {viewOf} from './address.js';

const SPEED = (6 * Math.PI) / 180; // radians a second
const NARROWEST = (20 * Math.PI) / 180; // radians: an arc to and fro where all cameras are near

export class Turn {
  // The scene asks for it, the address names no place, and the user does not want little motion.
  static isWanted(scene, options) {
    const isCalm = matchMedia('(prefers-reduced-motion: reduce)').matches;
    return (
      Boolean(scene.turn) &&
      options.get('turn') !== '0' &&
      !isCalm &&
      !viewOf(options, scene.cameras)
    );
  }

  // scene.turn: {middle, width}: a place on the circle, and radians of the arc about it; a whole turn
  // goes on in one direction
  constructor(scene, rig, stage) {
    const {middle, width} = scene.turn;
    this.rig = rig;
    this.stage = stage;
    this.center = new Vector3(...scene.center);
    this.axis = new Vector3(...scene.up).normalize();
    this.start = new Vector3(...middle).sub(this.center);
    this.width = Math.max(width, NARROWEST);
    this.seconds = 0;
    this.isOn = true;
    for (const touch of ['pointerdown', 'wheel', 'keydown'])
      addEventListener(touch, () => this.stop(), {capture: true, once: true});
    this.step(0);
  }

  get angle() {
    if (this.width >= 2 * Math.PI - 1e-6) return SPEED * this.seconds;
    return (this.width / 2) * Math.sin(((2 * SPEED) / this.width) * this.seconds); // SPEED at its middle
  }

  step(seconds) {
    if (!this.isOn) return;
    this.seconds += seconds;
    const turn = new Quaternion().setFromAxisAngle(this.axis, this.angle);
    const position = this.start.clone().applyQuaternion(turn).add(this.center);
    this.rig.arrive({
      position,
      quaternion: this.rig.facing(this.center.clone().sub(position)),
      target: this.center.clone(),
      lens: this.rig.lens,
    });
  }

  stop() {
    this.isOn = false;
    this.stage.request(); // the picture of the place where it stops
  }
}
