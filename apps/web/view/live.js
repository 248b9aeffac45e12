// SPDX-License-Identifier: Apache-2.0
// A run while it trains: asks how far it is, shows that, and tells when there is a newer model.
import uPlot from 'uplot';
import {cssColor, el} from '../shared/dom.js';
import {duration, fixed, isNumber, short, significant, whole} from '../shared/format.js';
import {figureList} from './parts.js';
import {askForState} from './server.js';

const EVERY = 1000;          // milliseconds between questions while the page is seen
const MOST_POINTS = 400;     // of the chart; beyond, every second one goes
const CHART_HEIGHT = 120;    // CSS pixels

export class Live {
  // snapshot(state): shows a model that was not there before, resolves to whether it could; failed(error or null)
  constructor({snapshot, failed}) {
    Object.assign(this, {snapshot, failed});
    this.version = 0;
    this.points = [[], []];
    this.figures = figureList(['Step', 'Loss', 'PSNR', 'Gaussians', 'Time', 'Left', 'Snapshot']);
    this.bar = el('progress', {max: 1, value: 0, 'aria-label': 'how far training is'});
    this.words = el('p.live-words', {'aria-live': 'polite'});
    this.holder = el('div.loss-chart', {role: 'img', 'aria-label': 'loss over steps'});
    this.node = el('div.training-body', {}, this.words, this.bar, this.figures.node, this.holder);
    new ResizeObserver(() => this.drawChart(true)).observe(this.holder);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.drawChart(true));
  }

  start() {
    document.addEventListener('visibilitychange', () => { if (!document.hidden) this.ask(); });
    this.ask();
  }

  async ask() {
    clearTimeout(this.timer);
    if (document.hidden || this.isDone) return;
    try {
      this.take(await askForState());
      this.failed(null);
    } catch (error) {
      this.failed(error);
    }
    this.timer = setTimeout(() => this.ask(), EVERY);
  }

  take(state) {
    this.show(state);
    if (isNumber(state.loss) && state.step > (this.points[0].at(-1) ?? -1)) this.add(state.step, state.loss);
    if (state.version > this.version && !this.isLoading) this.fetch(state);
    this.isDone = state.done && this.version >= state.version;
  }

  async fetch(state) {
    this.isLoading = true;
    if (await this.snapshot(state)) this.version = state.version;
    this.isLoading = false;
  }

  show({step, steps, loss, gaussians, psnr, seconds, done, stopped, message, version}) {
    this.bar.value = steps ? step / steps : 0;
    const left = step > 0 && !done ? seconds / step * (steps - step) : null;
    this.figures.set('Step', `${whole(step)} of ${whole(steps)}`);
    this.figures.set('Loss', isNumber(loss) ? significant(loss, 4) : null);
    this.figures.set('PSNR', isNumber(psnr) ? `${fixed(psnr, 2)} dB` : null);
    this.figures.set('Gaussians', whole(gaussians));
    this.figures.set('Time', duration(seconds));
    this.figures.set('Left', left === null ? null : duration(left));
    this.words.hidden = version > 0 && !done && !stopped && !message;
    this.figures.set('Snapshot', version ? String(version) : null);
    this.words.textContent = message || (stopped ? 'Training was stopped.' : done ? 'Training is done.' : version ? '' : 'The first model is on its way.');
  }

  add(step, loss) {
    this.points[0].push(step);
    this.points[1].push(loss);
    if (this.points[0].length > MOST_POINTS) this.points = this.points.map(list => list.filter((_, i) => i % 2 === 0));
    this.drawChart(false);
  }

  drawChart(anew) {
    const width = this.holder.clientWidth;
    if (!width || this.points[0].length < 2) return;
    if (this.plot && !anew) return this.plot.setData(this.points);
    this.plot?.destroy();
    const axis = {stroke: cssColor('--muted'), grid: {stroke: cssColor('--grid'), width: 1}, ticks: {show: false}, font: '11px system-ui, sans-serif'};
    this.plot = new uPlot({
      width, height: CHART_HEIGHT, padding: [6, 14, 0, 0], legend: {show: false}, cursor: {show: false},
      scales: {x: {time: false}},
      axes: [{...axis, size: 20, space: 60, values: (_, ticks) => ticks.map(short)},
             {...axis, size: 42, space: 28, values: (_, ticks) => ticks.map(value => significant(value, 2))}],
      series: [{}, {stroke: cssColor('--accent'), width: 1.5, points: {show: this.points[0].length < 30, size: 4}}],
    }, this.points, this.holder);
  }
}
