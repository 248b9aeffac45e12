// SPDX-License-Identifier: Apache-2.0
// The first screen: projects with pictures, and a place for new ones.
import {el} from '../shared/dom.js';
import {button, isActive} from './jobs.js';
import {ProjectServer, createProject} from './server.js';
import {filesOfDrop, filesOfInput, sendFiles} from './uploads.js';

const LONGEST_NAME = 60;

export const cleanName = name =>
  name
    .replaceAll(/[\\/\x00-\x1f\x7f]/g, ' ')
    .replace(/^[.\s]+/, '')
    .trim()
    .slice(0, LONGEST_NAME) || 'project';

/// A place to drop files on, or to choose them. take({name, files}, tell) gets them; what it says
/// stays there.
export function dropZone(words, take) {
  const said = el('p.said', {'aria-live': 'polite'}),
    bar = el('progress', {max: 1, hidden: true, 'aria-label': 'progress of the upload'});
  const begin = async given => {
    const found = await given;
    if (!found.files.length) return;
    const tell = (text, share) => {
      said.textContent = text;
      bar.hidden = share === undefined || share >= 1;
      bar.value = share ?? 0;
    };
    try {
      await take(found, tell);
    } catch (error) {
      tell(error.message);
    }
  };
  const input = (folder, label) => {
    const field = el('input', {
      type: 'file',
      multiple: true,
      webkitdirectory: folder,
      class: 'file-input',
      'aria-label': label,
      onchange: () => begin(filesOfInput(field)),
    });
    return el('label.button', {}, label, field);
  };
  const zone = el(
    'div.drop',
    {
      ondragover: event => {
        event.preventDefault();
        zone.classList.add('is-over');
      },
      ondragleave: () => zone.classList.remove('is-over'),
      ondrop: event => {
        event.preventDefault();
        zone.classList.remove('is-over');
        begin(filesOfDrop(event.dataTransfer));
      },
    },
    el('p.drop-words', {}, words),
    el('div.buttons', {}, input(false, 'Choose files'), input(true, 'Choose a folder')),
    bar,
    said,
  );
  return zone;
}

/// Has what a project begins with checked. Returns the screen to show: of a model alone, that which
/// cleans it.
export async function check(server) {
  const {photos, pictures, videos, scene, models} = await server.details();
  if (!pictures.length && !videos.length && !scene && models.length) return 'clean';
  await server.run(['doctor', photos]);
  return 'photos';
}

/// Sends files to a project. Throws an Error with the first sentence of trouble.
export async function upload(app, server, files, tell) {
  app.uploading = true;
  try {
    const [trouble, ...others] = await sendFiles(server, files, tell);
    if (trouble)
      throw new Error(others.length ? `${trouble} (and ${others.length} more)` : trouble);
  } finally {
    app.uploading = false;
  }
}

function typedFolder(app) {
  const field = el('input', {
    type: 'text',
    id: 'folder',
    placeholder: '/home/me/photos',
    spellcheck: 'false',
    autocomplete: 'off',
  });
  const said = el('p.said', {'aria-live': 'polite'});
  return el(
    'form.typed',
    {
      onsubmit: async event => {
        event.preventDefault();
        const photos = field.value.trim().replace(/(.)\/+$/, '$1');
        try {
          const {id} = await createProject(cleanName(photos.split('/').pop() ?? ''), photos);
          app.go(id, await check(new ProjectServer(id)));
        } catch (error) {
          said.textContent = error.message;
        }
      },
    },
    el('label', {for: 'folder'}, 'or type a folder of this machine; nothing is copied'),
    el('div.row', {}, field, el('button.button', {type: 'submit'}, 'Begin')),
    said,
  );
}

const DOES = {
  doctor: 'Check',
  reconstruct: 'Cameras',
  train: 'Training',
  edit: 'Cleaning',
  render: 'Film',
  export: 'Files to share',
  mesh: 'Mesh',
};
const lastWords = ({jobs}) => {
  const job = jobs.at(-1);
  if (!job) return 'new';
  return `${DOES[job.words[0]] ?? job.words[0]}: ${isActive(job) ? 'runs' : job.state}`;
};

function projectCard(app, project) {
  const state = el('span.muted', {}, lastWords(project)),
    picture = el('div.picture', {'aria-hidden': 'true'});
  const server = new ProjectServer(project.id);
  server
    .details()
    .then(({pictures: [first], turned}) => {
      if (first) picture.append(el('img', {src: server.thumb(first, turned[first]), alt: ''}));
    })
    .catch(() => {});
  const node = el(
    'a.card.project',
    {href: `#p=${encodeURIComponent(project.id)}`},
    picture,
    el('h3', {}, project.name),
    state,
  );
  return {node, id: project.id, update: now => (state.textContent = lastWords(now))};
}

export function showStart(app) {
  const {projects, folder} = app.state;
  const cards = projects.map(project => projectCard(app, project)).reverse();
  const take = async ({name, files}, tell) => {
    const {id} = await createProject(cleanName(name));
    const server = new ProjectServer(id);
    await upload(app, server, files, tell).catch(app.fail); // what has arrived is there
    app.go(id, await check(server));
  };
  return {
    node: el(
      'main.start',
      {},
      el(
        'section.card.new',
        {},
        el('h1', {}, 'From photos to a scene'),
        el(
          'p.muted',
          {},
          'Take 50 to 300 photos around something, each overlapping the one before by two thirds, or walk around it with a video.',
        ),
        dropZone('Drop photos, a folder, a video, a zip, a scene or a model here', take),
        typedFolder(app),
      ),
      app.removed && el('p.place', {role: 'status'}, app.removed),
      cards.length > 0 && el('h2', {}, 'Projects'),
      el(
        'div.projects',
        {},
        cards.map(({node}) => node),
      ),
      el('p.muted.place', {}, 'Everything is in ', el('code', {}, folder)),
    ),
    update: () => {
      for (const card of cards) {
        const now = app.state.projects.find(({id}) => id === card.id);
        if (now) card.update(now);
      }
    },
  };
}
