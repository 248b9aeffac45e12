// SPDX-License-Identifier: Apache-2.0
// Comparison with a photo: while the view is a camera's, its photo can lie over the picture, beside
// it with a slider, or blended.
import {el, segmented} from '../../shared/dom.js';

export const COMPARISONS = [
  ['render', 'Render'],
  ['split', 'Slider'],
  ['blend', 'Blend'],
  ['photo', 'Photo'],
];

export class Compare {
  // drawsLenses: whether pictures of cameras with a lens are seen through it
  constructor(drawsLenses) {
    this.drawsLenses = drawsLenses;
    this.mode = 'render';
    this.share = 0.5; // of the picture's width that shows the photo, from the left
    this.opacity = 0.5;
    this.camera = null;
    this.flipped = false;
    this.image = el('img.photo', {
      alt: '',
      draggable: 'false',
      onload: () => this.draw(),
      onerror: () => this.broken(),
    });
    this.handle = el('input.divider-range', {
      type: 'range',
      min: 0,
      max: 1000,
      value: 500,
      step: 10,
      'aria-label': 'border between photo and render',
      oninput: () => {
        this.share = this.handle.value / 1000;
        this.draw();
      },
    });
    this.divider = el('div.divider', {}, el('span.grip'), this.handle);
    this.tags = [el('span.tag.left', {}, 'photo'), el('span.tag.right', {}, 'render')];
    this.note = el('span.tag.note', {hidden: true});
    this.node = el('div.compare', {}, this.image, this.tags, this.note, this.divider);
    this.choice = segmented('comparison with the photo', COMPARISONS, this.mode, mode =>
      this.set(mode),
    );
    this.range = el('input.opacity', {
      type: 'range',
      min: 0,
      max: 100,
      value: 50,
      'aria-label': 'opacity of the photo',
      oninput: () => {
        this.opacity = this.range.value / 100;
        this.draw();
      },
    });
    this.controls = el('div.compare-controls', {}, this.choice, this.range);
    this.divider.addEventListener('pointerdown', event => {
      this.divider.setPointerCapture(event.pointerId);
      this.follow(event);
      event.preventDefault();
    });
    this.divider.addEventListener('pointermove', event => {
      if (this.divider.hasPointerCapture(event.pointerId)) this.follow(event);
    });
    this.draw();
  }

  follow(event) {
    const box = this.node.getBoundingClientRect();
    this.share = Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
    this.handle.focus({preventScroll: true});
    this.draw();
  }

  // camera: whose view this is, or null; place: of its picture in the window, {left, top, width,
  // height}
  show(camera, place) {
    if (camera !== this.camera) {
      this.camera = camera;
      this.isBroken = false;
      if (camera?.photo) this.image.src = camera.photo;
      else this.image.removeAttribute('src');
    }
    if (place)
      for (const side of ['left', 'top', 'width', 'height'])
        this.node.style[side] = `${place[side]}px`;
    this.draw();
  }

  broken() {
    if (!this.camera?.photo) return;
    this.isBroken = true;
    this.draw();
  }

  set(mode) {
    this.mode = mode;
    this.choice.press(mode);
    this.draw();
  }
  next() {
    this.set(
      COMPARISONS[
        (COMPARISONS.findIndex(([mode]) => mode === this.mode) + 1) % COMPARISONS.length
      ][0],
    );
  }
  flip(on) {
    this.flipped = on;
    this.draw();
  }

  draw() {
    const hasPhoto = Boolean(this.camera?.photo),
      mode = this.flipped ? 'photo' : this.mode,
      shows = hasPhoto && mode !== 'render';
    this.node.hidden = !shows;
    this.controls.hidden = !hasPhoto;
    this.range.hidden = mode !== 'blend';
    const splits = mode === 'split' && !this.isBroken;
    this.divider.hidden = !splits;
    for (const tag of this.tags) tag.hidden = !splits;
    this.image.hidden = Boolean(this.isBroken);
    this.image.style.opacity = mode === 'blend' ? this.opacity : 1;
    this.image.style.clipPath = splits ? `inset(0 ${100 * (1 - this.share)}% 0 0)` : 'none';
    this.divider.style.left = `${100 * this.share}%`;
    this.handle.value = Math.round(1000 * this.share);
    const differs = this.camera?.has_lens && !this.drawsLenses;
    this.note.hidden = !(shows && (this.isBroken || !this.image.complete || differs));
    this.note.textContent = this.isBroken
      ? 'the photo cannot be shown'
      : this.image.complete
        ? 'the photo has a lens, the picture none: gemsplat view --remote draws both alike'
        : 'loading the photo';
  }
}
