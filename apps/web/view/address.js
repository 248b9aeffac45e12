// SPDX-License-Identifier: Apache-2.0
// The address of the page holds the view after its #, so that it can be shared and kept, and the
// browser's Back and Forward lead through the places that were jumped to.
import {Vector3} from 'three';

const REST = 400; // milliseconds: browsers refuse an address that changes all the time
const DIGITS = 6;

const list = numbers =>
  [...numbers].map(number => String(Number(number.toPrecision(DIGITS)))).join(',');

// So many finite numbers with commas between them; null for anything else.
function numbersOf(text, count) {
  const numbers = (text ?? '').split(',').map(word => (word.trim() === '' ? NaN : Number(word)));
  return numbers.length === count && numbers.every(Number.isFinite) ? numbers : null;
}

/// The view that an address describes: {camera} or {position, quaternion, target, lens}, or null.
export function viewOf(options, cameras) {
  const index = options.get('camera') ?? options.get('c');
  if (/^\d+$/.test(index ?? '') && cameras[index]) return {camera: Number(index)};
  const position = numbersOf(options.get('p'), 3),
    quaternion = numbersOf(options.get('q'), 4),
    lens = numbersOf(options.get('lens'), 6);
  const target = numbersOf(options.get('o'), 3);
  const length = Math.hypot(...(quaternion ?? []));
  if (!position || !lens || !target || !(length > 0) || lens.slice(0, 4).some(side => side <= 0))
    return null;
  const [width, height, fx, fy, cx, cy] = lens;
  return {
    position,
    quaternion: quaternion.map(x => x / length),
    target: new Vector3(...target),
    lens: {width, height, fx, fy, cx, cy},
  };
}

export class Address {
  // viewer: with rig, switches, player and scene; goTo(options): shows what an address says
  constructor(viewer, goTo) {
    this.viewer = viewer;
    this.isNewPlace = false; // the view after the next rest is a place of its own
    addEventListener('popstate', () => {
      clearTimeout(this.timer);
      this.isNewPlace = false;
      goTo(new URLSearchParams(location.hash.slice(1)));
    });
  }

  get text() {
    const {rig, switches, player, isBare} = this.viewer,
      options = new URLSearchParams();
    if (rig.at !== null) {
      options.set('camera', rig.at);
    } else {
      const {width, height, fx, fy, cx, cy} = rig.lens;
      options.set('p', list(rig.position));
      options.set('q', list(rig.quaternion));
      options.set('o', list(rig.target));
      options.set('lens', list([width, height, fx, fy, cx, cy]));
    }
    if (player && !player.isPlaying) options.set('t', Number(player.time.toPrecision(DIGITS)));
    for (const [name, text] of switches.changes) options.set(name, text);
    if (isBare) options.set('ui', '0');
    return options.toString().replaceAll('%2C', ',');
  }

  /// Called after each change of the view: the address follows when it rests.
  note() {
    if (!this.isOn) return;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.write(), REST);
  }

  /// Called before a jump: Back leads here again.
  leave() {
    if (!this.isOn) return;
    if (!this.viewer.rig.flight) this.write();
    this.isNewPlace = true;
  }

  write() {
    clearTimeout(this.timer);
    if (this.viewer.rig.flight) return this.note();
    const hash = `#${this.text}`,
      isSame = hash === location.hash;
    if (!isSame) history[this.isNewPlace ? 'pushState' : 'replaceState'](null, '', hash);
    this.isNewPlace = false;
  }
}
