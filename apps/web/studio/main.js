// SPDX-License-Identifier: Apache-2.0
// Entry point of the studio: which screen is shown, and what the studio says of its jobs. The page
// keeps nothing: it can be closed at any time.
import {el} from '../shared/dom.js';
import {showClean} from './clean.js';
import {showFilm} from './film.js';
import {isActive} from './jobs.js';
import {showCameras, showPhotos} from './photos.js';
import {ProjectServer, askForState} from './server.js';
import {showShare} from './share.js';
import {showStart} from './start.js';
import {showTrain} from './train.js';

const EVERY = {busy: 500, idle: 2000}; // milliseconds between questions
const SAID_FOR = 9000; // milliseconds

const STEPS = {
  photos: ['Photos', showPhotos],
  cameras: ['Cameras', showCameras],
  train: ['Train', showTrain],
  clean: ['Clean', showClean],
  film: ['Film', showFilm],
  share: ['Share', showShare],
};

class App {
  constructor(root) {
    this.root = root;
    this.memories = {}; // what was chosen on the screens of a project, by its identity
    this.trouble = el('div.trouble', {role: 'alert', hidden: true});
    this.head = el('header.top');
    this.holder = el('div.holder');
    root.replaceChildren(this.head, this.trouble, this.holder);
    this.fail = error => this.say(error.message);
    addEventListener('hashchange', () => this.show());
    addEventListener('keydown', event => this.keys?.(event));
    addEventListener('unhandledrejection', event => {
      event.preventDefault();
      this.fail(event.reason);
    });
    addEventListener('beforeunload', event => this.uploading && event.preventDefault());
    // What is replaced between a press and its release gets no click.
    this.released = Promise.resolve();
    const press = () => {
      this.released = new Promise(done => {
        for (const kind of ['pointerup', 'pointercancel'])
          addEventListener(kind, () => setTimeout(done), {capture: true, once: true});
      });
    };
    addEventListener('pointerdown', press, {capture: true});
    // A file that is dropped beside its place would replace the page.
    for (const kind of ['dragover', 'drop'])
      addEventListener(kind, event => event.preventDefault());
  }

  get id() {
    return this.route.get('p');
  }
  get step() {
    const step = this.route.get('s');
    return STEPS[step] ? step : 'photos';
  }
  get project() {
    return (
      this.state.projects.find(({id}) => id === this.id) ?? {id: this.id, name: this.id, jobs: []}
    );
  }
  get memory() {
    return (this.memories[this.id] ??= {});
  }
  go(id, step) {
    const hash = `#p=${encodeURIComponent(id)}&s=${step}`;
    if (location.hash === hash) this.show();
    else location.hash = hash;
  }

  say(text) {
    clearTimeout(this.sayTimer);
    this.trouble.textContent = text;
    this.trouble.hidden = !text;
    if (text) this.sayTimer = setTimeout(() => this.say(''), SAID_FOR);
  }
  /// Does something with the project's server, and shows what has changed.
  async act(work) {
    try {
      await work(this.server);
      await this.poll();
      await this.reload();
    } catch (error) {
      this.fail(error);
    }
  }
  /// A version that a job makes is shown once it is there.
  showWhenDone(job, path) {
    this.expected = {id: this.id, job, path};
  }

  async poll() {
    const state = await askForState();
    // What goes on in other projects does not make a project's screen anew.
    const marks = ({projects}) =>
      projects
        .filter(({id}) => !this.id || id === this.id)
        .map(({id, name, jobs}) => id + name + jobs.map(({id, state}) => `${id}${state}`).join())
        .join();
    const hasChanged = this.state && marks(state) !== marks(this.state);
    this.state = state;
    return hasChanged;
  }
  async loop() {
    for (;;) {
      try {
        const hasChanged = await this.poll();
        await this.released;
        if (hasChanged || this.isStale) await this.reload();
        else this.screen?.update();
        this.isGone = false;
      } catch (error) {
        if (!this.isGone) this.say(error.message);
        this.isGone = true;
      }
      const isBusy = this.state?.projects.some(({jobs}) => jobs.some(isActive));
      await new Promise(done => setTimeout(done, isBusy ? EVERY.busy : EVERY.idle));
    }
  }

  async reload() {
    this.isStale = true;
    const {expected} = this;
    const made = expected?.id === this.id && this.project.jobs.find(({id}) => id === expected.job);
    if (made && !isActive(made)) {
      this.expected = null;
      if (made.state === 'done') await this.server.change({model: expected.path});
    }
    await this.show();
  }

  /// Shows the screen of the page's address. Where the studio does not answer, loop() tries again.
  async show() {
    const {hash} = location,
      turn = (this.turn = (this.turn ?? 0) + 1);
    this.route = new URLSearchParams(hash.slice(1));
    this.keys = null;
    this.isStale = true;
    let details = null;
    if (this.id) {
      this.server = new ProjectServer(this.id);
      try {
        details = await this.server.details();
      } catch (error) {
        this.fail(error);
        if (!error.isGone && turn === this.turn) location.hash = '';
        return;
      }
    }
    await this.released;
    if (turn !== this.turn) return; // another screen was chosen meanwhile
    this.details = details;
    this.showHead(details && this.step);
    const [title, screen] = details ? STEPS[this.step] : ['', showStart];
    document.title = details ? `${this.project.name} · ${title}` : 'gemsplat studio';
    this.put(screen(this), hash);
  }
  put(screen, hash) {
    this.head.querySelector('[aria-current]')?.scrollIntoView({block: 'nearest', inline: 'center'});
    const isSame = this.shown === hash,
      scroll = isSame ? scrollY : 0,
      entered = isSame ? this.entered() : () => {};
    this.shown = hash;
    this.isStale = false;
    this.screen = screen;
    const main = this.holder.firstChild;
    if (!screen.view) this.holder.replaceChildren(screen.node);
    else if (main?.matches('.with-viewer') && screen.view.node.parentNode === main)
      main.lastChild.replaceWith(screen.side);
    else this.holder.replaceChildren(el('main.with-viewer', {}, screen.view.node, screen.side));
    screen.update();
    entered();
    scrollTo(0, scroll);
  }
  // What was entered on the screen and what has the focus; the result puts it into a new one.
  entered() {
    const fields = [...this.holder.querySelectorAll('input[id], select[id]')].map(field => [
        field.id,
        field.value,
        field.checked,
      ]),
      {id, textContent: words, tagName: tag} = document.activeElement;
    return () => {
      for (const [name, value, checked] of fields) {
        const field = document.getElementById(name);
        if (field) Object.assign(field, {value, checked});
      }
      const again = id
        ? document.getElementById(id)
        : [...document.getElementsByTagName(tag)].find(node => node.textContent === words);
      if (tag !== 'BODY') again?.focus({preventScroll: true});
    };
  }

  isDone(step) {
    const {details} = this;
    if (step === 'photos') return details.pictures.length + details.videos.length > 0;
    if (step === 'cameras') return details.scene !== null;
    if (step === 'train') return details.models.length > 0;
    const verb = {clean: 'edit', film: 'render', share: 'export'}[step];
    return this.project.jobs.some(({words, state}) => words[0] === verb && state === 'done');
  }
  showHead(current) {
    const link = ([step, [title]]) =>
      el(
        'a.step',
        {
          href: `#p=${encodeURIComponent(this.id)}&s=${step}`,
          'aria-current': step === current ? 'step' : null,
          'data-done': this.isDone(step) ? '' : null,
        },
        title,
      );
    this.head.replaceChildren(
      el(
        'a.home',
        {href: '#', title: 'all projects'},
        el('span.mark', {'aria-hidden': 'true'}),
        el('b', {}, 'gemsplat studio'),
      ),
      ...(current
        ? [
            el('span.project-name', {}, this.project.name),
            el('nav.steps', {'aria-label': 'steps'}, Object.entries(STEPS).map(link)),
          ]
        : []),
    );
  }
}

const app = new App(document.getElementById('app'));
window.gemsplatStudio = app; // for tests
app
  .poll()
  .then(() => app.show())
  .catch(app.fail)
  .then(() => app.loop());
