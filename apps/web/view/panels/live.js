// SPDX-License-Identifier: Apache-2.0
// The panel of a run that trains: polls the server for its progress, shows it, and reports when
// there is a newer model.
import uPlot from 'uplot';
import {cssColor, el} from '../../shared/dom.js';
import {duration, fixed, isNumber, short, significant, whole} from '../../shared/format.js';
import {factList} from './parts.js';
import {RunButtons} from './run_buttons.js';
import {askForState} from '../server.js';

const EVERY = 1000; // milliseconds between polls while the page is visible
const MOST_POINTS = 400; // of the chart: beyond that, every second one is dropped
const CHART_HEIGHT = 120; // CSS pixels

export class Live {
  // snapshot(state): shows the newer model, and resolves to whether that worked; failed(error), or
  // failed(null) after a poll that worked; token: of those who control the run, or null
  constructor({snapshot, failed, token}) {
    Object.assign(this, {snapshot, failed});
    this.buttons = new RunButtons(token, {failed, asked: () => this.poll()});
    this.version = 0;
    this.points = [[], []]; // steps and losses, as in metrics.csv
    this.lastStep = 0; // of the last loss that the server has sent
    this.facts = factList(['Step', 'Loss', 'PSNR', 'Gaussians', 'Time', 'Left', 'Snapshot']);
    this.bar = el('progress', {max: 1, value: 0, 'aria-label': 'how far training is'});
    this.words = el('p.live-words', {'aria-live': 'polite'});
    this.holder = el('div.loss-chart', {role: 'img', 'aria-label': 'loss over steps'});
    this.node = el(
      'div.training-body',
      {},
      this.words,
      this.bar,
      this.facts.node,
      this.buttons.node,
      this.holder,
    );
    new ResizeObserver(() => this.drawChart(true)).observe(this.holder);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () =>
      this.drawChart(true),
    );
  }

  start() {
    document.addEventListener('visibilitychange', () => {
      if (!document.hidden) this.poll();
    });
    this.poll();
  }

  async poll() {
    clearTimeout(this.timer);
    if (document.hidden || this.isDone) return;
    try {
      this.take(await askForState(this.lastStep));
      this.failed(null);
    } catch (error) {
      if (this.buttons.isStopping) return this.endStopped();
      this.failed(error);
    }
    this.timer = setTimeout(() => this.poll(), EVERY);
  }

  // The server ends with a run that was stopped.
  endStopped() {
    this.isDone = true;
    this.buttons.node.hidden = true;
    this.words.hidden = false;
    this.words.textContent =
      'The run was stopped, and its model is saved. gemsplat train --resume goes on with it.';
    this.failed(null);
  }

  take(state) {
    this.show(state);
    if (state.step < this.lastStep) this.goBackTo(state.step);
    this.add(state.losses ?? []);
    if (state.version > this.version && !this.isLoading) this.fetch(state);
    this.isDone = state.done && this.version >= state.version;
  }

  async fetch(state) {
    this.isLoading = true;
    if (await this.snapshot(state)) this.version = state.version;
    this.isLoading = false;
  }

  show({
    step,
    steps,
    loss,
    gaussians,
    psnr,
    seconds,
    done,
    stopped,
    message,
    version,
    control = null,
  }) {
    this.bar.value = steps ? step / steps : 0;
    const left = step > 0 && !done ? (seconds / step) * (steps - step) : null;
    this.facts.set('Step', `${whole(step)} of ${whole(steps)}`);
    this.facts.set('Loss', isNumber(loss) ? significant(loss, 4) : null);
    this.facts.set('PSNR', isNumber(psnr) ? `${fixed(psnr, 2)} dB` : null);
    this.facts.set('Gaussians', whole(gaussians));
    this.facts.set('Time', duration(seconds));
    this.facts.set('Left', left === null ? null : duration(left));
    const isPaused = Boolean(control?.paused) && !done && !stopped;
    this.buttons.show(control, done || stopped);
    this.words.hidden = version > 0 && !done && !stopped && !message && !isPaused;
    this.facts.set('Snapshot', version ? String(version) : null);
    this.words.textContent =
      message ||
      (stopped
        ? 'Training was stopped.'
        : done
          ? 'Training is done.'
          : isPaused
            ? 'Paused.'
            : version
              ? ''
              : 'The first model is on its way.');
  }

  // losses: [[step, loss], ...] of the steps after lastStep.
  add(losses) {
    if (!losses.length) return;
    for (const [step, loss] of losses) {
      this.lastStep = step;
      if (!isNumber(loss)) continue;
      this.points[0].push(step);
      this.points[1].push(loss);
    }
    while (this.points[0].length > MOST_POINTS)
      this.points = this.points.map(list => list.filter((_, i) => i % 2 === 0));
    this.drawChart(false);
  }

  // The run went back to an earlier step: what came after it did not happen.
  goBackTo(step) {
    const count = this.points[0].filter(each => each <= step).length;
    this.points = this.points.map(list => list.slice(0, count));
    this.lastStep = step;
    this.drawChart(false);
  }

  drawChart(anew) {
    const width = this.holder.clientWidth;
    if (!width || this.points[0].length < 2) return;
    if (this.plot && !anew) return this.plot.setData(this.points);
    this.plot?.destroy();
    const axis = {
      stroke: cssColor('--muted'),
      grid: {stroke: cssColor('--grid'), width: 1},
      ticks: {show: false},
      font: '11px system-ui, sans-serif',
    };
    this.plot = new uPlot(
      {
        width,
        height: CHART_HEIGHT,
        padding: [6, 14, 0, 0],
        legend: {show: false},
        cursor: {show: false},
        scales: {x: {time: false}},
        axes: [
          {...axis, size: 20, space: 60, values: (_, ticks) => ticks.map(short)},
          {
            ...axis,
            size: 42,
            space: 28,
            values: (_, ticks) => ticks.map(value => significant(value, 2)),
          },
        ],
        series: [
          {},
          {
            stroke: cssColor('--accent'),
            width: 1.5,
            points: {show: this.points[0].length < 30, size: 4},
          },
        ],
      },
      this.points,
      this.holder,
    );
  }
}
