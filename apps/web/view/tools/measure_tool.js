// SPDX-License-Identifier: Apache-2.0
// The tool "Measure": the distance between two points of the surface that is seen.
import {el} from '../../shared/dom.js';
import {significant} from '../../shared/format.js';

const LINE = {class: 'measure-line'},
  DOT = {class: 'measure-dot'};

export class MeasureTool {
  title = 'Measure';
  picks = true; // clicks into the picture are for this tool while it is open

  constructor(viewer) {
    this.viewer = viewer;
    this.points = [];
    this.words = el('p.said', {'aria-live': 'polite'});
    this.places = el('dl.facts');
    this.node = el(
      'div.tool',
      {},
      this.words,
      this.places,
      el(
        'div.row.buttons',
        {},
        el('button.button', {type: 'button', onclick: () => this.clear()}, 'Clear'),
      ),
    );
    this.tell();
  }

  // "1.23 m", or in units where nobody knows how long a unit is.
  length(units) {
    const {meters_per_unit: meters} = this.viewer.scene;
    return meters ? `${significant(units * meters, 4)} m` : `${significant(units, 4)} units`;
  }

  pick(x, y) {
    const point = this.viewer.stage.surfaceAt(x, y);
    if (!point) {
      this.tell('There is nothing at this place.');
      return;
    }
    this.points = this.points.length === 1 ? [...this.points, point] : [point];
    this.tell();
  }
  clear() {
    this.points = [];
    this.tell();
  }

  tell(trouble) {
    const [a, b] = this.points;
    this.words.textContent =
      trouble ??
      (b
        ? `Distance: ${this.length(a.distanceTo(b))}`
        : a
          ? 'Choose the second point.'
          : 'Click two points of the picture.');
    const row = (name, value) => el('div', {}, el('dt', {}, name), el('dd', {}, value));
    const at = point => [point.x, point.y, point.z].map(value => significant(value, 4)).join(', ');
    this.places.replaceChildren(
      ...this.points.map((point, i) => row('AB'[i], at(point))),
      ...(b ? [row('B - A', at(b.clone().sub(a)))] : []),
    );
    this.viewer.stage.request();
  }

  draw(overlay) {
    const [a, b] = this.points;
    if (!a) return [];
    const line = b
      ? [...overlay.line(a, b, {class: 'measure-line under'}), ...overlay.line(a, b, LINE)]
      : [];
    const words = b
      ? overlay.words(a.clone().lerp(b, 0.5), this.length(a.distanceTo(b)), {
          class: 'measure-words',
        })
      : [];
    return [...line, ...this.points.flatMap(point => overlay.circle(point, 5, DOT)), ...words];
  }
}
