// SPDX-License-Identifier: Apache-2.0
// The list of cameras with its filter, and the bar at the bottom that steps through them.
import {el, segmented} from '../../shared/dom.js';
import {iconButton} from './parts.js';

const SPLIT_WORDS = {train: 'training', test: 'test'};

export const splitBadge = split =>
  SPLIT_WORDS[split] ? el(`span.badge.${split}`, {}, SPLIT_WORDS[split]) : null;

export class CameraList {
  // go(index): called for a click; mark(index), or mark(null): called when the pointer enters or
  // leaves an entry
  constructor(cameras, {go, mark}) {
    this.cameras = cameras;
    this.go = go;
    this.split = 'all';
    this.entries = cameras.map((camera, index) =>
      el(
        'button.entry',
        {
          type: 'button',
          onclick: () => go(index),
          onpointerenter: () => mark(index),
          onpointerleave: () => mark(null),
        },
        el(`i.dot${camera.split ? `.${camera.split}` : ''}`),
        el('span.entry-name', {}, camera.name),
      ),
    );
    this.filter = el('input.filter', {
      type: 'search',
      placeholder: 'Filter by name',
      'aria-label': 'filter cameras by name',
      oninput: () => this.sift(),
    });
    this.count = el('p.count.muted', {'aria-live': 'polite'});
    const kinds = new Set(cameras.map(camera => camera.split));
    const choice =
      kinds.has('test') &&
      kinds.has('train') &&
      segmented(
        'which cameras',
        [
          ['all', 'All'],
          ['train', 'Training'],
          ['test', 'Test'],
        ],
        'all',
        split => {
          this.split = split;
          this.sift();
        },
      );
    this.node = el(
      'div.camera-list',
      {},
      el('div.sieve', {}, this.filter, choice),
      this.count,
      el('div.entries', {}, this.entries),
    );
    this.sift();
  }

  get shown() {
    const words = this.filter.value.trim().toLowerCase();
    return this.cameras
      .map((camera, index) => ({camera, index}))
      .filter(
        ({camera}) =>
          camera.name.toLowerCase().includes(words) &&
          (this.split === 'all' || camera.split === this.split),
      )
      .map(({index}) => index);
  }

  sift() {
    const shown = new Set(this.shown);
    this.entries.forEach((entry, i) => {
      entry.hidden = !shown.has(i);
    });
    this.count.textContent =
      shown.size === this.cameras.length
        ? `${shown.size} cameras`
        : `${shown.size} of ${this.cameras.length} cameras`;
  }

  // The index of the camera `by` places further among those that pass the filter; null if none
  // does.
  neighbor(index, by) {
    const shown = this.shown;
    if (!shown.length) return null;
    const at = shown.indexOf(index);
    if (at < 0) return shown[by > 0 ? 0 : shown.length - 1];
    return shown[(at + by + shown.length) % shown.length];
  }

  select(index) {
    if (index === this.selected) return;
    this.entries[this.selected]?.removeAttribute('aria-current');
    this.selected = index;
    const entry = this.entries[index];
    if (!entry) return;
    entry.setAttribute('aria-current', 'true');
    const list = entry.parentElement;
    if (
      list.clientHeight &&
      (entry.offsetTop < list.scrollTop ||
        entry.offsetTop + entry.offsetHeight > list.scrollTop + list.clientHeight)
    )
      list.scrollTop = entry.offsetTop - list.clientHeight / 2;
  }
}

/// The bar at the bottom: the name of the view's camera, with buttons to the previous and the next
/// one.
export function cameraBar(cameras, {step, nearest}, compareControls) {
  const name = el('button.bar-name', {
    type: 'button',
    title: 'go to the nearest camera (N)',
    onclick: nearest,
  });
  const node = el(
    'div.camera-bar',
    {hidden: cameras.length === 0},
    el(
      'div.bar-turn',
      {},
      iconButton('previous', 'previous camera (left arrow)', () => step(-1)),
      name,
      iconButton('next', 'next camera (right arrow)', () => step(1)),
    ),
    compareControls,
  );
  const show = index => {
    const camera = cameras[index];
    node.classList.toggle('is-free', !camera);
    name.replaceChildren(
      ...(camera
        ? [el('span.bar-text', {}, camera.name), splitBadge(camera.split) ?? '']
        : [el('span.bar-text.muted', {}, 'free view')]),
    );
  };
  show(null);
  return {node, show};
}
