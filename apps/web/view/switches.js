// SPDX-License-Identifier: Apache-2.0
// The switches of the view: what the settings panel and keys change, and what the address holds.

const GROUNDS = {black: [0, 0, 0], gray: [0.5, 0.5, 0.5], white: [1, 1, 1]};
export const GROUND_NAMES = ['scene', ...Object.keys(GROUNDS)];
// Of the size of splats, and of points in CSS pixels: 0 shows splats.
export const SPLAT_SCALES = {min: 0.05, max: 2},
  POINT_SIZES = {min: 0, max: 8};

const within = ({min, max}, text) => {
  const value = Number(text);
  return text !== '' && value >= min && value <= max ? value : null;
};
const oneOf = words => text => (words.includes(text) ? text : null);

/// Each switch: its first value, read(text) -> value or null, apply(viewer, value).
const tableFor = ({scene, stage}) => ({
  show: {
    first: 'color',
    read: oneOf(['color', 'depth', 'normal']),
    apply: ({stage}, mode) => stage.show(mode),
  },
  colors: {
    first: 'neutral',
    read: oneOf(['neutral', 'photo']),
    apply: (viewer, colors) => viewer.showColors(colors),
  },
  scale: {
    first: 1,
    read: text => within(SPLAT_SCALES, text),
    apply: ({stage}, scale) => stage.splats?.setEffect('splatScale', scale),
  },
  points: {
    first: 0,
    read: text => within(POINT_SIZES, text),
    apply: ({stage}, size) => stage.splats?.setPoints(size),
  },
  background: {
    first: 'scene',
    read: oneOf(GROUND_NAMES),
    apply: ({stage, scene}, name) => stage.splats?.setBackground(GROUNDS[name] ?? scene.background),
  },
  sh: {
    first: scene.model?.sh_degree ?? 3,
    read: text => within({min: 0, max: scene.model?.sh_degree ?? 3}, text),
    apply: ({stage}, degree) => stage.splats?.setShDegree(degree),
  },
  mesh: {
    first: 0, // the share of the picture that shows it
    read: text => (scene.mesh && !stage.isRemote ? within({min: 0, max: 1}, text) : null),
    apply: (viewer, share) => viewer.showMesh(share),
  },
  meshlook: {
    first: 'color',
    read: oneOf(['color', 'shaded', 'wires']),
    apply: ({stage}, look) => stage.mesh?.setLook(look),
  },
  frusta: {
    first: false,
    read: text => ({1: true, 0: false})[text] ?? null,
    apply: ({stage}, on) => stage.showFrusta(on),
  },
  navigation: {
    first: 'orbit',
    read: oneOf(['orbit', 'fly']),
    apply: ({controls}, mode) => {
      controls.mode = mode;
    },
  },
  up: {
    first: 'up',
    read: oneOf(['up', 'down']),
    apply: ({rig}, way) =>
      rig.up
        .set(...scene.up)
        .normalize()
        .multiplyScalar(way === 'up' ? 1 : -1),
  },
});

export class Switches {
  // changed(): called after each change
  constructor(viewer, changed) {
    this.viewer = viewer;
    this.changed = changed;
    this.table = tableFor(viewer);
    this.values = Object.fromEntries(
      Object.entries(this.table).map(([name, {first}]) => [name, first]),
    );
  }

  get(name) {
    return this.values[name];
  }

  set(name, value) {
    if (this.values[name] === value) return;
    this.values[name] = value;
    this.table[name].apply(this.viewer, value);
    this.changed();
  }

  /// Those that are not at their first value, as [name, text].
  get changes() {
    return Object.entries(this.values)
      .filter(([name, value]) => value !== this.table[name].first)
      .map(([name, value]) => [
        name,
        typeof value === 'boolean' ? String(Number(value)) : String(value),
      ]);
  }

  /// Sets all of them to what an address says; what it does not say gets its first value.
  read(options) {
    for (const [name, {first, read}] of Object.entries(this.table))
      this.set(name, read(options.get(name) ?? '') ?? first);
  }
}
