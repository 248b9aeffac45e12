// SPDX-License-Identifier: Apache-2.0
// The screen "Train": presets with what they take, a form of all settings, the run while it goes on,
// and its figures.
import {el} from '../shared/dom.js';
import {fixed, whole} from '../shared/format.js';
import {modelAt, viewFrame, viewOfModel} from './frame.js';
import {button, isActive, jobList} from './jobs.js';

// Name, title, for whom; the first one on a machine without a GPU comes last in this list.
const PRESETS = [
  ['', 'Good', 'What most photos need.'],
  ['turbo', 'In a hurry', 'Half the Gaussians, 3,000 to 4,000 steps.'],
  ['best', 'Best picture', 'Also learns how photos differ in light.'],
  ['low_memory', 'Little memory', 'Few Gaussians, few photos held at a time.'],
  ['cpu_tiny', 'Small', 'Some minutes on a machine without a GPU.'],
];

// Settings are floats: 0.05000000074505806 was written as 0.05.
const shownValue = value =>
  typeof value === 'number' && !Number.isInteger(value)
    ? String(Number(value.toPrecision(7)))
    : String(value ?? '');

// A field of the form. typed: the values of the user where they are not the preset's, by key.
function settingField(key, {value, meaning, unit, words}, typed, changed) {
  const id = `setting-${key}`,
    title = [meaning, unit && `in ${unit}`].filter(Boolean).join('; '),
    all = words?.split(', ') ?? [],
    choices = all.includes(value) && !words.includes(':N') ? all : null;
  const isSwitch = typeof value === 'boolean',
    usual = shownValue(value),
    text = typed[key] ?? usual;
  const field = choices
    ? el(
        'select',
        {id, title},
        choices.map(word => el('option', {value: word, selected: word === text}, word)),
      )
    : el('input', {
        id,
        title,
        type: isSwitch ? 'checkbox' : 'text',
        checked: isSwitch && text === 'true',
        value: isSwitch ? null : text,
        spellcheck: 'false',
      });
  field.addEventListener('input', () => {
    const now = isSwitch ? String(field.checked) : field.value.trim();
    if (now === usual) delete typed[key];
    else typed[key] = now;
    changed();
  });
  const node = el(
    'div.setting',
    {},
    el('label', {for: id}, key.split('.')[1]),
    field,
    el('small', {}, title),
  );
  return {node, text: `${key} ${meaning}`.toLowerCase()};
}

// All settings of a preset, with a field to search them. What the user types outlives the form,
// which is made anew whenever a job of the project begins or ends; it holds for other presets, too.
function settingsForm(app) {
  const {memory} = app,
    typed = (memory.settings ??= {}),
    answers = (app.configs ??= {});
  const holder = el('div'),
    summary = el('summary'),
    search = el('input', {
      id: 'search-settings',
      type: 'search',
      placeholder: 'search settings',
      'aria-label': 'search settings',
      value: memory.search ?? '',
    });
  const node = el('details.settings', {open: memory.showsSettings}, summary, search, holder);
  let fields = [],
    shown = null;
  const count = () => {
    const {length} = Object.keys(typed);
    summary.textContent = `All settings${length ? `, ${length} changed` : ''}`;
  };
  const filter = () => {
    const wanted = search.value.trim().toLowerCase();
    for (const field of fields) field.node.hidden = !field.text.includes(wanted);
  };
  const fill = json => {
    fields = Object.entries(json)
      .filter(([section]) => section !== 'reconstruct')
      .flatMap(([section, settings]) =>
        Object.entries(settings).map(([name, setting]) =>
          settingField(`${section}.${name}`, setting, typed, count),
        ),
      );
    holder.replaceChildren(...fields.map(field => field.node));
    filter();
  };
  const load = async () => {
    const preset = memory.preset ?? '';
    if (!node.open || shown === preset) return;
    answers[preset] ??= await app.server.question(['config', ...(preset ? ['-c', preset] : [])]);
    if (preset !== (memory.preset ?? '')) return; // another one was chosen meanwhile
    shown = preset;
    fill(answers[preset]);
  };
  node.addEventListener('toggle', () => {
    memory.showsSettings = node.open;
    load().catch(app.fail);
  });
  search.addEventListener('input', () => {
    memory.search = search.value;
    filter();
  });
  count();
  load().catch(app.fail);
  return {
    node,
    load,
    words: () => Object.entries(typed).flatMap(([key, text]) => ['--set', `${key}=${text}`]),
  };
}

// "about 0.2 million Gaussians (at most ...); photos take ...; training on the CPU takes about 0.3 GiB
// of RAM (22 GiB are free); ..." without what stands in brackets, and without photos and disk.
const shortForecast = text =>
  text
    .replaceAll(/ \([^)]*\)/g, '')
    .split('; ')
    .filter(part => !/^(photos take|each saved)/.test(part))
    .join('; ');

// Presets as cards of which one is chosen; each says what doctor forecasts for it.
function presetCards(app, chosen, choose) {
  const cards = PRESETS.map(([name, title, words]) => {
    const forecast = el('small.forecast', {}, '…');
    const node = el(
      'button.card.preset',
      {type: 'button', 'data-preset': name, onclick: () => press(name)},
      el('b', {}, title),
      el('span', {}, words),
      forecast,
    );
    return {name, node, forecast};
  });
  const mark = name => {
    for (const card of cards) card.node.setAttribute('aria-pressed', String(card.name === name));
  };
  const press = name => {
    mark(name);
    choose(name);
  };
  const ask = async () => {
    app.forecasts ??= {};
    for (const {name, forecast} of cards) {
      const key = `${app.id}/${app.details.scene}/${name}`;
      app.forecasts[key] ??= await app.server
        .question(['doctor', app.details.scene, '--headers-only', ...(name ? ['-c', name] : [])])
        .then(({findings}) => findings.find(({topic}) => topic === 'forecast')?.text ?? '')
        .catch(error => error.message);
      forecast.textContent = shortForecast(app.forecasts[key]);
      if (!name && app.memory.preset === undefined && /on the CPU/.test(app.forecasts[key]))
        press('cpu_tiny');
      forecast.title = app.forecasts[key];
    }
  };
  mark(chosen);
  return {
    node: el(
      'div.presets',
      {role: 'group', 'aria-label': 'presets'},
      cards.map(({node}) => node),
    ),
    ask,
  };
}

const numberField = (id, label, hint) => {
  const field = el('input', {id, type: 'number', min: 0, inputmode: 'numeric', placeholder: hint});
  return {node: el('label.field', {for: id}, el('span', {}, label), field), field};
};

function runResult({folder, results}, app) {
  if (!results) return null;
  const measured = results.test ?? results.train;
  return el(
    'div',
    {},
    el(
      'p.summary',
      {},
      `${whole(results.num_gaussians)} Gaussians, ${whole(results.iterations)} steps`,
      measured?.psnr ? `, ${fixed(measured.psnr, 2)} dB PSNR` : '',
    ),
    el(
      'div.buttons',
      {},
      el(
        'a.button',
        {href: app.server.file(`${folder}/report.html`), target: '_blank', rel: 'noopener'},
        'Report',
      ),
      button('1,000 more steps', () =>
        app.act(server => server.run(['train', '--resume', folder, '--iterations', '+1000'])),
      ),
    ),
  );
}

export function showTrain(app) {
  const {details, memory} = app;
  if (!details.scene)
    return {
      node: el(
        'main',
        {},
        el(
          'section.card',
          {},
          el('h2', {}, 'Cameras come first'),
          el('p', {}, 'Training needs to know where the photos were taken.'),
          el(
            'div.buttons',
            {},
            button('Find the cameras', () => app.go(app.id, 'cameras'), 'primary'),
          ),
        ),
      ),
      update: () => {},
    };
  const list = jobList(
    app,
    ['train'],
    job => `Run ${job.id}`,
    outcome => runResult(outcome, app),
  );
  const settings = settingsForm(app);
  const presets = presetCards(app, memory.preset ?? '', name => {
    memory.preset = name;
    settings.load().catch(app.fail);
  });
  const steps = numberField('steps', 'Steps', 'by the photos'),
    width = numberField('width', 'Width of the photos', 'up to 1600');
  const measures = el('input', {type: 'checkbox', id: 'eval'});
  const start = () =>
    app.act(server =>
      server.run([
        'train',
        details.scene,
        '-o',
        'run-{id}',
        ...(memory.preset ? ['-c', memory.preset] : []),
        ...(measures.checked ? ['--eval'] : []),
        ...(steps.field.value ? ['--iterations', steps.field.value] : []),
        ...(width.field.value ? ['-r', width.field.value] : []),
        ...settings.words(),
      ]),
    );
  presets.ask();
  const form = el(
    list.newest ? 'details.card.new-run' : 'section.card.new-run',
    {},
    list.newest && el('summary', {}, 'Train again'),
    presets.node,
    el(
      'div.fields',
      {},
      steps.node,
      width.node,
      el(
        'label.field.check',
        {for: 'eval'},
        measures,
        el('span', {}, 'hold out every 8th photo, and measure on it'),
      ),
    ),
    settings.node,
    el('div.buttons', {}, button('Start', start, 'primary')),
  );
  const live = el('div.live');
  let shown = null;
  const update = () => {
    list.update();
    const job = app.project.jobs.find(({id}) => id === list.newest?.id);
    if (!job) return;
    const folder = job.words[job.words.indexOf(job.words.includes('-o') ? '-o' : '--resume') + 1],
      isLive = job.state === 'running' && job.viewer;
    const kind = isLive ? 'live' : !isActive(job) && modelAt(details, folder) ? 'ended' : null;
    if (kind === shown || !kind) return;
    shown = kind;
    const frame = isLive
      ? viewFrame(app.server.live(job.id), 'the run while it trains')
      : viewOfModel(app, folder);
    live.replaceChildren(frame.node);
  };
  return {node: el('main', {}, !list.newest && form, live, list.node, list.newest && form), update};
}
