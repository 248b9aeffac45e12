// SPDX-License-Identifier: Apache-2.0
// The tool "Crop": a box or a sphere with handles, what would remain of the model, and the command
// that does it. The page changes no file.
import {Vector3} from 'three';
import {el, segmented} from '../../shared/dom.js';
import {whole} from '../../shared/format.js';
import {row, toggleSwitch} from '../panels/parts.js';
import {copyButton, quoted} from './clipboard.js';
import {Region} from './crop_region.js';

const COUNT_AFTER = 250; // milliseconds without a change
const FIRST_SIZE = 0.5; // of the scene's radius: half a side of the first box
const REACH = 9; // CSS pixels: radius of a handle

export class CropTool {
  title = 'Crop';

  constructor(viewer) {
    this.viewer = viewer;
    this.region = new Region(
      viewer.center,
      FIRST_SIZE * viewer.scene.radius,
      viewer.scene.world_offset ?? [0, 0, 0],
      new Vector3(...viewer.scene.up),
    );
    this.hides = true;
    this.fields = el('div.fields');
    this.counts = el('p.said', {'aria-live': 'polite'});
    this.command = el('code.command', {tabindex: '0'});
    const choose = (name, value) => {
      this.region[name] = value;
      this.changed();
    };
    const hide = toggleSwitch('hide the rest', true, on => {
      this.hides = on;
      this.changed();
    });
    this.node = el(
      'div.tool',
      {},
      row(
        'Shape',
        segmented(
          'shape',
          [
            ['box', 'Box'],
            ['sphere', 'Sphere'],
          ],
          'box',
          shape => choose('shape', shape),
        ),
      ),
      row(
        'Inside',
        segmented(
          'inside',
          [
            ['keep', 'Keep'],
            ['drop', 'Drop'],
          ],
          'keep',
          what => choose('drops', what === 'drop'),
        ),
      ),
      this.fields,
      row('Hide the rest', hide.button),
      this.counts,
      this.command,
      el(
        'div.row.buttons',
        {},
        copyButton('Copy the command', () => this.command.textContent),
        el('button.button', {type: 'button', onclick: () => this.fit()}, 'Around this view'),
      ),
    );
  }

  // The region where people look now.
  fit() {
    const {rig, scene} = this.viewer;
    this.region.fitTo(rig.target, Math.min(FIRST_SIZE * scene.radius, 0.4 * rig.distance));
    this.changed();
  }

  opened() {
    this.isOpen = true;
    this.changed();
  }
  closed() {
    this.isOpen = false;
    this.viewer.stage.splats.setEffect('cropKind', 0);
  }

  changed() {
    const {scene, stage} = this.viewer;
    if (this.isOpen && this.hides) this.region.apply(stage.splats);
    else stage.splats.setEffect('cropKind', 0);
    this.command.textContent = `gemsplat edit ${quoted(scene.path ?? scene.title)} ${this.region.operation} -o cropped.ply`;
    this.showFields();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.count(), COUNT_AFTER);
  }

  // Fields keep the focus while their shape stays.
  showFields() {
    const {fields} = this.region,
      labels = fields.map(([label]) => label).join();
    if (labels !== this.labels) {
      this.labels = labels;
      this.inputs = fields.map(([label], i) =>
        el('input', {
          type: 'number',
          step: 'any',
          'aria-label': label,
          onchange: event => this.enter(i, event.target.value),
        }),
      );
      this.fields.replaceChildren(
        ...fields.map(([label], i) => el('label', {}, label, this.inputs[i])),
      );
    }
    fields.forEach(([, value], i) => {
      if (document.activeElement !== this.inputs[i])
        this.inputs[i].value = Number(value.toPrecision(this.region.digitsOf(value)));
    });
  }
  enter(index, text) {
    const value = Number(text);
    if (text !== '' && Number.isFinite(value)) this.region.fields[index][2](value);
    this.changed();
  }

  count() {
    const counts = this.region.count(this.viewer.stage.splats);
    this.counts.textContent = counts
      ? `${whole(counts.kept)} of ${whole(counts.all)} Gaussians remain.`
      : 'gemsplat edit --dry-run counts what remains of a streamed model.';
  }

  draw(overlay) {
    if (!this.isOpen) return [];
    const {lines, handles} = this.region;
    return [
      ...lines.flatMap(([a, b]) => [
        ...overlay.line(a, b, {class: 'crop-line under'}),
        ...overlay.line(a, b, {class: 'crop-line'}),
      ]),
      ...handles.flatMap((handle, i) =>
        overlay
          .circle(handle.point, REACH, {class: 'handle', 'data-handle': i})
          .map(circle => this.live(circle, i, overlay)),
      ),
    ];
  }

  // Handles are made anew in each frame, so that a drag listens to the window.
  live(circle, index, overlay) {
    circle.addEventListener('pointerdown', event => {
      event.preventDefault();
      let last = {x: event.clientX, y: event.clientY};
      const move = now => {
        if (now.pointerId !== event.pointerId) return;
        this.drag(this.region.handles[index], now.clientX - last.x, now.clientY - last.y, overlay);
        last = {x: now.clientX, y: now.clientY};
      };
      const end = now => {
        if (now.pointerId !== event.pointerId) return;
        removeEventListener('pointermove', move);
        removeEventListener('pointerup', end);
        removeEventListener('pointercancel', end);
      };
      addEventListener('pointermove', move);
      addEventListener('pointerup', end);
      addEventListener('pointercancel', end);
    });
    return circle;
  }

  // Moves a handle along its axis so that it follows the pointer.
  drag({point, axis, drag}, dx, dy, overlay) {
    const small = 0.01 * this.viewer.scene.radius,
      from = overlay.place(point),
      to = overlay.place(point.clone().addScaledVector(axis, small));
    if (!from || !to) return;
    const ex = (to.x - from.x) / small,
      ey = (to.y - from.y) / small,
      square = ex * ex + ey * ey;
    if (square > 0) drag((dx * ex + dy * ey) / square);
    this.changed();
  }
}
