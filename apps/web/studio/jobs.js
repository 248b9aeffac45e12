// SPDX-License-Identifier: Apache-2.0
// A job as a card: how far it is, what it said, its command, and buttons to stop it or to go on.
import {el} from '../shared/dom.js';
import {duration, whole} from '../shared/format.js';
import {copyButton, quoted} from '../view/tools/clipboard.js';

const WORDS = {
  waiting: 'waits',
  running: 'runs',
  done: 'done',
  failed: 'failed',
  stopped: 'stopped',
  interrupted: 'interrupted',
};
export const isActive = job => job.state === 'running' || job.state === 'waiting';

export const button = (text, onclick, kind = '') =>
  el(`button.button${kind && `.${kind}`}`, {type: 'button', onclick}, text);

export const nameOf = file => file.split('/').pop();

/// Saves a file of the project.
export const saveLink = (app, file, kind = 'a') =>
  el(kind, {href: app.server.file(file), download: nameOf(file)}, 'Save');

/// The command as a person types it in the project's folder.
export const commandOf = words => `gemsplat ${words.map(quoted).join(' ')}`;

export function commandLine(folder, words) {
  const text = `cd ${quoted(folder)}\n${commandOf(words)}`;
  return el(
    'details.command-line',
    {},
    el('summary', {}, 'Command'),
    el('pre', {tabindex: '0'}, text),
    copyButton('Copy', () => text),
  );
}

const secondsOf = job => (job.ended || Date.now() / 1000) - job.began;

export class JobCard {
  // app: the page; title: what the job does; show(outcome): an element for what it found or made
  constructor(app, job, title, show) {
    Object.assign(this, {app, id: job.id, title, show});
    this.bar = el('progress', {max: 1, 'aria-label': `progress of ${title}`});
    this.state = el('span.badge');
    this.text = el('p.said', {'aria-live': 'polite'});
    this.more = el('div.job-more');
    this.buttons = el('div.buttons');
    this.node = el(
      'section.card.job',
      {'aria-label': title},
      el('div.job-head', {}, el('h3', {}, title), this.state),
      this.bar,
      this.text,
      this.more,
      this.buttons,
      commandLine(app.details.folder, job.words),
    );
    this.update(job);
    if (!isActive(job)) this.showWhatItSaid();
  }

  update(job) {
    this.node.dataset.state = job.state;
    this.state.textContent = WORDS[job.state];
    const {progress} = job,
      isRunning = job.state === 'running';
    this.bar.hidden = !isRunning;
    if (isRunning && progress?.total) this.bar.value = progress.done / progress.total;
    else this.bar.removeAttribute('value');
    this.text.textContent = isRunning ? this.progressText(job) : this.endText(job);
    if (isRunning && progress?.unit !== this.unit) {
      this.unit = progress?.unit;
      this.showWhatItSaid(); // such as a forecast that memory is too small
    }
    if (this.shown === job.state) return;
    this.shown = job.state;
    this.buttons.replaceChildren(
      isActive(job) ? button('Stop', () => this.app.act(server => server.stop(this.id))) : '',
      ['interrupted', 'stopped', 'failed'].includes(job.state) &&
        !(job.words[0] === 'doctor' && job.state === 'failed')
        ? button(
            job.state === 'failed' ? 'Try again' : 'Go on',
            () => this.app.act(server => server.goOn(this.id)),
            'primary',
          )
        : '',
    );
  }

  progressText({progress, note, began}) {
    if (!progress) return note || 'begins';
    const {part, unit, done, total, seconds_left: left} = progress;
    const rest = left > 0 ? `, ${duration(left)} left` : '';
    return `${part ? `${part}: ` : ''}${whole(done)} of ${whole(total)} ${unit}s${rest} (${duration(Date.now() / 1000 - began)})${this.sharingText()}`;
  }
  // Jobs of other projects run at the same time, on the same processors and in the same memory.
  sharingText() {
    const others = this.app.state.projects
      .filter(({id, jobs}) => id !== this.app.id && jobs.some(({state}) => state === 'running'))
      .map(({name}) => name);
    return others.length ? `; it shares this machine with ${others.join(', ')}` : '';
  }
  endText(job) {
    if (job.state === 'waiting')
      return 'It begins when the job before it in this project has ended.';
    if (job.state === 'done') return `It took ${duration(Math.max(0, secondsOf(job)))}.`;
    if (job.words[0] === 'doctor' && job.state === 'failed')
      return 'Training cannot start with these yet; what is marked red says why.';
    return (
      job.message ||
      (job.state === 'interrupted' ? 'The studio ended while it ran. Nothing is lost.' : '')
    );
  }

  async showWhatItSaid() {
    const {warnings, outcome} = await this.app.server.said(this.id).catch(() => ({}));
    const shown = outcome && this.show?.(outcome);
    this.more.replaceChildren(
      warnings?.length
        ? el(
            'ul.warnings',
            {},
            warnings.map(text => el('li', {}, text)),
          )
        : '',
      shown || '',
    );
  }
}

/// The cards of the jobs with these verbs, the newest first; the older ones are folded.
export function jobList(app, verbs, title, show) {
  const jobs = app.project.jobs.filter(job => verbs.includes(job.words[0])).reverse();
  const cards = jobs.slice(0, 12).map(job => new JobCard(app, job, title(job), show));
  const [first, ...older] = cards;
  const node = el(
    'div.jobs',
    {},
    first?.node,
    older.length > 0 &&
      el(
        'details',
        {},
        el('summary', {}, `${older.length} older`),
        older.map(({node}) => node),
      ),
  );
  const update = () => {
    for (const card of cards) {
      const job = app.project.jobs.find(({id}) => id === card.id);
      if (job) card.update(job);
    }
  };
  return {node, update, newest: jobs[0]};
}
